"""Penitentes: blades of ice left between troughs that sublimation deepens under a high Sun.

Blades stand in rows along the Sun's path, concave between sharp crests, and lean toward the noon Sun. Measured on Earth
in the Andes; the theory of their spacing: Claudin et al. 2015 (Phys. Rev. E 92, 033015). For Europa, Hobley et al. 2018
(Nat. Geosci. 11, 901) predict up to 15 m of depth at 7.5 m of spacing within 23 degrees of the equator; that is
disputed (Matters Arising and correction, 2019), so this is a hypothesis. A height field cannot overhang, so the lean is
limited and the steep side stays a slope.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ....settings.topics.landforms import PenitentesSettings
from ....support.arrays import Array, Numbers
from ..noise.lattice_noise import hash_lattice, to_uniform
from .landform import Crests, Landform, draw_key, rotate_coordinates, sample_shifted_noise, smooth_step

#: Wavelength of the wandering, in blade lengths.
_WANDER_WAVELENGTH = 1.2
#: Largest random offset of a row's crest from the middle between its troughs, in spacings.
_CREST_OFFSET = 0.12
#: Largest offset of a crest with its lean, in spacings.
_MAX_LEAN = 0.35
#: At full disorder: height loss of the lowest group of blades relative to the tallest.
_GROUP_HEIGHT_LOSS = 0.75
#: Width of groups, in spacings.
_GROUP_WIDTH = 5.0
#: Shift of rows from their places, in spacings.
_ROW_SHIFT = 0.8
#: Number of rows over which the shift varies.
_ROW_SHIFT_WAVELENGTH = 3.6
#: Variation of a blade's lean about its row's lean, in spacings.
_LEAN_VARIATION = 0.3
#: Height loss of the lowest blade relative to the tallest, as a share of the variation.
_MIN_BLADE_LOSS = 0.5
#: Depth loss of the shallowest notch between two blades relative to the deepest.
_NOTCH_VARIATION = 0.6
#: Depth of a crest's teeth, as a share of the variation.
_TOOTH_DEPTH = 0.4
#: Length of the teeth, in blade lengths.
_TOOTH_LENGTH = 0.25
#: Shortest wavelength of a mesh, in spacings, up to which crests along its edges are fully sharp.
_SHARP_UP_TO = 0.2


def _random_along_row(place: Array, row: Array, key: int) -> Array:
    """Draw random numbers in [0, 1] along each row, linear between integer positions, because broken ice has pointed
    crests.
    """
    first = np.floor(place)
    index = first.astype(np.int64)
    low, high = (to_uniform(hash_lattice(index + k, row, key)) for k in (0, 1))
    return low + (place - first) * (high - low)


def _crest_height(along: Array, row: Array, variation: float, keys: Sequence[int]) -> Array:
    """Compute the height of the crest line, 0 to 1: blades of random height, toothed, with a notch where one ends.

    ``along`` is in lengths of blades.
    """
    place = along + 17.0 * to_uniform(hash_lattice(row, np.int64(0) * row, keys[0]))
    tall = 1.0 - _MIN_BLADE_LOSS * variation * _random_along_row(place, row, keys[1])
    toothed = 1.0 - _TOOTH_DEPTH * variation * _random_along_row(place / _TOOTH_LENGTH, row, keys[2])
    # Blades end at whole places, in notches of random depth, and are highest half way between.
    end = np.floor(place + 0.5)
    notch = 1.0 - _NOTCH_VARIATION * to_uniform(hash_lattice(end.astype(np.int64), row, keys[3]))
    return tall * toothed * (1.0 - variation * notch * (1.0 - 2.0 * np.abs(place - end)))


def _group_height(x: Array, y: Array, disorder: float, key: int) -> Numbers:
    """Compute the height of a group of blades relative to the tallest group; ``x`` and ``y`` are in group widths."""
    if not disorder:
        return 1.0
    u, v = np.broadcast_arrays(x, y)
    field = sample_shifted_noise(u, v, key) + 0.5 * sample_shifted_noise(2.7 * u, 2.7 * v, key ^ 1)  # rarely beyond 0.6
    return 1.0 - disorder * _GROUP_HEIGHT_LOSS * smooth_step(0.5 + 0.8 * field)


def _blade_height(distance: Array, edge: Array, sharpness: float) -> Array:
    """Compute the height of a blade between its crest, at distance 0, and its trough, at 1. A mesh cannot carry a sharp
    edge and would show it as a saw, so the crest is rounded over ``edge``, which follows from the spacing.
    """
    distance = (np.hypot(distance, edge) - edge) / (np.hypot(1.0, edge) - edge)
    rounded = 1.0 - smooth_step(distance)
    return rounded + sharpness * ((1.0 - distance) ** 2 - rounded)


def make(settings: PenitentesSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make penitentes with the set height from trough to crest, above the ground; None without height."""
    keys = [draw_key(random) for _ in range(7)]
    height, spacing = settings.height_m, settings.spacing_m
    if height == 0.0:
        return None
    more = [draw_key(random) for _ in range(3)]
    disorder, wander, length = settings.disorder, settings.wander, spacing * settings.elongation
    lean = min(math.tan(math.radians(settings.lean_deg)) * height / spacing, _MAX_LEAN - _CREST_OFFSET)

    def offset(x_m: Array, y_m: Array) -> tuple[Array, Array, Array, Array]:
        """Compute the offset of a point from its row's crest, in spacings; the position of the crest, the row, and the
        distance along it.
        """
        across, along = rotate_coordinates(x_m, y_m, settings.noon_azimuth_deg)
        u, v = along / (_WANDER_WAVELENGTH * length), across / (_WANDER_WAVELENGTH * length)
        wide, narrow = sample_shifted_noise(u, v, keys[4]), sample_shifted_noise(2.3 * u, 2.3 * v, keys[5])
        place = across / spacing + wander * wide + 0.5 * wander * narrow
        if disorder:
            over = _ROW_SHIFT_WAVELENGTH * spacing
            place = place + disorder * _ROW_SHIFT * sample_shifted_noise(along / over, across / over, more[0])
        row = np.floor(place + 0.5)
        index = row.astype(np.int64)
        middle = lean + _CREST_OFFSET * (2.0 * to_uniform(hash_lattice(index, np.int64(0) * index, keys[6])) - 1.0)
        if disorder:
            leans = disorder * _LEAN_VARIATION * sample_shifted_noise(along / length, 1.7 * row, more[1])
            middle = np.clip(middle + leans, -_MAX_LEAN, _MAX_LEAN)
        return place - row - middle, middle, index, along

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        beside, middle, index, along = offset(x_m, y_m)
        distance = np.where(beside > 0.0, beside / (0.5 - middle), -beside / (0.5 + middle))  # 0 crest, 1 trough
        blade = _blade_height(distance, np.asarray(shortest_m) / spacing, settings.sharpness)
        tallest = _group_height(x_m / (_GROUP_WIDTH * spacing), y_m / (_GROUP_WIDTH * spacing), disorder, more[2])
        return height * tallest * blade * _crest_height(along / length, index, settings.variation, keys)

    def sharp_heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        """Compute heights in metres; crests are round only where the mesh is too coarse for an edge along them."""
        return heights(x_m, y_m, np.clip(2.0 * (shortest_m - _SHARP_UP_TO * spacing), 0.0, shortest_m))

    crests = Crests([lambda x_m, y_m: spacing * offset(x_m, y_m)[0]], sharp_heights, spacing)
    return Landform(spacing / 2, heights, crests if settings.sharpness > 0.0 else None)

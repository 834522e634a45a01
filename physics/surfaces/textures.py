"""Small texture sets of ice that the code computes: maps whose opposite edges fit together.

Each set is made from one height map, in texture widths. The other maps follow from it, so that bright crests, rough
hollows and normals belong together. The sets are artificial: they replace photographs.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ...settings.topics.surfaces import TexturesSettings
from ...support.arrays import Array
from ..random_numbers.seeds import make_generator

SETS = ("FROST", "GRAINS", "CRACKS")
#: Pixels along a side of every map.
MAP_SIDE_PX = 512
_SEED = 0  # the sets are the same in every data set; where they lie is not


@dataclass(frozen=True)
class TextureSet:
    """Square maps of one set, row 0 at the bottom: ``albedo`` with a mean of 1, ``roughness`` (0 to 1),
    ``height`` from 0 to 1."""

    albedo: Array
    roughness: Array
    height: Array


def _draw_waves(random: np.random.Generator, slope: float, shortest: float, longest: float) -> Array:
    """Draw a periodic random field of unit standard deviation. Its amplitude falls as wave number^-slope between the
    wavelengths ``shortest`` and ``longest``, in texture widths.
    """
    k_x, k_y = np.fft.rfftfreq(MAP_SIDE_PX, 1 / MAP_SIDE_PX), np.fft.fftfreq(MAP_SIDE_PX, 1 / MAP_SIDE_PX)
    k = np.hypot(k_x[None, :], k_y[:, None])
    amplitude = np.where((k >= 1 / longest) & (k <= 1 / shortest), np.maximum(k, 1.0) ** -slope, 0.0)
    field = np.fft.irfft2(
        amplitude * np.fft.rfft2(random.standard_normal((MAP_SIDE_PX, MAP_SIDE_PX))), (MAP_SIDE_PX, MAP_SIDE_PX)
    )
    return np.asarray(field / field.std())


def _draw_cells(random: np.random.Generator, across: int) -> tuple[Array, Array, Array]:
    """Draw across² points, one in each square of a periodic grid, and a random number for each cell around a point.
    Return, for each pixel, the distances in squares to the nearest and second nearest point, and the number of its
    cell.
    """
    jitter, values = random.random((across, across, 2)), random.random((across, across))
    axis = (np.arange(MAP_SIDE_PX) + 0.5) * across / MAP_SIDE_PX
    x, y = axis[None, :], axis[:, None]
    first = np.full((MAP_SIDE_PX, MAP_SIDE_PX), np.inf)
    second, value = first.copy(), first.copy()
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    for j in range(-2, 3):
        for i in range(-2, 3):
            where = (row + j) % across, (column + i) % across
            distance = np.hypot(column + i + jitter[where][..., 0] - x, row + j + jitter[where][..., 1] - y)
            nearer = distance < first
            second = np.where(nearer, first, np.minimum(second, distance))
            value = np.where(nearer, values[where], value)
            first = np.where(nearer, distance, first)
    return first, second, value


def _stretch_to_unit(field: Array) -> Array:
    return (field - field.min()) / np.ptp(field)


def _pack_maps(height: Array, albedo: Array, roughness: Array) -> TextureSet:
    return TextureSet(
        *(
            np.ascontiguousarray(a, np.float32)
            for a in (albedo / albedo.mean(), np.clip(roughness, 0, 1), _stretch_to_unit(height))
        )
    )


@functools.cache
def make_maps(name: str) -> TextureSet:
    """Make the maps of one of ``SETS``. Raises ValueError for another name."""
    random = make_generator(_SEED, "surface", SETS.index(name))
    if name == "FROST":
        # Crystals of hoar: fine relief, brightest on the tips.
        height = _draw_waves(random, 1.2, 1 / 128, 1 / 3)
        return _pack_maps(
            height, 1.0 + 0.06 * height + 0.04 * _draw_waves(random, 1.5, 1 / 64, 1 / 2), 0.65 + 0.1 * height
        )
    if name == "GRAINS":
        # Rounded grains of different brightness, dark in the gaps.
        first, second, value = _draw_cells(random, 24)
        gap = np.clip((second - first) / 0.25, 0.0, 1.0)
        height = np.sqrt(np.clip(1.0 - first**2, 0.0, 1.0)) * (0.7 + 0.3 * value)
        return _pack_maps(height, (0.85 + 0.15 * gap) * (0.9 + 0.2 * value), 0.6 - 0.2 * gap + 0.1 * value)
    # Old crust in plates, with dark cracks between.
    first, second, value = _draw_cells(random, 7)
    crack = np.clip((second - first) / 0.06, 0.0, 1.0)
    fine = _draw_waves(random, 1.3, 1 / 128, 1 / 4)
    height = 0.25 * value + 0.5 * crack + 0.06 * fine
    return _pack_maps(
        height, (0.7 + 0.3 * crack) * (0.92 + 0.16 * value) + 0.03 * fine, 0.4 + 0.2 * value + 0.05 * fine
    )


def uses_uv(textures: TexturesSettings) -> bool:
    """Return whether ``textures`` settings put images on the ground by its UV coordinates; images of a mesh file always
    use them."""
    return bool(textures.set == "MESH" or (textures.set != "NONE" and textures.mapping == "UV"))

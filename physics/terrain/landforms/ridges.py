"""Ridges: double ridges with a central trough, as on Europa's plains; young ridges cross old ridges.

On Europa: hundreds of metres wide on average (to 5 km), up to a few hundred metres high, a V-shaped trough
shallower than the ridge is high, flanks mostly under 20 degrees (Encyclopedia of Planetary Landforms).
Images resolve no narrower ones, so ridges of metres are a hypothesis of scale.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ....settings.topics.landforms import RidgesSettings
from ....support.arrays import Array, Numbers
from ..noise.lattice_noise import hash_lattice, to_uniform
from .landform import Crests, Landform, draw_key, rotate_coordinates, sample_shifted_noise, smooth_step

#: Distance of the crests from the middle, in half widths.
_CREST_PLACE = 0.4
#: Sideways wandering of a ridge, in spacings.
_RIDGE_WANDER = 0.12
#: Wavelength of the wandering, in spacings.
_WANDER_WAVELENGTH = 2.5


def ridge_profile(place: Array, trough: float) -> Array:
    """Compute the height across a ridge, 1 at the crests, at distances ``place`` from the middle in half widths."""
    place = np.abs(place)
    inner = 1.0 - trough * (1.0 - place / _CREST_PLACE)
    down = np.clip((1.0 - place) / (1.0 - _CREST_PLACE), 0.0, 1.0)
    return np.where(place < _CREST_PLACE, inner, 0.5 * (down + smooth_step(down)))


def distance_to_edges(place: Array) -> Array:
    """Compute the signed distance, in half widths, to the nearest edge across a ridge; the edges are both crests and
    the trough.
    """
    far = np.abs(place)
    return np.where(far < _CREST_PLACE / 2, place, np.sign(place) * (_CREST_PLACE - far))


def make(settings: RidgesSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make sets of parallel ridges in different directions, each crossing the sets before it; None without height."""
    most = 6
    keys = [draw_key(random) for _ in range(2 * most)]
    turns = random.uniform(-1.0, 1.0, most)
    height, width, spacing = settings.height_m, settings.width_m, settings.spacing_m
    sets = int(settings.sets)
    if height == 0.0:
        return None
    # Ridges of a set must not overlap: their middles keep a width between them.
    spacing = max(spacing, 1.2 * width)
    loose = 1.0 - width / spacing

    def one_set(k: int, x_m: Array, y_m: Array) -> Array:
        """Compute the distance to the ridge of the set's strip, in half widths."""
        along, across = rotate_coordinates(x_m, y_m, settings.azimuth_deg + turns[k] * settings.spread_deg)
        place = across / spacing + _RIDGE_WANDER * sample_shifted_noise(
            along / (_WANDER_WAVELENGTH * spacing), across / (4 * spacing), keys[2 * k]
        )
        strip = np.floor(place)
        index = strip.astype(np.int64)
        middle = strip + 0.5 + loose * (to_uniform(hash_lattice(index, np.int64(0) * index, keys[2 * k + 1])) - 0.5)
        return (place - middle) * (2.0 * spacing / width)

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        total = np.zeros(np.broadcast_shapes(np.shape(x_m), np.shape(y_m)))
        for k in range(sets):
            place = one_set(k, x_m, y_m)
            # A younger ridge buries the older relief, from its foot inward.
            total *= 1.0 - smooth_step(2.0 * (1.0 - np.abs(place)))
            total += height * ridge_profile(place, settings.trough)
        return total

    def line(k: int, x_m: Array, y_m: Array) -> Array:
        return width / 2 * distance_to_edges(one_set(k, x_m, y_m))

    crests = Crests([partial(line, k) for k in range(sets)], heights, _CREST_PLACE * width / 2)
    return Landform(width * min(_CREST_PLACE, 1 - _CREST_PLACE) / 2, heights, crests)

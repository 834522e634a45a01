"""Penitentes: blades of ice left between troughs that sublimation deepens under a high Sun.

Blades stand in rows along the Sun's path, concave between sharp crests, and lean toward the noon Sun.
Measured on Earth in the Andes; the theory of their spacing: Claudin et al. 2015 (Phys. Rev. E 92,
033015). For Europa, Hobley et al. 2018 (Nat. Geosci. 11, 901) predict up to 15 m of depth at 7.5 m of
spacing within 23 degrees of the equator; that is disputed (Matters Arising and correction, 2019), so this is a
hypothesis. A height field cannot overhang: the lean is held to what leaves the steep side a slope.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..noise import hashed, uniform
from .common import Landform, key_of, smooth, turned, wandering

#: Sideways wandering of the rows, in spacings.
_WANDER = 0.3
#: Furthest the crest leans from the middle of its blade, in spacings.
_MOST_LEAN = 0.35


def make(settings: Mapping[str, Any], random: np.random.Generator, size_m: float) -> Landform | None:
    """Penitentes of the stated height, crest to trough, above the ground."""
    keys = [key_of(random) for _ in range(3)]
    height, spacing = settings["height_m"], settings["spacing_m"]
    if height == 0.0:
        return None
    length = spacing * settings["elongation"]
    sharpness, variation = settings["sharpness"], settings["variation"]
    lean = math.tan(math.radians(settings["lean_deg"])) * height / spacing
    lean = min(lean, _MOST_LEAN)

    def crest(along: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Height of the crest line, 0 to 1: spikes of random height with saddles between them."""
        shifted = along / length + 17.0 * uniform(hashed(row, np.int64(0) * row, keys[0]))
        spike = np.floor(shifted)
        here = shifted - spike
        index = spike.astype(np.int64)
        low, high = (uniform(hashed(index + k, row, keys[1])) for k in (0, 1))
        tall = 1.0 - variation * (low + smooth(here) * (high - low))
        return tall * (1.0 - variation * 4.0 * here * (1.0 - here))

    def heights(x_m: np.ndarray, y_m: np.ndarray, shortest_m: Any) -> np.ndarray:
        across, along = turned(x_m, y_m, settings["noon_azimuth_deg"])
        place = across / spacing + _WANDER * wandering(along / length, across / (3.0 * spacing), keys[2])
        row = np.floor(place + 0.5)
        offset = place - row - lean
        distance = np.where(offset > 0.0, offset / (0.5 - lean), -offset / (0.5 + lean))  # 0 crest, 1 trough
        rounded = 1.0 - smooth(distance)
        blade = rounded + sharpness * ((1.0 - distance) ** 2 - rounded)
        return height * blade * crest(along, row.astype(np.int64))

    return Landform(spacing / 2, heights)

"""Mantling: fall-out that lies thick in hollows and thin on heights.

Plume fall-out on Enceladus, and frost, smooth ground that is lower than its surroundings; ridges stay as they are.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array


def snow_depth_m(below_m: Array, thickness_m: float) -> Array:
    """Metres of snow on ground that lies ``below_m`` under its smoothed surroundings (negative: above). Shallow hollows
    are filled to that surface, deep ones by ``thickness_m``, with a smooth transition: e - e²/4T up to e = 2T, then T.
    """
    if thickness_m == 0.0:
        return np.zeros_like(below_m)
    e = np.clip(below_m, 0.0, 2.0 * thickness_m)
    return e - e * e / (4.0 * thickness_m)

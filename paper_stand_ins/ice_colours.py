"""Albedos of snow and of bubbly ice in red, green and blue, from the absorption of pure ice.

Absorption of ice at -7 °C: Warren and Brandt 2008, J. Geophys. Res. 113, D14220, at the effective wavelengths of a
camera's bands (630, 544 and 480 nm: Hayes et al. 2021, Space Sci. Rev. 217, 29). Albedo of snow: Kokhanovsky and Zege
2004, Appl. Opt. 43, 1589, with the grain shape of Libois et al. 2013; of ice with bubbles: the same asymptotic law.
"""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array

#: Absorption in 1/m: red, green, blue.
ABSORPTION_PER_M = np.array([0.207, 0.0460, 0.00749])
#: Density of ice.
_ICE_KG_M3 = 917.0
#: Factor on the absorption by the shape of grains.
_ABSORPTION_ENHANCEMENT = 1.6
#: Asymmetry of scattering.
_ASYMMETRY = 0.845


def snow_albedo(radius_m: float | Array) -> Array:
    """Albedo (..., 3) under light from all sides of deep snow whose grains have this optical radius."""
    radius = np.asarray(radius_m, float)[..., None]
    surface = 3.0 / (_ICE_KG_M3 * radius)  # m² / kg
    lost = 2.0 * _ABSORPTION_ENHANCEMENT * ABSORPTION_PER_M / (_ICE_KG_M3 * surface)
    return np.asarray(np.exp(-np.sqrt(16.0 / 3.0 * lost / (1.0 - _ASYMMETRY))))


def ice_albedo(bubble_share: float | Array, bubble_radius_m: float = 0.0005) -> Array:
    """Albedo (..., 3) under light from all sides of deep ice with this share of its volume in bubbles."""
    share = np.asarray(bubble_share, float)[..., None]
    ratio = ABSORPTION_PER_M * (1.0 - share) * (4.0 * bubble_radius_m / 3.0) / (0.63 * share)
    return np.asarray(np.exp(-4.0 * np.sqrt(ratio)))

"""Sunlight in the solar system: irradiance, apparent size and colour."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array
from .photons import planck_radiance

SOLAR_CONSTANT_WM2 = 1361.0  # at 1 au; IAU 2015 nominal
SUN_RADIUS_KM = 695700.0  # IAU 2015 nominal
AU_KM = 149597870.7  # IAU 2012
SUN_TEMPERATURE_K = 5772.0  # effective; IAU 2015 nominal

#: Wavelengths in metres of the bands R, G, B, for the colour of a Sun of another temperature.
BANDS_M = (620e-9, 550e-9, 460e-9)


def sun_irradiance_wm2(distance_au: float) -> float:
    """Compute the solar irradiance in W/m², over all wavelengths, on a facing surface at a heliocentric distance."""
    return SOLAR_CONSTANT_WM2 / distance_au**2


def apparent_diameter_deg(radius_km: float, distance_km: float) -> float:
    """Compute the apparent diameter in degrees of a sphere whose centre is at a distance: 2 asin(R/d), not the
    small-angle 2R/d.
    """
    if distance_km <= radius_km:
        return 180.0
    return math.degrees(2 * math.asin(radius_km / distance_km))


def sun_diameter_deg(distance_au: float) -> float:
    """Compute the apparent diameter in degrees of the Sun at a heliocentric distance."""
    return apparent_diameter_deg(SUN_RADIUS_KM, distance_au * AU_KM)


def sun_colour(temperature_k: float) -> Array:
    """Compute the light (3,) of a black body relative to sunlight in the bands R, G, B, divided by the mean over the
    bands.
    """
    wavelength = np.array(BANDS_M)
    ratio = planck_radiance(wavelength, temperature_k) / planck_radiance(wavelength, SUN_TEMPERATURE_K)
    return np.asarray(ratio / ratio.mean())

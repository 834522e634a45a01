"""Sunlight that the ground scatters into a laser's receiver."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from ..light.photons import LIGHT_M_S, PLANCK_J_S, planck_radiance, total_radiance
from ..light.sunlight import SUN_TEMPERATURE_K


def background_photons_1_s(
    sun_w_m2: float,
    cos_incidence: Numbers,
    brdf_1_sr: Numbers,
    wavelength_nm: float,
    filter_nm: float,
    aperture_m: float,
    field_rad: float,
    transmission: float = 1.0,
) -> Array:
    """Compute the photons per second of sunlight on the detector: E_λ cos i f_r Δλ Ω A τ / hν.

    ``sun_w_m2`` is the Sun's irradiance over all wavelengths, as in the settings. Its spectrum is the black body of
    5772 K, within 10 % of the Sun's above 450 nm. ``filter_nm`` is the width of the filter, ``aperture_m`` the diameter
    of the receiver and ``field_rad`` its full field of view. The distance of the ground cancels. Raises IcyMoonError
    for impossible values.
    """
    for name, value in (("wavelength", wavelength_nm), ("filter", filter_nm), ("aperture", aperture_m)):
        if not 0.0 < value < math.inf:
            raise IcyMoonError(f"The {name} of the receiver is {value:g}; give more than 0.")
    if not 0.0 < field_rad <= math.pi:
        raise IcyMoonError(f"The field of view of the receiver is {field_rad:g} rad; give more than 0 and at most π.")
    wavelength = wavelength_nm * 1e-9
    spectral = sun_w_m2 * float(planck_radiance(wavelength, SUN_TEMPERATURE_K)) / total_radiance(SUN_TEMPERATURE_K)
    area = math.pi * aperture_m**2 / 4.0
    solid_angle = 4.0 * math.pi * math.sin(field_rad / 4.0) ** 2
    power = spectral * filter_nm * 1e-9 * solid_angle * area * transmission
    lit = np.maximum(np.asarray(cos_incidence, np.float64), 0.0) * np.asarray(brdf_1_sr, np.float64)
    return np.asarray(lit * power * wavelength / (PLANCK_J_S * LIGHT_M_S))

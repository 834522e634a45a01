"""From radiance to photo-electrons per second: aperture, band, quantum efficiency, pixel area.

In this module ``light`` and ``sensor`` are the settings topics of these names.
"""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import RigSettings, SensorSettings
from ...settings.topics.light import LightSettings
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError

# CODATA 2018, exact.
PLANCK_J_S = 6.62607015e-34
LIGHT_M_S = 299792458.0
BOLTZMANN_J_K = 1.380649e-23

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


def planck_radiance(wavelength_m: Numbers, temperature_k: float) -> Array:
    """Compute the spectral radiance of a black body, W/(m² sr m), at wavelengths in metres."""
    wavelength = np.asarray(wavelength_m, np.float64)
    x = PLANCK_J_S * LIGHT_M_S / (wavelength * BOLTZMANN_J_K * temperature_k)
    # exp(-x) / -expm1(-x) is 1 / expm1(x) without overflow.
    return 2 * PLANCK_J_S * LIGHT_M_S**2 / wavelength**5 * np.exp(-x) / -np.expm1(-x)


def total_radiance(temperature_k: float) -> float:
    """Compute the radiance of a black body over all wavelengths, W/(m² sr): σT⁴/π."""
    sigma = 2 * math.pi**5 * BOLTZMANN_J_K**4 / (15 * PLANCK_J_S**3 * LIGHT_M_S**2)
    return sigma * temperature_k**4 / math.pi


def _sample_band(sensor: SensorSettings) -> tuple[Array, Array]:
    """Return wavelengths in metres across the camera's band and the weights of an integral over it."""
    half = sensor.band_width_nm * 0.5e-9
    centre = sensor.band_centre_nm * 1e-9
    low = max(centre - half, 1e-9)
    high = centre + half
    if sensor.colour != "MONO":
        low, high = sensor.cut_on_nm * 1e-9, sensor.cut_off_nm * 1e-9
        if low >= high:
            raise IcyMoonError(
                f"sensor.cut_on_nm is {sensor.cut_on_nm:g} and sensor.cut_off_nm {sensor.cut_off_nm:g}; "
                "make the first one the shorter wavelength."
            )
    return (high + low) / 2 + (high - low) / 2 * _NODES, (high - low) / 2 * _WEIGHTS


def band_share(light: LightSettings, sensor: SensorSettings) -> float:
    """Compute the share of the Sun's power in the camera's band, with the Sun as a black body. At 5772 K the black body
    is within 10 % of the solar spectrum in bands 100 nm wide from 450 nm on.
    """
    wavelength, weight = _sample_band(sensor)
    temperature = float(light.sun_temperature_k)
    return float((planck_radiance(wavelength, temperature) * weight).sum() / total_radiance(temperature))


def photons_per_joule(light: LightSettings, sensor: SensorSettings) -> float:
    """Compute the photons in the camera's band per joule of light in the band that ``light.irradiance_band`` names."""
    wavelength, weight = _sample_band(sensor)
    power = planck_radiance(wavelength, float(light.sun_temperature_k)) * weight
    photons = float((power * wavelength).sum() / power.sum() / (PLANCK_J_S * LIGHT_M_S))
    return photons if light.irradiance_band == "CAMERA" else photons * band_share(light, sensor)


def photons_by_wavelength(light: LightSettings, sensor: SensorSettings) -> tuple[Array, Array]:
    """Return wavelengths (n,) in metres across the camera's band, and the part of ``photons_per_joule`` that each
    represents.
    """
    wavelength, weight = _sample_band(sensor)
    each = planck_radiance(wavelength, float(light.sun_temperature_k)) * weight * wavelength
    return wavelength, photons_per_joule(light, sensor) * each / each.sum()


def pixel_pitch_m(sensor: SensorSettings, rig: RigSettings) -> float:
    """Return the side of a pixel in metres: the stated pitch, or else the rig's sensor width over its columns.

    The field of view depends on the rig alone. The paper's rig, with 60 mm behind 640 columns, has the view of a real
    camera, but its pixels would be 94 µm wide and gather sixty times the light.
    """
    stated = float(sensor.pixel_pitch_um) * 1e-6
    return stated if stated > 0 else float(rig.sensor_width_mm) * 1e-3 / int(rig.width_px)


def optics_m2_sr(sensor: SensorSettings, pitch_m: float) -> float:
    """Compute the watts on a pixel of side ``pitch_m`` per W/(m² sr) of radiance.

    EMVA 1288, release 4.0: the irradiance is E = π τ L / (1 + 4 N²) for f-number N, transmission τ and radiance L.
    """
    irradiance = math.pi * float(sensor.transmission) / (1 + 4 * float(sensor.f_number) ** 2)
    return irradiance * pitch_m**2


def electron_rate(light: LightSettings, sensor: SensorSettings, pitch_m: float) -> float:
    """Compute the photo-electrons per second of a monochrome sensor in a pixel of side ``pitch_m`` per W/(m² sr) of
    radiance: photons on the pixel's area times quantum efficiency.
    """
    return optics_m2_sr(sensor, pitch_m) * float(sensor.quantum_efficiency) * photons_per_joule(light, sensor)

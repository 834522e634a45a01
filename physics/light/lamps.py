"""Lamps: their radiant power, their intensity and their factors at evaluation. Imports no Blender.

A lamp's stated light is its radiant power from 400 to 700 nm. Within these wavelengths its spectrum is the spectrum of
a black body of its colour temperature. A pair's channels state visible light relative to visible sunlight, times all
sunlight, see ``bands``. So a lamp of Φ watts counts as Φ over the share of sunlight from 400 to 700 nm.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...settings.topics.light import Lamp, LightSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from ...support.labels import LAMP_GROUPS, LIGHT_GROUPS
from .photons import band_share, planck_radiance, total_radiance

#: Wavelengths in metres between which the power of a lamp is stated.
BAND_M = (400e-9, 700e-9)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


def list_lamp_groups(light: LightSettings) -> tuple[str, ...]:
    """List the light groups of the lamps, in the order of the lamps."""
    return LAMP_GROUPS[: len(light.lamps)]


def radiant_power_w(lamp: Lamp) -> float:
    """Compute the radiant power, in W, that leaves a lamp from 400 to 700 nm."""
    return float(lamp.power_w) * float(lamp.efficiency)


def visible_share(temperature_k: float) -> float:
    """Compute the share of a black body's light from 400 to 700 nm."""
    low, high = BAND_M
    wavelength = (high + low) / 2 + (high - low) / 2 * _NODES
    within = float((planck_radiance(wavelength, temperature_k) * _WEIGHTS).sum()) * (high - low) / 2
    return within / total_radiance(temperature_k)


def pair_power_w(lamp: Lamp, light: LightSettings) -> float:
    """Compute the power of a lamp in the unit of a pair's channels, in W: the mean of R, G and B."""
    return radiant_power_w(lamp) / visible_share(float(light.sun_temperature_k))


def spot_share(cone_deg: float, blend: float) -> float:
    """Compute the flux of Blender's spot over its energy.

    Its intensity is energy / 4π times smoothstep((cos θ - cos h) / (blend (1 - cos h))) within the half angle h; the
    flux is the integral of this intensity.
    """
    return (1.0 - math.cos(math.radians(cone_deg) / 2)) * (1.0 - blend / 2) / 2


def intensity(lamp: Lamp, cosine: Numbers) -> Array:
    """Compute the intensity over power, 1/sr, far from a lamp, by the cosine of the angle from the direction in which
    it shines. Raises ValueError for an IES lamp, whose intensity is in its table.
    """
    cosine = np.asarray(cosine, np.float64)
    if lamp.kind == "IES":
        raise ValueError("the intensity of an IES lamp is in its table")
    if lamp.kind == "AREA":
        return np.maximum(cosine, 0.0) / math.pi
    if lamp.kind == "POINT":
        return np.full(cosine.shape, 0.25 / math.pi)
    edge = math.cos(math.radians(lamp.cone_deg) / 2)
    t = np.clip((cosine - edge) / max(lamp.blend * (1.0 - edge), 1e-9), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t) / (4.0 * math.pi * spot_share(lamp.cone_deg, lamp.blend)))


def estimate_irradiance_wm2(light: LightSettings, distance_m: float) -> float:
    """Estimate the irradiance of a facing surface at a distance straight before all lamps together, in the unit of a
    pair. An IES lamp counts as an area, since its file is not read.
    """
    ahead = (
        pair_power_w(lamp, light) * (1 / math.pi if lamp.kind == "IES" else float(intensity(lamp, 1.0)))
        for lamp in light.lamps
    )
    return sum(ahead) / distance_m**2


def read_factors(light: LightSettings) -> list[float]:
    """Read the factors of the lamps at evaluation, from ``light.lamp_scales``. Raises IcyMoonError if their number is
    not the number of lamps.
    """
    stated = [float(part) for part in str(light.lamp_scales).split(",") if part.strip()]
    if stated and len(stated) != len(light.lamps):
        raise IcyMoonError(
            f"light.lamp_scales has {len(stated)} numbers, but light.lamps has {len(light.lamps)}; write one number "
            "for each lamp, or leave it empty for 1."
        )
    return stated or [1.0] * len(light.lamps)


def find_light_factors(settings: Settings) -> dict[str, float]:
    """Find the factor of each light group of a pair at evaluation.

    With ``light.irradiance_band`` CAMERA the Sun's channels are light in the camera's band. The channels of lamps are
    not, so their factors contain the share of the band. Raises IcyMoonError as ``read_factors`` does.
    """
    light = settings.light
    found = {group: float(light[key]) for group, key in LIGHT_GROUPS.items()}
    if not light.lamps:
        return found
    band = band_share(light, settings.sensor) if light.irradiance_band == "CAMERA" else 1.0
    factors = read_factors(light)
    return found | {group: factor * band for group, factor in zip(list_lamp_groups(light), factors, strict=True)}


def is_light_scaled(settings: Settings) -> bool:
    """Return whether an image at evaluation needs the light groups of the pair, because a factor differs from 1."""
    return any(factor != 1 for factor in find_light_factors(settings).values())


def switch_lamps_off(settings: Settings) -> Settings:
    """Return the settings with the factors of all lamps 0, for the radiance of Sun and planet without lamps."""
    if not settings.light.lamps:
        return settings
    dark = settings.light | {"lamp_scales": ", ".join("0" for _ in settings.light.lamps)}
    return Settings(settings | {"light": dark})


def gives_light(light: LightSettings) -> bool:
    """Return whether any lamp shines."""
    return any(radiant_power_w(lamp) > 0 for lamp in light.lamps)


def describe_lamp(lamp: Lamp, light: LightSettings) -> dict[str, Any]:
    """Describe the constants of a lamp for ``pair.json``."""
    return {
        "kind": lamp.kind,
        "radiant_w_400_700_nm": radiant_power_w(lamp),
        "pair_w": pair_power_w(lamp, light),
        "temperature_k": lamp.temperature_k,
    }

"""Reflectances of clean ice and of salts in the bands of ``bands``, from settings."""

from __future__ import annotations

from ...settings.topics.surfaces import HapkeSettings, SurfaceSettings
from ..surfaces.surface_law import find_albedos
from .bands import bubbly_ice_bands, material_bands, snow_bands

#: Reflectances in R, G, B.
Bands = tuple[float, float, float]
_WHITE = (1.0, 1.0, 1.0)


def clean_albedo(surface: SurfaceSettings, hapke: HapkeSettings | None) -> float:
    """Find the albedo of clean ice in even light, at least 0.001; colours are factors on it."""
    found = find_albedos(surface, hapke) if surface.model == "HAPKE" and hapke is not None else None
    return max(surface.albedo if found is None else found.bond, 1e-3)


def ice_tint(surface: SurfaceSettings, albedo: float) -> Bands:
    """Compute the colour of clean ice. The mean of its bands is 1, so that ``albedo`` stays the mean reflectance, and
    no band reflects more light than it receives.
    """
    if surface.ice_colour == "GREY":
        return _WHITE
    bands = (
        snow_bands(float(surface.snow_grain_m)) if surface.ice_colour == "SNOW" else material_bands(surface.ice_colour)
    )
    red, green, blue = (min(3 * band / sum(bands), max(1.0, 1 / albedo)) for band in bands)
    return red, green, blue


def salt_colour(surface: SurfaceSettings, albedo: float) -> Bands:
    """Compute the colour of salt-covered ground, a factor on the albedo of clean ice."""
    if surface.salt == "OWN":
        return _times(ice_tint(surface, albedo), _own_salt(surface))
    return _times(material_bands(surface.salt), (1 / albedo,) * 3)


def ice_and_salt_bands(surface: SurfaceSettings, hapke: HapkeSettings) -> tuple[Bands, Bands]:
    """Compute the reflectances of clean ice and of salt-covered ground. For bubbly ice they are the mean over its
    depth.
    """
    if surface.model == "PRINCIPLED" and surface.bubble_share > 0.0:
        ice = bubbly_ice_bands(surface.bubble_radius_m, surface.bubble_share)
        return ice, _times(ice, _own_salt(surface)) if surface.salt == "OWN" else material_bands(surface.salt)
    albedo = clean_albedo(surface, hapke)
    return _times(ice_tint(surface, albedo), (albedo,) * 3), _times(salt_colour(surface, albedo), (albedo,) * 3)


def _own_salt(surface: SurfaceSettings) -> Bands:
    """Return the user's own salt, relative to clean ice."""
    return float(surface.salt_red), float(surface.salt_green), float(surface.salt_blue)


def _times(one: Bands, other: Bands) -> Bands:
    """Multiply two triples, band by band."""
    red, green, blue = (a * b for a, b in zip(one, other, strict=True))
    return red, green, blue

"""The photometric law that surface settings describe, and its normal, geometric and Bond albedos."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import NamedTuple

from ...settings.topics.surfaces import HapkeSettings, SurfaceSettings
from . import photometry
from .hapke import HapkeParameters, bidirectional_reflectance, hapke_from_settings
from .snow import snow_law


class Albedos(NamedTuple):
    """Normal, geometric and Bond albedo."""

    normal: float
    geometric: float
    bond: float


def make_law(surface: SurfaceSettings, hapke: HapkeSettings) -> photometry.Law | None:
    """Make the reflectance law of ``surface`` settings, without albedo patches and relief; None for Principled snow,
    which has no closed form. Raises IcyMoonError for parameters that are physically impossible."""
    if surface.model == "PRINCIPLED":
        return None
    if surface.model == "HAPKE":
        return partial(bidirectional_reflectance, parameters=hapke_from_settings(hapke))
    if surface.model == "SNOW":
        return snow_law(surface.albedo)
    share = {"LAMBERT": 0.0, "LOMMEL_SEELIGER": 1.0}.get(surface.model, surface.lommel_seeliger_share)
    return photometry.lunar_lambert(surface.albedo, share)


@lru_cache(maxsize=32)
def _compute_hapke_albedos(parameters: HapkeParameters) -> Albedos:
    return _compute_albedos(partial(bidirectional_reflectance, parameters=parameters))


def _compute_albedos(law: photometry.Law) -> Albedos:
    return Albedos(photometry.normal_albedo(law), photometry.geometric_albedo(law), photometry.bond_albedo(law))


def find_albedos(surface: SurfaceSettings, hapke: HapkeSettings) -> Albedos | None:
    """Compute the albedos of ``surface`` settings; None for Principled snow. The albedos of Hapke's law are cached."""
    if surface.model == "HAPKE":
        return _compute_hapke_albedos(hapke_from_settings(hapke))
    law = make_law(surface, hapke)
    return None if law is None else _compute_albedos(law)

"""The albedo of a surface as a value pass, which a render from straight above writes as a map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...physics.surfaces import photometry
from ...physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array
from ...support.labels import ALBEDO_AOV
from ..tree.builder import Socket, Tree, Triple, Value

#: Number of factors on w at which the albedo of Hapke's law is computed. Between them it is linear, within 0.002.
_FACTOR_STEPS = 17


def add_albedo_pass(
    tree: Tree,
    surface: SurfaceSettings,
    settings: Settings | None,
    grey: Value,
    reflectance: Value,
    least: float,
    frosted: Socket | None = None,
) -> None:
    """Add the pass ``ALBEDO_AOV``: the albedo in even light, in the bands of ``physics.light.bands``.

    ``reflectance`` is albedo x grey x colour, a number or an output socket; for Hapke's law it is the colour alone, and
    ``grey`` the factor on w, at least ``least``. ``frosted`` is an output socket of the share of frost over it, or
    None.
    """
    found: Triple = (*[reflectance] * 3, 1.0) if isinstance(reflectance, (int, float)) else reflectance
    if surface.model == "HAPKE" and settings is not None:
        factors, bond = compute_hapke_curve(settings, 1.0 if isinstance(grey, float) else least)
        level: Value = float(bond[-1]) if isinstance(grey, float) else tree.curve("Albedo of w", grey, factors, bond)
        vector = found[:3] if isinstance(found, tuple) else found
        found = tree.vector("MULTIPLY", "Albedo by Band", vector, (level,) * 3 if isinstance(level, float) else level)
    if frosted is not None:
        frost = (*[float(surface.frost_albedo)] * 3, 1.0)
        found = tree.mixed("Albedo with Frost", frosted, found, frost)
    tree.value_pass("Albedo", ALBEDO_AOV, found)


def compute_hapke_curve(settings: Settings, least: float) -> tuple[Array, Array]:
    """Compute the Bond albedo of Hapke's law for factors on w from ``least`` to 1. Return the factors and the
    albedos."""
    known = hapke_from_settings(settings.hapke)
    factors = np.unique(np.linspace(least, 1.0, _FACTOR_STEPS))

    def bond(factor: float) -> float:
        dimmed = replace(known, w=known.w * factor)
        return photometry.bond_albedo(lambda i, e, azimuth: bidirectional_reflectance(i, e, azimuth, dimmed))

    return factors, np.array([bond(float(factor)) for factor in factors])

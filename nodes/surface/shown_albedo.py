"""The albedo of a surface as a value pass, which a render from straight above writes as a map."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...physics.surfaces import photometry
from ...physics.surfaces.hapke import bidirectional_reflectance, from_settings
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array
from ...support.labels import ALBEDO_AOV
from ..tree.builder import Tree, output

#: Factors on w at which the albedo of Hapke's law is computed; between them it is linear, within 0.002.
_STEPS = 17


def add_albedo_pass(
    tree: Tree,
    surface: SurfaceSettings,
    settings: Settings | None,
    grey: Any,
    reflectance: Any,
    least: float,
    frosted: Any = None,
) -> None:
    """Add the pass ``ALBEDO_AOV``: the albedo in even light, in the bands of ``physics.light.bands``.

    ``reflectance`` is albedo x grey x colour, a number or an output socket; for Hapke's law it is the colour alone, and
    ``grey`` the factor on w, at least ``least``. ``frosted`` is an output socket of the share of frost over it, or
    None.
    """
    found: Any = (*[reflectance] * 3, 1.0) if isinstance(reflectance, (int, float)) else reflectance
    if surface.model == "HAPKE" and settings is not None:
        factors, bond = hapke_curve(settings, 1.0 if isinstance(grey, float) else least)
        level: Any = float(bond[-1]) if isinstance(grey, float) else tree.curve("Albedo of w", grey, factors, bond)
        found = _add_product(tree, found, (level,) * 3 if isinstance(level, float) else level)
    if frosted is not None:
        frost = (*[float(surface.frost_albedo)] * 3, 1.0)
        found = output(
            tree.node(
                "ShaderNodeMix",
                "Albedo with Frost",
                {"Factor_Float": frosted, "A_Color": found, "B_Color": frost},
                data_type="RGBA",
                blend_type="MIX",
                clamp_factor=True,
                clamp_result=False,
            ),
            "Result_Color",
        )
    tree.node("ShaderNodeOutputAOV", "Albedo", {"Color": found, "Value": 0.0}, aov_name=ALBEDO_AOV)


def _add_product(tree: Tree, colour: Any, level: Any) -> Any:
    vector = colour[:3] if isinstance(colour, tuple) else colour
    return tree.node(
        "ShaderNodeVectorMath", "Albedo by Band", {"Vector": vector, "Vector_001": level}, operation="MULTIPLY"
    ).outputs[0]


def hapke_curve(settings: Settings, least: float) -> tuple[Array, Array]:
    """Factors on w from ``least`` to 1, and the Bond albedo of Hapke's law with each."""
    known = from_settings(settings.hapke)
    factors = np.unique(np.linspace(least, 1.0, _STEPS))

    def bond(factor: float) -> float:
        dimmed = replace(known, w=known.w * factor)
        return photometry.bond_albedo(lambda i, e, azimuth: bidirectional_reflectance(i, e, azimuth, dimmed))

    return factors, np.array([bond(float(factor)) for factor in factors])

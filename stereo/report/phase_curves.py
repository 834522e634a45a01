"""The phase curves of the surfaces in an evaluation's pairs, if their reflectance laws have one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ...physics import scene_requirements
from ...physics.surfaces import photometry, surface_law
from ...settings.topics.scene import typed
from ...settings.topics.surfaces import HapkeSettings, SurfaceSettings
from ...support.arrays import Array

#: Most laws that are drawn.
MAX_LAWS = 6
#: Phase angles in degrees, densest near 0, where the opposition surge is.
PHASE_DEG = 160.0 * np.linspace(0.0, 1.0, 121) ** 3


def compute_phase_curves(pairs: Iterable[Mapping[str, Any]]) -> dict[str, Array]:
    """Compute the brightness (n,) at ``PHASE_DEG``, relative to the brightness at opposition, of each law in the pairs'
    facts, by its name.
    """
    found: dict[str, Array] = {}
    for pair in pairs:
        if not pair["settings"]:
            continue  # it was not rendered here
        settings = typed(pair["settings"])
        for topic in scene_requirements.surface_topics(settings):
            surface, hapke = settings[topic], settings.hapke
            name = _make_law_name(surface, hapke)
            if len(found) == MAX_LAWS:
                return found
            if name and name not in found:
                law = surface_law.make_law(surface, hapke)
                assert law is not None
                found[name] = photometry.phase_curve(law, np.radians(PHASE_DEG))
    return found


def _make_law_name(surface: SurfaceSettings, hapke: HapkeSettings) -> str:
    """Name a law with its parameters; "" if it has no closed form or reflects nothing."""
    if surface.model == "PRINCIPLED" or (hapke.w if surface.model == "HAPKE" else surface.albedo) == 0:
        return ""
    if surface.model != "HAPKE":
        share = f", {surface.lommel_seeliger_share:g} Lommel-Seeliger" if surface.model == "LUNAR_LAMBERT" else ""
        share = f", albedo {surface.albedo:g}" if surface.model == "SNOW" else share
        return surface.model.replace("_", "-").title() + share
    keys = ("w", "b", "c", "b_s0", "h_s", "b_c0", "h_c", "theta_bar_deg")
    return "Hapke " + ", ".join(f"{key} {hapke[key]:g}" for key in keys if key == "w" or hapke[key] != 0.0)

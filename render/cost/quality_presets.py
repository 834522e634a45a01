"""The quality presets, each with its cost on this machine and its stereo error. Imports no Blender."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from ...physics.scene_requirements import is_baked
from ...settings.description import merged
from ...settings.preset_files import find_preset, load, preset_names, read_preset_header
from ...settings.toml_text import read_toml
from ...settings.topics.scene import Settings
from ..plans.baked_or_traced import estimate_bake_seconds, resolve_auto_indirect
from .blender_abilities import Abilities, describe_lack
from .estimate import estimate_prior_spread, estimate_roughly, estimate_work, format_duration
from .machine_speed import Speed, to_wall_seconds


@dataclass(frozen=True)
class QualityPreset:
    """A quality preset with its cost and error for a scene.

    In 19 of 20 cases a further pair takes between ``seconds`` divided by ``factor`` and ``seconds`` times ``factor`` by
    the clock. ``errors`` are measured, see ``list_qualities``.
    """

    name: str
    title: str
    seconds: float
    factor: float
    errors: Mapping[str, Any]
    lacks: str = ""  # the feature that Blender lacks for this quality, with the fix
    chosen: bool = False  # whether the settings of the scene equal this quality

    @property
    def cost(self) -> str:
        """Cost in words, for example '12 s (8 s to 18 s)', or the feature that Blender lacks."""
        if self.lacks:
            return self.lacks
        low, high = format_duration(self.seconds / self.factor), format_duration(self.seconds * self.factor)
        return f"{format_duration(self.seconds)} ({low} to {high})"

    @property
    def brief(self) -> str:
        """Cost and error in short, for example '12 s, +0.03 px': the seconds of a pair, and the measured error, if any,
        that the quality adds to the error of SGBM."""
        added = f", {self.errors['sgbm_px']:+.2f} px" if self.errors else ""
        return "" if self.lacks else f"{format_duration(self.seconds)}{added}"

    @property
    def error(self) -> str:
        """Error in words, for example 'SGBM +0.031 px, radiance 4.1 %'; empty if no error was measured."""
        if not self.errors:
            return ""
        return f"SGBM {self.errors['sgbm_px']:+.3f} px, radiance {100 * self.errors['radiance_rms']:.1f} %"


def estimate_pair_seconds(settings: Settings, triangles: float, speed: Speed | None) -> tuple[float, float]:
    """Estimate the wall seconds of a further pair of a scene of ``triangles`` triangles, and their uncertainty as a
    factor.

    Light that is baked for the view of one pair counts; light that all pairs share does not.
    """
    settled = resolve_auto_indirect(settings, int(settings.dataset.headings))
    work = estimate_work(settled).seconds(triangles)
    if is_baked(settled) and settled.quality.bake_area == "VIEW":
        work += estimate_bake_seconds(settled)
    seconds = to_wall_seconds(work * (speed.factor if speed else 1.0), speed)
    return seconds, _find_uncertainty(settings, speed)


def estimate_render_seconds(settings: Settings, speed: Speed | None) -> tuple[float, float]:
    """Wall seconds until a process of its own has built a scene and rendered all its pairs, one for each heading, and
    their uncertainty as a factor. Light that all pairs share counts once."""
    headings = int(settings.dataset.headings)
    settled = resolve_auto_indirect(settings, headings)
    seconds, _ = estimate_roughly((settled,), headings, 1.0, speed)
    if is_baked(settled):
        bakes = headings if settled.quality.bake_area == "VIEW" else 1
        seconds += to_wall_seconds(bakes * estimate_bake_seconds(settled) * (speed.factor if speed else 1.0), speed)
    return seconds, _find_uncertainty(settings, speed)


def _find_uncertainty(settings: Settings, speed: Speed | None) -> float:
    return math.exp(2.0 * estimate_prior_spread(speed, settings.quality.device == "GPU"))


def list_qualities(
    settings: Settings,
    triangles: float,
    speed: Speed | None,
    able: Abilities = Abilities(),  # noqa: B008  it is frozen
) -> list[QualityPreset]:
    """List the shipped qualities for a scene, cheapest first, then the scene's own. Each names the feature that a
    Blender with the abilities ``able`` lacks.

    ``errors`` are from the preset's file: ``sgbm_px`` added to the mean error of SGBM, ``radiance_rms`` and
    ``radiance_bias`` as fractions of the mean radiance, the ``scene`` and the ``command`` that measured them.
    """
    found = []
    for name in preset_names("qualities"):
        title, preset, errors = _read_preset(name)
        whole = merged(settings, preset)
        found.append(
            QualityPreset(
                name,
                title,
                *estimate_pair_seconds(whole, triangles, speed),
                errors,
                describe_lack(whole, able),
                chosen=whole == settings,
            )
        )
    own = QualityPreset(
        "",
        "As described",
        *estimate_pair_seconds(settings, triangles, speed),
        {},
        describe_lack(settings, able),
        chosen=not any(quality.chosen for quality in found),
    )
    return [*sorted(found, key=lambda quality: quality.seconds), own]


@cache
def _read_preset(name: str) -> tuple[str, Settings, Mapping[str, Any]]:
    """Read the title, settings and measured errors of a preset. Each preset is read once, since the window draws them
    at every redraw."""
    path = find_preset(name)
    return read_preset_header(name)[0], load(path), read_toml(path).get("measured", {})

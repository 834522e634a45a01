"""The cost and effect of each feature that is switched on only where a scene needs it.

    python benchmarks requires           measure all, and write docs/make/requires.json, which the manual shows
    python benchmarks requires walk …    only these, without writing the file

Each feature is measured on and off in turn, on one thread, in one run. The result is the ratio of the processor
seconds. A first pair is not measured, because it includes what is loaded only once. Needs Blender as a module, SpiceyPy
and PyTorch.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.processor import measure_all_seconds, seconds_of
from icymoon.benchmarks.common.renders import hide_cycles_output, render_planned, settings_of, start_blender
from icymoon.render import cycles_settings
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.topics.rendering import QualitySettings
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.support.version import ROOT

RESULT = ROOT / "docs" / "make" / "requires.json"
REPEATS = 2
SMALL: dict[str, Any] = {
    "rig": {"width_px": 160, "height_px": 120},
    "quality": {"samples": 16, "threads": 1},
    "mesh": {"error_px": 2.0},
}
_SNOW = {"surface": {"subsurface_weight": 1.0, "subsurface_radius_m": 5.0e-4, "albedo": 0.8}}
_CRESCENT = {"light": {"planet": True, "sun_elevation_deg": 26.0, "sun_azimuth_deg": 0.0}}


@dataclass(frozen=True)
class Feature:
    """One row: a feature, its switch, its effect, and how it is measured on and off: by settings, by programs for
    another Python, or with ``forced`` by a change that no setting makes."""

    title: str
    needed: str
    changes: str
    on: dict[str, Any] | str = field(default_factory=dict)
    off: dict[str, Any] | str = field(default_factory=dict)
    forced: bool = False


FEATURES = {
    "osl": Feature(
        "Open Shading Language",
        "a surface by Hapke's law that is not made of nodes",
        "Nothing, if no surface is made of it; measured by switching it on for Lambert's law",
        {"surface": {"model": "LAMBERT"}},
        {"surface": {"model": "LAMBERT"}},
        forced=True,
    ),
    "walk": Feature(
        "Subsurface scattering",
        "a radius of `quality.walk_px` pixels or more, where the ground is nearest",
        "Blurs light over its radius, here 0.02 of a pixel. Without it the mean radiance is within 3 %; the "
        "truth is the same",
        {**_SNOW, "quality": {"walk_px": 0.0}},
        _SNOW,
    ),
    "planet": Feature(
        "Light of the planet",
        "a planet above the horizon, and by day `light.planet_least` of the Sun's light or more",
        "The planet's part of the light, here under 0.0001 of the Sun's. Its disc is in the sky in both cases; the "
        "truth is the same",
        {**_CRESCENT, "light": {**_CRESCENT["light"], "planet_least": 0.0}},
        _CRESCENT,
    ),
    "planet_on_ice": Feature(
        "Light of the planet on Hapke's ice",
        "the same; Sun and planet are then rendered separately",
        "The same",
        {**_CRESCENT, "surface": {"model": "HAPKE"}, "light": {**_CRESCENT["light"], "planet_least": 0.0}},
        {**_CRESCENT, "surface": {"model": "HAPKE"}},
    ),
    "labels": Feature(
        "Normals and labels",
        "`quality.truth` is FULL",
        "Normals, semantic and instance labels, from a separate render. The depth is identical to the bit",
        {},
        {"quality": {"truth": "DEPTH"}},
    ),
    "mesh": Feature(
        "Ground as fine everywhere as near the camera",
        "`mesh.kind` is GRID",
        "Detail far away that no pixel shows. The grid has vertices every 20 mm on 20 m; the graded mesh has rings as "
        "fine as 2 pixels need, out to the horizon, which the grid does not reach. Light and depth therefore differ a "
        "little",
        {"mesh": {"kind": "GRID"}},
        {},
    ),
    "far": Feature(
        "Ground beyond the horizon",
        "a larger body; the ground ends where `terrain.body_radius_m` hides it",
        "Nothing, because no ray hits it",
        {"terrain": {"body_radius_m": 1.0e8}},
        {},
    ),
    "torch": Feature(
        "PyTorch",
        "a network among the matchers",
        "Nothing in an image",
        "import icymoon.stereo.evaluate, torch",
        "import icymoon.stereo.evaluate",
    ),
    "spice": Feature(
        "SpiceyPy",
        "`light.directions_from` is KERNELS",
        "Nothing in a sky from angles or from a date",
        "import icymoon.physics.light.sky, spiceypy",
        "import icymoon.physics.light.sky",
    ),
}


@contextmanager
def _forced_osl(on: bool) -> Iterator[None]:
    """Force Cycles to use Open Shading Language for all materials."""
    original = cycles_settings.apply_quality

    def apply(
        scene: bpy.types.Scene, quality: QualitySettings, seed: int, blurred: bool = False, through: bool = False
    ) -> None:
        original(scene, quality, seed, blurred, through)
        scene.cycles.shading_system = on

    cycles_settings.apply_quality = apply
    try:
        yield
    finally:
        cycles_settings.apply_quality = original


def rendered(changes: dict[str, Any], folder: Path) -> tuple[float, float, Array]:
    """Processor seconds of a scene and one of its pairs, and mean radiance and depth of the left image."""
    settings = settings_of((), SMALL, changes)
    planned = PlannedPair(make_pair_id(settings), settings, 0.0)
    seconds = seconds_of(lambda: render_planned([planned], folder))
    view = read_view(planned.folder(folder) / "left.exr", "left")
    return seconds, float(view.radiance.mean()), view.depth


def imported(program: str) -> float:
    """Processor seconds of a program in another Python."""
    return measure_all_seconds(lambda: subprocess.run([sys.executable, "-c", program], check=True))


def measured(feature: Feature) -> dict[str, Any]:
    """Measure a feature: least seconds with and without it, and its change of a pair's mean radiance and depth."""
    if isinstance(feature.on, str) or isinstance(feature.off, str):
        seconds = [(imported(str(feature.on)), imported(str(feature.off))) for _ in range(REPEATS)]
        return _least(seconds)
    pairs: list[tuple[Any, Any]] = []
    for _ in range(REPEATS):
        with scratch() as folder:
            found = []
            for name, changes in (("on", feature.on), ("off", feature.off)):
                with _forced_osl(name == "on") if feature.forced else _forced_osl(False):
                    found.append(rendered(changes, folder / name))
            pairs.append((found[0], found[1]))
    (_, with_it, depth), (_, without, other) = pairs[-1]
    same = np.isclose(depth, other, rtol=1e-3, equal_nan=True)
    return {
        **_least([(on[0], off[0]) for on, off in pairs]),
        "radiance": without / with_it - 1,
        "depth_differs": float(1 - same.mean()),
    }


def _least(seconds: list[tuple[float, float]]) -> dict[str, Any]:
    on, off = (min(column) for column in zip(*seconds, strict=True))
    return {"on_s": on, "off_s": off, "ratio": on / off}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", nargs="*", help="all by default")


def main(options: argparse.Namespace) -> None:
    """Print the table; write it if all features are measured."""
    with hide_cycles_output():
        print_table(options.names)


def print_table(names: list[str]) -> None:
    """Measure the features of these names, or all, and print the table."""
    start_blender()
    rows: dict[str, Any] = {}
    with scratch() as folder:
        rendered({}, folder)
    for name, feature in FEATURES.items():
        if names and name not in names:
            continue
        found = {key: float(f"{value:.3g}") for key, value in measured(feature).items()}
        rows[name] = {"title": feature.title, "needed": feature.needed, "changes": feature.changes, **found}
        print(f"{feature.title:50} {found}", flush=True)
    if not names:
        facts = {
            "command": "python benchmarks requires",
            "blender": bpy.app.version_string,
            "repeats": REPEATS,
            "pair": f"{SMALL['rig']['width_px']} x {SMALL['rig']['height_px']}, {SMALL['quality']['samples']} samples",
            "rows": rows,
        }
        RESULT.write_text(json.dumps(facts, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(RESULT)

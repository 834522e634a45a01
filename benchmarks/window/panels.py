"""CPU time of drawing all panels of the sidebar, at each of Blender's redraws.

    python benchmarks panels

Panels are drawn on a layout that does nothing, so the figures are of our own code. They are compared with reading
the settings once, in the same run. Between two drawings passes more time than settings that were read are kept, as
between two redraws of a window at rest. The least time counts, so that other work on the machine is left out.
"""

from __future__ import annotations

import argparse
import atexit
import json
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import icymoon
from icymoon.benchmarks.common.processor import seconds_of
from icymoon.operators import decisions_in_view, results
from icymoon.panels import CLASSES
from icymoon.settings.blender import scene_properties

ROUNDS = 40
APART_S = 0.06


class Nothing:
    """A layout on which nothing appears."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments, **options: Nothing()

    def __setattr__(self, name: str, value: object) -> None:
        pass


def draw(panel: type[bpy.types.Panel]) -> None:
    """Draw a panel if it would be shown."""
    if getattr(panel, "poll", lambda context: True)(bpy.context):
        parts = {name: getattr(panel, name) for name in ("topic", "section") if hasattr(panel, name)}
        panel.draw(SimpleNamespace(layout=Nothing(), **parts), bpy.context)


def milliseconds(action: Callable[[], object]) -> float:
    """CPU milliseconds of an action, the least of ROUNDS after a first run."""
    action()
    return min(_measure(action) for _ in range(ROUNDS))


def _measure(action: Callable[[], object]) -> float:
    time.sleep(APART_S)
    return 1e3 * seconds_of(action)


def add_results() -> None:
    """Give four matchers results and decisions on a pair, and let two settings vary."""
    scene, methods = bpy.context.scene, ("bm", "sgbm", "sgbm_wls", "jplv")
    folder = Path(tempfile.mkdtemp(prefix="icymoon-panels-"))
    atexit.register(shutil.rmtree, folder)
    scene.icymoon.dataset.folder, pair = str(folder), "0" * 12
    row = {"total_bad_1": 0.35, "l1_m": 0.123, "l1_rate_10": 0.5, "si_rmse": None, "dod": 0.25, "coverage": 0.75}
    write_json(
        folder / "evaluation_scene" / "report.json",
        {
            "summary": [{"method": method, **row} for method in methods],
            "rows": [],
            "provenance": {"created": "2038-06-01T12:00:00+00:00"},
        },
    )
    write_json(
        folder / "decisions" / "decisions.json",
        {
            "rules": {"site": {"slope_deg": 10.0, "disc_m": 0.3}},
            "rows": [
                {"pair": pair, "method": method, "images": {"suitability": "a.npy"}, "numbers": None}
                for method in methods
            ],
        },
    )
    results.keep_results(scene, "SCENE", scene_properties.read_settings(scene.icymoon), [pair])
    for setting in ("light.sun_elevation_deg", "surface.model"):
        bpy.ops.icymoon.vary(setting=setting)
    assert len(results.read_summary(scene)) == len(decisions_in_view.list_decided_methods(scene)) == len(methods)


def write_json(path: Path, what: object) -> None:
    """Write a file, and make its folder."""
    path.parent.mkdir()
    path.write_text(json.dumps(what), encoding="utf-8")


def main(options: argparse.Namespace) -> None:
    """Print the time of all panels before and after a scene is built, and after an evaluation."""
    icymoon.register()
    panels = [cls for cls in CLASSES if issubclass(cls, bpy.types.Panel)]

    def draw_all() -> None:
        for panel in panels:
            draw(panel)

    group = bpy.context.scene.icymoon
    group.mesh.kind, group.terrain.resolution = "GRID", 65
    for state, reach in {
        "empty": lambda: None,
        "built": bpy.ops.icymoon.build_scene,
        "with results, decisions and variations": add_results,
    }.items():
        reach()
        whole = milliseconds(draw_all)
        once = milliseconds(lambda: scene_properties.read_unchecked(group))
        print(f"{state}: {len(panels)} panels {whole:.2f} ms, {whole / once:.1f} times reading the settings once")

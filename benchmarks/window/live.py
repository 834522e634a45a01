"""The speed of the live preview: updates per second for every terrain and scene preset.

    python benchmarks live             all
    python benchmarks live chaos …     those whose name contains a word

Each preset is built. Then its ruggedness changes as if the slider were dragged. An update includes the height function,
mesh, rocks, bookkeeping and Blender's own evaluation, everything except drawing. Milliseconds and rates are of
processor time, which on an idle machine equals real time. ``full`` is the time of a full build divided by the time of
an update of the same run. The window uses the largest side with an update below ``live.BUDGET_S``. Needs Blender as a
module.
"""

from __future__ import annotations

import argparse

import bpy
from icymoon.benchmarks.common.arguments import is_asked
from icymoon.benchmarks.common.processor import Stopwatch, seconds_of
from icymoon.benchmarks.common.renders import open_empty_file, start_blender
from icymoon.nodes import build_scene as scenes
from icymoon.operators import live_preview
from icymoon.operators.session import session
from icymoon.settings import preset_files
from icymoon.settings.blender import scene_properties

SIDES = live_preview.SIDES[0], live_preview.SIDES[-1]
WARM_UP, UPDATES = 2, 12


def seconds(scene: bpy.types.Scene, topic: str, key: str) -> float:
    """Processor seconds of an update while a slider moves."""
    group = getattr(scene.icymoon, topic)
    middle = getattr(group, key)
    for k in range(WARM_UP + UPDATES):
        if k == WARM_UP:
            watch = Stopwatch()
        setattr(group, key, middle + 0.01 * (k + 1))
        live_preview.update_scene(scene)
        bpy.context.view_layer.update()
        shown = scenes.find_built(scene)
        assert shown is not None
        mesh = shown.terrain.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        mesh.corner_normals[0].vector  # noqa: B018  (drawing asks for them)
    return watch.lap() / UPDATES


def built(name: str) -> tuple[bpy.types.Scene, float]:
    """A scene of a preset, and the processor seconds of its full build."""
    scene = open_empty_file()
    scene.icymoon.live = False
    scene_properties.write_settings(scene.icymoon, preset_files.load_preset(name))
    settings = scene_properties.read_settings(scene.icymoon)
    build = seconds_of(lambda: scenes.build_scene(scene, settings))
    scene.icymoon.live = True
    return scene, build


def cell(update: float, build: float) -> str:
    """Milliseconds, updates a second and a full build over an update."""
    return f"   {update * 1e3:6.1f} ms {1 / update:6.1f} /s {build / update:5.0f}"


def drag(name: str) -> str:
    """A row: an update of the ground with this number of vertices per side."""
    scene, build = built(name)
    row = f"{name:40}"
    for side in SIDES:
        live_preview.SIDES, session.preview_side = (side,), side
        row += cell(seconds(scene, "terrain", "rms_slope_deg"), build)
    return row


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", nargs="*", help="presets whose name contains one of these; all by default")


def main(options: argparse.Namespace) -> None:
    """Print a row for each preset."""
    start_blender()
    scene, build = built("scenes/enceladus_block_field")
    for topic, key in (("light", "sun_elevation_deg"), ("rig", "heading_deg"), ("surface", "roughness")):
        name = f"{topic}.{key} at full resolution"
        print(f"{name:40}{cell(seconds(scene, topic, key), build)}", flush=True)
    print(f"{'preset':40}" + "".join(f"   {side:>6} a side         full" for side in SIDES))
    for name in preset_files.preset_names():
        if name.startswith(("terrains/", "scenes/")) and is_asked(name, options.words):
            print(drag(name), flush=True)

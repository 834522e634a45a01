"""The cost of the ground between the patch and the horizon: distant hills, and rocks beyond the patch.

    python benchmarks far_field [PRESET ...]     presets with hills (scenes/enceladus_block_field)

The preset is built and a pair rendered with the gallery's camera, 480 pixels wide, at the quality draft: without both,
with hills, with rocks beyond the patch, with both. Each is measured in a separate process: vertices of the ground,
rocks, processor seconds to build and to render, peak memory; ``+`` is the increase over the first. Needs Blender as a
module.
"""

from __future__ import annotations

import argparse
from typing import Any

import bpy
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.own_process import call
from icymoon.benchmarks.common.processor import Stopwatch, peak_mib
from icymoon.benchmarks.common.renders import render, settings_of, start_blender
from icymoon.nodes.build_scene import build_scene
from icymoon.settings.topics.declaration import Parts

WIDTH_PX, HEIGHT_PX = 480, 320
WITHOUT: dict[str, Parts] = {
    "neither": {"hills": {"rms_slope_deg": 0.0}, "rocks": {"beyond_px": 0.0}},
    "hills": {"rocks": {"beyond_px": 0.0}},
    "rocks": {"hills": {"rms_slope_deg": 0.0}},
    "both": {},
}


def measure(preset: str, way: str) -> dict[str, Any]:
    """Build and render in this process."""
    scene = start_blender()
    settings = settings_of(
        (preset, "rigs/gallery", "qualities/draft"),
        {"rig": {"width_px": WIDTH_PX, "height_px": HEIGHT_PX}},
        WITHOUT[way],
    )
    watch = Stopwatch()
    built = build_scene(scene, settings)
    build_s = watch.lap()
    with scratch() as folder:
        render(built, settings, folder)
    render_s = watch.lap()
    rock = bpy.data.objects.get("Icy Moon Rock")
    return {
        "vertices": len(built.terrain.data.vertices),
        "rocks": len(rock.data.vertices) if rock else 0,
        "build": build_s,
        "render": render_s,
        "peak": peak_mib(),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("presets", nargs="*", default=["scenes/enceladus_block_field"])


def main(options: argparse.Namespace) -> None:
    """Measure each variant in a separate process and print a table."""
    print("| scene | beyond the patch | vertices | rocks | build, CPU-s | render, CPU-s | + CPU-s | + MiB |")
    print("|---|---|---|---|---|---|---|---|")
    for preset in options.presets:
        first = None
        for way in WITHOUT:
            row = call(measure, preset, way)
            first = first or row
            more = sum(row[key] - first[key] for key in ("build", "render"))
            print(
                f"| {preset.split('/')[1]} | {way} | {row['vertices']} | {row['rocks']} | {row['build']:.2f} "
                f"| {row['render']:.2f} | {more:.2f} | {row['peak'] - first['peak']:.0f} |",
                flush=True,
            )

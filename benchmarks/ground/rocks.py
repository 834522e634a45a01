"""The cost of rocks: processor seconds and memory to build and to render them, from none to 100 000.

    python benchmarks rocks             instances, as Icy Moon makes them
    python benchmarks rocks objects     the same rocks as single objects, for comparison

A 20 m patch of 1 M triangles and one 640 x 480 pair with truth at one sample. Each number of rocks is
measured in a separate process; ``+`` is the increase over none. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import time

import bpy
import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.own_process import call
from icymoon.benchmarks.common.processor import peak_mib
from icymoon.benchmarks.common.renders import render, settings_of, start_blender
from icymoon.nodes.build_scene import build_scene

NUMBERS = (0, 100, 1000, 10_000, 100_000)


def _as_objects(carrier: bpy.types.Object) -> None:
    """Replace the instances of a carrier by objects that share the shapes."""
    shapes = sorted(
        carrier.modifiers[0].node_group.nodes["Shapes"].inputs["Collection"].default_value.objects,
        key=lambda item: item.name,
    )
    columns = {}
    for name, width, kind, key in (
        ("position", 3, np.float32, "vector"),
        ("rotation", 3, np.float32, "vector"),
        ("scale", 3, np.float32, "vector"),
        ("shape", 1, np.int32, "value"),
    ):
        values = np.empty(len(carrier.data.vertices) * width, kind)
        carrier.data.attributes[name].data.foreach_get(key, values)
        columns[name] = values.reshape(-1, width).tolist()
    collection = carrier.users_collection[0]
    for k, (place, turn, scale, shape) in enumerate(zip(*columns.values(), strict=True)):
        item = bpy.data.objects.new(f"Block {k}", shapes[shape[0]].data)
        item.location, item.rotation_euler, item.scale, item.pass_index = place, turn, scale, min(k + 1, 32767)
        collection.objects.link(item)
    bpy.data.objects.remove(carrier)


def measure(number: int, way: str) -> dict[str, float]:
    """Build and render with this number of rocks, in this process."""
    scene = start_blender()
    settings = settings_of(
        (),
        {
            "terrain": {"resolution": 725},
            "quality": {"samples": 1},
            "rocks": {"coverage": 0.3 if number else 0.0, "smallest_m": 0.01, "largest_m": 0.8, "most": number},
        },
    )
    start = time.process_time(), time.perf_counter()
    built = build_scene(scene, settings)
    if way == "objects" and number:
        _as_objects(bpy.data.objects["Icy Moon Rock"])
    middle = time.process_time(), time.perf_counter()
    with scratch() as folder:
        render(built, settings, folder)
    end = time.process_time(), time.perf_counter()
    return {
        "blocks": number,
        "build": middle[0] - start[0],
        "render": end[0] - middle[0],
        "build_wall": middle[1] - start[1],
        "render_wall": end[1] - middle[1],
        "peak": peak_mib(),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("way", nargs="?", choices=("instances", "objects"), default="instances")


def main(options: argparse.Namespace) -> None:
    """Measure each number in a separate process and print a table."""
    way = options.way
    print(f"{way:>10}{'build s':>10}{'render s':>10}{'+ render':>10}{'peak MiB':>10}{'+ MiB':>8}   (wall)")
    none = None
    for number in NUMBERS:
        row = call(measure, number, way)
        none = none or row
        print(
            f"{number:>10}{row['build']:>10.2f}{row['render']:>10.2f}{row['render'] - none['render']:>10.2f}"
            f"{row['peak']:>10.0f}{row['peak'] - none['peak']:>8.0f}   ({row['build_wall']:.1f}, "
            f"{row['render_wall']:.1f})",
            flush=True,
        )

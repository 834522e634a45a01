"""The cost of what lies between the patch and the horizon: distant hills, and rocks beyond the patch.

    python benchmarks/far_field.py [PRESET ...]     presets with hills (scenes/enceladus_block_field)

The preset is built and a pair rendered with the gallery's camera, 480 pixels wide, at the quality draft: without both,
with hills, with rocks beyond the patch, with both. Each is measured in a process of its own: vertices of the ground,
rocks, processor seconds to build and to render, peak memory; ``+`` is what is added to the first. Needs Blender as a
module.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

WIDTH_PX, HEIGHT_PX = 480, 320
WITHOUT: dict[str, dict[str, dict[str, float]]] = {
    "neither": {"hills": {"rms_slope_deg": 0.0}, "rocks": {"beyond_px": 0.0}},
    "hills": {"rocks": {"beyond_px": 0.0}},
    "rocks": {"hills": {"rms_slope_deg": 0.0}},
    "both": {},
}


def measure(preset: str, way: str) -> dict[str, Any]:
    """Build and render in this process."""
    import resource

    import bpy
    import icymoon
    from icymoon.nodes import scene as scenes
    from icymoon.render.plans.planned_pair import expand_headings
    from icymoon.render.worker import render_pairs
    from icymoon.settings import description
    from icymoon.settings.preset_files import load_preset

    icymoon.register()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    settings = description.merged(
        description.defaults(),
        load_preset(preset),
        load_preset("rigs/gallery"),
        load_preset("qualities/draft"),
        {"rig": {"width_px": WIDTH_PX, "height_px": HEIGHT_PX}},
        WITHOUT[way],
    )
    start = time.process_time()
    built = scenes.build(bpy.context.scene, settings)
    middle = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        render_pairs(built, expand_headings(settings), Path(folder), 1, 0.0, lambda *a, **k: None)
    rock = bpy.data.objects.get("Icy Moon Rock")
    return {
        "vertices": len(built.terrain.data.vertices),
        "rocks": len(rock.data.vertices) if rock else 0,
        "build": middle - start,
        "render": time.process_time() - middle,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def main(arguments: list[str]) -> None:
    """Measure each way in a process of its own and print a table."""
    if len(arguments) == 2 and arguments[1] in WITHOUT:
        print(json.dumps(measure(*arguments)), flush=True)
        os._exit(0)  # Blender as a module may crash or hang when the interpreter ends
    print("| scene | beyond the patch | vertices | rocks | build, CPU-s | render, CPU-s | + CPU-s | + MiB |")
    print("|---|---|---|---|---|---|---|---|")
    for preset in arguments or ["scenes/enceladus_block_field"]:
        first = None
        for way in WITHOUT:
            done = subprocess.run([sys.executable, __file__, preset, way], capture_output=True, text=True, check=True)
            row = json.loads(done.stdout.strip().splitlines()[-1])
            first = first or row
            more = sum(row[key] - first[key] for key in ("build", "render"))
            print(
                f"| {preset.split('/')[1]} | {way} | {row['vertices']} | {row['rocks']} | {row['build']:.2f} "
                f"| {row['render']:.2f} | {more:.2f} | {row['peak'] - first['peak']:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])

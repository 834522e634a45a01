"""How much of the relief that the image shows is in the depth, what that costs, and what it does to matchers.

    python benchmarks/fine_relief.py [PRESET [SAMPLES [HEADINGS [SCALE]]]]     scenes/europa_rough_ice, 8, 1 and 1

The preset is built with its own camera and pairs rendered at so many headings, in a process of its own for each way:
fine relief as bump, displaced on the mesh as it is, real. SCALE below 1 makes image, height of the camera and baseline
smaller alike, so that relief is as large in pixels as before. Angles are those between the left eye's shading normals
and facets, on the ground, as rocks' relief is always bump: median and 90 %, and the median of ground nearer than twice
the nearest ("near"). Matchers: mean error of what they measure, against the depth of the same pair, in pixels and in
millimetres, and the share of pixels that are wrong by more than 1 px or missing. Needs Blender as a module and the
evaluator's packages.
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

import numpy as np
from icymoon.support.arrays import Array

WAYS = {"painted": "BUMP", "displaced": "DISPLACEMENT", "real": "REAL"}
METHODS = "bm,sgbm,jplv"


def _angles_deg(pair: Any) -> tuple[Array, Array]:
    """Angles in degrees between shading normal and facet, and depths in metres, of the left eye's pixels of ground."""
    from icymoon.stereo.images.exr import read_truth
    from icymoon.support.labels import NORMAL_AOV, TERRAIN, TRUTH

    truth = read_truth(pair.truth("left"), "left")
    shading = read_truth(pair.truth("left"), "left", without=[f"{TRUTH}.{NORMAL_AOV}"]).normal
    assert truth.semantic is not None
    assert truth.normal is not None
    assert shading is not None
    seen = (truth.semantic == TERRAIN) & np.isfinite(truth.depth)
    one, other = (each[seen] / np.linalg.norm(each[seen], axis=-1, keepdims=True) for each in (shading, truth.normal))
    return np.degrees(np.arccos(np.clip((one * other).sum(axis=-1), -1.0, 1.0))), truth.depth[seen]


def measure(preset: str, samples: int, headings: int, scale: float, way: str, folder: str) -> dict[str, Any]:
    """Build and render in this process."""
    import resource

    import bpy
    import icymoon
    from icymoon.nodes.next_scene import adapt_scene
    from icymoon.physics.mesh.fine_relief import nearest_m
    from icymoon.render.pairs.pair_folder import read_pair
    from icymoon.render.plans.planned_pair import expand_headings
    from icymoon.render.worker import render_pairs
    from icymoon.settings import description
    from icymoon.settings.preset_files import load_preset

    icymoon.register()
    settings = description.merged(description.defaults(), load_preset(preset))
    rig = {
        "width_px": round(settings.rig.width_px * scale),
        "height_px": round(settings.rig.height_px * scale),
        "height_m": settings.rig.height_m * scale,
        "baseline_m": settings.rig.baseline_m * scale,
    }
    settings = description.merged(
        settings, {"rig": rig, "surface": {"relief": WAYS[way]}, "quality": {"samples": samples, "denoiser": "NONE"}}
    )
    build = render = vertices = 0.0
    angles: list[Array] = []
    depths: list[Array] = []
    built = None
    warnings: list[str] = []
    for heading in range(headings):
        turned = description.merged(settings, {"rig": {"heading_deg": 360.0 / headings * heading}})
        start = time.process_time()
        built, _ = adapt_scene(built, turned)
        middle = time.process_time()
        made = render_pairs(built, expand_headings(turned), Path(folder), 1, 0.0, lambda *a, **k: None)
        build, render = build + middle - start, render + time.process_time() - middle
        vertices += len(built.terrain.data.vertices) / headings
        warnings += built.warnings
        angle, depth = _angles_deg(read_pair(made[0]))
        angles, depths = [*angles, angle], [*depths, depth]
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    angle, depth = np.concatenate(angles), np.concatenate(depths)
    near = depth < 2 * nearest_m(settings.rig)
    return {
        "vertices": vertices,
        "build": build / headings,
        "render": render / headings,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "median": float(np.median(angle)),
        "most": float(np.quantile(angle, 0.9)),
        "near": float(np.median(angle[near])),
        "warnings": warnings,
    }


def matched(folder: Path) -> dict[str, tuple[float, ...]]:
    """Mean error in pixels and in metres and the share wrong or missing, by matcher, over the pairs in a folder."""
    from icymoon.stereo.evaluate import evaluate
    from icymoon.stereo.matchers.methods import parse_methods

    rows = evaluate([folder], parse_methods(METHODS), folder / "report", jobs=1)["rows"]
    found: dict[str, tuple[float, ...]] = {}
    for method in METHODS.split(","):
        own = [row for row in rows if row["method"] == method]
        found[method] = tuple(float(np.mean([each[key] for each in own])) for key in ("epe_px", "l1_m", "total_bad_1"))
    return found


def main(arguments: list[str]) -> None:
    """Measure each way in a process of its own and print two tables."""
    preset, samples, headings, scale = (arguments + ["scenes/europa_rough_ice", "8", "1", "1"][len(arguments) :])[:4]
    if len(arguments) == 6:
        print(json.dumps(measure(preset, int(samples), int(headings), float(scale), *arguments[4:])), flush=True)
        os._exit(0)  # Blender as a module may crash or hang when the interpreter ends
    print("| fine relief | vertices | build, CPU-s | pair, CPU-s | peak MiB | angle, median | 90 % | near, median |")
    print("|---|---|---|---|---|---|---|---|")
    errors = {}
    with tempfile.TemporaryDirectory() as top:
        for way in WAYS:
            done = subprocess.run(
                [sys.executable, __file__, preset, samples, headings, scale, way, f"{top}/{way}"],
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode:
                sys.exit(done.stderr)
            row = json.loads(done.stdout.strip().splitlines()[-1])
            print(
                f"| {way} | {row['vertices']:.0f} | {row['build']:.1f} | {row['render']:.1f} | {row['peak']:.0f} "
                f"| {row['median']:.1f}° | {row['most']:.1f}° | {row['near']:.1f}° |",
                flush=True,
            )
            for warning in dict.fromkeys(row["warnings"]):
                print(f"  {warning}", file=sys.stderr)
            errors[way] = matched(Path(top) / way)
    print("\n| fine relief | matcher | error, px | depth error, mm | wrong or missing |\n|---|---|---|---|---|")
    for way, by_method in errors.items():
        for method, (px, depth_m, bad) in by_method.items():
            print(f"| {way} | {method} | {px:.3f} | {1e3 * depth_m:.1f} | {bad:.1%} |")


if __name__ == "__main__":
    main(sys.argv[1:])

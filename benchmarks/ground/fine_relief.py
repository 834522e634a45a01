"""The share of the image's relief that is in the depth, its cost, and its effect on matchers.

    python benchmarks fine_relief [PRESET [SAMPLES [HEADINGS [SCALE]]]]     scenes/europa_rough_ice, 8, 1 and 1

The preset is built with its own camera and pairs are rendered at HEADINGS headings, in a separate process for each way:
fine relief as bump, displaced on the mesh as it is, real. SCALE below 1 makes image, height of the camera and baseline
smaller alike, so that relief is as large in pixels as before. Angles are those between the left eye's shading normals
and facets, on the ground, as rocks' relief is always bump: median and 90 %, and the median of ground nearer than twice
the nearest ("near"). Matchers: mean error of the measured pixels, against the depth of the same pair, in pixels and in
millimetres, and the share of pixels that are wrong by more than 1 px or missing. Needs Blender as a module and the
evaluator's packages.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.own_process import call
from icymoon.benchmarks.common.processor import Stopwatch, peak_mib
from icymoon.benchmarks.common.renders import open_empty_file, render, settings_of, start_blender
from icymoon.nodes.change_scene import adapt_scene
from icymoon.physics.mesh.finer_in_view import nearest_ground_m
from icymoon.render.pairs.pair_folder import Pair, read_pair
from icymoon.settings import description
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.images.exr import read_truth
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.arrays import Array
from icymoon.support.labels import NORMAL_AOV, TERRAIN, TRUTH

WAYS = {"painted": "BUMP", "displaced": "DISPLACEMENT", "real": "REAL"}
METHODS = "bm,sgbm,jplv"


def _angles_deg(pair: Pair) -> tuple[Array, Array]:
    """Angles in degrees between shading normal and facet, and depths in metres, of the left eye's pixels of ground."""
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
    start_blender()
    settings = settings_of((preset,))
    rig = {
        "width_px": round(settings.rig.width_px * scale),
        "height_px": round(settings.rig.height_px * scale),
        "height_m": settings.rig.height_m * scale,
        "baseline_m": settings.rig.baseline_m * scale,
    }
    settings = description.merged(
        settings, {"rig": rig, "surface": {"relief": WAYS[way]}, "quality": {"samples": samples, "denoiser": "NONE"}}
    )
    build_s = render_s = vertices = 0.0
    angles: list[Array] = []
    depths: list[Array] = []
    built = None
    warnings: list[str] = []
    for heading in range(headings):
        turned = description.merged(settings, {"rig": {"heading_deg": 360.0 / headings * heading}})
        watch = Stopwatch()
        built, _ = adapt_scene(built, turned)
        build_s += watch.lap()
        made = render(built, turned, Path(folder))
        render_s += watch.lap()
        vertices += len(built.terrain.data.vertices) / headings
        warnings += built.warnings
        angle, depth = _angles_deg(read_pair(made[0]))
        angles, depths = [*angles, angle], [*depths, depth]
    open_empty_file()
    angle, depth = np.concatenate(angles), np.concatenate(depths)
    near = depth < 2 * nearest_ground_m(settings.rig)
    return {
        "vertices": vertices,
        "build": build_s / headings,
        "render": render_s / headings,
        "peak": peak_mib(),
        "median": float(np.median(angle)),
        "most": float(np.quantile(angle, 0.9)),
        "near": float(np.median(angle[near])),
        "warnings": warnings,
    }


def matched(folder: Path) -> dict[str, tuple[float, ...]]:
    """Mean error in pixels and in metres and the share wrong or missing, by matcher, over the pairs in a folder."""
    rows = evaluate([folder], parse_methods(METHODS), folder / "report", jobs=1)["rows"]
    found: dict[str, tuple[float, ...]] = {}
    for method in METHODS.split(","):
        own = [row for row in rows if row["method"] == method]
        found[method] = tuple(float(np.mean([each[key] for each in own])) for key in ("epe_px", "l1_m", "total_bad_1"))
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("preset", nargs="?", default="scenes/europa_rough_ice")
    parser.add_argument("samples", nargs="?", type=int, default=8)
    parser.add_argument("headings", nargs="?", type=int, default=1)
    parser.add_argument("scale", nargs="?", type=float, default=1.0)


def main(options: argparse.Namespace) -> None:
    """Measure each variant in a separate process and print two tables."""
    print("| fine relief | vertices | build, CPU-s | pair, CPU-s | peak MiB | angle, median | 90 % | near, median |")
    print("|---|---|---|---|---|---|---|---|")
    errors = {}
    with scratch() as top:
        for way in WAYS:
            row = call(measure, options.preset, options.samples, options.headings, options.scale, way, str(top / way))
            print(
                f"| {way} | {row['vertices']:.0f} | {row['build']:.1f} | {row['render']:.1f} | {row['peak']:.0f} "
                f"| {row['median']:.1f}° | {row['most']:.1f}° | {row['near']:.1f}° |",
                flush=True,
            )
            for warning in dict.fromkeys(row["warnings"]):
                print(f"  {warning}", file=sys.stderr)
            errors[way] = matched(top / way)
    print("\n| fine relief | matcher | error, px | depth error, mm | wrong or missing |\n|---|---|---|---|---|")
    for way, by_method in errors.items():
        for method, (px, depth_m, bad) in by_method.items():
            print(f"| {way} | {method} | {px:.3f} | {1e3 * depth_m:.1f} | {bad:.1%} |")

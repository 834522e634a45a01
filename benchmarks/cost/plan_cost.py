"""The cost of a pair: processor seconds and bytes. The coefficients in ``render/cost/estimate.py`` come from here.

    python benchmarks plan_cost              all
    python benchmarks plan_cost Hapke …      those whose name contains a word

Each row is a scene built from settings, two pairs of it, and the estimate of the coefficients for a pair. Seconds are
processor time of the whole process, which depends little on the load of the machine. Cycles prints its own lines
between the rows. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import is_asked, scratch
from icymoon.benchmarks.common.renders import open_empty_file, settings_of, start_blender
from icymoon.nodes.build_scene import build_scene
from icymoon.render.cost import estimate
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.plans.triangle_count import count_triangles
from icymoon.render.worker import render_pairs
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings

SMALL: dict[str, Any] = {
    "rig": {"width_px": 160, "height_px": 120},
    "mesh": {"error_px": 4.0, "edge_px": 24.0},
    "quality": {"samples": 8},
}
#: Changes of ``SMALL``, each measured alone.
ROWS: dict[str, dict[str, Any]] = {
    "Lambert": {"surface": {"model": "LAMBERT"}},
    "Lambert, 2 samples": {"surface": {"model": "LAMBERT"}, "quality": {"samples": 2}},
    "Lambert, 24 samples": {"surface": {"model": "LAMBERT"}, "quality": {"samples": 24}},
    "Lambert, 320 x 240": {"surface": {"model": "LAMBERT"}, "rig": {"width_px": 320, "height_px": 240}},
    "Lambert, mesh of 1 px": {"surface": {"model": "LAMBERT"}, "mesh": {"error_px": 1.0, "edge_px": 8.0}},
    "Lambert, grid 513²": {"surface": {"model": "LAMBERT"}, "mesh": {"kind": "GRID"}, "terrain": {"resolution": 513}},
    "Lambert, grid 1025²": {"surface": {"model": "LAMBERT"}, "mesh": {"kind": "GRID"}},
    "Lambert, denoised": {"surface": {"model": "LAMBERT"}, "quality": {"denoiser": "OIDN"}},
    "Lambert, denoised, 320 x 240": {
        "surface": {"model": "LAMBERT"},
        "quality": {"denoiser": "OIDN"},
        "rig": {"width_px": 320, "height_px": 240},
    },
    "Lambert, planet": {"surface": {"model": "LAMBERT"}, "light": {"planet": True}},
    "Lambert, 0 bounces": {"surface": {"model": "LAMBERT"}, "quality": {"diffuse_bounces": 0}},
    "Lambert, 10 bounces": {"surface": {"model": "LAMBERT"}, "quality": {"diffuse_bounces": 10}},
    **{
        f"Lambert, 256 samples, threshold {limit:g}": {
            "surface": {"model": "LAMBERT"},
            "quality": {"samples": 256, "noise_threshold": limit},
        }
        for limit in (0.3, 0.1, 0.05, 0.02, 0.01)
    },
    "Lambert, rocks": {"surface": {"model": "LAMBERT"}, "rocks": {"coverage": 0.1}},
    "Principled": {},
    **{
        f"Principled, {name}walk{text}": {
            "surface": {"subsurface_weight": weight, "subsurface_radius_m": 2.0e-3},
            "quality": {"walk_px": limit},
        }
        for name, weight in (("half ", 0.5), ("", 1.0))
        for text, limit in (("", 0.0), (" left out", 100.0))
    },
    **{
        f"Principled, walk of {1e3 * length:g} mm": {
            "surface": {"subsurface_weight": 1.0, "subsurface_radius_m": length},
            "quality": {"walk_px": 0.0},
        }
        for length in (0.0005, 0.005, 0.02)
    },
    **{
        f"{model.capitalize()}, 64 samples, {text}": {
            "surface": {"model": model, "grain_amplitude_m": height},
            "quality": {"samples": 64, "fine_relief": whose},
        }
        for model in ("LAMBERT", "PRINCIPLED")
        for text, height, whose in (
            ("no relief", 0.0, "ALL"),
            ("relief", 0.004, "ALL"),
            ("relief for the camera", 0.004, "CAMERA"),
        )
    },
    "Principled, transmission": {"surface": {"transmission": 0.5}},
    "Principled, images": {"textures": {"set": "FROST"}},
    "Principled, images for the camera": {"textures": {"set": "FROST"}, "quality": {"fine_relief": "CAMERA"}},
    "Principled, images, 320 x 240": {"textures": {"set": "FROST"}, "rig": {"width_px": 320, "height_px": 240}},
    "Lommel-Seeliger": {"surface": {"model": "LOMMEL_SEELIGER"}},
    "lunar-Lambert": {"surface": {"model": "LUNAR_LAMBERT"}},
    "Hapke, OSL, fast": {"surface": {"model": "HAPKE"}},
    "Hapke, OSL, fast, 320 x 240": {"surface": {"model": "HAPKE"}, "rig": {"width_px": 320, "height_px": 240}},
    "Hapke, OSL, accurate": {"surface": {"model": "HAPKE"}, "hapke": {"accuracy": "ACCURATE"}},
    "Hapke, OSL, reference": {"surface": {"model": "HAPKE"}, "hapke": {"accuracy": "REFERENCE"}},
    "Hapke, nodes": {"surface": {"model": "HAPKE"}, "hapke": {"backend": "NODES"}},
}


def measured(settings: Settings, folder: Path) -> tuple[float, float, float, float]:
    """Processor seconds of the build, of the first pair and of a further pair of the scene, and bytes of a pair."""
    scene = open_empty_file()
    start = time.process_time()
    built = build_scene(scene, settings)
    moments = [start, time.process_time()]
    pairs = expand_headings(description.merged(settings, {"dataset": {"headings": 2}}))
    render_pairs(
        built,
        pairs,
        folder,
        1,
        0.0,
        lambda kind, **facts: moments.append(time.process_time()) if kind == "pair" else None,
    )
    build_s, first_s, other_s = np.diff(moments).tolist()
    size = sum(f.stat().st_size for f in pairs[0].folder(folder).glob("*.exr"))
    return build_s, first_s, other_s, float(size)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", nargs="*", help="rows whose name contains one of these; all by default")


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    start_blender()
    print(
        f"{'':32} {'Mtri':>6} {'build s':>8} {'first s':>8} {'other s':>8} {'expected':>8} {'bytes/px':>9} "
        f"{'expected':>8}"
    )
    for name, changes in ROWS.items():
        if not is_asked(name, options.words):
            continue
        settings = settings_of((), SMALL, changes)
        with scratch() as folder:
            build_s, first_s, other_s, size = measured(settings, folder)
        work, triangles = estimate.estimate_work(settings), count_triangles(settings)
        expected = work.seconds(triangles)
        print(
            f"{name:32} {triangles / 1e6:6.3f} {build_s:8.2f} {first_s:8.2f} {other_s:8.2f} "
            f"{expected:8.2f} {size / work.pixels:9.1f} {estimate.estimate_bytes(settings) / work.pixels:8.1f}",
            flush=True,
        )

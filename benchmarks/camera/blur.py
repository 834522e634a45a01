"""The effect of rendered blur and toe-in on stereo, and their cost: one scene with different lenses, motions and rigs.

    python benchmarks blur [WIDTH [SAMPLES]]

Depth error, coverage and bad-1 are measured on the pixels that both eyes see. Cost is the CPU time of the render, as a
ratio to the first row of the same run.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.matcher_errors import heads, measure_errors
from icymoon.benchmarks.common.processor import Stopwatch
from icymoon.benchmarks.common.renders import render, settings_of, start_blender
from icymoon.nodes.build_scene import build_scene
from icymoon.settings import description
from icymoon.stereo.measure.prepare_pair import load_pair

METHODS = ("bm", "sgbm")
SECONDS = 0.01
#: Title, and the rig and sensor settings beside the preset's.
ROWS: tuple[tuple[str, dict[str, Any], dict[str, Any]], ...] = (
    ("sharp", {}, {}),
    ("f/8, focus 2 m", {"focus_distance_m": 2.0}, {"f_number": 8.0}),
    ("f/1.4, focus 2 m", {"focus_distance_m": 2.0}, {"f_number": 1.4}),
    ("f/1.4, focus 0.5 m", {"focus_distance_m": 0.5}, {"f_number": 1.4}),
    ("right, 0.6 m/s x 10 ms", {"speed_right_m_s": 0.6}, {}),
    ("right, 5 m/s x 10 ms", {"speed_right_m_s": 5.0}, {}),
    ("forward, 5 m/s x 10 ms", {"speed_forward_m_s": 5.0}, {}),
    ("turn, 100°/s x 10 ms", {"turn_right_deg_s": 100.0}, {}),
    ("toe-in 1°", {"toe_in_deg": 1.0}, {}),
    ("toe-in 5°", {"toe_in_deg": 5.0}, {}),
    ("toe-in 5°, overscan 0.1", {"toe_in_deg": 5.0, "overscan": 0.1}, {}),
)


def numbers(folder: Path) -> str:
    """Coverage, L1 and bad-1 of each matcher on a pair."""
    loaded = load_pair(folder, {})
    truth, visible, camera = loaded.depth["left"], loaded.visible["left"], loaded.pair.camera
    text = f"{100 * visible.mean():6.1f}"
    for method in METHODS:
        text += measure_errors(method, loaded.images, truth, visible, camera).line()
    return text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("width", nargs="?", type=int, default=320)
    parser.add_argument("samples", nargs="?", type=int, default=32)


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    scene = start_blender()
    width = options.width
    base = settings_of(
        ("enceladus_block_field",),
        {
            "rig": {"width_px": width, "height_px": width * 3 // 4, "motion_exposure_s": SECONDS},
            "quality": {"samples": options.samples, "threads": 1},
        },
    )
    built = build_scene(scene, base)
    print(f"{'':26}{'both %':>6}{heads(METHODS)}   CPU")
    first = 0.0
    with scratch() as folder:
        for title, rig, sensor in ROWS:
            settings = description.merged(base, description.check({"rig": rig, "sensor": sensor}, title))
            watch = Stopwatch()
            pairs = render(built, settings, folder)
            cost = watch.lap()
            first = first or cost
            print(f"{title:26}{numbers(pairs[0])}  {cost / first:5.2f}", flush=True)

"""The effect of rendered blur and toe-in on stereo, and their cost: one scene with different lenses, motions and rigs.

    python benchmarks/blur.py [WIDTH [SAMPLES]]

Depth error, coverage and bad-1 are measured on the pixels that both eyes see. Cost is the CPU time of the render, as a
ratio to the first row of the same run.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import bpy
import icymoon
import numpy as np
from icymoon.nodes.scene import build
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings import description, preset_files
from icymoon.stereo.matchers import match
from icymoon.stereo.measure.prepare import load

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
    loaded = load(folder, {})
    truth, visible, camera = loaded.depth["left"], loaded.visible["left"], loaded.pair.camera
    text = f"{100 * visible.mean():6.1f}"
    for method in METHODS:
        disparity, _, _ = match(method, *loaded.images.for_matchers())
        found = np.isfinite(disparity) & visible
        error = np.abs(disparity - camera.disparity(truth))[found]
        depth = np.abs(camera.focal_baseline_px_m / disparity[found].astype(np.float64) - truth[found])
        text += f"  {100 * found.sum() / visible.sum():6.1f} {100 * depth.mean():7.2f} {100 * (error > 1).mean():6.2f}"
    return text


def main(arguments: list[str]) -> None:
    """Print the table."""
    width, samples = (int(word) for word in (*arguments, *("320", "32")[len(arguments) :]))
    icymoon.register()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    base = description.merged(
        description.defaults(),
        preset_files.load_preset("enceladus_block_field"),
        {
            "rig": {"width_px": width, "height_px": width * 3 // 4, "motion_exposure_s": SECONDS},
            "quality": {"samples": samples, "threads": 1},
        },
    )
    built = build(bpy.context.scene, base)
    heads = "".join(f"  {method + ' cov':>6} {'L1 cm':>7} {'bad1 %':>6}" for method in METHODS)
    print(f"{'':26}{'both %':>6}{heads}   CPU")
    first = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for title, rig, sensor in ROWS:
            settings = description.merged(base, description.check({"rig": rig, "sensor": sensor}, title))
            start = time.process_time()
            pairs = render_pairs(built, expand_headings(settings), Path(folder), 1, 0.0, lambda *a, **k: None)
            cost = time.process_time() - start
            first = first or cost
            print(f"{title:26}{numbers(pairs[0])}  {cost / first:5.2f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(0)  # Blender as a module may crash or hang when the interpreter ends

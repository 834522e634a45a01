"""What a lander costs: processor seconds of a pair with it and without, as a ratio within one run, and the error of the
arm's forward kinematics.

    python benchmarks/lander.py [--width PX] [--samples N]

The scene is ``workspace_europa_lander`` on a grid, so that most of the time is that of rays. Building is not counted.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
from icymoon.nodes.scene import build
from icymoon.physics.arm.kinematics import tip_of
from icymoon.physics.arm.parametric import arm_of
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings

POSES = 2000


def render_seconds(settings: Settings, folder: Path) -> float:
    """Processor seconds of the render of a pair into a folder, without building its scene."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    built = build(bpy.context.scene, settings)
    start = time.process_time()
    render_pairs(built, expand_headings(settings), folder, 1, 0.0, lambda *a, **k: None)
    return time.process_time() - start


def scene(width: int, samples: int, kind: str) -> Settings:
    """The scene with a lander of a kind, small and without a denoiser."""
    image: Parts = {
        "rig": {"width_px": width, "height_px": width * 3 // 4},
        "mesh": {"kind": "GRID"},
        "terrain": {"resolution": 257, "size_m": 12.0},
        "workspace": {"cell_m": 0.0},
        "quality": {"samples": samples, "denoiser": "NONE", "threads": 1},
        "lander": {"kind": kind},
    }
    return description.merged(description.defaults(), preset_files.load_preset("scenes/workspace_europa_lander"), image)


def kinematics_error_m() -> float:
    """The largest distance of the tip from a yaw and a sum of lengths in the plane of the arm."""
    arm = arm_of(description.defaults())
    offset, upper, fore, hand = arm.lengths_m
    worst = 0.0
    for yaw, q1, q2, q3, q4 in np.random.default_rng(1).uniform(arm.low, arm.high, (POSES, 5)):
        pitches = (0.0, q1, q1 + q2, q1 + q2 + q3)
        out, up = (
            sum(
                length * turn(pitch)
                for length, turn, pitch in zip((offset, upper, fore, hand), (each,) * 4, pitches, strict=True)
            )
            for each in (math.cos, math.sin)
        )
        place = arm.base @ [out * math.cos(yaw), out * math.sin(yaw), up, 1.0]
        worst = max(worst, float(np.linalg.norm(place[:3] - tip_of(arm, np.array([yaw, q1, q2, q3, q4])))))
    return worst


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--samples", type=int, default=32)
    options = parser.parse_args()
    print(f"error of the tip, largest of {POSES} poses: {kinematics_error_m():.1e} m", flush=True)
    took = {}
    for kind in ("NONE", "PARAMETRIC"):
        with tempfile.TemporaryDirectory(prefix="icymoon-lander-") as folder:
            took[kind] = render_seconds(scene(options.width, options.samples, kind), Path(folder))
        print(f"{kind:<11} {took[kind]:8.1f} CPU-s  {took[kind] / took['NONE']:.2f} x", flush=True)
    os._exit(0)  # Blender as a module may hang at its exit


if __name__ == "__main__":
    main()

"""The cost of a lander: processor seconds of a pair with it and without, as a ratio within one run, and the error of
the arm's forward kinematics.

    python benchmarks lander [--width PX] [--samples N]

The scene is ``workspace_europa_lander`` on a grid, so that rays take most of the time. Building is not counted.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from icymoon.benchmarks.common.renders import measure_render_seconds, settings_of, start_blender
from icymoon.physics.arm.kinematics import find_tip
from icymoon.physics.arm.parametric_arm import make_parametric_arm
from icymoon.settings import description
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings

POSES = 2000


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
    return settings_of(("scenes/workspace_europa_lander",), image)


def measure_kinematics_error_m() -> float:
    """The largest distance of the tip by forward kinematics from the tip by trigonometry: a yaw, and the sum of the
    links in the arm's plane."""
    arm = make_parametric_arm(description.defaults())
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
        worst = max(worst, float(np.linalg.norm(place[:3] - find_tip(arm, np.array([yaw, q1, q2, q3, q4])))))
    return worst


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--samples", type=int, default=32)


def main(options: argparse.Namespace) -> None:
    """Print the error and the costs."""
    start_blender()
    print(f"error of the tip, largest of {POSES} poses: {measure_kinematics_error_m():.1e} m", flush=True)
    took = {}
    for kind in ("NONE", "PARAMETRIC"):
        took[kind] = measure_render_seconds(scene(options.width, options.samples, kind))
        print(f"{kind:<11} {took[kind]:8.1f} CPU-s  {took[kind] / took['NONE']:.2f} x", flush=True)

"""The picture at the top of the README: left image, true depth and depth error of a pair, side by side.

    python benchmarks picture [TARGET.png]

Renders the Europa preset with the horizon in view and evaluates it. Without an argument it writes
docs/images/europa.png.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
from icymoon.benchmarks.common.arguments import scratch

TARGET = Path(__file__).resolve().parents[2] / "docs" / "images" / "europa.png"
SCENE = ("--preset", "europa_rough_ice", "--set", "rig.pitch_deg=24", "--set", "rig.heading_deg=35")
GAP_PX = 6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("target", nargs="?", type=Path, default=TARGET, help="docs/images/europa.png by default")


def main(options: argparse.Namespace) -> None:
    """Render, evaluate and join."""
    with scratch() as folder:
        dataset = folder / "set"
        subprocess.run([sys.executable, "-m", "icymoon", "render", *SCENE, "--out", str(dataset)], check=True)
        subprocess.run(
            [
                sys.executable,
                "-m",
                "icymoon.stereo",
                "evaluate",
                str(dataset),
                "--methods",
                "sgbm",
                "--out",
                str(folder / "report"),
            ],
            check=True,
        )
        shown = next((folder / "report" / "pairs").iterdir())
        images = [cv2.imread(str(shown / f"{name}.png")) for name in ("left", "true_depth", "sgbm_error")]
    height = max(image.shape[0] for image in images)
    padded = [
        np.pad(image, ((0, height - image.shape[0]), (0, GAP_PX), (0, 0)), constant_values=255) for image in images
    ]
    target: Path = options.target
    target.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(target), np.hstack(padded)[:, :-GAP_PX], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(target)

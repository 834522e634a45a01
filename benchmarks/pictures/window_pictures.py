"""The pictures of the window in the manual, made from screenshots of a real Blender.

    python tests/gui/run.py --manual 4.3
    python benchmarks window_pictures out/shots/4.3-trixie

Scales them down and writes them to docs/images.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2

TARGET = Path(__file__).resolve().parents[2] / "docs" / "images"
WIDTH_PX, JPEG_QUALITY = 1000, 82


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="the screenshots")


def main(options: argparse.Namespace) -> None:
    """Shrink and write."""
    for path in sorted(options.folder.glob("window_*.png")):
        view = cv2.imread(str(path))
        size = WIDTH_PX, round(WIDTH_PX * view.shape[0] / view.shape[1])
        target = TARGET / f"{path.stem}.jpg"
        cv2.imwrite(
            str(target), cv2.resize(view, size, interpolation=cv2.INTER_AREA), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        )
        print(target)

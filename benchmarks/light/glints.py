"""The share of a pair's pixels that glint, and the share of the left eye's glints that are in the right eye too.

    python benchmarks glints FOLDER

``FOLDER`` is a pair's, with its depth. A glint is brighter than 1.5 times the median of the 5 x 5 pixels around it, on
ground that is lit. It is in both eyes if one of the three pixels around its point in the right eye glints too. "By
chance" is the share of the right eye's lit pixels with a glint among the three pixels around them. Noise of few samples
counts too. Needs the evaluator's packages.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from icymoon.physics.rig.focal_length import focal_px
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.stereo.images.develop import average_bands
from icymoon.stereo.images.exr import read_truth, read_view
from icymoon.support.arrays import Array

_BRIGHTER, _LIT = 1.5, 0.05
#: Limits of distance in metres between rows of the table.
_LIMITS_M = (0.0, 4.0, 8.0, np.inf)


def find_glints(radiance: Array) -> tuple[Array, Array]:
    """Whether pixels of an image (h, w) are glints, and whether they are lit."""
    around = cv2.medianBlur(radiance.astype(np.float32), 5)
    lit = around > _LIT * np.median(around[around > 0.0])
    return lit & (radiance > _BRIGHTER * around), lit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path)


def main(options: argparse.Namespace) -> None:
    """Print the shares."""
    pair = read_pair(options.folder)
    views = {eye: average_bands(read_view(pair.image(eye)).radiance).astype(np.float64) for eye in ("left", "right")}
    (left, lit_left), (right, lit_right) = (find_glints(views[eye]) for eye in ("left", "right"))
    depth, rig = read_truth(pair.truth("left"), "left").depth, pair.settings.rig
    print(
        f"glints: {left.sum() / lit_left.sum():.2%} of lit pixels on the left, {right.sum() / lit_right.sum():.2%} "
        "on the right"
    )
    about = cv2.dilate(right.astype(np.uint8), np.ones((1, 3), np.uint8)).astype(bool)
    print(f"in both eyes by chance: {about[lit_right].mean():.1%}")
    row, column = np.nonzero(left & np.isfinite(depth))
    there = np.rint(column - focal_px(rig) * rig.baseline_m / depth[row, column]).astype(int)
    inside = (there >= 0) & (there < left.shape[1])
    row, column, there = row[inside], column[inside], there[inside]
    for least, most in pairwise(_LIMITS_M):
        some = (depth[row, column] >= least) & (depth[row, column] < most)
        if some.any():
            print(f"depth {least:g} to {most:g} m: {about[row[some], there[some]].mean():.0%} of {some.sum()} glints")

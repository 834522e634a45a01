"""The cost of a Bayer mosaic for stereo: the same pairs developed by a monochrome and by a colour camera.

    python benchmarks colour DATASET [key=value …]

Renders nothing. The colour camera comes from ``sensors/mastcam_z``; the monochrome one is the same without filters,
with the efficiency of the green one. Settings of ``sensor`` after the data set change both. Errors are measured on the
pixels that both eyes see: coverage, mean depth error, share of disparities more than 1 px off, and the RMS error of the
others.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from icymoon.benchmarks.common.matcher_errors import measure_errors
from icymoon.benchmarks.common.processor import Stopwatch
from icymoon.render.pairs.pair_folder import EYES, Pair, find_pairs
from icymoon.settings.description import merged
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.images.develop import DevelopedImages, develop
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth, find_visible_in_right
from icymoon.stereo.images.exr import View, read_view
from icymoon.support.arrays import Array

METHODS = ("bm", "sgbm")
#: Settings of the cameras by the label of their row.
ROWS: dict[str, dict[str, Any]] = {
    "monochrome": {"colour": "MONO"},
    "Bayer, BILINEAR": {"demosaicing": "BILINEAR"},
    "Bayer, MALVAR": {"demosaicing": "MALVAR"},
    "Bayer, EDGE_AWARE": {"demosaicing": "EDGE_AWARE"},
    "Bayer, MALVAR, mean as grey": {"demosaicing": "MALVAR", "grey": "MEAN"},
}


def develop_with_colour(pair: Pair, views: dict[str, View], sensor: dict[str, Any]) -> DevelopedImages:
    """The pair's images by the colour camera, with changes of ``sensor``."""
    camera = load_preset("sensors/mastcam_z")
    glass = {"band_centre_nm": 560.0, "band_width_nm": 320.0, "quantum_efficiency": 0.403}
    return develop(pair, views["left"], views["right"], merged(pair.settings, camera, {"sensor": glass | sensor}))


def errors(pair: Pair, views: dict[str, View], visible: Array, images: DevelopedImages) -> list[float]:
    """Coverage in %, L1 in cm, bad-1 in % and RMS in px of each matcher."""
    truth = find_scene_depth(views["left"])
    found_errors: list[float] = []
    for method in METHODS:
        found = measure_errors(method, images, truth, visible, pair.camera)
        found_errors += [100 * found.coverage, 100 * found.depth_m, 100 * found.bad_1, found.good_rms_px]
    return found_errors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path)
    parser.add_argument("changes", nargs="*", metavar="key=value", help="settings of the sensor")


def main(options: argparse.Namespace) -> None:
    """Print the table: means over all pairs."""
    cv2.setNumThreads(1)
    changes: dict[str, Any] = {key: float(value) for key, value in (text.split("=") for text in options.changes)}
    head = "".join(f"  {m + ' cov %':>10} {'L1 cm':>6} {'bad1 %':>6} {'RMS px':>6}" for m in METHODS)
    rows: dict[str, list[list[float]]] = {label: [] for label in ROWS}
    seconds = dict.fromkeys(ROWS, 0.0)
    for pair in find_pairs(options.dataset):
        views = {eye: read_view(pair.image(eye), eye) for eye in EYES}
        visible = find_visible_in_right(find_scene_depth(views["left"]), find_scene_depth(views["right"]), pair.camera)
        for label, sensor in ROWS.items():
            watch = Stopwatch()
            images = develop_with_colour(pair, views, {"colour": "BAYER"} | sensor | changes)
            seconds[label] += watch.lap()
            rows[label].append(errors(pair, views, visible, images))
    print(f"{'':30}{head}  CPU s")
    for label, values in rows.items():
        means = np.mean(values, axis=0)
        text = "".join(
            f"  {means[k]:10.1f} {means[k + 1]:6.2f} {means[k + 2]:6.2f} {means[k + 3]:6.3f}"
            for k in range(0, len(means), 4)
        )
        print(f"{label:30}{text} {seconds[label] / len(values):6.2f}")

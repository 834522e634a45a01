"""What a Bayer mosaic costs stereo: the same pairs developed by a monochrome and by a colour camera.

    python benchmarks/colour.py DATASET [key=value …]

Renders nothing. The colour camera is that of ``sensors/mastcam_z``; the monochrome one is the same without filters,
with the efficiency of the green one. Settings of ``sensor`` after the data set change both. Errors are measured on the
pixels that both eyes see: coverage, mean depth error, share of disparities more than 1 px off, and the RMS error of the
others.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from icymoon.render.pairs.pair_folder import EYES, Pair, find_pairs
from icymoon.settings.description import merged
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.images.develop import Images, develop
from icymoon.stereo.images.disparity_and_occlusion import scene_depth, visible_in_right
from icymoon.stereo.images.exr import View, read_view
from icymoon.stereo.matchers import match
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


def images_of(pair: Pair, views: dict[str, View], sensor: dict[str, Any]) -> Images:
    """The pair by the colour camera, with changes of ``sensor``."""
    camera = load_preset("sensors/mastcam_z")
    glass = {"band_centre_nm": 560.0, "band_width_nm": 320.0, "quantum_efficiency": 0.403}
    return develop(pair, views["left"], views["right"], merged(pair.settings, camera, {"sensor": glass | sensor}))


def errors(pair: Pair, views: dict[str, View], visible: Array, images: Images) -> list[float]:
    """Coverage in %, L1 in cm, bad-1 in % and RMS in px of each matcher."""
    truth = scene_depth(views["left"])
    found_errors: list[float] = []
    for method in METHODS:
        disparity, _, _ = match(method, *images.for_matchers())
        found = np.isfinite(disparity) & visible
        off = (disparity - pair.camera.disparity(truth))[found]
        l1 = np.abs(pair.camera.focal_baseline_px_m / disparity.astype(np.float64)[found] - truth[found]).mean()
        near = np.abs(off) <= 1
        found_errors += [
            100 * found.sum() / visible.sum(),
            100 * l1,
            100 * (1 - near.mean()),
            float(np.sqrt(np.mean(off[near] ** 2))),
        ]
    return found_errors


def main(arguments: list[str]) -> None:
    """Print the table: means over all pairs."""
    cv2.setNumThreads(1)
    changes: dict[str, Any] = {key: float(value) for key, value in (text.split("=") for text in arguments[1:])}
    head = "".join(f"  {m + ' cov %':>10} {'L1 cm':>6} {'bad1 %':>6} {'RMS px':>6}" for m in METHODS)
    rows: dict[str, list[list[float]]] = {label: [] for label in ROWS}
    seconds = dict.fromkeys(ROWS, 0.0)
    for pair in find_pairs(Path(arguments[0])):
        views = {eye: read_view(pair.image(eye), eye) for eye in EYES}
        visible = visible_in_right(scene_depth(views["left"]), scene_depth(views["right"]), pair.camera)
        for label, sensor in ROWS.items():
            start = time.process_time()
            images = images_of(pair, views, {"colour": "BAYER"} | sensor | changes)
            seconds[label] += time.process_time() - start
            rows[label].append(errors(pair, views, visible, images))
    print(f"{'':30}{head}  CPU s")
    for label, values in rows.items():
        means = np.mean(values, axis=0)
        text = "".join(
            f"  {means[k]:10.1f} {means[k + 1]:6.2f} {means[k + 2]:6.2f} {means[k + 3]:6.3f}"
            for k in range(0, len(means), 4)
        )
        print(f"{label:30}{text} {seconds[label] / len(values):6.2f}")


if __name__ == "__main__":
    main(sys.argv[1:])

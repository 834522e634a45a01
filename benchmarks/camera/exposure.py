"""The effect of the camera on stereo: matchers with saturation, noise, brackets and particles, and their cost.

    python benchmarks exposure [PAIR_OR_DATASET]

Renders nothing: every row develops the same pair again. Depth error and coverage are measured on the
pixels that both eyes see. Without an argument it uses a synthetic pair.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pairs
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.matcher_errors import heads, measure_errors
from icymoon.benchmarks.common.processor import Stopwatch
from icymoon.render.pairs.pair_folder import EYES, Pair, find_pairs
from icymoon.settings.description import defaults, merged
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth, find_visible_in_right
from icymoon.stereo.images.exr import View, read_light, read_view
from icymoon.stereo.images.image_files import encode_image
from icymoon.support.arrays import Array

METHODS = ("bm", "sgbm")


def synthetic(folder: Path) -> Pair:
    """A textured plane with a cuboid, 640 x 480."""
    return find_pairs(pairs.write_pair(folder / "pair", pairs.Scene(), pairs.camera(640, 480), noise=0.005))[0]


def row(pair: Pair, views: dict[str, View], visible: Array, sensor: dict[str, Any]) -> str:
    """Share of saturated pixels, then coverage, L1 and bad-1 of each matcher."""
    images = develop(pair, views["left"], views["right"], merged(defaults(), pair.settings, {"sensor": sensor}))
    truth = find_scene_depth(views["left"])
    text = f"{100 * images.saturated:7.1f}"
    for method in METHODS:
        text += measure_errors(method, images, truth, visible, pair.camera).line()
    return text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", nargs="?", type=Path, help="a pair or a data set (default: a synthetic pair)")


def main(options: argparse.Namespace) -> None:
    """Print the tables."""
    cv2.setNumThreads(1)
    with scratch() as folder:
        pair = find_pairs(options.folder)[0] if options.folder else synthetic(folder)
        views = {eye: read_view(pair.image(eye), eye) for eye in EYES}
        visible = find_visible_in_right(find_scene_depth(views["left"]), find_scene_depth(views["right"]), pair.camera)
        settings = merged(defaults(), pair.settings)
        base = develop(pair, views["left"], views["right"], settings).exposure_s
        head = f"{'':34}{'full %':>7}{heads(METHODS)}"
        tables: dict[str, list[tuple[str, dict[str, Any]]]] = {
            f"Saturation: auto exposure is {base:.3g} s": [
                (f"exposure x {factor:g}", {"auto_exposure": False, "exposure_s": base * factor})
                for factor in (0.01, 0.1, 0.5, 1, 1.5, 2, 3, 4, 8)
            ],
            "Noise: full well, so signal to noise, at auto exposure": [
                (f"full well {well:g} e-", {"full_well_e": float(well), "read_noise_e": 15.0})
                for well in (20000, 5000, 1000, 300, 100)
            ],
            "Gain at a 12-bit converter and square-root encoding": [
                (f"gain {gain:g}", {"bits": 12, "encoding": "SQUARE_ROOT", "gain": gain}) for gain in (1.0, 8.0, 64.0)
            ],
            "Brackets of 2 stops at 4 x the exposure": [
                (
                    f"{n} exposures",
                    {
                        "auto_exposure": False,
                        "exposure_s": 4 * base,
                        "brackets": n,
                        "bits": 12,
                        "encoding": "SQUARE_ROOT",
                    },
                )
                for n in (1, 3, 5)
            ],
            "Glare and blur": [
                (f"glare {g:g}, PSF {p:g} px", {"veiling_glare": g, "psf_sigma_px": p})
                for g, p in ((0.05, 0.0), (0.5, 0.0), (0.0, 0.7), (0.0, 2.0))
            ],
            "Particles, 10 ms": [
                (
                    f"{flux:.0e} per cm² and s",
                    {"auto_exposure": False, "exposure_s": base, "radiation_flux_cm2_s": flux * 0.01 / base},
                )
                for flux in (1e3, 1e4, 1e5)
            ],
        }
        for title, rows in tables.items():
            print(f"\n{title}\n{head}")
            for name, sensor in rows:
                print(f"{name:34}{row(pair, views, visible, sensor)}")
        watch = Stopwatch()
        left, right = (read_light(pair.image(eye), eye, groups=False) for eye in EYES)
        images = develop(pair, left, right, merged(settings, {"sensor": {"psf_sigma_px": 0.7, "prnu": 0.01}}))
        for eye in EYES:
            encode_image(getattr(images, eye).astype(np.uint8), ".png")
        print(f"\nRead, develop (with PSF and PRNU) and encode a pair: {watch.lap():.3f} CPU s")

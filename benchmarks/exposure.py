"""The effect of the camera on stereo: matchers with saturation, noise, brackets and particles, and their cost.

    python benchmarks/exposure.py PAIR_OR_DATASET

Renders nothing: every row develops the same pair again. Depth error and coverage are measured on the
pixels that both eyes see. Without an argument it uses a synthetic pair, which needs ``tests/support/pairs.py``.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from icymoon.render.pairs.pair_folder import EYES, Pair, find_pairs
from icymoon.settings.description import defaults, merged
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.disparity_and_occlusion import scene_depth, visible_in_right
from icymoon.stereo.images.exr import View, read_light, read_view
from icymoon.stereo.images.image_files import encoded
from icymoon.stereo.matchers import match
from icymoon.support.arrays import Array

METHODS = ("bm", "sgbm")


def synthetic(folder: Path) -> Pair:
    """A textured plane with a cuboid, 640 x 480."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
    import pairs

    return find_pairs(pairs.write_pair(folder / "pair", pairs.Scene(), pairs.camera(640, 480), noise=0.005))[0]


def row(pair: Pair, views: dict[str, View], visible: Array, sensor: dict[str, Any]) -> str:
    """Share of full pixels, then coverage, L1 and bad-1 of each matcher."""
    images = develop(pair, views["left"], views["right"], merged(defaults(), pair.settings, {"sensor": sensor}))
    truth = scene_depth(views["left"])
    text = f"{100 * images.saturated:7.1f}"
    for method in METHODS:
        disparity, _, _ = match(method, *images.for_matchers())
        found = np.isfinite(disparity) & visible
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = pair.camera.focal_baseline_px_m / disparity.astype(np.float64)
        off = np.abs(disparity - pair.camera.disparity(truth))[found] > 1
        l1 = np.abs(depth - truth)[found].mean() if found.any() else np.nan
        text += f"  {100 * found.sum() / visible.sum():6.1f} {100 * l1:7.2f} {100 * off.mean():6.2f}"
    return text


def main(arguments: list[str]) -> None:
    """Print the tables."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        pair = find_pairs(Path(arguments[0]))[0] if arguments else synthetic(Path(folder))
        views = {eye: read_view(pair.image(eye), eye) for eye in EYES}
        visible = visible_in_right(scene_depth(views["left"]), scene_depth(views["right"]), pair.camera)
        settings = merged(defaults(), pair.settings)
        base = develop(pair, views["left"], views["right"], settings).exposure_s
        head = f"{'':34}{'full %':>7}" + "".join(f"  {m + ' cov %':>6} {'L1 cm':>6} {'bad1 %':>6}" for m in METHODS)
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
        start = time.process_time()
        left, right = (read_light(pair.image(eye), eye, groups=False) for eye in EYES)
        images = develop(pair, left, right, merged(settings, {"sensor": {"psf_sigma_px": 0.7, "prnu": 0.01}}))
        for eye in EYES:
            encoded(getattr(images, eye).astype(np.uint8), ".png")
        print(f"\nRead, develop (with PSF and PRNU) and encode a pair: {time.process_time() - start:.3f} CPU s")


if __name__ == "__main__":
    main(sys.argv[1:])

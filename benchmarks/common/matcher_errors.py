"""Errors of a matcher on the pixels that both eyes see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.stereo.images.develop import DevelopedImages
from icymoon.stereo.matchers import match
from icymoon.support.arrays import Array


@dataclass(frozen=True)
class MatcherErrors:
    """Shares from 0 to 1, lengths in metres and pixels; NaN where the matcher measures nothing."""

    coverage: float  #: measured, of the pixels that both eyes see
    depth_m: float  #: mean error of depth
    bad_1: float  #: off by more than 1 px, of the measured pixels
    good_rms_px: float  #: RMS error of the measured pixels that are not off by more

    def line(self) -> str:
        """Coverage in %, depth error in cm and share off in %, as under ``HEAD``."""
        return f"  {100 * self.coverage:6.1f} {100 * self.depth_m:7.2f} {100 * self.bad_1:6.2f}"


def heads(methods: tuple[str, ...]) -> str:
    """The column headers above each method's ``MatcherErrors.line``."""
    return "".join(f"  {method + ' cov':>6} {'L1 cm':>7} {'bad1 %':>6}" for method in methods)


def measure_errors(
    method: str, images: DevelopedImages, depth_m: Array, visible: Array, camera: StereoCamera
) -> MatcherErrors:
    """The errors of a method on a pair's images.

    ``depth_m`` (H, W) is the true depth of the left eye and ``visible`` bool (H, W) tells where the right eye sees it.
    """
    disparity, _, _ = match(method, *images.for_matchers())
    found = np.isfinite(disparity) & visible
    if not found.any():
        return MatcherErrors(0.0, np.nan, np.nan, np.nan)
    off = (disparity - camera.disparity(depth_m))[found]
    with np.errstate(divide="ignore"):
        depth = camera.focal_baseline_px_m / disparity[found].astype(np.float64)
    good = np.abs(off) <= 1
    return MatcherErrors(
        float(found.sum() / visible.sum()),
        float(np.abs(depth - depth_m[found]).mean()),
        float(1 - good.mean()),
        float(np.sqrt(np.mean(off[good] ** 2))),
    )

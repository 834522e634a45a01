"""Confidences of any matcher that can be run again, from its answers to changed images.

Each measure compares two answers about a pixel; their difference in px is taken as the expected error, see ``result``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from . import get_matcher_title, match_checked
from .result import ERROR_PX, Confidence
from .search_range import SearchRange

#: Disparities in px that the sweep adds, each by one more run. Fractions of a pixel change what a matcher sees even
#: where it treats whole pixels alike, as block matching does.
SWEPT_PX = (0.5, 2.25, 5.75)
#: Measures of confidence that need more runs, and their number.
RUNS = {"left_right": 1, "sweep": len(SWEPT_PX)}
#: Difference in px that counts where one of the two answers is missing.
_MISSING_PX = 1e3


def compute_black_box_confidence(
    measure: str,
    method: str,
    left: Array,
    right: Array,
    disparity: Array,
    options: Mapping[str, Any],
    camera: StereoCamera | None = None,
    ranges: Mapping[str, SearchRange] | None = None,
) -> Array:
    """Compute the confidence, float32 (H, W) from 0 to 1, of a ``disparity`` (H, W), px, NaN where invalid, that
    ``match_checked`` found with the other arguments. ``measure`` is one of RUNS. Raises IcyMoonError if a run fails.
    """

    def run(left: Array, right: Array, camera: StereoCamera | None) -> Array:
        return match_checked(method, left, right, options, camera, ranges)[0]

    find = find_left_right_error if measure == "left_right" else find_sweep_error
    error = find(run, left, right, disparity, camera)
    return Confidence(error, ERROR_PX).check(get_matcher_title(method), np.isfinite(disparity))


#: Matches a left and a right image with the camera that took them: the disparity, px, NaN where invalid.
Run = Callable[[Array, Array, StereoCamera | None], Array]


def find_left_right_error(
    run: Run, left: Array, right: Array, disparity: Array, camera: StereoCamera | None = None
) -> Array:
    """Find the difference in px (H, W) between the disparity of each left pixel and the disparity of the right pixel to
    which it points. It is large where the right pixel has no disparity or is outside the image. Between two right
    pixels the nearer pixel counts, because the mean of two surfaces lies on neither.
    """
    of_right = match_right_image(run, left, right, camera)
    width = disparity.shape[1]
    column = np.arange(width) - disparity
    with np.errstate(invalid="ignore"):
        inside = (column > -0.5) & (column < width - 0.5)
    at = np.where(inside, np.rint(np.nan_to_num(column)), 0).astype(int)
    answer = np.where(inside, np.take_along_axis(of_right, at, axis=1), np.nan)
    return np.nan_to_num(np.abs(answer - disparity), nan=_MISSING_PX)


def match_right_image(run: Run, left: Array, right: Array, camera: StereoCamera | None = None) -> Array:
    """Find the disparity (H, W) of the right image, px: both images are mirrored and exchanged, so that the right one
    is matched as a left one.
    """
    mirrored = [np.ascontiguousarray(image[:, ::-1]) for image in (right, left)]
    return run(mirrored[0], mirrored[1], camera and mirror_camera(camera))[:, ::-1]


def mirror_camera(camera: StereoCamera) -> StereoCamera:
    """Return the rig of the mirrored images, with the right eye as the left one."""
    rig = camera.rectified
    return replace(rig, cx_px=rig.width_px - rig.cx_px - rig.doffs_px)


def find_sweep_error(
    run: Run, left: Array, right: Array, disparity: Array, camera: StereoCamera | None = None
) -> Array:
    """Find the expected error in px (H, W) by a sweep of disparity planes (Lee et al. 2024).

    The right image is shifted by each of SWEPT_PX, which should add as much to each disparity. The expected error is
    -log(mean of exp(-difference)) over the shifts.
    """
    trust: Array = np.zeros(disparity.shape)
    for shift in SWEPT_PX:
        moved = run(left, shift_left(right, shift), camera)
        trust += np.exp(-np.nan_to_num(np.abs(moved - shift - disparity), nan=_MISSING_PX)) / len(SWEPT_PX)
    return np.asarray(-np.log(np.clip(trust, np.finfo(np.float64).tiny, 1.0)))


def shift_left(image: Array, shift: float) -> Array:
    """Move an image (H, W) or (H, W, bands) to the left by ``shift`` px, interpolated linearly; its border is repeated
    beyond it.
    """
    width = image.shape[1]
    column = np.minimum(np.arange(width) + shift, width - 1.0)
    first = np.minimum(np.floor(column).astype(int), width - 2)
    share = (column - first).reshape(-1, *[1] * (image.ndim - 2))
    mixed = (1 - share) * image[:, first] + share * image[:, first + 1]
    return np.rint(mixed).astype(image.dtype)

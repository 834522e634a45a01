"""Semi-global matching of both eyes, smoothed along the left image (weighted least squares).

OpenCV's StereoSGBM and its DisparityWLSFilter, which smooths where the two eyes agree, fills in where they do not, and
stops at edges of the image: Min et al., "Fast global image smoothing based on weighted least squares", IEEE TIP
23(12), 2014.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .opencv_common import STEPS_PER_PX, drop_matches_outside_right, extend_left, require_room, resolve_range
from .options import Option
from .result import Confidence, Result
from .search_range import SearchRange
from .sgbm import SEARCH_OPTIONS, StripMatcher, make_semi_global_matcher, remove_rounding_bias

TITLE = "SGBM with WLS"
ONE_PROCESSOR = True
SPARSE = True

OPTIONS = (
    *SEARCH_OPTIONS,
    Option(
        "smoothness",
        30.0,
        "Weight of smoothness against the matches (OpenCV's lambda; the 8000 of its manual turns slopes into steps)",
        0.0,
        1e6,
    ),
    Option("edge", 1.5, "Difference of grey that counts as an edge (OpenCV's sigma color)", 0.1, 100.0),
    Option(
        "min_confidence",
        0,
        "Least confidence of a measurement, 0 to 255; 0 keeps filled-in pixels, 1 drops them",
        0,
        255,
    ),
)

PRESETS: dict[str, dict[str, Any]] = {}


def settle(
    options: dict[str, Any], ranges: Mapping[str, SearchRange], shape: tuple[int, ...]
) -> tuple[dict[str, Any], SearchRange]:
    """Return the options with a search range in numbers, and this range."""
    return resolve_range("sgbm_wls", options, ranges)


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 (H, W) images. The confidence of OpenCV's filter is 0 where it filled in the
    disparity; the array ``confidence`` holds it as uint8, from 0 to 255.
    """
    cv2.setNumThreads(1)
    matcher = make_semi_global_matcher("sgbm_wls", options)
    filtering = cv2.ximgproc.createDisparityWLSFilter(matcher)
    backwards = cv2.ximgproc.createRightMatcher(matcher)
    filtering.setLambda(options["smoothness"])
    filtering.setSigmaColor(options["edge"])
    extension = options["min_disparity"] + options["disparities"]
    require_room("sgbm_wls", left, left.shape[1] > options["window"] // 2)
    left, right = extend_left(left, extension), extend_left(right, extension)
    try:
        # The filter takes floats too, so that nothing is rounded in between.
        smooth = filtering.filter(
            _match_in_mode(matcher, options["mode"], left, right),
            left,
            disparity_map_right=_match_in_mode(backwards, options["mode"], right, left),
        )
    except cv2.error as error:
        raise IcyMoonError(f"OpenCV's sgbm_wls failed ({error.err}); try other options.") from None
    confidence = np.rint(filtering.getConfidenceMap()[:, extension:]).clip(0, 255).astype(np.uint8)
    disparity = drop_matches_outside_right(smooth[:, extension:] / STEPS_PER_PX)
    return Result(
        np.where(confidence >= options["min_confidence"], disparity, np.nan),
        {"confidence": confidence},
        confidence=Confidence(confidence / 255),
    )


def _match_in_mode(matcher: cv2.StereoMatcher, mode: str, image: Array, other: Array) -> Array:
    """Compute disparities in OpenCV's 1/16 px, float32. Where matching failed they are OpenCV's mark, which its filter
    needs.
    """
    fixed = StripMatcher(matcher, mode).compute(image, other)
    measured = fixed >= matcher.getMinDisparity() * STEPS_PER_PX
    return np.where(measured, remove_rounding_bias(fixed / STEPS_PER_PX) * STEPS_PER_PX, fixed).astype(np.float32)

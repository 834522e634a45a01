"""Semi-global matching, OpenCV's StereoSGBM (Hirschmüller 2008, with windows)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .opencv_common import (
    SEARCH_RANGE,
    STEPS_PER_PX,
    drop_matches_outside_right,
    extend_left,
    make_filter_options,
    require_room,
    resolve_range,
    run_matcher,
)
from .options import Option
from .result import Result
from .search_range import SearchRange

TITLE = "SGBM"
ONE_PROCESSOR = True
SPARSE = True

#: Options that sgbm and sgbm_wls share.
SEARCH_OPTIONS = (
    *SEARCH_RANGE,
    Option("window", 5, "Side of the square that is compared, px, odd", 1, 25, 2, opencv="blockSize"),
    Option("p1", 0, "Penalty of a disparity step of 1 px between neighbours; 0 for 8 window²", 0, 100000, opencv="P1"),
    Option("p2", 0, "Penalty of a larger step, more than p1; 0 for 32 window²", 0, 100000, opencv="P2"),
    Option("prefilter_cap", 63, "Filtered values are cut at plus and minus this", 1, 63, opencv="preFilterCap"),
    Option(
        "mode",
        "hh",
        "Paths: hh 8 (the whole algorithm), hh4 4. sgbm, 5, a third of the time, and 3way, 3, shift "
        "sloping ground by up to 0.1 px",
        choices=("sgbm", "hh", "3way", "hh4"),
    ),
)

OPTIONS = (
    *SEARCH_OPTIONS,
    *make_filter_options(speckle_range=2),
)

PRESETS: dict[str, dict[str, Any]] = {}

#: Modes that keep the costs of the whole image in memory, the bytes of one cost, and the most bytes for all costs.
_WHOLE_IMAGE_MODES, _COST_BYTES, _MAX_COST_BYTES = ("hh", "hh4"), 4, 1e9
#: Rows beyond a strip of the image from which its paths may come. With 64, strips change no pixel in ten thousand.
_STRIP_MARGIN_ROWS = 64

_MODE_CODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "hh": cv2.STEREO_SGBM_MODE_HH,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh4": cv2.STEREO_SGBM_MODE_HH4,
}


def settle(
    options: dict[str, Any], ranges: Mapping[str, SearchRange], shape: tuple[int, ...]
) -> tuple[dict[str, Any], SearchRange]:
    """Return the options with a search range in numbers, and this range."""
    return resolve_range("sgbm", options, ranges)


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 (H, W) images, float32 px, NaN where invalid."""
    least = options["min_disparity"]
    matcher = make_semi_global_matcher("sgbm", options)
    matcher.setUniquenessRatio(options["uniqueness"])
    matcher.setSpeckleWindowSize(options["speckle_window"])
    matcher.setSpeckleRange(options["speckle_range"])
    matcher.setDisp12MaxDiff(options["left_right"])
    reach = least + options["disparities"]
    extension = reach if options["left_border"] == "match" else 0
    height, width = left.shape
    # OpenCV 5 refuses a smaller image; older versions give random results.
    require_room("sgbm", left, width + extension - reach > options["window"] // 2)
    left, right = extend_left(left, extension), extend_left(right, extension)
    # Unlike StereoBM, SGBM compares windows that extend over the border.
    disparity = run_matcher(
        "sgbm", StripMatcher(matcher, options["mode"]), left, right, least, (reach, width + extension), (0, height)
    )[:, extension:]
    return Result(drop_matches_outside_right(remove_rounding_bias(disparity)))


def make_semi_global_matcher(method: str, options: dict[str, Any]) -> cv2.StereoSGBM:
    """Make OpenCV's matcher with the options of ``SEARCH_OPTIONS``; it rejects no match. Raises IcyMoonError unless p2
    is above p1.
    """
    area = options["window"] ** 2
    small_step, large_step = options["p1"] or 8 * area, options["p2"] or 32 * area
    if small_step >= large_step:
        raise IcyMoonError(f"{method}.p2, {large_step}, must be above {method}.p1, {small_step}; raise p2 or lower p1.")
    return cv2.StereoSGBM.create(
        minDisparity=options["min_disparity"],
        numDisparities=options["disparities"],
        blockSize=options["window"],
        P1=small_step,
        P2=large_step,
        disp12MaxDiff=-1,
        preFilterCap=options["prefilter_cap"],
        mode=_MODE_CODES[options["mode"]],
    )


@dataclass(frozen=True)
class StripMatcher:
    """A semi-global matcher that processes a large image in strips of rows, so that its costs fit into memory."""

    matcher: cv2.StereoMatcher
    mode: str

    def compute(self, image: Array, other: Array) -> Array:
        """Compute OpenCV's fixed-point disparities of ``image``."""
        height, width = image.shape
        rows = int(_MAX_COST_BYTES / (_COST_BYTES * width * self.matcher.getNumDisparities()))
        if self.mode not in _WHOLE_IMAGE_MODES or rows >= height:
            return np.asarray(self.matcher.compute(image, other))
        step = max(rows - 2 * _STRIP_MARGIN_ROWS, _STRIP_MARGIN_ROWS)
        parts = []
        for start in range(0, height, step):
            top, bottom = max(0, start - _STRIP_MARGIN_ROWS), min(height, start + step + _STRIP_MARGIN_ROWS)
            part = self.matcher.compute(image[top:bottom], other[top:bottom])
            parts.append(part[start - top : min(start + step, height) - top])
        return np.vstack(parts)


def remove_rounding_bias(disparity: Array) -> Array:
    """Remove the bias of OpenCV's rounding from a disparity, px.

    The sub-pixel offset, in 1/16 px, is the integer quotient (16 a + b) / 2b, which C++ truncates toward zero. So
    negative offsets are one sixteenth too large, and half of the offsets that are 0 should be one less. On a textured
    plane this is a bias of +0.025 px.
    """
    sixteenth = np.mod(np.round(disparity * STEPS_PER_PX), STEPS_PER_PX)
    excess = np.where(sixteenth >= STEPS_PER_PX // 2, 1.0, np.where(sixteenth == 0, 0.5, 0.0)) / STEPS_PER_PX
    return np.asarray(disparity - excess, np.float32)

"""Block matching, OpenCV's StereoBM; its defaults were chosen on rendered ice, its preset ``guiss`` is the paper's.

The preset ``guiss`` has the parameters of nasa-jpl/guiss, ``stereoBM_eval.py``: window 49, 96 disparities from 4. With
the camera of the GUISS paper this measures from 0.86 m to 21.3 m. The defaults give the smallest share of visible
pixels that are missing or wrong by more than 1 px, without a larger depth error on the demo: 7 % instead of 34 % over
the two scenes of the demo, a noisy scene and two synthetic ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from .opencv_common import (
    SEARCH_RANGE,
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

TITLE = "StereoBM"
ONE_PROCESSOR = True
SPARSE = True

OPTIONS = (
    *SEARCH_RANGE,
    Option("window", 17, "Side of the square that is compared, px, odd", 5, 255, 2, opencv="blockSize"),
    Option(
        "prefilter",
        "normalized",
        "What is compared: horizontal gradients or grey normalised by its contrast",
        choices=("xsobel", "normalized"),
        opencv="preFilterType",
    ),
    Option("prefilter_size", 11, "Window of the normalising filter, px, odd", 5, 255, 2, opencv="preFilterSize"),
    Option("prefilter_cap", 31, "Filtered values are cut at plus and minus this", 1, 63, opencv="preFilterCap"),
    Option(
        "texture_threshold",
        10,
        "A window with less gradient than this is not matched",
        0,
        1000000,
        opencv="textureThreshold",
    ),
    *make_filter_options(speckle_range=4),
    Option(
        "rounding",
        "even",
        "OpenCV rounds up to a sixteenth, which adds 0.03 px on average: subtract this, or keep it",
        choices=("even", "up"),
    ),
    Option(
        "grey",
        "mean",
        "Grey of colour images: the mean of the bands, as a grey camera sees, or luminance, "
        "which weights them for the eye",
        choices=("mean", "luminance"),
    ),
)

PRESETS: dict[str, dict[str, Any]] = {
    "guiss": {
        "disparities": 96,
        "min_disparity": 4,
        "window": 49,
        "prefilter": "xsobel",
        "prefilter_size": 17,
        "prefilter_cap": 20,
        "texture_threshold": 18,
        "uniqueness": 0,
        "speckle_window": 0,
        "speckle_range": 9,
        "left_right": 25,
        "left_border": "skip",
        "rounding": "up",
        "grey": "luminance",
    },
}

_PREFILTER_CODES = {"normalized": cv2.STEREO_BM_PREFILTER_NORMALIZED_RESPONSE, "xsobel": cv2.STEREO_BM_PREFILTER_XSOBEL}

# OpenCV computes x in 1/256 px and rounds by (x + 15) >> 4, which adds 7.5 of them on average.
_ROUNDING_BIAS_PX = 7.5 / 256


def settle(
    options: dict[str, Any], ranges: Mapping[str, SearchRange], shape: tuple[int, ...]
) -> tuple[dict[str, Any], SearchRange]:
    """Return the options with a search range in numbers, and this range."""
    return resolve_range("bm", options, ranges)


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 (H, W) images, float32 px, NaN where invalid."""
    least = options["min_disparity"]
    matcher = cv2.StereoBM.create(options["disparities"], options["window"])
    matcher.setMinDisparity(least)
    matcher.setPreFilterType(_PREFILTER_CODES[options["prefilter"]])
    matcher.setPreFilterSize(options["prefilter_size"])
    matcher.setPreFilterCap(options["prefilter_cap"])
    matcher.setTextureThreshold(options["texture_threshold"])
    matcher.setUniquenessRatio(options["uniqueness"])
    matcher.setSpeckleWindowSize(options["speckle_window"])
    matcher.setSpeckleRange(options["speckle_range"])
    matcher.setDisp12MaxDiff(options["left_right"])
    height, width = left.shape
    reach, margin = least + options["disparities"] - 1, options["window"] // 2
    extension = reach if options["left_border"] == "match" else 0
    # The area of cv2.getValidDisparityROI for two whole images.
    columns, rows = (reach + (0 if extension else margin), width + extension - margin), (margin, height - margin)
    room = columns[1] - (extension + margin if extension else columns[0])  # for whole windows
    require_room("bm", left, room > 0 and rows[0] < rows[1])
    disparity = run_matcher(
        "bm", matcher, extend_left(left, extension), extend_left(right, extension), least, columns, rows
    )
    if options["rounding"] == "even":
        disparity -= np.float32(_ROUNDING_BIAS_PX)
    disparity = disparity[:, extension:]
    return Result(drop_matches_outside_right(disparity) if extension else disparity)

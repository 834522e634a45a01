"""Block matching, OpenCV's StereoBM; by default exactly as the GUISS paper ran it.

The parameters are those of nasa-jpl/guiss, ``stereoBM_eval.py``: window 49, 96 disparities from 4.
With the paper's camera that measures from 0.86 m to 21.3 m.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from ...render.pair import StereoCamera
from .opencv import require_room, run
from .options import Option
from .result import Result

OPTIONS = (
    Option("disparities", 96, "Number of disparities searched, px", 16, 1024, 16, opencv="numDisparities"),
    Option("min_disparity", 4, "Least disparity searched, px", 0, 1024, opencv="minDisparity"),
    Option("window", 49, "Side of the square that is compared, px, odd", 5, 255, 2, opencv="blockSize"),
    Option("prefilter", "xsobel", "What is compared: horizontal gradient or contrast-normalised grey",
           choices=("xsobel", "normalized"), opencv="preFilterType"),
    Option("prefilter_size", 17, "Window of the normalising filter, px, odd", 5, 255, 2, opencv="preFilterSize"),
    Option("prefilter_cap", 20, "Filtered values are cut at plus and minus this", 1, 63, opencv="preFilterCap"),
    Option("texture_threshold", 18, "A window with less gradient than this is not matched", 0, 1000000,
           opencv="textureThreshold"),
    Option("uniqueness", 0, "Per cent by which the best match must beat the second", 0, 100,
           opencv="uniquenessRatio"),
    Option("speckle_window", 0, "Connected patches up to this many px are removed; 0 for off", 0, 100000,
           opencv="speckleWindowSize"),
    Option("speckle_range", 9, "Disparity step, px, that separates patches", 0, 1024, opencv="speckleRange"),
    Option("left_right", 25, "Disparity difference, px, allowed when matching backwards; -1 for off", -1, 1024,
           opencv="disp12MaxDiff"),
)

PRESETS: dict[str, dict[str, Any]] = {
    "guiss": {"disparities": 96, "min_disparity": 4, "window": 49, "prefilter": "xsobel", "prefilter_size": 17,
              "prefilter_cap": 20, "texture_threshold": 18, "uniqueness": 0, "speckle_window": 0,
              "speckle_range": 9, "left_right": 25},
}

_PREFILTERS = {"normalized": cv2.STEREO_BM_PREFILTER_NORMALIZED_RESPONSE, "xsobel": cv2.STEREO_BM_PREFILTER_XSOBEL}


def compute(left: np.ndarray, right: np.ndarray, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Disparity of uint8 (H, W) images, float32 px, NaN where invalid."""
    matcher = cv2.StereoBM.create(options["disparities"], options["window"])
    matcher.setMinDisparity(options["min_disparity"])
    matcher.setPreFilterType(_PREFILTERS[options["prefilter"]])
    matcher.setPreFilterSize(options["prefilter_size"])
    matcher.setPreFilterCap(options["prefilter_cap"])
    matcher.setTextureThreshold(options["texture_threshold"])
    matcher.setUniquenessRatio(options["uniqueness"])
    matcher.setSpeckleWindowSize(options["speckle_window"])
    matcher.setSpeckleRange(options["speckle_range"])
    matcher.setDisp12MaxDiff(options["left_right"])
    height, width = left.shape
    margin = options["window"] // 2
    # The area of cv2.getValidDisparityROI for two whole images.
    columns = (options["min_disparity"] + options["disparities"] - 1 + margin, width - margin)
    rows = (margin, height - margin)
    require_room("bm", left, columns[0] < columns[1] and rows[0] < rows[1])
    return Result(run("bm", matcher, left, right, options["min_disparity"], columns, rows))

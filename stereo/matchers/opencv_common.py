"""Common parts of OpenCV's matchers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..images.image_values import describe_size
from . import get_matcher_title
from .options import Option
from .search_range import AUTO, STATED, STEP_PX, TRUTH, SearchRange, require_range

#: Options of the search range, which all of OpenCV's matchers have.
SEARCH_RANGE = (
    Option(
        "disparities",
        AUTO,
        "Number of disparities searched, px. auto: those that the rig can see; truth: those "
        "that the pair contains, which no camera knows",
        STEP_PX,
        1024,
        STEP_PX,
        words=(AUTO, TRUTH),
        opencv="numDisparities",
    ),
    Option(
        "min_disparity",
        AUTO,
        "Least disparity searched, px. auto: that of the range, or 0 if disparities is a number",
        0,
        1024,
        words=(AUTO,),
        opencv="minDisparity",
    ),
)


def make_filter_options(speckle_range: int) -> tuple[Option, ...]:
    """Make the options that reject matches, for block matching and semi-global matching, with a default of
    ``speckle_range``.
    """
    return (
        Option(
            "uniqueness", 10, "Per cent by which the best match must beat the second", 0, 100, opencv="uniquenessRatio"
        ),
        Option(
            "speckle_window",
            100,
            "Connected patches up to this many px are removed; 0 for off",
            0,
            100000,
            opencv="speckleWindowSize",
        ),
        Option(
            "speckle_range", speckle_range, "Disparity step, px, that separates patches", 0, 1024, opencv="speckleRange"
        ),
        Option(
            "left_right",
            1,
            "Disparity difference, px, allowed when matching backwards; -1 for off",
            -1,
            1024,
            opencv="disp12MaxDiff",
        ),
        Option(
            "left_border",
            "match",
            "Columns left of the search range: match them over the disparities that stay in the "
            "image, or skip them as OpenCV does",
            choices=("match", "skip"),
        ),
    )


STEPS_PER_PX = 16  # OpenCV's disparities are fixed-point numbers with four fractional bits


def resolve_range(
    method: str, options: dict[str, Any], ranges: Mapping[str, SearchRange]
) -> tuple[dict[str, Any], SearchRange]:
    """Return the options with numbers for those in SEARCH_RANGE, and the range that these numbers state.

    Raises IcyMoonError if the true disparities are asked for but unknown.
    """
    count, least = options["disparities"], options["min_disparity"]
    source = STATED
    if isinstance(count, str):
        chosen = require_range(method, count, "disparities", ranges)
        least, source = chosen.least_px if isinstance(least, str) else least, chosen.source
        count = STEP_PX * max(1, math.ceil((chosen.most_px + 1 - least) / STEP_PX))
    least = 0 if isinstance(least, str) else least
    return options | {"disparities": count, "min_disparity": least}, SearchRange(least, least + count - 1, source)


def require_room(method: str, image: Array, enough: bool, option: str = "") -> None:
    """Raise IcyMoonError unless an image (H, W) is large ``enough`` for a search range and window.

    ``option`` names the options that the user can lower; by default disparities and window.
    """
    if not enough:
        option = option or f"disparities or {method}.window"
        raise IcyMoonError(
            f"The images, {describe_size(image)}, are too small for {get_matcher_title(method)}: its search range "
            f"and window do not fit; lower {method}.{option}, or render larger images."
        )


def run_matcher(
    method: str,
    matcher: Any,
    left: Array,
    right: Array,
    min_disparity: int,
    columns: tuple[int, int],
    rows: tuple[int, int],
) -> Array:
    """Run an OpenCV matcher; return the disparity, float32 (H, W) px, NaN where no reliable match was found.

    ``columns`` and ``rows`` are the half-open ranges of pixels whose search range and window lie inside the images.

    OpenCV marks a failed match by one less than the lowest disparity, which may look like a far surface. To the left of
    ``columns`` its values are random and depend on the number of threads, so it runs with one thread.
    """
    cv2.setNumThreads(1)
    try:
        fixed = matcher.compute(left, right)
    except (cv2.error, MemoryError) as error:
        raise IcyMoonError(
            f"OpenCV's {get_matcher_title(method)} failed ({getattr(error, 'err', error)}); try other options."
        ) from None
    disparity = np.full(left.shape, np.nan, np.float32)
    inside = (slice(*rows), slice(*columns))
    measured = fixed[inside] >= min_disparity * STEPS_PER_PX
    disparity[inside] = np.where(measured, fixed[inside] / np.float32(STEPS_PER_PX), np.nan)
    return disparity


def extend_left(image: Array, columns: int) -> Array:
    """Extend an image to the left by repeating its border.

    OpenCV skips every column that cannot be searched over the whole range, a seventh of the GUISS paper's images. An
    extended image has no such column. A match in the extension does not count, see ``drop_matches_outside_right``.
    """
    return cv2.copyMakeBorder(image, 0, 0, columns, 0, cv2.BORDER_REPLICATE)


def drop_matches_outside_right(disparity: Array) -> Array:
    """Replace matches beyond the left border of the right image by NaN in a disparity map (H, W), px."""
    return np.where(disparity <= np.arange(disparity.shape[1]), disparity, np.nan)

"""What the matchers that are OpenCV's have in common."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from ...errors import IcyMoonError

SUBPIXELS = 16  # OpenCV's disparities are fixed-point numbers with four fractional bits


def require_room(method: str, image: np.ndarray, enough: bool, option: str = "") -> None:
    """Raise IcyMoonError unless there is ``enough`` of an image (H, W) for a search range and window.

    ``option`` names those to lower; by default disparities and window.
    """
    if not enough:
        option = option or f"disparities or {method}.window"
        raise IcyMoonError(f"The images, {image.shape[1]} x {image.shape[0]} px, are too small for {method}: its "
                           f"search range and window do not fit; lower {method}.{option}, or "
                           "render larger images.")


def run_matcher(method: str, matcher: Any, left: np.ndarray, right: np.ndarray, min_disparity: int,
        columns: tuple[int, int], rows: tuple[int, int]) -> np.ndarray:
    """Disparity, float32 (H, W) px, NaN where ``matcher`` found none or may not be believed.

    ``columns`` and ``rows`` are the half-open ranges of pixels whose search range and window lie
    inside the images. OpenCV marks a failed match with one less than the least disparity, which with
    a positive least disparity looks like a far surface. It also leaves garbage to the left of
    ``columns``, and other garbage for another number of threads (one stripe each), hence one thread.
    """
    cv2.setNumThreads(1)
    try:
        fixed = matcher.compute(left, right)
    except (cv2.error, MemoryError) as error:
        raise IcyMoonError(f"OpenCV's {method} failed ({getattr(error, 'err', error)}); try other options.") from None
    disparity = np.full(left.shape, np.nan, np.float32)
    inside = (slice(*rows), slice(*columns))
    measured = fixed[inside] >= min_disparity * SUBPIXELS
    disparity[inside] = np.where(measured, fixed[inside] / np.float32(SUBPIXELS), np.nan)
    return disparity


def extended(image: np.ndarray, columns: int) -> np.ndarray:
    """The image with its left border repeated.

    OpenCV leaves out every column that cannot be searched to the end of the range, a seventh of the
    paper's images. Extended images have none; a match found in the extension is none (inside_right).
    """
    return cv2.copyMakeBorder(image, 0, 0, columns, 0, cv2.BORDER_REPLICATE)


def inside_right(disparity: np.ndarray) -> np.ndarray:
    """NaN where the match would be left of the right image."""
    return np.where(disparity <= np.arange(disparity.shape[1]), disparity, np.nan)

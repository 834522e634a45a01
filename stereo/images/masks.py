"""Masks of rocks and shadows: from polygons and convex hulls, dilated, eroded, and compared."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ...support.arrays import Array

#: Fractional bits of the corners that OpenCV fills.
_FRACTION_BITS = 4


def _to_fixed_point(corners: Array) -> Array:
    # A pixel's centre is at a half here and at a whole number in OpenCV.
    return np.round((np.asarray(corners) - 0.5) * 2**_FRACTION_BITS).astype(np.int32)


def fill_polygons(shape: tuple[int, int], outlines: Sequence[Array], finer: int = 1) -> Array:
    """Make the mask (H, W) of the union of polygons (n, 2) in pixels.

    OpenCV fills every pixel that an edge touches. With ``finer``, an odd number, it fills a grid that is finer by this
    factor, and the mask takes its values at the centres of our pixels: they are inside, to 1 / ``finer`` of a pixel.
    """
    mask = np.zeros((shape[0] * finer, shape[1] * finer), np.uint8)
    for each in outlines:
        cv2.fillPoly(mask, [_to_fixed_point(np.asarray(each) * finer)], (1,), shift=_FRACTION_BITS)
    return mask[finer // 2 :: finer, finer // 2 :: finer].astype(bool)


def fill_hulls(shape: tuple[int, int], parts: Sequence[Array]) -> Array:
    """Make the mask (H, W) of the union of the convex hulls of points (n, 2) in pixels."""
    mask = np.zeros(shape, np.uint8)
    for each in parts:
        cv2.fillConvexPoly(mask, cv2.convexHull(_to_fixed_point(each)), (1,), shift=_FRACTION_BITS)
    return mask.astype(bool)


def dilate(mask: Array, reach: int) -> Array:
    """Extend a mask (H, W) by all pixels within ``reach`` pixels of it."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc)).astype(bool)


def erode(mask: Array, reach: int) -> Array:
    """Remove from a mask (H, W) the pixels that have an unset pixel within ``reach`` rows and columns."""
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), square)).astype(bool)


def sample_at_pixels(image: Array, pixels: Array) -> Array:
    """Sample an image (H, W) at ``pixels`` (h, w, 2), x and y, linearly between pixels; return float32 (h, w), 0
    outside.
    """
    at = (pixels - 0.5).astype(np.float32)
    return np.asarray(cv2.remap(image.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR))


def compute_intersection_over_union(one: Array, other: Array) -> float:
    """Compute the intersection over union of two masks; NaN if both are empty."""
    union = np.count_nonzero(one | other)
    return np.count_nonzero(one & other) / union if union else float("nan")


def measure_distance_inside_hull_px(point: Array, around: Array) -> float:
    """Measure the distance in pixels from a point (2,) inside the convex hull of points (n, 2) to its border; negative
    outside.
    """
    hull = cv2.convexHull(np.asarray(around, np.float32))
    return float(cv2.pointPolygonTest(hull, (float(point[0]), float(point[1])), True))

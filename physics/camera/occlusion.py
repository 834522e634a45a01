"""Points that one eye of a parallel rig sees and that are hidden from the other eye.

Columns and rows are pixel indices, because the half pixel to the coordinates of pixel centres cancels between the eyes.
Disparity is the left column minus the right column.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Disparity in px by which an occluder must be nearer. It allows for curved ground, on which disparity is not linear
#: between two rays of the other eye. ``python benchmarks occlusion`` measures the effect of this and other values.
_MIN_GAP_PX = 0.25
#: Further disparity by which an occluder must be nearer, as a share of the difference between the two rays. If one ray
#: meets the occluder and one passes it, the assumed edge is a quarter of the way from the ray that passes.
_MIN_GAP_SHARE = 0.25


def find_matching_column(disparity: Array, eye: str = "left") -> Array:
    """Find the column (H, W), float64, in the other eye's image, of the point that each pixel of ``eye`` sees."""
    return np.arange(disparity.shape[1]) - disparity * (1 if eye == "left" else -1)


def sample_at_columns(image: Array, column: Array) -> Array:
    """Interpolate ``image`` (H, W) linearly at fractional columns (H, any); it is constant beyond the edges."""
    before, after, weight = _neighbouring_columns(image, column)
    return np.asarray((1 - weight) * before + weight * after)


def _neighbouring_columns(image: Array, column: Array) -> tuple[Array, Array, Array]:
    """Return the pixels of ``image`` on both sides of fractional columns, and the fractions, 0 to 1, from the first."""
    column = np.clip(np.nan_to_num(column, nan=0.0), 0.0, image.shape[1] - 1.0)
    first = np.floor(column).astype(np.intp)
    second = np.minimum(first + 1, image.shape[1] - 1)
    return np.take_along_axis(image, first, axis=1), np.take_along_axis(image, second, axis=1), column - first


def is_in_frame(column: Array) -> Array:
    """Return whether each ``column`` (H, W) lies in an image of W columns; False for NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray((column >= -0.5) & (column <= column.shape[1] - 0.5))


def find_hidden(disparity: Array, other: Array, eye: str) -> Array:
    """Find the pixels (H, W), bool, of ``eye`` whose point is inside the other eye's image but hidden there.

    ``disparity`` (H, W), px, belongs to the pixel centres of ``eye``. ``other`` (H, n W), px, is the disparity on n
    rays per pixel of the other eye: through the pixel's centre, and at equal steps toward the next pixel. Both are NaN
    for sky, which hides nothing. On a plane disparity is an affine function of the column, so even a steep plane does
    not hide itself.
    """
    column = find_matching_column(disparity, eye)
    before, after, weight = _neighbouring_columns(
        np.nan_to_num(other, nan=0.0), column * (other.shape[1] // disparity.shape[1])
    )
    nearer = np.maximum(_MIN_GAP_PX, _MIN_GAP_SHARE * np.abs(after - before))
    with np.errstate(invalid="ignore"):
        return is_in_frame(column) & ((1 - weight) * before + weight * after > disparity + nearer)

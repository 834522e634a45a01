"""Which points that one eye of a parallel rig sees are hidden from the other eye.

Columns and rows are pixel indices. The coordinates of pixel centres differ from them by half a pixel, which cancels
between the eyes. Disparity is the left column minus the right one.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Disparity, px, by which an occluder must be nearer. Between two rays of the other eye disparity is taken as linear,
#: and on curved ground it is not. ``python benchmarks occlusion`` has what this and other numbers find.
_NEARER_PX = 0.25
#: The same, as a share of the difference between the two rays. Where one ray meets the occluder and one passes it, the
#: edge is somewhere between them; a quarter of the way from the ray that passes is taken as outside.
_NEARER_SHARE = 0.25


def find_matching_column(disparity: Array, eye: str = "left") -> Array:
    """Column, in the other eye's image, of the point that each pixel of ``eye`` sees, float64 (H, W)."""
    return np.arange(disparity.shape[1]) - disparity * (1 if eye == "left" else -1)


def sample_at_columns(image: Array, column: Array) -> Array:
    """``image`` (H, W) interpolated linearly at fractional columns (H, any); constant beyond the edges."""
    before, after, weight = _neighbouring_columns(image, column)
    return np.asarray((1 - weight) * before + weight * after)


def _neighbouring_columns(image: Array, column: Array) -> tuple[Array, Array, Array]:
    """The pixels of ``image`` before and after fractional columns, and how far these are from the first, 0 to 1."""
    column = np.clip(np.nan_to_num(column, nan=0.0), 0.0, image.shape[1] - 1.0)
    first = np.floor(column).astype(np.intp)
    second = np.minimum(first + 1, image.shape[1] - 1)
    return np.take_along_axis(image, first, axis=1), np.take_along_axis(image, second, axis=1), column - first


def is_in_frame(column: Array) -> Array:
    """Boolean (H, W): this column, of an image of W columns, is in it; False for NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray((column >= -0.5) & (column <= column.shape[1] - 0.5))


def find_hidden(disparity: Array, other: Array, eye: str) -> Array:
    """Boolean (H, W): the point that a pixel of ``eye`` sees is in the other eye's frame, and hidden there.

    ``disparity`` (H, W), px, is of the eye's pixel centres. ``other`` (H, n W), px too, is of the points
    that the other eye sees in n rays for each of its pixels: through its centre, and at equal steps toward the next
    one. Both are NaN for sky, which hides nothing.

    On a plane, disparity is an affine function of the column, so it does not hide itself, however steep it is.
    """
    column = find_matching_column(disparity, eye)
    before, after, weight = _neighbouring_columns(
        np.nan_to_num(other, nan=0.0), column * (other.shape[1] // disparity.shape[1])
    )
    nearer = np.maximum(_NEARER_PX, _NEARER_SHARE * np.abs(after - before))
    with np.errstate(invalid="ignore"):
        return is_in_frame(column) & ((1 - weight) * before + weight * after > disparity + nearer)

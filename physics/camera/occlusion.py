"""Which points that one eye of a parallel rig sees are hidden from the other eye.

Columns and rows are pixel indices. The coordinates of pixel centres differ from them by half a pixel, which cancels
between the eyes. Disparity is the left column minus the right one.
"""

from __future__ import annotations

import numpy as np

#: Disparity, px, by which an occluder must be nearer. Between two rays of the other eye disparity is taken as linear,
#: and on curved ground and at edges it is not. ``benchmarks/occlusion.py`` has what this and other numbers find.
_NEARER_PX = 0.25


def matching_column(disparity: np.ndarray, eye: str = "left") -> np.ndarray:
    """Column, in the other eye's image, of the point that each pixel of ``eye`` sees, float64 (H, W)."""
    return np.arange(disparity.shape[1]) - disparity * (1 if eye == "left" else -1)


def warped(image: np.ndarray, column: np.ndarray) -> np.ndarray:
    """``image`` (H, W) interpolated linearly at fractional columns (H, any); constant beyond the edges."""
    column = np.clip(np.nan_to_num(column, nan=0.0), 0.0, image.shape[1] - 1.0)
    before = np.floor(column).astype(np.intp)
    weight = column - before
    after = np.minimum(before + 1, image.shape[1] - 1)
    return np.asarray((1 - weight) * np.take_along_axis(image, before, axis=1)
                      + weight * np.take_along_axis(image, after, axis=1))


def is_in_frame(column: np.ndarray) -> np.ndarray:
    """Boolean (H, W): this column, of an image of W columns, is in it; False for NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray((column >= -0.5) & (column <= column.shape[1] - 0.5))


def find_hidden(disparity: np.ndarray, other: np.ndarray, eye: str) -> np.ndarray:
    """Boolean (H, W): the point that a pixel of ``eye`` sees is in the other eye's frame, and hidden there.

    ``disparity`` (H, W), px, is of the eye's pixel centres. ``other`` (H, n W), px too, is of what the other eye sees
    in n rays for each of its pixels: through its centre, and at equal steps toward the next one. Both are NaN for sky,
    which hides nothing.

    On a plane, disparity is an affine function of the column, so it does not hide itself, however steep it is.
    """
    column = matching_column(disparity, eye)
    nearest = warped(np.nan_to_num(other, nan=0.0), column * (other.shape[1] // disparity.shape[1]))
    with np.errstate(invalid="ignore"):
        return is_in_frame(column) & (nearest > disparity + _NEARER_PX)

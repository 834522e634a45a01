"""A search near an expected disparity, for any matcher that has a search range.

The right image is moved by the expected disparity of each pixel, and the matcher finds the remaining disparity. This
changes the image, because OpenCV's costs cannot be changed from outside.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array


def move_right(right: Array, expected: Array, margin_px: int) -> Array:
    """Move the right image (H, W) or (H, W, 3) to uint8 by the ``expected`` disparity of each left pixel.

    The match of a left pixel with exactly this disparity is then ``margin_px`` columns to its left.
    """
    rows, columns = np.indices(expected.shape)
    beside = np.clip(columns + margin_px, 0, expected.shape[1] - 1)
    place = np.clip(columns + margin_px - expected[rows, beside], 0, expected.shape[1] - 1)
    whole = np.minimum(place.astype(int), expected.shape[1] - 2)
    share = place - whole
    if right.ndim == 3:
        share = share[..., None]
    mixed = (1 - share) * right[rows, whole] + share * right[rows, whole + 1]
    return np.rint(mixed).astype(np.uint8)


def restore_disparity(found: Array, expected: Array, margin_px: int) -> Array:
    """Convert the disparity ``found`` in the moved right image to the left image's disparity (H, W), both in px.

    NaN where the matcher has none. A left pixel u that matches the column x of the moved image sees the right column x
    + margin - expected(x + margin).
    """
    rows, columns = np.indices(expected.shape)
    place = np.clip(columns - np.nan_to_num(found) + margin_px, 0, expected.shape[1] - 1)
    whole = np.minimum(place.astype(int), expected.shape[1] - 2)
    share = place - whole
    moved = (1 - share) * expected[rows, whole] + share * expected[rows, whole + 1]
    return np.asarray(found - margin_px + moved)

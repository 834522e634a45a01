"""Patterns that are painted into both images at range points, so that any matcher finds these places.

Bartolomei et al., *Active Stereo Without Pattern Projector* (arXiv 2309.12315): each point gets a patch of random grey
in the left image and the same patch, moved by the point's disparity, in the right image.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from .range_points import RangePoints

#: Share of the pattern in a painted pixel; the rest is the image.
PAINT_SHARE = 0.4


def find_hidden(points: RangePoints, half_px: int) -> Array:
    """Find the points, bool (n,), whose patches nearer points cover in the right image.

    The right eye may not see such a point. A nearer point covers it if their patches overlap in the right image, and
    not in the left one. Neighbours on one surface keep their order, and their patches overlap in both.
    """
    order = np.argsort(points.row, kind="stable")
    row = points.row[order]
    column, disparity = points.column[order], points.disparity[order]
    ends = np.searchsorted(row, row + half_px, side="right")
    hidden = np.zeros(len(row), bool)
    for k, end in enumerate(ends.tolist()):
        near = np.arange(k + 1, end)
        beside = column[near] - column[k]
        closer = disparity[near] - disparity[k]
        meets = (np.abs(beside - closer) <= 2 * half_px) & (np.abs(beside) > 2 * half_px)
        hidden[k] |= bool((meets & (closer > 0)).any())
        hidden[near[meets & (closer < 0)]] = True
    found = np.zeros(len(row), bool)
    found[order] = hidden
    return found


def paint_points(
    left: Array, right: Array, points: RangePoints, side_px: int, random: np.random.Generator
) -> tuple[Array, Array]:
    """Paint patches of ``side_px`` px into copies of both images, uint8 (H, W) or (H, W, 3).

    A pixel of the right image lies between two columns of the pattern, and is a mixture of both. Near points are
    painted over far ones. Points that the right eye does not see are left out.
    """
    half = side_px // 2
    painted = left.astype(np.float64), right.astype(np.float64)
    pattern = random.integers(0, 256, (len(points.column), side_px, side_px)).astype(np.float64)
    shown = ~find_hidden(points, half)
    for k in np.argsort(points.disparity, kind="stable").tolist():
        if not shown[k]:
            continue
        column, row = round(float(points.column[k])), round(float(points.row[k]))
        _blend(painted[0], pattern[k], column - half, row - half)
        start = column - half - float(points.disparity[k])
        whole = int(np.ceil(start))
        part = whole - start
        between = (1 - part) * pattern[k, :, :-1] + part * pattern[k, :, 1:] if part else pattern[k]
        _blend(painted[1], between, whole, row - half)
    one, other = (np.rint(each).clip(0, 255).astype(np.uint8) for each in painted)
    return one, other


def _blend(image: Array, patch: Array, column: int, row: int) -> None:
    """Mix a patch into an image in place; parts beyond its borders are left out."""
    top, left = max(row, 0), max(column, 0)
    bottom, right = min(row + patch.shape[0], image.shape[0]), min(column + patch.shape[1], image.shape[1])
    if top >= bottom or left >= right:
        return
    part = patch[top - row : bottom - row, left - column : right - column]
    part = part if image.ndim == 2 else part[..., None]
    image[top:bottom, left:right] = (1 - PAINT_SHARE) * image[top:bottom, left:right] + PAINT_SHARE * part

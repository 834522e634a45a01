"""Census matching: which neighbours are brighter, compared by the number of differences (Zabih and Woodfill 1994)."""

from __future__ import annotations

from typing import Any

import numpy as np

ICYMOON_API = 1

OPTIONS = {
    "window": {"default": 9, "minimum": 3, "maximum": 31, "step": 2, "doc": "Side of the square of a mean, px, odd"},
    "left_right": {"default": 1, "minimum": 0, "maximum": 64, "doc": "Difference, px, allowed when matching backwards"},
}

#: The neighbours that a pixel is compared with: every second one of a square of 7 x 7.
_NEIGHBOURS = [(dy, dx) for dy in (-3, -1, 1, 3) for dx in (-3, -1, 1, 3)]


def match(left: np.ndarray, right: np.ndarray, context: Any) -> np.ndarray:
    """Disparity of the left image, float32 (H, W) px, NaN where it is not measured.

    ``left`` and ``right`` are uint8 (H, W). Winner takes all over the whole disparities
    ``context.least_px`` to ``context.most_px``, then a parabola.
    """
    disparities = np.arange(context.least_px, context.most_px + 1)
    costs = _costs(_census(left), _census(right), disparities, context.options["window"])
    best = costs.argmin(axis=0)
    found = disparities[best] + _parabola(costs, best)

    # A match counts where the right image finds the same one, and where the whole disparity was within the image.
    columns = np.arange(left.shape[1])[None, :]
    there = columns - disparities[best]
    backwards = disparities[_costs_of_the_right(costs, disparities).argmin(axis=0)]
    same = np.take_along_axis(backwards, np.clip(there, 0, None), axis=1)
    certain = (there >= 0) & (np.abs(same - disparities[best]) <= context.options["left_right"])
    certain &= np.isfinite(np.take_along_axis(costs, best[None], axis=0)[0])
    return np.where(certain, found, np.nan).astype(np.float32)


def _census(image: np.ndarray) -> np.ndarray:
    """A bit for each neighbour, set if it is brighter: uint16 (H, W)."""
    height, width = image.shape
    wide = np.pad(image, 3, mode="edge")
    bits = np.zeros(image.shape, np.uint16)
    for k, (dy, dx) in enumerate(_NEIGHBOURS):
        brighter = wide[3 + dy : 3 + dy + height, 3 + dx : 3 + dx + width] > image
        bits |= brighter.astype(np.uint16) << np.uint16(k)
    return bits


def _costs(left: np.ndarray, right: np.ndarray, disparities: np.ndarray, window: int) -> np.ndarray:
    """Mean number of different bits in a window, float32 (disparities, H, W); infinite outside the right image."""
    ones = np.array([bin(k).count("1") for k in range(256)], np.float32)
    costs = np.full((len(disparities), *left.shape), np.inf, np.float32)
    for k, disparity in enumerate(disparities):
        if disparity < left.shape[1]:
            different = left[:, disparity:] ^ right[:, : left.shape[1] - disparity]
            costs[k, :, disparity:] = _mean(ones[different & 255] + ones[different >> 8], window)
    return costs


def _mean(values: np.ndarray, window: int) -> np.ndarray:
    """Mean over a square around each pixel, the border repeated."""
    for axis in (0, 1):
        edge = [(0, 0), (0, 0)]
        edge[axis] = (window // 2 + 1, window // 2)
        sums = np.cumsum(np.pad(values, edge, mode="edge"), axis=axis, dtype=np.float64)
        length = values.shape[axis]
        values = (np.take(sums, range(window, window + length), axis) - np.take(sums, range(length), axis)) / window
    return values.astype(np.float32)


def _costs_of_the_right(costs: np.ndarray, disparities: np.ndarray) -> np.ndarray:
    """The same costs, at the pixel of the right image for each disparity."""
    turned = np.full_like(costs, np.inf)
    width = costs.shape[2]
    for k, disparity in enumerate(disparities):
        if disparity < width:
            turned[k, :, : width - disparity] = costs[k, :, disparity:]
    return turned


def _parabola(costs: np.ndarray, best: np.ndarray) -> np.ndarray:
    """The offset of the vertex of a parabola through the best cost and its neighbours, -0.5 to 0.5 px."""
    last = len(costs) - 1
    before, least, after = (np.take_along_axis(costs, np.clip(best + k, 0, last)[None], axis=0)[0] for k in (-1, 0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        offset = 0.5 * (before - after) / (before - 2 * least + after)
    inside = (best > 0) & (best < last) & np.isfinite(offset)
    return np.where(inside, np.clip(offset, -0.5, 0.5), 0.0)

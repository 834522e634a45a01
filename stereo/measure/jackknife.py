"""The standard error of a number from one image: the jackknife over tiles of the image.

Errors of neighbouring pixels are correlated over the window of a matcher or a denoiser, so pixels are not independent.
Tiles are larger than such windows and nearly independent. Leaving out one tile after the other shows how strongly a
number depends on the noise (Efron and Tibshirani 1993, chapter 11; for tiles Künsch 1989). The same tiles of two images
are left out together, so errors that both share cancel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ...support.arrays import Array

#: Number of tiles from top to bottom and from left to right.
TILES_DOWN, TILES_ACROSS = 6, 8


def sum_over_tiles(*images: Array) -> Array:
    """Sum K images (H, W) of numbers or booleans over tiles; return float64 (DOWN * ACROSS, K). No pixel may be NaN.
    Images in single precision are added up in single precision.
    """
    return np.stack([_sum_tiles(image) for image in images], axis=1).astype(np.float64)


def _sum_tiles(image: Array) -> Array:
    if image.dtype != np.float32:
        image = np.asarray(image, np.float64)
    down, across = (
        _make_part_membership(size, count, image.dtype.char)
        for size, count in zip(image.shape, (TILES_DOWN, TILES_ACROSS), strict=True)
    )
    return np.asarray((down @ image @ across.T).ravel())


@lru_cache(maxsize=8)
def _make_part_membership(size: int, count: int, kind: str) -> Array:
    """Make the membership (count, size), 1 or 0, of each of ``size`` rows or columns in ``count`` equal parts."""
    return (np.arange(size) * count // size == np.arange(count)[:, None]).astype(kind)


def jackknife(value: Callable[..., Array], *sums: Array) -> tuple[Array, Array]:
    """Compute numbers of whole images, and their standard errors.

    ``sums`` are arrays (..., tiles, K) from ``sum_over_tiles``. ``value`` computes the numbers from their totals (...,
    K); it must accept one more axis before the last, over the tiles that are left out. An undefined number is NaN. The
    error is NaN if fewer than two tiles contain anything.
    """
    held = np.any([each.any(axis=tuple(k for k in range(each.ndim) if k != each.ndim - 2)) for each in sums], axis=0)
    count = int(held.sum())
    totals = [each.sum(axis=-2, keepdims=True) for each in sums]
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = value(*totals)[..., 0, :]
        if count < 2:
            return whole, np.full(whole.shape, np.nan)
        without = value(*(total - each[..., held, :] for total, each in zip(totals, sums, strict=True)))
        spread = (without - without.mean(axis=-2, keepdims=True)) ** 2
    return whole, np.sqrt((count - 1) / count * spread.sum(axis=-2))

"""How far a number of one image can be trusted: the jackknife over tiles of the image.

Pixels beside each other err together, over a matcher's window or a denoiser's, so their number says little. Tiles are
larger than that and nearly independent: leaving out one after the other tells how much the number hangs on the noise
that there happens to be (Efron and Tibshirani 1993, chapter 11; in blocks Künsch 1989). Sums over the same tiles of
two images are left out together, so what both have in common cancels.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Tiles along the columns and rows of an image.
DOWN, ACROSS = 6, 8


def tile_sums(*images: np.ndarray) -> np.ndarray:
    """Sums (DOWN * ACROSS, K) over the tiles of K images, all (H, W), of numbers or booleans; none may be NaN."""
    height, width = images[0].shape
    tile = (np.arange(height) * DOWN // height)[:, None] * ACROSS + np.arange(width) * ACROSS // width
    return np.stack([np.bincount(tile.ravel(), np.asarray(image, np.float64).ravel(), DOWN * ACROSS)
                     for image in images], axis=1)


def jackknife(value: Callable[..., np.ndarray], *sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A number of whole images, and its standard error.

    ``sums`` are arrays (..., tiles, K) of ``tile_sums``; ``value`` gives numbers of their totals (..., K), where it may
    have one more axis before the last, over the tiles left out. NaN where a number is not defined; the error is NaN
    with fewer than two tiles that hold anything.
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

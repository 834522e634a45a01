"""Statistics of images that can be compared without a photograph: slope of the power spectrum, black and white parts.

The power of natural images falls as about f^-2 in the mean over many images (Field 1987, Journal of the Optical Society
of America A 4, 2379), and as f^-1 to f^-3 in single ones. For ice, snow and the ground of moons no such number is
published.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: The rings of the spectrum: least cycles per image, most cycles per pixel, and number of rings.
_FEWEST_CYCLES, _MAX_CYCLES, _RING_COUNT = 4.0, 0.35, 13
#: Least side of a square whose spectrum is meaningful, px: its rings span a factor of 2.8 or more.
MIN_SIDE_PX = 32
#: Light below this fraction of the full scale looks black.
DARK_LEVEL = 0.02


def find_largest_square(mask: Array) -> tuple[slice, slice]:
    """Find the rows and columns of the largest square in which a mask (H, W) is true everywhere; empty slices for an
    empty mask.
    """
    sums = np.pad(mask.astype(np.int64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))

    def find_full_squares(side: int) -> Array:
        """Find the upper left corners of squares of this side in which the mask is true everywhere."""
        inside = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
        return np.asarray(inside == side**2)

    side, too_large = 0, min(mask.shape) + 1
    while too_large - side > 1:  # a square within a full square is full too
        middle = (side + too_large) // 2
        side, too_large = (middle, too_large) if find_full_squares(middle).any() else (side, middle)
    if not side:
        return slice(0, 0), slice(0, 0)
    top, left = divmod(int(find_full_squares(side).argmax()), mask.shape[1] + 1 - side)
    return slice(top, top + side), slice(left, left + side)


def measure_spectral_slope(light: Array) -> float:
    """Measure the exponent α of the power spectrum f^-α of linear light (n, n); NaN below 32 pixels or without
    contrast.

    A line is fitted to the logarithm of the mean power in the rings of ``measure_spectrum``.
    """
    cycles, power = measure_spectrum(light)
    return -float(np.polyfit(np.log(cycles), np.log(power), 1)[0]) if cycles.size else float("nan")


def measure_spectrum(light: Array) -> tuple[Array, Array]:
    """Measure the spectrum of linear light (n, n) in rings: mean cycles per image (rings,), and mean power (rings,).

    The rings go from 4 cycles per image to 0.35 cycles per pixel; an image of less than 32 pixels, or without contrast,
    has none. The mean is subtracted, and a Hann window fades the borders.
    """
    n = light.shape[0]
    if light.shape != (n, n):
        raise ValueError(f"an image of {light.shape} is not a square")
    if n < MIN_SIDE_PX or not light.std() > 0:
        return np.empty(0), np.empty(0)
    window = np.hanning(n)
    power = np.abs(np.fft.fft2((light - light.mean()) * window * window[:, None])) ** 2
    cycles = np.hypot(*np.meshgrid(*[np.fft.fftfreq(n, 1 / n)] * 2))
    bounds = np.geomspace(_FEWEST_CYCLES, _MAX_CYCLES * n, _RING_COUNT + 1)
    ring = np.digitize(cycles.ravel(), bounds)
    count = np.bincount(ring, minlength=_RING_COUNT + 2)[1:-1]
    filled = count > 0
    mean = np.bincount(ring, power.ravel(), _RING_COUNT + 2)[1:-1][filled] / count[filled]
    middle = np.bincount(ring, cycles.ravel(), _RING_COUNT + 2)[1:-1][filled] / count[filled]
    return middle, mean


def measure_shares(level: Array, ground: Array) -> tuple[float, float]:
    """Measure the shares of the pixels with ``ground`` (H, W) that are saturated, and that are darker than 2 % of the
    full scale.

    ``level`` (H, W) is the image from 0 to 1, the full scale. NaN without ground.
    """
    shown = level[ground]
    if not shown.size:
        return float("nan"), float("nan")
    return float((shown >= 1.0).mean()), float((shown < DARK_LEVEL).mean())

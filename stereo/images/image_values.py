"""Images as 8-bit grey levels, and their size in words."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Rows that are scaled at once.
_ROWS_PER_STEP = 256
#: Quantile of an image's brightness that becomes white where images of unknown exposure are compared.
_WHITE_QUANTILE = 0.995


def to_8_bit(image: Array) -> Array:
    """Scale a uint16 image to uint8; a uint8 image is returned unchanged."""
    if image.dtype != np.uint16:
        return np.ascontiguousarray(image)
    scaled = np.empty(image.shape, np.uint8)
    for top in range(0, len(image), _ROWS_PER_STEP):  # a whole image would take eight bytes per value
        scaled[top : top + _ROWS_PER_STEP] = np.rint(image[top : top + _ROWS_PER_STEP] / 257.0)
    return scaled


def to_grey(image: Array) -> Array:
    """Convert an image to grey, uint8 (H, W): the mean of its three bands, as matchers without colour get it."""
    if image.ndim == 3:
        image = np.rint(image[..., :3].mean(axis=-1)).astype(image.dtype)
    return to_8_bit(image)


def find_white(image: Array) -> float:
    """Find the white level of an image (H, W) with an unknown exposure; NaN pixels do not count."""
    return max(float(np.quantile(image[np.isfinite(image)], _WHITE_QUANTILE)), 1e-12)


def stretch_to_8_bit(image: Array, white: float) -> Array:
    """Scale an image (H, W) to uint8 (H, W) so that ``white`` and more become 255; NaN becomes 0."""
    return np.asarray(np.clip(np.nan_to_num(image) / white, 0.0, 1.0) * 255, np.uint8)


def describe_size(image: Array) -> str:
    """Describe the width and height of an image in words."""
    return f"{image.shape[1]} x {image.shape[0]} px"

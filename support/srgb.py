"""The transfer curve of sRGB (IEC 61966-2-1)."""

from __future__ import annotations

import numpy as np

from .arrays import Array


def to_srgb(linear: Array) -> Array:
    """Convert linear values of any shape to values of sRGB, 0 to 1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0) ** (1 / 2.4) - 0.055)


def from_srgb(values: Array) -> Array:
    """Convert values of sRGB of any shape to linear values, 0 to 1."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)

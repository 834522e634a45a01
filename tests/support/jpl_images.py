"""Stereo pairs made of integers only, the same on every machine, and what JPL's own program made of them.

The CRC-32 are of its output, int32 little-endian, 1/256 px, 0x7FFF where rejected, and the counts of its flags; taken
from the compiled original (NASA-AMMOS/VICAR, ``marsjplstereo``).
"""

from __future__ import annotations

import numpy as np
from icymoon.support.arrays import Array

_FLAGS = ("ACCEPT", "BLOB", "BORDER", "BOUND", "FLAT", "LRLOS", "THRESH")
_SEARCH = {"max_disparity": 31, "blob_size": 20}

#: name -> (arguments of ``pair``, options, CRC of left, right and disparity, counts of flags)
CASES = {
    "textured": (
        (160, 120, 1, 128, 0),
        _SEARCH,
        (0xFF25D99E, 0x78CB334A, 0x88ABFB24),
        dict(zip(_FLAGS, (13822, 206, 922, 3724, 9, 517, 0), strict=True)),
    ),
    "weak and noisy": (
        (160, 120, 2, 32, 8),
        _SEARCH,
        (0x63CDB9E6, 0x42DF12FC, 0xB422E5D5),
        dict(zip(_FLAGS, (13435, 475, 883, 3724, 59, 624, 0), strict=True)),
    ),
    "pyramid": (
        (160, 120, 3, 128, 4),
        _SEARCH | {"pyramid_level": 1},
        (0x37FCAED2, 0x76919902, 0xD61CC151),
        dict(zip(_FLAGS, (2908, 2, 250, 1536, 5, 99, 0), strict=True)),
    ),
    "uncertainty": (
        (160, 120, 1, 128, 4),
        _SEARCH | {"min_disparity": 2, "uncertainty": 128},
        (0x6DE26130, 0x15476174, 0x8B3ECDC4),
        dict(zip(_FLAGS, (13807, 184, 1083, 3724, 7, 355, 40), strict=True)),
    ),
}


def pair(width: int, height: int, seed: int, contrast: int, noise: int, slope: int = 16) -> tuple[Array, ...]:
    """(left, right, integer disparity of the left one): uint8, uint8, int64, each (height, width).

    Random texture, smoothed along the rows, ``contrast`` of 128, with a ramp of ``slope`` px of disparity
    down the image and steps of 1 px, and noise of its own in each eye.
    """
    texture = _bytes((width + 64) * height, seed).reshape(height, width + 64)
    base = 128 + (((texture[:, :-2] + 2 * texture[:, 1:-1] + texture[:, 2:]) // 4 - 128) * contrast >> 7)
    row, column = np.indices((height, width))
    disparity = 4 + slope * row // height + (column // 16 + row // 16) % 3
    left = np.take_along_axis(base, np.clip(32 + column - disparity, 0, base.shape[1] - 1), axis=1)
    right = base[:, 32 : 32 + width]
    grain = (_bytes(2 * width * height, seed + 7).reshape(2, height, width) - 128) * noise >> 7
    return *(
        np.clip(image + own, 0, 255).astype(np.uint8) for image, own in zip((left, right), grain, strict=True)
    ), disparity


def _bytes(count: int, state: int) -> Array:
    """The top bytes of a linear congruential generator's states."""
    values = np.empty(count, np.int64)
    for place in range(count):
        state = (1664525 * state + 1013904223) % 2**32
        values[place] = state >> 24
    return values

"""Demosaicing in the evaluator: the linear methods of ``camera.colour``, and OpenCV's along edges."""

from __future__ import annotations

import numpy as np

from ...physics.camera import colour
from ...support.arrays import Array

#: OpenCV's names of mosaics, by the second and third pixel of the second row.
_OPENCV_PATTERNS = {"RGGB": "BG", "BGGR": "RG", "GRBG": "GB", "GBRG": "GR"}


def demosaic(numbers: Array, bits: int, pattern: str, method: str) -> Array:
    """R, G and B, float64 (H, W, 3) from 0 to the top of ``bits`` bits, of digital numbers (H, W), uint16, of a
    mosaic."""
    if method == "EDGE_AWARE":
        import cv2  # imported here, because Blender has no OpenCV and uses another method

        code = getattr(cv2, f"COLOR_Bayer{_OPENCV_PATTERNS[pattern]}2RGB_EA")
        finer = 2 ** (16 - bits)  # OpenCV rounds each of its means, so the numbers are scaled up first
        return np.asarray(cv2.demosaicing(numbers * np.uint16(finer), code) / finer)
    return np.clip(colour.demosaic(numbers, pattern, method), 0.0, 2.0**bits - 1)

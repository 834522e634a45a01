"""Conventions of icynet's files and images, without PyTorch."""

from __future__ import annotations

#: Search ranges are rounded up to a multiple of this, px, and images padded to it.
MULTIPLE = 16
#: Pixels of disparity between two levels of the costs.
LEVEL_PX = 4
#: Inputs of the ONNX file: images (1, 1, H, W) from 0 to 1 with sides that are multiples of 16, and levels 0 to D - 1.
INPUTS = ("left", "right", "levels")
#: Outputs (1, H, W) of the ONNX file: disparity in px, and the logit of the confidence.
OUTPUTS = ("disparity", "logit")


def count_levels(range_px: int) -> int:
    """Count the levels of a search range."""
    return -(-range_px // MULTIPLE) * (MULTIPLE // LEVEL_PX)

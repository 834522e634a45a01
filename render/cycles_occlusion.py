"""Finds the pixels of an eye whose point is hidden from the other eye, by rays from the other eye."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..formats.exr_parts import assemble, keep_part_attributes, read_pieces
from ..formats.exr_pixels import Pixels
from ..physics.camera.occlusion import find_hidden
from ..physics.camera.stereo_camera import StereoCamera
from ..support.arrays import Array
from ..support.labels import HIDDEN, SKY_DEPTH_M, TRUTH
from .pairs.pair_folder import EYES

#: Offsets from a pixel's centre to the rays between it and the next pixel. ``python benchmarks occlusion`` measures the
#: number of pixels that more rays would find.
STEPS_PX = (0.25, 0.5, 0.75)


def add_hidden_pass(truth: Mapping[str, Path], between: Mapping[str, Sequence[Array]], camera: StereoCamera) -> None:
    """Write the pass ``HIDDEN`` into the files of the truth, by eye: 1 where the point is hidden from the other eye.

    ``between`` are disparity maps by eye, one for each offset of STEPS_PX to the right. Raises ValueError, KeyError or
    OverBudgetError for a file that Blender did not write.
    """
    data = {eye: truth[eye].read_bytes() for eye in EYES}
    disparity = {eye: read_disparity(data[eye], camera) for eye in EYES}
    for eye, other in zip(EYES, reversed(EYES), strict=True):
        rays = np.stack([disparity[other], *between[other]], axis=-1)
        hidden = find_hidden(disparity[eye], rays.reshape(len(rays), -1), eye)
        pieces = [keep_part_attributes(piece, TRUTH) for piece in read_pieces(data[eye])]
        hidden_piece = Pixels(pieces[0]).replace_channels(f"{TRUTH}.{HIDDEN}", ("X",), hidden[:, None])
        truth[eye].write_bytes(assemble([*pieces, hidden_piece]))


def read_disparity(data: bytes, camera: StereoCamera) -> Array:
    """Read the disparity (H, W), px, from the depth in an EXR file; NaN for sky. Raises the errors of
    ``add_hidden_pass``."""
    return camera.disparity(read_depth(data))


def read_depth(data: bytes) -> Array:
    """Read the depth (H, W), m, in an EXR file; NaN for sky. Raises the errors of ``add_hidden_pass``."""
    for piece in read_pieces(data):
        pixels = Pixels(piece)
        for k, name in enumerate(pixels.channels):
            if ".Depth." in name:
                depth = pixels.decode()[:, k]
                return np.where((depth > 0) & (depth < SKY_DEPTH_M), depth, np.nan)
    raise ValueError("no depth")

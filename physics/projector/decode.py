"""Decode the columns of a projector from images of Gray code and phase, and triangulate depth. Imports no Blender."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from .device import Projector
from .patterns import count_gray_bits


def decode_columns(images: Array, projector: Projector, period_px: float, least: float) -> Array:
    """Decode the projector column (H, W), px, at each pixel, from images (count, H, W) in the order of
    ``make_gray_and_phase``. NaN where white is less than ``least`` above black, where the stripes' amplitude is less
    than half of ``least``, or where code and phase fit no column.

    The code numbers half periods, so that an error at the edge of a bit does not change the period.
    """
    bits = count_gray_bits(projector, period_px)
    white, black, coded, shifted = images[0], images[1], images[2 : 2 + bits], images[2 + bits :]
    middle = (white.astype(np.float64) + black) / 2
    gray = np.zeros(white.shape, np.int64)
    for image in coded:
        gray = gray << 1 | (image > middle)
    half = gray.copy()
    for bit in range(1, bits):
        half ^= gray >> bit
    angle = 2 * np.pi * np.arange(len(shifted)) / len(shifted)
    sine, cosine = (np.tensordot(of(angle), shifted.astype(np.float64), axes=1) for of in (np.sin, np.cos))
    within = (np.arctan2(-sine, cosine) / (2 * np.pi) % 1.0) * period_px
    column = within + np.rint(((half + 0.5) / 2 * period_px - within) / period_px) * period_px
    amplitude = np.hypot(sine, cosine) * 2 / len(shifted)
    fits = np.abs((half + 0.5) / 2 * period_px - column) <= period_px / 2
    seen = (white - black.astype(np.float64) >= least) & (amplitude >= least / 2) & fits
    return np.where(seen & (column >= 0) & (column <= projector.columns), column, np.nan)


def triangulate_columns(column: Array, projector: Projector, pose: Array, eye: Array, rays: Array) -> Array:
    """Compute the planar depth (H, W) in metres where camera rays meet the plane that a column of the projector lights.

    ``pose`` and ``eye`` (4, 4) transform from projector and camera to the world, with axes right, down and ahead.
    ``rays`` (H, W, 3) are in the camera's axes, with 1 ahead. NaN where a ray does not meet the plane in front of the
    camera.
    """
    tangent = (column - projector.columns / 2) / projector.focal_px
    normal = pose[:3, 0] - tangent[..., None] * pose[:3, 2]
    toward = (normal * (rays @ eye[:3, :3].T)).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (normal @ (pose[:3, 3] - eye[:3, 3])) / toward
        return np.where(depth > 0, depth, np.nan)

"""Images through a lens with distortion, and rectified again as a stereo pipeline gets them.

The render is the pinhole image, and so is its truth. The sensor detects the distorted image; matchers
are given what rectification makes of its numbers, which lies on the truth again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ..physics.distortion import check, coefficients, distorted, undistorted
from ..render.pair import StereoCamera


@dataclass(frozen=True)
class Lens:
    """Where the pixels of one image are in the other; maps (H, W, 2) float32, column and row, NaN outside."""

    from_pinhole: np.ndarray  # of each pixel that the sensor has, in the rendered image
    from_distorted: np.ndarray  # of each pixel of the rectified image, in the sensor's

    def distort(self, radiance: np.ndarray) -> np.ndarray:
        """What falls on the sensor, of pinhole radiance (H, W); dark where the render does not reach."""
        seen = _remapped(radiance, self.from_pinhole, cv2.INTER_CUBIC)
        return np.maximum(np.nan_to_num(seen), 0.0)

    def rectify(self, numbers: np.ndarray) -> np.ndarray:
        """The rectified image of the sensor's numbers (H, W), of their type; 0 where it has none."""
        seen = _remapped(numbers.astype(np.float32), self.from_distorted, cv2.INTER_LINEAR)
        return np.rint(np.nan_to_num(seen)).astype(numbers.dtype)

    def distort_truth(self, values: np.ndarray) -> np.ndarray:
        """Truth (H, W) for the sensor's pixels: that of the nearest pinhole pixel, never a mean; NaN outside."""
        height, width = values.shape
        column, row = np.rint(np.nan_to_num(self.from_pinhole, nan=-9.0)).astype(np.intp).transpose(2, 0, 1)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return np.where(inside, values[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)], np.nan)


def lens_of(camera: StereoCamera, rig: Mapping[str, Any]) -> Lens | None:
    """The lens that ``rig`` settings describe, or None if it has no distortion.

    Raises IcyMoonError if the coefficients fold the image.
    """
    k = coefficients(rig)
    if not any(k):
        return None
    pixels = np.stack(np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5), axis=-1)
    principal = np.array([camera.cx_px, camera.cy_px])
    points = (pixels - principal) / camera.focal_px
    check(points, k)

    def columns_and_rows(normalised: np.ndarray) -> np.ndarray:
        return (normalised * camera.focal_px + principal - 0.5).astype(np.float32)

    return Lens(columns_and_rows(undistorted(points, k)), columns_and_rows(distorted(points, k)))


def _remapped(image: np.ndarray, where: np.ndarray, method: int) -> np.ndarray:
    """``image`` at the places of a map; NaN beyond its outermost pixel centres."""
    height, width = image.shape
    outside = ~((where[..., 0] >= 0) & (where[..., 0] <= width - 1) & (where[..., 1] >= 0)
                & (where[..., 1] <= height - 1))
    at = np.nan_to_num(where, nan=-1.0)
    found = cv2.remap(image.astype(np.float32), at[..., 0], at[..., 1], method, borderMode=cv2.BORDER_REPLICATE)
    found[outside] = np.nan
    return np.asarray(found)

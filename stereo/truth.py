"""What the true depth says about a pair: disparity, visibility, and whether both eyes agree.

Columns and rows are pixel indices, whose difference between the eyes is free of the half-pixel
that the coordinates of pixel centres carry. Disparity is left column minus right column.
"""

from __future__ import annotations

import numpy as np

from ..labels import PLANET
from ..render.pair import StereoCamera
from .exr import View

#: Disparity, px, by which a surface must be nearer to count as an occluder; see visible_in_right.
OCCLUSION_STEP_PX = 0.5


def scene_depth(view: View) -> np.ndarray:
    """Planar depth in metres, float64 (H, W), NaN for sky and for the planet.

    The planet is sky to a stereo camera: it is far beyond any disparity that can be measured.
    """
    if view.semantic is None:
        return view.depth
    return np.where(view.semantic == PLANET, np.nan, view.depth)


def visible_in_right(left_depth: np.ndarray, right_depth: np.ndarray, camera: StereoCamera) -> np.ndarray:
    """Boolean (H, W): the point seen by this left pixel is inside the right image and not hidden there.

    Both depths are planar metres, NaN for sky; sky is not visible. The point lands between two
    columns of the right image. On a plane disparity is an affine function of the column, so there
    its own disparity lies between those of the two columns however steep the plane is; it is hidden
    only if both columns show something nearer. Nearer means by OCCLUSION_STEP_PX: an occluder that
    is nearer by s px of disparity hides a strip s px wide, and one narrower than half a pixel can
    hide no whole pixel, while curvature between two columns and single precision stay below it.
    """
    height, width = left_depth.shape
    disparity = camera.disparity(left_depth)
    right_disparity = np.nan_to_num(camera.disparity(right_depth), nan=0.0)  # sky hides nothing
    column = np.arange(width) - disparity
    inside = (column >= -0.5) & (column <= width - 0.5)  # also False for NaN
    before, after, _ = _neighbours(column, width)
    rows = np.arange(height)[:, None]
    nearest_open = np.minimum(right_disparity[rows, before], right_disparity[rows, after])
    return inside & (nearest_open <= np.where(inside, disparity, 0.0) + OCCLUSION_STEP_PX)


def photometric_disagreement(left_grey: np.ndarray, right_grey: np.ndarray, left_depth: np.ndarray,
                             visible: np.ndarray, camera: StereoCamera) -> float:
    """Median relative difference of left radiance and right radiance fetched by the true disparity.

    Taken where ``visible``; NaN if nothing is. It checks camera, baseline, eye order and depth at
    once: a good pair differs by its render noise and by how far the surface is from Lambertian,
    a wrong f·B or swapped eyes by its whole texture contrast.
    """
    if not visible.any():
        return float("nan")
    height, width = left_depth.shape
    column = np.arange(width) - camera.disparity(left_depth)
    before, after, weight = _neighbours(column, width)
    rows = np.arange(height)[:, None]
    fetched = (1 - weight) * right_grey[rows, before] + weight * right_grey[rows, after]
    left, right = left_grey[visible].astype(np.float64), fetched[visible].astype(np.float64)
    brightness = (left + right) / 2
    lit = brightness > 0
    if not lit.any():
        return 0.0
    return float(np.median(np.abs(left - right)[lit] / brightness[lit]))


def _neighbours(column: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two whole columns around a fractional one, held inside the image, and the second's weight."""
    column = np.clip(np.nan_to_num(column, nan=0.0), 0.0, width - 1.0)
    before = np.floor(column).astype(np.intp)
    return before, np.minimum(before + 1, width - 1), column - before

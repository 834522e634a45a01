"""Disparity and occlusion, from the true depth of a pair.

Columns and rows are pixel indices. The coordinates of pixel centres differ from them by half a pixel, which cancels
between the eyes. Disparity is the left column minus the right one.
"""

from __future__ import annotations

import numpy as np

from ...labels import PLANET
from ...render.pairs.pair_folder import StereoCamera
from .exr import Truth

#: Disparity, px, by which an occluder must be nearer; see visible_in_right.
OCCLUSION_STEP_PX = 0.5


def scene_depth(view: Truth) -> np.ndarray:
    """Planar depth in metres, float64 (H, W), NaN for sky and for the planet.

    To a stereo camera the planet is sky: its disparity is too small to measure.
    """
    if view.semantic is None:
        return view.depth
    return np.where(view.semantic == PLANET, np.nan, view.depth)


def visible_in_right(left_depth: np.ndarray, right_depth: np.ndarray, camera: StereoCamera) -> np.ndarray:
    """Boolean (H, W): the point that a left pixel sees is inside the right image and not hidden there.

    Both depths are planar metres, NaN for sky; sky is not visible. The point falls between two columns of the right
    image, and is hidden only if both show something nearer. On a plane, disparity is an affine function of the column,
    so the disparity of a visible point lies between those of the two columns, however steep the plane is.

    Something is nearer if its disparity is larger by OCCLUSION_STEP_PX. An occluder whose disparity is larger by s px
    hides a strip s px wide, and a strip below half a pixel hides no whole pixel. Curvature between two columns and
    single precision change the disparity by less.
    """
    return _visible(left_depth, right_depth, camera, "left")


def visible_in_left(left_depth: np.ndarray, right_depth: np.ndarray, camera: StereoCamera) -> np.ndarray:
    """The same for the pixels of the right image."""
    return _visible(right_depth, left_depth, camera, "right")


def _visible(depth: np.ndarray, other_depth: np.ndarray, camera: StereoCamera, eye: str) -> np.ndarray:
    width = depth.shape[1]
    disparity = camera.disparity(depth)
    other_disparity = np.nan_to_num(camera.disparity(other_depth), nan=0.0)  # sky hides nothing
    column = matching_column(disparity, eye)
    inside = (column >= -0.5) & (column <= width - 0.5)  # also False for NaN
    before, after, _ = _neighbours(column, width)
    nearest_open = np.minimum(_at(other_disparity, before), _at(other_disparity, after))
    return inside & (nearest_open <= np.where(inside, disparity, 0.0) + OCCLUSION_STEP_PX)


def matching_column(disparity: np.ndarray, eye: str = "left") -> np.ndarray:
    """Column, in the other eye's image, of the point that each pixel of ``eye`` sees, float64 (H, W)."""
    return np.arange(disparity.shape[1]) - disparity * (1 if eye == "left" else -1)


def warped(image: np.ndarray, column: np.ndarray) -> np.ndarray:
    """``image`` (H, W) interpolated linearly at the fractional ``column`` (H, W) of each pixel; constant beyond the
    edges."""
    before, after, weight = _neighbours(column, image.shape[1])
    return (1 - weight) * _at(image, before) + weight * _at(image, after)


def _neighbours(column: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two whole columns around a fractional one, clamped to the image, and the weight of the second."""
    column = np.clip(np.nan_to_num(column, nan=0.0), 0.0, width - 1.0)
    before = np.floor(column).astype(np.intp)
    return before, np.minimum(before + 1, width - 1), column - before


def _at(image: np.ndarray, column: np.ndarray) -> np.ndarray:
    return np.asarray(np.take_along_axis(image, column, axis=1))

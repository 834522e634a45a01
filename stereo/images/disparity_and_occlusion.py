"""What the true depth says about a pair: disparity, and what each eye sees of the other's view.

Columns and rows are pixel indices, whose difference between the eyes is free of the half-pixel
that the coordinates of pixel centres carry. Disparity is left column minus right column.
"""

from __future__ import annotations

import numpy as np

from ...labels import PLANET
from ...render.pairs.pair_folder import StereoCamera
from .exr import Truth

#: Disparity, px, by which a surface must be nearer to count as an occluder; see visible_in_right.
OCCLUSION_STEP_PX = 0.5


def scene_depth(view: Truth) -> np.ndarray:
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
    return _visible(left_depth, right_depth, camera, "left")


def visible_in_left(left_depth: np.ndarray, right_depth: np.ndarray, camera: StereoCamera) -> np.ndarray:
    """The same of the pixels of the right image."""
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
    """``image`` (H, W) fetched at the fractional ``column`` (H, W) of each pixel, linear, held at the edges."""
    before, after, weight = _neighbours(column, image.shape[1])
    return (1 - weight) * _at(image, before) + weight * _at(image, after)


def _neighbours(column: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two whole columns around a fractional one, held inside the image, and the second's weight."""
    column = np.clip(np.nan_to_num(column, nan=0.0), 0.0, width - 1.0)
    before = np.floor(column).astype(np.intp)
    return before, np.minimum(before + 1, width - 1), column - before


def _at(image: np.ndarray, column: np.ndarray) -> np.ndarray:
    return np.asarray(np.take_along_axis(image, column, axis=1))

"""Disparity and occlusion, from the true depth of a pair."""

from __future__ import annotations

import numpy as np

from ...physics.camera.occlusion import find_hidden, find_matching_column, is_in_frame
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.labels import PLANET
from .exr import Truth

#: Sources of visibility: rays that were cast when the pair was rendered, the depths of both eyes, or a mask of the data
#: set.
RAYS, ESTIMATED, MASK = "RAYS", "ESTIMATED", "MASK"


def find_scene_depth(view: Truth) -> Array:
    """Find the planar depth in metres, float64 (H, W), NaN for sky and for the planet.

    To a stereo camera the planet is sky: its disparity is too small to measure.
    """
    if view.semantic is None:
        return view.depth
    return np.where(view.semantic == PLANET, np.nan, view.depth)


def find_visible_in_right(
    left_depth: Array, right_depth: Array, camera: StereoCamera, hidden: Array | None = None
) -> Array:
    """Return the left eye's pixels (H, W), bool, whose point is inside the right image and not hidden there.

    Both depths are planar, m, NaN for sky; sky is not visible. ``hidden`` (H, W), bool, marks the points that rays
    found hidden at the render. Without it, hidden points are estimated: the right image shows a nearer surface there.
    """
    return _find_visible(left_depth, right_depth, camera, "left", hidden)


def find_visible_in_left(
    left_depth: Array, right_depth: Array, camera: StereoCamera, hidden: Array | None = None
) -> Array:
    """Return the right eye's pixels (H, W), bool, whose point the left eye sees; see ``find_visible_in_right``."""
    return _find_visible(right_depth, left_depth, camera, "right", hidden)


def _find_visible(depth: Array, other_depth: Array, camera: StereoCamera, eye: str, hidden: Array | None) -> Array:
    disparity = camera.disparity(depth)
    if hidden is None:
        hidden = find_hidden(disparity, camera.disparity(other_depth), eye)
    return is_in_frame(find_matching_column(disparity, eye)) & ~hidden

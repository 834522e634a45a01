"""Disparity and occlusion, from the true depth of a pair."""

from __future__ import annotations

import numpy as np

from ...physics.camera.occlusion import find_hidden, find_matching_column, is_in_frame
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.labels import PLANET
from .exr import Truth

#: Sources of the points that the other eye sees: rays that were cast when the pair was rendered, the depths of both
#: eyes, or a mask that the data set contains.
RAYS, ESTIMATED, MASK = "RAYS", "ESTIMATED", "MASK"


def find_scene_depth(view: Truth) -> Array:
    """Planar depth in metres, float64 (H, W), NaN for sky and for the planet.

    To a stereo camera the planet is sky: its disparity is too small to measure.
    """
    if view.semantic is None:
        return view.depth
    return np.where(view.semantic == PLANET, np.nan, view.depth)


def find_visible_in_right(
    left_depth: Array, right_depth: Array, camera: StereoCamera, hidden: Array | None = None
) -> Array:
    """Boolean (H, W): the point that a left pixel sees is inside the right image and not hidden there.

    Both depths are planar metres, NaN for sky; sky is not visible. ``hidden``, Boolean (H, W), marks the points that
    rays found hidden when the pair was rendered. Without it, it is estimated: the right image shows something nearer.
    """
    return _find_visible(left_depth, right_depth, camera, "left", hidden)


def find_visible_in_left(
    left_depth: Array, right_depth: Array, camera: StereoCamera, hidden: Array | None = None
) -> Array:
    """The same for the pixels of the right image."""
    return _find_visible(right_depth, left_depth, camera, "right", hidden)


def _find_visible(depth: Array, other_depth: Array, camera: StereoCamera, eye: str, hidden: Array | None) -> Array:
    disparity = camera.disparity(depth)
    if hidden is None:
        hidden = find_hidden(disparity, camera.disparity(other_depth), eye)
    return is_in_frame(find_matching_column(disparity, eye)) & ~hidden

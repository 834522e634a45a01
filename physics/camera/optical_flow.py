"""Optical flow and occlusion of still ground between two images of one camera, from true depth and poses.

Coordinates start at the outer corner of the first pixel; the centre of pixel (column u, row v) is (u + 0.5, v + 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .rolling_shutter import RollingShutter, move_to_middle, project_points
from .stereo_camera import StereoCamera

#: Relative difference in distance by which an occluder must be nearer: ten times the error bound of true depth on a
#: plane.
_MIN_GAP = 1e-3
#: Further difference by which an occluder must be nearer, as a share of the range of the four pixels around the point.
#: Inverse depth is assumed to be linear between them, although an edge may lie anywhere.
_MIN_GAP_SHARE = 0.25


@dataclass(frozen=True)
class Flow:
    """Displacement of an image's points to another image. ``flow_px`` (H, W, 2) is columns to the right and rows down,
    NaN without a point or behind the other camera. ``visible`` (H, W) is true where the other image shows the point.
    """

    flow_px: Array
    visible: Array


def find_flow(
    camera: StereoCamera,
    depth_m: Array,
    pose: Array,
    other_depth_m: Array,
    other_pose: Array,
    shutter: RollingShutter | None = None,
    other_shutter: RollingShutter | None = None,
) -> Flow:
    """Find the flow from one image to another of the same camera, with the lens of the left rectified eye.

    Planar depths (H, W) in metres are NaN for sky, which hides nothing. Poses (4, 4) are from the axes x right, y down,
    z forward to the world. With a rolling shutter, poses belong to the middle of the readout, and depths are along the
    axes of the rows.
    """
    rows, columns = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    centre, focal = np.array([camera.cx_px, camera.cy_px]), camera.focal_px
    here = np.stack([columns, rows], axis=-1)
    points = np.concatenate([(here - centre) / focal, np.ones((*depth_m.shape, 1))], axis=-1) * depth_m[..., None]
    # Combine the poses first: coordinates far from the origin would lose digits.
    turn = other_pose[:3, :3].T @ pose[:3, :3]
    shift = other_pose[:3, :3].T @ (pose[:3, 3] - other_pose[:3, 3])
    moved = move_to_middle(points, shutter) @ turn.T + shift
    if other_shutter is not None:
        at, away = project_points(moved.reshape(-1, 3), camera, other_shutter)
        there = at.reshape(here.shape)
        return Flow(there - here, _find_visible(there, away.reshape(depth_m.shape), other_depth_m))
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = moved[..., 2] > 0
        there = np.where(ahead[..., None], focal * moved[..., :2] / moved[..., 2:] + centre, np.nan)
    return Flow(there - here, _find_visible(there, moved[..., 2], other_depth_m))


def _find_visible(there: Array, depth_m: Array, other_depth_m: Array) -> Array:
    """Return whether the other image, with true depths ``other_depth_m`` (H, W), shows each point, bool (H, W).
    ``there`` (H, W, 2) and ``depth_m`` (H, W) are the points' positions and depths in that image.
    """
    height, width = other_depth_m.shape
    with np.errstate(invalid="ignore"):
        inside = ((there >= 0) & (there <= (width, height))).all(axis=-1)
    at = np.where(inside[..., None], there, 0.5) - 0.5
    # The half pixel at the border is extrapolated from the two pixels beside it.
    first = np.clip(np.floor(at).astype(np.intp), 0, (width - 2, height - 2))
    (u, v), (left, top), (right, bottom) = (np.moveaxis(each, -1, 0) for each in (at - first, first, first + 1))
    inverse = np.nan_to_num(1.0 / other_depth_m, nan=0.0)  # affine on a plane; 0 for sky
    corners = np.stack([inverse[top, left], inverse[top, right], inverse[bottom, left], inverse[bottom, right]])
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
    with np.errstate(invalid="ignore", divide="ignore"):
        own = 1.0 / depth_m
        nearer = np.maximum(_MIN_GAP * own, _MIN_GAP_SHARE * np.ptp(corners, axis=0))
        return np.asarray(inside & ((weights * corners).sum(axis=0) <= own + nearer))

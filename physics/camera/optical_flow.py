"""Optical flow of still ground between two images of one camera, from true depth and poses, and where it is hidden.

Coordinates count from the outer corner of the first pixel; the centre of pixel (column u, row v) is (u + 0.5, v + 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .stereo_camera import StereoCamera

#: Share of its distance by which something must be nearer to hide a point: ten times the bound of the error of true
#: depth on a plane.
_NEARER = 1e-3
#: The same, as a share of the differences among the four pixels around it: between them inverse depth is taken as that
#: of a plane, and an edge lies anywhere between two.
_NEARER_SHARE = 0.25


@dataclass(frozen=True)
class Flow:
    """Where the points of an image are in another: ``flow_px`` (H, W, 2), columns to the right and rows down, NaN
    without a point or behind the other camera, and whether the other image shows the point, ``visible`` (H, W)."""

    flow_px: Array
    visible: Array


def find_flow(camera: StereoCamera, depth_m: Array, pose: Array, other_depth_m: Array, other_pose: Array) -> Flow:
    """The flow from an image to another of the same camera, with the lens of the left rectified eye.

    Planar depths (H, W) in metres are NaN for sky, which hides nothing; poses (4, 4) are from the axes x right, y down,
    z forward to the world.
    """
    rows, columns = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    centre, focal = np.array([camera.cx_px, camera.cy_px]), camera.focal_px
    here = np.stack([columns, rows], axis=-1)
    points = np.concatenate([(here - centre) / focal, np.ones((*depth_m.shape, 1))], axis=-1) * depth_m[..., None]
    # Between the poses first: places far from the origin would lose digits.
    turn = other_pose[:3, :3].T @ pose[:3, :3]
    shift = other_pose[:3, :3].T @ (pose[:3, 3] - other_pose[:3, 3])
    moved = points @ turn.T + shift
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = moved[..., 2] > 0
        there = np.where(ahead[..., None], focal * moved[..., :2] / moved[..., 2:] + centre, np.nan)
    return Flow(there - here, _find_visible(there, moved[..., 2], other_depth_m))


def _find_visible(there: Array, depth_m: Array, other_depth_m: Array) -> Array:
    """Whether an image with ``other_depth_m`` (H, W) shows points ``depth_m`` away, ``there`` (H, W, 2) in it."""
    height, width = other_depth_m.shape
    with np.errstate(invalid="ignore"):
        inside = ((there >= 0) & (there <= (width, height))).all(axis=-1)
    at = np.where(inside[..., None], there, 0.5) - 0.5
    # Half a pixel at the border goes on from the two pixels before it.
    first = np.clip(np.floor(at).astype(np.intp), 0, (width - 2, height - 2))
    (u, v), (left, top), (right, bottom) = (np.moveaxis(each, -1, 0) for each in (at - first, first, first + 1))
    inverse = np.nan_to_num(1.0 / other_depth_m, nan=0.0)  # affine on a plane; 0 for sky
    corners = np.stack([inverse[top, left], inverse[top, right], inverse[bottom, left], inverse[bottom, right]])
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
    with np.errstate(invalid="ignore", divide="ignore"):
        own = 1.0 / depth_m
        nearer = np.maximum(_NEARER * own, _NEARER_SHARE * np.ptp(corners, axis=0))
        return np.asarray(inside & ((weights * corners).sum(axis=0) <= own + nearer))

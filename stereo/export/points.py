"""Writes the surface that a matcher measured as a point cloud coloured by its error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.rolling_shutter import place_in_world, turn_to_world
from ...support.arrays import Array
from ...support.files import write_bytes
from ..images.colours import colour_signed_errors
from ..measure.prepare_pair import PreparedPair
from ..measure.row_metrics import disparity_to_depth

#: Most points of one pair. In a larger image every second, third, … row and column is used.
MAX_POINTS = 60_000
_POINT_LAYOUT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("nx", "<f4"),
        ("ny", "<f4"),
        ("nz", "<f4"),
        ("red", "u1"),
        ("green", "u1"),
        ("blue", "u1"),
        ("error_m", "<f4"),
        ("size_m", "<f4"),
    ]
)
_PLY_TYPES = {"f4": "float", "u1": "uchar"}


def write_points(path: Path, prepared: PreparedPair, disparity: Array) -> None:
    """Write the measured points in world axes, metres, as binary PLY.

    Normals point to the camera. ``error_m`` is the measured minus the true depth, NaN without a true depth. ``size_m``
    is the width of the pixels that a point stands for. A comment ``missing N`` gives the number of pixels with a true
    but no measured depth, and ``map {...}`` the place on a map in JSON. The pair must have a ``find_left_pose``.
    """
    points = make_measured_points(prepared, disparity)
    properties = [f"property {_PLY_TYPES[_POINT_LAYOUT[name].str[1:]]} {name}" for name in _POINT_LAYOUT.names or ()]
    place = prepared.facts.get("map")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment Icy Moon: error_m is measured minus true depth",
        *([f"comment map {json.dumps(place)}"] if place else []),
        f"comment missing {count_missing_points(prepared, disparity)}",
        f"element vertex {len(points)}",
        *properties,
        "end_header",
    ]
    write_bytes(path, "".join(f"{line}\n" for line in header).encode("ascii") + points.tobytes())


def make_measured_points(prepared: PreparedPair, disparity: Array) -> Array:
    """Make the measured points, a structured array of ``_POINT_LAYOUT``; see ``write_points``."""
    camera = prepared.depth_camera
    pose = prepared.pair.row_poses("left")
    assert pose is not None
    step = _choose_pixel_step(disparity)
    rows, columns = (grid[::step, ::step] for grid in np.indices(disparity.shape))
    depth, truth = (values[::step, ::step] for values in (disparity_to_depth(prepared, disparity), prepared.truth))
    known = np.isfinite(depth)
    depth, truth = depth[known], truth[known]
    # Pixel centres, in OpenCV's axes: x right, y down, z along the optical axis.
    rays = np.stack(
        [
            (columns[known] + 0.5 - camera.cx_px) / camera.focal_px,
            (rows[known] + 0.5 - camera.cy_px) / camera.focal_px,
            np.ones(depth.size),
        ],
        axis=1,
    )
    position = place_in_world(rays * depth[:, None], pose, rows[known])
    toward = turn_to_world(-(rays / np.linalg.norm(rays, axis=1, keepdims=True)), pose, rows[known])
    points = np.zeros(depth.size, _POINT_LAYOUT)
    for k, axis in enumerate("xyz"):
        points[axis], points[f"n{axis}"] = position[:, k], toward[:, k]
    points["error_m"] = depth - truth
    points["size_m"] = step * depth / camera.focal_px
    points["red"], points["green"], points["blue"] = colour_signed_errors(depth - truth).T
    return points


def count_missing_points(prepared: PreparedPair, disparity: Array) -> int:
    """Count the pixels in the grid of ``make_measured_points`` that have a true depth but no measured one."""
    step = _choose_pixel_step(disparity)
    depth, truth = (values[::step, ::step] for values in (disparity_to_depth(prepared, disparity), prepared.truth))
    return int((np.isfinite(truth) & ~np.isfinite(depth)).sum())


def _choose_pixel_step(disparity: Array) -> int:
    """Choose the step, in rows and columns, between the pixels that become points."""
    return max(1, int(np.ceil(np.sqrt(disparity.size / MAX_POINTS))))


def find_left_pose(prepared: PreparedPair) -> Array | None:
    """Return the matrix (4, 4) from the rectified left camera, in OpenCV's axes, to the world; None if the pair has
    none.
    """
    return prepared.pair.rectified_pose("left")


def add_points(images: dict[str, Any], out: Path, prepared: PreparedPair, disparity: Array) -> dict[str, Any]:
    """Return the ``images`` of a row with its ``points``. Missing points are written beside the row's disparity."""
    if "points" in images:
        return images
    path = (out / images["disparity"]).with_suffix(".ply")
    write_points(path, prepared, disparity)
    return images | {"points": path.relative_to(out).as_posix()}

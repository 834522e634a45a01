"""Calibrations of ROS: a ``camera_info`` in YAML for each eye, see ``formats.ros_camera``.

A pair states its pose by rectification: the left eye is at the origin of the rectified axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig, rectifying_rotations
from ...physics.camera.lens_models import Brown, Fisheye, LensModel
from ...physics.camera.rotations import nearest_rotation, rotation_error
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import write_text
from ...support.foreign_bytes import explain_errors
from ..ros_camera import RosCamera, read_ros_camera
from .options import (
    Reading,
    Stated,
    convert_to_brown,
    convert_to_fisheye,
    find_why_no_opencv_lens,
    format_numbers,
    make_brown,
)

_KIND = "a calibration of ROS"
#: Largest deviation of R times its transpose from 1 without a note; camera_calibration writes five digits.
_MAX_ROUNDING = 1e-6


def read_ros(paths: Sequence[Path], _: Stated) -> Reading:
    """Read one eye, or a pair of two files."""
    found = [read_ros_camera(path) for path in paths]
    if len(found) > 2:
        raise IcyMoonError(f"{paths[2]} is a third calibration of ROS, which hold pairs; give two.")
    cameras, notes = [], []
    for path, ros in zip(paths, found, strict=True):
        turn = nearest_rotation(ros.rectification)
        off = rotation_error(ros.rectification)
        if off > _MAX_ROUNDING:
            notes.append(
                f"{path.name}: rectification_matrix was rounded, off by {off:.2g}; the nearest rotation is taken."
            )
        with explain_errors(path, _KIND, "calibrate both eyes as a stereo pair"):
            camera, place = _camera(ros, path.stem), find_position_m(ros)
            # From the rectified axes, whose origin is the left eye, to the camera's.
            cameras.append(camera.placed(turn.T, -turn.T @ place) if len(found) > 1 else camera)
    if len(found) == 2 and not np.linalg.norm(cameras[1].centre_m - cameras[0].centre_m) > 0:
        raise IcyMoonError(
            f"{paths[1]}: projection_matrix states no baseline (-f B, its fourth number); calibrate both eyes as a "
            "stereo pair."
        )
    return Reading(
        CalibratedRig(tuple(cameras)).from_first() if len(found) > 1 else CalibratedRig(tuple(cameras)), tuple(notes)
    )


def find_position_m(camera: RosCamera) -> Array:
    """Find the position (3,), m, of a camera in the axes of the rectified pair."""
    return np.array([*(-camera.projection[row, 3] / camera.projection[row, row] for row in range(2)), 0.0])


def _camera(ros: RosCamera, name: str) -> CalibratedCamera:
    (fx, skew, cx), (_, fy, cy) = ros.matrix[:2].tolist()
    if skew:
        raise ValueError(f"camera_matrix has a skew of {skew:g} px, which ROS' functions leave out; set it to 0")
    lens: LensModel = Fisheye(ros.coefficients) if ros.model == "equidistant" else make_brown(ros.coefficients)
    return CalibratedCamera(ros.width_px, ros.height_px, fx, fy, cx, cy, lens, name=name)


def make_ros_pair(rig: CalibratedRig) -> tuple[RosCamera, RosCamera]:
    """Convert the first two cameras to ROS' form, rectified by the method of Bouguet and OpenCV.

    The rectified images have the mean focal length and principal point of both. A lens that ROS lacks keeps its own
    model name and has no coefficients. Raises ValueError for eyes that are not side by side.
    """
    eyes = rig.cameras[:2]
    turns = rectifying_rotations(rig)
    same = [convert_to_brown(camera) or convert_to_fisheye(camera) or camera for camera in eyes]
    focal = float(np.mean([[camera.fx_px, camera.fy_px] for camera in same]))
    cx, cy = np.mean([[camera.cx_px, camera.cy_px] for camera in same], axis=0).tolist()
    # Position of the right eye along x of the rectified axes.
    along = float((turns[1] @ rig.relative_pose()[1])[0])
    found = []
    for camera, turn, shift in zip(same, turns, (0.0, along), strict=True):
        projection = np.array([[focal, 0, cx, focal * shift], [0, focal, cy, 0], [0, 0, 1.0, 0]])
        model, numbers = _list_lens_parameters(camera.lens)
        found.append(RosCamera(camera.matrix, model, numbers, turn, projection, *camera.size_px))
    return found[0], found[1]


def _list_lens_parameters(lens: LensModel) -> tuple[str, tuple[float, ...]]:
    """Return the name of a lens model of ROS, and its coefficients."""
    if isinstance(lens, Fisheye):
        return "equidistant", lens.coefficients
    if not isinstance(lens, Brown):
        return lens.name, ()
    numbers = lens.shortened() or (0.0,) * 5
    return "plumb_bob" if len(numbers) == 5 else "rational_polynomial", numbers


def why_not_ros(camera: CalibratedCamera) -> str:
    """Return a phrase on why ROS cannot store a camera; empty if it can."""
    return find_why_no_opencv_lens(camera, 12)


def write_ros(rig: CalibratedRig, paths: Sequence[Path]) -> None:
    """Write a file for each eye of a pair. Raises IcyMoonError for eyes that are not side by side."""
    with explain_errors(paths[-1], _KIND, "give two eyes side by side"):
        if len(paths) != 2:
            raise ValueError("ROS holds pairs, and this is one camera")
        pair = make_ros_pair(rig)
    for camera, ros, path in zip(rig.cameras, pair, paths, strict=True):
        write_text(path, _text(ros, camera.name or path.stem))


def _text(ros: RosCamera, name: str) -> str:
    lines = [
        f"image_width: {ros.width_px}",
        f"image_height: {ros.height_px}",
        f"camera_name: {''.join(sign if sign.isalnum() else '_' for sign in name)}",
        *_matrix("camera_matrix", ros.matrix),
        f"distortion_model: {ros.model}",
        *_matrix("distortion_coefficients", np.array([ros.coefficients])),
        *_matrix("rectification_matrix", ros.rectification),
        *_matrix("projection_matrix", ros.projection),
        "",
    ]
    return "\n".join(lines)


def _matrix(name: str, values: Array) -> list[str]:
    rows, cols = values.shape
    return [f"{name}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: [{format_numbers(values)}]"]

"""``transforms.json`` of nerfstudio and instant-ngp: a frame for each camera, in OpenGL's axes.

Pixels are counted from the corner of the first pixel. Values of a frame replace those of the whole file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.arm.kinematics import make_rigid_transform
from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.lens_models import Brown, Fisheye
from ...support.files import quote, write_json
from ...support.foreign_bytes import ForeignBytes, RefusedError, describe_reason, parse_json, read
from .options import Reading, Stated, find_why_no_opencv_lens, split_pose, to_number_array, to_opencv_lens

_KIND = "a transforms.json"
_FIX = "give a file with frames, fl_x, fl_y, cx, cy, w, h and a transform_matrix of each frame"
_HALF_PIXEL = 0.5
_MAX_BYTES = 2**24
#: Axes of OpenGL, y up and z backward, to ours.
_OPENGL_TO_OURS = np.diag([1.0, -1.0, -1.0, 1.0])
_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV_FISHEYE")
_ASSUMED_UNIT = "A transforms.json states no unit: one unit of its scale is assumed to be {} m."


def read_transforms(paths: Sequence[Path], stated: Stated) -> Reading:
    """Read a camera for each frame, in world axes."""
    (path,) = paths
    return read(path, lambda foreign: _parse(foreign, stated), _KIND, _FIX, _MAX_BYTES)


def _parse(foreign: ForeignBytes, stated: Stated) -> Reading:
    whole = parse_json(foreign.text())
    frames = whole["frames"]
    if not isinstance(frames, list) or not 0 < len(frames) <= 1000:
        raise ValueError("it has no frames, or more than 1000")
    cameras = []
    for number, frame in enumerate(frames):
        try:
            cameras.append(_camera({**whole, **frame}, stated.unit_m()))
        except (ValueError, KeyError) as error:
            raise ValueError(f"frames[{number}]: {describe_reason(error)}") from None
    return Reading(CalibratedRig(tuple(cameras)), (_ASSUMED_UNIT.format(stated.unit_m()),))


def _camera(frame: dict[str, Any], unit_m: float) -> CalibratedCamera:
    model = frame.get("camera_model", "OPENCV")
    if model not in _MODELS:
        raise RefusedError(
            f"has the camera model {quote(model)}, but only {', '.join(_MODELS)} are supported; undistort the images."
        )
    fx, fy, cx, cy, width, height = (
        float(to_number_array(frame[key], key, 1)[0]) for key in ("fl_x", "fl_y", "cx", "cy", "w", "h")
    )
    k1, k2, k3, k4, p1, p2 = (
        float(to_number_array(frame.get(key, 0.0), key, 1)[0]) for key in ("k1", "k2", "k3", "k4", "p1", "p2")
    )
    fisheye = model == "OPENCV_FISHEYE" or frame.get("is_fisheye") is True
    if not fisheye and k4:
        raise ValueError("k4 is not 0, which nerfstudio uses as a power that OpenCV's lens lacks; set it to 0")
    lens = Fisheye((k1, k2, k3, k4)) if fisheye else Brown((k1, k2, p1, p2, k3))
    rotation, centre = split_pose(
        to_number_array(frame["transform_matrix"], "transform_matrix", 4, 4) @ _OPENGL_TO_OURS
    )
    name = str(frame.get("file_path", ""))
    own = CalibratedCamera(
        int(width), int(height), fx, fy, cx - _HALF_PIXEL, cy - _HALF_PIXEL, lens, name=name, rotation=rotation.T
    )
    return own.placed(own.rotation, -own.rotation @ centre * unit_m)


def why_not_transforms(camera: CalibratedCamera) -> str:
    """Return a phrase on why a transforms.json cannot store a camera; empty if it can."""
    return find_why_no_opencv_lens(camera, 5)


def write_transforms(rig: CalibratedRig, paths: Sequence[Path]) -> None:
    """Write a frame for each camera."""
    (path,) = paths
    write_json(path, {"frames": [_frame(camera, number) for number, camera in enumerate(rig.cameras, 1)]})


def _frame(camera: CalibratedCamera, number: int) -> dict[str, Any]:
    same, lens = to_opencv_lens(camera)
    is_fisheye = isinstance(lens, Fisheye)
    names = ("k1", "k2", "k3", "k4") if is_fisheye else ("k1", "k2", "p1", "p2", "k3")
    return {
        "file_path": camera.name or f"camera{number}",
        "transform_matrix": (make_rigid_transform(camera.rotation.T, camera.centre_m) @ _OPENGL_TO_OURS).tolist(),
        "camera_model": "OPENCV_FISHEYE" if is_fisheye else "OPENCV",
        "w": camera.width_px,
        "h": camera.height_px,
        "fl_x": same.fx_px,
        "fl_y": same.fy_px,
        "cx": same.cx_px + _HALF_PIXEL,
        "cy": same.cy_px + _HALF_PIXEL,
        **dict(zip(names, lens.coefficients, strict=False)),
    }

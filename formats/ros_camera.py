"""Calibrations of ROS: the YAML files that ``camera_calibration`` writes, one for each eye, or the message CameraInfo
as ``ros2 topic echo`` prints it.

Each has the matrix K and the distortion of a camera (plumb_bob: k1, k2, p1, p2, k3), and the rotation R and the matrix
P of the rectified pair; the right eye's P contains -f B (sensor_msgs/CameraInfo). Pixels are counted from the centre of
the first pixel. Where ``roi`` and ``binning`` state that the images are a binned part of the calibrated ones, K and P
are converted to the images, as in ROS' image_geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes, RefusedError, read
from .yaml_text import parse_yaml

#: Largest file in bytes; a calibration has 1 kB.
_MAX_BYTES = 2**16
#: Keys of the message CameraInfo, in lower case, by the key of the file.
_MESSAGE_KEYS = {
    "height": "image_height",
    "width": "image_width",
    "k": "camera_matrix",
    "d": "distortion_coefficients",
    "r": "rectification_matrix",
    "p": "projection_matrix",
}
_FIX = (
    "give the YAML file that ROS' camera_calibration wrote for this eye, or one like it, with image_width, "
    "image_height, camera_matrix, distortion_coefficients, rectification_matrix and projection_matrix"
)
#: Possible numbers of coefficients of each lens model. A missing fifth coefficient of plumb_bob is 0, as in OpenCV.
_COEFFICIENT_COUNTS = {"plumb_bob": (5, 4), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}
#: Largest number of pixels along a side that are read as one; cameras bin up to 16.
_MAX_BINNED = 64
#: Largest deviation of a rotation times its transpose from 1, for files with few digits.
_MAX_ROTATION_ERROR = 1e-3


@dataclass(frozen=True)
class RosCamera:
    """A camera: its matrix K (3, 3), its lens model and coefficients, the rotation R (3, 3) into the axes of the
    rectified pair, the matrix P (3, 4) there, and the size of its images. ``window`` is the part of the calibrated
    images that was read out (corner, width and height; None for the whole), and ``binning`` the number of pixels along
    x and y that form one."""

    matrix: Array
    model: str
    coefficients: tuple[float, ...]
    rectification: Array
    projection: Array
    width_px: int
    height_px: int
    window: tuple[int, int, int, int] | None = None
    binning: tuple[int, int] = (1, 1)

    @property
    def k(self) -> tuple[float, ...] | None:
        """Coefficients k1, k2, p1, p2, k3 of plumb_bob; None for other models."""
        return (*self.coefficients, 0.0)[:5] if self.model == "plumb_bob" else None


def read_ros_camera(path: Path) -> RosCamera:
    """Read a calibration. Raises IcyMoonError if the file is not one, or its lens model is not supported."""
    return read(path, _parse_camera, "a calibration of ROS", _FIX, _MAX_BYTES)


def _parse_camera(foreign: ForeignBytes) -> RosCamera:
    text = foreign.text()
    if text.startswith("%YAML:1.0"):
        raise RefusedError(f"is a calibration of OpenCV, not of ROS; {_FIX}.")
    stated = parse_yaml(text)
    if "cam0" in stated:
        raise RefusedError(f"is a camchain of Kalibr, which contains all cameras; {_FIX}.")
    if not any(key in stated for key in _MESSAGE_KEYS.values()):
        stated = {_MESSAGE_KEYS.get(key.lower(), key): value for key, value in stated.items()}
    model = str(stated.get("distortion_model", "plumb_bob"))
    if model not in _COEFFICIENT_COUNTS:
        raise RefusedError(
            f"has the lens model {model[:40]!r}, but only {', '.join(_COEFFICIENT_COUNTS)} are supported; "
            "calibrate the camera with one of them."
        )
    k = _read_numbers(stated, "distortion_coefficients", *_COEFFICIENT_COUNTS[model])
    rotation = _read_numbers(stated, "rectification_matrix", 9).reshape(3, 3)
    if not np.abs(rotation @ rotation.T - np.eye(3)).max() < _MAX_ROTATION_ERROR or np.linalg.det(rotation) < 0:
        raise ValueError("rectification_matrix is not a rotation")
    matrix = _read_numbers(stated, "camera_matrix", 9).reshape(3, 3)
    projection = _read_numbers(stated, "projection_matrix", 12).reshape(3, 4)
    whole = 0, 0, _read_whole(stated, "image_width"), _read_whole(stated, "image_height")
    window = _read_window(stated.get("roi", {}), whole)
    binning = _read_binning(stated, "binning_x"), _read_binning(stated, "binning_y")
    for each in (matrix, projection):
        each[:2, 2] -= window[:2]
        each[:2] /= np.array(binning)[:, None]
    width, height = window[2] // binning[0], window[3] // binning[1]
    return RosCamera(
        matrix,
        model,
        tuple(map(float, k)),
        rotation,
        projection,
        width,
        height,
        window if window != whole else None,
        binning,
    )


def _read_window(roi: Any, whole: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """Read the window of the calibrated images that is read out: corner, width and height, px."""
    if not isinstance(roi, dict):
        raise ValueError("roi is not a mapping")
    x, y, wide, high = (
        _read_whole(roi, key, least=0) if key in roi else 0 for key in ("x_offset", "y_offset", "width", "height")
    )
    if not (x or y or wide or high):
        return whole
    width, height = whole[2:]
    if not (0 < wide <= width - x and 0 < high <= height - y):
        raise RefusedError(
            f"has a roi of {wide} x {high} px at ({x}, {y}), which is not part of images of {width} x "
            f"{height} px; correct it, or remove roi for whole images."
        )
    return x, y, wide, high


def _read_binning(stated: dict[str, Any], key: str) -> int:
    """Read how many pixels form one; 0 counts as 1."""
    count = max(_read_whole(stated, key, least=0), 1) if key in stated else 1
    if count > _MAX_BINNED:
        raise RefusedError(f"has {key} of {count}, and at most {_MAX_BINNED} pixels are read as one; correct it.")
    return count


def _read_numbers(stated: dict[str, Any], key: str, *counts: int) -> Array:
    table = stated.get(key)
    values = table.get("data") if isinstance(table, dict) else table
    if not isinstance(values, list) or len(values) not in counts or not np.isfinite(values).all():
        raise ValueError(f"{key} has not {' or '.join(map(str, counts))} numbers")
    return np.array(values)


def _read_whole(stated: dict[str, Any], key: str, least: int = 1) -> int:
    text = str(stated.get(key, ""))
    if not text.isascii() or not text.isdecimal() or not least <= int(text[:9]) < 2**20:
        raise ValueError(f"{key} is {text[:40]!r}, not a number of pixels")
    return int(text)

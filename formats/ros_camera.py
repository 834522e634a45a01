"""Calibrations of ROS: the YAML files that ``camera_calibration`` writes, one for each eye.

Each has the matrix K and the distortion of a camera (plumb_bob: k1, k2, p1, p2, k3), and the rotation R and the matrix
P of the rectified pair; the right eye's P contains -f B (sensor_msgs/CameraInfo). Pixels are counted from the centre of
the first one. Only this subset of YAML is read: mappings by indentation, with numbers, words and lists in brackets.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..support.foreign_bytes import ForeignBytes, RefusedError, read

#: Largest file: a calibration has 1 kB.
_MOST_BYTES = 2**16
_KEY = re.compile(r"( *)([A-Za-z_]\w*):(.*)")
_FIX = "give the YAML file that ROS' camera_calibration wrote for this eye"


@dataclass(frozen=True)
class RosCamera:
    """A camera: its matrix K (3, 3), distortion ``k`` (k1, k2, p1, p2, k3), the rotation R (3, 3) into the axes of the
    rectified pair, the matrix P (3, 4) there, and the size of its images."""

    matrix: np.ndarray
    k: tuple[float, ...]
    rectification: np.ndarray
    projection: np.ndarray
    width_px: int
    height_px: int


def read_ros_camera(path: Path) -> RosCamera:
    """A calibration. Raises IcyMoonError if it is none, or of another lens than plumb_bob."""
    return read(path, _parse, "a calibration of ROS", _FIX, _MOST_BYTES)


def _parse(foreign: ForeignBytes) -> RosCamera:
    text = foreign.text()
    if text.startswith("%YAML:1.0"):
        raise RefusedError(f"is a calibration in the YAML of OpenCV, which is not read; {_FIX}.")
    stated = _parse_mapping(text)
    model = stated.get("distortion_model", "plumb_bob")
    if model != "plumb_bob":
        raise RefusedError(f"has the lens model {str(model)[:40]!r}, and plumb_bob alone is read; calibrate the camera "
                           "with it, or rectify its images first.")
    k = _numbers(stated, "distortion_coefficients", 5)
    size = [_whole(stated, key) for key in ("image_width", "image_height")]
    return RosCamera(_numbers(stated, "camera_matrix", 9).reshape(3, 3), tuple(map(float, k)),
                     _numbers(stated, "rectification_matrix", 9).reshape(3, 3),
                     _numbers(stated, "projection_matrix", 12).reshape(3, 4), *size)


def _parse_mapping(text: str) -> dict[str, Any]:
    """The keys of a text with their values; a mapping within is one of its own."""
    found: dict[str, Any] = {}
    inside: dict[str, Any] | None = None
    lines = iter(text.split("\n"))
    for line in lines:
        match = _KEY.fullmatch(line.split(" #")[0].rstrip())
        if match is None:
            if line.strip() and not line.lstrip().startswith(("#", "---", "...")):
                raise ValueError(f"{line.strip()[:40]!r} is no key with a value")
            continue
        value = match[3].strip()
        while value.startswith("[") and not value.endswith("]"):
            value += " " + next(lines, "]").strip()
        table = found if not match[1] else inside
        if table is None or match[2] in table:
            raise ValueError(f"the key {match[2]} is there twice, or in no mapping")
        table[match[2]] = _value(value)
        if not match[1]:
            inside = {} if not value else None
            if inside is not None:
                found[match[2]] = inside
    return found


def _value(text: str) -> Any:
    if text.startswith("["):
        return [float(word) for word in text[1:].removesuffix("]").split(",")]
    return text.strip("'\"")


def _numbers(stated: dict[str, Any], key: str, count: int) -> np.ndarray:
    table = stated.get(key)
    values = table.get("data") if isinstance(table, dict) else table
    if not isinstance(values, list) or len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"{key} has not {count} numbers")
    return np.array(values)


def _whole(stated: dict[str, Any], key: str) -> int:
    text = str(stated.get(key, ""))
    if not text.isascii() or not text.isdecimal() or not 0 < int(text[:9]) < 2**20:
        raise ValueError(f"{key} is {text[:40]!r}, not a number of pixels")
    return int(text)

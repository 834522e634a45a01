"""A head: a TOML file with a list of cameras beside the stereo pair, each with its role, model and pose."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera
from ...physics.camera.head_camera import (
    FRAMES,
    MAX_CAMERAS,
    ROLES,
    Equirectangular,
    HeadCamera,
    Orthographic,
    Projection,
    make_fisheye,
    make_pinhole,
)
from ...physics.camera.rotations import from_quaternion
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import is_number
from ...support.files import parse_path, quote
from ...support.foreign_bytes import ForeignBytes, parse_toml, read
from ...support.suggestions import suggest_nearest
from ...support.system import find_name_fault
from ..toml_lines import Place
from .options import LENSES, UNITS_M, Stated
from .registry import read_calibration

#: Largest file in bytes.
_MAX_BYTES = 2**20
_FIX = "give a file with [[camera]] tables"
#: Largest number of columns or rows that Blender renders.
_MAX_PX = 16384
#: Longest name of a camera; names are used as file names and in tables.
_LONGEST_NAME = 40
#: Largest deviation of a quaternion's length from 1.
_MAX_OFF = 0.1
_ANYWHERE = ("name", "role", "model", "frame", "position_m", "forward", "up", "quaternion_xyzw")
_SIZE = ("width_px", "height_px")
#: The keys of a camera that replace the options of the shell for a calibration.
_KEYS = {
    "--size WIDTHxHEIGHT": "width_px and height_px",
    "--size": "width_px and height_px",
    "--unit": "unit",
    "--lens": "lens",
}
#: Default directions of ``forward`` and ``up`` by frame: along the left eye's axes, or north and up.
_AHEAD = {"RIG": ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0))} | dict.fromkeys(
    ("GROUND", "ZERO"), ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
)


@dataclass(frozen=True)
class Head:
    """The cameras of a file, and the files that they come from: the file itself, and the calibrations that it names."""

    cameras: tuple[HeadCamera, ...]
    files: tuple[Path, ...]


def read_head(path: Path) -> Head:
    """Read the cameras of a file. Raises IcyMoonError, one sentence with the line and a fix."""
    text = read(path, ForeignBytes.text, "a head of cameras", _FIX, _MAX_BYTES)
    return _parse_head(path, text)


def _name_keys(sentence: str) -> str:
    """Replace the options in a sentence on a calibration by the keys of a head."""
    return re.sub("|".join(_KEYS), lambda found: _KEYS[found[0]], sentence)


def list_head_files(path: Path) -> list[Path]:
    """List a head's file and the calibrations that it names. If the file is no head, list it alone, because
    ``read_head`` reports the fault."""
    try:
        return list(read_head(path).files)
    except IcyMoonError:
        return [path]


@lru_cache(maxsize=8)  # a plan asks for each of its pairs; calibrations are read again only for another text
def _parse_cached(path: Path, text: str) -> dict[str, Any]:
    try:
        return parse_toml(text)
    except ValueError as error:
        raise IcyMoonError(f"{path}: is not a TOML file that can be read ({error}); {_FIX}.") from None


def _parse_head(path: Path, text: str) -> Head:
    data, place = _parse_cached(path, text), Place(path, text)
    if unknown := sorted(data.keys() - {"camera", "head", "sources"}):
        raise IcyMoonError(f"{place.at(unknown[0])}: a head has no {quote(unknown[0])}; {_FIX}.")
    tables = data.get("camera")
    if not isinstance(tables, list) or not tables or not all(isinstance(each, Mapping) for each in tables):
        raise IcyMoonError(f"{path}: has no cameras; {_FIX}.")
    if len(tables) > MAX_CAMERAS:
        raise IcyMoonError(
            f"{place.at('camera', MAX_CAMERAS)}: a head has at most {MAX_CAMERAS} cameras, not {len(tables)}; "
            "remove some."
        )
    entries = [_Entry(table, place.at("camera", k)) for k, table in enumerate(tables)]
    cameras = tuple(entry.make() for entry in entries)
    first: dict[str, int] = {}
    for k, camera in enumerate(cameras):
        same = first.setdefault(camera.name.lower(), k)
        if same != k:
            raise IcyMoonError(
                f"{place.at('camera', k, 'name')}: {quote(camera.name)} is also the name of another camera; give "
                "each camera its own name."
            )
    return Head(cameras, tuple(dict.fromkeys([path, *(file for entry in entries for file in entry.files)])))


class _Entry:
    """Reads one ``[[camera]]`` table of a head file."""

    def __init__(self, table: Mapping[str, Any], place: Place) -> None:
        self._table, self._place = table, place
        self.files: list[Path] = []

    def make(self) -> HeadCamera:
        """Make the camera. Raises IcyMoonError with its line."""
        name, model = self._name(), self._choice("model", _MODELS, None)
        keys, make_projection = _MODELS[model]
        if unknown := sorted(self._table.keys() - {*_ANYWHERE, *keys}):
            raise self._error(unknown[0], f"a camera of the model {model} has no {unknown[0]}; leave it out")
        role = self._choice("role", ROLES, "context")
        frame = self._choice("frame", FRAMES, "RIG")
        try:
            projection = make_projection(self)
        except ValueError as error:
            raise self._error("model", f"there is no such camera ({error}); correct it") from None
        size = HeadCamera(name, role, model, projection).rendered.size_px
        if max(size) > _MAX_PX:
            raise self._error(
                "model",
                f"its render would have {size[0]} x {size[1]} px, and {_MAX_PX} are the most; take fewer pixels",
            )
        return HeadCamera(name, role, model, projection, frame, *self._pose(frame, projection))

    def pinhole(self) -> Projection:
        return make_pinhole(*self._size(), self._number("field_deg", 0.1, 170.0))

    def fisheye(self) -> Projection:
        return make_fisheye(*self._size(), self._number("field_deg", 1.0, 360.0))

    def orthographic(self) -> Projection:
        return Orthographic(*self._size(), self._number("width_m", 1e-3, 1e4))

    def equirectangular(self) -> Projection:
        width, height = self._size()
        made = Equirectangular(width, height, self._number("field_deg", 1.0, 360.0))
        if made.step_rad * height > math.pi * (1 + 1e-9):
            most = int(math.pi / made.step_rad * (1 + 1e-9))
            raise self._error(
                "height_px",
                f"its rows would span {math.degrees(made.step_rad * height):.4g}°, more than 180°; "
                f"state height_px of {most} at most",
            )
        return made

    def calibrated(self) -> Projection:
        """Read the camera from a calibration file, in the axes of the first camera of that file."""
        file = self._place.file.parent / parse_path(self._text("calibration"), str(self._place.at("calibration")))
        self.files.append(file)
        sizes = (self._size(),) if self._table.keys() & {*_SIZE} else ()
        unit, lens = (self._choice(key, names, "") or None for key, names in (("unit", UNITS_M), ("lens", LENSES)))
        try:
            cameras = read_calibration([file], Stated(unit, sizes, lens)).rig.from_first().cameras
        except IcyMoonError as error:
            raise IcyMoonError(f"{self._place.at('calibration')}: {_name_keys(str(error))}") from None
        if "camera" not in self._table:
            if len(cameras) > 1:
                names = ", ".join(camera.name for camera in cameras)
                raise self._error("calibration", f"the file has the cameras {names}; choose one by camera")
            return cameras[0]
        wanted = self._text("camera")
        found = [camera for camera in cameras if camera.name == wanted]
        if not found:
            known = [camera.name for camera in cameras]
            raise self._error("camera", f"the file has no camera {quote(wanted)}, {suggest_nearest(wanted, known)}", "")
        return found[0]

    def _pose(self, frame: str, projection: Projection) -> tuple[Array, Array]:
        """Return the rotation (3, 3) from the camera's axes to its frame, and the position (3,) there, m."""
        calibrated = isinstance(projection, CalibratedCamera) and "calibration" in self._table
        if calibrated and isinstance(projection, CalibratedCamera):
            rotation, position = projection.rotation.T, projection.centre_m
            if not self._table.keys() & {"position_m", "forward", "up", "quaternion_xyzw"}:
                return rotation, position
        position = self._vector("position_m", 3, (0.0, 0.0, 0.0) if frame == "RIG" else None)
        if "quaternion_xyzw" in self._table:
            if clash := sorted(self._table.keys() & {"forward", "up"}):
                raise self._error(clash[0], f"quaternion_xyzw states the direction too; leave {clash[0]} out")
            x, y, z, w = self._vector("quaternion_xyzw", 4)
            length = math.hypot(x, y, z, w)
            if not abs(length - 1) <= _MAX_OFF:
                raise self._error("quaternion_xyzw", f"it has the length {length:.3g}; state one of the length 1")
            return from_quaternion(np.array([w, x, y, z])), position
        return self._turn(frame), position

    def _turn(self, frame: str) -> Array:
        """Return the rotation that ``forward`` and ``up`` state."""
        default = _AHEAD[frame]
        forward, up = (self._vector(key, 3, each) for key, each in zip(("forward", "up"), default, strict=True))
        right = np.cross(forward, up)
        lengths = [float(np.linalg.norm(each)) for each in (forward, up, right)]
        for key, length in zip(("forward", "up"), lengths, strict=False):
            if not length > 0:
                raise self._error(key, f"{key} has the length 0; state a vector that points somewhere")
        if lengths[2] < 1e-6 * lengths[0] * lengths[1]:
            key = "forward" if "forward" in self._table else "up"
            unsaid = "" if "up" in self._table else f", which is {list(default[1])} by default"
            raise self._error(key, f"forward is along up{unsaid}; state an up that points elsewhere")
        z, x = forward / lengths[0], right / lengths[2]
        return np.column_stack([x, np.cross(z, x), z])

    def _name(self) -> str:
        name = self._text("name")
        if not all(each.isascii() and (each.isalnum() or each in "-_") for each in name):
            raise self._error("name", f"{quote(name)} is not a name of a camera; take letters, digits, - and _")
        if fault := find_name_fault(name):
            raise self._error("name", f"Windows has no file with a name {fault}; take another name")
        if len(name) > _LONGEST_NAME:
            raise self._error("name", f"it has {len(name)} letters; take {_LONGEST_NAME} at most")
        return name

    def _size(self) -> tuple[int, int]:
        width, height = (self._number(key, 4, _MAX_PX, whole=True) for key in _SIZE)
        return int(width), int(height)

    def _text(self, key: str) -> str:
        value = self._table.get(key)
        if not isinstance(value, str) or not value:
            what = f"is {quote(value)}, not a text" if key in self._table else "is missing"
            raise self._error(key, f"{key} {what}; state it in quotes")
        return value

    def _choice(self, key: str, names: Iterable[str], default: str | None) -> str:
        value, known = self._table.get(key, default), list(names)
        if value is None:
            raise self._error(key, f"{key} is missing; state one of {', '.join(known)}")
        if value == default or value in known:
            return str(value)
        raise self._error(key, f"{key} is {quote(value)}, {suggest_nearest(str(value), known)}", "")

    def _number(self, key: str, low: float, high: float, whole: bool = False) -> float:
        value = self._table.get(key)
        if value is None:
            raise self._error(key, f"{key} is missing; state a number from {low:g} to {high:g}")
        if not is_number(value) or not low <= value <= high or (whole and value != int(value)):
            kind = "whole number" if whole else "number"
            raise self._error(key, f"{key} is {quote(value)}; state a {kind} from {low:g} to {high:g}")
        return float(value)

    def _vector(self, key: str, count: int, default: Sequence[float] | None = None) -> Array:
        value = self._table.get(key, default)
        if value is None:
            raise self._error(key, f"{key} is missing; state {count} numbers")
        if not isinstance(value, Sequence) or len(value) != count or not all(map(is_number, value)):
            raise self._error(key, f"{key} is {quote(value)}; state {count} numbers")
        if max(map(abs, value)) > 1e6:
            raise self._error(key, f"{key} is {quote(value)}, farther than 1000 km; state metres")
        return np.array(value, np.float64)

    def _error(self, key: str, clause: str, end: str = ".") -> IcyMoonError:
        named = self._table.get("name")
        who = f" (camera {quote(named)})" if isinstance(named, str) and named else ""
        return IcyMoonError(f"{self._place.at(key)}{who}: {clause}{end}")


#: For each model: its keys besides the keys of every camera, and the function that makes its projection.
_MODELS: dict[str, tuple[tuple[str, ...], Callable[[_Entry], Projection]]] = {
    "PINHOLE": ((*_SIZE, "field_deg"), _Entry.pinhole),
    "ORTHOGRAPHIC": ((*_SIZE, "width_m"), _Entry.orthographic),
    "EQUIRECTANGULAR": ((*_SIZE, "field_deg"), _Entry.equirectangular),
    "FISHEYE": ((*_SIZE, "field_deg"), _Entry.fisheye),
    "CALIBRATED": ((*_SIZE, "calibration", "camera", "unit", "lens"), _Entry.calibrated),
}

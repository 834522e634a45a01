"""Calibrations as programs with OpenCV write them: ``cv2.FileStorage`` in YAML, XML or JSON, and npz of numpy.

The matrices have the names of OpenCV's sample stereo_calib (M1, D1, M2, D2, R, T, in one file or two), or other common
names. ``x2 = R x1 + T``. T is in the unit of the board's squares, which no file of OpenCV states. Our files state it by
the key ``unit``, and also the size of the images and the lens.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.lens_models import Brown, Fisheye, LensModel
from ...support.arrays import Array
from ...support.files import quote, write_atomically, write_text
from ...support.foreign_bytes import ForeignBytes, RefusedError, explain_errors, parse_json, parse_npz, parse_xml, read
from ..yaml_text import parse_yaml, write_number
from .options import (
    LENSES,
    MAX_BYTES,
    UNITS_M,
    Reading,
    Stated,
    find_why_no_opencv_lens,
    make_brown,
    to_number_array,
    to_opencv_lens,
)

_KIND = "a calibration of OpenCV"
_FIX = "give a file with M1, D1, M2, D2, R and T, as OpenCV's stereo_calib writes them"
_WRONG_VALUE_FIX = "correct that value, or calibrate again"
#: Names of the matrices, in lower case without underscores; with 1, 2, L, R, left or right before or after them.
_MATRIX_NAMES = {
    "K": ("m", "k", "mtx", "cameramatrix", "intrinsics", "intrinsic", "cammatrix"),
    "D": ("d", "dist", "distcoeffs", "distcoeff", "distortioncoefficients", "distortion", "distortioncoeffs"),
    "size": ("imagesize", "imgsize", "size", "imageshape"),
    "width": ("imagewidth", "width"),
    "height": ("imageheight", "height"),
    "lens": ("lensmodel", "distortionmodel"),
}
_PAIR_NAMES = {
    "R": ("r", "rotation", "rotationmatrix", "rot"),
    "T": ("t", "translation", "translationvector", "trans"),
    "unit": ("unit", "units"),
}
_SIDE_NAMES = (("1", "l", "left"), ("2", "r", "right"))
#: Lenses by the value of the key ``lens_model``.
_LENS_MODELS = dict(zip(LENSES, (Brown, Fisheye), strict=True))


def read_opencv(paths: Sequence[Path], stated: Stated) -> Reading:
    """Read a calibration of one camera or of two. It is one file, or one of intrinsics and one of extrinsics."""
    found: dict[str, Any] = {}
    for path in paths:
        content = read(path, _parse, _KIND, _FIX, MAX_BYTES)
        with explain_errors(path, _KIND, "give each key in one of the files alone"):
            if twice := found.keys() & content.keys():
                raise ValueError(f"it states {quote(min(twice))} as {paths[0].name} does")
        found |= content
    with explain_errors(" with ".join(map(str, paths)), _KIND, _WRONG_VALUE_FIX):
        return _rig_of(found, stated)


def _parse(foreign: ForeignBytes) -> dict[str, Any]:
    """Parse the keys and values of a file that belong to a calibration."""
    if foreign.part(0, min(4, foreign.size)) == b"PK\x03\x04":
        arrays = parse_npz(foreign, kinds="fiubU")
        return {key: value.tolist() for key, value in arrays.items() if value.size <= 10_000}
    text = foreign.text()
    if text.lstrip().startswith("<"):
        foreign.budget.charge(16 * len(text), "numbers")
        return {each.tag: _read_element(each) for each in parse_xml(text, foreign.budget)}
    foreign.budget.charge(32 * len(text), "numbers")
    return parse_json(text) if text.lstrip().startswith("{") else parse_yaml(text)


def _read_element(element: Element) -> Any:
    """Return the value of a FileStorage element: a mapping of its children, a number, several numbers, or a text."""
    if len(element):
        return {each.tag: each.text or "" for each in element}
    words = (element.text or "").split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return (element.text or "").strip().strip('"')
    return numbers if len(numbers) != 1 else numbers[0]


def _array(value: Any, name: str) -> Array:
    """Return the flat array of a FileStorage matrix, or of lists of numbers. OpenCV 5 writes a vector with its
    ``sizes``."""
    if not isinstance(value, dict):
        return to_number_array(value, name)
    data = value.get("data")
    if isinstance(data, str):  # of XML
        data = data.split()
    found = to_number_array(data, name)
    sizes = value["sizes"] if "sizes" in value else [value["rows"], value["cols"]]
    count = math.prod(map(int, sizes.split() if isinstance(sizes, str) else to_number_array(sizes, name)))
    if not 0 < len(found) == count:
        raise ValueError(f"{name} has {len(found)} numbers, not {count} as it states")
    return found


def _find(found: Mapping[str, Any], key: str, side: int | None) -> tuple[str, Any]:
    """Find the name and the value of a key, for a ``side`` or without one; an empty name if the key is absent."""
    for name, value in found.items():
        plain = name.replace("_", "").replace(".", "").lower()
        if side is None:
            fits = plain in (_PAIR_NAMES.get(key) or _MATRIX_NAMES[key])
        else:
            fits = any(
                plain in (f"{word}{mark}", f"{mark}{word}") for word in _MATRIX_NAMES[key] for mark in _SIDE_NAMES[side]
            )
        if fits:
            return name, value
    return "", None


def _rig_of(found: Mapping[str, Any], stated: Stated) -> Reading:
    if not _find(found, "K", 0)[0]:
        if not _find(found, "K", None)[0]:
            keys = f" among {', '.join(map(quote, list(found)[:12]))}" if found else ""
            raise RefusedError(f"has no camera matrix M1{keys}; {_FIX}.")
        return Reading(CalibratedRig((_camera(found, None, stated),)))
    cameras = [_camera(found, side, stated) for side in range(2)]
    (r_name, r_value), (t_name, t_value) = _find(found, "R", None), _find(found, "T", None)
    if not (r_name and t_name):
        lacks = "T" if r_name else "R"
        raise RefusedError(f"has no {lacks}, the pose of the second camera; give the file of extrinsics too.")
    rotation, translation = _array(r_value, r_name), _array(t_value, t_name)
    if len(rotation) == 3:
        raise RefusedError(f"has a rotation vector as {r_name}; convert it to a matrix with cv2.Rodrigues.")
    if len(rotation) != 9 or len(translation) != 3:
        raise ValueError(f"{r_name} must have 9 numbers, and {t_name} 3")
    unit_name, own = _find(found, "unit", None)
    unit = own if unit_name else stated.unit
    if unit not in UNITS_M:
        told = f"{unit_name} is {quote(own)}" if unit_name else "which the file does not state"
        fix = (
            f"write one of {', '.join(UNITS_M)} there" if unit_name else f"add --unit with one of {', '.join(UNITS_M)}"
        )
        raise RefusedError(
            f"has a {t_name} that is {np.linalg.norm(translation):.6g} long in the unit of the board's squares, "
            f"{told}; {fix}."
        )
    if stated.unit not in (None, unit):
        raise RefusedError(f"states lengths in {unit}; leave out --unit {stated.unit}.")
    right = cameras[1].placed(rotation.reshape(3, 3), translation * UNITS_M[unit])
    return Reading(CalibratedRig((cameras[0], right)), (f"The baseline is in {unit}, as stated.",))


def _camera(found: Mapping[str, Any], side: int | None, stated: Stated) -> CalibratedCamera:
    number = side or 0
    name, value = _find(found, "K", side)
    if not name:
        raise RefusedError(f"has no camera matrix M{number + 1}; {_FIX}.")
    matrix = _array(value, name)
    if len(matrix) != 9:
        raise ValueError(f"{name} has {len(matrix)} numbers, not 9")
    (fx, skew, cx), (below, fy, cy), last = matrix.reshape(3, 3).tolist()
    if below or last != [0, 0, 1]:
        raise ValueError(f"{name} is not a camera matrix: 0 below fx, and 0 0 1 in its last row, are missing")
    lens = _lens(found, side, stated)
    if skew and isinstance(lens, Brown):
        raise RefusedError(f"has a skew of {skew:g} px in {name}, which OpenCV's functions leave out; set it to 0.")
    width, height = _size(found, side, stated)
    try:
        return CalibratedCamera(width, height, fx, fy, cx, cy, lens, skew, name=("left", "right")[number])
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _lens(found: Mapping[str, Any], side: int | None, stated: Stated) -> LensModel:
    name, value = _find(found, "D", side)
    if not name:
        raise RefusedError(f"has no distortion D{(side or 0) + 1}; write zeros for a pinhole.")
    numbers = _array(value, name)
    own = next((text for at in (side, None) if (text := _find(found, "lens", at)[1])), None)
    kind = own or stated.lens
    if kind is None and len(numbers) == 4:
        raise RefusedError(
            f"has 4 coefficients in {name}, which may be k1, k2, p1, p2 or those of a fisheye; add --lens brown or "
            "--lens fisheye."
        )
    if kind not in (None, *_LENS_MODELS):
        raise RefusedError(
            f"has the lens model {quote(kind)}, but only {' and '.join(_LENS_MODELS)} are supported; "
            "calibrate with one of these."
        )
    if stated.lens not in (None, kind):
        raise RefusedError(f"states the lens {kind}; leave out --lens {stated.lens}.")
    try:
        return Fisheye(tuple(numbers.tolist())) if kind == "fisheye" else make_brown(numbers.tolist())
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _size(found: Mapping[str, Any], side: int | None, stated: Stated) -> tuple[int, int]:
    for at in (side, None):
        name, value = _find(found, "size", at)
        width, height = (_find(found, key, at)[1] for key in ("width", "height"))
        if not name and None not in (width, height):
            name, value = "image_width, image_height", [width, height]
        if name:
            numbers = _array(value, name)
            if len(numbers) != 2 or not (numbers == np.floor(numbers)).all():
                raise ValueError(f"{name} is {numbers}, not width and height in pixels")
            return int(numbers[0]), int(numbers[1])
    if size := stated.size(side or 0):
        return size
    raise RefusedError("does not state the size of its images; add --size WIDTHxHEIGHT.")


def why_not_opencv(camera: CalibratedCamera) -> str:
    """Return a phrase on why OpenCV cannot store a camera; empty if it can. OpenCV's fisheye has skew."""
    lacks = find_why_no_opencv_lens(camera, 12)
    return "" if isinstance(camera.lens, Fisheye) else lacks


def write_opencv(rig: CalibratedRig, paths: Sequence[Path]) -> None:
    """Write one camera or two, as npz, XML, JSON or YAML by the suffix of the only path."""
    (path,) = paths
    stated: dict[str, Any] = {}
    for number, camera in enumerate(rig.cameras, 1):
        same, lens = to_opencv_lens(camera)
        stated |= {
            f"M{number}": same.matrix,
            f"D{number}": np.array([lens.coefficients]),
            f"lens_model{number}": "fisheye" if isinstance(lens, Fisheye) else "brown",
            f"image_size{number}": np.array([same.size_px]),
        }
    if len(rig.cameras) == 2:
        rotation, translation = rig.relative_pose()
        stated |= {"R": rotation, "T": translation[:, None], "unit": "m"}
    kind = path.suffix.lower()
    if kind == ".npz":
        write_atomically(path, lambda part: _write_npz(part, stated))
        return
    write_text(path, {".xml": _xml, ".json": _json}.get(kind, _yaml)(stated))


def _write_npz(part: Path, stated: Mapping[str, Any]) -> None:
    with part.open("wb") as stream:
        np.savez(stream, **{key: np.asarray(value) for key, value in stated.items()})


def _words(value: Array) -> list[str]:
    return [write_number(number) for number in np.asarray(value, np.float64).ravel().tolist()]


def _yaml(stated: Mapping[str, Any]) -> str:
    parts = ["%YAML:1.0", "---"]
    for key, value in stated.items():
        if isinstance(value, str):
            parts.append(f'{key}: "{value}"')
            continue
        rows, cols = value.shape
        parts += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}", "   dt: d"]
        words = _words(value)
        lines = [", ".join(words[at : at + 3]) for at in range(0, len(words), 3)]
        parts.append("   data: [ " + ",\n       ".join(lines) + " ]")
    return "\n".join([*parts, ""])


def _xml(stated: Mapping[str, Any]) -> str:
    parts = ['<?xml version="1.0"?>', "<opencv_storage>"]
    for key, value in stated.items():
        if isinstance(value, str):
            parts.append(f"<{key}>{value}</{key}>")
            continue
        rows, cols = value.shape
        words = " ".join(_words(value))
        parts.append(
            f'<{key} type_id="opencv-matrix">\n  <rows>{rows}</rows>\n  <cols>{cols}</cols>\n  <dt>d</dt>\n'
            f"  <data>\n    {words}</data></{key}>"
        )
    return "\n".join([*parts, "</opencv_storage>", ""])


def _json(stated: Mapping[str, Any]) -> str:
    return json.dumps(
        {
            key: value
            if isinstance(value, str)
            else {
                "type_id": "opencv-matrix",
                "rows": value.shape[0],
                "cols": value.shape[1],
                "dt": "d",
                "data": value.astype(float).ravel().tolist(),
            }
            for key, value in stated.items()
        },
        indent=1,
    )

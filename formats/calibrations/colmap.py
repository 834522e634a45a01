"""Models of COLMAP: ``cameras`` and ``images`` in one folder, read as text or binary, written as text.

COLMAP counts pixels from the corner of the first pixel. Lengths are in the unit of the model's scale, which is the
metre if the positions of the images are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.lens_models import Brown, Fisheye
from ...physics.camera.rotations import from_quaternion, quaternion
from ...support.errors import IcyMoonError
from ...support.files import quote, write_text
from ...support.foreign_bytes import ForeignBytes, RefusedError, explain_errors, read
from .options import Reading, Stated, find_why_no_opencv_lens, to_number_array, to_opencv_lens

_KIND = "a model of COLMAP"
_FIX = "give the folder with cameras.txt and images.txt"
_HALF_PIXEL = 0.5
#: Text files of a COLMAP model. A model may also have them as .bin.
COLMAP_FILES = ("cameras.txt", "images.txt", "points3D.txt")
#: Largest file of cameras in bytes.
_MAX_CAMERA_BYTES = 2**22
#: Largest file of images in bytes; it also states all of their points.
_MAX_IMAGE_BYTES = 2**29
#: Maximum number of images that form a rig.
_MAX_RIG_IMAGES = 1000
#: Camera models in the order of COLMAP's numbers.
_MODELS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV")
#: Number of parameters of each of these models.
_PARAMETER_COUNTS = (3, 4, 4, 5, 8, 8, 12)
_ASSUMED_UNIT = "COLMAP states no unit: one unit of its scale is assumed to be {} m."


def read_colmap(paths: Sequence[Path], stated: Stated) -> Reading:
    """Read a camera for each image of a model, in world axes and in the order of their numbers."""
    (folder,) = paths
    folder = folder if folder.is_dir() else folder.parent
    kind = next((kind for kind in (".txt", ".bin") if (folder / f"cameras{kind}").is_file()), None)
    if kind is None:
        raise IcyMoonError(f"{folder} has no cameras.txt or cameras.bin; {_FIX}.")
    parse = (_cameras_of_text, _images_of_text) if kind == ".txt" else (_cameras_of_bytes, _images_of_bytes)
    cameras = read(folder / f"cameras{kind}", parse[0], _KIND, _FIX, _MAX_CAMERA_BYTES)
    images = read(folder / f"images{kind}", parse[1], _KIND, _FIX, _MAX_IMAGE_BYTES)
    unit_m = stated.unit_m()
    found = []
    with explain_errors(folder / f"images{kind}", _KIND, _FIX):
        for _, placed, number, name in sorted(images, key=lambda image: image[0]):
            if number not in cameras:
                raise ValueError(f"{quote(name)} has the camera {number}, which is not in the file")
            rotation = from_quaternion(np.array(placed[:4]))
            found.append(
                replace(cameras[number], rotation=rotation, translation_m=np.array(placed[4:]) * unit_m, name=name)
            )
        return Reading(CalibratedRig(tuple(found)), (_ASSUMED_UNIT.format(unit_m),))


#: An image: its number; w, x, y, z and the translation; the number of its camera; its name.
_Image = tuple[int, list[float], int, str]


def _camera(model: str, width: int, height: int, p: list[float]) -> CalibratedCamera:
    """Make a camera from COLMAP's model and parameters."""
    if model not in _MODELS:
        raise RefusedError(f"has the camera model {quote(model)}; run COLMAP with one of {', '.join(_MODELS)}.")
    if len(p) != _PARAMETER_COUNTS[_MODELS.index(model)]:
        raise ValueError(f"{model} has {len(p)} parameters")
    if model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"):
        p = [p[0], *p]
    fx, fy, cx, cy, *k = p
    if model == "OPENCV_FISHEYE":
        lens: Brown | Fisheye = Fisheye(tuple(k))
    else:
        lens = Brown((*k, *(0.0,) * ((8 if len(k) > 4 else 5) - len(k))))
    return CalibratedCamera(width, height, fx, fy, cx - _HALF_PIXEL, cy - _HALF_PIXEL, lens)


def _cameras_of_text(foreign: ForeignBytes) -> dict[int, CalibratedCamera]:
    found = {}
    for number, line in foreign.lines():
        words = line.decode().split()
        if words and not words[0].startswith("#"):
            try:
                parameters = to_number_array(words[4:], "its parameters").tolist()
                found[int(words[0])] = _camera(words[1], int(words[2]), int(words[3]), parameters)
            except (ValueError, IndexError) as error:
                raise ValueError(f"line {number}: {error}") from None
    return found


def _images_of_text(foreign: ForeignBytes) -> list[_Image]:
    """Parse the images of a text. Every second line states the points of an image, and may be empty."""
    found: list[_Image] = []
    is_points = False
    for number, line in foreign.lines(longest=2**24):
        if line.startswith(b"#") or (not line.strip() and not is_points):
            continue
        if not is_points:
            words = line.decode().split(maxsplit=9)
            if len(words) != 10 or len(found) == _MAX_RIG_IMAGES:
                raise ValueError(f"line {number} is not an image with a pose, or there are more than {_MAX_RIG_IMAGES}")
            placed = to_number_array(words[1:8], f"line {number}").tolist()
            found.append((int(words[0]), placed, int(words[8]), words[9].strip()))
        is_points = not is_points
    return found


def _cameras_of_bytes(foreign: ForeignBytes) -> dict[int, CalibratedCamera]:
    cursor = foreign.cursor()
    found = {}
    for _ in range(cursor.number("<Q")):
        number, model, width, height = cursor.unpack("<iiQQ")
        if not 0 <= model < len(_MODELS):
            raise RefusedError(f"has a camera model of number {model}; run COLMAP with one of {', '.join(_MODELS)}.")
        found[number] = _camera(_MODELS[model], width, height, list(cursor.unpack(f"<{_PARAMETER_COUNTS[model]}d")))
    return found


def _images_of_bytes(foreign: ForeignBytes) -> list[_Image]:
    cursor = foreign.cursor()
    count = cursor.number("<Q")
    if count > _MAX_RIG_IMAGES:
        raise ValueError(f"it has {count} images, more than {_MAX_RIG_IMAGES}")
    found: list[_Image] = []
    for _ in range(count):
        number, *placed, camera = cursor.unpack("<I7dI")
        name = cursor.take_until(b"\0", 4096).decode()
        cursor.skip(24 * cursor.number("<Q"))
        found.append((number, list(placed), camera, name))
    return found


def why_not_colmap(camera: CalibratedCamera) -> str:
    """Return a phrase on why COLMAP cannot store a camera; empty if it can."""
    return find_why_no_opencv_lens(camera, 8)


def write_colmap(rig: CalibratedRig, paths: Sequence[Path]) -> None:
    """Write ``cameras.txt``, ``images.txt`` and an empty ``points3D.txt`` into the folder."""
    (folder,) = paths
    cameras, images = [], []
    for number, camera in enumerate(rig.cameras, 1):
        model, parameters = _list_lens_parameters(camera)
        words = " ".join(map(repr, parameters))
        cameras.append(f"{number} {model} {camera.width_px} {camera.height_px} {words}\n")
        placed = [*quaternion(camera.rotation), *camera.translation_m]
        name = camera.name or f"camera{number}"
        images.append(f"{number} {' '.join(repr(float(value)) for value in placed)} {number} {name}\n\n")
    write_text(folder / "cameras.txt", "".join(cameras))
    write_text(folder / "images.txt", "".join(images))
    write_text(folder / "points3D.txt", "")


def _list_lens_parameters(camera: CalibratedCamera) -> tuple[str, list[float]]:
    same, lens = to_opencv_lens(camera)
    common = [same.fx_px, same.fy_px, same.cx_px + _HALF_PIXEL, same.cy_px + _HALF_PIXEL]
    k = lens.coefficients
    if isinstance(lens, Fisheye):
        return "OPENCV_FISHEYE", [*common, *k]
    if not any(k):
        return "PINHOLE", common
    return ("FULL_OPENCV", [*common, *(*k, 0.0, 0.0, 0.0)[:8]]) if any(k[4:]) else ("OPENCV", [*common, *k[:4]])

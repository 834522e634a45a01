"""Camera models of mrcal: a ``.cameramodel`` for each camera, a Python literal with comments.

Extrinsics are a rotation vector and a translation from reference axes to the camera's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.lens_models import Brown, Cahvore, LensModel
from ...physics.camera.rotations import from_vector, to_vector
from ...support.files import quote, write_text
from ...support.foreign_bytes import ForeignBytes, RefusedError, read
from ..yaml_text import parse_flow
from .options import (
    MAX_BYTES,
    Reading,
    Stated,
    convert_to_brown,
    convert_to_cahvore,
    describe_skew,
    format_numbers,
    make_brown,
    to_number_array,
)

_KIND = "a camera model of mrcal"
_FIX = "give the file .cameramodel that mrcal-calibrate-cameras wrote"
_CAHVORE_PREFIX = "LENSMODEL_CAHVORE_linearity="
_PARAMETER_COUNTS = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
    "LENSMODEL_CAHVOR": 5,
}
#: Keys of the pose in the versions of mrcal.
_POSE_KEYS = ("extrinsics", "rt_cam_ref", "rt_fromref")


def read_mrcal(paths: Sequence[Path], _: Stated) -> Reading:
    """Read a camera from each file, in their common reference axes."""
    found = [read(path, _parse, _KIND, _FIX, MAX_BYTES) for path in paths]
    return Reading(CalibratedRig(tuple(found)))


def _parse(foreign: ForeignBytes) -> CalibratedCamera:
    lines = [line.strip() for line in foreign.text().split("\n")]
    # Drop the measurements, which are one line of bytes.
    kept = [line for line in lines if not line.startswith(("#", "'optimization_inputs'", '"optimization_inputs"'))]
    model = parse_flow("\n".join(kept))
    if not isinstance(model, dict):
        raise ValueError("it is not a table")
    name = str(model.get("lensmodel", model.get("lens_model")))
    fx, fy, cx, cy, *more = to_number_array(model["intrinsics"], "intrinsics").tolist()
    lens = _lens(name, more)
    pose = next((model[key] for key in _POSE_KEYS if key in model), None)
    if pose is None:
        raise ValueError("extrinsics are missing")
    vector = to_number_array(pose, "extrinsics", 6)
    width, height = map(int, to_number_array(model["imagersize"], "imagersize", 2))
    return CalibratedCamera(
        width,
        height,
        fx,
        fy,
        cx,
        cy,
        lens,
        0.0,
        from_vector(vector[:3]),
        vector[3:],
        Path(foreign.name).stem,
    )


def _lens(name: str, numbers: list[float]) -> LensModel:
    """Make the lens of a model of mrcal; ``numbers`` follow fx, fy, cx, cy."""
    if name.startswith(_CAHVORE_PREFIX):
        linearity = float(name.removeprefix(_CAHVORE_PREFIX)[:20])
        if len(numbers) != 8:
            raise ValueError(f"{name} has {len(numbers) + 4} intrinsics, not 12")
        return Cahvore(_axis(*numbers[:2]), tuple(numbers[2:5]), tuple(numbers[5:]), linearity)
    if name not in _PARAMETER_COUNTS:
        raise RefusedError(
            f"has the lens model {quote(name)}, which is not supported; convert it with mrcal-convert-lensmodel "
            "LENSMODEL_OPENCV8."
        )
    if len(numbers) != _PARAMETER_COUNTS[name]:
        raise ValueError(f"{name} has {len(numbers) + 4} intrinsics, not {_PARAMETER_COUNTS[name] + 4}")
    if name == "LENSMODEL_CAHVOR":
        return Cahvore(_axis(*numbers[:2]), tuple(numbers[2:]))
    return make_brown(numbers) if numbers else Brown()


def _axis(alpha: float, beta: float) -> tuple[float, ...]:
    """Return the optical axis for two angles in rad."""
    return math.sin(alpha) * math.cos(beta), math.sin(beta), math.cos(alpha) * math.cos(beta)


def why_not_mrcal(camera: CalibratedCamera) -> str:
    """Return a phrase on why mrcal cannot store a camera; empty if it can."""
    return (
        describe_skew(camera)
        if convert_to_brown(camera) or convert_to_cahvore(camera)
        else f"no lens like {camera.lens.name}"
    )


def write_mrcal(rig: CalibratedRig, paths: Sequence[Path]) -> None:
    """Write a file for each camera."""
    for camera, path in zip(rig.cameras, paths, strict=True):
        write_text(path, _text(camera))


def _text(camera: CalibratedCamera) -> str:
    camera = convert_to_brown(camera) or convert_to_cahvore(camera) or camera
    lens = camera.lens
    if isinstance(lens, Cahvore):
        x, y, z = lens.axis
        numbers = [math.atan2(x, z), math.asin(max(-1.0, min(1.0, y))), *lens.radial, *(lens.pupil or ())]
        name = "LENSMODEL_CAHVOR" if lens.pupil is None else f"{_CAHVORE_PREFIX}{lens.linearity!r}"
    else:
        assert isinstance(lens, Brown)
        numbers = list(lens.shortened())
        name = f"LENSMODEL_OPENCV{len(numbers)}" if numbers else "LENSMODEL_PINHOLE"
    intrinsics = format_numbers([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *numbers])
    pose = format_numbers(np.concatenate([to_vector(camera.rotation), camera.translation_m]))
    return (
        "{\n"
        f"    'lensmodel':  '{name}',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': [ {intrinsics},],\n\n"
        "    # extrinsics are rt_fromref\n"
        f"    'extrinsics': [ {pose},],\n\n"
        f"    'imagersize': [ {camera.width_px}, {camera.height_px},]\n"
        "}\n"
    )

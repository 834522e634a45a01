"""Camchains of Kalibr: ``cam0``, ``cam1`` and more in one YAML file, each with its pose from the previous one, in
metres."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.arm.kinematics import make_rigid_transform as rigid_pose
from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.lens_models import Brown, Fisheye, LensModel
from ...support.files import quote, write_text
from ...support.foreign_bytes import ForeignBytes, RefusedError, describe_reason, explain_errors, read
from ..yaml_text import parse_yaml
from .options import (
    MAX_BYTES,
    Reading,
    Stated,
    find_why_no_opencv_lens,
    format_numbers,
    split_pose,
    to_number_array,
    to_opencv_lens,
)

_KIND = "a camchain of Kalibr"
_FIX = "give the file camchain.yaml that kalibr_calibrate_cameras wrote"


def read_kalibr(paths: Sequence[Path], _: Stated) -> Reading:
    """Read all cameras of a camchain, in the axes of its first camera."""
    (path,) = paths
    return read(path, _parse, _KIND, _FIX, MAX_BYTES)


def _parse(foreign: ForeignBytes) -> Reading:
    chain = parse_yaml(foreign.text())
    names = [f"cam{k}" for k in range(len(chain)) if f"cam{k}" in chain]
    if not names:
        raise ValueError("it has no cam0")
    cameras: list[CalibratedCamera] = []
    pose = np.eye(4)
    for number, name in enumerate(names):
        entry = chain[name]
        if not isinstance(entry, dict):
            raise ValueError(f"{name} is {quote(entry)}, not a mapping")
        try:
            if number:
                if "T_cn_cnm1" not in entry:
                    raise ValueError("T_cn_cnm1 is missing, the pose from the camera before")
                rotation, shift = split_pose(to_number_array(entry["T_cn_cnm1"], "T_cn_cnm1", 4, 4))
                # Making the camera checks the rotation before it is chained with others.
                step = _camera(entry, name).placed(rotation, shift)
                pose = rigid_pose(step.rotation, step.translation_m) @ pose
            cameras.append(_camera(entry, name).placed(pose[:3, :3], pose[:3, 3]))
        except (ValueError, KeyError) as error:
            raise ValueError(f"{name}: {describe_reason(error)}") from None
    return Reading(CalibratedRig(tuple(cameras)))


def _camera(entry: dict[str, Any], name: str) -> CalibratedCamera:
    if entry.get("camera_model") != "pinhole":
        raise RefusedError(
            f"{name} has the camera model {quote(entry.get('camera_model'))}, but only pinhole is supported; calibrate "
            "it as pinhole-radtan or pinhole-equi."
        )
    fx, fy, cx, cy = to_number_array(entry["intrinsics"], "intrinsics", 4).tolist()
    width, height = map(int, to_number_array(entry["resolution"], "resolution", 2))
    return CalibratedCamera(width, height, fx, fy, cx, cy, _lens(entry, name), name=name)


def _lens(entry: dict[str, Any], name: str) -> LensModel:
    model = entry.get("distortion_model", "none")
    if model == "none":
        return Brown()
    if model not in ("radtan", "equidistant"):
        raise RefusedError(
            f"{name} has the distortion model {quote(model)}, but only radtan, equidistant and none are supported; "
            "calibrate it as pinhole-radtan or pinhole-equi."
        )
    numbers = to_number_array(entry["distortion_coeffs"], "distortion_coeffs", 4).tolist()
    return Brown((*numbers, 0.0)) if model == "radtan" else Fisheye(tuple(numbers))


def why_not_kalibr(camera: CalibratedCamera) -> str:
    """Return a phrase on why Kalibr cannot store a camera; empty if it can."""
    return find_why_no_opencv_lens(camera, 4)


def write_kalibr(rig: CalibratedRig, paths: Sequence[Path]) -> None:
    """Write all cameras of a rig."""
    (path,) = paths
    lines = []
    before = np.eye(4)
    for number, camera in enumerate(rig.from_first().cameras):
        same, lens = to_opencv_lens(camera)
        pose = rigid_pose(same.rotation, same.translation_m)
        lines.append(f"cam{number}:")
        if number:
            lines.append("  T_cn_cnm1:")
            lines += [f"  - [{format_numbers(row)}]" for row in pose @ np.linalg.inv(before)]
        before = pose
        lines += [
            "  camera_model: pinhole",
            f"  distortion_coeffs: [{format_numbers(lens.coefficients[:4])}]",
            f"  distortion_model: {'radtan' if isinstance(lens, Brown) else 'equidistant'}",
            f"  intrinsics: [{format_numbers([same.fx_px, same.fy_px, same.cx_px, same.cy_px])}]",
            f"  resolution: [{same.width_px}, {same.height_px}]",
        ]
    with explain_errors(path, _KIND, "write to another folder"):
        write_text(path, "\n".join([*lines, ""]))

"""Cameras of JPL: a ``.cahvor`` file or a PDS3 label for each, with CAHV, CAHVOR or CAHVORE; see ``formats.cahvor``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.lens_models import Brown, Cahvore, LensModel
from ...support.errors import IcyMoonError
from ...support.files import write_text
from ...support.foreign_bytes import explain_errors
from ..cahvor import Cahvor, make_cahvor_text, make_model_from_pinhole, make_pds_text, read_model
from .options import Reading, Stated, convert_to_cahvore, describe_skew

#: The coordinate system that labels name.
_FRAME_NAME = "REFERENCE_AXES"


def read_cahv(paths: Sequence[Path], _: Stated) -> Reading:
    """Read a camera from each file, in their common axes."""
    found = []
    for path in paths:
        model = read_model(path)
        with explain_errors(path, "a camera model", "correct its vectors"):
            found.append(_camera(model, path.stem))
    return Reading(CalibratedRig(tuple(found)))


def _camera(model: Cahvor, name: str) -> CalibratedCamera:
    matrix, rotation = model.pinhole()
    lens: LensModel = Brown()
    if model.o is not None and model.r is not None:
        axis = rotation @ model.o
        pupil = None if model.e is None else tuple(model.e.tolist())
        lens = Cahvore(tuple(axis.tolist()), tuple(model.r.tolist()), pupil, model.linearity)
    (fx, _, cx), (_, fy, cy) = matrix[:2].tolist()
    shift = -rotation @ model.c
    return CalibratedCamera(model.width_px, model.height_px, fx, fy, cx, cy, lens, 0.0, rotation, shift, name)


def why_not_cahv(camera: CalibratedCamera) -> str:
    """Return a phrase on why CAHVORE cannot store a camera; empty if it can."""
    return describe_skew(camera) if convert_to_cahvore(camera) else f"no lens equal to {camera.lens.name}"


def write_cahv(rig: CalibratedRig, paths: Sequence[Path]) -> None:
    """Write a file for each camera; a suffix .lbl makes a PDS3 label."""
    for camera, path in zip(rig.cameras, paths, strict=True):
        model = to_cahv_model(camera)
        write_text(
            path, make_pds_text(model, _FRAME_NAME) if path.suffix.lower() == ".lbl" else make_cahvor_text(model)
        )


def find_nearest_model(camera: CalibratedCamera) -> Cahvor:
    """Find the model that equals a camera, or that is fitted to its lens of Brown and Conrady. Raises IcyMoonError
    without such a model, or if the fit is off by more than ``FIT_LIMIT_PX``."""
    lens = camera.lens
    if (
        isinstance(lens, Brown)
        and convert_to_cahvore(camera) is None
        and len(lens.shortened()) <= 5
        and not camera.skew_px
    ):
        return make_model_from_pinhole(
            camera.matrix, camera.rotation, camera.centre_m, camera.size_px, lens.coefficients[:5]
        )
    if lacks := why_not_cahv(camera):
        raise IcyMoonError(f"CAHVORE has {lacks} (camera {camera.name}); export raw, which has all lenses.")
    return to_cahv_model(camera)


def to_cahv_model(camera: CalibratedCamera) -> Cahvor:
    """Convert a camera to its CAHV, CAHVOR or CAHVORE model, if its lens has one, see ``why_not_cahv``."""
    camera = convert_to_cahvore(camera) or camera
    right, down, a = camera.rotation
    h, v = camera.fx_px * right + camera.cx_px * a, camera.fy_px * down + camera.cy_px * a
    plain = (camera.centre_m, a, h, v, camera.width_px, camera.height_px)
    lens = camera.lens
    if not isinstance(lens, Cahvore):
        return Cahvor(*plain)
    pupil = None if lens.pupil is None else np.array(lens.pupil)
    return Cahvor(*plain, np.array(lens.axis) @ camera.rotation, np.array(lens.radial), pupil, lens.linearity)

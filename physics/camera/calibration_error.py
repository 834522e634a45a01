"""A calibration with errors: the rig as it is assumed to be, from the true one and the ``calibration_error`` settings.

The eyes took their images as they are. Rectification and depth use what is assumed of them: the rectified pair has the
assumed focal length and baseline, and the principal point of both eyes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...settings.topics.camera import CalibrationErrorSettings, RigSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .calibrated_camera import CalibratedCamera
from .lens_distortion import COEFFICIENTS, read_coefficients
from .lens_models import Brown
from .rotations import from_vector
from .stereo_camera import StereoCamera


def list_stated_errors(errors: CalibrationErrorSettings) -> dict[str, float]:
    """The errors that are not 0, by the keys of the settings."""
    return {key: float(value) for key, value in errors.items() if value != 0}


def make_assumed_camera(camera: StereoCamera, errors: CalibrationErrorSettings) -> StereoCamera:
    """The rectified rig that is assumed, by which disparity becomes depth. Without an error it is ``camera``."""
    return replace(
        camera,
        focal_px=camera.focal_px * _factor(errors.focal_percent),
        baseline_m=camera.baseline_m * _factor(errors.baseline_percent),
    )


def make_assumed_eye(
    camera: StereoCamera, rig: RigSettings, errors: CalibrationErrorSettings, eye: str
) -> CalibratedCamera:
    """An eye as it is assumed to be, turned from the axes of the rectified rig; its place is left at 0.

    The errors of yaw, pitch and roll are one rotation vector in the eye's own axes.
    """
    right = float(eye == "right")
    focal_px = camera.focal_px * _factor(errors.focal_percent) * _factor(right * errors.right_focal_percent)
    k = dict(zip(COEFFICIENTS, read_coefficients(rig), strict=True))
    k["k1"] += errors.k1 + right * errors.right_k1
    # In x right, y down, z forward, a turn about +y is to the right, about +x up and about +z clockwise.
    turn = np.radians([-errors.right_pitch_deg, errors.right_yaw_deg, errors.right_roll_deg]) * right
    return CalibratedCamera(
        camera.width_px,
        camera.height_px,
        focal_px,
        focal_px,
        camera.cx_px - 0.5 + right * errors.right_column_px,
        camera.cy_px - 0.5 + right * errors.right_row_px,
        Brown(tuple(k.values())),
        rotation=from_vector(turn).T @ camera.eye_rotation(eye),
    )


def moves_pixels(camera: StereoCamera, rig: RigSettings, errors: CalibrationErrorSettings, eye: str) -> bool:
    """Whether the errors change the rectified image of an eye. The same error of both focal lengths does so only where
    a lens distorts or an eye is turned."""
    wrong = list_stated_errors(errors)
    if eye == "right" and any(key.startswith("right_") for key in wrong):
        return True
    return "k1" in wrong or ("focal_percent" in wrong and (any(read_coefficients(rig)) or camera.toe_in_deg != 0))


def make_rectifying_map(camera: StereoCamera, rig: RigSettings, errors: CalibrationErrorSettings, eye: str) -> Array:
    """Where the pixels of the rectified image of an eye are assumed to be in the image of its sensor: columns and rows
    (H, W, 2), counted from the centre of the first pixel; NaN where nowhere.

    Raises IcyMoonError if no pixel is anywhere in the image.
    """
    assumed, seen_by = make_assumed_camera(camera, errors), make_assumed_eye(camera, rig, errors, eye)
    columns, rows = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    x, y = (columns - camera.cx_px) / assumed.focal_px, (rows - camera.cy_px) / assumed.focal_px
    found = seen_by.project(np.stack([x, y, np.ones_like(x)], axis=-1))
    with np.errstate(invalid="ignore"):
        inside = ((found >= 0) & (found <= np.array(seen_by.size_px) - 1)).all(axis=-1)
    if not inside.any():
        stated = ", ".join(f"calibration_error.{key} {value:g}" for key, value in list_stated_errors(errors).items())
        raise IcyMoonError(f"With {stated} the rectified image of the {eye} eye would see nothing of it; lower them.")
    return np.asarray(found)


def refuse_errors(errors: CalibrationErrorSettings, where: object) -> None:
    """Raise IcyMoonError if there is an error: true disparities fit no images that it rectified."""
    for key, value in list_stated_errors(errors).items():
        raise IcyMoonError(
            f"{where}: calibration_error.{key} is {value:g}, and images rectified by it do not fit the true "
            "disparities beside them; set it to 0 here, and use it to evaluate."
        )


def _factor(percent: float) -> float:
    return 1.0 + float(percent) / 100.0


def describe_errors(errors: CalibrationErrorSettings) -> list[str]:
    """A sentence on the errors in force; none without any."""
    stated = ", ".join(f"calibration_error.{key} {value:+g}" for key, value in list_stated_errors(errors).items())
    return [f"An error of the calibration is in force: {stated}."] if stated else []

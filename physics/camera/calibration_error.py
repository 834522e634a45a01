"""A calibration with errors: the assumed rig, from the true rig and the ``calibration_error`` settings.

Images are taken with the true eyes. Rectification and depth use the assumed eyes: the rectified pair has the assumed
focal length, baseline and principal point.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...settings.topics.camera import CalibrationErrorSettings, RigSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .calibrated_camera import CalibratedCamera
from .lens_distortion import read_coefficients
from .lens_models import Brown, Cahvore, LensModel
from .rotations import from_vector
from .stereo_camera import StereoCamera


def list_stated_errors(errors: CalibrationErrorSettings) -> dict[str, float]:
    """List the errors that are not 0, by the keys of the settings."""
    return {key: float(value) for key, value in errors.items() if value != 0}


def make_assumed_camera(camera: StereoCamera, errors: CalibrationErrorSettings) -> StereoCamera:
    """Make the assumed rectified rig, which converts disparity to depth. Without errors it equals ``camera``."""
    return replace(
        camera,
        focal_px=camera.focal_px * _factor(errors.focal_percent),
        baseline_m=camera.baseline_m * _factor(errors.baseline_percent),
    )


def make_assumed_eye(
    camera: StereoCamera, rig: RigSettings, errors: CalibrationErrorSettings, eye: str
) -> CalibratedCamera:
    """Make the assumed ``eye``, rotated from the axes of the rectified rig; its position stays 0. The errors of yaw,
    pitch and roll form one rotation vector in the eye's axes.
    """
    right = float(eye == "right")
    stretch = _factor(errors.focal_percent) * _factor(right * errors.right_focal_percent)
    # In x right, y down, z forward, a turn about +y is to the right, about +x up and about +z clockwise.
    turn = np.radians([-errors.right_pitch_deg, errors.right_yaw_deg, errors.right_roll_deg]) * right
    true = _make_true_eye(camera, rig, eye)
    return replace(
        true,
        fx_px=true.fx_px * stretch,
        fy_px=true.fy_px * stretch,
        skew_px=true.skew_px * stretch,
        cx_px=true.cx_px + right * errors.right_column_px,
        cy_px=true.cy_px + right * errors.right_row_px,
        lens=_add_radial_error(true.lens, errors.k1 + right * errors.right_k1),
        rotation=from_vector(turn).T @ true.rotation,
    )


def _make_true_eye(camera: StereoCamera, rig: RigSettings, eye: str) -> CalibratedCamera:
    """Make the true ``eye``, rotated from the axes of the rectified rig; its position stays 0."""
    if camera.eyes is not None:
        calibrated = camera.eyes[eye == "right"]
        return calibrated.placed(calibrated.rotation, np.zeros(3))
    lens, (cx_px, cy_px) = Brown(read_coefficients(rig)), (camera.cx_px - 0.5, camera.cy_px - 0.5)
    size = camera.width_px, camera.height_px
    rotation = camera.eye_rotation(eye)
    return CalibratedCamera(*size, camera.focal_px, camera.focal_px, cx_px, cy_px, lens, rotation=rotation)


def _add_radial_error(lens: LensModel, error: float) -> LensModel:
    """Add ``error`` to a lens's coefficient of r² (k1, or R1 of CAHVORE)."""
    if isinstance(lens, Cahvore):
        r0, r1, r2 = lens.radial
        return replace(lens, radial=(r0, r1 + error, r2))
    first, *others = lens.coefficients
    return replace(lens, coefficients=(first + error, *others))


def moves_pixels(camera: StereoCamera, rig: RigSettings, errors: CalibrationErrorSettings, eye: str) -> bool:
    """Return whether the errors change the rectified image of an eye. An equal error of both focal lengths changes it
    only if a lens distorts or an eye is rotated.
    """
    wrong = list_stated_errors(errors)
    if eye == "right" and any(key.startswith("right_") for key in wrong):
        return True
    turned = camera.eyes is not None or any(read_coefficients(rig)) or camera.toe_in_deg != 0
    return "k1" in wrong or ("focal_percent" in wrong and turned)


def make_rectifying_map(camera: StereoCamera, rig: RigSettings, errors: CalibrationErrorSettings, eye: str) -> Array:
    """Make the map from the rectified image of an eye to the image of its sensor, by the assumed calibration: columns
    and rows (H, W, 2), counted from the centre of the first pixel, at each rectified pixel. Positions outside the
    sensor are kept; pixels outside the lens's field are NaN. Raises IcyMoonError if no pixel is inside the sensor.
    """
    assumed, seen_by = make_assumed_camera(camera, errors), make_assumed_eye(camera, rig, errors, eye)
    columns, rows = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    x, y = (columns - camera.cx_px) / assumed.focal_px, (rows - camera.cy_px) / assumed.focal_px
    found = seen_by.project(np.stack([x, y, np.ones_like(x)], axis=-1))
    with np.errstate(invalid="ignore"):
        inside = ((found >= 0) & (found <= np.array(seen_by.size_px) - 1)).all(axis=-1)
    if not inside.any():
        stated = ", ".join(f"calibration_error.{key} {value:g}" for key, value in list_stated_errors(errors).items())
        raise IcyMoonError(f"With {stated} the rectified image of the {eye} eye would be empty; lower these errors.")
    return np.asarray(found)


def refuse_calibration_errors(errors: CalibrationErrorSettings, where: object) -> None:
    """Raise IcyMoonError if there is an error, because true disparities do not fit images that are rectified with
    it.
    """
    for key, value in list_stated_errors(errors).items():
        raise IcyMoonError(
            f"{where}: calibration_error.{key} is {value:g}, and images rectified by it do not fit the true "
            "disparities beside them; set it to 0 here, and use it to evaluate."
        )


def _factor(percent: float) -> float:
    """Return the factor 1 + percent / 100."""
    return 1.0 + float(percent) / 100.0


def describe_errors(errors: CalibrationErrorSettings) -> list[str]:
    """Describe the errors in force by a sentence in a list; an empty list without errors."""
    stated = ", ".join(f"calibration_error.{key} {value:+g}" for key, value in list_stated_errors(errors).items())
    return [f"An error of the calibration is in force: {stated}."] if stated else []

"""Code that readers and writers of calibrations share: options of the user, results, and conversions of lenses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.lens_distortion import COEFFICIENTS
from ...physics.camera.lens_models import Brown, Cahvore, Fisheye
from ...support.arrays import Array
from ...support.files import quote
from ..yaml_text import write_number

#: Metres per unit that a translation may have.
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
#: Words for the lens of four coefficients.
LENSES = ("brown", "fisheye")
#: Largest calibration file in bytes; one with all measurements has a few megabytes.
MAX_BYTES = 2**22
#: The coefficients of Brown and Conrady's lens in OpenCV's order.
BROWN_NAMES = (*COEFFICIENTS, "k4", "k5", "k6", "s1", "s2", "s3", "s4")
#: Largest cosine or coefficient that counts as a rounded zero.
_MAX_ROUNDING = 1e-12


@dataclass(frozen=True)
class Stated:
    """The user's options for facts that a file may omit: the ``unit`` of lengths, the ``sizes`` of the images of each
    camera (or one for all), and the ``lens``, brown or fisheye."""

    unit: str | None = None
    sizes: tuple[tuple[int, int], ...] = ()
    lens: str | None = None

    def unit_m(self, default: str = "m") -> float:
        """Return the metres per unit of lengths; ``default`` names the unit if the user stated none."""
        return UNITS_M[self.unit or default]

    def size(self, number: int) -> tuple[int, int] | None:
        """Return columns and rows of a camera's images as the user gave them; None without them."""
        return self.sizes[min(number, len(self.sizes) - 1)] if self.sizes else None


@dataclass(frozen=True)
class Reading:
    """The rig of a calibration, and sentences on the assumptions made."""

    rig: CalibratedRig
    notes: tuple[str, ...] = ()


def convert_to_brown(camera: CalibratedCamera) -> CalibratedCamera | None:
    """Return the same camera with an equivalent lens of Brown and Conrady; None if no such lens is equivalent."""
    lens = camera.lens
    if isinstance(lens, Brown):
        return camera
    if not (isinstance(lens, Cahvore) and lens.pupil is None and _is_along(lens)):
        return None
    scale, r1, r2 = 1 + lens.radial[0], *lens.radial[1:]
    brown = Brown((r1 / scale, r2 / scale, 0.0, 0.0, 0.0))
    return replace(
        camera, fx_px=camera.fx_px * scale, fy_px=camera.fy_px * scale, skew_px=camera.skew_px * scale, lens=brown
    )


def convert_to_fisheye(camera: CalibratedCamera) -> CalibratedCamera | None:
    """Return the same camera with an equivalent fisheye lens of Kannala and Brandt; None if no such lens is
    equivalent."""
    lens = camera.lens
    if isinstance(lens, Fisheye):
        return camera
    if not (isinstance(lens, Cahvore) and lens.pupil is not None and lens.linearity == 0 and _is_along(lens)):
        return None
    if any(lens.pupil) or lens.radial[0]:
        return None
    return replace(camera, lens=Fisheye((*lens.radial[1:], 0.0, 0.0)))


def convert_to_cahvore(camera: CalibratedCamera) -> CalibratedCamera | None:
    """Return the same camera with an equivalent lens of CAHVOR or CAHVORE, or as a pinhole; None if no such lens is
    equivalent."""
    lens = camera.lens
    if isinstance(lens, Cahvore):
        return camera
    axis = (0.0, 0.0, 1.0)
    if isinstance(lens, Fisheye):
        k1, k2, *more = lens.coefficients
        return None if any(more) else replace(camera, lens=Cahvore(axis, (0.0, k1, k2), (0.0,) * 3, 0.0))
    k1, k2, *more = lens.coefficients
    if any(more):
        return None
    return replace(camera, lens=Cahvore(axis, (0.0, k1, k2))) if k1 or k2 else camera


def _is_along(lens: Cahvore) -> bool:
    """Return whether the optical axis of the distortion is the camera's."""
    return abs(lens.axis[0]) < _MAX_ROUNDING and abs(lens.axis[1]) < _MAX_ROUNDING


def to_opencv_lens(camera: CalibratedCamera) -> tuple[CalibratedCamera, Brown | Fisheye]:
    """Return the same camera with an equivalent lens of OpenCV, and that lens. Raises ValueError if no lens of OpenCV
    is equivalent."""
    same = convert_to_brown(camera) or convert_to_fisheye(camera)
    if same is None or isinstance(same.lens, Cahvore):
        raise ValueError(f"no lens like {camera.lens.name}")
    return same, same.lens


def find_why_no_opencv_lens(camera: CalibratedCamera, most: int) -> str:
    """Return a phrase on why a format with OpenCV's lenses, but without skew, cannot store a camera; empty if it can.
    ``most`` is the largest number of Brown and Conrady's coefficients in the format."""
    try:
        _, lens = to_opencv_lens(camera)
    except ValueError as error:
        return str(error)
    if isinstance(lens, Brown) and any(lens.coefficients[most:]):
        return f"no coefficients beyond {', '.join(BROWN_NAMES[:most])}"
    return describe_skew(camera)


def describe_skew(camera: CalibratedCamera) -> str:
    """Return a phrase on the skew that a format without skew cannot store; empty for a camera without skew."""
    return f"no skew, which is {camera.skew_px:g} px" if camera.skew_px else ""


def make_brown(numbers: Sequence[float]) -> Brown:
    """Make the lens of 4, 5, 8, 12 or 14 coefficients in OpenCV's order. Raises ValueError for another number, and for
    a tilted sensor."""
    if len(numbers) == 4:
        numbers = [*numbers, 0.0]
    if len(numbers) == 14:
        if any(numbers[12:]):
            raise ValueError(
                "it has the tilted sensor of OpenCV's 14 coefficients; calibrate without CALIB_TILTED_MODEL"
            )
        numbers = numbers[:12]
    return Brown(tuple(map(float, numbers)))


def to_number_array(value: Any, name: str, *shape: int) -> Array:
    """Convert a list of finite numbers, or lists of equal length, to an array of this shape; flat without a shape.
    Raises ValueError for other values."""
    try:
        found = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {quote(value)}, not numbers") from None
    if found.size > 10_000 or not np.isfinite(found).all():
        raise ValueError(f"{name} has a number that is not finite, or too many numbers")
    if shape and found.size != math.prod(shape):
        raise ValueError(f"{name} has {found.size} numbers, not {' x '.join(map(str, shape))}")
    return found.reshape(shape) if shape else found.ravel()


def split_pose(matrix: Array) -> tuple[Array, Array]:
    """Split a matrix (4, 4) into rotation and translation. Raises ValueError if its last row is not 0 0 0 1."""
    if not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise ValueError("the last row of its matrix is not 0 0 0 1")
    return matrix[:3, :3], matrix[:3, 3]


def format_numbers(numbers: Any) -> str:
    """Write numbers with all digits, separated by commas."""
    return ", ".join(map(write_number, np.ravel(numbers)))

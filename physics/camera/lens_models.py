"""Lens models of calibrated cameras: directions in the camera's axes to points of a normalised image, and back.

Axes are x right, y down, z forward. A point (x, y) of the normalised image is the pixel (fx x + s y + cx, fy y + cy).
Each model has ``bend``, from directions (..., 3) of any length to points (..., 2), and ``unbend``, from points to
directions of length 1. Both give NaN outside the field of the lens: behind it, and beyond a fold of its polynomials.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.file_schemas import is_number
from ...support.files import quote
from . import cahvore, lens_distortion
from .invert_growing import find_smallest_positive_root, invert

#: Possible numbers of coefficients of Brown and Conrady's model, in OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4.
BROWN_COUNTS = (5, 8, 12)


@dataclass(frozen=True)
class Brown:
    """Brown and Conrady's model with OpenCV's ``coefficients``, 5, 8 or 12 of them; five zeros are a pinhole."""

    coefficients: tuple[float, ...] = (0.0,) * 5

    def __post_init__(self) -> None:
        _check_numbers(self.coefficients, "a lens of Brown and Conrady", *BROWN_COUNTS)

    @property
    def name(self) -> str:
        """Name of the model, for messages."""
        return f"Brown-Conrady, {len(self.coefficients)} coefficients" if any(self.coefficients) else "pinhole"

    def shortened(self) -> tuple[float, ...]:
        """Return the coefficients without trailing zeros: 0, 5, 8 or 12 of them."""
        counts = (0, *BROWN_COUNTS)
        return next(self.coefficients[:count] for count in counts if not any(self.coefficients[count:]))

    def bend(self, directions: Array) -> Array:
        """Map directions (..., 3) to points (..., 2); NaN outside the field."""
        ahead = directions[..., 2] > 0
        with np.errstate(all="ignore"):
            points = directions[..., :2] / np.where(ahead, directions[..., 2], np.nan)[..., None]
            seen = ahead & lens_distortion.is_seen(points, self.coefficients)
            return np.where(seen[..., None], lens_distortion.distort_points(points, self.coefficients), np.nan)

    def unbend(self, points: Array) -> Array:
        """Map points (..., 2) to directions (..., 3) of length 1; NaN outside the field."""
        found = lens_distortion.undistort_points(points, self.coefficients)
        directions = np.concatenate([found, np.ones_like(found[..., :1])], axis=-1)
        return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Fisheye:
    """Kannala and Brandt's model as in OpenCV's module fisheye, Kalibr's equidistant and COLMAP's OPENCV_FISHEYE.

    A direction at the angle a off the axis is shown at the distance a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8).
    """

    coefficients: tuple[float, ...] = (0.0,) * 4

    def __post_init__(self) -> None:
        _check_numbers(self.coefficients, "a fisheye", 4)

    @property
    def name(self) -> str:
        """Name of the model, for messages."""
        return "Kannala-Brandt fisheye"

    @property
    def widest_rad(self) -> float:
        """The largest angle off the axis, in rad, that the lens shows."""
        k1, k2, k3, k4 = self.coefficients
        return min(math.pi, math.sqrt(find_smallest_positive_root([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0])))

    def _distance(self, angle: Array) -> Array:
        """Compute the distance from the principal point, in the normalised image, of a ray at ``angle`` (rad) off the
        axis.
        """
        k1, k2, k3, k4 = self.coefficients
        a2 = angle**2
        return angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))

    def bend(self, directions: Array) -> Array:
        """Map directions (..., 3) to points (..., 2); NaN outside the field."""
        aside = np.hypot(directions[..., 0], directions[..., 1])
        angle = np.arctan2(aside, directions[..., 2])
        with np.errstate(all="ignore"):
            scale = np.where(aside > 0, self._distance(angle) / np.where(aside > 0, aside, 1.0), 0.0)
            seen = (angle <= self.widest_rad) & ((aside > 0) | (directions[..., 2] > 0))
            return np.where(seen[..., None], scale[..., None] * directions[..., :2], np.nan)

    def unbend(self, points: Array) -> Array:
        """Map points (..., 2) to directions (..., 3) of length 1; NaN outside the field."""
        distance = np.hypot(points[..., 0], points[..., 1])
        angle = invert(self._distance, distance, self.widest_rad)
        side = np.divide(points, distance[..., None], out=np.zeros_like(points), where=distance[..., None] > 0)
        return np.concatenate([np.sin(angle)[..., None] * side, np.cos(angle)[..., None]], axis=-1)


@dataclass(frozen=True)
class Cahvore:
    """The lens of CAHVOR, or of CAHVORE if ``pupil`` is given; see ``cahvore``. ``axis`` (3,) is the optical axis in
    the camera's axes, of length 1; ``radial`` is the vector R, ``pupil`` the vector E.
    """

    axis: tuple[float, ...]
    radial: tuple[float, ...]
    pupil: tuple[float, ...] | None = None
    linearity: float = 1.0

    def __post_init__(self) -> None:
        for numbers, what in ((self.axis, "O"), (self.radial, "R"), (self.pupil or (0.0,) * 3, "E")):
            _check_numbers(numbers, f"the vector {what} of a lens", 3)
        _check_numbers((self.linearity,), "a linearity", 1)
        if not (abs(math.hypot(*self.axis) - 1) < 1e-6 and self.axis[2] > 0):
            raise ValueError("the optical axis O must have length 1 and point forward")
        if not 1 + self.radial[0] > 0:
            raise ValueError(f"R begins with {self.radial[0]:g}, which mirrors the image")

    @property
    def name(self) -> str:
        """Name of the model, for messages."""
        return "CAHVOR" if self.pupil is None else f"CAHVORE with linearity {self.linearity:g}"

    @property
    def _numbers(self) -> tuple[Array, Array, Array | None, float]:
        pupil = None if self.pupil is None else np.array(self.pupil)
        return np.array(self.axis), np.array(self.radial), pupil, self.linearity

    def bend(self, directions: Array) -> Array:
        """Map directions (..., 3) to points (..., 2); NaN outside the field."""
        with np.errstate(all="ignore"):
            bent = cahvore.bend(directions, *self._numbers)
            seen = (bent[..., 2] > 0) & cahvore.is_seen(directions, *self._numbers)
            return np.where(seen[..., None], bent[..., :2] / bent[..., 2:], np.nan)

    def unbend(self, points: Array) -> Array:
        """Map points (..., 2) to directions (..., 3) of length 1; NaN outside the field."""
        return cahvore.unbend(np.concatenate([points, np.ones_like(points[..., :1])], axis=-1), *self._numbers)


LensModel = Brown | Fisheye | Cahvore


def lens_json(lens: LensModel) -> dict[str, Any]:
    """Describe a lens by its name and its numbers, as ``lens_from_json`` reads them."""
    if isinstance(lens, Cahvore):
        return {
            "model": "CAHVORE",
            "axis": list(lens.axis),
            "radial": list(lens.radial),
            "pupil": list(lens.pupil or (0.0, 0.0, 0.0)),
            "linearity": lens.linearity,
        }
    return {"model": "BROWN" if isinstance(lens, Brown) else "FISHEYE", "coefficients": list(lens.coefficients)}


def lens_from_json(data: Mapping[str, Any]) -> LensModel:
    """Read the lens of a table of ``lens_json``. Raises ValueError for another table."""
    model = data.get("model")
    if model not in ("BROWN", "FISHEYE", "CAHVORE"):
        raise ValueError(f"there is no lens {quote(model)}")
    numbers = {
        key: tuple(value) for key, value in data.items() if isinstance(value, list) and all(map(is_number, value))
    }
    try:
        if model == "CAHVORE":
            linearity = data["linearity"]
            pupil = None if linearity == 1.0 and not any(numbers["pupil"]) else numbers["pupil"]
            return Cahvore(numbers["axis"], numbers["radial"], pupil, float(linearity))
        return Fisheye(numbers["coefficients"]) if model == "FISHEYE" else Brown(numbers["coefficients"])
    except (KeyError, TypeError):
        raise ValueError(f"there is no lens {model} with these numbers") from None


def _check_numbers(numbers: tuple[float, ...], what: str, *counts: int) -> None:
    """Raise ValueError unless all numbers are finite, and their count is one of ``counts``."""
    if len(numbers) not in counts:
        raise ValueError(f"{what} has {' or '.join(map(str, counts))} coefficients, not {len(numbers)}")
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"a coefficient of {what} is not a finite number")

"""The geometry of a stereo pair: pixels, depth and disparity."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.arrays import Array
from ...support.file_schemas import COUNT, NUMBER, PIXELS, POSITIVE, Maybe
from ..rig.focal_length import focal_px
from .calibrated_camera import CORNER, CalibratedCamera
from .panorama import Panorama

#: The table of a file that ``StereoCamera.from_json`` reads, see ``support.file_schemas``.
CAMERA_SHAPE = {
    "width_px": PIXELS,
    "height_px": PIXELS,
    "focal_px": POSITIVE,
    "cx_px": NUMBER,
    "cy_px": NUMBER,
    "baseline_m": POSITIVE,
    "margin_x_px": Maybe(COUNT),
    "margin_y_px": Maybe(COUNT),
    "toe_in_deg": Maybe(NUMBER),
    "doffs_px": Maybe(NUMBER),
}


@dataclass(frozen=True)
class StereoCamera:
    """Two identical, parallel pinhole cameras, the right camera ``baseline_m`` along the left camera's x.

    The principal point is in pixel-corner coordinates: pixel (column u, row v) has its centre at (u + 0.5, v + 0.5), so
    a ray through it is ((u + 0.5 - cx) / f, (v + 0.5 - cy) / f, 1).

    Truth and rectified images belong to this rig. Images were taken with eyes that may each be turned in by
    ``toe_in_deg``, and rendered with the margins as extra pixels beyond each border. Calibrated ``eyes``, left first,
    are separate cameras at the centres of this rig, with poses in the axes of its left eye. Their images are taken from
    the images of the parallel rig, or from a ``panorama`` of each of its eyes if no pinhole shows their field.
    """

    width_px: int
    height_px: int
    focal_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    margin_x_px: int = 0
    margin_y_px: int = 0
    toe_in_deg: float = 0.0
    #: Column of the right principal point minus the left one's; 0 in our pairs, not in Middlebury's.
    doffs_px: float = 0.0
    eyes: tuple[CalibratedCamera, CalibratedCamera] | None = None
    panorama: Panorama | None = None

    @classmethod
    def from_settings(cls, rig: RigSettings) -> StereoCamera:
        """Make the rig of the ``rig`` settings, without calibrated eyes (see ``eyes.make_camera_with_eyes``). The
        sensor width spans the image width, and pixels are square.
        """
        return cls(
            rig.width_px,
            rig.height_px,
            focal_px(rig),
            rig.width_px / 2 + rig.principal_x_px,
            rig.height_px / 2 + rig.principal_y_px,
            rig.baseline_m,
            math.ceil(rig.overscan * rig.width_px),
            math.ceil(rig.overscan * rig.height_px),
            rig.toe_in_deg if rig.eyes == "ALIKE" else 0.0,
        )

    @property
    def focal_baseline_px_m(self) -> float:
        """Disparity (px) times planar depth (m): f B in px·m."""
        return self.focal_px * self.baseline_m

    @property
    def matrix(self) -> list[list[float]]:
        """The calibration matrix K (3 x 3) in pixel-corner coordinates."""
        return [[self.focal_px, 0.0, self.cx_px], [0.0, self.focal_px, self.cy_px], [0.0, 0.0, 1.0]]

    @property
    def rectified(self) -> StereoCamera:
        """The parallel rig of the pair, without margins, toe-in or calibrated eyes."""
        return replace(self, margin_x_px=0, margin_y_px=0, toe_in_deg=0.0, eyes=None, panorama=None)

    @property
    def looks_elsewhere(self) -> bool:
        """Whether the eyes are toed in or calibrated, so that they may see less than the rectified images."""
        return bool(self.toe_in_deg) or self.eyes is not None

    def sensor_px(self, eye: str) -> tuple[int, int]:
        """Return the columns and rows of an eye's sensor."""
        own = self.own_eye(eye)
        return (self.width_px, self.height_px) if own is None else own.size_px

    def own_eye(self, eye: str) -> CalibratedCamera | None:
        """Return the calibrated camera of an eye; None for an eye of the parallel rig."""
        return None if self.eyes is None else self.eyes[eye != "left"]

    @property
    def rendered_px(self) -> tuple[int, int]:
        """Columns and rows of the rendered images of the parallel rig, margins included."""
        return self.width_px + 2 * self.margin_x_px, self.height_px + 2 * self.margin_y_px

    @property
    def light_px(self) -> tuple[int, int]:
        """Columns and rows of the rendered light, from which the sensors' images are made."""
        return self.rendered_px if self.panorama is None else (self.panorama.size_px,) * 2

    def eye_rotation(self, eye: str) -> Array:
        """Return the rotation (3, 3) from the axes of the parallel rig to the axes of an eye, which may be toed in or
        calibrated.
        """
        own = self.own_eye(eye)
        if own is not None:
            return np.array(own.rotation)
        angle = math.radians(self.toe_in_deg) * (1 if eye == "left" else -1)
        return np.array(
            [[math.cos(angle), 0.0, -math.sin(angle)], [0.0, 1.0, 0.0], [math.sin(angle), 0.0, math.cos(angle)]]
        )

    def cropped(self, image: Array) -> Array:
        """Return a rendered image (H + 2 margins, W + 2 margins, ...) without its margins."""
        return image[
            self.margin_y_px : self.margin_y_px + self.height_px, self.margin_x_px : self.margin_x_px + self.width_px
        ]

    def disparity(self, depth_m: Array | np.floating[Any]) -> Array:
        """Compute the disparity in px of planar depths in metres; NaN (sky) stays NaN."""
        return self.focal_baseline_px_m / np.asarray(depth_m, np.float64) - self.doffs_px

    def depth(self, disparity_px: Array) -> Array:
        """Compute the planar depth in metres of disparities in px; NaN for disparities of no point in front of the
        camera.
        """
        reach = np.asarray(disparity_px, np.float64) + self.doffs_px
        with np.errstate(over="ignore", invalid="ignore"):
            ahead = reach > 0
            return np.where(ahead, self.focal_baseline_px_m / np.where(ahead, reach, 1.0), np.nan)

    def to_json(self) -> dict[str, Any]:
        """Return the ``camera`` table of ``pair.json``."""
        return {
            "width_px": self.width_px,
            "height_px": self.height_px,
            "focal_px": self.focal_px,
            "cx_px": self.cx_px,
            "cy_px": self.cy_px,
            "baseline_m": self.baseline_m,
            "K": self.matrix,
            "focal_baseline_px_m": self.focal_baseline_px_m,
            "margin_x_px": self.margin_x_px,
            "margin_y_px": self.margin_y_px,
            "toe_in_deg": self.toe_in_deg,
            **({"doffs_px": self.doffs_px} if self.doffs_px else {}),
            "pixel_centre": "(u + 0.5, v + 0.5)",
        }

    def find_offset_m(self, eye: str) -> float:
        """Return the distance in metres of an eye from the left eye, along its x."""
        return 0.0 if eye == "left" else self.baseline_m

    def eyes_json(self) -> dict[str, Any]:
        """Return the calibration of each eye: K, and R and t of x = R X + t from the left eye's rectified axes, in
        metres.
        """
        found = {}
        for eye in ("left", "right"):
            rotation, along = self.eye_rotation(eye), self.find_offset_m(eye)
            own = self.own_eye(eye)
            matrix = self.matrix if own is None else (own.matrix + CORNER).tolist()
            found[eye] = {"K": matrix, "R": rotation.tolist(), "t": (-along * rotation[:, 0]).tolist()}
        return found

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> StereoCamera:
        """Read the camera of the ``camera`` table of ``pair.json``."""
        own = ("width_px", "height_px", "focal_px", "cx_px", "cy_px", "baseline_m")
        return cls(
            **{key: data[key] for key in own},
            **{key: data.get(key, 0) for key in ("margin_x_px", "margin_y_px", "toe_in_deg", "doffs_px")},
        )

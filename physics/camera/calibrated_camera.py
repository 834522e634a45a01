"""Calibrated cameras as other programs state them: any focal lengths, skew, principal point, lens and pose.

As in OpenCV, ROS, Kalibr and mrcal, the centre of the first pixel is (0, 0), so coordinates are half a pixel less than
in ``stereo_camera``. Distances are in metres. A pose is the rotation and the translation of x = R X + t, from reference
axes to the camera's: x right, y down, z forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ...support.arrays import Array
from ...support.file_schemas import PIXELS
from .lens_models import Brown, LensModel
from .rotations import from_vector, nearest_rotation, rotation_error, to_vector

#: Largest deviation from 1 of a matrix times its transpose. A matrix within it counts as a rounded rotation.
ROTATION_TOLERANCE = 1e-6
#: Largest focal length, skew and principal point, px.
_LARGEST_PX = 1e8
#: Largest distance, m.
_LARGEST_M = 1e9
#: Difference between K with pixels counted from the corner of the first pixel, and K with pixels counted from its
#: centre.
CORNER = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])


@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """A camera: the size of its images, its matrix K, its lens, and its pose. Raises ValueError for impossible values,
    and for a matrix that is not a rotation.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    lens: LensModel = field(default_factory=Brown)
    skew_px: float = 0.0
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation_m: Array = field(default_factory=lambda: np.zeros(3))
    name: str = ""

    def __post_init__(self) -> None:
        for size, what in ((self.width_px, "width"), (self.height_px, "height")):
            if not PIXELS.fits(size):
                raise ValueError(f"an image has a {what} of {size}, not {PIXELS.name}")
        for value, what in ((self.fx_px, "fx"), (self.fy_px, "fy")):
            if not 0 < value <= _LARGEST_PX:
                raise ValueError(
                    f"{what} is {value:g} px, and a focal length is above 0 and at most {_LARGEST_PX:g} px"
                )
        for value, what in ((self.cx_px, "cx"), (self.cy_px, "cy"), (self.skew_px, "the skew")):
            if not abs(value) <= _LARGEST_PX:
                raise ValueError(f"{what} is {value:g} px, not a number up to {_LARGEST_PX:g}")
        rotation, translation = np.array(self.rotation, np.float64), np.array(self.translation_m, np.float64)
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise ValueError("a pose has a rotation of 3 x 3 and a translation of 3 numbers")
        off = rotation_error(rotation)
        if not off <= ROTATION_TOLERANCE:
            raise ValueError(
                "R is not a rotation: it is mirrored or has no finite numbers"
                if math.isinf(off)
                else f"R is not a rotation: R times its transpose is off from 1 by {off:.2g}"
            )
        if not (np.abs(translation) <= _LARGEST_M).all():
            raise ValueError(f"the translation is {translation}, not three numbers up to {_LARGEST_M:g} m")
        for key, array in (("rotation", nearest_rotation(rotation)), ("translation_m", translation)):
            array.setflags(write=False)
            object.__setattr__(self, key, array)

    @property
    def size_px(self) -> tuple[int, int]:
        """Numbers of columns and rows."""
        return self.width_px, self.height_px

    @property
    def matrix(self) -> Array:
        """K (3, 3); the centre of the first pixel is (0, 0)."""
        return np.array([[self.fx_px, self.skew_px, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    @property
    def centre_m(self) -> Array:
        """Position (3,) of the camera in reference axes, in metres."""
        return -self.rotation.T @ self.translation_m

    def project(self, points_m: Array) -> Array:
        """Project points (..., 3) in reference axes to columns and rows (..., 2); NaN where the lens does not show
        them.
        """
        return self.show(np.asarray(points_m, np.float64) @ self.rotation.T + self.translation_m)

    def show(self, directions: Array) -> Array:
        """Project directions (..., 3), of any length, in the camera's axes to columns and rows (..., 2); NaN where the
        lens does not show them.
        """
        bent = self.lens.bend(directions)
        x, y = bent[..., 0], bent[..., 1]
        return np.stack([self.fx_px * x + self.skew_px * y + self.cx_px, self.fy_px * y + self.cy_px], axis=-1)

    def unproject(self, pixels: Array) -> Array:
        """Find the unit directions (..., 3), in the camera's axes, of pixels (..., 2); NaN outside the field of
        view.
        """
        pixels = np.asarray(pixels, np.float64)
        y = (pixels[..., 1] - self.cy_px) / self.fy_px
        x = (pixels[..., 0] - self.cx_px - self.skew_px * y) / self.fx_px
        return self.lens.unbend(np.stack([x, y], axis=-1))

    def placed(self, rotation: Array, translation_m: Array) -> CalibratedCamera:
        """Return the same camera in another pose."""
        return replace(self, rotation=rotation, translation_m=translation_m)

    def dark_share(self) -> float:
        """Estimate the share of the pixels outside the lens's field of view, on a grid of 65 x 49 points over the
        image.
        """
        grid = np.meshgrid(np.linspace(0, self.width_px - 1, 65), np.linspace(0, self.height_px - 1, 49))
        return float(np.isnan(self.unproject(np.stack(grid, axis=-1))[..., 0]).mean())


@dataclass(frozen=True)
class CalibratedRig:
    """One or more cameras in common reference axes; the left one of a pair is first. Raises ValueError without a
    camera.
    """

    cameras: tuple[CalibratedCamera, ...]

    def __post_init__(self) -> None:
        if not self.cameras:
            raise ValueError("a rig has at least one camera")

    def relative_pose(self, camera: int = 1) -> tuple[Array, Array]:
        """Compute R (3, 3) and t (3,), in metres, of x = R X + t from the axes of the first camera to the axes of
        another camera.

        OpenCV's stereoCalibrate calls them R and T.
        """
        first, second = self.cameras[0], self.cameras[camera]
        rotation = second.rotation @ first.rotation.T
        return rotation, second.translation_m - rotation @ first.translation_m

    def from_first(self) -> CalibratedRig:
        """Return the same rig in the axes of its first camera."""
        poses = [(np.eye(3), np.zeros(3)), *(self.relative_pose(k) for k in range(1, len(self.cameras)))]
        return CalibratedRig(tuple(camera.placed(*pose) for camera, pose in zip(self.cameras, poses, strict=True)))


def rectifying_rotations(rig: CalibratedRig) -> tuple[Array, Array]:
    """Compute the rotations (3, 3) from the axes of the first two cameras to the axes of their rectified pair.

    As in Bouguet's method and OpenCV's stereoRectify, each eye turns by half of the rotation between them. Both then
    turn until x is along the baseline. Raises ValueError for eyes at one position, or one above the other.
    """
    rotation, translation = rig.relative_pose()
    half = from_vector(-to_vector(rotation) / 2)
    along = half @ translation
    length = float(np.linalg.norm(along))
    if not length > 1e-12:  # rounding can leave as much
        raise ValueError("both eyes have the same position")
    if abs(along[0]) < abs(along[1]):
        raise ValueError("one eye is above the other")
    x_axis = np.array([math.copysign(1.0, along[0]), 0.0, 0.0])
    turn = np.cross(along, x_axis)
    sine = float(np.linalg.norm(turn))
    if sine > 0:
        turn *= math.atan2(sine, float(along @ x_axis)) / sine
    level = from_vector(turn)
    return level @ half.T, level @ half

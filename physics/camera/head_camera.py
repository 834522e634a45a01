"""Cameras beside the stereo pair, each with a name, a role, a projection and a pose.

A projection takes pixels to rays and points to pixels, in the camera's axes: x right, y down, z forward. Pixels are
counted from the centre of the first pixel. A pinhole, a fisheye and a calibrated camera are ``CalibratedCamera``;
orthographic and equirectangular cameras are here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.file_schemas import FILE_NAME, MATRIX, NUMBER, PIXELS, POSITIVE, TABLE, TEXT, Each, Maybe
from .calibrated_camera import CORNER, CalibratedCamera
from .lens_models import Brown, Fisheye, LensModel, lens_from_json, lens_json
from .rotations import rotation_error

#: Purposes of a camera, as words by which users choose it.
ROLES = ("hazcam", "mast", "arm", "navigation", "context")
#: Frames of a pose. RIG has the axes of the rig's left eye. GROUND and ZERO have east, north and up from the site's
#: origin, with heights above the ground beneath, or above the site's zero.
FRAMES = ("RIG", "GROUND", "ZERO")
#: The most cameras of a head.
MAX_CAMERAS = 16
#: Largest deviation from a rotation of a pose's matrix in Blender's single precision.
_SINGLE = 1e-5
#: Largest angle off the axis, in degrees, up to which a calibrated camera is rendered as a pinhole.
_WIDEST_PINHOLE_DEG = 60.0
#: Extra rendered pixels around the pixels that a lens needs, for interpolation by splines.
_BORDER_PX = 4


@dataclass(frozen=True)
class Orthographic:
    """A camera with parallel rays: its image is ``width_m`` wide at each depth; pixels are square."""

    width_px: int
    height_px: int
    width_m: float

    @property
    def size_px(self) -> tuple[int, int]:
        """Numbers of columns and rows."""
        return self.width_px, self.height_px

    @property
    def _metres_per_px(self) -> float:
        return self.width_m / self.width_px

    @property
    def _middle(self) -> Array:
        return np.array([self.width_px - 1, self.height_px - 1]) / 2

    def rays(self, pixels: Array) -> tuple[Array, Array]:
        """Find the origins and directions (..., 3) of the rays of pixels (..., 2), in metres; directions have
        length 1.
        """
        aside = (np.asarray(pixels, np.float64) - self._middle) * self._metres_per_px
        origins = np.concatenate([aside, np.zeros_like(aside[..., :1])], axis=-1)
        return origins, np.broadcast_to([0.0, 0.0, 1.0], origins.shape)

    def project(self, points_m: Array) -> Array:
        """Project points (..., 3), in metres, to columns and rows (..., 2); NaN behind the camera."""
        points = np.asarray(points_m, np.float64)
        return np.where(points[..., 2:] > 0, points[..., :2] / self._metres_per_px + self._middle, np.nan)


@dataclass(frozen=True)
class Equirectangular:
    """A panorama. Columns are even in longitude, over ``field_deg``, and rows are even in latitude by the same step.

    The optical axis is in the middle.
    """

    width_px: int
    height_px: int
    field_deg: float

    @property
    def size_px(self) -> tuple[int, int]:
        """Numbers of columns and rows."""
        return self.width_px, self.height_px

    @property
    def step_rad(self) -> float:
        """Angle between neighbouring pixels in radians."""
        return math.radians(self.field_deg) / self.width_px

    @property
    def _middle(self) -> Array:
        return np.array([self.width_px - 1, self.height_px - 1]) / 2

    def rays(self, pixels: Array) -> tuple[Array, Array]:
        """Find the origins and directions (..., 3) of the rays of pixels (..., 2); directions have length 1."""
        angles = (np.asarray(pixels, np.float64) - self._middle) * self.step_rad
        longitude, down = angles[..., 0], angles[..., 1]
        level = np.cos(down)
        directions = np.stack([np.sin(longitude) * level, np.sin(down), np.cos(longitude) * level], axis=-1)
        return np.zeros_like(directions), directions

    def project(self, points_m: Array) -> Array:
        """Project points (..., 3), in metres, to columns and rows (..., 2)."""
        x, y, z = np.moveaxis(np.asarray(points_m, np.float64), -1, 0)
        angles = np.stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))], axis=-1)
        return np.asarray(angles / self.step_rad + self._middle)


Projection = CalibratedCamera | Orthographic | Equirectangular


def make_rays_of_pixels(projection: Projection, pixels: Array) -> tuple[Array, Array]:
    """Find the origins and directions (..., 3) of the rays of pixels (..., 2) in the camera's axes, in metres.
    Directions have length 1, and are NaN outside the field of view.
    """
    if not isinstance(projection, CalibratedCamera):
        return projection.rays(pixels)
    directions = projection.unproject(pixels)
    return np.zeros_like(directions), directions


def show_points(projection: Projection, points_m: Array) -> Array:
    """Project points (..., 3) in the camera's axes to columns and rows (..., 2); NaN for invisible points."""
    return projection.show(points_m) if isinstance(projection, CalibratedCamera) else projection.project(points_m)


def make_pinhole(width_px: int, height_px: int, field_deg: float) -> CalibratedCamera:
    """Make a pinhole with square pixels that sees ``field_deg`` across its width, its axis in the middle."""
    return _centred(width_px, height_px, width_px / 2 / math.tan(math.radians(field_deg) / 2), Brown())


def make_fisheye(width_px: int, height_px: int, field_deg: float) -> CalibratedCamera:
    """Make an equidistant fisheye that sees ``field_deg`` across its width. The distance of a pixel from the middle is
    proportional to its angle from the axis.
    """
    return _centred(width_px, height_px, width_px / math.radians(field_deg), Fisheye())


def _centred(width_px: int, height_px: int, focal_px: float, lens: LensModel) -> CalibratedCamera:
    return CalibratedCamera(width_px, height_px, focal_px, focal_px, (width_px - 1) / 2, (height_px - 1) / 2, lens)


def is_plain(projection: Projection) -> bool:
    """Return whether Cycles can render the projection; the lens of a camera must be a pinhole or an equidistant fisheye
    with square pixels.
    """
    if not isinstance(projection, CalibratedCamera):
        return True
    lens = projection.lens
    square = projection.fx_px == projection.fy_px and not projection.skew_px
    return square and isinstance(lens, Brown | Fisheye) and not any(lens.coefficients)


@dataclass(frozen=True)
class HeadCamera:
    """A camera beside the pair. ``rotation`` (3, 3) takes vectors from its axes to its frame, one of ``FRAMES``, and
    ``position_m`` (3,) is in that frame. ``model`` is the name of the projection in its file.
    """

    name: str
    role: str
    model: str
    projection: Projection
    frame: str = "RIG"
    rotation: Array = field(default_factory=lambda: np.eye(3))
    position_m: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def pose(self) -> Array:
        """The matrix (4, 4) from the camera's axes to its frame."""
        made = np.eye(4)
        made[:3, :3], made[:3, 3] = self.rotation, self.position_m
        return made

    @property
    def rendered(self) -> Projection:
        """The projection of its rendered image. It is the camera's own; or, for a lens that Cycles lacks, a wider
        pinhole or fisheye with the same resolution in the middle.
        """
        own = self.projection
        return own if not isinstance(own, CalibratedCamera) or is_plain(own) else _find_render(own)


def _find_render(own: CalibratedCamera) -> CalibratedCamera:
    """Make a pinhole or an equidistant fisheye that shows everything that a camera sees."""
    grid = np.meshgrid(np.linspace(0.0, own.width_px - 1.0, 65), np.linspace(0.0, own.height_px - 1.0, 49))
    seen = own.unproject(np.stack(grid, axis=-1)).reshape(-1, 3)
    seen = seen[np.isfinite(seen).all(axis=-1)]
    narrow = len(seen) and seen[:, 2].min() > math.cos(math.radians(_WIDEST_PINHOLE_DEG))
    focal = max(own.fx_px, own.fy_px)
    lens: LensModel = Brown() if narrow else Fisheye()
    middle = CalibratedCamera(1, 1, focal, focal, 0.0, 0.0, lens)
    reach = np.abs(middle.show(seen)).max(axis=0) if len(seen) else np.zeros(2)
    width, height = (2 * math.ceil(float(each) + _BORDER_PX) for each in reach)
    return _centred(width, height, focal, lens)


#: The table of a file that ``camera_from_json`` reads, see ``support.file_schemas``.
HEAD_CAMERA_SHAPE = {
    "name": FILE_NAME,
    "role": TEXT,
    "model": TEXT,
    "width_px": PIXELS,
    "height_px": PIXELS,
    "pose_camera_to_world": MATRIX,
    "width_m": Maybe(POSITIVE),
    "field_deg": Maybe(POSITIVE),
    "K": Maybe(Each(Each(NUMBER))),
    "lens": Maybe(TABLE),
    "image": FILE_NAME,
    "truth": FILE_NAME,
}
#: How pixels become rays, in words, for readers of a file that have no program for it.
_MAPPINGS = {
    Orthographic: "rays along z from x = (u - width_px / 2) width_m / width_px, y = (v - height_px / 2) width_m / "
    "width_px",
    Equirectangular: "longitude a = (u - width_px / 2) s, downward angle b = (v - height_px / 2) s, s = field_deg / "
    "width_px; ray (sin a cos b, sin b, cos a cos b)",
    CalibratedCamera: "(u, v, 1) = K (x, y, 1) of the point (x, y) that the lens gives of a ray",
}


def camera_json(camera: HeadCamera, to_world: Array, image: str, truth: str) -> dict[str, Any]:
    """Make the entry of a camera in ``pair.json``, with its pose (4, 4) in the world and the names of its files."""
    own = camera.projection
    facts: dict[str, Any] = {
        "name": camera.name,
        "role": camera.role,
        "model": camera.model,
        "width_px": own.width_px,
        "height_px": own.height_px,
    }
    if isinstance(own, CalibratedCamera):
        facts |= {"K": (own.matrix + CORNER).tolist(), "lens": lens_json(own.lens)}
    elif isinstance(own, Orthographic):
        facts["width_m"] = own.width_m
    else:
        facts["field_deg"] = own.field_deg
    axes = "x right, y down, z forward; pixels are counted from the corner of the first pixel"
    return {
        **facts,
        "mapping": f"{_MAPPINGS[type(own)]}; {axes}",
        "pose_camera_to_world": np.asarray(to_world).tolist(),
        "image": image,
        "truth": truth,
    }


def camera_from_json(data: Mapping[str, Any]) -> HeadCamera:
    """Read the camera of a checked entry, in the frame ZERO, which is the frame of the world. Raises ValueError for
    impossible parameters.
    """
    pose = np.array(data["pose_camera_to_world"], np.float64)
    if not rotation_error(pose[:3, :3]) <= _SINGLE:
        raise ValueError(f"the pose of the camera {data['name']} is not a rotation")
    return HeadCamera(
        data["name"], data["role"], data["model"], _projection_from_json(data), "ZERO", pose[:3, :3], pose[:3, 3]
    )


def _projection_from_json(data: Mapping[str, Any]) -> Projection:
    width, height = int(data["width_px"]), int(data["height_px"])
    if "width_m" in data:
        return Orthographic(width, height, float(data["width_m"]))
    if "field_deg" in data:
        return Equirectangular(width, height, float(data["field_deg"]))
    matrix = np.array(data.get("K"), np.float64)
    if matrix.shape != (3, 3):
        raise ValueError(f"the camera {data['name']} has no K of 3 x 3 numbers")
    matrix = matrix - CORNER
    lens = lens_from_json(data.get("lens") or {})
    return CalibratedCamera(width, height, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], lens, matrix[0, 1])

"""Renders a ball, whose few images show how a surface reflects sunlight at all angles.

The ball is a mesh from a file, rendered in the same way as a user's own ground: it has a radius of 1 m and lies at the
origin. The camera looks at it from the south, a little from above. The Sun stands as high as the camera, so the phase
angle is set by the Sun's azimuth alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..formats.ply import write_triangles
from ..render.pairs.pair_folder import Pair
from ..settings.description import check, defaults, merged
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from .comparison import Bench

#: Elevation of camera and Sun; both must be above the horizon, which hides the Sun from all ground.
_ELEVATION_DEG = 2.0
_VIEW_WIDTH_M = 2.2
_BALL_RINGS = 180


def make_ball_mesh(rings: int = _BALL_RINGS) -> tuple[Array, Array]:
    """Make the positions (n, 3) and outward triangles (m, 3) of a sphere of radius 1 with ``2 * rings`` meridians."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)[1:-1, None]
    longitude = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)[None]
    x, y, z = np.broadcast_arrays(
        np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)
    )
    vertices = np.concatenate([[[0, 0, -1]], np.stack([x, y, z], axis=-1).reshape(-1, 3), [[0, 0, 1]]])
    around, count = np.arange(2 * rings), 2 * rings
    after = (around + 1) % count
    faces = [np.stack([0 * around, 1 + after, 1 + around], axis=1)]
    for ring in range(rings - 2):
        low, high = 1 + ring * count, 1 + (ring + 1) * count
        faces += [
            np.stack([low + around, low + after, high + after], axis=1),
            np.stack([low + around, high + after, high + around], axis=1),
        ]
    top = 1 + (rings - 2) * count
    faces.append(np.stack([0 * around + len(vertices) - 1, top + around, top + after], axis=1))
    return vertices, np.concatenate(faces)


@dataclass(frozen=True)
class BallImage:
    """The left image of a ball: ``radiance_factor`` I/F (H, W), 0 beside the ball, and angles (H, W) in radians.

    Incidence, emission and azimuth are those on the true sphere at the centre of each pixel, and NaN beside the ball.
    ``pixel_area`` is the area of a pixel divided by the area of the disc.
    """

    phase: float
    radiance_factor: Array
    incidence: Array
    emission: Array
    azimuth: Array
    pixel_area: float

    @property
    def brightness(self) -> float:
        """Brightness of the whole disc divided by the brightness of a white, facing Lambert disc."""
        return float(self.radiance_factor.sum() * self.pixel_area)


def render_ball(
    bench: Bench,
    surface: Sequence[Settings],
    phases_deg: Sequence[float],
    distance: float,
    pixels: int = 160,
    samples: int = 16,
) -> list[list[BallImage]]:
    """Render images of a ball for each description of a surface, in the order of the phase angles (0 to 176 degrees).

    ``distance`` is the distance of the camera in radii. As it is finite, the phase angle changes across the disc by up
    to 1 / distance.
    """
    mesh = bench.folder / "ball.ply"
    if not mesh.is_file():
        mesh.parent.mkdir(parents=True, exist_ok=True)
        write_triangles(mesh, *make_ball_mesh())
    described = [
        _describe_ball(each, mesh, phase, distance, pixels, samples) for each in surface for phase in phases_deg
    ]
    pairs = iter(bench.render(described))
    return [[_read_ball(next(pairs), math.radians(phase), distance) for phase in phases_deg] for _ in surface]


def _describe_ball(
    surface: Settings, mesh: Path, phase_deg: float, distance: float, pixels: int, samples: int
) -> Settings:
    height, phase = math.radians(_ELEVATION_DEG), math.radians(phase_deg)
    focal_mm = min(5000.0, 20.0 * distance / _VIEW_WIDTH_M)  # a sensor of 20 mm, or the longest lens
    cosine = (math.cos(phase) - math.sin(height) ** 2) / math.cos(height) ** 2
    return merged(
        defaults(),
        surface,
        check(
            {
                "source": {"kind": "MESH", "file": str(mesh), "centre": False, "up_axis": "Z"},
                "rig": {
                    "y_m": -distance * math.cos(height),
                    "height_m": distance * math.sin(height),
                    "pitch_deg": _ELEVATION_DEG,
                    "heading_deg": 0.0,
                    "focal_length_mm": focal_mm,
                    "sensor_width_mm": _VIEW_WIDTH_M / distance * focal_mm,
                    "width_px": pixels,
                    "height_px": pixels,
                    "baseline_m": 0.001,
                },
                "light": {
                    "sun_elevation_deg": _ELEVATION_DEG,
                    "sun_azimuth_deg": 180.0 - math.degrees(math.acos(min(max(cosine, -1.0), 1.0))),
                    "sun_angular_diameter_deg": 0.0,
                    "planet": False,
                },
                "quality": {"samples": samples, "denoiser": "NONE"},
            },
            "a ball",
        ),
    )


def _read_ball(pair: Pair, phase: float, distance: float) -> BallImage:
    from ..stereo.images.exr import read_view  # which needs OpenEXR

    light = pair.data["light"]["sun"]
    image = read_view(pair.image("left")).radiance.mean(axis=-1).astype(np.float64) * math.pi / light["irradiance_wm2"]
    pose = np.array(pair.data["poses_camera_to_world"]["left"])
    camera, size = pair.camera, image.shape
    u = (np.arange(size[1]) + 0.5 - camera.cx_px) / camera.focal_px
    v = (np.arange(size[0]) + 0.5 - camera.cy_px) / camera.focal_px
    ray = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1) @ pose[:3, :3].T
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = -(ray @ pose[:3, 3])
    nearest = pose[:3, 3] + along[..., None] * ray
    inside = 1.0 - (nearest**2).sum(-1)
    normal = nearest - np.sqrt(np.where(inside > 0, inside, np.nan))[..., None] * ray
    sun, eye = np.array(light["direction_to_world"]), -ray
    sun = sun / np.linalg.norm(sun)
    across_sun, across_eye = np.cross(sun, normal), np.cross(eye, normal)
    i = np.arctan2(np.linalg.norm(across_sun, axis=-1), normal @ sun)
    e = np.arctan2(np.linalg.norm(across_eye, axis=-1), (eye * normal).sum(-1))
    azimuth = np.arctan2(np.linalg.norm(np.cross(across_sun, across_eye), axis=-1), (across_sun * across_eye).sum(-1))
    return BallImage(phase, image, i, e, azimuth, (_VIEW_WIDTH_M / size[1]) ** 2 / math.pi)

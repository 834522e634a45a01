"""The rebuilt scene: settings of our rig, lamp and ground for a photograph, and masks from its renders.

Our rig has parallel eyes side by side. So the labels are rectified as images are for stereo: undistorted, and turned
about each eye into the axes of a rig whose x axis is the line between the fitted eyes. The world is turned by the tilt
of that line, a degree or two, so that it is level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...formats.ply import write_triangles
from ...render.pairs.pair_folder import Pair
from ...settings.description import check, defaults, merged
from ...settings.preset_files import load_preset
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from .camera import Calibration
from .data_set import EYES, ROCK, SHADOW, Rock, Terrain, View
from .sand import Sand

#: Extent in metres of the fine part of the ground.
_FINE_EXTENT_M = 2.4
#: Spacing of its vertices in metres.
_FINE_SPACING_M = 0.02
#: Reach of the coarse part in metres.
_COARSE_REACH_M = 9.0
#: Distance in metres at which the ground begins to become level.
_LEVEL_FROM_M = 2.2
#: Distance at which it is level.
_LEVEL_AT_M = 3.4
_WINDOW_MARGIN_PX = 12
_SENSOR_MM = 20.0
#: Apparent diameter of the lamp in degrees, chosen, because none is published.
LAMP_DEG = 0.5
_SAMPLES = 4
#: A pixel shows a rock if the rock is nearer than the sand by more than this, in metres.
_MIN_GAP_M = 0.002
#: A pixel is in shadow if it has less than this share of the light without rocks.
_SHADOW_SHARE = 0.5
#: A pixel of sand is also in shadow if it has less than this share of the light of most sand at its distance from the
#: lamp.
_DARK_SHARE = 0.1


@dataclass(frozen=True)
class Frame:
    """Our rig at a camera position.

    The rows of ``axes`` (3, 3) are the rig's axes x (right), y (down) and z (forward), in the data set's world.
    ``world`` (3, 3) rotates the data set's world into ours, and ``origin`` (3,) is the origin of our world. The window
    begins at ``corner`` (2,), counted from the optical axis in pixels of focal length ``focal_px``, and has the
    ``size`` (columns, rows).
    """

    position: str
    axes: Array
    world: Array
    origin: Array
    left: Array
    baseline_m: float
    focal_px: float
    corner: Array
    size: tuple[int, int]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.size[1], self.size[0]

    def rectify(self, camera: Calibration, eye: str, pixels: Array) -> Array:
        """Convert pixels (n, 2) of a photograph to pixels (n, 2) of our rig."""
        fitted = camera.eyes[View(self.position, eye)]
        rays = fitted.rays(pixels) @ fitted.turn @ self.axes.T
        return np.asarray(rays[:, :2] / rays[:, 2:] * self.focal_px - self.corner)

    def unrectify(self, camera: Calibration, eye: str, pixels: Array) -> Array:
        """Convert pixels (n, 2) of our rig to pixels (n, 2) of a photograph."""
        fitted = camera.eyes[View(self.position, eye)]
        rays = np.column_stack([(pixels + self.corner) / self.focal_px, np.ones(len(pixels))])
        return fitted.project(fitted.place_m + rays @ self.axes)

    def to_world_axes(self, points: Array) -> Array:
        """Convert points (n, 3) from the data set's world to ours."""
        return np.asarray((points - self.origin) @ self.world.T)

    def project(self, points: Array, eye: str) -> Array:
        """Project points (n, 3) of the data set's world to pixels (n, 2) of our rig."""
        inside = (points - self.left) @ self.axes.T - [self.baseline_m if eye == "R" else 0.0, 0.0, 0.0]
        return np.asarray(inside[:, :2] / inside[:, 2:] * self.focal_px - self.corner)


def find_frame(terrain: Terrain, camera: Calibration, sand: Sand, position: str, columns: int) -> Frame:
    """Find our rig at a position, with a window of about ``columns`` columns around all labels of rocks and shadows."""
    frame = _make_rig(camera, sand, position)
    seen = np.concatenate(
        [
            frame.rectify(camera, view.eye, each)
            for view, azimuth in terrain.photographs
            if view.position == position
            for kind in (ROCK, SHADOW)
            for each in terrain.polygons(view, azimuth, kind)
        ]
    )
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = (columns - 2 * _WINDOW_MARGIN_PX) / (high[0] - low[0])
    corner = np.floor(low * scale) - _WINDOW_MARGIN_PX
    width, height = (np.ceil(high * scale).astype(int) + _WINDOW_MARGIN_PX - corner.astype(int)).tolist()
    return replace(frame, focal_px=frame.focal_px * scale, corner=corner, size=(width, height))


def _make_rig(camera: Calibration, sand: Sand, position: str) -> Frame:
    """Make our rig at a position, as yet without a window."""
    left, right = (camera.eyes[View(position, eye)] for eye in EYES)
    across = right.place_m - left.place_m
    x = across / np.linalg.norm(across)
    forward = left.turn[2] + right.turn[2]
    z = forward - (forward @ x) * x
    z /= np.linalg.norm(z)
    up = np.array([0.0, 0.0, 1.0]) - x[2] * x
    up /= np.linalg.norm(up)
    return Frame(
        position,
        np.stack([x, np.cross(z, x), z]),
        np.stack([x, np.cross(up, x), up]),
        np.array([0.0, 0.0, sand.level_m]),
        left.place_m,
        float(np.linalg.norm(across)),
        1000.0,
        np.zeros(2),
        (0, 0),
    )


def _make_ground_mesh(frame: Frame, sand: Sand) -> tuple[Array, Array]:
    """Make the mesh of the sand in our world: fine where the rocks are, level at height 0 around them and under the
    cameras."""
    fine = np.arange(-_FINE_EXTENT_M, _FINE_EXTENT_M + _FINE_SPACING_M / 2, _FINE_SPACING_M)
    coarse = np.linspace(_FINE_EXTENT_M, _COARSE_REACH_M, 8)[1:]
    line = np.concatenate([-coarse[::-1], fine, coarse])
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(len(grid))])
    inner = np.hypot(*grid.T) < _LEVEL_AT_M
    for _ in range(4):  # the vertical of the two worlds is a degree or two apart
        there = points[inner] @ frame.world + frame.origin
        points[inner, 2] += sand.heights(there[:, :2]) - there[:, 2]
    points[:, 2] *= np.clip((_LEVEL_AT_M - np.hypot(*grid.T)) / (_LEVEL_AT_M - _LEVEL_FROM_M), 0.0, 1.0)
    n = len(line)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)[None]).ravel()
    return points, np.concatenate([np.stack([k, k + 1, k + n + 1], axis=1), np.stack([k, k + n + 1, k + n], axis=1)])


def write_ground(folder: Path, frame: Frame, sand: Sand, rocks: Sequence[Rock]) -> dict[bool, Path]:
    """Write the ground with the rocks (``True``) and without them, in metres, z up, and return the files."""
    points, faces = _make_ground_mesh(frame, sand)
    vertices, triangles = [points], [faces]
    for rock in rocks:
        _, above = sand.visible(rock)
        triangles.append(above + sum(map(len, vertices)))
        vertices.append(frame.to_world_axes(rock.vertices))
    found = {kept: folder / f"ground_{frame.position}{'_rocks' if kept else ''}.ply" for kept in (False, True)}
    folder.mkdir(parents=True, exist_ok=True)
    write_triangles(found[False], points, faces)
    write_triangles(found[True], np.concatenate(vertices), np.concatenate(triangles))
    return found


def describe_scene(frame: Frame, lamp: Array, mesh: Path) -> Settings:
    """Return the complete settings of a photograph: our rig, a lamp near the ground, and the mesh with lunar regolith
    on it."""
    way, eye = (frame.to_world_axes(point[None])[0] for point in (lamp, frame.left))
    distance = float(np.linalg.norm(way))
    forward = frame.world @ frame.axes[2]
    middle = np.array(frame.size) / 2 + frame.corner
    width, height = frame.size
    return merged(
        defaults(),
        load_preset("surfaces/hapke_lunar_like"),
        check(
            {
                "source": {"kind": "MESH", "file": str(mesh), "centre": False, "up_axis": "Z"},
                "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0},
                "hapke": {"backend": "NODES"},
                "rig": {
                    "x_m": float(eye[0]),
                    "y_m": float(eye[1]),
                    "height_m": float(eye[2]),
                    "heading_deg": math.degrees(math.atan2(forward[0], forward[1])),
                    "pitch_deg": math.degrees(-math.asin(forward[2])),
                    "baseline_m": frame.baseline_m,
                    "width_px": width,
                    "height_px": height,
                    "sensor_width_mm": _SENSOR_MM,
                    "focal_length_mm": frame.focal_px * _SENSOR_MM / width,
                    "principal_x_px": float(-middle[0]),
                    "principal_y_px": float(-middle[1]),
                },
                "light": {
                    "directions_from": "ANGLES",
                    "planet": False,
                    "sun_distance_m": distance,
                    "sun_elevation_deg": math.degrees(math.asin(way[2] / distance)),
                    "sun_azimuth_deg": math.degrees(math.atan2(way[0], way[1])),
                    "sun_angular_diameter_deg": LAMP_DEG,
                },
                "quality": {"samples": _SAMPLES, "denoiser": "NONE", "noise_threshold": 0.0, "diffuse_bounces": 0},
            },
            "a photograph",
        ),
    )


@dataclass(frozen=True)
class Twin:
    """The images (H, W) of an eye in our renders: masks of rock, of shadow, and of the shadow that the sand casts
    without rocks; radiance; and planar depth in metres."""

    rock: Array
    shadow: Array
    own_shadow: Array
    light: Array
    depth: Array


def read_twin(with_rocks: Pair, without: Pair, eye: str) -> Twin:
    """Read the twin of a photograph of an eye ``L`` or ``R``, from a render with the rocks and one without them."""
    from ...stereo.images.exr import read_view  # which needs OpenEXR

    name = "left" if eye == "L" else "right"
    here, bare = (read_view(pair.image(name)) for pair in (with_rocks, without))
    nearer = np.where(np.isnan(bare.depth), np.inf, bare.depth) - np.where(np.isnan(here.depth), np.inf, here.depth)
    rock = np.nan_to_num(nearer, nan=0.0) > _MIN_GAP_M
    light, full = (view.radiance.mean(axis=-1) for view in (here, bare))
    # Light falls with the square of the distance to the lamp.
    squared = _compute_distances_to_lamp(with_rocks, name, here.depth) ** 2
    lit = np.nanmedian(full * squared)
    seen = ~np.isnan(bare.depth)
    dark = ((light < _SHADOW_SHARE * full) | (light * squared < _DARK_SHARE * lit)) & seen
    return Twin(rock, dark & ~rock, (full * squared < _DARK_SHARE * lit) & seen, light, here.depth)


def _compute_distances_to_lamp(pair: Pair, name: str, depth: Array) -> Array:
    """Compute the distance (H, W), m, from the lamp to the surface that each pixel of an eye sees; NaN for sky."""
    camera, pose = pair.camera, np.array(pair.data["poses_camera_to_world"][name])
    u, v = (
        (np.arange(count) + 0.5 - centre) / camera.focal_px
        for count, centre in ((camera.width_px, camera.cx_px), (camera.height_px, camera.cy_px))
    )
    ray = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1)
    points = (ray * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
    sun = pair.data["light"]["sun"]
    return np.asarray(np.linalg.norm(points - np.array(sun["direction_to_world"]) * sun["distance_m"], axis=-1))


@dataclass(frozen=True)
class Masks:
    """Masks (H, W) of rock and shadow in a photograph, as labelled and as rendered, without unscanned objects. ``twin``
    is the photograph's twin.

    ``judged`` (H, W) marks the pixels that show the sandbox or scanned objects.
    """

    rock: Array
    shadow: Array
    our_rock: Array
    our_shadow: Array
    judged: Array
    twin: Twin

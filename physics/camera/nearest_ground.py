"""The greatest disparity that described ground and its rocks can have, found without building them.

Heights are sampled on a fan in front of the camera, rocks are replaced by the boxes around them, and occlusion is
ignored. ``DEPTH_MARGIN`` allows for ground between the samples.
"""

from __future__ import annotations

import json
import math
from dataclasses import astuple

import numpy as np

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..light.directions import camera_axes
from ..rocks.beyond_patch import make_view_beyond
from ..rocks.place_rocks import euler_matrices
from ..terrain.standing_places import RockyGround, make_rocky_ground

#: Share by which ground between the samples may be nearer than the nearest sample.
DEPTH_MARGIN = 0.1
#: Number of directions of the fan.
_FAN_DIRECTIONS = 49
#: Number of distances in each direction.
_FAN_DISTANCES = 150
#: Distance of the first sample in heights of the camera.
_FAN_START = 0.05
#: Distance of the last sample in heights of the camera.
_FAN_END = 12.0
#: Least depth that counts, in heights of the camera. Nearer ground gives no useful range of disparities.
_MIN_DEPTH = 0.05

#: The last ground by its key; the pairs of one scene stand on the same ground.
_last_ground: dict[str, RockyGround] = {}
#: Topics of settings that do not affect the ground, except by the settings that ``make_ground_name_key`` adds.
_TOPICS_NOT_OF_GROUND = {
    "rig",
    "sensor",
    "light",
    "quality",
    "dataset",
    "surface",
    "rock_surface",
    "hapke",
    "textures",
    "lander",
    "arm",
    "workspace",
    "excavation",
}


def find_greatest_disparity_px(settings: Settings, focal_px: float) -> float | None:
    """Find the greatest disparity in px of the described ground and rocks in the image. None if the ground comes from a
    file, cannot be made, or is outside the image.
    """
    if settings.source.kind != "PROCEDURAL":
        return None
    try:
        return _find_greatest(_get_ground(settings), settings.rig, focal_px)
    except IcyMoonError:
        return None


def make_ground_name_key(settings: Settings) -> str:
    """Make a cache key of the ground: equal texts for settings with the same ground and rocks."""
    made_of = {topic: values for topic, values in settings.items() if topic not in _TOPICS_NOT_OF_GROUND}
    # Which rocks are drawn beyond the patch depends on the rig.
    beyond = make_view_beyond(settings)
    return json.dumps([made_of, settings.dataset.seed, beyond and astuple(beyond)], sort_keys=True)


def _get_ground(settings: Settings) -> RockyGround:
    """Return the ground of the settings; the last one is cached by its key."""
    name = make_ground_name_key(settings)
    if name not in _last_ground:
        _last_ground.clear()
        _last_ground[name] = make_rocky_ground(settings)
    return _last_ground[name]


def _find_greatest(ground: RockyGround, rig: RigSettings, focal: float) -> float | None:
    """Find the greatest disparity in px of the samples and rocks; None if all are outside the image."""
    axes = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)
    eye = np.array([rig.x_m, rig.y_m, float(ground.heights(rig.x_m, rig.y_m)) + rig.height_m])
    # Seen from above, the fan of a camera that looks down is wider than its field of view.
    narrow = max(math.cos(math.radians(rig.pitch_deg)), 0.1)
    wide = int(rig.width_px) if rig.roll_deg == 0 else math.hypot(int(rig.width_px), int(rig.height_px))
    half = min(math.pi, 2 * math.atan(wide / 2 / focal / narrow))
    direction = np.radians(rig.heading_deg) + np.linspace(-half, half, _FAN_DIRECTIONS)[:, None]
    distance = rig.height_m * np.geomspace(_FAN_START, _FAN_END, _FAN_DISTANCES)
    x, y = eye[0] + distance * np.sin(direction), eye[1] + distance * np.cos(direction)
    points = np.stack([x, y, ground.heights(x, y)], axis=-1).reshape(-1, 3)
    depths = [_depths_in_image(points, np.zeros(len(points)), np.zeros(len(points)), eye, axes, rig, focal)]
    rocks = ground.rocks
    if rocks is not None and len(rocks.reach_m):
        clear = float(ground.settings.rocks.clear_radius_m)  # rocks so near to any camera are left out
        away = np.hypot(*(rocks.position_m[:, :2] - eye[:2]).T)
        near = (away < _FAN_END * rig.height_m) & (away > clear + rocks.reach_m)
        half_m = rocks.scale_m[near] / 2
        along = np.abs(np.einsum("nij,i->nj", euler_matrices(rocks.rotation[near]), axes[:, 2]))
        depths.append(
            _depths_in_image(
                rocks.position_m[near],
                (along * half_m).sum(axis=1),
                np.linalg.norm(half_m, axis=1),
                eye,
                axes,
                rig,
                focal,
            )
        )
    depth = np.concatenate(depths)
    if not depth.size:
        return None
    return float(focal * rig.baseline_m / (depth.min() * (1 - DEPTH_MARGIN)))


def _depths_in_image(
    points: Array,
    toward: Array,
    size: Array,
    eye: Array,
    axes: Array,
    rig: RigSettings,
    focal: float,
) -> Array:
    """Find the planar depths (k,), m, of the near sides of objects in the image. ``points`` (n, 3) are the objects'
    centres, ``toward`` (n,) their extents toward the camera and ``size`` (n,) to each side, in metres.
    """
    x, y, z = ((points - eye) @ axes).T
    depth = z - toward
    known = np.isfinite(depth) & (depth > _MIN_DEPTH * rig.height_m)
    u, v, wide = (np.where(known, focal * each / np.where(known, depth, 1.0), np.inf) for each in (x, y, size))
    right, down = float(rig.principal_x_px), float(rig.principal_y_px)
    inside = (np.abs(u + right) <= int(rig.width_px) / 2 + wide) & (np.abs(v + down) <= int(rig.height_px) / 2 + wide)
    return depth[known & inside]

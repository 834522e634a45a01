"""The greatest disparity that described ground and its rocks can have, without building them.

Heights are sampled on a fan in front of the camera, rocks are replaced by the boxes around them, and occlusion is
ignored. ``SPARE`` makes up for ground between the samples.
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

#: Share of the depth of the nearest sample that nearer ground may be off.
SPARE = 0.1
#: Directions and distances of the fan, and its ends in heights of the camera.
_DIRECTIONS, _DISTANCES, _NEAREST, _FARTHEST = 49, 150, 0.05, 12.0
#: Part of the camera's height within which nothing counts: the lens is in no rock, and such depths are no range.
_LEAST_DEPTH = 0.05

#: The ground that was made last, by its name: pairs of one scene stand on the same.
_last: dict[str, RockyGround] = {}
#: Topics of settings that the ground does not depend on, but for what ``name_ground`` adds.
_NOT_GROUND = {
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
    """The greatest disparity, px, of the ground and the rocks that the settings describe in the image.

    None if the ground is not described but comes from a file, if it cannot be made, or if none of it is in the image.
    """
    if settings.source.kind != "PROCEDURAL":
        return None
    try:
        return _find_greatest(_get_ground(settings), settings.rig, focal_px)
    except IcyMoonError:
        return None


def name_ground(settings: Settings) -> str:
    """A text that is equal for settings that describe the same ground and rocks. Ground that follows another with the
    same name is not made again."""
    made_of = {topic: values for topic, values in settings.items() if topic not in _NOT_GROUND}
    # Which rocks are drawn beyond the patch depends on the rig.
    beyond = make_view_beyond(settings)
    return json.dumps([made_of, settings.dataset.seed, beyond and astuple(beyond)], sort_keys=True)


def _get_ground(settings: Settings) -> RockyGround:
    name = name_ground(settings)
    if name not in _last:
        _last.clear()
        _last[name] = make_rocky_ground(settings)
    return _last[name]


def _find_greatest(ground: RockyGround, rig: RigSettings, focal: float) -> float | None:
    axes = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)
    eye = np.array([rig.x_m, rig.y_m, float(ground.heights(rig.x_m, rig.y_m)) + rig.height_m])
    # Seen from above, the fan of a camera that looks down is wider than its field of view.
    narrow = max(math.cos(math.radians(rig.pitch_deg)), 0.1)
    wide = int(rig.width_px) if rig.roll_deg == 0 else math.hypot(int(rig.width_px), int(rig.height_px))
    half = min(math.pi, 2 * math.atan(wide / 2 / focal / narrow))
    direction = np.radians(rig.heading_deg) + np.linspace(-half, half, _DIRECTIONS)[:, None]
    distance = rig.height_m * np.geomspace(_NEAREST, _FARTHEST, _DISTANCES)
    x, y = eye[0] + distance * np.sin(direction), eye[1] + distance * np.cos(direction)
    points = np.stack([x, y, ground.heights(x, y)], axis=-1).reshape(-1, 3)
    depths = [_depths_in_image(points, np.zeros(len(points)), np.zeros(len(points)), eye, axes, rig, focal)]
    rocks = ground.rocks
    if rocks is not None and len(rocks.reach_m):
        clear = float(ground.settings.rocks.clear_radius_m)  # about every camera, so rocks there are left out
        away = np.hypot(*(rocks.position_m[:, :2] - eye[:2]).T)
        near = (away < _FARTHEST * rig.height_m) & (away > clear + rocks.reach_m)
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
    return float(focal * rig.baseline_m / (depth.min() * (1 - SPARE)))


def _depths_in_image(
    points: Array,
    toward: Array,
    size: Array,
    eye: Array,
    axes: Array,
    rig: RigSettings,
    focal: float,
) -> Array:
    """Planar depths of the near sides of things at ``points`` (n, 3) that reach ``toward`` (n,) the camera and are
    ``size`` (n,) wide to any side, for those that are in the image."""
    x, y, z = ((points - eye) @ axes).T
    depth = z - toward
    known = np.isfinite(depth) & (depth > _LEAST_DEPTH * rig.height_m)
    u, v, wide = (np.where(known, focal * each / np.where(known, depth, 1.0), np.inf) for each in (x, y, size))
    right, down = float(rig.principal_x_px), float(rig.principal_y_px)
    inside = (np.abs(u + right) <= int(rig.width_px) / 2 + wide) & (np.abs(v + down) <= int(rig.height_px) / 2 + wide)
    return depth[known & inside]

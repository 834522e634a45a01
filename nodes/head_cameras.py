"""The cameras of a head as Blender's cameras in the built scene, and their properties for a render."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ..formats.calibrations.head_file import read_head
from ..physics.camera.calibrated_camera import CalibratedCamera
from ..physics.camera.head_camera import MAX_CAMERAS, HeadCamera, Orthographic, Projection
from ..physics.camera.lens_models import Fisheye
from ..physics.scene_checks import MIN_EYE_HEIGHT_M, describe_depth
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.blender import compat
from ..support.errors import IcyMoonError
from .datablocks.blend_file_paths import make_paths_absolute
from .datablocks.fingerprint import NAME, TAG, find_built_objects
from .ground.heights_under import probe_heights
from .rig import CLIP_M, OPENCV_FROM_BLENDER

#: Roles of the objects, in the order of the file.
ROLES = tuple(f"head camera {k + 1}" for k in range(MAX_CAMERAS))
#: Width of a sensor in Blender, mm. It sets the scale of lengths on the sensor, and no light depends on it.
_SENSOR_MM = 36.0


def read_head_cameras(settings: Settings) -> tuple[HeadCamera, ...]:
    """Read the cameras of ``rig.head_file``; empty without a file. Raises IcyMoonError for a faulty file."""
    file = str(make_paths_absolute(settings).rig.head_file)
    return read_head(Path(file)).cameras if file else ()


def build_head_cameras(settings: Settings, rig: bpy.types.Object, terrain: bpy.types.Object) -> list[bpy.types.Object]:
    """Build Blender's cameras for the head. Cameras of the frame RIG are children of the ``rig``. The caller links
    them.

    Raises IcyMoonError for a camera that is under the ground.
    """
    cameras = read_head_cameras(settings)
    if not cameras:
        return []
    places = _find_places(cameras, np.array(rig.matrix_world), terrain)
    made = []
    for camera, (ground_m, world) in zip(cameras, places, strict=True):
        depth_m = ground_m - world[2, 3]
        if depth_m > -MIN_EYE_HEIGHT_M:
            raise IcyMoonError(describe_obstructed_camera(settings.rig.head_file, camera.name, depth_m))
    for role, camera, (_, world) in zip(ROLES, cameras, places, strict=False):
        lens = bpy.data.cameras.new(f"{NAME} {camera.name}")
        item = bpy.data.objects.new(f"{NAME} {camera.name}", lens)
        item[TAG] = role
        set_projection(lens, camera.rendered)
        if camera.frame == "RIG":
            item.parent = rig
            item.matrix_parent_inverse = Matrix.Identity(4)
            item.matrix_basis = Matrix((np.linalg.inv(np.array(rig.matrix_world)) @ world).tolist())
        else:
            item.matrix_world = Matrix(world.tolist())
        made.append(item)
    return made


def describe_obstructed_camera(file: str, name: str, depth_m: float | None) -> str:
    """Describe in a sentence a head camera at a depth in metres under the ground. The depth is negative just above the
    ground and infinite in a rock. Empty for the depth None, a free camera."""
    if depth_m is None:
        return ""
    if math.isinf(depth_m):
        return f"{file}: the camera {name} is in a rock; change its position_m, or the rocks."
    return f"{file}: the camera {name} is {describe_depth(depth_m)}; raise its position_m."


def _find_places(cameras: tuple[HeadCamera, ...], rig: Array, terrain: bpy.types.Object) -> list[tuple[float, Array]]:
    """Find for each camera the height in metres of the ground beneath it (NaN outside the ground), and its matrix (4,
    4) in the world, in Blender's axes."""
    flip = np.eye(4)
    flip[:3, :3] = OPENCV_FROM_BLENDER
    made = []
    for camera in cameras:
        world = (rig @ flip if camera.frame == "RIG" else np.eye(4)) @ camera.pose @ flip
        made.append(world)
    with probe_heights(terrain) as height_at:
        ground = np.asarray(height_at(*(np.array([world[k, 3] for world in made]) for k in (0, 1))), float)
    for camera, world, under in zip(cameras, made, ground.tolist(), strict=True):
        if camera.frame == "GROUND":
            if math.isnan(under):
                raise IcyMoonError(
                    f"There is no ground beneath the camera {camera.name} of the head; change its position_m, or set "
                    "its frame to ZERO."
                )
            world[2, 3] += under
    return list(zip(ground.tolist(), made, strict=True))


def find_head_poses(collection: bpy.types.Collection, rig: bpy.types.Object) -> list[Array]:
    """Find the matrices (4, 4) from the cameras of the head, in OpenCV's axes, to the world, in the order of the
    file."""
    there = find_built_objects(collection)
    made = []
    for item in (there[role] for role in ROLES if role in there):
        # Blender evaluates children later; a rig that is turned for a pair is not evaluated at all.
        world = rig.matrix_world @ item.matrix_parent_inverse @ item.matrix_basis if item.parent else item.matrix_world
        pose = np.array(world, np.float64)
        pose[:3, :3] = pose[:3, :3] / np.linalg.norm(pose[:3, :3], axis=0) @ OPENCV_FROM_BLENDER
        made.append(pose)
    return made


def set_projection(lens: bpy.types.Camera, projection: Projection) -> None:
    """Give a camera of Blender a projection that Cycles has, see ``head_camera.is_plain``."""
    width, height = projection.size_px
    lens.sensor_fit, lens.sensor_width = "HORIZONTAL", _SENSOR_MM
    lens.shift_x = lens.shift_y = 0.0
    lens.dof.use_dof = False
    lens.clip_start, lens.clip_end = CLIP_M
    if isinstance(projection, Orthographic):
        lens.type, lens.ortho_scale = "ORTHO", projection.width_m
        return
    if not isinstance(projection, CalibratedCamera):
        half = projection.step_rad * np.array([width, height]) / 2
        compat.set_panorama(lens, longitude_rad=float(half[0]), latitude_rad=float(half[1]))
        return
    # Both shifts are in widths of the image, y up, and move the frame, not the axis.
    lens.shift_x = ((width - 1) / 2 - projection.cx_px) / width
    lens.shift_y = (projection.cy_px - (height - 1) / 2) / width
    focal_mm = projection.fx_px * _SENSOR_MM / width
    if isinstance(projection.lens, Fisheye):
        compat.set_fisheye(lens, focal_mm)
    else:
        lens.type, lens.lens_unit, lens.lens = "PERSP", "MILLIMETERS", focal_mm

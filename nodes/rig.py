"""The stereo camera: one Blender camera with two parallel eyes. The left eye is at the position of the camera."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..physics.light.directions import camera_axes
from ..settings.topics.camera import RigSettings
from ..support.arrays import Array

#: Blender's camera looks along -z with y up; OpenCV's along +z with y down.
OPENCV_FROM_BLENDER = np.diag([1.0, -1.0, -1.0])
#: The nearest and the farthest surfaces that cameras see.
CLIP_M = 1.0e-4, 1.0e6


def build_rig(name: str, rig: RigSettings, ground_m: float) -> bpy.types.Object:
    """Build a camera from ``rig`` settings, ``rig.height_m`` above the ground at ``ground_m``."""
    camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    camera.data.passepartout_alpha = 1.0
    place_rig(camera, rig, ground_m)
    return camera


def place_rig(camera: bpy.types.Object, rig: RigSettings, ground_m: float) -> None:
    """Give an existing camera the lens, baseline and pose of ``rig`` settings."""
    lens = camera.data
    lens.lens_unit = "MILLIMETERS"
    for name, (_, value) in list_lens_values(rig).items():
        setattr(lens, name, value)
    lens.dof.use_dof = False
    lens.clip_start, lens.clip_end = CLIP_M
    lens.stereo.convergence_mode = "PARALLEL"
    lens.stereo.pivot = "LEFT"
    lens.stereo.interocular_distance = rig.baseline_m
    lens.stereo.use_spherical_stereo = False
    axes = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg) @ OPENCV_FROM_BLENDER
    pose = np.eye(4)
    pose[:3, :3] = axes
    pose[:3, 3] = rig.x_m, rig.y_m, ground_m + rig.height_m
    camera.matrix_world = Matrix(pose.tolist())


def list_lens_values(rig: RigSettings) -> dict[str, tuple[str, Any]]:
    """Return the ``rig`` setting and the value of each property of Blender's camera, by property."""
    # Both shifts are in widths of the image, y up, and move the frame, not the axis.
    return {
        "type": ("rig.focal_length_mm", "PERSP"),
        "sensor_fit": ("rig.sensor_width_mm", "HORIZONTAL"),
        "lens": ("rig.focal_length_mm", rig.focal_length_mm),
        "sensor_width": ("rig.sensor_width_mm", rig.sensor_width_mm),
        "shift_x": ("rig.principal_x_px", -rig.principal_x_px / rig.width_px),
        "shift_y": ("rig.principal_y_px", rig.principal_y_px / rig.width_px),
    }


def find_eye_poses(matrix_world: Matrix, baseline_m: float) -> dict[str, Array]:
    """Find the camera-to-world matrices (4, 4) of both eyes in OpenCV's axes, with positions in metres."""
    left = np.array(matrix_world, np.float64)
    left[:3, :3] /= np.linalg.norm(left[:3, :3], axis=0)
    left[:3, :3] = left[:3, :3] @ OPENCV_FROM_BLENDER
    right = left.copy()
    right[:3, 3] += left[:3, 0] * baseline_m
    return {"left": left, "right": right}


@contextmanager
def turn_about_eye(camera: bpy.types.Object, turn_deg: float, about: bpy.types.Object | None = None) -> Iterator[None]:
    """Rotate an object clockwise by ``turn_deg`` degrees about the vertical through the left eye, and rotate it back at
    the end. ``about`` is the camera if the object is the housing of the cameras."""
    # Setting the old matrix would change location and rotation by a rounding error, which would count as an edit.
    pose = {
        key: tuple(getattr(camera, key))
        for key in ("location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle", "scale")
    }
    if turn_deg:
        turn, eye = Matrix.Rotation(-math.radians(turn_deg), 4, "Z"), (about or camera).matrix_world.translation
        camera.matrix_world = Matrix.Translation(eye) @ turn @ Matrix.Translation(-eye) @ camera.matrix_world
    try:
        yield
    finally:
        for key, value in pose.items():
            setattr(camera, key, value)

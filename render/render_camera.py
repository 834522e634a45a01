"""The camera of the images: a copy of the built camera.

The built camera stays the parallel rig without blur. Only the copy gets the changes that would disturb the user in the
scene: the place of Cycles' first sample in a pixel, overscan, toe-in, depth of field and motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ..nodes.head_cameras import set_projection
from ..nodes.rig import OPENCV_FROM_BLENDER
from ..physics.camera.blur import Blur, find_pose_after
from ..physics.camera.head_camera import Projection
from ..physics.camera.stereo_camera import StereoCamera
from ..support.arrays import Array
from ..support.blender import compat
from ..support.errors import IcyMoonError

#: Place of Cycles' first sample of a pixel, right of and above its centre, at the pixel filter of ``quality``: half a
#: bin of the filter's table. Measured the same in 4.3, 5.0 and 5.2.
SAMPLE_OFFSET_PX = 5.4e-4
#: Largest turn of a camera with a rolling shutter between two of Cycles' steps, in degrees. The straight line between
#: them is off by 4e-5 of the baseline, so by 4e-5 of the disparity.
_MAX_TURN_PER_STEP_DEG = 1.0
#: Property groups of a lens. Until Blender 4.5, Cycles' own properties are one of them.
_LENS_GROUPS = ("stereo", "dof", "cycles")
_COMMON_PROPERTIES = {prop.identifier for prop in bpy.types.ID.bl_rna.properties}


@contextmanager
def add_render_camera(scene: bpy.types.Scene, built: bpy.types.Object) -> Iterator[None]:
    """Give ``scene`` a separate camera, which ``set_up_camera`` makes a copy of the ``built`` camera.

    All renders share it: Cycles builds its scene again when an object comes or goes, but not when an object changes.
    """
    lens = bpy.data.cameras.new(built.data.name)
    item = bpy.data.objects.new(built.name, lens)
    scene.collection.objects.link(item)
    scene.camera = item
    try:
        yield
    finally:
        bpy.data.objects.remove(item)
        bpy.data.cameras.remove(lens)


@contextmanager
def set_up_camera(
    scene: bpy.types.Scene,
    built: bpy.types.Object,
    camera: StereoCamera,
    blur: Blur | None,
    toed: bool,
    wide: bool = False,
) -> Iterator[None]:
    """Make the camera of ``scene``, see ``add_render_camera``, a copy of the ``built`` camera, in its frame.

    With ``toed`` the eyes are turned in by the angle of ``camera``, else they are parallel; with ``wide`` they have its
    panorama. ``blur`` is given to the copy's lens and movement; the scene's present frame is the middle of the
    exposure.
    """
    item, pose, baseline = scene.camera, built.matrix_world.copy(), built.data.stereo.interocular_distance
    _copy_lens(built.data, item.data)
    _set_frame(scene, item.data, camera, wide)
    if toed and camera.toe_in_deg:
        # Blender turns both eyes about the middle between them.
        stereo = item.data.stereo
        stereo.convergence_mode, stereo.pivot = "TOE", "CENTER"
        stereo.convergence_distance = baseline / 2 / math.tan(math.radians(camera.toe_in_deg))
        middle = baseline / 2
    else:
        middle = 0.0
    item.matrix_world = pose @ Matrix.Translation((middle, 0.0, 0.0))
    if blur is not None:
        _set_focus(item.data, blur)
    if blur is None or blur.exposure_s is None:
        yield
        return
    _set_motion(scene, item, pose, middle, blur, _find_shutter(blur, blur.exposure_s, camera))
    try:
        yield
    finally:
        action = item.animation_data.action
        item.animation_data_clear()
        item.rotation_mode = "XYZ"
        scene.cycles.rolling_shutter_type = "NONE"
        bpy.data.actions.remove(action)


@contextmanager
def set_up_head_camera(scene: bpy.types.Scene, projection: Projection, pose: Array) -> Iterator[None]:
    """Make the camera of ``scene``, see ``add_render_camera``, a single camera of a ``projection`` that Cycles
    supports. Its pose (4, 4) is in the world in OpenCV's axes."""
    item, render = scene.camera, scene.render
    set_projection(item.data, projection)
    render.resolution_x, render.resolution_y = projection.size_px
    matrix = pose.copy()
    matrix[:3, :3] = pose[:3, :3] @ OPENCV_FROM_BLENDER
    item.matrix_world = Matrix(matrix.tolist())
    render.use_motion_blur = render.use_multiview = False
    try:
        yield
    finally:
        render.use_multiview = True


def _copy_lens(source: bpy.types.bpy_struct, target: bpy.types.bpy_struct) -> None:
    """Copy the properties of a lens, or of a group in it."""
    for prop in source.bl_rna.properties:
        name = prop.identifier
        if name in _COMMON_PROPERTIES or name.startswith("angle"):  # the angle follows from focal length and sensor
            continue
        if name in _LENS_GROUPS:
            _copy_lens(getattr(source, name), getattr(target, name))
        elif not prop.is_readonly and getattr(target, name) != getattr(source, name):
            setattr(target, name, getattr(source, name))


def _set_frame(scene: bpy.types.Scene, lens: bpy.types.Camera, camera: StereoCamera, wide: bool) -> None:
    """Widen the frame by the overscan, with unchanged pixel size and principal point; or set the panorama."""
    width, height = camera.light_px if wide else camera.rendered_px
    scene.render.resolution_x, scene.render.resolution_y = width, height
    if (scene.render.resolution_x, scene.render.resolution_y) != (width, height):
        why, fix = ("In its panorama", "shrink the images") if wide else ("With its overscan", "lower rig.overscan")
        raise IcyMoonError(f"{why} an image is {width} x {height} px, more than Blender renders; {fix}.")
    if wide and camera.panorama:
        lens.shift_x = lens.shift_y = 0.0
        compat.set_equidistant_fisheye(lens, camera.panorama.field_rad)
        return
    wider = width / camera.width_px
    lens.sensor_width *= wider
    # The frame is shifted by the offset of Cycles' sample from the pixel centre, so that truth is exact.
    lens.shift_x, lens.shift_y = (shift / wider - SAMPLE_OFFSET_PX / width for shift in (lens.shift_x, lens.shift_y))


@contextmanager
def shift_frame(scene: bpy.types.Scene, columns: float) -> Iterator[None]:
    """Move the frame of the camera of ``scene`` to the right by ``columns`` pixels."""
    lens = scene.camera.data
    before = lens.shift_x
    lens.shift_x = before + columns / scene.render.resolution_x
    try:
        yield
    finally:
        lens.shift_x = before


def _set_focus(lens: bpy.types.Camera, blur: Blur) -> None:
    if blur.focus_m is None:
        return
    dof = lens.dof
    dof.use_dof, dof.focus_object, dof.focus_distance = True, None, blur.focus_m
    dof.aperture_fstop = blur.f_number
    dof.aperture_blades, dof.aperture_rotation, dof.aperture_ratio = 0, 0.0, 1.0


@dataclass(frozen=True)
class _Shutter:
    """The duration in seconds of one frame of Blender; the share of it for which a row is exposed, 1 for a global
    shutter; the seconds by which the frame's middle is before the exposure's middle; and the steps of Cycles' motion.
    """

    seconds: float
    row_share: float = 1.0
    early_s: float = 0.0
    steps: int = 1


def _find_shutter(blur: Blur, exposure_s: float, camera: StereoCamera) -> _Shutter:
    """Find the shutter by which Cycles exposes the rows of a camera.

    Cycles exposes row r of n, counted from 0 on top, for a share d of the frame, about its middle plus ((r + 1) / n -
    1/2) (1 - d) of the frame (``camera_sample`` in its kernel; measured in 4.2, 4.3, 4.5, 5.0). So the frame lasts the
    exposure and n rows, and begins half a row earlier.
    """
    if not blur.readout_s:
        return _Shutter(exposure_s)
    row_s = blur.readout_s / max(1, camera.height_px - 1)
    seconds = exposure_s + camera.rendered_px[1] * row_s
    # Between steps, Cycles moves the right eye on straight lines, although it really moves on an arc.
    parts = max(1.0, float(np.linalg.norm(blur.turn_deg_s)) * seconds / _MAX_TURN_PER_STEP_DEG)
    return _Shutter(seconds, exposure_s / seconds, row_s / 2, max(1, math.ceil(math.log2(parts))))


def _set_motion(
    scene: bpy.types.Scene, item: bpy.types.Object, pose: Matrix, middle: float, blur: Blur, shutter: _Shutter
) -> None:
    """Move the camera while the shutter is open, which lasts one frame.

    Cycles takes the camera's pose at the ends of equal parts of the exposure, two at least. Keys are at exactly these
    times, so Blender's interpolation between keys has no effect.
    """
    render = scene.render
    render.use_motion_blur, render.motion_blur_shutter, render.motion_blur_position = True, 1.0, "CENTER"
    item.cycles.use_motion_blur, item.cycles.motion_steps = True, shutter.steps
    if shutter.row_share < 1.0:
        scene.cycles.rolling_shutter_type, scene.cycles.rolling_shutter_duration = "TOP", shutter.row_share
    turned = np.eye(4)
    turned[:3, :3] = OPENCV_FROM_BLENDER
    item.rotation_mode = "QUATERNION"
    sides = np.linspace(-0.5, 0.5, 2**shutter.steps + 1)
    for side in sorted(sides.tolist(), key=abs, reverse=True):
        step = Matrix((turned @ find_pose_after(blur, side * shutter.seconds - shutter.early_s) @ turned).tolist())
        item.matrix_world = pose @ step @ Matrix.Translation((middle, 0.0, 0.0))
        for path in ("location", "rotation_quaternion"):
            item.keyframe_insert(path, frame=scene.frame_current + side)

"""Tests on the rendered meshes whether the eyes, the head's cameras and the lamps of a built scene are inside its
ground or a rock."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import bpy
from mathutils import Matrix, Vector

from ..physics import scene_checks
from ..physics.scene_checks import (
    MIN_EYE_HEIGHT_M,
    describe_buried_eye,
    describe_buried_lamp,
    describe_eye_in_rock,
)
from ..support.arrays import Array
from .built_scene import Built
from .datablocks.blend_file_paths import make_paths_absolute
from .datablocks.fingerprint import TAG
from .head_cameras import describe_obstructed_camera, find_head_poses, read_head_cameras
from .light.lamps import find_lamp_matrix
from .rig import find_eye_poses

_UP = Vector((0.0, 0.0, 1.0))
#: Maximum number of faces of the user's own objects that a ray passes before the test gives up.
_MAX_PASSED = 1000


def find_reasons_when_built(built: Built, scene: bpy.types.Scene | None = None) -> list[str]:
    """Find the sentences of ``find_reasons`` for a scene that was just built.

    The sentences on the two eyes follow from the settings if possible: their mesh is tested only if it may be coarser
    than the images under the camera. Lamps and the cameras of a head are always tested by the mesh.
    """
    settings = built.settings
    graded = settings.source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED"
    found: list[str] = list(scene_checks.find_reasons(make_paths_absolute(settings)))
    if found or (graded and not settings.rig.head_file and not settings.light.lamps):
        return found
    return find_reasons(built, scene=scene, ask_eyes=not graded)


def find_reasons(
    built: Built, turn_deg: float = 0.0, scene: bpy.types.Scene | None = None, *, ask_eyes: bool = True
) -> list[str]:
    """Find the eyes, head cameras and lamps inside the ground or a rock, where they see only black or light nothing.
    Returns a sentence for each.

    The rig is turned clockwise by ``turn_deg``. Without ``ask_eyes`` the two eyes are not tested. A ray upward from
    inside the ground or a rock leaves through the outer side of a face. From outside it hits nothing, or enters an
    overhang. The test runs in ``scene``, which contains only the built scene, or in a temporary scene, so that Blender
    computes nothing in the user's scene.
    """
    with nullcontext(scene) if scene else _make_scene(built) as test_scene:
        layer = test_scene.view_layers[0]
        layer.update()
        rig = built.camera.evaluated_get(layer.depsgraph)
        poses = find_eye_poses(rig.matrix_world, built.settings.rig.baseline_m)
        turn = _make_rotation(poses["left"][:3, 3], turn_deg)
        found = [
            _find_eye_reason(test_scene, layer.depsgraph, built, eye, turn @ Vector(pose[:3, 3].tolist()))
            for eye, pose in poses.items()
            if ask_eyes
        ]
        # The render reports a head that has changed since the build.
        for camera, pose in zip(
            read_head_cameras(built.settings), find_head_poses(built.collection, rig), strict=False
        ):
            position = Vector(pose[:3, 3].tolist())
            place = turn @ position if camera.frame == "RIG" else position
            where = _find_obstacle(test_scene, layer.depsgraph, place)
            found.append(describe_obstructed_camera(built.settings.rig.head_file, camera.name, where))
        for k, (item, lamp) in enumerate(zip(built.lamps, built.settings.light.lamps, strict=False)):
            position = find_lamp_matrix(item).translation
            place = turn @ position if lamp.place == "CAMERA" else position
            found.append(describe_buried_lamp(k, _find_obstacle(test_scene, layer.depsgraph, place)))
    return [sentence for sentence in found if sentence]


@contextmanager
def _make_scene(built: Built) -> Iterator[bpy.types.Scene]:
    scene = bpy.data.scenes.new("Icy Moon Eyes")
    try:
        scene.collection.children.link(built.collection)
        yield scene
    finally:
        bpy.data.scenes.remove(scene)


def _make_rotation(about: Array, turn_deg: float) -> Matrix:
    """Make the matrix (4, 4) that rotates the rig clockwise about the vertical through a point."""
    centre = Matrix.Translation(about.tolist())
    return centre @ Matrix.Rotation(-math.radians(turn_deg), 4, "Z") @ centre.inverted()


def _find_eye_reason(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, built: Built, eye: str, position: Vector
) -> str:
    rig, depth_m = built.settings.rig, _find_obstacle(scene, depsgraph, position)
    if depth_m is None:
        return ""
    return describe_eye_in_rock(rig, eye) if math.isinf(depth_m) else describe_buried_eye(rig, eye, depth_m)


def _find_obstacle(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, position: Vector) -> float | None:
    """Find the depth in metres of a point under the ground, negative for a point just above the ground, and infinite in
    a rock; None if the point is free."""
    role, distance, leaves = cast_ray(scene, depsgraph, position, _UP)
    if role and leaves:
        return distance if role == "terrain" else math.inf
    role, distance, _ = cast_ray(scene, depsgraph, position, -_UP)
    return -distance if role == "terrain" and distance < MIN_EYE_HEIGHT_M / 2 else None


def cast_ray(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, start: Vector, toward: Vector
) -> tuple[str, float, bool]:
    """Find the first ground or rock that a ray hits. Returns its role, its distance in metres, and whether the ray
    leaves the solid there.

    The role is empty if the ray hits none. The ray passes through the user's own objects.
    """
    at = start
    for _ in range(_MAX_PASSED):
        hit, place, normal, _, item, _ = scene.ray_cast(depsgraph, at, toward)
        if not hit:
            break
        role = item.original.get(TAG, "")
        if role in ("terrain", "rock", "rock shape"):
            return role, (place - start).length, normal.dot(toward) > 0
        passed = place + toward * 1e-4 * max(1.0, (place - start).length)
        # Ground that was made from an object lies where that object lies, so the ray would pass it too.
        if ground := _cast_on_ground(scene, depsgraph, at, passed):
            place, normal = ground
            return "terrain", (place - start).length, normal.dot(toward) > 0
        at = passed
    return "", 0.0, False


def _cast_on_ground(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, start: Vector, end: Vector
) -> tuple[Vector, Vector] | None:
    """Find the point where the line from ``start`` to ``end`` first meets the ground, and the normal there; None if it
    does not meet the ground."""
    for item in scene.objects:
        if item.get(TAG) != "terrain":
            continue
        ground = item.evaluated_get(depsgraph)
        to_local = ground.matrix_world.inverted_safe()
        first, way = to_local @ start, to_local @ end - to_local @ start
        hit, place, normal, _ = ground.ray_cast(first, way, distance=way.length)
        if hit:
            upright = (to_local.to_3x3().transposed() @ normal).normalized()
            return ground.matrix_world @ place, upright
    return None

"""Whether the eyes of a built scene are inside its ground or a rock, tested on the rendered meshes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import bpy
import numpy as np
from mathutils import Vector

from ..physics import scene_checks
from ..physics.scene_checks import LEAST_EYE_HEIGHT_M, buried_sentence, in_rock_sentence
from ..support.arrays import Array
from .built_scene import Built
from .datablocks.fingerprint import TAG
from .rig import find_eye_poses

_UP = Vector((0.0, 0.0, 1.0))
#: Maximum number of faces of the user's own objects that a ray passes before the test gives up.
_MOST_PASSED = 1000


def find_reasons_when_built(built: Built, scene: bpy.types.Scene | None = None) -> list[str]:
    """``find_reasons`` for a scene that was just built.

    They follow from the settings if possible. The mesh is tested only if it may be coarser than the images under the
    camera.
    """
    settings = built.settings
    graded = settings.source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED"
    return list(scene_checks.find_reasons(settings)) or ([] if graded else find_reasons(built, scene=scene))


def find_reasons(built: Built, turn_deg: float = 0.0, scene: bpy.types.Scene | None = None) -> list[str]:
    """Sentences on each eye that sees only black because it is inside the ground or a rock.

    The rig is turned clockwise by ``turn_deg``. A ray upward from inside the ground or a rock leaves through the outer
    side of a face. From outside it hits nothing, or enters an overhang. The test runs in ``scene``, which contains
    only the built scene, or in a temporary scene, so that Blender computes nothing in the user's scene.
    """
    with nullcontext(scene) if scene else _make_scene(built) as test_scene:
        layer = test_scene.view_layers[0]
        layer.update()
        poses = find_eye_poses(built.camera.evaluated_get(layer.depsgraph).matrix_world, built.settings.rig.baseline_m)
        found = [
            _find_eye_reason(test_scene, layer.depsgraph, built, eye, position)
            for eye, position in _find_eye_positions(poses, turn_deg).items()
        ]
    return [sentence for sentence in found if sentence]


@contextmanager
def _make_scene(built: Built) -> Iterator[bpy.types.Scene]:
    scene = bpy.data.scenes.new("Icy Moon Eyes")
    try:
        scene.collection.children.link(built.collection)
        yield scene
    finally:
        bpy.data.scenes.remove(scene)


def _find_eye_positions(poses: dict[str, Array], turn_deg: float) -> dict[str, Vector]:
    """Positions of the eyes after the rig is turned clockwise about the vertical through the left eye."""
    left, turn = poses["left"][:3, 3], np.radians(-turn_deg)
    x, y, z = poses["right"][:3, 3] - left
    right = left + np.array([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z])
    return {"left": Vector(left.tolist()), "right": Vector(right.tolist())}


def _find_eye_reason(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, built: Built, eye: str, position: Vector
) -> str:
    rig = built.settings.rig
    role, distance, leaves = _cast_ray(scene, depsgraph, position, _UP)
    if role and leaves:
        return buried_sentence(rig, eye, distance) if role == "terrain" else in_rock_sentence(rig, eye)
    role, distance, _ = _cast_ray(scene, depsgraph, position, -_UP)
    return buried_sentence(rig, eye, -distance) if role == "terrain" and distance < LEAST_EYE_HEIGHT_M / 2 else ""


def _cast_ray(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, start: Vector, toward: Vector
) -> tuple[str, float, bool]:
    """Role and distance in metres of the first ground or rock that a ray hits, and whether the ray leaves it there.

    The role is empty if the ray hits none. The ray passes the user's own objects.
    """
    at = start
    for _ in range(_MOST_PASSED):
        hit, place, normal, _, item, _ = scene.ray_cast(depsgraph, at, toward)
        if not hit:
            break
        role = item.original.get(TAG, "")
        if role in ("terrain", "rock", "rock shape"):
            return role, (place - start).length, normal.dot(toward) > 0
        at = place + toward * 1e-4 * max(1.0, (place - start).length)
    return "", 0.0, False

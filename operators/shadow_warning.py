"""Warn in the sidebar if nearly all of the camera's view is in shadow, or if an object of the user encloses the camera.

A note on a shadow tells how to light the view. After a build or a change of the Sun, the ground or the camera, a thread
traces some hundred rays against the built ground, without a render.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ..nodes import build_scene as scenes
from ..nodes.datablocks.fingerprint import TAG
from ..physics.camera.stereo_camera import StereoCamera
from ..physics.light.directions import direction_toward
from ..rays.engine import open_tracer
from ..rays.shapes import Placed, Shape, World
from ..rays.stereo_truth import Eye
from ..rays.sunlit_share import measure_sunlit_shares
from ..render import mesh_arrays
from ..render.workers.process import Message
from ..render.workers.watched_thread import Calculation
from ..settings import description
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.blender import compat
from . import jobs
from .session import session
from .sidebar_text import find_light, find_sun
from .view_resolution import has_window
from .window_areas import find_scene, redraw_panels
from .window_events import call_later, cancel_call, make_registration

#: Seconds without a change before rays are traced.
REST_S = 0.4
#: Share of the ground in view that the Sun must reach; below it the view counts as dark.
MIN_LIT = 0.05
#: Width of the traced image in pixels, and number of the Sun's azimuths among which the best is advised.
_COLUMNS, _AZIMUTHS = 24, 24
_NEAR_M = 1e-3
_EFFECTS = {"geometry", "light", "camera"}
#: Maximum number of the user's objects that are compared with the camera at each redraw.
_MAX_OBJECTS = 200
BRIEF = "View in shadow: see Light"


def schedule_check(scene: bpy.types.Scene | None, effects: frozenset[str] = frozenset(_EFFECTS)) -> None:
    """Schedule the tracing of a scene's rays ``REST_S`` after the last change."""
    if scene is not None and effects & _EFFECTS and has_window():
        session.to_trace.add(scene.session_uid)
        cancel_call(_trace_next)
        call_later(_trace_next, REST_S)


def describe_shadow(scene: bpy.types.Scene) -> str:
    """Describe the shadow in the view of a built scene, with the fix; empty if the Sun lights the view or this is
    unknown."""
    if scenes.find_collection(scene) is None:
        return ""
    return session.shadow_notes.get(scene.session_uid, ("", None))[0]


def recall_lit_azimuth(scene: bpy.types.Scene) -> float | None:
    """Return the azimuth of the Sun, deg, that ``describe_shadow`` names; None if it names none."""
    return session.shadow_notes.get(scene.session_uid, ("", None))[1] if describe_shadow(scene) else None


def describe_enclosing(scene: bpy.types.Scene) -> str:
    """Name an object of the user that encloses the stereo camera and so makes the drawn view black; empty without such
    an object."""
    built = scenes.find_built(scene)
    if built is None:
        return ""
    place, space = built.camera.matrix_world.translation, bpy.context.space_data
    view = {"viewport": space} if space is not None and space.type == "VIEW_3D" else {}
    for item in scene.objects[:_MAX_OBJECTS]:
        if item.type == "MESH" and not item.get(TAG) and item.visible_get(**view) and _is_inside(item, place):
            return f"{item.name} encloses the camera: move or hide it"
    return ""


def _is_inside(item: bpy.types.Object, place: Vector) -> bool:
    """Return whether a world position is behind the nearest face of a mesh, and so inside it."""
    corners, at = np.array(item.bound_box), item.matrix_world.inverted_safe() @ place
    if not ((corners.min(axis=0) < np.array(at)) & (np.array(at) < corners.max(axis=0))).all():
        return False
    with suppress(RuntimeError):  # a mesh that is not evaluated now
        found, nearest, normal, _ = item.closest_point_on_mesh(at)
        return bool(found and (at - nearest).dot(normal) < 0)
    return False


def advise_on_shadow(settings: Settings, shares: Array) -> str:
    """Advise how to light the view; empty if the Sun lights enough, or no ground is seen.

    ``shares`` (k,) are the lit shares of the view: first for the present Sun, then for Suns at azimuths in equal steps
    from it.
    """
    if not shares[0] < MIN_LIT:  # NaN: no ground is seen
        return ""
    dark = f"{100 * (1 - shares[0]):.0f} % of the ground in view is in shadow;"
    if settings.light.directions_from != "ANGLES":
        return f"{dark} choose another light.date_utc, or turn the camera by rig.heading_deg."
    azimuth = find_lit_azimuth(settings, shares)
    if azimuth is None:
        return f"{dark} raise light.sun_elevation_deg, now {settings.light.sun_elevation_deg:g}°."
    return (
        f"{dark} set light.sun_azimuth_deg to {azimuth:.0f}° ({100 * shares.max():.0f} % lit), or raise "
        f"light.sun_elevation_deg, now {settings.light.sun_elevation_deg:g}°."
    )


def find_lit_azimuth(settings: Settings, shares: Array) -> float | None:
    """Find the azimuth, in whole degrees, at which the Sun lights most of a view that is in shadow now. ``shares`` are
    as in ``advise_on_shadow``. None if the view is lit, if no azimuth lights it, or if the Sun has no azimuth to
    set."""
    if not shares[0] < MIN_LIT or shares.max() < MIN_LIT or settings.light.directions_from != "ANGLES":
        return None
    return round(settings.light.sun_azimuth_deg + 360.0 * int(shares.argmax()) / len(shares)) % 360.0


def list_suns(direction: Array) -> Array:
    """List unit vectors (k, 3) toward the present Sun, and toward Suns at azimuths in equal steps from it."""
    azimuth, elevation = math.degrees(math.atan2(direction[0], direction[1])), math.degrees(math.asin(direction[2]))
    return np.array([direction_toward(azimuth + 360.0 * k / _AZIMUTHS, elevation) for k in range(_AZIMUTHS)])


def read_ground(built: scenes.Built) -> World:
    """Read the triangles of the ground of a built scene."""
    mesh = built.terrain.data
    corners, count = mesh_arrays.read_corners(mesh), len(mesh.polygons)
    if built.settings.source.kind == "PROCEDURAL" and count:  # 25 ms for 3 million triangles; the general way takes 1 s
        faces = corners.reshape(count, -1)
        triangles = np.concatenate([faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)])
    else:
        triangles = corners[mesh_arrays.read_triangles(mesh)[0]]
    shape = Shape(
        mesh_arrays.read_vertices(mesh),
        triangles.astype(np.uint32),
        np.zeros(len(triangles), bool),
        np.ones(len(triangles), np.uint8),
    )
    return World([Placed(shape, np.array(built.terrain.matrix_world, np.float64)[None], np.array([1]))])


def make_small_eye(built: scenes.Built, settings: Settings) -> Eye:
    """Make the left eye of a built scene with few pixels."""
    camera = StereoCamera.from_settings(settings.rig)
    scale = _COLUMNS / camera.width_px
    matrix = np.array(built.camera.matrix_world, np.float64)
    return Eye(
        _COLUMNS,
        max(1, round(scale * camera.height_px)),
        scale * camera.focal_px,
        scale * camera.cx_px,
        scale * camera.cy_px,
        matrix[:3, :3] * [1.0, -1.0, -1.0],  # Blender's cameras look along -z, with y up
        matrix[:3, 3],
    )


def measure_shares(world: World, eye: Eye, suns: Array, folders: Sequence[Path]) -> Array:
    """Measure the lit shares by ``measure_sunlit_shares``, in any thread. Embree may be in one of ``folders``. Raises
    IcyMoonError without Embree."""
    tracer = open_tracer(world, folders)
    try:
        return measure_sunlit_shares(world, tracer, eye, suns, _NEAR_M)
    finally:
        tracer.close()


def _start(scene: bpy.types.Scene) -> jobs.Job | None:
    """Start to trace the rays of a scene. Returns None if there is nothing to trace or to warn of."""
    built = scenes.find_built(scene)
    session.shadow_notes.pop(scene.session_uid, None)
    if built is None or built.terrain.mode != "OBJECT":
        return None
    settings = description.merged(built.settings, built.preview)  # the settings that are shown
    sun = find_sun(find_light(settings))
    if sun is None or settings.light.lamps:  # lamps light the view
        return None
    work = partial(
        measure_shares,
        read_ground(built),
        make_small_eye(built, settings),
        list_suns(np.array(sun["direction_to_world"])),
        compat.list_library_folders(),  # not in the thread, which may ask Blender nothing
    )
    uid = scene.session_uid

    def note(message: Message) -> None:
        if message["type"] == "result" and (text := advise_on_shadow(settings, message["value"])):
            session.shadow_notes[uid] = text, find_lit_azimuth(settings, message["value"])
        redraw_panels()

    return jobs.Job("Shadow", Calculation(work, "the shadow"), note)


def _trace_next() -> float | None:
    """Check the running calculation, or start the next. Returns the seconds until the next call, None if none runs."""
    if session.tracing is not None:
        if session.tracing.poll():
            return jobs.INTERVAL_S
        session.tracing.close()
        session.tracing = None
    while session.to_trace and session.tracing is None:
        scene = find_scene(session.to_trace.pop())
        session.tracing = _start(scene) if scene is not None else None
    return jobs.INTERVAL_S if session.tracing is not None else None


def _check_all() -> None:
    """Check all scenes after undo, redo and opening a file, since each may have another ground or Sun."""
    for scene in bpy.data.scenes:
        if scenes.find_collection(scene) is not None:
            schedule_check(scene)


register, unregister = make_registration(
    schedule_check, timers=(_trace_next,), undo_post=_check_all, redo_post=_check_all, load_post=_check_all
)

"""Read the marks of a built scene's meshes in pieces while the window rests, so that a slider's first step is fast."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

import bpy

from ..nodes import build_scene as scenes
from ..nodes.datablocks import known_marks
from ..nodes.datablocks.array_marks import list_mesh_marks_in_steps
from ..nodes.datablocks.fingerprint import list_meshes
from ..support.steps import Steps
from .session import session
from .settled_steps import settle
from .window_areas import find_scene
from .window_events import call_later, make_registration
from .work_in_pieces import PIECES_INTERVAL_S, WorkInPieces

#: Marks of meshes by the ``session_uid`` of the mesh.
Marks: TypeAlias = dict[int, list[object]]
#: Seconds before the marks are read, so that the scene is drawn first.
_BEGIN_S = 0.2


def schedule_reading(scene: bpy.types.Scene) -> None:
    """Schedule the reading of the marks of a scene's meshes."""
    stop_reading()
    session.marking = WorkInPieces(_keep_marks(scene.session_uid), "the marks")
    call_later(_read_next, _BEGIN_S)


def keep_marks(marks: Marks) -> None:
    """Keep marks that were read before a scene took in their meshes.

    Blender must have announced these meshes as changed by then, since each announcement lets their marks be forgotten.
    """
    stop_reading()
    for uid, found in marks.items():
        known_marks.keep_marks(uid, found)


def stop_reading() -> None:
    """Stop reading marks, and forget the marks that were read."""
    known_marks.forget_marks()
    if session.marking is not None:
        session.marking.stop()
        session.marking = None


def _read_anew() -> None:
    """Schedule the reading of the marks of the window's scene after undo, redo or the opening of a file."""
    stop_reading()
    if not bpy.app.background:
        schedule_reading(bpy.context.scene)


def _read_next() -> float | None:
    """Read the next marks. The timer stops after the last."""
    if session.marking is None:
        return None
    session.marking.poll()
    if session.marking.running:
        return PIECES_INTERVAL_S
    session.marking = None
    return None


def _keep_marks(scene_uid: int) -> Steps[None]:
    """Read and keep the marks of a built scene's meshes in steps."""
    for uid, marks in (yield from settle(lambda: _read_marks(scene_uid))).items():
        known_marks.keep_marks(uid, marks)


def _read_marks(scene_uid: int) -> Steps[Marks]:
    """Read the marks of a built scene's meshes in steps; empty without a built scene."""
    scene = find_scene(scene_uid)
    built = scenes.find_built(scene) if scene is not None else None
    return (yield from read_marks_in_steps(list_meshes(built.collection) if built is not None else ()))


def read_marks_in_steps(meshes: Iterable[bpy.types.Mesh]) -> Steps[Marks]:
    """Read the marks of meshes in steps; meshes in Edit Mode are left out."""
    found: Marks = {}
    for mesh in meshes:
        if not mesh.is_editmode:
            found[mesh.session_uid] = yield from list_mesh_marks_in_steps(mesh)
    return found


@bpy.app.handlers.persistent
def _forget_changed(scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """Forget the marks of the meshes that Blender announces as changed."""
    if not known_marks.has_known_marks():
        return
    for update in graph.updates:
        if update.is_updated_geometry:  # a slider of the surface updates the shading of meshes
            block = update.id.original
            mesh = block.data if isinstance(block, bpy.types.Object) else block
            if isinstance(mesh, bpy.types.Mesh):
                known_marks.forget_marks(mesh.session_uid)


_register, _unregister = make_registration(
    timers=(_read_next,),
    end=stop_reading,
    undo_pre=stop_reading,
    redo_pre=stop_reading,
    undo_post=_read_anew,
    redo_post=_read_anew,
    load_pre=stop_reading,
    load_post=_read_anew,
)


def register() -> None:
    """Follow Blender's announcements."""
    _register()
    bpy.app.handlers.depsgraph_update_post.append(_forget_changed)


def unregister() -> None:
    """Stop following Blender's announcements."""
    bpy.app.handlers.depsgraph_update_post.remove(_forget_changed)
    _unregister()

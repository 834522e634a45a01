"""The ground of a scene that was just chosen: coarse at once, then at full resolution while the user looks.

A thread computes the ground, and a timer builds the scene from it. This adds no undo step: undo takes the chosen scene
back as a whole. Where undo and redo show the coarse ground again, the fine ground follows again.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Any

import bpy

from ..nodes import preview
from ..nodes import scene as scenes
from ..nodes.ground.dug_ground import mesh_whole_ground
from ..nodes.ground.terrain_mesh import MeshedGround
from ..settings import changes
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError, describe_error
from . import first_picture, jobs, view_resolution
from .build import look_through, views_through

_INTERVAL_S = 0.1
#: Text in the sidebar while the fine ground is computed.
NOTE = "Coarse ground; the fine one follows"
#: Beginnings of the names of operators that hold the data they change, or that a wait would interrupt.
_BUSY = ("TRANSFORM_OT_", "VIEW3D_OT_", "SCULPT_OT_", "PAINT_OT_", "MESH_OT_")


class _Meshing(threading.Thread):
    """The ground of settings that is being computed."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(name="Icy Moon ground")  # no daemon: Python waits for it before it frees its data
        self.settings = settings
        self.found: MeshedGround | None = None
        self.error = ""

    def run(self) -> None:
        try:
            self.found = mesh_whole_ground(scenes.ground_of, self.settings)
        except Exception as error:
            self.error = describe_error(error, "the ground")


_meshing: _Meshing | None = None  # the latest; the result of an earlier one is not used


def begin() -> None:
    """Let the fine ground follow wherever a scene awaits it."""
    if not bpy.app.timers.is_registered(_work):
        bpy.app.timers.register(_work, first_interval=_INTERVAL_S)


def note(scene: bpy.types.Scene) -> str:
    """Text for the sidebar while the ground of the scene is made at full resolution; empty otherwise."""
    if not bpy.app.timers.is_registered(_work):
        return ""
    return NOTE if preview.awaits_ground(scene, scene_properties.read_for_display(scene.icymoon)) else ""


def _next() -> tuple[scenes.Built, Settings] | None:
    """A built scene that awaits its ground, and its settings."""
    for scene in bpy.data.scenes:
        with suppress(IcyMoonError):  # settings that no panel can make
            settings = scene_properties.read_settings(scene.icymoon)
            if scene.icymoon.live and (built := preview.awaits_ground(scene, settings)):
                return built, settings
    return None


def _is_busy() -> bool:
    """Whether Blender renders, or the user drags something."""
    return bpy.app.is_job_running("RENDER") or any(
        operator.bl_idname.startswith(_BUSY)
        for window in bpy.context.window_manager.windows
        for operator in window.modal_operators
    )


def _work() -> float | None:
    """Compute the ground of a scene that awaits it, then build the scene. The timer stops when no scene waits."""
    global _meshing
    found = _next()
    if found is None:
        _meshing = None
        return None
    built, settings = found
    if _meshing is None or changes.scene(_meshing.settings) != changes.scene(settings):
        _meshing = _Meshing(settings)
        _meshing.start()
    elif not _meshing.is_alive() and not _is_busy():
        made, _meshing = _meshing, None
        _show(built, settings, made)
        jobs.redraw()
    return _INTERVAL_S


def _show(built: scenes.Built, settings: Settings, made: _Meshing) -> None:
    """Build a scene at full resolution from its ground and note its warnings, or note why it is not built.

    It is not built if something was edited by hand.
    """
    views = views_through(bpy.context, built.camera)
    try:
        if made.found is None:
            raise IcyMoonError(made.error)
        if built.terrain.mode != "OBJECT" or built.edited_parts():
            raise IcyMoonError("The scene was edited while its ground was coarse; press Build Scene to build it again.")
        fine = scenes.build(built.scene, settings, made.found)
        look_through(views, fine)
        preview.set_notes(fine, list(fine.warnings))  # no operator runs that could report them
    except IcyMoonError as error:
        del built.collection[scenes.REFINED]
        preview.set_notes(built, [str(error)])
    view_resolution.begin(built.scene)
    first_picture.count(built.scene)


@bpy.app.handlers.persistent
def _resume(*_: Any) -> None:
    """Undo, redo and opening a file may show a coarse ground again."""
    if not bpy.app.background:
        begin()


_HANDLERS = (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post, bpy.app.handlers.load_post)


def register() -> None:
    """Follow undo, redo and files that are opened."""
    for handlers in _HANDLERS:
        handlers.append(_resume)


def unregister() -> None:
    """Stop following them, and let no ground follow."""
    for handlers in _HANDLERS:
        handlers.remove(_resume)
    if bpy.app.timers.is_registered(_work):
        bpy.app.timers.unregister(_work)

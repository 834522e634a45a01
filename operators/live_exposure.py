"""Develops the shown camera image again when a setting of the camera response changes.

The evaluator develops it in its own process, after the settings have not changed for a moment. A timer handles its
messages, so the window never waits. Changes during the development are developed afterwards.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..render.pairs.our_files import folder_of_pair
from ..render.pairs.pair_folder import is_complete
from ..render.workers.process import Message
from ..settings import change_announcements
from ..settings.blender import scene_properties
from ..support.errors import IcyMoonError
from . import jobs, live_preview
from .expose import start_developing
from .render import dataset_folder
from .sidebar_text import plain

#: Seconds without a change of settings before an image is developed.
REST_S = 0.3
_INTERVAL_S = 0.1
_waiting: set[str] = set()  # names of scenes whose images are to be developed
_job: jobs.Job | None = None
_messages: list[str] = []  # warnings of the last development, or why it failed


def exposed_folder(scene: bpy.types.Scene) -> Path:
    """The folder of a scene's camera images. Raises IcyMoonError if the data set has no valid folder."""
    return dataset_folder(scene_properties.read_settings(scene.icymoon)) / "exposed"


def shown_paths() -> list[Path]:
    """The image files that Image Editors show."""
    spaces = [
        area.spaces.active
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "IMAGE_EDITOR"
    ]
    return [Path(bpy.path.abspath(space.image.filepath)) for space in spaces if space.image and space.image.filepath]


def listen(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Schedule a development after a change of the camera response; a listener of ``scene_properties``."""
    if "response" not in effects or scene is None or not live_preview.has_window() or not scene.icymoon.follow:
        return
    _waiting.add(scene.name)
    if _job is None:
        _call_again(REST_S)


def _call_again(seconds: float) -> None:
    if bpy.app.timers.is_registered(work):
        bpy.app.timers.unregister(work)
    bpy.app.timers.register(work, first_interval=seconds)


def work() -> float | None:
    """Start a waiting development or handle messages of a running one. The timer calls it until there is neither."""
    global _job
    try:
        if _job is None:
            _job = _start()
        elif not _job.advance():
            _finish(_job)
    except IcyMoonError as error:
        _stop()
        _show_messages([str(error)])
    return _INTERVAL_S if _job is not None or _waiting else None


def _start() -> jobs.Job | None:
    """Start to develop the shown images of a waiting scene; None without such images, or while another job runs."""
    if jobs.current is not None:
        return None  # the other job may be writing the same images
    scene = bpy.data.scenes.get(_waiting.pop()) if _waiting else None
    if scene is None or not scene.icymoon.follow:
        return None
    exposed = exposed_folder(scene)
    names = {path.parent.name for path in shown_paths() if path.parent.parent == exposed}
    folders = [folder_of_pair(exposed.parent, name) for name in sorted(names)]
    pairs = [folder for folder in folders if is_complete(folder)]
    return start_developing(scene_properties.read_settings(scene.icymoon), pairs, _hear) if pairs else None


def _hear(message: Message) -> None:
    if message["type"] == "result":
        folders = {Path(folder) for folder in message["folders"]}
        for image in bpy.data.images:
            if image.filepath and Path(bpy.path.abspath(image.filepath)).parent in folders:
                image.reload()


def _finish(job: jobs.Job) -> None:
    _stop()
    _show_messages([job.failure] if job.failure else job.warnings)
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                area.tag_redraw()


def _show_messages(sentences: list[str]) -> None:
    _messages[:] = sentences
    jobs.redraw()


def lines() -> list[str]:
    """Warnings of the last development, or why it failed."""
    return [plain(sentence) for sentence in _messages]


def _stop() -> None:
    global _job
    if _job is not None:
        _job.process.stop()
        _job.clean_up()
        _job = None


@bpy.app.handlers.persistent
def _forget(*_: object) -> None:
    """Stop, and forget what waits, before another file is opened."""
    _stop()
    _waiting.clear()
    _messages.clear()
    if bpy.app.timers.is_registered(work):
        bpy.app.timers.unregister(work)


def register() -> None:
    """Listen to changes of settings."""
    change_announcements.listeners.append(listen)
    bpy.app.handlers.load_pre.append(_forget)


def unregister() -> None:
    """Stop listening, and stop a running development."""
    change_announcements.listeners.remove(listen)
    bpy.app.handlers.load_pre.remove(_forget)
    _forget()

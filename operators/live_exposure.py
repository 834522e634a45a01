"""Develop the shown camera image again when a setting of the camera response changes.

The evaluator develops the image in a separate process, after the settings have not changed for a moment. A timer
handles its messages, so the window never waits. Settings that change meanwhile start another development afterwards.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..render.pairs.dataset_file_names import folder_of_pair
from ..render.pairs.pair_folder import is_complete
from ..settings.blender import scene_properties
from ..support.errors import IcyMoonError
from . import jobs, live_preview
from .camera_image_notes import note_camera_image
from .render import find_dataset_folder
from .session import session
from .show_camera_image import start_developing
from .sidebar_text import replace_keys_by_labels
from .window_areas import list_areas, redraw, redraw_panels
from .window_events import call_later, cancel_call, make_registration

#: Seconds without a change of settings before an image is developed.
REST_S = 0.3


def find_exposed_folder(scene: bpy.types.Scene) -> Path:
    """Return the folder of a scene's camera images. Raises IcyMoonError if the data set has no valid folder."""
    return find_dataset_folder(scene_properties.read_settings(scene.icymoon)) / "exposed"


def list_shown_paths() -> list[Path]:
    """List the image files that Image Editors show."""
    spaces = [area.spaces.active for _, area in list_areas("IMAGE_EDITOR")]
    return [Path(bpy.path.abspath(space.image.filepath)) for space in spaces if space.image and space.image.filepath]


def schedule_development(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Schedule a development after a change of the camera response; a listener of ``scene_properties``."""
    if "response" not in effects or scene is None or not live_preview.has_window() or not scene.icymoon.follow:
        return
    session.to_develop.add(scene.name)
    if session.developing is None:
        cancel_call(develop_waiting)
        call_later(develop_waiting, REST_S)


def develop_waiting() -> float | None:
    """Start to develop a waiting scene's images, or handle the messages of a running development. Returns the seconds
    to the timer's next call, or None if no development runs or waits."""
    try:
        if session.developing is None:
            session.developing = _start_developing_images()
        elif not session.developing.poll():
            _finish_development(session.developing)
    except IcyMoonError as error:
        _stop_development()
        _show_notes([str(error)])
    return jobs.INTERVAL_S if session.developing is not None or session.to_develop else None


def _start_developing_images() -> jobs.Job | None:
    """Start to develop the shown images of a waiting scene. Returns None without such images, or while another job
    runs."""
    if session.job is not None:
        return None  # the other job may write the same images
    scene = bpy.data.scenes.get(session.to_develop.pop()) if session.to_develop else None
    if scene is None or not scene.icymoon.follow:
        return None
    exposed = find_exposed_folder(scene)
    names = {path.parent.name for path in list_shown_paths() if path.parent.parent == exposed}
    folders = [folder_of_pair(exposed.parent, name) for name in sorted(names)]
    pairs = [folder for folder in folders if is_complete(folder)]
    return start_developing(scene_properties.read_settings(scene.icymoon), pairs) if pairs else None


def _finish_development(job: jobs.Job) -> None:
    _stop_development()
    folders = {Path(folder) for folder in job.result.get("folders", ())}
    for image in bpy.data.images:
        if image.filepath and Path(bpy.path.abspath(image.filepath)).parent in folders:
            image.reload()
            note_camera_image(image)
    _show_notes([job.failure] if job.failure else job.warnings)
    redraw("IMAGE_EDITOR")


def _show_notes(sentences: list[str]) -> None:
    session.development_notes = sentences
    redraw_panels()


def list_lines() -> list[str]:
    """List the warnings of the last development, or why it failed."""
    return [replace_keys_by_labels(sentence) for sentence in session.development_notes]


def _stop_development() -> None:
    if session.developing is not None:
        session.developing.close()
        session.developing = None


register, unregister = make_registration(schedule_development, timers=(develop_waiting,))

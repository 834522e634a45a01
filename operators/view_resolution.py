"""Show the lit view of a built scene coarsely first, so that the scene is soon seen, then in the user's resolution.

After its first picture, of an eighth of the columns, Cycles shows nothing new until a light path was traced for every
pixel. On two processors without a graphics card this takes up to a minute. Meanwhile the pixels of the view are twice
as wide. When the view rests, it gets the user's pixel size if the first picture with it takes little time.
"""

from __future__ import annotations

import time
from contextlib import suppress

import bpy

from ..nodes import build_scene as scenes
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from .session import session
from .window_areas import find_scene, list_areas
from .window_events import call_later, make_registration

#: Side of a large pixel of the view, in screen pixels.
_LARGE_PIXELS = "2"
#: Property of the built collection: the pixel size that the user chose, and the size that replaced it.
_CHOICE_PROPERTY = "icymoon_view_pixels"
#: Maximum seconds for the first picture with the user's pixels; until then only its coarse beginning is seen.
_LONGEST_S = 2.0
_INTERVAL_S = 1.0
#: A view rests when Blender takes less than this share of one processor.
_RESTING_SHARE = 0.1


def has_window() -> bool:
    """Return whether there is a view."""
    return not bpy.app.background


def begin_coarse(scene: bpy.types.Scene) -> None:
    """Show the changes of a built scene with larger pixels first.

    A pixel size that the user has chosen since the last call stays, and any pixel size stays if a graphics card
    renders.
    """
    collection = scenes.find_collection(scene)
    if collection is None or not has_window() or scene.cycles.device == "GPU":
        return
    users, ours = _read_noted_choices(collection)
    if ours and scene.render.preview_pixel_size != ours:
        return
    users = users or scene.render.preview_pixel_size
    if users not in ("AUTO", "1"):
        return
    scene.render.preview_pixel_size = _LARGE_PIXELS
    collection[_CHOICE_PROPERTY] = f"{users} {_LARGE_PIXELS}"
    session.traced_since_s = time.monotonic()
    session.load_measured_s = time.monotonic(), time.process_time()
    call_later(_refine_resting_view, _INTERVAL_S)


def restore_resolution(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Restore the user's pixel size of the view, unless the user has chosen another since."""
    users, ours = _read_noted_choices(collection)
    if ours and scene.render.preview_pixel_size == ours:
        with suppress(TypeError):  # the value is from a file, which anyone may have written
            scene.render.preview_pixel_size = users
    collection.pop(_CHOICE_PROPERTY, None)


def is_coarse(scene: bpy.types.Scene) -> bool:
    """Return whether the view has larger pixels than the user has chosen."""
    collection = scenes.find_collection(scene)
    return (
        collection is not None
        and _CHOICE_PROPERTY in collection
        and scene.render.preview_pixel_size == _read_noted_choices(collection)[1]
    )


def _read_noted_choices(collection: bpy.types.Collection) -> tuple[str, str]:
    """Read the user's pixel size and the size that replaced it; both empty if it was not replaced."""
    users, _, ours = str(collection.get(_CHOICE_PROPERTY, "")).partition(" ")
    return users, ours


def _is_traced(scene: bpy.types.Scene) -> bool:
    """Return whether a 3D View shows the light of the scene."""
    return any(
        window.scene == scene and area.spaces.active.shading.type == "RENDERED"
        for window, area in list_areas("VIEW_3D")
    )


def _refine_resting_view() -> float | None:
    """Give a resting view the user's pixel size, if this takes little time. The timer calls this until the view
    rests."""
    waiting = [scene for scene in bpy.data.scenes if is_coarse(scene)]
    traced = [scene for scene in waiting if _is_traced(scene)]
    before, now = session.load_measured_s, (time.monotonic(), time.process_time())
    session.load_measured_s = now
    if not traced:  # nothing can be measured before a view shows the light
        session.traced_since_s = time.monotonic()
        return _INTERVAL_S if waiting else None
    seconds, busy_s = (late - early for late, early in zip(now, before, strict=True))
    if busy_s > _RESTING_SHARE * seconds:
        return _INTERVAL_S
    for scene in traced:
        collection = scenes.find_collection(scene)
        taken_s, pixels = now[0] - seconds - session.traced_since_s, int(scene.render.preview_pixel_size)
        if pixels**2 * taken_s / max(1, scene.cycles.preview_samples) <= _LONGEST_S:
            restore_resolution(scene, collection)
    return None


def _resume_refining() -> None:
    """Start refining again, since undo, redo and opening a file may show larger pixels."""
    for scene in bpy.data.scenes if has_window() else ():
        if is_coarse(scene):
            begin_coarse(scene)


def _note_settings() -> None:
    """Note the settings of built scenes before undo or redo."""
    session.settings_before_undo = _read_settings()


def _read_settings() -> dict[int, Settings]:
    """Read the settings of built scenes, by ``session_uid``."""
    scenes_with_build = [scene for scene in bpy.data.scenes if has_window() and scenes.find_collection(scene)]
    return {scene.session_uid: scene_properties.read_unchecked(scene.icymoon) for scene in scenes_with_build}


def _follow_undo() -> None:
    """Show the changes of undo or redo with larger pixels first. The new exposure applies at once, so the old picture
    is too bright or too dark until the next picture comes."""
    _resume_refining()
    before, session.settings_before_undo = session.settings_before_undo, {}
    for uid, settings in _read_settings().items():
        if before.get(uid, settings) != settings and (scene := find_scene(uid)) is not None:
            begin_coarse(scene)


register, unregister = make_registration(
    timers=(_refine_resting_view,),
    undo_pre=_note_settings,
    redo_pre=_note_settings,
    undo_post=_follow_undo,
    redo_post=_follow_undo,
    load_post=_resume_refining,
)

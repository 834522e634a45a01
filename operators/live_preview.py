"""Live preview: make the built scene follow the settings while they change.

The first change in a turn of Blender's event loop is shown before the callback of the property returns. The undo step
that the window then takes contains both the change and its preview. Further changes in the same turn come from a
script, and a timer shows them together. Without a window there is no preview.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.datablocks import known_marks
from ..settings import description
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import refine_ground, shadow_warning, view_resolution
from .build import frame_and_expose
from .coloured_views import give_back_views
from .session import SIDES, session
from .sidebar_text import describe_ground_file, find_light, find_sky_fault, replace_keys_by_labels
from .window_areas import push_undo
from .window_events import call_later, make_registration

#: Seconds that an update of the ground may take. Below 0.1 s the window seems to follow at once; the rest is a reserve,
#: since an update may take longer than the one before.
BUDGET_S = 0.06
_SHOWN_EFFECTS = {"geometry", "material", "light", "lander", "camera"}
#: The text while a scene is built again, whose settings are the new ones already.
BUILDING = "The earlier scene, until the build ends"
_NO_SKY = "The light is as before: see Light"  # the panel that shows the reason


def has_window() -> bool:
    """Return whether there is a window for the preview."""
    return not bpy.app.background


def update_scene(scene: bpy.types.Scene) -> bool:
    """Show the settings of a scene in its built objects, or note why they cannot be shown. Returns whether the shown
    settings have changed."""
    built = scenes.find_built(scene)
    if built is None:
        return False
    if known_marks.has_known_marks():
        bpy.context.view_layer.update()  # Blender announces what a script has changed in this turn
        if scene != bpy.context.scene:  # Blender does not announce changes of other scenes
            known_marks.forget_marks()
    settings, before = scene_properties.read_unchecked(scene.icymoon), description.merged(built.settings, built.preview)
    scenes.separate_from_copies(built)
    if why := built.outdated or scenes.why_shared(built):
        preview.set_notes(built, [why])
        return False
    if not scene.icymoon.live:
        stale = _has_changed(built, settings)
        preview.set_notes(built, ["Settings have changed; press Build Scene to show them."] if stale else [])
        return False
    start = time.perf_counter()
    if preview.show_settings(built, settings, session.preview_side):
        session.preview_side = choose_next_side(session.preview_side, time.perf_counter() - start)
        give_back_views(scene)  # the painted errors are gone with the previous ground
    now = description.merged(built.settings, built.preview)
    frame_and_expose(scene, now, before)
    if now != before:
        view_resolution.begin_coarse(scene)
        session.picture.remove()
    return now != before


def choose_next_side(side: int, seconds: float) -> int:
    """Choose the vertices per side of the ground for the next update, from the ``seconds`` of an update with ``side``
    vertices per side."""
    if seconds > BUDGET_S:
        return max((n for n in SIDES if n < side), default=side)
    finer = min((n for n in SIDES if n > side), default=side)
    return finer if seconds * (finer / side) ** 2 < 0.8 * BUDGET_S else side


def _has_changed(built: scenes.Built, settings: Settings) -> bool:
    try:
        return bool(scenes.list_changed_settings(built, settings))
    except IcyMoonError:
        return True  # the file of the ground is missing, which Build Scene reports


@contextmanager
def leave_to_build() -> Iterator[None]:
    """Leave changed settings, within this context, to the build that comes next; they are not previewed."""
    session.left_to_build = True
    try:
        yield
    finally:
        session.left_to_build = False


def schedule_update(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Show a change of settings, or schedule it. ``scene_properties`` calls this as a listener."""
    if session.left_to_build or not has_window() or not effects & _SHOWN_EFFECTS or scene is None:
        return
    if bpy.app.timers.is_registered(show_waiting):
        session.to_preview.add(scene.name)
        return
    call_later(show_waiting)
    update_scene(scene)


def show_waiting() -> None:
    """Show the waiting changes. The timer calls this in the next turn of the event loop."""
    names, shown = sorted(session.to_preview), False
    session.to_preview.clear()
    for scene in (bpy.data.scenes.get(name) for name in names):
        shown |= scene is not None and update_scene(scene)
    if shown:
        push_undo("Live Preview")


def list_lines(scene: bpy.types.Scene) -> list[str]:
    """List sentences on how well the built scene shows the settings; empty without a built scene.

    There is always a line. Otherwise the fields below would move while the user drags one of them.
    """
    if scenes.find_collection(scene) is None:
        return []
    follows = refine_ground.describe_refining(scene)
    sentences = (
        [follows] if follows else preview.read_notes(scene) or [describe_ground_file(scene) or "Ground in full detail"]
    )
    if session.building is not None and session.building.scene_uid == scene.session_uid:
        sentences = [BUILDING]
    fault = find_sky_fault(find_light(scene_properties.read_for_display(scene.icymoon)))
    shown = [_NO_SKY if sentence == fault else replace_keys_by_labels(sentence) for sentence in sentences]
    if shadow_warning.describe_shadow(scene):
        shown.append(shadow_warning.BRIEF)
    if enclosing := shadow_warning.describe_enclosing(scene):
        shown.append(enclosing)
    return shown


register, unregister = make_registration(schedule_update, timers=(show_waiting,))

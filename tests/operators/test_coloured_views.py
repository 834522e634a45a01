"""What 3D Views showed before they showed the colours of errors comes back, however the errors go."""

from __future__ import annotations

import bpy
import pytest
from icymoon.nodes import painted_errors
from icymoon.nodes.datablocks.fingerprint import TAG
from icymoon.operators import coloured_views

SHOWN = ("SOLID", "FLAT", "VERTEX")
BEFORE = ("WIREFRAME", "MATCAP", "OBJECT")


def shading():
    return next(
        area for window in bpy.context.window_manager.windows for area in window.screen.areas if area.type == "VIEW_3D"
    ).spaces.active.shading


def look() -> tuple[str, str, str]:
    """The kind of shading, then light and colours of Solid shading."""
    found = shading()
    kind, found.type = found.type, "SOLID"
    told = kind, found.light, found.color_type
    found.type = kind
    return told


def paint(scene) -> None:
    """Show a collection that counts as painted errors."""
    collection = bpy.data.collections.new(painted_errors.NAME)
    collection[TAG] = painted_errors.ROLE
    scene.collection.children.link(collection)
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area):
        coloured_views.show_colours(bpy.context, [], solid=True)


@pytest.fixture
def viewed(scene):
    """An empty file whose view has a shading of the user's own."""
    found = shading()
    found.type = "SOLID"
    found.light, found.color_type = BEFORE[1:]
    found.type = BEFORE[0]
    assert look() == BEFORE
    return scene


def test_the_view_returns_when_undo_takes_the_errors_away_and_follows_redo(viewed):
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="Empty")
    paint(viewed)
    bpy.ops.ed.undo_push(message="Painted")
    assert look() == SHOWN
    bpy.ops.ed.undo()
    coloured_views._follow_scenes()
    assert look() == BEFORE
    bpy.ops.ed.redo()
    coloured_views._follow_scenes()
    assert painted_errors.find_painted(bpy.context.scene) is not None
    assert look() == SHOWN
    coloured_views.hide_errors(bpy.context.scene)
    assert look() == BEFORE
    assert coloured_views.KEPT not in bpy.context.scene


def test_other_undo_steps_leave_the_view_as_the_user_has_it(viewed):
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="Empty")
    paint(viewed)
    bpy.ops.ed.undo_push(message="Painted")
    bpy.context.scene.frame_current = 7
    bpy.ops.ed.undo_push(message="Frame")
    shading().type = "MATERIAL"  # by the user, while the errors are there
    bpy.ops.ed.undo()
    coloured_views._follow_scenes()
    assert shading().type == "MATERIAL"


@pytest.mark.parametrize("by_user", [False, True])
def test_the_view_returns_after_the_file_was_opened_again(viewed, tmp_path, by_user):
    paint(viewed)
    if by_user:  # who has already chosen another shading keeps it
        shading().type = "MATERIAL"
    path = str(tmp_path / "painted.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    assert shading().type == ("MATERIAL" if by_user else "SOLID")
    assert bpy.ops.icymoon.hide_surface() == {"FINISHED"}
    assert shading().type == ("MATERIAL" if by_user else BEFORE[0])
    assert by_user or look() == BEFORE


def test_any_text_in_a_file_is_no_error(viewed, tmp_path):
    paint(viewed)
    viewed[coloured_views.KEPT] = {"type": "EVIL", "light": 7, "color_type": "OBJECT"}
    path = str(tmp_path / "painted.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    coloured_views.hide_errors(bpy.context.scene)
    assert look() == ("SOLID", "FLAT", "OBJECT")


def test_a_scene_without_errors_is_seen_as_before_and_they_come_back_with_theirs(viewed):
    paint(viewed)
    window = bpy.context.window_manager.windows[0]
    other = window.scene = bpy.data.scenes.new("Other")
    coloured_views._follow_scenes()
    assert look() == BEFORE
    coloured_views.hide_errors(other)
    assert look() == BEFORE
    window.scene = viewed
    coloured_views._follow_scenes()
    assert look() == SHOWN
    coloured_views.hide_errors(other)  # of a scene that the view does not show
    assert look() == SHOWN

"""Marks of meshes that are kept for the first step of a slider: they spare the reading, and no edit is missed."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import bpy
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks import array_marks, known_marks
from icymoon.nodes.datablocks.fingerprint import list_meshes, read_marks
from icymoon.operators import keep_marks, live_preview, window_events
from icymoon.operators.session import session
from icymoon.operators.window_events import cancel_call
from icymoon.settings.blender import scene_properties
from icymoon.support.steps import finish


@pytest.fixture
def built(small: bpy.types.Scene) -> Iterator[scenes.Built]:
    """The small scene with rocks, built, whose marks are kept."""
    small.icymoon.rocks.coverage = 0.05
    made = scenes.build_scene(small, scene_properties.read_settings(small.icymoon))
    bpy.context.view_layer.update()
    finish(keep_marks._keep_marks(small.session_uid))
    assert len(known_marks.find_known_marks(list_meshes(made.collection))) > 2
    yield made
    keep_marks.stop_reading()


def is_known(built: scenes.Built) -> bool:
    return built.terrain.data in known_marks.find_known_marks([built.terrain.data])


def find_edits(built: scenes.Built) -> set[str]:
    """The edited parts as the first step of a slider asks for them."""
    with built.reading_marks_once():
        return built.edited_parts("terrain data", "rock object", "rock data")


def test_known_marks_are_those_that_are_read(built):
    assert read_marks(built.collection, trusts=True) == read_marks(built.collection)


def test_the_first_step_of_a_slider_reads_no_array_of_the_built_meshes(built, monkeypatch):
    read: list[object] = []
    read_one = array_marks.read_property

    def note(items, *arguments, **options):
        read.append(items.id_data)
        return read_one(items, *arguments, **options)

    monkeypatch.setattr(array_marks, "read_property", note)
    assert find_edits(built) == set()
    assert read == []
    assert built.edited_parts("terrain data") == set()  # before a render, all is read
    assert built.terrain.data in read


def test_an_announced_edit_is_found(built):
    built.terrain.data.vertices[0].co.z += 1.0
    bpy.context.view_layer.update()
    assert not is_known(built)
    assert find_edits(built) == {"terrain data"}


def test_an_edit_in_edit_mode_is_found(built):
    bpy.context.view_layer.objects.active = built.terrain
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.flip_normals()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert find_edits(built) == {"terrain data"}


def test_an_edit_of_a_rock_is_found(built):
    shape = next(mesh for mesh in list_meshes(built.collection) if "Shape" in mesh.name)
    shape.vertices[0].co.x += 0.1
    bpy.context.view_layer.update()
    assert "rock object" in find_edits(built)


def test_an_edit_by_a_script_that_moves_a_slider_in_the_same_turn_stays(built):
    scene, terrain = built.scene, built.terrain
    terrain.data.vertices[0].co.z += 1.0
    height_m = terrain.data.vertices[0].co.z
    scene.icymoon.terrain.rms_slope_deg += 2.0
    live_preview.update_scene(scene)
    assert terrain.data.vertices[0].co.z == height_m
    assert "edited by hand" in " ".join(preview.read_notes(scene))


def test_a_step_of_a_slider_forgets_what_it_replaces(built):
    scene = built.scene
    scene.icymoon.terrain.rms_slope_deg += 2.0
    live_preview.update_scene(scene)
    assert not known_marks.has_known_marks()
    scene.icymoon.terrain.rms_slope_deg += 2.0
    live_preview.update_scene(scene)
    assert preview.read_notes(scene) == [preview.COARSE_MESSAGE]
    assert not scenes.find_built(scene).edited


def test_sliders_of_sun_and_surface_keep_them(built):
    scene = built.scene
    scene.icymoon.light.sun_elevation_deg += 3.0
    scene.icymoon.surface.albedo -= 0.1
    live_preview.update_scene(scene)
    bpy.context.view_layer.update()
    assert is_known(built)


@pytest.mark.parametrize("event", ["undo_pre", "redo_post", "load_pre"])
def test_undo_and_another_file_forget_them(built, event):
    for handler in list(getattr(bpy.app.handlers, event)):
        if handler.__module__ == window_events.__name__:
            handler(None, None)
    assert not known_marks.has_known_marks()


@pytest.mark.parametrize("event", ["undo_post", "load_post"])
def test_in_a_window_they_are_read_anew_after_undo_and_when_a_file_is_open(built, event, monkeypatch):
    monkeypatch.setattr(keep_marks, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), context=bpy.context))
    for handler in list(getattr(bpy.app.handlers, event)):
        if handler.__module__ == window_events.__name__ and "_read_anew" in repr(handler.__closure__[0]):
            handler(None, None)
    cancel_call(keep_marks._read_next)
    while keep_marks._read_next() is not None:
        pass
    assert is_known(built)


def test_they_are_read_in_pieces_and_anew_after_a_change(built):
    keep_marks.schedule_reading(built.scene)
    cancel_call(keep_marks._read_next)
    assert not known_marks.has_known_marks()
    keep_marks._read_next()
    session.changes += 1  # what Blender's handler does
    while keep_marks._read_next() is not None:
        pass
    assert is_known(built)
    assert session.marking is None


def test_a_scene_that_is_cleared_meanwhile_keeps_none(built):
    keep_marks.schedule_reading(built.scene)
    cancel_call(keep_marks._read_next)
    scenes.clear_scene(built.scene)
    while keep_marks._read_next() is not None:
        pass
    assert not known_marks.has_known_marks()

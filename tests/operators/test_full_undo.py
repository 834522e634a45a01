"""Undo that reads all data-blocks anew: its option is on during such an undo alone."""

from __future__ import annotations

import bpy
import pytest
from icymoon.operators import full_undo
from icymoon.operators.session import session


@pytest.fixture
def seen(scene):
    """What Blender's option was during each undo."""
    found = []

    def note(*_: object) -> None:
        found.append(bpy.context.preferences.experimental.use_undo_legacy)

    preferences = bpy.context.preferences
    before = preferences.edit.use_global_undo, preferences.is_dirty
    preferences.edit.use_global_undo, preferences.is_dirty = True, False
    bpy.app.handlers.undo_pre.append(note)  # after ours
    yield found
    bpy.app.handlers.undo_pre.remove(note)
    preferences.edit.use_global_undo, preferences.is_dirty = before


def undo_a_step(scene) -> None:
    for name in ("One", "Two"):
        scene["step"] = name
        bpy.ops.ed.undo_push(message=name)
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert bpy.context.scene["step"] == "One"


def test_only_the_undo_after_a_change_without_a_step_reads_everything(scene, seen):
    preferences = bpy.context.preferences
    shown = preferences.view.show_developer_ui
    undo_a_step(scene)
    full_undo.require_full_undo()
    undo_a_step(bpy.context.scene)
    undo_a_step(bpy.context.scene)
    assert seen == [False, True, False]
    assert not preferences.experimental.use_undo_legacy
    assert preferences.view.show_developer_ui == shown
    assert not preferences.is_dirty  # or Blender would save what it had during the undo


def test_the_undo_of_a_mode_leaves_the_next_one_to_read_everything(scene):
    full_undo.require_full_undo()
    item = bpy.data.objects.new("Dunes", bpy.data.meshes.new("Dunes"))
    scene.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item
    bpy.ops.object.mode_set(mode="EDIT")
    full_undo._begin()
    full_undo._end()
    assert session.changed_without_step
    bpy.ops.object.mode_set(mode="OBJECT")
    full_undo._begin()
    full_undo._end()
    assert not session.changed_without_step


@pytest.mark.usefixtures("scene")
def test_options_of_before_are_restored_also_after_an_undo_without_an_end():
    preferences = bpy.context.preferences
    before = preferences.view.show_developer_ui, preferences.experimental.use_undo_legacy
    full_undo.require_full_undo()
    full_undo._begin()
    full_undo._begin()
    full_undo._end()
    assert (preferences.view.show_developer_ui, preferences.experimental.use_undo_legacy) == before

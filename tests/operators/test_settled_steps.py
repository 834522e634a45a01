"""What is read in pieces is the scene at one time."""

from __future__ import annotations

import threading
import time

import bpy
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.datablocks import array_marks
from icymoon.nodes.datablocks.fingerprint import read_marks, read_marks_in_steps
from icymoon.operators import refine_ground, render
from icymoon.operators.session import session
from icymoon.operators.settled_steps import settle
from icymoon.operators.work_in_pieces import WorkInPieces
from icymoon.settings.blender import scene_properties
from icymoon.support.errors import IcyMoonError
from icymoon.support.steps import Steps, finish
from pieces import count_pauses, stop_after, walk
from thread_asks import list_asks_of_threads


def test_a_change_at_any_pause_begins_the_reading_anew():
    for changed in range(4):
        pauses: list[int] = []
        readings: list[int] = []

        def read(readings: list[int] = readings) -> Steps[int]:
            readings.append(session.changes)
            yield None
            yield None
            return readings[-1]

        def change(pauses: list[int] = pauses, changed: int = changed) -> None:
            session.changes += len(pauses) == changed
            pauses.append(session.changes)

        found = walk(settle(read), change)
        assert found == session.changes
        assert len(readings) == (2 if changed < 3 else 1), f"a change at pause {changed}"


def test_a_scene_that_changes_all_the_time_is_read_at_once():
    pauses: list[None] = []

    def change() -> None:
        session.changes += 1
        pauses.append(None)

    def read() -> Steps[int]:
        before = len(pauses)
        yield None
        return len(pauses) - before

    assert walk(settle(read), change) == 0
    assert len(pauses) == 6


def test_a_data_block_that_is_removed_meanwhile_is_not_read_again():
    def read() -> Steps[str]:
        item = bpy.data.objects.get("Passing")
        yield None
        return item.name if item else "gone"

    item = bpy.data.objects.new("Passing", None)
    assert (
        walk(settle(read), lambda: bpy.data.objects.remove(item) if "Passing" in bpy.data.objects else None) == "gone"
    )


@pytest.fixture
def built(small: bpy.types.Scene) -> scenes.Built:
    """The small scene with rocks, built."""
    small.icymoon.rocks.coverage = 0.05
    return scenes.build_scene(small, scene_properties.read_settings(small.icymoon))


def test_marks_in_steps_are_those_at_once(built):
    assert walk(read_marks_in_steps(built.collection), lambda: None) == read_marks(built.collection)
    assert walk(built.find_extra(), lambda: None) == built.extra
    built.terrain.data.vertices[0].co.z += 1.0
    assert walk(built.find_edited_parts(), lambda: None) == built.edited_parts() == {"terrain data"}
    assert walk(built.find_extra(), lambda: None) == built.extra != ""


def test_a_piece_of_the_marks_reads_one_array_of_a_mesh(built, monkeypatch):
    """A piece holds the window for the time that it takes to copy and hash what it reads."""
    reads, read_one = [0], array_marks.read_property

    def note(items, *arguments, **options):
        found = read_one(items, *arguments, **options)
        reads[-1] += found.dtype != bool
        return found

    monkeypatch.setattr(array_marks, "read_property", note)
    walk(read_marks_in_steps(built.collection), lambda: reads.append(0))
    assert max(reads) == 1
    assert sum(reads) >= 3


def test_threads_hash_large_arrays_and_ask_blender_nothing(built, monkeypatch):
    at_once, hash_one = read_marks(built.collection), array_marks.mark_array
    threads: list[bool] = []

    def note(values, indices=False):
        if values.nbytes:
            threads.append(threading.current_thread() is not threading.main_thread())
        return hash_one(values, indices)

    monkeypatch.setattr(array_marks, "mark_array", note)
    monkeypatch.setattr(array_marks, "LARGE_BYTES", 0)
    asked = list_asks_of_threads(monkeypatch)
    work = WorkInPieces(read_marks_in_steps(built.collection), "the marks")
    while not (messages := work.poll()):
        time.sleep(0.001)
    assert messages[0]["value"] == at_once
    assert all(threads)
    assert len(threads) > 10
    assert asked == []


def test_an_edit_between_two_pieces_is_in_the_plan_of_pairs(built):
    settings, scene = scene_properties.read_settings(built.scene.icymoon), built.scene
    edits: list[None] = []

    def edit() -> None:
        if len(edits) == 4:
            built.camera.location.z += 1.0
            refine_ground._note_change()  # what Blender's handler does
        edits.append(None)

    pairs = walk(settle(lambda: render.plan_pairs_in_steps(scene, settings)), edit)
    assert [pair.id for pair in pairs] == [pair.id for pair in render.plan_pairs(scene, settings)]


def test_a_render_of_a_preview_builds_coarse_ground_in_pieces_and_leaves_nothing_before(small, monkeypatch):
    settings = scene_properties.read_settings(small.icymoon)
    monkeypatch.setattr(render, "start_refining", lambda: None)
    before = len(bpy.data.objects), len(bpy.data.meshes)
    states: list[bool] = []
    walk(
        render.show_rendered_scene(small.session_uid, settings),
        lambda: states.append(scenes.find_collection(small) is not None),
    )
    assert len(states) > 4
    assert not any(states)
    assert scenes.find_built(small).preview
    scenes.clear_scene(small)
    for pauses in range(1, len(states) + 1):
        stop_after(render.show_rendered_scene(small.session_uid, settings), pauses)
        assert (len(bpy.data.objects), len(bpy.data.meshes)) == before


def test_a_scene_that_is_deleted_meanwhile_is_a_sentence(small):
    other = bpy.data.scenes.new("Other")
    settings = scene_properties.read_settings(small.icymoon)
    steps = render.show_rendered_scene(other.session_uid, settings)
    next(steps)
    bpy.data.scenes.remove(other)
    with pytest.raises(IcyMoonError, match="The scene was deleted"):
        finish(steps)


def test_pauses_are_as_many_as_there_are_parts_to_read(built):
    assert count_pauses(built.find_edited_parts("sun"))[0] >= 2

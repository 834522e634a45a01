"""A build in pieces comes to what a build at once comes to; and if anything happens between two pieces, the scene is
built completely or is as it was."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import pytest
from built_scenes import everything
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks.fingerprint import read_parts
from icymoon.operators import build, build_in_pieces, coloured_views, live_preview, work_in_pieces
from icymoon.operators.build_in_pieces import PiecewiseBuildOperator
from icymoon.operators.build_scene import ICYMOON_OT_build_scene
from icymoon.operators.jobs import Job
from icymoon.operators.session import session
from icymoon.operators.window_events import cancel_call
from icymoon.operators.work_in_pieces import WorkInPieces
from icymoon.settings.blender import scene_properties
from icymoon.support.errors import IcyMoonError
from icymoon.support.steps import call, finish
from pieces import count_pauses, stop_after
from stand_ins import stand_in
from thread_asks import list_asks_of_threads

TIMER = stand_in(type="TIMER", value="NOTHING")
ESCAPE = stand_in(type="ESC", value="PRESS")
UNDO = stand_in(type="Z", value="PRESS", ctrl=True, oskey=False, shift=False)


@pytest.fixture
def rocky(small: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> Iterator[bpy.types.Scene]:
    """The small scene with rocks and a planet, not built. Each look at a build runs one piece."""
    monkeypatch.setattr(work_in_pieces, "_BUDGET_S", -1.0)
    small.icymoon.rocks.coverage = 0.05
    small.icymoon.light.planet = True
    yield small
    session.stop_building()
    session.to_preview.clear()
    cancel_call(live_preview.show_waiting)


def settings(scene: bpy.types.Scene) -> Any:
    return scene_properties.read_settings(scene.icymoon)


def begin(scene: bpy.types.Scene) -> Job:
    """Begin to build, as the operator does."""
    work = WorkInPieces(build_in_pieces.build_in_pieces(scene.session_uid, settings(scene)), "the ground")
    session.building = Job("Build Scene", work, if_stopped="the scene is as before")
    return session.building


def wait(job: Job, pieces: int = 10**6) -> Job:
    """Look at the job until it ends or some looks have begun new pieces."""
    work: Any = job.process
    while pieces and job.poll():
        pieces -= work._thread is None
        time.sleep(0.001)
    return job


def add_second(scene: bpy.types.Scene) -> bpy.types.Scene:
    """Add a scene with the same settings."""
    other = bpy.data.scenes.new("Other")
    scene_properties.write_settings(other.icymoon, settings(scene))
    return other


def count_pieces(scene: bpy.types.Scene) -> int:
    """Number of pauses of a build."""
    count, made = count_pauses(preview.make_coarse(settings(scene)))
    made.remove()
    return count


def test_pieces_come_to_what_a_build_at_once_comes_to(rocky):
    at_once = preview.build_coarse(rocky, settings(rocky))
    marks, counts, stored = read_parts(at_once.collection), everything(), at_once.preview
    scenes.clear_scene(rocky)
    job = wait(begin(rocky))
    built = scenes.find_built(rocky)
    assert not job.failure
    assert read_parts(built.collection) == marks
    assert everything() == counts
    assert built.preview == stored
    assert not built.edited
    assert [kind for kind, _ in job.result["value"]] == ["INFO"]


def test_a_scene_shows_nothing_before_the_last_piece(rocky):
    job, states = begin(rocky), []
    while job.poll():
        states.append((len(rocky.objects), scenes.find_built(rocky) is not None))
        time.sleep(0.001)
    assert states[0] == (0, False)
    assert {built for count, built in states if not count} == {False}
    assert {count for count, _ in states} == {0, len(rocky.objects)}


def test_nothing_is_left_wherever_a_build_stops(rocky):
    before, pieces = everything(), count_pieces(rocky)
    assert pieces >= 6
    for pauses in range(1, pieces + 1):
        stop_after(preview.make_coarse(settings(rocky)), pauses)
        assert everything() == before, f"after {pauses} pauses"


def test_a_stopped_build_leaves_the_earlier_scene(rocky):
    built = scenes.build_scene(rocky, settings(rocky))
    marks, counts = read_parts(built.collection), everything()
    rocky.icymoon.terrain.rms_slope_deg += 3.0
    job = wait(begin(rocky), 3)
    job.cancel()
    assert not job.poll()
    assert job.failure == "Build Scene was stopped; the scene is as before."
    assert read_parts(built.collection) == marks
    assert everything() == counts


@pytest.mark.parametrize("error", [IcyMoonError("The file is gone; choose another."), MemoryError()])
def test_an_error_in_the_thread_is_a_sentence_and_changes_nothing(rocky, monkeypatch, error):
    def fail(*_: object) -> None:
        raise error

    before = everything()
    monkeypatch.setattr("icymoon.nodes.scene_objects._place_rocks", fail)
    job = wait(begin(rocky))
    assert job.failure.startswith(str(error) or "There is not enough memory for")
    assert everything() == before
    assert scenes.find_collection(rocky) is None


def test_a_defect_in_the_thread_ends_the_operator_and_changes_nothing(rocky, monkeypatch, operator):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("no step")

    before = everything()
    monkeypatch.setattr("icymoon.nodes.scene_objects._place_rocks", fail)
    assert finish_operator(operator) == {"CANCELLED"}
    assert "ended by an error (ZeroDivisionError: no step)" in operator.said[-1]
    assert everything() == before
    assert session.building is None


@pytest.mark.parametrize("path", ["NONE", "LINE"])
def test_its_threads_ask_blender_nothing(rocky, monkeypatch, path):
    """A stopped build's thread runs on while another file is opened, and Blender then frees what it would read."""
    rocky.icymoon.rocks.skirt = 0.3
    rocky.icymoon.excavation.path = path
    rocky.icymoon.surface.model, rocky.icymoon.surface.frost_share = "PRINCIPLED", 0.5
    rocky.icymoon.surface.frost_from = "FALL"
    asked, calls = list_asks_of_threads(monkeypatch), []
    monkeypatch.setattr(work_in_pieces, "call", lambda work: calls.append(work.func.__name__) or call(work))
    job = wait(begin(rocky))
    assert not job.failure
    assert {"mesh_whole_ground", "_place_rocks", "_trace_shelter"} <= set(calls)
    assert asked == []


def test_a_scene_that_is_deleted_meanwhile_is_a_sentence(rocky):
    other = add_second(rocky)
    before = everything()
    job = wait(begin(other), 4)
    bpy.data.scenes.remove(other)
    wait(job)
    assert job.failure.startswith("The scene was deleted while it was built")
    assert everything() == before | {"scenes": before["scenes"] - 1}


def test_purging_unused_data_meanwhile_is_a_sentence(rocky):
    before = everything()
    job = wait(begin(rocky), 4)
    assert len(bpy.data.objects) > before["objects"]
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    wait(job)
    assert job.failure.startswith("Parts of the new scene were removed while it was built")
    assert scenes.find_collection(rocky) is None
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    assert everything() == before


@pytest.mark.parametrize("again", [False, True])
@pytest.mark.parametrize("kind", ["objects", "materials"])
def test_removing_one_part_meanwhile_removes_the_others(rocky, kind, again):
    if again:
        scenes.build_scene(rocky, settings(rocky))
    before, pieces = everything(), count_pieces(rocky)
    for pauses in range(2, pieces + 1):
        old = set(getattr(bpy.data, kind))
        job = wait(begin(rocky), pauses)
        new = [block for block in getattr(bpy.data, kind) if block not in old]
        if not new or not job.process.running:
            job.cancel()
            continue
        getattr(bpy.data, kind).remove(new[0])
        wait(job)
        assert job.failure.startswith("Parts of the new scene were removed while it was built"), pauses
        half_made = len(bpy.data.objects) - before["objects"]  # one that was to point at the removed one
        assert half_made <= 1, pauses
        bpy.ops.outliner.orphans_purge(do_recursive=True)
        assert everything() == before, pauses


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_ground_that_is_edited_meanwhile_stays(rocky, mode):
    built = scenes.build_scene(rocky, settings(rocky))
    counts = everything()
    job = wait(begin(rocky), 4)
    bpy.context.view_layer.objects.active = built.terrain
    bpy.ops.object.mode_set(mode=mode)
    wait(job)
    assert job.failure == f"{built.terrain.name} is being edited; go to Object Mode to build the scene."
    assert built.terrain.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    assert everything() == counts
    assert not scenes.find_built(rocky).preview


def test_parts_that_are_deleted_meanwhile_are_built_again(rocky):
    built = scenes.build_scene(rocky, settings(rocky))
    job = wait(begin(rocky), 4)
    bpy.data.objects.remove(built.terrain)
    bpy.data.objects.remove(built.sun)
    wait(job)
    assert not job.failure
    counts = everything()
    scenes.clear_scene(rocky)
    preview.build_coarse(rocky, settings(rocky))
    assert everything() == counts


def test_a_build_of_another_scene_stops_it(rocky):
    other = add_second(rocky)
    job = wait(begin(other), 4)
    assert build.build_and_report(stand_in(report=print), bpy.context, coarse=True) == {"FINISHED"}
    assert job.process.cancelled
    assert scenes.find_collection(other) is None
    assert not scenes.find_built(rocky).edited
    bpy.data.scenes.remove(other)


def test_a_slider_meanwhile_is_shown_afterwards(rocky):
    job = wait(begin(rocky), 4)
    rocky.icymoon.light.sun_elevation_deg = 33.0
    wait(job)
    assert scenes.find_built(rocky).settings.light.sun_elevation_deg != 33.0
    assert session.to_preview == {rocky.name}
    assert bpy.app.timers.is_registered(live_preview.show_waiting)
    cancel_call(live_preview.show_waiting)
    live_preview.show_waiting()
    assert scenes.find_built(rocky).settings.light.sun_elevation_deg == 33.0


def test_undo_meanwhile_stops_it_first(rocky):
    before = everything()
    job = wait(begin(rocky), 4)
    for handler in list(bpy.app.handlers.undo_pre):
        handler(rocky, None)
    assert job.process.cancelled
    assert session.building is None
    assert everything() == before


class Operator(PiecewiseBuildOperator):
    """An operator as Blender holds it after ``invoke``."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self._watch, self._timer = stand_in(ended=False, turns=0, is_seen=False), object()

    def report(self, kind: set[str], message: str, /) -> None:
        self.said.append(message)

    def take_back(self, scene: bpy.types.Scene) -> None:
        scene.icymoon.preset = "before"


@pytest.fixture
def operator(rocky: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> Operator:
    monkeypatch.setattr(build_in_pieces.refine_ground, "start_refining", lambda: None)
    found = Operator()
    found._job = found.start(bpy.context)
    return found


def finish_operator(operator: Operator, then: Callable[[], object] = lambda: None) -> set[str]:
    """Send events of a timer until the operator ends."""
    while (result := operator.modal(bpy.context, TIMER)) == {"PASS_THROUGH"}:
        time.sleep(0.001)
    return result


def test_the_operator_finishes_once_the_scene_is_built(rocky, operator):
    assert session.building is operator._job
    assert finish_operator(operator) == {"FINISHED"}
    assert session.building is None
    assert operator.said[-1].startswith("Built ")
    assert scenes.find_built(rocky).preview


@pytest.mark.parametrize("event", [ESCAPE, UNDO])
def test_esc_and_undo_stop_it_and_take_back_what_came_before(rocky, operator, event):
    before = everything()
    assert operator.modal(bpy.context, TIMER) == {"PASS_THROUGH"}
    assert operator.modal(bpy.context, event) == {"RUNNING_MODAL"}  # the key does nothing else
    assert finish_operator(operator) == {"CANCELLED"}
    assert rocky.icymoon.preset == "before"
    assert everything() == before
    assert session.building is None


def test_while_a_scene_is_built_again_the_sidebar_calls_it_the_earlier_one(rocky):
    """It said 'Ground in full detail' of the ground that was about to go."""
    bpy.ops.icymoon.build_scene()
    begin(rocky)
    assert live_preview.list_lines(rocky) == [live_preview.BUILDING]
    session.stop_building()
    assert live_preview.list_lines(rocky) == ["Ground in full detail"]


@pytest.mark.parametrize("event", [ESCAPE, UNDO])
def test_the_sidebar_tells_that_a_build_was_stopped_and_what_is_left(operator, event):
    """It said that no job was running."""
    operator.modal(bpy.context, event)
    finish_operator(operator)
    assert (session.ended, session.remains) == ("Build Scene: stopped", "The scene is as before")
    session.ended = session.remains = ""


class BuildScene(Operator):
    """The operator of Build Scene as Blender holds it after ``invoke``."""

    make_steps = ICYMOON_OT_build_scene.make_steps


def press_build(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Press Build Scene, and return what it reports."""
    monkeypatch.setattr(build_in_pieces.refine_ground, "start_refining", lambda: None)
    found = BuildScene()
    found._job = found.start(bpy.context)
    assert finish_operator(found) == {"FINISHED"}
    return found.said


@pytest.mark.parametrize("build", [preview.build_coarse, scenes.build_scene], ids=["coarse", "full"])
def test_a_scene_that_is_built_is_told_and_not_built_again(rocky, monkeypatch, build):
    """It was built again without a word, with coarse ground."""
    built = build(rocky, settings(rocky))
    ground, marks = built.terrain, read_parts(built.collection)
    assert press_build(monkeypatch) == ["The scene is built already, and nothing has changed since"]
    assert session.ended == "Build Scene: nothing has changed"
    assert (scenes.find_built(rocky).terrain, read_parts(built.collection)) == (ground, marks)
    session.ended = ""


def test_a_build_of_an_unchanged_scene_removes_what_a_deleted_scene_left(rocky, monkeypatch):
    scenes.build_scene(rocky, settings(rocky))
    before = everything()
    other = bpy.data.scenes.new("Other")
    scenes.build_scene(other, settings(rocky))
    bpy.data.scenes.remove(other)
    assert everything() != before
    press_build(monkeypatch)
    assert everything() == before
    session.ended = ""


def test_a_scene_that_is_covered_by_colours_is_built_again_without_them(rocky, monkeypatch):
    """Errors and decisions stayed on the ground, since no setting had changed."""
    built = scenes.build_scene(rocky, settings(rocky))
    bpy.ops.icymoon.show_beams()  # as errors and decisions do
    assert coloured_views.is_shown(built.scene)
    assert press_build(monkeypatch)[-1].startswith("Built ")
    assert not coloured_views.is_shown(rocky)
    session.ended = ""


@pytest.mark.parametrize("change", ["setting", "light", "edit", "deleted", "left coarse"])
def test_a_scene_that_differs_from_its_settings_is_built_again(rocky, monkeypatch, change):
    built = (preview.build_coarse if change == "left coarse" else scenes.build_scene)(rocky, settings(rocky))
    if change == "setting":
        rocky.icymoon.terrain.rms_slope_deg += 3.0
    elif change == "light":
        rocky.icymoon.light.sun_elevation_deg += 3.0
    elif change == "edit":
        built.sun.rotation_euler.x += 0.1
    elif change == "deleted":
        bpy.data.objects.remove(built.terrain)
    else:  # the fine ground could not be made
        del built.collection[scenes.REFINED]
    assert press_build(monkeypatch)[-1].startswith("Built ")
    assert session.ended == "Build Scene: done"
    session.ended = ""
    assert scenes.find_built(rocky).preview  # its fine ground follows


def test_keys_of_others_pass(operator):
    for event in (
        stand_in(type="Z", value="PRESS", ctrl=True, oskey=False, shift=True),
        stand_in(type="G", value="PRESS"),
    ):
        assert operator.modal(bpy.context, event) == {"PASS_THROUGH"}
    assert operator._job.process.running


def test_finish_is_what_the_pieces_come_to(rocky):
    made = finish(preview.make_coarse(settings(rocky)))
    assert made.coarse
    assert made.is_there()
    made.remove()
    assert not made.is_there()


def test_an_undo_by_the_menu_takes_back_the_build_alone(rocky, monkeypatch):
    """The build has no undo step yet, so the undo takes back the step before it too, which is redone."""
    asked: list[object] = []
    monkeypatch.setattr(build_in_pieces, "call_later", asked.append)
    begin(rocky)
    build_in_pieces._stop_before_undo()
    assert session.building is None
    build_in_pieces._return_after_undo()
    assert asked == [build_in_pieces.redo]
    build_in_pieces._stop_before_undo()
    build_in_pieces._return_after_undo()
    assert len(asked) == 1, "an undo without a build is an undo"

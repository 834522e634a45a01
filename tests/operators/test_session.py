"""What belongs to the open file is stopped and forgotten with it; what is known holds until anything changes."""

from __future__ import annotations

import sys
import threading

import bpy
import pytest
from icymoon.operators import jobs, window_events
from icymoon.operators.session import Session, session
from icymoon.operators.work_in_pieces import WorkInPieces
from icymoon.render.workers.watched_thread import Calculation
from icymoon.support.errors import IcyMoonError
from stand_ins import stand_in


@pytest.fixture
def sleeping(scene):
    """A process that would run for a minute."""
    yield jobs.Job.start("Sleep", [sys.executable, "-c", "import time; time.sleep(60)"])
    session.reset()


def test_another_file_stops_all_jobs_and_forgets_all_else(sleeping):
    free, cleaned = threading.Event(), []
    sleeping.clean_up = lambda: cleaned.append(True)
    session.job, session.reading = sleeping, jobs.Job("Read", Calculation(free.wait, "a pair"))
    for name in ("to_develop", "to_preview", "views_left"):
        getattr(session, name).add(1)
    for name in ("views_before", "shading_before", "colours_left"):
        getattr(session, name)[1] = {}
    session.development_notes, session.preview_side = ["A warning."], 129
    reading, fresh = session.reading, Session()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    free.set()
    assert cleaned == [True]
    assert sleeping.process.returncode != 0
    assert sleeping.process.cancelled
    assert reading.process.cancelled
    clocks = {"traced_since_s", "load_measured_s", "picture", "changes"}
    assert {k: v for k, v in vars(session).items() if k not in clocks} == {
        k: v for k, v in vars(fresh).items() if k not in clocks
    }


def test_a_command_that_cannot_start_leaves_nothing():
    cleaned = []
    with pytest.raises(IcyMoonError, match="Cannot start /nowhere/python"):
        jobs.Job.start("Sleep", ["/nowhere/python"], clean_up=lambda: cleaned.append(True))
    assert cleaned == [True]


@pytest.mark.parametrize("clean", [True, False])
def test_a_job_runs_without_the_variables_that_lead_to_modules_unless_it_is_blender(monkeypatch, clean):
    monkeypatch.setenv("PYTHONPATH", "/elsewhere")
    started = []
    monkeypatch.setattr(jobs, "Process", lambda command, environment: started.append(environment))
    jobs.Job.start("Render", ["blender"], clean=clean)
    if clean:
        assert "PYTHONPATH" not in started[0]
    else:
        assert started == [None]  # ours


def test_the_last_message_of_an_end_is_the_result():
    messages = [{"type": "progress", "fraction": 0.5, "message": "half"}, {"type": "done", "assets": 3}]
    process = stand_in(cancelled=False, poll=lambda: [messages.pop(0)], running=True, returncode=1, cause="Killed")
    job = jobs.Job("Make", process)
    assert job.poll()
    assert (job.fraction, job.result) == (0.5, {})
    assert job.failure == "Make ended without a result (status 1): Killed"
    job.poll()
    assert job.result["assets"] == 3
    assert job.failure == ""


def change_setting() -> None:
    bpy.context.scene.icymoon.surface.albedo = 0.31


def undo() -> None:
    for handler in bpy.app.handlers.undo_post:
        handler(bpy.context.scene)


def open_file() -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


@pytest.mark.usefixtures("scene")
@pytest.mark.parametrize("change", [change_setting, undo, open_file])
def test_what_is_known_is_made_once_until_anything_changes(change):
    made = []
    for _ in range(2):
        window_events.keep_until_change("a key", lambda: made.append(1))
    window_events.keep_until_change("another", lambda: made.append(2))
    assert made == [1, 2]
    change()
    window_events.keep_until_change("a key", lambda: made.append(3))
    assert made == [1, 2, 3]


def test_a_module_follows_events_only_while_it_is_registered(scene):
    heard: list[object] = []
    timer = heard.copy  # any function
    register, unregister = window_events.make_registration(
        lambda scene, effects: heard.append(set(effects)),
        timers=(timer,),
        end=lambda: heard.append("end"),
        undo_post=lambda: heard.append("undo"),
    )
    change_setting()
    register()
    window_events.call_later(timer, 60.0)
    window_events.call_later(timer, 60.0)
    scene.icymoon.surface.albedo = 0.4
    undo()
    assert heard == [{"material"}, "undo"]
    assert bpy.app.timers.is_registered(timer)
    unregister()
    assert not bpy.app.timers.is_registered(timer)
    undo()
    change_setting()
    assert heard == [{"material"}, "undo", "end"]


def do_nothing():
    yield None


def test_how_a_job_ended_is_told_in_its_own_scene(small):
    other = bpy.data.scenes.new("Other")
    job = jobs.Job("Export", WorkInPieces(do_nothing(), "nothing"))
    session.note_end(job, "done")
    assert (session.find_end(small), session.find_end(other)) == ("Export: done", "")
    session.note("Use Selected Object as Rock", "failed", other.session_uid)
    assert (session.find_end(small), session.find_end(other)) == ("", "Use Selected Object as Rock: failed")
    session.ended, session.ended_in = "", 0


def test_what_fails_before_its_job_begins_is_told_instead_of_the_last_job(small):
    session.note_end(jobs.Job("Export", WorkInPieces(do_nothing(), "nothing")), "done")
    bpy.ops.mesh.primitive_plane_add()
    with pytest.raises(RuntimeError, match="must be closed"):
        bpy.ops.icymoon.object_as_rock()
    assert session.find_end(small) == "Use Selected Object as Rock: failed"
    session.ended, session.ended_in = "", 0

"""The pair folder, the plan, atomic files, the worker's queue and launch paths; no Blender."""

from __future__ import annotations

import json
import math
import os
import socket
import sys
from pathlib import Path

import hostile_arrays
import numpy as np
import pytest
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.pairs.pair_folder import find_pairs, is_complete, read_pair, update_response
from icymoon.render.plans.frozen_plan import read_frozen_plan
from icymoon.render.plans.plan_file import find_plan, read_plan
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.workers.job_commands import Job, blender_command, resolve_dataset_folder
from icymoon.render.workers.process import Process
from icymoon.settings import description
from icymoon.support import files
from icymoon.support.errors import IcyMoonError
from pairs import camera, write_pair


def test_the_papers_camera():
    camera = StereoCamera.from_settings(description.defaults().rig)
    assert camera.focal_px == pytest.approx(640 * 32 / 60)
    assert camera.focal_baseline_px_m == pytest.approx(85.3333333)  # not 80, which is 6.25 % off
    field_of_view = [2 * math.degrees(math.atan(size / 2 / camera.focal_px)) for size in (640, 480)]
    assert field_of_view == pytest.approx([86.3, 70.2], abs=0.1)
    assert (camera.cx_px, camera.cy_px) == (320, 240)
    assert StereoCamera.from_json(json.loads(json.dumps(camera.to_json()))) == camera
    depth = np.array([1.0, 85.3333333, math.nan])
    assert camera.disparity(depth)[:2] == pytest.approx([85.3333333, 1.0])
    assert math.isnan(camera.disparity(depth)[2])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("focal_px", 1e300),
        ("focal_px", 1.01),
        ("baseline_m", 1e-300),
        ("baseline_m", 0.99),
        ("toe_in_deg", 90.0),
        ("margin_x_px", 40),
        ("width_px", 95),
        ("cx_px", 1.01),
    ],
)
def test_a_calibration_that_the_settings_do_not_give_is_no_pair(tmp_path, key, value):
    """One number of it would be in every average, and change it without a word. Numbers near 1 are factors."""
    path = write_pair(tmp_path / "a", rig=camera(96, 48)) / "pair.json"
    assert read_pair(path.parent).camera == camera(96, 48)
    stated = json.loads(path.read_text())
    there = stated["camera"][key]
    stated["camera"][key] = there * value if 0.9 < value < 1.1 else value
    path.write_text(json.dumps(stated))
    with pytest.raises(IcyMoonError, match=rf"camera\.{key} is .*its settings give {there}"):
        read_pair(path.parent)


def test_headings_are_equal_turns_with_their_own_ids():
    base = description.merged(description.defaults(), {"dataset": {"headings": 4}, "rig": {"heading_deg": 100.0}})
    pairs = expand_headings(base)
    assert [p.turn_deg for p in pairs] == [0, 90, 180, 270]
    assert [p.settings.rig.heading_deg for p in pairs] == [100, -170, -80, 10]
    assert len({p.id for p in pairs}) == 4
    assert len({p.render_seed for p in pairs}) == 4
    assert [p.id for p in expand_headings(base)] == [p.id for p in pairs]
    alone = expand_headings(description.merged(base, {"dataset": {"headings": 1}}))[0]
    assert alone.id == pairs[0].id


def test_incomplete_and_foreign_folders_are_named(tmp_path):
    with pytest.raises(IcyMoonError, match="no complete stereo pair"):
        find_pairs(tmp_path)
    pair = tmp_path / "pairs" / "abc"
    pair.mkdir(parents=True)
    for content, word in (
        ("{", "cannot be read"),
        ("[]", "not an Icy Moon pair"),
        ("{}", "not an Icy Moon pair"),
        ('{"format": "icymoon-pair", "version": 99}', "version 99"),
        ('{"format": "icymoon-pair", "version": 1}', "is missing"),
    ):
        (pair / "pair.json").write_text(content)
        with pytest.raises(IcyMoonError, match="abc") as caught:
            read_pair(pair)
        assert word in str(caught.value)
    with pytest.raises(IcyMoonError, match="is a data set, not a pair; give the folder of one of its pairs"):
        read_pair(tmp_path)
    pair.rename(tmp_path / "pairs" / "abc.part")
    with pytest.raises(IcyMoonError, match="no complete stereo pair"):
        find_pairs(tmp_path)


def test_a_failed_write_leaves_the_old_file(tmp_path):
    target = tmp_path / "deep" / "a.json"
    files.write_json(target, {"a": 1})

    def fail(part: Path) -> None:
        part.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(IcyMoonError, match="disk is full"):
        files.write_atomically(target, fail)
    assert json.loads(target.read_text()) == {"a": 1}
    assert [p.name for p in target.parent.iterdir()] == ["a.json"]
    with pytest.raises(ValueError, match=r"nan|NaN|JSON"):
        files.write_json(target, {"a": math.nan})
    with pytest.raises(IcyMoonError, match="a file"):
        files.write_json(target / "b.json", {})


def _python(code: str) -> Process:
    return Process([sys.executable, "-c", code])


def test_a_process_is_heard_in_order_and_its_noise_is_kept():
    process = _python(
        "import json\nfor k in range(3): print(json.dumps({'type': 'progress', 'k': k}), flush=True)\n"
        "print('{not json'); print('Cycles says hello')"
    )
    assert [m["k"] for m in process.wait_for_messages()] == [0, 1, 2]
    assert process.returncode == 0
    assert process.cause == "Cycles says hello"


def test_a_process_that_ignores_the_request_is_made_to_stop():
    process = _python(
        "import signal, time\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        'print(\'{"type": "ready"}\', flush=True)\ntime.sleep(3600)'
    )
    next(process.wait_for_messages())
    process.cancel()
    list(process.wait_for_messages())  # which end when the process does
    assert process.returncode != 0
    assert process.cancelled


def test_a_command_that_is_not_there_is_an_error_with_a_mend():
    with pytest.raises(IcyMoonError, match="check its path"):
        Process(["/nowhere/blender", "-b"])


def test_commands_are_lists_for_blender_and_python():
    assert blender_command("/opt/blender/blender", "worker", "j")[:3] == [
        "/opt/blender/blender",
        "-b",
        "--factory-startup",
    ]
    assert "--python-exit-code" in blender_command("/opt/blender/blender", "worker", "j")
    assert blender_command("/usr/bin/python3.11", "worker", "j")[-2:] == ["worker", "j"]


def test_dataset_folders(tmp_path):
    assert resolve_dataset_folder("//sub/set", str(tmp_path)) == tmp_path / "sub" / "set"
    assert resolve_dataset_folder("~/x") == Path.home() / "x"
    for text in ("//x", "", "  "):
        with pytest.raises(IcyMoonError, match=r"dataset\.folder"):
            resolve_dataset_folder(text, None)


def test_removing_a_job_removes_what_a_killed_worker_left(tmp_path):
    job = Job(tmp_path, description.defaults())
    files.make_part_path(tmp_path / "pairs" / ("0" * 12)).mkdir(parents=True)
    (tmp_path / "pairs" / "def").mkdir()
    job.remove()
    assert not job.folder.exists()
    assert [p.name for p in (tmp_path / "pairs").iterdir()] == ["def"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_no_pair_and_nobody_waits_for_it(tmp_path):
    os.mkfifo(tmp_path / "pair.json")
    with pytest.raises(IcyMoonError, match="it is not a regular file"):
        read_pair(tmp_path)
    assert not is_complete(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("make", ["pipe", "folder", "socket"])
def test_what_stands_in_place_of_a_file_is_named(tmp_path, make, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the path of a socket is short
    for name, read in (
        ("pair.json", lambda: find_pairs(tmp_path)),
        ("plan.jsonl", lambda: read_frozen_plan(tmp_path)),
        ("plan.toml", lambda: read_plan(find_plan(str(tmp_path / "plan.toml")))),
        ("plan", lambda: read_plan(find_plan(str(tmp_path / "plan")))),
    ):
        with socket.socket(socket.AF_UNIX) as server:
            if make == "socket":
                server.bind(name)
            else:
                (os.mkfifo if make == "pipe" else os.mkdir)(name)
            with pytest.raises(IcyMoonError, match=rf"/{name}:? cannot be read \(it is not a regular file\)"):
                read()


@pytest.mark.parametrize("name", ["", "pair.json", "left.exr"])
def test_a_pair_that_is_a_link_or_has_one_is_not_there_and_nothing_is_written_through_it(tmp_path, name):
    folder = write_pair(tmp_path / "a", rig=camera(32, 24))
    assert is_complete(folder)
    target = tmp_path / "elsewhere"
    (folder / name).rename(target)
    (folder / name).symlink_to(target)
    stated = (folder / "pair.json").read_bytes()
    assert not is_complete(folder)
    other = description.merged(description.defaults(), {"sensor": {"gain": 7.0}})
    if name == "left.exr":  # pair.json itself may be written
        update_response(folder, other)
    else:
        with pytest.raises(IcyMoonError, match="is a link"):
            update_response(folder, other)
        assert (folder / "pair.json").read_bytes() == stated
    assert (folder / name).is_symlink()
    assert read_pair(folder).folder == folder  # what others have put together may be measured


@pytest.mark.parametrize("put", ["folder", "pipe", "nothing"])
def test_an_image_that_is_no_regular_file_is_not_there(tmp_path, put):
    folder = write_pair(tmp_path / "a", rig=camera(32, 24))
    hostile_arrays.put(folder / "left.exr", put)
    assert not is_complete(folder)


def test_pairs_of_a_data_set_share_their_tables(tmp_path):
    for name in "ab":
        write_pair(tmp_path / "pairs" / name)
    first, second = find_pairs(tmp_path)
    assert all(first.settings[topic] is second.settings[topic] for topic in first.settings)

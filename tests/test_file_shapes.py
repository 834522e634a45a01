"""What is read back is held against a shape: damaged files are told in a sentence, whatever the damage."""

from __future__ import annotations

import datetime
import errno
import json
import os
import random
import shutil
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import IO

import pytest
from icymoon.commands.sources import read_pair_settings
from icymoon.render.cost import estimate
from icymoon.render.cost import machine_speed as machine
from icymoon.render.pairs.pair_folder import is_complete, read_pair, update_response
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.workers.detached_process import DetachedProcess
from icymoon.render.workers.job_commands import Job, read_job, read_planned_pairs
from icymoon.render.workers.manifest import write_manifest
from icymoon.render.workers.pair_claims import CLAIMS_FOLDER, Claims
from icymoon.render.workers.runner import Runner, WorkerOptions
from icymoon.render.workers.verify_dataset import verify_data_set
from icymoon.settings.description import check
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.export.layouts import export, write_truth
from icymoon.stereo.images import develop as stereo_develop
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.prepare_pair import load_pair
from icymoon.stereo.reexpose import reexpose
from icymoon.stereo.report import schema, write_results
from icymoon.stereo.report.row_log import RowLog
from icymoon.support import cache_folder, file_schemas, files, system
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import quote
from pairs import Scene, camera, write_pair
from stated_pairs import PAIRS, whole

#: What takes the place of a value: other types, other signs, what is not a number, what leads elsewhere, and too much.
INSTEAD = (
    None,
    True,
    -1,
    0,
    2.5,
    1e308,
    float("nan"),
    float("inf"),
    10**30,
    "",
    "abc",
    "../../victim",
    "a/b",
    "\ud800",
    "a\0b",
    [],
    {},
    [[]],
    {"": None},
    {"left.exr": 1},
    {"../x": {"bytes": 1, "sha256": "0" * 64}},
)


def places(data: object, path: tuple = ()) -> list[tuple]:
    """The paths of all values in JSON data."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [path, *(place for key, value in inner for place in places(value, (*path, key)))]


def mutated(text: str, chosen: random.Random) -> str | bytes:
    """A JSON text with a value exchanged or left out, or with bytes that are."""
    if chosen.random() < 0.3:
        raw = bytearray(text.encode())
        at = chosen.randrange(len(raw))
        kind = chosen.randrange(4)
        if kind == 0:
            raw[at] ^= 1 << chosen.randrange(8)
        elif kind == 1:
            del raw[at:]
        elif kind == 2:
            del raw[at : at + chosen.randrange(1, 40)]
        else:
            raw[at:at] = chosen.choice((b"\0", b"\xff\xfe", b"[" * 5000, b"9" * 5000, b'"', b"}"))
        return bytes(raw)
    data = json.loads(text)
    # Each key of the top as likely as another: the settings have more values than all else.
    first = chosen.choice(list(data))
    *above, key = chosen.choice([place for place in places(data) if place[:1] == (first,)])
    parent = data
    for step in above:
        parent = parent[step]
    if chosen.random() < 0.2:
        del parent[key]
    else:
        parent[key] = chosen.choice(INSTEAD)
    return json.dumps(data)


def write(path: Path, content: str | bytes) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))


def sentence_or_success(act: Callable[[], object]) -> bool:
    """Whether it went well; anything but a sentence that can be printed is a failure of the test."""
    said = ""
    try:
        act()
    except IcyMoonError as error:
        said = str(error)
    assert "\n" not in said.encode().decode()
    return not said


def test_a_damaged_pair_is_read_or_told_in_a_sentence(tmp_path):
    folder = whole(tmp_path / "pairs" / PAIRS[0].id)
    path, chosen = folder / "pair.json", random.Random(5)
    good = path.read_text()
    read = 0
    for _ in range(250):
        write(path, mutated(good, chosen))
        for act in (is_complete, read_pair_settings, lambda folder: update_response(folder, PAIRS[0].settings)):
            sentence_or_success(partial(act, folder))
        write(path, mutated(good, chosen))
        if sentence_or_success(lambda: read_pair(folder)):
            read += 1
            sentence_or_success(lambda: load_pair(folder, {}))
    assert 10 < read < 200


def test_a_pair_names_its_files_and_no_others(tmp_path):
    folder = whole(tmp_path / PAIRS[0].id)
    path = folder / "pair.json"
    good = json.loads(path.read_text())
    (tmp_path / "x").write_bytes(b"1")
    other = {"bytes": 1, "sha256": "0" * 64}
    for wrong in (
        {},
        [],
        {"left.exr": good["files"]["left.exr"]},
        good["files"] | {"../x": other},
        good["files"] | {str(tmp_path / "x"): other},
        good["files"] | {"..": other},
        good["files"] | {"left.exr": {"bytes": "1", "sha256": "0" * 64}},
        good["files"] | {"left.exr": {"bytes": good["files"]["left.exr"]["bytes"], "sha256": "abc"}},
    ):
        path.write_text(json.dumps(good | {"files": wrong}))
        assert not is_complete(folder)
        with pytest.raises(IcyMoonError, match=r"pair\.json.*files.*render the pair again"):
            read_pair(folder)
    path.write_text(json.dumps(good))
    assert is_complete(folder)


def test_a_damaged_plan_is_read_or_told_in_a_sentence(tmp_path):
    datasets.freeze_plan(tmp_path, PAIRS, "the plan\n")
    path, chosen = tmp_path / datasets.PLAN, random.Random(6)
    lines = path.read_text().splitlines()
    for _ in range(150):
        number = chosen.randrange(len(lines))
        write(
            path,
            b"\n".join(
                each if isinstance(each, bytes) else each.encode("utf-8", "surrogatepass")
                for each in (mutated(line, chosen) if k == number else line for k, line in enumerate(lines))
            ),
        )
        if sentence_or_success(lambda: datasets.read_frozen_plan(tmp_path)):
            assert all(len(pair.id) == 12 for pair in datasets.read_frozen_plan(tmp_path).pairs)


def test_a_damaged_job_is_read_or_told_in_a_sentence(tmp_path):
    for job in (Job(tmp_path, PAIRS[0].settings, scene="Scene"), Job(tmp_path, pairs=PAIRS, threads=2)):
        good, chosen = job.file.read_text(), random.Random(7)
        for _ in range(100):
            write(job.file, mutated(good, chosen))

            def act(job=job) -> None:
                read = read_job(job.file)
                check(read.get("settings") or {}, "job")
                read_planned_pairs({"pairs": [], **read})
                Path(read["dataset"]).exists()

            sentence_or_success(act)
        job.discard()
    with pytest.raises(IcyMoonError, match="There is no job"):
        read_job(tmp_path / "job.json")


def test_what_a_damaged_file_of_ones_own_remembers_is_forgotten(tmp_path, monkeypatch):
    """The speed of the machine, a claim, what runs, an evaluation's facts and rows: none of them is worth a failure."""
    monkeypatch.setenv(cache_folder.FOLDER_VARIABLE, str(tmp_path))
    speed = machine.Speed(2.0, "CPU", "5.0.1", system.count_processors(), "2026-01-01T00:00+00:00")
    machine.remember_speed(speed)
    claims = Claims(tmp_path)
    claims.take(PAIRS[0].id)
    (claim,) = (tmp_path / CLAIMS_FOLDER).iterdir()
    running = tmp_path / "run.json"
    running.write_text(json.dumps({"pid": 2**22 + 1, "started": 1.0, "title": "Rendering", "dataset": "/x"}))
    (tmp_path / "run.log").touch()
    facts = tmp_path / "pairs" / "p" / "facts.json"
    facts.parent.mkdir(parents=True)
    facts.write_text(
        json.dumps(
            {
                "pair": "p",
                "key": "k",
                "images": {"left": "pairs/p/left.png"},
                "settings": {},
                "rendered": {},
                "width_px": 3,
                "self_check": {"ok": True, "problems": []},
                "height_px": 2,
                "true": 1.0,
                "visible": None,
                "exposure_s": 1.0,
            }
        )
    )
    rows = tmp_path / "rows.jsonl"
    row = {
        "pair": "p",
        "method": "bm",
        "key": "k",
        **dict.fromkeys(write_results.NUMBERS),
        "status": "ok",
        "error": "",
        "common": {},
        "images": {},
        "options": {},
        "facts": {},
        "counts": {},
        "strata": {},
        "histograms": {},
        "sparsification": {},
        "error_curve": [],
    }
    rows.write_text(json.dumps(row) + "\n")
    assert RowLog(rows, schema.ROW).find("p", "bm", "k") == row
    assert write_results.find_facts(tmp_path, "p") is not None
    assert machine.recall_speed("CPU") == speed
    file = machine._speed_file()
    for path, act in (
        (file, lambda: machine.recall_speed("CPU")),
        (claim, lambda: Claims(tmp_path).find_claimed_elsewhere()),
        (claim, lambda: Claims(tmp_path).describe_holder(PAIRS[0].id)),
        (claim, lambda: claims.is_lost(PAIRS[0].id)),
        (running, lambda: DetachedProcess.attach(tmp_path / "run")),
        (facts, lambda: write_results.find_facts(tmp_path, "p")),
        (rows, lambda: RowLog(rows, schema.ROW).find("p", "bm", "k")),
    ):
        good, chosen = path.read_text(), random.Random(8)
        for _ in range(60):
            content = mutated(good.rstrip("\n"), chosen)
            write(path, content + b"\n" if isinstance(content, bytes) else content + "\n")
            act()
        path.write_text(good)
    file.write_text(
        json.dumps({machine._speed_key("CPU", "5.0.1", system.count_processors()): asdict(speed) | {"factor": "abc"}})
    )
    assert machine.recall_speed("CPU") is None
    claims.close()


@pytest.fixture(scope="module")
def broken_set(tmp_path_factory):
    """A data set of two good pairs, and one that has all its files and settings that are none."""
    folder = tmp_path_factory.mktemp("set")
    datasets.freeze_plan(folder, PAIRS, "")
    for pair in PAIRS:
        write_pair(pair.folder(folder), Scene(), camera(96, 64), settings=pair.settings)
    path = PAIRS[0].folder(folder) / "pair.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"settings": {"sensor": 7}}))
    assert is_complete(PAIRS[0].folder(folder))
    return folder


@pytest.mark.usefixtures("undrawn")
def test_a_bad_pair_stops_no_other_and_is_counted(broken_set, tmp_path):
    bad = PAIRS[0].id
    report = evaluate([broken_set], parse_methods("bm"), tmp_path / "evaluation")
    assert [row["status"] for row in report["rows"]].count("failed") == 1
    assert [failure["pair"] for failure in report["failed"]] == [bad]
    failed = export([broken_set], "kitti", tmp_path / "kitti")
    assert len(failed) == 1
    assert bad in failed[0]
    assert (tmp_path / "kitti" / "pairs.csv").read_text().count("\n") == len(PAIRS)
    with pytest.raises(IcyMoonError, match=rf"1 of {len(PAIRS)} pairs failed.*{bad}"):
        reexpose([broken_set], tmp_path / "exposed", {})
    assert len(list((tmp_path / "exposed").iterdir())) == len(PAIRS) - 1
    told = {each["pair"]: each["ok"] for each in write_truth([broken_set], tmp_path / "truth")}
    assert [pair for pair, ok in told.items() if not ok] == [bad]
    found = verify_data_set(broken_set)
    assert {problem.what for problem in found.problems if "not a table" in problem.text} == {bad}
    assert write_manifest(broken_set, {})["set_aside"].keys() == {bad}
    assert estimate.estimate_plan(PAIRS, broken_set).there == len(PAIRS)
    said = []
    runner = Runner(
        broken_set, PAIRS, WorkerOptions(1, 1, "no Blender"), lambda kind, **facts: said.append((kind, facts))
    )
    assert runner.run().keys() == {bad}
    assert [facts["pair"] for kind, facts in said if kind == "error"] == [bad]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("error", [KeyError("x"), ValueError("x"), ZeroDivisionError(), MemoryError(), OSError(5, "x")])
def test_an_exception_of_any_kind_costs_one_pair_only(broken_set, tmp_path, monkeypatch, error):
    """What nobody has thought of, while a pair is developed or written."""

    def broken(pair, *arguments, **options):
        if pair.folder.name == PAIRS[1].id:
            raise error
        return original(pair, *arguments, **options)

    from icymoon.stereo import reexpose as again
    from icymoon.stereo.measure import prepare_pair

    original = stereo_develop.develop
    for module in (prepare_pair, again):
        monkeypatch.setattr(module, "develop", broken)
    report = evaluate([broken_set], parse_methods("bm"), tmp_path / "evaluation")
    assert {failure["pair"] for failure in report["failed"]} == {PAIRS[0].id, PAIRS[1].id}
    assert len(export([broken_set], "png8", tmp_path / "png8")) == 2
    with pytest.raises(IcyMoonError, match=f"2 of {len(PAIRS)}"):
        reexpose([broken_set], tmp_path / "x", {})


def test_a_pair_that_cannot_be_written_in_a_layout_stops_no_other(broken_set, tmp_path, monkeypatch):
    from icymoon.stereo.export import layouts as module

    def broken(pair, eye):
        if pair.pair.folder.name == PAIRS[1].id:
            raise IcyMoonError(f"{pair.pair.folder} shows too many instances.")
        return original(pair, eye)

    original = module._get_eye_disparity
    monkeypatch.setattr(module, "_get_eye_disparity", broken)
    assert len(export([broken_set], "pfm", tmp_path / "pfm")) == 2
    assert len(export([broken_set], "kitti", tmp_path / "kitti")) == 2


def test_errors_that_pass_are_waited_for(tmp_path, monkeypatch):
    waited: list[float] = []
    monkeypatch.setattr(system.time, "sleep", waited.append)
    path = tmp_path / "a.json"
    real = os.replace
    for number in (errno.EIO, errno.ESTALE, errno.EAGAIN, errno.ETIMEDOUT, errno.EINTR):
        fails = [OSError(number, "for now")] * 3

        def replace(source, target, fails=fails) -> None:
            if fails:
                raise fails.pop()
            real(source, target)

        monkeypatch.setattr(os, "replace", replace)
        waited.clear()
        files.write_json(path, {"number": number})
        assert json.loads(path.read_text()) == {"number": number}
        assert len(waited) == 3
        assert waited == sorted(waited)
    monkeypatch.setattr(os, "replace", lambda source, target: (_ for _ in ()).throw(OSError(errno.ESTALE, "gone")))
    waited.clear()
    with pytest.raises(IcyMoonError, match="gone"):
        files.write_json(path, {})
    assert 5 < sum(waited) < 60  # and not for ever
    waited.clear()
    monkeypatch.setattr(os, "replace", lambda source, target: (_ for _ in ()).throw(OSError(errno.ENOSPC, "full")))
    with pytest.raises(IcyMoonError, match="full"):
        files.write_json(path, {})
    assert not waited
    assert [each.name for each in tmp_path.iterdir()] == ["a.json"]


def test_a_pair_on_a_share_that_is_away_for_a_moment_is_there(tmp_path, monkeypatch):
    folder = whole(tmp_path / PAIRS[0].id)
    monkeypatch.setattr(system.time, "sleep", lambda seconds: None)
    fails = [OSError(errno.ESTALE, "stale")] * 2
    real = system.open_regular

    def open_later(path: Path) -> IO[bytes]:
        if fails:
            raise fails.pop()
        return real(path)

    monkeypatch.setattr(system, "open_regular", open_later)
    assert is_complete(folder)
    assert not fails


@pytest.mark.parametrize(
    ("shape", "good", "bad"),
    [
        (file_schemas.TEXT, ["", "é"], [1, None, "\ud800", b"x"]),
        (file_schemas.FLAG, [True], [0, 1, None]),
        (file_schemas.NUMBER, [0, -1.5, 1e300], [True, "1", float("nan"), float("inf"), 10**400, None]),
        (file_schemas.POSITIVE, [1e-300, 3], [0, -1, True]),
        (file_schemas.COUNT, [0, 7], [-1, 1.0, True, 2**70]),
        (file_schemas.FILE_NAME, ["left.exr", "a b"], ["", ".", "..", "a/b", "a\\b", "C:", "a\nb", "x ", "nul", 7]),
        (file_schemas.SHA256, ["0" * 64], ["0" * 63, "G" * 64, "A" * 64, 0]),
        (file_schemas.Maybe(file_schemas.FLAG), [True], [None]),
        (file_schemas.Maybe(file_schemas.FLAG, null=True), [None, False], [1]),
        (file_schemas.Each(file_schemas.FLAG), [[], [True]], [{}, [1], None]),
        (
            file_schemas.Each(file_schemas.FLAG, file_schemas.FILE_NAME, ("a",)),
            [{"a": True}],
            [{}, {"a": 1}, {"a": True, "../b": True}, []],
        ),
        (
            {"a": file_schemas.FLAG, "b": file_schemas.Maybe(file_schemas.TEXT)},
            [{"a": True}, {"a": False, "b": "", "c": 1}],
            [{}, {"a": True, "b": 1}, [], None],
        ),
    ],
)
def test_shapes(shape, good, bad):
    assert [value for value in good if file_schemas.find_fault(value, shape)] == []
    assert [value for value in bad if not file_schemas.find_fault(value, shape)] == []


def test_a_fault_names_the_file_the_key_what_is_expected_and_the_fix():
    shape = {"files": file_schemas.Each({"bytes": file_schemas.COUNT}, file_schemas.FILE_NAME)}
    with pytest.raises(IcyMoonError) as caught:
        file_schemas.check_record({"files": {"left.exr": {"bytes": "x"}}}, shape, "a/pair.json", "fix it")
    assert str(caught.value) == ("a/pair.json: files.left.exr.bytes is 'x', not a whole number of 0 or more; fix it.")


def test_temporary_folders_of_killed_processes_are_swept_and_no_others(tmp_path, monkeypatch):
    from icymoon.support import temporary_folders

    monkeypatch.setattr(temporary_folders.tempfile, "tempdir", str(tmp_path))
    with temporary_folders.open_scratch_folder() as mine:
        assert mine.parent == tmp_path
    assert not mine.exists()
    owner = {"pid": os.getpid(), "place": system.find_process_scope(), "computer": system.find_computer_name()}
    dead = owner | {"pid": 2**22 + 7}  # more than Linux ever gives
    cases = {
        "living": (owner, True),
        "dead": (dead, False),
        "rebooted": (dead | {"place": "boot pid:[1]"}, False),
        "elsewhere": (dead | {"computer": "x", "place": "y z"}, True),
        "odd": ({"pid": "x"}, True),
        "none": (None, True),
    }
    for name, (said, _) in cases.items():
        folder = tmp_path / f"icymoon-{name}"
        folder.mkdir()
        (folder / "content").touch()
        if said is not None:
            (folder / ".icymoon.json").write_text(json.dumps(said))
    victim = tmp_path / "victim"
    shutil.copytree(tmp_path / "icymoon-dead", victim)
    (tmp_path / "icymoon-link").symlink_to(victim)
    temporary_folders._remove_abandoned.cache_clear()
    with temporary_folders.open_scratch_folder():
        there = {path.name for path in tmp_path.iterdir()}
        assert {name for name, (_, kept) in cases.items() if kept} == {
            name.removeprefix("icymoon-") for name in there if name.removeprefix("icymoon-") in cases
        }
    assert (victim / "content").exists()
    assert (tmp_path / "icymoon-link").is_symlink()


def test_numbers_of_a_table_are_those_of_its_lines(tmp_path):
    for text in ("a,b,c\n1,x,2\n\n 3 ,, 4e1 \n", "\ufeffa,b,c\r\n1,\xe9,2\r\n\r\n3,,40\r\n", "a,b,c\r1,,2\r\r3,,40"):
        (tmp_path / "a.csv").write_bytes(text.encode())
        assert file_schemas.read_number_lines(tmp_path / "a.csv", ("c", "a"), "rocks.file") == [
            (2, [2.0, 1.0]),
            (4, [40.0, 3.0]),
        ]


@pytest.mark.parametrize("line", ["1", "", ",", "x,1", "1,x", "1_0,1", "'1',1", "1,\x1b[31m", "0x1,1", "1,-"])
def test_a_line_without_numbers_is_none(tmp_path, line):
    (tmp_path / "a.csv").write_text(f"a,b\n1,2\n{line}\n", encoding="utf-8")
    found = file_schemas.read_number_lines(tmp_path / "a.csv", ("a", "b"), "rocks.file")
    assert found == [(2, [1.0, 2.0]), *([(3, None)] if line else [])]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\n",
        b"a",
        b"b,c\n1,2",
        b"a;b\n1;2",
        b"\0" * 10**6,
        b"," * 10**6,
        b"a,b\n" + b"1" * 70_000,
        pytest.param(b"a,b\n" + b"1,1\n" * 1_300_000, marks=pytest.mark.heavy),
        b"a" * 10**6,
        b"\x80,a,b\n",
        b"A,B\n1,2",
        b'"a","b"\n1,2',
        b"a,b" + b"x" * 70_000 + b"\n",
    ],
    ids=range(14),
)
@pytest.mark.timeout(20)
def test_a_table_that_is_none_is_a_sentence(tmp_path, content):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(IcyMoonError) as caught:
        file_schemas.read_number_lines(tmp_path / "a.csv", ("a", "b"), "rocks.file")
    assert str(caught.value).startswith(f"{tmp_path / 'a.csv'}")


def test_a_table_that_is_no_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "absent"):
        with pytest.raises(IcyMoonError, match=r"cannot be read.*check rocks\.file"):
            file_schemas.read_number_lines(path, ("a",), "rocks.file")


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (True, "true"),
        (None, "null"),
        (3, "3"),
        (2.5, "2.5"),
        (10**5000, "a whole number of 5001 digits"),
        ("a", "'a'"),
        ("x" * 100, "'" + "x" * 59 + "…"),
        ({"a": 1}, "a table"),
        ([1, "a", False], "[1, 'a', false]"),
        ([[1]], "a list of 1"),
        (list(range(9)), "a list of 9"),
        (datetime.date(1979, 5, 27), "1979-05-27"),
        (datetime.time(7, 32), "07:32:00"),
        (datetime.datetime(1979, 5, 27, 7, 32, tzinfo=datetime.UTC), "1979-05-27T07:32:00+00:00"),
    ],
    ids=range(14),
)
def test_a_value_is_quoted_plainly(value, shown):
    assert quote(value) == shown


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"a,b\n1,2\n1,\0002\n", "has a byte 0 in line 3"),
        (b"a,\0b\n1,2\n", "has a byte 0 in line 1"),
        (b"a,c\n1,2\n1,\xff\n" * 10, "has no column b, but the first line 'a,c'."),
        (b"a," + b"," * 60000 + b"\n", "has no column b, but the first line"),
        (b"a,b,c\n1,2,\0\n", "has a byte 0 in line 2"),
    ],
)
def test_a_fault_of_a_table_is_named_with_its_line(tmp_path, data, text):
    (tmp_path / "a.csv").write_bytes(data)
    with pytest.raises(IcyMoonError) as caught:
        file_schemas.read_number_lines(tmp_path / "a.csv", ("a", "b"), "rocks.file")
    assert text in str(caught.value)
    assert len(str(caught.value)) < 300

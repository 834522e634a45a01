"""In an output folder or current folder with any content, nothing is run and nothing is lost."""

from __future__ import annotations

import json
import os
import stat
import sys
from pathlib import Path

import matplotlib
import pairs
import pytest
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError


@pytest.fixture
def dataset(tmp_path):
    pairs.write_pair(tmp_path / "set" / "pairs" / "a", rig=pairs.camera(96, 48))
    return tmp_path / "set"


def link(path: Path, target: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        path.symlink_to(target, target_is_directory=target.is_dir())
    except OSError:
        pytest.skip("this system lets nobody make links")


@pytest.mark.parametrize("name", ["results.jsonl", "pairs", "pairs/a"])
def test_an_evaluation_writes_through_no_link_that_a_data_set_brought(dataset, tmp_path, name):
    """A row appended to a start-up file of a shell would be run, and its last line cut."""
    victim = tmp_path / "home"
    (victim / "a").mkdir(parents=True)
    for file in (victim / ".bashrc", victim / "left.png", victim / "a" / "left.png"):
        file.write_text("work, and no end of line")
    link(dataset / "evaluation" / name, victim / ".bashrc" if name == "results.jsonl" else victim)
    with pytest.raises(IcyMoonError, match="is a link"):
        evaluate([dataset], parse_methods("bm"), dataset / "evaluation")
    assert {path.name for path in victim.rglob("*")} == {".bashrc", "left.png", "a"}
    assert all(path.read_text() == "work, and no end of line" for path in victim.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", ["results.jsonl", "results.csv", "report.json", "summary.json", "report.html"])
def test_results_of_other_programs_stay(dataset, tmp_path, name):
    """These are names that many programs give."""
    out = tmp_path / "experiments"
    out.mkdir()
    (out / name).write_text('{"loss": 0.1}\n{"loss": 0.2}')
    with pytest.raises(IcyMoonError, match="not written by an evaluation"):
        evaluate([dataset], parse_methods("bm"), out)
    assert [path.name for path in out.iterdir()] == [name]
    assert (out / name).read_text() == '{"loss": 0.1}\n{"loss": 0.2}'


@pytest.mark.parametrize("name", ["results.jsonl", "report.json"])
def test_a_pipe_in_place_of_results_holds_nothing_up(dataset, tmp_path, name):
    out = tmp_path / "experiments"
    out.mkdir()
    os.mkfifo(out / name)
    with pytest.raises(IcyMoonError, match=name):
        evaluate([dataset], parse_methods("bm"), out)


@pytest.mark.usefixtures("undrawn")
def test_a_first_row_that_was_cut_off_is_ours(dataset, tmp_path):
    (tmp_path / "results.jsonl").write_text('{"pair": "a", "meth')
    assert len(evaluate([dataset], parse_methods("bm"), tmp_path)["rows"]) == 1


def test_pictures_of_an_evaluation_do_not_get_into_pairs(dataset):
    with pytest.raises(IcyMoonError, match="is a data set"):
        evaluate([dataset], parse_methods("bm"), dataset)
    assert sorted(path.name for path in dataset.rglob("*")) == ["a", "left.exr", "pair.json", "pairs", "right.exr"]


@pytest.mark.skipif(sys.platform == "win32", reason="a program for the test is a shell script")
def test_a_matplotlibrc_starts_no_program(dataset, tmp_path, monkeypatch):
    """Matplotlib reads that file in the current folder, and one of its settings is to start LaTeX."""
    for name in ("latex", "dvipng"):
        program = tmp_path / "bin" / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(f"#!/bin/sh\ntouch {tmp_path}/ran\nexit 1\n")
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setitem(matplotlib.rcParams, "text.usetex", True)  # as it is after an import there
    evaluate([dataset], parse_methods("bm"), tmp_path / "out")
    assert not (tmp_path / "ran").exists()


@pytest.mark.long
def test_a_text_of_a_data_set_is_no_formula_of_a_chart(tmp_path):
    """Matplotlib takes what stands between two dollars for one, and ends at what is none."""
    for name, body in (("a", "EUROPA"), ("b", "$\\frac{$")):
        pair = pairs.write_pair(tmp_path / "set" / "pairs" / name, rig=pairs.camera(96, 48))
        data = json.loads((pair / "pair.json").read_text(encoding="utf-8"))
        data["settings"]["light"]["body"] = body
        (pair / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    evaluate([tmp_path / "set"], parse_methods("bm"), tmp_path / "out")
    assert "$\\frac{$" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")

"""The verb ``design`` with stand-ins for grounds: its files, a start after a kill, and wrong words."""

from __future__ import annotations

import csv
import json
from typing import Any

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.stereo.cli import main as stereo_main
from icymoon.stereo.design import measure_suites as study_of
from icymoon.stereo.design.read_design import find_design
from icymoon.stereo.design.report import FIRST_BYTES
from icymoon.support.errors import IcyMoonError

#: Share of unsafe choices of each suite.
UNSAFE = {"base": 0.2, "short": 0.0, "wide": 0.2, "fine": 0.2, "bm": 0.9, "jplv": 0.1}


@pytest.fixture
def made(monkeypatch):
    """Grounds without rays; the list has the (ground, suite) that were measured, and may hold a number after which the
    run is stopped."""
    made: dict[str, Any] = {"rows": [], "most": 10**9}

    def measure(self, suite):
        if len(made["rows"]) == made["most"]:
            raise KeyboardInterrupt
        made["rows"].append((self._recipe.number, suite.name))
        random = np.random.default_rng([self._recipe.number, self._recipe.split == "landform", *suite.name.encode()])
        unsafe = float(random.random() < UNSAFE.get(suite.name, 0.3))
        return {
            "unsafe_choice": unsafe,
            "dangerous_choice": 0.0,
            "no_site": 0.0,
            "fails": "slope" if unsafe else None,
            "cells": [100, 40, 20, 10],
            "cpu_s": 0.1 + random.random() / 100,
            "exposure_s": 0.01,
            **({"lamp_s": 0.002} if suite.lamp else {}),
            "frames": suite.suns,
            "points": 100 if suite.method.lidar else 0,
        }

    monkeypatch.setattr(study_of, "build_ground", lambda recipe: None)
    monkeypatch.setattr(study_of, "release_ground", lambda ground: None)
    monkeypatch.setattr(study_of._OpenGround, "measure", measure)
    return made


def run(folder, *words):
    return stereo_main(["design", "--out", str(folder), "--grounds", "20", "--landforms", "20", *words])


@pytest.mark.left_to_ci
def test_a_stopped_run_goes_on_to_the_files_of_a_whole_one(made, tmp_path, capsys):
    assert run(tmp_path / "whole") == 0
    printed = capsys.readouterr().out
    assert "lidar_1000" in printed
    assert "Kendall's tau-b" in printed
    assert len(made["rows"]) == 40 * 11
    made |= {"rows": [], "most": 57}
    assert run(tmp_path / "parts") == 130
    with (tmp_path / "parts" / "design.jsonl").open("a", encoding="utf-8") as stream:
        stream.write('{"pair": "half a r')  # a kill while a row is written
    made["most"] = 10**9
    assert run(tmp_path / "parts") == 0
    assert len(made["rows"]) == 40 * 11  # none was made twice
    for name in ("design.jsonl", "design.csv"):
        assert (tmp_path / "parts" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    one, other = (json.loads((tmp_path / name / "design.json").read_text()) for name in ("whole", "parts"))
    one["provenance"].pop("created")
    other["provenance"].pop("created")
    assert one == other
    for name, begin in FIRST_BYTES.items():
        assert (tmp_path / "whole" / name).read_bytes().startswith(begin)


@pytest.mark.left_to_ci
def test_the_files_state_the_same_numbers(made, tmp_path, capsys):
    assert run(tmp_path / "out", "--json-lines") == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["type"] == "result"
    report = json.loads((tmp_path / "out" / "design.json").read_text())
    assert last["suites"] == report["suites"]
    with (tmp_path / "out" / "design.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 440
    for entry in report["suites"]:
        own = [row for row in rows if row["suite"] == entry["suite"] and row["landform"] == "0"]
        assert entry["unsafe"] == sum(row["unsafe"] == "1" for row in own)
        assert entry["risk"]["mean"] == pytest.approx(np.mean([float(row["loss"]) for row in own]))
        energy = [sum(float(row[part]) for part in ("camera_j", "processor_j", "lidar_j", "lamp_j")) for row in own]
        assert entry["energy_j"]["mean"] == pytest.approx(np.mean(energy), rel=1e-5)
        assert len(own) == 20
    assert len(report["differences"]) == 55
    assert {entry["suite"] for entry in report["suites"] if entry["place"] == "beaten"} <= {"bm"}
    page = (tmp_path / "out" / "design.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2
    assert all(entry["suite"] in page for entry in report["suites"])
    assert all(sentence in page.replace("&#39;", "'") for sentence in (*report["head"], *report["notes"]))
    assert "a lamp of 20 W" in page
    assert "Waiting for another Sun or for the night" in page
    assert all(source.replace("'", "&#39;") in page for source in report["sources"].values() if "Ouster" in source)


def test_a_study_in_which_all_fails_still_has_a_report(made, tmp_path, capsys, monkeypatch):
    def fail(self, suite):
        raise IcyMoonError("no light; turn it on.")

    monkeypatch.setattr(study_of._OpenGround, "measure", fail)
    assert run(tmp_path) == 1
    assert (
        "440 of the decisions failed, the first one: no light; turn it on." in capsys.readouterr().err.splitlines()[-1]
    )
    report = json.loads((tmp_path / "design.json").read_text())
    assert (report["suites"], report["ranking"], len(report["failed"])) == ([], None, 440)
    assert "40 grounds on which a suite failed count nowhere." in report["notes"]
    assert "440 failed" in (tmp_path / "design.html").read_text(encoding="utf-8")


def fail_wide(monkeypatch, fails):
    """Let the suite ``wide`` fail on the grounds for which ``fails`` of their place among all is true."""
    measure = study_of._OpenGround.measure
    places: dict[tuple[str, int], int] = {}

    def measure_or_fail(self, suite):
        place = places.setdefault((self._recipe.split, self._recipe.number), len(places))
        if suite.name == "wide" and fails(place):
            raise IcyMoonError("no light; turn it on.")
        return measure(self, suite)

    monkeypatch.setattr(study_of._OpenGround, "measure", measure_or_fail)


@pytest.mark.filterwarnings("error")
@pytest.mark.left_to_ci
@pytest.mark.parametrize("left", [1, 3])
def test_a_study_of_few_grounds_without_a_failure_has_a_page(made, tmp_path, capsys, monkeypatch, left):
    fail_wide(monkeypatch, lambda place: left <= place < 20)
    assert run(tmp_path) == 1
    report = json.loads((tmp_path / "design.json").read_text())
    assert (report["grounds"], report["landforms"]) == (left, 20)
    for entry in report["suites"]:
        assert (entry["risk"]["interval"] == [None, None]) == (left == 1)
        assert entry["energy_j"]["interval"] == [None, None]
    page = (tmp_path / "design.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2
    assert "None" not in page
    assert "nan" not in page.replace("dominant", "")


@pytest.fixture
def write_suites(tmp_path):
    """Write the shipped design with these suites alone, and return its path."""

    def write(*names):
        text = find_design("suites").read_text(encoding="utf-8")
        head, *suites = text.split("[[suite]]")
        suites[-1], sources = suites[-1].split("[sources]")
        own = [each for each in suites if any(f'name = "{name}"' in each for name in names)]
        path = tmp_path / "mine.toml"
        path.write_text("[[suite]]".join([head, *own]) + "\n[sources]" + sources, encoding="utf-8")
        return path

    return write


@pytest.mark.left_to_ci
def test_one_suite_is_compared_with_nothing(made, write_suites, tmp_path, capsys):
    assert run(tmp_path / "out", str(write_suites("base"))) == 0
    report = json.loads((tmp_path / "out" / "design.json").read_text())
    assert [entry["suite"] for entry in report["suites"]] == ["base"]
    assert len(report["head"]) == 1
    assert report["head"][0].startswith("On 20 grounds, base has a risk of ")
    assert report["ranking"] is None


@pytest.mark.left_to_ci
def test_the_page_claims_of_differences_what_its_numbers_show(made, write_suites, tmp_path, capsys):
    """The bounds of a difference hold together with those of all others, so they may be wider than both bars."""
    assert run(tmp_path / "out", str(write_suites("base", "wide", "fine"))) == 0
    report = json.loads((tmp_path / "out" / "design.json").read_text())
    width = {entry["suite"]: np.diff(entry["risk"]["interval"])[0] for entry in report["suites"]}
    wider = [
        entry
        for entry in report["differences"]
        if np.diff(entry["risk"]) > width[entry["suite"]] + width[entry["other"]]
    ]
    page = (tmp_path / "out" / "design.html").read_text(encoding="utf-8")
    assert wider
    assert "differences are narrower" not in page
    assert page.count("95 %: ") == 2  # of the least risk and of tau
    assert "1 310 720" in page


@pytest.mark.parametrize("start", [main, stereo_main])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--grounds", "19"],
            "--grounds is 19, and intervals of risk, energy and time need 20 grounds; give 20 or more",
        ),
        (["--landforms", "0"], "--landforms is 0, and"),
        (["--seed", "-1"], "--seed is -1; give 0 or more"),
        (["suits"], "no design 'suits', did you mean 'suites'"),
        (["absent.toml"], "absent.toml: cannot be read"),
    ],
)
def test_wrong_words_are_one_sentence(start, words, said, tmp_path, capsys):
    assert start(["design", *words, "--out", str(tmp_path / "out")]) == 1
    found = capsys.readouterr().err
    assert said in found
    assert len(found.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_files_of_another_program_are_kept(tmp_path, capsys):
    (tmp_path / "design.csv").write_text("a,b\n")
    assert run(tmp_path) == 1
    assert "design.csv was not written by an evaluation" in capsys.readouterr().err
    assert (tmp_path / "design.csv").read_text() == "a,b\n"

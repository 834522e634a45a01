"""What `make` runs for the tests, by stand-ins for the programs."""

import os
import re
import shutil
import subprocess

import lanes
import pytest
from icymoon.support.version import ROOT
from processor_time import APART

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")


def run(folder, target, tests="true", types="true", style="true"):
    """Exit status and output of a target where pytest, mypy and ruff end with these commands."""
    folder.mkdir(exist_ok=True)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (folder / "Makefile").write_text(makefile, encoding="utf-8")
    programs = folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    (folder / "pyproject.toml").touch()
    (folder / ".types").mkdir()
    (folder / ".types" / "icymoon").touch()
    # pytest waits for the checker to have begun, for 5 s at most: a checker that begins after it is then told too late.
    waits = f"for _ in $(seq 500); do [ -e {folder}/begun ] && break; sleep 0.01; done; "
    waits += f"[ -e {folder}/begun ] || echo unchecked; "
    for name, what in {
        "python": f'{waits if target.startswith("test") else ""}echo "tests $* [$PYTHONDONTWRITEBYTECODE]"; {tests}',
        "mypy": f"touch {folder}/begun; echo types; {types}",
        "ruff": f'echo "style $1"; {style}',
    }.items():
        (programs / name).write_text(f"#!/bin/sh\n{what}\n")
        (programs / name).chmod(0o755)
    for made in (".demo", ".tests"):
        (folder / ".venv" / made).touch()
    # Variables given to the make that runs these tests, such as CI's TYPE_CHECK=true, would reach this one too.
    given = {"MAKEFLAGS", "MAKELEVEL", "MAKEOVERRIDES", *re.findall(r"^(\w+) \?=", makefile, re.MULTILINE)}
    environment = {name: value for name, value in os.environ.items() if name not in given}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    done = subprocess.run(
        ["make", target], cwd=folder, env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stdout


@pytest.mark.parametrize("target", ["test", "test-ci", "test-all"])
def test_types_are_checked_beside_the_tests_and_told_after_them(tmp_path, target):
    status, said = run(tmp_path, target)
    assert status == 0
    assert said.index("style format") < said.index("tests -m pytest") < said.index("\ntypes\n")
    assert said.count("\ntypes\n") == 1
    assert "unchecked" not in said


def test_the_variables_of_the_make_that_runs_the_tests_do_not_reach_these(tmp_path, monkeypatch):
    """CI runs ``make test-ci TYPE_CHECK=true``, which make hands to whatever it starts."""
    monkeypatch.setenv("TYPE_CHECK", "true")
    monkeypatch.setenv("MAKEFLAGS", " -- TYPE_CHECK=true")
    assert "\ntypes\n" in run(tmp_path, "test")[1]


@pytest.mark.parametrize(("tests", "types"), [("false", "true"), ("true", "false"), ("false", "false")])
def test_a_fault_in_either_fails_the_target(tmp_path, tests, types):
    status, said = run(tmp_path, "test", tests=tests, types=types)
    assert status != 0
    assert "tests -m pytest" in said
    assert "\ntypes\n" in said


def test_a_fault_of_style_is_told_before_any_test(tmp_path):
    status, said = run(tmp_path, "test", style="false")
    assert status != 0
    assert "tests" not in said


def test_what_takes_long_is_left_out(tmp_path):
    """A mark does not tell the other ones: what is ``long`` need not be ``slow`` or ``heavy``."""
    apart = {f"not {mark}" for mark in APART}
    _, said = run(tmp_path, "test")
    assert set(re.search(r" -m (not .*) \[", said)[1].split(" and ")) == apart | {"not left_to_ci"}
    assert set(lanes.PYTEST[lanes.PYTEST.index("-m", 2) + 1].split(" and ")) == apart
    assert "$(QUICK)" in (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ntest-ends:")[2]


def test_programs_keep_what_they_compile(tmp_path):
    assert "[]" in run(tmp_path, "test")[1]


@pytest.mark.parametrize("fault", ["types", "style"])
def test_the_linter_checks_style_and_types(tmp_path, fault):
    assert run(tmp_path / "whole", "lint")[0] == 0
    assert run(tmp_path / "broken", "lint", **{fault: "false"})[0] != 0

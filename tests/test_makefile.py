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
    shutil.copy(ROOT / "Makefile", folder)
    programs = folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    (folder / "pyproject.toml").touch()
    (folder / ".types").mkdir()
    (folder / ".types" / "icymoon").touch()
    # pytest waits for the checker to have begun, as it would for ever if that began after it.
    waits = f"while [ ! -e {folder}/begun ]; do sleep 0.01; done; " if target.startswith("test") else ""
    for name, what in {
        "python": f'{waits}echo "tests $* [$PYTHONDONTWRITEBYTECODE]"; {tests}',
        "mypy": f"touch {folder}/begun; echo types; {types}",
        "ruff": f'echo "style $1"; {style}',
    }.items():
        (programs / name).write_text(f"#!/bin/sh\n{what}\n")
        (programs / name).chmod(0o755)
    for made in (".demo", ".tests"):
        (folder / ".venv" / made).touch()
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"} | dict.fromkeys(("MAKEFLAGS", "MAKELEVEL"), "")
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

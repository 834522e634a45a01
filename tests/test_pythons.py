"""The first command in a Python that cannot do it is one sentence that says what to do."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib

import pytest
from icymoon import __main__ as program
from icymoon.stereo.environment import packages
from icymoon.support.version import ROOT
from packaging.requirements import Requirement

MAIN = str(ROOT / "__main__.py")


def run(*command):
    return subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("verb", ["--version", "render", "stereo", "probe"])
def test_a_python_that_is_too_old_is_told(verb):
    code = (
        f"import runpy, sys; sys.version_info = (3, 10, 0, 'final', 0); sys.version = '3.10.0 (main)'; "
        f"sys.argv = [{MAIN!r}, {verb!r}]; runpy.run_path({MAIN!r}, run_name='__main__')"
    )
    done = run("-c", code)
    assert done.returncode == 1
    assert done.stderr == "icymoon: needs Python 3.11 or later, this is 3.10.0; run it with a later one.\n"


def test_a_python_without_what_icymoon_needs_is_told():
    done = run("-I", "-S", MAIN, "presets")  # which sees no package that is installed
    assert done.returncode == 1
    assert re.fullmatch(r"icymoon: .* lacks (numpy|rich); run make, .* -m pip install \.\n", done.stderr)


@pytest.mark.parametrize(
    ("version", "said"),
    [
        ((3, 11), 'pip install "icymoon[blender]".'),
        ((3, 12), "is Python 3.12, which has no Blender as a module"),
        ((3, 13), 'pip install "icymoon[blender]".'),
        ((3, 14), "is Python 3.14, which has no Blender as a module"),
    ],
)
def test_a_python_for_which_there_is_no_blender_is_not_told_to_install_one(version, said, monkeypatch):
    monkeypatch.setattr(sys, "version_info", (*version, 0, "final", 0))
    assert said in program.explain_missing_blender()
    assert "--blender" in program.explain_missing_blender()


def test_the_pythons_with_a_blender_are_those_of_the_package_and_of_make():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    blender = " ".join(project["optional-dependencies"]["blender"])
    assert {tuple(map(int, found.split("."))) for found in re.findall(r"python_version == '([\d.]+)'", blender)} == set(
        program._WITH_BLENDER
    )
    for python in ("3.10", "3.11", "3.12", "3.13", "3.14"):
        asked = [
            str(need.specifier)
            for need in map(Requirement, project["optional-dependencies"]["blender"])
            if need.marker is not None and need.marker.evaluate({"python_version": python})
        ]
        assert len(asked) == 1, python
        # A local version, after the +, is one that nobody can publish.
        assert (asked == ["==0+needs.python.3.11.or.3.13"]) == (python not in ("3.11", "3.13"))
    assert project["requires-python"] == ">=" + ".".join(map(str, program._LEAST))
    make = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert f"not in {list(program._WITH_BLENDER)}" in make


@pytest.mark.parametrize(("end", "first"), [("lowest", True), ("newest", False)])
def test_the_constraints_are_the_ends_of_what_is_taken(end, first):
    """The lowest ones are the first that each bound of the package and of the evaluator's check lets in."""
    lines = (ROOT / "constraints" / f"{end}.txt").read_text(encoding="utf-8").splitlines()
    pinned = {need.name.lower(): next(iter(need.specifier)).version for need in map(Requirement, lines[1:])}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    bounds = [Requirement(text) for text in (*project["dependencies"], *project["optional-dependencies"]["evaluate"])]
    assert set(pinned) == {need.name.lower() for need in bounds}
    for name, oldest, _ in packages.PACKAGES.values():
        numbers = tuple(map(int, pinned[name.lower()].split(".")[:2]))
        assert numbers == oldest if first else numbers >= oldest, name
    assert all(pinned[need.name.lower()] in need.specifier for need in bounds)

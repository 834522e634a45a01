"""``.ci/run`` from a clone with nothing beside it, and with a real Blender to install; programs are stand-ins."""

import os
import shutil
import subprocess

import pytest
from icymoon.support.version import ROOT

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")


def run(folder, fails="nothing", beside=False):
    """Exit status and output of ``.ci/run`` in a clone that has nothing else; the target ``fails`` of make fails."""
    clone, programs = folder / "clone", folder / "programs"
    programs.mkdir(parents=True)
    (clone / ".ci").mkdir(parents=True)
    shutil.copy(ROOT / ".ci" / "run", clone / ".ci" / "run")
    scripts = {
        programs / "make": f'echo "make $*"; echo "== 3 passed in 1 s =="; [ "$1" != {fails} ]',
        programs / "dpkg": "true",
        programs / "apt-get": "true",
        clone / ".venv" / "bin" / "python": 'echo "python $*"',
    }
    if beside:
        scripts[folder / "shared" / "blender" / "install"] = "true"
    for path, text in scripts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)
    environment = {key: value for key, value in os.environ.items() if key != "ICYMOON_BLENDER"}
    environment["PATH"] = f"{programs}{os.pathsep}{environment['PATH']}"
    done = subprocess.run(
        [clone / ".ci" / "run"], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stdout


def test_it_passes_with_nothing_beside_the_clone_and_says_what_it_left_out(tmp_path):
    status, said = run(tmp_path)
    assert status == 0
    assert "make env zip" in said
    assert "make test-ci TYPE_CHECK=true" in said
    assert "make lint" in said  # with the types that the tests leave out
    assert "SKIPPED: no Blender is named by ICYMOON_BLENDER" in said
    assert said.endswith("== 3 passed in 1 s ==\n")


def test_it_tries_the_zip_in_a_blender_that_can_be_installed(tmp_path):
    status, said = run(tmp_path, beside=True)
    assert status == 0
    assert "python tests/lanes.py real-4.3" in said
    assert "python tests/lanes.py first-4.3" in said
    assert "SKIPPED" not in said


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize("target", ["test-ci", "lint"])
def test_it_fails_where_a_test_or_a_type_fails(tmp_path, target, beside):
    assert run(tmp_path, fails=target, beside=beside)[0] != 0


def test_what_failed_is_run_again_with_values_in_its_assertions(tmp_path):
    again = "python -m pytest -q --last-failed"
    assert again in run(tmp_path / "failed", fails="test-ci")[1]
    assert again not in run(tmp_path / "passed")[1]

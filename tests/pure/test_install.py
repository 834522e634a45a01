"""Making the evaluator's environment: whole, or not there."""

from __future__ import annotations

import json
import subprocess
from types import SimpleNamespace

import pytest
from icymoon import install


@pytest.fixture
def python(monkeypatch):
    """Stands for the programs that are run: what each is to do, in order."""
    acts = []
    monkeypatch.setattr(subprocess, "run", lambda command, **_: acts.pop(0)(command))
    return acts


def makes(command):
    folder = install.Path(command[-1])
    folder.mkdir(exist_ok=True)
    (folder / "python").touch()
    return SimpleNamespace(returncode=0, stdout="", stderr="")


def fails(command):
    return SimpleNamespace(returncode=1, stdout="", stderr="WARNING: retrying\nERROR: no route to host\n")


def works(command):
    return SimpleNamespace(returncode=0, stdout="", stderr="")


def stopped(command):
    raise KeyboardInterrupt


def test_it_says_how_far_it_is_and_that_it_is_done(python, tmp_path, capsys):
    python += [makes, works]
    assert install.main([str(tmp_path / "evaluator")]) == 0
    said = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [message["type"] for message in said] == ["progress", "progress", "progress", "done"]
    assert (tmp_path / "evaluator" / "python").is_file()


def test_a_failure_is_told_and_leaves_no_half_of_an_environment(python, tmp_path, capsys):
    python += [makes, fails]
    assert install.main([str(tmp_path / "evaluator")]) == 1
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert said["type"] == "error"
    assert "no route to host; check network and disk" in said["message"]
    assert not (tmp_path / "evaluator").exists()


def test_neither_does_a_stop(python, tmp_path):
    python += [makes, stopped]
    with pytest.raises(KeyboardInterrupt):
        install.main([str(tmp_path / "evaluator")])
    assert not (tmp_path / "evaluator").exists()


def test_an_environment_that_was_there_stays(python, tmp_path):
    (tmp_path / "evaluator").mkdir()
    python += [makes, fails]
    assert install.main([str(tmp_path / "evaluator")]) == 1
    assert (tmp_path / "evaluator" / "python").is_file()

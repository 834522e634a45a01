"""The maps that ``batch`` asks its evaluator for."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest
from icymoon.commands import batch
from icymoon.support.errors import IcyMoonError


def _parse(*words):
    parser = argparse.ArgumentParser()
    batch.add_batch_options(parser)
    return parser.parse_args(["plan.toml", "--out", "set", *words])


@pytest.mark.parametrize(
    ("words", "wanted"), [([], []), (["--maps"], ["--maps", "0.0"]), (["--maps", "0.2"], ["--maps", "0.2"])]
)
def test_maps_are_asked_for_while_pairs_are_rendered_and_afterwards(words, wanted):
    options = _parse("--evaluate", "bm", *words)
    for more in ("--follow", "--json-lines"):
        command, _ = batch._make_evaluation_command(Path("set"), options, more)
        start = command.index("--maps") if "--maps" in command else len(command)
        assert command[start : start + 2] == wanted
        assert more in command


@pytest.mark.parametrize(
    ("words", "told"), [(["--maps"], "add --evaluate"), (["--evaluate", "bm", "--maps", "-1"], "--maps is -1")]
)
def test_maps_of_nothing_are_refused_before_a_render(words, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(IcyMoonError, match=told):
        batch._run_batch(_parse(*words))
    assert not list(tmp_path.iterdir())

"""The verb verify, where something is wrong: it prints what, also as JSON lines, and ends with status 1."""

from __future__ import annotations

import json

import pytest
from icymoon.commands.cli import main
from icymoon.render.plans.frozen_plan import freeze_plan
from plans import grid

#: A name that clears the screen, sets the title and is markup.
HOSTILE = "q\x1b[2J\x1b]0;x\x07[b]"


@pytest.fixture
def dataset(tmp_path):
    """A planned data set: one pair is broken, one is missing, and there is a foreign file of a hostile name."""
    folder = tmp_path / HOSTILE
    pairs = grid(1, (20.0,))
    freeze_plan(folder, pairs, "")
    (folder / "pairs" / pairs[0].id).mkdir(parents=True)
    (folder / HOSTILE).write_text("mine")
    return folder


@pytest.mark.parametrize("more", [[], ["--remove"]])
def test_problems_are_told_as_json_lines(dataset, capsys, more):
    assert main(["verify", str(dataset), "--json", *more]) == 1
    said = capsys.readouterr()
    messages = [json.loads(line) for line in said.out.splitlines()]
    assert {message["type"] for message in messages} == {"problem", "result"}
    assert {"broken", "missing"} <= {message["kind"] for message in messages[:-1]}
    assert messages[-1]["problems"] == len(messages) - 1
    assert "\x1b" not in said.out + said.err
    assert len(said.err.splitlines()) == 1


def test_what_would_steer_a_terminal_is_shown(dataset, capsys):
    assert main(["verify", str(dataset)]) == 1
    said = capsys.readouterr()
    assert r"q\x1b[2J\x1b]0;x\x07[b]" in said.out
    assert "\x1b" not in said.out + said.err

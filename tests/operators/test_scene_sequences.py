"""Forty sequences of actions on scenes, files and undo, those that need no window; ``tests/gui`` runs all in one."""

from __future__ import annotations

import importlib
from pathlib import Path

import icymoon
import pytest
from icymoon.operators import live_preview
from scene_sequences import QUICK, SEQUENCES, TABLE, WINDOW, Runner, Sequence


def test_the_table_has_forty_sequences_with_names_of_their_own():
    assert len({sequence.name for sequence in SEQUENCES}) == len(SEQUENCES) == 40


def test_the_manual_has_the_table():
    manual = Path(icymoon.__file__).parent / "docs" / "extend.md"
    assert f"```text{TABLE}```" in manual.read_text(encoding="utf-8")


@pytest.mark.ci_takes(5)
@pytest.mark.parametrize(
    "sequence",
    [
        pytest.param(each, id=each.name, marks=() if each.needs == QUICK else pytest.mark.long)
        for each in SEQUENCES
        if each.needs != WINDOW
    ],
)
def test_sequence(sequence: Sequence, scene, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    runner = Runner(lambda name: importlib.import_module(f"icymoon.{name}"), tmp_path)
    for _ in runner.run(sequence):
        pass
    printed = capfd.readouterr()
    assert "Traceback" not in printed.out + printed.err

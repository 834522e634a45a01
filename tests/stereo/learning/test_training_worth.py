"""The study of what training data are worth: its rows."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")
from icymoon.benchmarks.stereo.training_worth import EVERYTHING, NARROWED, list_trainings
from icymoon.support.errors import IcyMoonError


def test_each_data_set_is_a_row_with_a_training_for_each_seed(tmp_path):
    found = list_trainings(2, [tmp_path / "a", tmp_path / "b"])
    assert [(each.name, each.seed, each.data) for each in found] == [
        (EVERYTHING, 0, None),
        (EVERYTHING, 1, None),
        *((name, seed, tmp_path / name) for name in ("a", "b") for seed in (0, 1)),
    ]
    assert list_trainings(1, [])[1:] == list(NARROWED)


def test_two_data_sets_of_one_name_are_refused(tmp_path, monkeypatch):
    (tmp_path / "x" / "out").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "x" / "out")
    with pytest.raises(IcyMoonError, match="two folders named 'out'; rename one"):
        list_trainings(1, [tmp_path / "out", tmp_path / "x" / "out" / "."])
    with pytest.raises(IcyMoonError, match="two folders named 'out'"):
        list_trainings(1, [tmp_path / "out", Path()])

"""Maps of cells, of workspaces and of decisions: their numbers, or one sentence with the fix."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from hostile_arrays import NO_FILES, damaged_npy, flipped, put, saved
from icymoon.stereo.decisions.dem import read_cells, read_grid
from icymoon.support.errors import IcyMoonError

GOOD = np.linspace(-1.0, 1.0, 12, dtype=np.float32).reshape(3, 4)
OTHER = {
    "other shape": saved(GOOD.T),
    "one side": saved(GOOD.ravel()),
    "double": saved(GOOD.astype(np.float64)),
    "whole numbers": saved(GOOD.astype(np.int32)),
    "other order": saved(GOOD.astype(">f4")),
}
DAMAGED = damaged_npy(GOOD) | OTHER


@pytest.mark.parametrize("values", [GOOD, GOOD > 0, np.full((3, 4), np.nan, np.float32), np.asfortranarray(GOOD)])
def test_cells_are_read(tmp_path, values):
    (tmp_path / "a.npy").write_bytes(saved(values))
    found = read_cells(tmp_path / "a.npy", (3, 4), "make it again")
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, values)
    found[0, 0] = 5.0  # it may be changed


@pytest.mark.parametrize("what", [*NO_FILES, *DAMAGED])
def test_anything_else_is_one_sentence(tmp_path, what):
    put(tmp_path / "a.npy", DAMAGED.get(what, what))
    with pytest.raises(IcyMoonError, match=r"a\.npy.*make it (again|smaller)\.$"):
        read_cells(tmp_path / "a.npy", (3, 4), "make it again")


def test_no_stated_shape_makes_room(tmp_path):
    (tmp_path / "a.npy").write_bytes(saved(GOOD))
    with pytest.raises(IcyMoonError, match=r"not a map of 2 x 1000000000 x 1000000000 cells"):
        read_cells(tmp_path / "a.npy", (2, 10**9, 10**9), "make it again")


@pytest.mark.heavy
def test_random_damage_is_a_sentence_or_a_map(tmp_path):
    for data in flipped(saved(GOOD), 1000):
        (tmp_path / "a.npy").write_bytes(data)
        with suppress(IcyMoonError):
            assert read_cells(tmp_path / "a.npy", (3, 4), "make it again").shape == (3, 4)


@pytest.mark.parametrize(
    "change",
    [
        {"shape": []},
        {"shape": [3]},
        {"shape": [3, 4, 5]},
        {"shape": [0, 4]},
        {"shape": [4097, 1]},
        {"shape": [10**18, 4]},
        {"origin_m": []},
        {"origin_m": [1.0]},
        {"origin_m": [1.0, 2.0, 3.0]},
    ],
)
def test_a_stated_workspace_that_is_none_is_a_sentence(change):
    stated = {"cell_m": 0.1, "shape": [3, 4], "origin_m": [1.0, 2.0]}
    assert read_grid(stated).rows == 3
    with pytest.raises(IcyMoonError, match="render the pair again"):
        read_grid(stated | change)

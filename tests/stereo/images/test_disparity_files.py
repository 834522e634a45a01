"""Stored disparities are read as they were written; anything else counts as absent."""

from __future__ import annotations

import numpy as np
import pytest
from files_when_asked import Files
from hostile_arrays import NO_FILES, damaged_npz, flipped, packed, put
from icymoon.stereo.images.disparity_files import read_disparity
from icymoon.stereo.images.image_files import write_disparity

GOOD = np.linspace(0.0, 9.0, 12, dtype=np.float32).reshape(3, 4)
DAMAGED = Files(damaged_npz("disparity", GOOD))


def test_what_was_written_is_read(tmp_path):
    path = tmp_path / "bm.npz"
    stored = np.where(GOOD > 8, np.float32(np.nan), GOOD)
    write_disparity(path, stored, {"flags": np.zeros((500, 500), np.uint8)}, focal_baseline_px_m=85.0)
    found = read_disparity(path, (3, 4))
    assert found is not None
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, stored)
    assert read_disparity(path, (4, 3)) is None
    assert read_disparity(path, (1, 1)) is None
    assert read_disparity(path, ()) is None


@pytest.mark.parametrize("what", [*NO_FILES, *DAMAGED, "without", "npy"])
def test_anything_else_counts_as_absent(tmp_path, what):
    path = tmp_path / "bm.npz"
    put(path, DAMAGED.get(what, {"without": packed({"a": GOOD}), "npy": GOOD.tobytes()}.get(what, what)))
    assert read_disparity(path, (3, 4)) is None


@pytest.mark.heavy
def test_random_damage_counts_as_absent_or_changes_nothing(tmp_path):
    path = tmp_path / "bm.npz"
    write_disparity(path, GOOD)
    for data in flipped(path.read_bytes(), 1000):
        path.write_bytes(data)
        found = read_disparity(path, (3, 4))
        assert found is None or found.shape == (3, 4)

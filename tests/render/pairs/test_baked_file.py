"""Files of baked light: read as written, and refused where they are anything else. Nothing in them is run."""

from __future__ import annotations

import errno

import numpy as np
import pytest
from icymoon.errors import IcyMoonError
from icymoon.physics.light.baked_rocks import TERMS
from icymoon.render.pairs import baked_file
from icymoon.render.pairs.baked_file import BakedLight

KEY, VERTICES, ROCKS = "0123456789ab", 40, 5


def light() -> BakedLight:
    random = np.random.default_rng(1)
    return BakedLight(random.random((VERTICES, 3)).astype(np.float32),
                      random.normal(size=(ROCKS, TERMS, 3)).astype(np.float32), 0.02, 0.2, 64, 1.5)


def save(path, **changes) -> None:
    """A file with other members than ours."""
    whole = {"key": np.array(KEY, "S12"), "values": light().values, "rocks": light().rocks, "noise": np.float64(0.02),
             "share": np.float64(0.2), "samples": np.float64(64), "cpu_seconds": np.float64(1.0)}
    with path.open("wb") as stream:
        np.savez(stream, **{name: value for name, value in (whole | changes).items() if value is not None})


def test_what_is_written_is_read(tmp_path):
    path = baked_file.path_of(tmp_path, KEY)
    baked_file.write(path, KEY, light())
    found = baked_file.read(path, KEY, VERTICES, ROCKS)
    assert found is not None
    assert np.array_equal(found.values, light().values)
    assert np.array_equal(found.rocks, light().rocks)
    assert (found.noise, found.share, found.samples, found.cpu_seconds) == (0.02, 0.2, 64, 1.5)
    assert [each.name for each in path.parent.iterdir()] == [path.name]


class Runs:
    """What would write a file if a pickle of it were loaded."""

    def __init__(self, path) -> None:
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.mark.parametrize("changes", [
    {"values": None}, {"more": np.zeros(3)}, {"key": np.array("ffffffffffff", "S12")}, {"key": np.array(KEY)},
    {"values": np.zeros((VERTICES + 1, 3), np.float32)}, {"values": np.zeros((VERTICES, 3), np.float64)},
    {"values": np.zeros((VERTICES, 2), np.float32)}, {"values": np.full((VERTICES, 3), np.nan, np.float32)},
    {"values": np.full((VERTICES, 3), -1.0, np.float32)}, {"rocks": None},
    {"rocks": np.zeros((ROCKS + 1, TERMS, 3), np.float32)}, {"rocks": np.zeros((ROCKS, TERMS, 3), np.float64)},
    {"rocks": np.full((ROCKS, TERMS, 3), np.inf, np.float32)}, {"noise": np.float64(np.inf)}, {"noise": np.zeros(2)}])
def test_another_content_counts_as_absent(tmp_path, changes):
    path = tmp_path / "light.npz"
    save(path)
    assert baked_file.read(path, KEY, VERTICES, ROCKS) is not None
    save(path, **changes)
    assert baked_file.read(path, KEY, VERTICES, ROCKS) is None


def test_a_file_that_would_run_something_is_not_run(tmp_path):
    path, trace = tmp_path / "light.npz", tmp_path / "ran"
    save(path, values=np.array([Runs(trace)], object))
    assert baked_file.read(path, KEY, VERTICES, ROCKS) is None
    assert not trace.exists()


@pytest.mark.parametrize("data", [b"", b"no archive", None])
def test_a_damaged_file_counts_as_absent(tmp_path, data):
    path = tmp_path / "light.npz"
    baked_file.write(path, KEY, light())
    whole = path.read_bytes()
    path.write_bytes(whole[:len(whole) // 2] if data is None else data)
    assert baked_file.read(path, KEY, VERTICES, ROCKS) is None
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 255
    path.write_bytes(flipped)
    assert baked_file.read(path, KEY, VERTICES, ROCKS) is None
    assert baked_file.read(tmp_path / "none.npz", KEY, VERTICES, ROCKS) is None


def test_a_disk_that_refuses_is_reported_and_leaves_nothing_half_written(tmp_path, monkeypatch):
    def fill(stream, **members) -> None:
        stream.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fill)
    path = baked_file.path_of(tmp_path, KEY)
    with pytest.raises(IcyMoonError, match="free some space"):
        baked_file.write(path, KEY, light())
    assert not list(path.parent.iterdir())


def test_what_is_in_the_way_of_the_file_is_reported(tmp_path):
    path = baked_file.path_of(tmp_path, KEY)
    path.mkdir(parents=True)
    assert baked_file.read(path, KEY, VERTICES, ROCKS) is None
    with pytest.raises(IcyMoonError, match=KEY):
        baked_file.write(path, KEY, light())
    (tmp_path / "data").write_bytes(b"")
    with pytest.raises(IcyMoonError, match="data"):
        baked_file.write(baked_file.path_of(tmp_path / "data", KEY), KEY, light())
    assert [each.name for each in path.parent.iterdir()] == [path.name]

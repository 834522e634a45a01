"""Files of baked light: read as written, and absent where they are anything else. Nothing in them is run."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from icymoon.physics.light.baked_rocks import TERM_COUNT
from icymoon.render.pairs import baked_file
from icymoon.render.pairs.baked_file import BakedLight
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

KEY, VERTICES, ROCKS = "0123456789ab", 40, 5


def light() -> BakedLight:
    random = np.random.default_rng(1)
    return BakedLight(
        random.random((VERTICES, 3)).astype(np.float32),
        random.normal(size=VERTICES).astype(np.float32),
        random.normal(size=(ROCKS, TERM_COUNT, 3)).astype(np.float32),
        0.02,
        0.2,
        64,
        1.5,
    )


def members(**changes) -> dict[str, Array]:
    """Members of a file with changes; None takes one away."""
    whole = {
        "key": np.array(KEY, "S12"),
        "values": light().values,
        "error": light().error,
        "rocks": light().rocks,
        "noise": np.float64(0.02),
        "share": np.float64(0.2),
        "samples": np.float64(64),
    }
    return {name: value for name, value in (whole | changes).items() if value is not None}


def saved(**changes) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **members(**changes))
    return stream.getvalue()


def read_data(path: Path, data: bytes) -> BakedLight | None:
    """What is read of a file whose checksum is known, whatever it is: a pair of an attacker states it."""
    path.write_bytes(data)
    return baked_file.read_baked_light(path, KEY, hashlib.sha256(data).hexdigest(), VERTICES, ROCKS)


def test_what_is_written_is_read(tmp_path):
    path, checksum = baked_file.write_baked_light(tmp_path, KEY, light())
    assert path.name == f"{KEY}-{checksum[:12]}.npz"
    assert checksum == hashlib.sha256(path.read_bytes()).hexdigest()
    assert baked_file.parse_name(path.name) == (KEY, checksum[:12])
    found = baked_file.read_baked_light(path, KEY, checksum, VERTICES, ROCKS)
    assert found is not None
    assert np.array_equal(found.values, light().values)
    assert np.array_equal(found.error, light().error)
    assert np.array_equal(found.rocks, light().rocks)
    assert (found.noise, found.share, found.samples) == (0.02, 0.2, 64)
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_the_same_light_is_the_same_file_whatever_it_took(tmp_path):
    first, _ = baked_file.write_baked_light(tmp_path, KEY, light())
    stamp = first.stat().st_mtime_ns
    again, _ = baked_file.write_baked_light(tmp_path, KEY, BakedLight(**{**vars(light()), "cpu_seconds": 99.0}))
    assert (again, again.stat().st_mtime_ns) == (first, stamp)
    other, _ = baked_file.write_baked_light(tmp_path, KEY, BakedLight(**{**vars(light()), "noise": 0.03}))
    assert other != first


def test_a_name_of_an_older_version_states_no_content():
    assert baked_file.parse_name(f"{KEY}.npz") == (KEY, "")


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".npz",
        "x.npz",
        f"{KEY}.npy",
        f"{KEY}.npz\n",
        f"{KEY}-.npz",
        f"{KEY}-{'0' * 11}.npz",
        f"{KEY}-{'0' * 13}.npz",
        f"{KEY.upper()}.npz",
        f"../{KEY}.npz",
        f"{KEY}.npz.host-1-1.part",
        "٠" * 12 + ".npz",
    ],
)
def test_other_names_are_no_names_of_baked_light(name):
    assert baked_file.parse_name(name) is None


class Runs:
    """What would write a file if a pickle of it were loaded."""

    def __init__(self, path) -> None:
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.mark.parametrize(
    "changes",
    [
        {"values": None},
        {"more": np.zeros(3)},
        {"key": np.array("ffffffffffff", "S12")},
        {"key": np.array(KEY)},
        {"values": np.zeros((VERTICES + 1, 3), np.float32)},
        {"values": np.zeros((VERTICES, 3), np.float64)},
        {"values": np.zeros((VERTICES, 2), np.float32)},
        {"values": np.full((VERTICES, 3), np.nan, np.float32)},
        {"values": np.full((VERTICES, 3), -1.0, np.float32)},
        {"rocks": None},
        {"values": np.zeros((VERTICES, 3), ">f4")},
        {"values": np.zeros((VERTICES, 3), np.int32)},
        {"values": np.zeros((0, 3), np.float32)},
        {"values": np.zeros((10**6, 3), np.float32)},
        {"key": np.array([KEY], "S12")},
        {"key": np.zeros((), "S13")},
        {"key": np.zeros((), "V12")},
        {"rocks": np.zeros((ROCKS + 1, TERM_COUNT, 3), np.float32)},
        {"rocks": np.zeros((ROCKS, TERM_COUNT, 3), np.float64)},
        {"rocks": np.full((ROCKS, TERM_COUNT, 3), np.inf, np.float32)},
        {"noise": np.float64(np.inf)},
        {"noise": np.zeros(2)},
        {"noise": None},
        {"samples": np.float64(np.nan)},
        {"samples": np.int64(1)},
        {"cpu_seconds": np.float64(1.0)},
        {"error": None},
        {"error": np.zeros((VERTICES, 3), np.float32)},
        {"error": np.full(VERTICES, np.nan, np.float32)},
    ],
)
def test_another_content_counts_as_absent(tmp_path, changes):
    path = tmp_path / "light.npz"
    assert read_data(path, saved()) is not None
    assert read_data(path, saved(**changes)) is None


def header(shape: str) -> bytes:
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}\n".encode()
    return b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text


def archive(values: bytes = b"", method: int = zipfile.ZIP_DEFLATED, twice: bool = False) -> bytes:
    """A file whose member ``values`` has this content, or is packed in another way."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(saved())) as old, zipfile.ZipFile(stream, "w", method) as new:
        for member in old.namelist():
            data = values if values and member == "values.npy" else old.read(member)
            with warnings.catch_warnings(action="ignore"):  # of a name that is there twice
                for _ in range(1 + (twice and member == "values.npy")):
                    new.writestr(member, data)
    return stream.getvalue()


def patched(at: int, value: bytes, mark: bytes = b"PK\x01\x02") -> bytes:
    """A file with other bytes in the entry of its first member."""
    data = bytearray(saved())
    place = data.index(mark) + at
    data[place : place + len(value)] = value
    return bytes(data)


DAMAGED = {
    "empty": b"",
    "no archive": b"no archive",
    "half": saved()[:2000],
    "an array": b"\x93NUMPY",
    "marks": b"PK\3\4" * 99,
    "stated huge": archive(header("1000000000000, 3")),
    "300 digits": archive(header("9" * 300 + ", 3")),
    "5000 digits": archive(header("9" * 5000 + ", 3")),
    "negative": archive(header("-40, -3")),
    "wraps": archive(header("4611686018427387904, 4")),
    "nested": archive(header("(" * 3000)),
    "one byte": archive(b"\0"),
    "zeros": archive(bytes(600)),
    "short header": archive(b"\x93NUMPY\1\0\xff\xff"),
    "version 9": archive(b"\x93NUMPY\x09\0" + bytes(600)),
    "bzip2": archive(method=zipfile.ZIP_BZIP2),
    "lzma": archive(method=zipfile.ZIP_LZMA),
    "twice": archive(twice=True),
    "odd compression": patched(10, b"\x63\0"),
    "encrypted": patched(8, b"\1\0"),
    "other size": patched(24, b"\5\0\0\0"),
    "huge size": patched(24, b"\xfe\xff\xff\xff"),
    "wrong sum": patched(16, b"\0\0\0\0"),
    "place beyond": patched(42, b"\xfe\xff\xff\x7f"),
    "other name": patched(46, b"\xff\xfe\0"),
    "many entries": patched(10, b"\xff\xff", b"PK\x05\x06"),
    "bomb": archive(bytes(10**7)),
}


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_damaged_file_counts_as_absent_even_if_it_is_vouched_for(tmp_path, kind):
    assert read_data(tmp_path / "light.npz", DAMAGED[kind]) is None


def test_an_empty_member_counts_as_absent(tmp_path):
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(saved())) as old, zipfile.ZipFile(stream, "w") as new:
        for member in old.namelist():
            new.writestr(member, b"" if member == "values.npy" else old.read(member))
    assert read_data(tmp_path / "light.npz", stream.getvalue()) is None


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("seed", range(8))
def test_random_damage_counts_as_absent_or_changes_nothing(tmp_path, seed):
    """Bytes that no reader looks at may differ, such as times. 500 files each."""
    random = np.random.default_rng(seed)
    whole, path = baked_file.encode_baked_light(KEY, light()) if seed % 2 else saved(), tmp_path / "light.npz"
    for _ in range(500):
        data = bytearray(whole)
        for at in random.integers(0, len(data), random.integers(1, 4)):
            data[at] = random.integers(0, 256)
        found = read_data(path, bytes(data))
        if found is not None:
            assert found.values.shape == (VERTICES, 3)
            assert np.isfinite(found.values).all()


def test_a_file_that_would_run_something_is_not_run(tmp_path):
    trace = tmp_path / "ran"
    assert read_data(tmp_path / "light.npz", saved(values=np.array([Runs(trace)], object))) is None
    assert not trace.exists()


def test_what_changed_since_or_is_no_regular_file_counts_as_absent(tmp_path):
    path, checksum = baked_file.write_baked_light(tmp_path / "set", KEY, light())
    whole = path.read_bytes()
    brighter, _ = baked_file.write_baked_light(
        tmp_path, KEY, BakedLight(**{**vars(light()), "values": 8 * light().values})
    )
    path.write_bytes(brighter.read_bytes())
    assert baked_file.read_baked_light(path, KEY, checksum, VERTICES, ROCKS) is None
    path.write_bytes(whole + b"\0")
    assert baked_file.read_baked_light(path, KEY, checksum, VERTICES, ROCKS) is None
    path.unlink()
    assert baked_file.read_baked_light(path, KEY, checksum, VERTICES, ROCKS) is None
    os.mkfifo(path)
    assert baked_file.read_baked_light(path, KEY, checksum, VERTICES, ROCKS) is None
    path.unlink()
    (tmp_path / "elsewhere.npz").write_bytes(whole)
    path.symlink_to(tmp_path / "elsewhere.npz")
    assert baked_file.read_baked_light(path, KEY, checksum, VERTICES, ROCKS) is None
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / "light").symlink_to(tmp_path / "light")
    assert (
        baked_file.read_baked_light(
            tmp_path / "linked" / "light" / brighter.name,
            KEY,
            hashlib.sha256(brighter.read_bytes()).hexdigest(),
            VERTICES,
            ROCKS,
        )
        is None
    )


def test_nothing_is_written_through_links(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    path, _ = baked_file.write_baked_light(elsewhere, KEY, light())
    path.write_text("mine")
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "light").symlink_to(elsewhere / "light")
    with pytest.raises(IcyMoonError, match="is a link"):
        baked_file.write_baked_light(tmp_path / "set", KEY, light())
    (tmp_path / "set" / "light").unlink()
    (tmp_path / "set" / "light").mkdir()
    link = tmp_path / "set" / "light" / path.name
    link.symlink_to(path)
    baked_file.write_baked_light(tmp_path / "set", KEY, light())
    assert not link.is_symlink()
    assert path.read_text() == "mine"


def test_a_disk_that_refuses_is_reported_and_leaves_nothing_half_written(tmp_path, monkeypatch):
    def fill(part: Path, data: bytes) -> None:
        with part.open("wb") as stream:
            stream.write(data[:4])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fill)
    with pytest.raises(IcyMoonError, match="free some space"):
        baked_file.write_baked_light(tmp_path, KEY, light())
    assert not list((tmp_path / "light").iterdir())


def test_what_is_in_the_way_of_the_file_is_reported(tmp_path):
    path, checksum = baked_file.write_baked_light(tmp_path, KEY, light())
    path.unlink()
    path.mkdir(parents=True)
    assert baked_file.read_baked_light(path, KEY, checksum, VERTICES, ROCKS) is None
    with pytest.raises(IcyMoonError, match=KEY):
        baked_file.write_baked_light(tmp_path, KEY, light())
    (tmp_path / "data").write_bytes(b"")
    with pytest.raises(IcyMoonError, match="data"):
        baked_file.write_baked_light(tmp_path / "data", KEY, light())
    assert [each.name for each in path.parent.iterdir()] == [path.name]

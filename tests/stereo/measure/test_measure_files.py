"""Depth and disparity maps from files of the user: their numbers, or one sentence."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from files_when_asked import Files
from hostile_arrays import NO_FILES, damaged_npy, damaged_npz, flipped, packed, put, saved
from icymoon.stereo.measure.measure_files import measure_files, read_map
from icymoon.support.errors import IcyMoonError

GOOD = np.linspace(1.0, 9.0, 12).reshape(3, 4)
DAMAGED = Files({**damaged_npy(GOOD), **damaged_npz("disparity", GOOD)})


@pytest.mark.parametrize("kind", ["<f4", ">f8", "<f2", "u1", ">i4", "<u8"])
def test_maps_are_read_as_numbers(tmp_path, kind):
    values = GOOD.astype(kind)
    for data in (saved(values), saved(np.asfortranarray(values)), packed({"disparity": values, "more": b"x"})):
        (tmp_path / "a").write_bytes(data)
        found = read_map(tmp_path / "a")
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize("what", [*NO_FILES, *DAMAGED])
def test_anything_else_is_one_sentence(tmp_path, what):
    path = tmp_path / "a.npy"
    put(path, DAMAGED.get(what, what))
    with pytest.raises(IcyMoonError, match=r"a\.npy") as caught:
        read_map(path)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)
    assert "\x1b" not in str(caught.value)


def test_a_sparse_file_of_a_terabyte_is_refused_unread(tmp_path):
    with (tmp_path / "a.npy").open("wb") as stream:
        stream.truncate(10**12)
    with pytest.raises(IcyMoonError, match="MB"):
        read_map(tmp_path / "a.npy")


@pytest.mark.heavy
def test_a_bomb_is_refused_in_little_memory(tmp_path):
    """In a process of its own, with 500 MB beyond what its start takes: 268 MB of zeros in 1 MB."""
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("disparity.npy", "w", force_zip64=True) as member,
    ):
        np.lib.format.write_array_header_1_0(member, {"descr": "<f4", "fortran_order": False, "shape": (2**26,)})
        for _ in range(256):
            member.write(bytes(2**20))
    program = (
        "import resource, sys\nfrom pathlib import Path\nfrom icymoon.support.errors import IcyMoonError\n"
        "from icymoon.stereo.images.disparity_files import read_disparity\n"
        "from icymoon.stereo.measure.measure_files import read_map\n"
        "taken = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()\n"
        "resource.setrlimit(resource.RLIMIT_AS, (taken + 500 * 10**6,) * 2)\n"
        "assert read_disparity(Path(sys.argv[1]), (2**10, 2**10)) is None\n"
        "try:\n    read_map(Path(sys.argv[1]))\nexcept IcyMoonError as error:\n    print(error)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "a.npz")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "asks for more than 134 MB" in ended.stdout, ended.stderr


@pytest.mark.heavy
def test_random_damage_is_a_sentence_or_a_map(tmp_path):
    for whole in (saved(GOOD), packed({"disparity": GOOD})):
        for data in flipped(whole, 500):
            (tmp_path / "a").write_bytes(data)
            with suppress(IcyMoonError):
                read_map(tmp_path / "a")


@pytest.mark.parametrize(
    ("least", "word"),
    [
        (np.float64(0), ""),
        (np.int64(-16), ""),
        (np.float64(np.nan), "is not a disparity"),
        (np.float64(1e300), "is not a disparity"),
        (np.zeros(2), "is not a disparity"),
        (np.array("x"), "of type"),
        (b"\x93NUMPY", "npz file"),
    ],
)
def test_the_least_disparity_that_a_file_states_is_a_number(tmp_path, least, word):
    stated = least if isinstance(least, bytes) else np.asarray(least)
    (tmp_path / "d.npz").write_bytes(packed({"disparity": GOOD, "bm_min_disparity": stated}))
    (tmp_path / "t.npy").write_bytes(saved(GOOD))
    if word:
        with pytest.raises(IcyMoonError, match=word):
            measure_files(None, tmp_path / "d.npz", tmp_path / "t.npy", 10.0, guiss=True)
    else:
        assert measure_files(None, tmp_path / "d.npz", tmp_path / "t.npy", 10.0, guiss=True)

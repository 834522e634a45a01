"""Which files are loaded as SPICE kernels: those that are some, and none that a stranger's kernel leads to."""

from __future__ import annotations

import os
import struct
from contextlib import suppress

import numpy as np
import pytest
from icymoon.physics.light import kernels as kernel_module
from icymoon.physics.light.kernels import find_kernels, list_kernel_files
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.timeout(30)
PCK = "KPL/PCK\nA text of others\n\\begindata\nBODY599_RADII = ( 71492 71492 66854 )\n\\begintext\nmore\n"
MK = "KPL/MK\n\\begindata\n{}\n\\begintext\n"


def daf(
    following: float = 0.0,
    count: float = 1.0,
    first: int = 2,
    begin: int = 385,
    end: int = 400,
    doubles: int = 2,
    integers: int = 6,
    free: int = 401,
    order: str = "<",
) -> bytes:
    """A DAF of four records: its own, a record of summaries, one of names, one of numbers."""
    mark = b"LTL-IEEE" if order == "<" else b"BIG-IEEE"
    head = (
        b"DAF/SPK "
        + struct.pack(f"{order}2i", doubles, integers)
        + b"name".ljust(60)
        + struct.pack(f"{order}3i", first, 2, free)
        + mark
    ).ljust(1024, b"\0")
    summary = struct.pack(f"{order}3d2d6i", following, 0.0, count, 0.0, 1.0, 10, 0, 1, 8, begin, end)
    return head + summary.ljust(1024, b"\0") + b" " * 1024 + bytes(1024)


@pytest.fixture
def folder(tmp_path):
    """A folder as macOS leaves it, with a folder of kernels in it."""
    there = tmp_path / "kernels"
    (there / "spk").mkdir(parents=True)
    (there / "a.tpc").write_text(PCK)
    (there / "README").write_text("How to use \\begindata in a text kernel\n")
    (there / ".DS_Store").write_bytes(b"\0\0\0\1Bud1" + bytes(2000))
    (there / "image.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (there / "spk" / "b.bsp").write_bytes(daf())
    return there


def test_only_kernels_are_loaded_of_a_folder(folder):
    assert find_kernels(folder) == [folder / "a.tpc", folder / "spk" / "b.bsp"]
    assert len(list_kernel_files(folder)) == 5
    assert find_kernels(folder / "a.tpc") == [folder / "a.tpc"]
    (folder / "spk" / "b.bsp").write_bytes(daf(order=">"))
    assert len(find_kernels(folder)) == 2
    for empty in (folder / "README", folder / ".DS_Store", folder / "image.png"):
        with pytest.raises(IcyMoonError, match="has no SPICE kernel"):
            find_kernels(empty)


@pytest.mark.parametrize(
    "data",
    [
        "KERNELS_TO_LOAD = ( 'a.tpc', 'spk/b.bsp' )",
        "KERNELS_TO_LOAD = 'a.tpc'\nKERNELS_TO_LOAD += ( 'spk/b.bsp' )",
        "PATH_SYMBOLS = ('K' 'S')\nPATH_VALUES = ('.' 'spk')\nKERNELS_TO_LOAD=('$K/a.tpc'\n  '$S/b.bsp')",
        "KERNELS_TO_LOAD = ( 'a.t+' 'pc' 'spk/+', 'b.bsp' )",
        "KERNELS_TO_LOAD = ( '{}/a.tpc', '{}/spk/b.bsp' )",
    ],
)
def test_a_meta_kernel_names_files_beside_it(folder, data):
    (folder / "m.tm").write_text(MK.format(data.replace("{}", str(folder))))
    assert find_kernels(folder / "m.tm") == [folder / "a.tpc", folder / "spk" / "b.bsp"]


def test_a_meta_kernel_in_a_folder_of_its_kind_names_what_is_beside_that(folder):
    (folder / "mk").mkdir()
    (folder / "mk" / "m.tm").write_text(MK.format("KERNELS_TO_LOAD = ( '../spk/b.bsp' )"))
    assert find_kernels(folder / "mk" / "m.tm") == [folder / "spk" / "b.bsp"]
    assert find_kernels(folder) == [folder / "a.tpc", folder / "spk" / "b.bsp"]


@pytest.mark.parametrize(
    "data",
    [
        "KERNELS_TO_LOAD = ( '../secret.tpc' )",
        "KERNELS_TO_LOAD = ( '/etc/passwd' )",
        "KERNELS_TO_LOAD = ( 'link.tpc' )",
        "PATH_SYMBOLS = 'A'\nPATH_VALUES = '..'\nKERNELS_TO_LOAD = '$A/secret.tpc'",
        "KERNELS_TO_LOAD = ( 'absent.tpc' )",
        "KERNELS_TO_LOAD = ( 'm.tm' )",
        "KERNELS_TO_LOAD = ( 'README' )",
        "KERNELS_TO_LOAD = ( 'pipe' )",
        "KERNELS_TO_LOAD = ( '' )",
        "KERNELS_TO_LOAD = ( 'spk' )",
        "KERNELS_TO_LOAD = ( )",
        "KERNELS_TO_LOAD",
        "KERNELS_TO_LOAD = ( 'a",
        "KERNELS_TO_LOAD = ( 3 )",
        "KERNELS_TO_LOAD = ( '\0' )",
        "PATH_SYMBOLS = ('A' 'B')\nPATH_VALUES = 'a'\nKERNELS_TO_LOAD = 'a.tpc'",
        "KERNELS_TO_LOAD = ( " + "'a.tpc' " * 3000 + ")",
        "KERNELS_TO_LOAD = ( '" + "a" * 5000 + "' )",
        "KERNELS_TO_LOAD = ( '" + "a+' '" * 10**4 + "' )",
        "KERNELS_TO_LOAD = '" + "a" * 70_000 + "'",
    ],
    ids=range(20),
)
def test_a_meta_kernel_leads_nowhere_else(folder, data):
    (folder.parent / "secret.tpc").write_text(PCK)
    (folder / "link.tpc").symlink_to(folder.parent / "secret.tpc")
    os.mkfifo(folder / "pipe")
    (folder / "m.tm").write_text(MK.format(data))
    with pytest.raises(IcyMoonError) as caught:
        find_kernels(folder / "m.tm")
    assert len(str(caught.value)) < 600
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "content",
    [
        daf(following=2.0),
        daf(following=-1.0),
        daf(following=1e300),
        daf(following=float("nan")),
        daf(following=2.5),
        daf(count=-1),
        daf(count=1e9),
        daf(count=float("nan")),
        daf(count=126),
        daf(first=-1),
        daf(first=5),
        daf(first=1),
        daf(doubles=-1),
        daf(doubles=200),
        daf(integers=0),
        daf(integers=10**6),
        daf(integers=-1),
        daf(begin=0),
        daf(begin=401),
        daf(end=10**9),
        daf(free=10**9),
        daf(free=-1),
        daf()[:1500],
        daf()[:500],
        b"DAF/SPK ",
    ],
    ids=range(25),
)
def test_a_binary_kernel_that_leads_in_a_ring_or_out_is_refused(folder, content):
    (folder / "c.bsp").write_bytes(content)
    with pytest.raises(IcyMoonError, match=r"c\.bsp"):
        find_kernels(folder)


def test_a_text_kernel_is_bounded(folder, monkeypatch):
    monkeypatch.setattr(kernel_module, "_MAX_TEXT_BYTES", 1000)
    (folder / "c.tpc").write_text(PCK + "more\n" * 1000)
    with pytest.raises(IcyMoonError, match="is a text kernel of 0 MB"):
        find_kernels(folder)
    monkeypatch.setattr(kernel_module, "_MAX_FILES", 4)
    with pytest.raises(IcyMoonError, match="files, more than 4"):
        find_kernels(folder)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("whole", [daf(), MK.format("KERNELS_TO_LOAD = ( 'a.tpc', 'spk/b.bsp' )").encode()])
def test_a_damaged_kernel_is_one_or_a_sentence(folder, whole, seed):
    random = np.random.default_rng(seed)
    for _ in range(100):
        data = bytearray(whole)
        for at in random.integers(0, min(len(data), 1200), 3):
            data[at] = random.integers(0, 256)
        (folder / "m.tm").write_bytes(data)
        kernel_module._read_kernel.cache_clear()
        with suppress(IcyMoonError):
            find_kernels(folder / "m.tm")

"""Height maps and textures that state what cannot be: a sentence before Blender is given them, in little memory."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from bounded import run_bounded
from exr_files import attribute, channel, exr, window
from icymoon.nodes.ground.import_heights import read_heights
from icymoon.nodes.surface.images import load_maps
from icymoon.settings.topics.surfaces import TexturesSettings
from icymoon.support.errors import IcyMoonError
from rendering import complete


def part(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(width: int, height: int, bits: int = 16, colours: int = 0, data: bytes = bytes(40)) -> bytes:
    return (
        b"\x89PNG\r\n\x1a\n"
        + part(b"IHDR", struct.pack(">2I5B", width, height, bits, colours, 0, 0, 0))
        + part(b"IDAT", zlib.compress(data))
        + part(b"IEND", b"")
    )


def npy(shape: str, kind: str = "<f4", data: bytes = bytes(64)) -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode() + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text + data


def exr_window(*ends: int) -> dict[bytes, bytes]:
    return {b"dataWindow": attribute(b"dataWindow", b"box2i", window(*ends))}


HEIGHTS = {
    "huge.png": png(30000, 20000, data=bytes(10**6)),
    "zero.png": png(0, 9),
    "bits.png": png(9, 9, 3),
    "colour.png": png(9, 9, 8, 2),
    "cut.png": png(9, 9)[:-14],
    "text.png": b"no image",
    "empty.png": b"",
    "huge.exr": exr(exr_window(0, 0, 10**8, 3)),
    "cut.exr": exr()[:-1],
    "text.exr": b"no image",
    "named.exr": exr({b"channels": attribute(b"channels", b"chlist", channel(b"\x1b[31mred\x1b[0m") + b"\0")}),
    "negative.exr": exr(before=attribute(b"a", b"b", b"", -8)),
    "turned.exr": exr(exr_window(3, 3, 0, 0)),
    "many.exr": exr(
        {b"channels": attribute(b"channels", b"chlist", b"".join(channel(b"c%03d" % k) for k in range(500)) + b"\0")}
    ),
    "huge.npy": npy("(100000000000, 3)"),
    "digits.npy": npy("(" + "9" * 300 + ",)"),
    "minus.npy": npy("(-4, -4)"),
    "cube.npy": npy("(4, 2, 2)"),
    "text.npy": npy("(4, 4)", "|O"),
    "complex.npy": npy("(2, 4)", "<c8"),
    "bool.npy": npy("(8, 8)", "|b1"),
    "cut.npy": npy("(4, 4)")[:-1],
    "deep.npy": npy("(" * 5000),
    "pickle.npy": b"\x80\4N.",
    "row.npy": npy("(1, 16)"),
    "empty.npy": b"",
}


@pytest.mark.parametrize("name", HEIGHTS)
def test_a_bad_height_map_is_a_sentence(tmp_path, name, capfd):
    path = tmp_path / name
    path.write_bytes(HEIGHTS[name])
    with pytest.raises(IcyMoonError) as caught:
        read_heights(path)
    assert str(caught.value).startswith(f"{path}")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500 + len(str(path))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", ["png", "exr", "npy", "tif"])
def test_what_is_no_regular_file_is_a_sentence(tmp_path, suffix):
    os.mkfifo(tmp_path / f"pipe.{suffix}")
    (tmp_path / f"folder.{suffix}").mkdir()
    (tmp_path / f"loop.{suffix}").symlink_to(tmp_path / f"loop.{suffix}")
    for name in ("pipe", "folder", "loop", "absent"):
        with pytest.raises(IcyMoonError, match=f"{name}.{suffix}"):
            read_heights(tmp_path / f"{name}.{suffix}")


def test_good_height_maps_are_read(tmp_path):
    rows = b"".join(b"\0" + struct.pack(">3H", *range(3 * k, 3 * k + 3)) for k in range(4))
    (tmp_path / "a.png").write_bytes(png(3, 4, data=rows))
    assert read_heights(tmp_path / "a.png").values.tolist() == np.arange(12.0).reshape(4, 3).tolist()
    (tmp_path / "a.exr").write_bytes(exr())
    assert read_heights(tmp_path / "a.exr").values.tolist() == [[0, 1, 2, 3]] * 4
    (tmp_path / "a.npy").write_bytes(npy("(4, 4)"))
    assert read_heights(tmp_path / "a.npy").values.tolist() == [[0] * 4] * 4


TEXTURES = {
    "huge.png": png(30000, 20000, 8, 2, bytes(10**6)),
    "huge.exr": exr(exr_window(0, 0, 10**8, 3)),
    "cut.exr": exr()[:-1],
    "negative.exr": exr(before=attribute(b"a", b"b", b"", -8)),
    "text.png": b"no image",
    "movie.png": b"\0\0\0\x20ftypisom" + bytes(1000),
    "empty.jpg": b"",
    "psd.png": b"8BPS\0\1" + bytes(100),
    "torn.png": png(9, 9, 8, 2)[:20],
    "torn.jpg": b"\xff\xd8\xff\xe0\0\x10JFIF",
}


def own(path: Path) -> TexturesSettings:
    return complete({"textures": {"set": "OWN", "albedo_file": str(path)}}).textures


@pytest.mark.parametrize("name", TEXTURES)
def test_a_bad_texture_is_a_sentence(tmp_path, name, capfd):
    path = tmp_path / name
    path.write_bytes(TEXTURES[name])
    with pytest.raises(IcyMoonError, match="give a PNG") as caught:
        load_maps(own(path), {"albedo": path})
    assert str(caught.value).isprintable()
    assert capfd.readouterr() == ("", "")


def test_a_texture_that_is_no_regular_file_is_a_sentence(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    for path in (tmp_path / "pipe.png", tmp_path, tmp_path / "absent.png"):
        with pytest.raises(IcyMoonError):
            load_maps(own(path), {"albedo": path})


@pytest.mark.ci_takes(1)
@pytest.mark.heavy
@pytest.mark.parametrize("name", ["huge.png", "huge.exr", "huge.npy"])
def test_little_memory_is_taken(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(HEIGHTS[name])
    ended = run_bounded(
        f"""
from pathlib import Path
import icymoon.nodes.ground.import_heights as heights
import resource
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
from icymoon.support.errors import IcyMoonError
try:
    heights.read_heights(Path({str(path)!r}))
except IcyMoonError:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
""",
        memory=4 * 10**9,
    )  # Blender reserves address space; so its memory is measured
    assert 1024 * int(ended) < 100e6

"""EXR files that state what cannot be: each is refused at once, by every reader, and a good one is not."""

from __future__ import annotations

import os
import struct
import zlib
from contextlib import suppress

import numpy as np
import OpenEXR
import pytest
from bounded import run_bounded
from exr_files import attribute, channel, exr, one_chunk_named_often, window
from icymoon.formats.exr_layout import check_decodable, is_whole, read_layout
from icymoon.formats.exr_parts import assemble, keep_part_attributes, read_pieces
from icymoon.formats.exr_pixels import Pixels, decode_parts
from icymoon.stereo.images.exr import read_depth, read_light, read_view
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import Budget, ForeignBytes, OverBudgetError, parse_part

REFUSED = (ValueError, KeyError, OverBudgetError)
LINE = struct.pack("<4f", *range(4))


def test_the_file_made_by_hand_is_good(tmp_path):
    (tmp_path / "a.exr").write_bytes(exr())
    assert is_whole(tmp_path / "a.exr")
    assert np.array_equal(
        OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()["Y"].pixels,
        np.tile(np.arange(4, dtype="f4"), (4, 1)),
    )
    ((_, found),) = decode_parts(exr())
    assert np.array_equal(found["Y"], np.tile(np.arange(4, dtype="f4"), (4, 1)))


def data_window(*ends: int) -> dict[bytes, bytes]:
    return {b"dataWindow": attribute(b"dataWindow", b"box2i", window(*ends))}


def chunk_list(*entries: bytes, end: bytes = b"\0") -> dict[bytes, bytes]:
    return {b"channels": attribute(b"channels", b"chlist", b"".join(entries) + end)}


LINES = [(line, 16, LINE) for line in range(4)]
BAD = {
    "negative size": exr({b"lineOrder": attribute(b"lineOrder", b"lineOrder", b"\0", -30)}),
    "negative size leads to its own start": exr(before=attribute(b"a", b"b", b"", -(2 + 2 + 4))),
    "size of 2 GB": exr({b"lineOrder": attribute(b"lineOrder", b"lineOrder", b"\0", 2**31 - 1)}),
    "least size": exr({b"lineOrder": attribute(b"lineOrder", b"lineOrder", b"\0", -(2**31))}),
    "size off by one": exr({b"lineOrder": attribute(b"lineOrder", b"lineOrder", b"\0", 2)}),
    "attribute twice": exr(extra=attribute(b"dataWindow", b"box2i", window(0, 0, 9, 9))),
    "no end of the header": exr(end=b"")[:300],
    "name without end": exr(before=b"a" * 400),
    "no window": exr({b"dataWindow": b""}),
    "no channels": exr({b"channels": b""}),
    "no compression": exr({b"compression": b""}),
    "unknown compression": exr(compression=200),
    "window of another type": exr({b"dataWindow": attribute(b"dataWindow", b"box2f", window())}),
    "window of 12 bytes": exr({b"dataWindow": attribute(b"dataWindow", b"box2i", bytes(12))}),
    "right before left": exr(data_window(3, 0, 0, 3)),
    "bottom before top": exr(data_window(0, 3, 3, 0)),
    "window of 2^31": exr(data_window(-(2**31), 0, 2**31 - 1, 3)),
    "lines of 2^31": exr(data_window(0, 0, 3, 2**31 - 2)),
    "lines of 2^30": exr(data_window(0, 0, 3, 2**30 - 1)),
    "far window": exr(data_window(2**30, 0, 2**30 + 3, 3)),
    "display window inside out": exr({b"displayWindow": attribute(b"displayWindow", b"box2i", window(9, 0, 0, 9))}),
    "one line too many": exr(data_window(0, 0, 3, 4)),
    "channel twice": exr(chunk_list(channel(), channel())),
    "channels without end": exr(chunk_list(channel(), end=b"")),
    "channels after the end": exr(chunk_list(channel(), end=b"\0\0")),
    "no channel": exr(chunk_list()),
    "channel cut": exr(chunk_list(channel()[:-1])),
    "sampled at every 0": exr(chunk_list(channel(across=0))),
    "sampled at every -1": exr(chunk_list(channel(down=-1))),
    "type 3": exr(chunk_list(channel(kind=3))),
    "type -1": exr(chunk_list(channel(kind=-1))),
    "channel that is no text": exr(chunk_list(channel(b"\xff\xfe"))),
    "5000 channels": exr(chunk_list(*(channel(b"%d" % k) for k in range(5000)))),
    "chunkCount of 2^31": exr(extra=attribute(b"chunkCount", b"int", struct.pack("<i", 2**31 - 1))),
    "chunkCount below zero": exr(extra=attribute(b"chunkCount", b"int", struct.pack("<i", -1))),
    "chunkCount of one less": exr(extra=attribute(b"chunkCount", b"int", struct.pack("<i", 3))),
    "chunkCount of two bytes": exr(extra=attribute(b"chunkCount", b"int", bytes(2))),
    "deep": exr(version=2 | 0x800),
    "version 3": exr(version=3),
    "type deepscanline": exr(extra=attribute(b"type", b"string", b"deepscanline")),
    "tiles": exr(version=2 | 0x200, extra=attribute(b"tiles", b"tiledesc", struct.pack("<2IB", 4, 4, 0))),
    "several without an end": exr(version=2 | 0x1000),
    "no part at all": exr(version=2 | 0x1000)[:8] + b"\0" * 40,
    "offsets of 0": exr(offsets=[0] * 4),
    "offsets of 2^64": exr(offsets=[2**64 - 1] * 4),
    "offsets of 2^63": exr(offsets=[2**63] * 4),
    "offsets of the table": exr(offsets=[exr().index(LINE) - 8 - 32] * 4),
    "the same chunk": exr(offsets=[exr().index(LINE) - 8] * 4),
    "the last chunk twice": exr(offsets=[exr().index(LINE) - 8 + 24 * k for k in (0, 1, 3, 3)]),
    "chunk of a negative size": exr(chunks=[(0, -16, LINE), *LINES[1:]]),
    "chunk of 2 GB": exr(chunks=[(0, 2**31 - 1, LINE), *LINES[1:]]),
    "chunk one byte longer": exr(chunks=[*LINES[:3], (3, 17, LINE)]),
    "chunk that reaches into the next": exr(chunks=[(0, 40, LINE), *LINES[1:]]),
    "line outside": exr(chunks=[(4, 16, LINE), *LINES[1:]]),
    "line before": exr(chunks=[(-1, 16, LINE), *LINES[1:]]),
    "line of 2^31": exr(chunks=[(2**31 - 1, 16, LINE), *LINES[1:]]),
    "line -2^31": exr(chunks=[(-(2**31), 16, LINE), *LINES[1:]]),
    "line twice": exr(chunks=[(1, 16, LINE), *LINES[1:]]),
    "cut": exr()[:-1],
    "cut in the table": exr()[: exr().index(LINE) - 20],
    "magic": b"v/1\0" + exr()[4:],
    "empty": b"",
    "zeros": bytes(1000),
    "four bytes": exr()[:4],
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_is_refused_by_every_reader(tmp_path, name, capfd):
    path = tmp_path / "left.exr"
    path.write_bytes(BAD[name])
    assert not is_whole(path)
    with pytest.raises(REFUSED):
        read_pieces(BAD[name])
    with pytest.raises(REFUSED):
        list(decode_parts(BAD[name]))
    for read in (read_view, read_light, read_depth, lambda p: read_light(p, rows=range(1, 2))):
        with pytest.raises(IcyMoonError) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert str(caught.value).endswith("; render the pair again.")
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("chunk", "compression"),
    [
        (zlib.compress(bytes(15)), 2),
        (zlib.compress(bytes(17)), 2),
        (zlib.compress(bytes(10**6)), 2),
        (b"x" * 15, 2),
        (b"", 2),
        (bytes(12), 0),
        (bytes(17), 0),
        (zlib.compress(bytes(range(16)))[:-9], 2),
    ],
)
def test_chunks_that_unfold_to_another_size_are_refused(tmp_path, chunk, compression):
    data = exr(chunks=[*LINES[:3], (3, len(chunk), chunk)], compression=compression)
    with pytest.raises(REFUSED):
        list(decode_parts(data))


@pytest.mark.parametrize("entry", [channel(across=2), channel(down=2), channel(kind=0)])
def test_what_is_not_of_every_pixel_or_no_float_is_not_decoded_here(entry):
    with pytest.raises(ValueError, match="does not store floats"):
        list(decode_parts(exr(chunk_list(entry))))


def test_parts_of_unequal_size_are_a_sentence(tmp_path):
    pieces = []
    for k, band in enumerate(b"RGB"):
        name = b"Beauty.Combined.%c" % band
        data = struct.pack(f"<{4 + k}f", *range(4 + k))
        (piece,) = read_pieces(
            exr(
                chunk_list(channel(name)) | data_window(0, 0, 3 + k, 3),
                chunks=[(line, len(data), data) for line in range(4)],
            )
        )
        pieces.append(keep_part_attributes(piece, name.decode()))
    (tmp_path / "left.exr").write_bytes(assemble(pieces))
    assert is_whole(tmp_path / "left.exr")
    with pytest.raises(IcyMoonError, match="unequal size"):
        read_light(tmp_path / "left.exr")


def test_an_image_that_unfolds_a_thousandfold_is_refused_before_its_room_is_made():
    size = 2**14
    block = zlib.compress(bytes(16 * size * 4), 9)
    data = exr(
        data_window(0, 0, size - 1, size - 1),
        compression=3,
        chunks=[(16 * k, len(block), block) for k in range(size // 16)],
    )
    assert len(data) < 5_000_000
    for parse in (lambda f: read_pieces(f.content()), check_decodable):
        with pytest.raises(IcyMoonError, match="asks for more than"):
            parse_part(data, "a.exr", parse, "an EXR file", "render it again")
    assert read_layout(ForeignBytes(data, len(data), Budget()))  # its structure is whole


def test_what_is_no_regular_file_is_not_whole(tmp_path):
    os.mkfifo(tmp_path / "pipe.exr")
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "loop.exr").symlink_to(tmp_path / "loop.exr")
    (tmp_path / "good.exr").write_bytes(exr())
    (tmp_path / "link.exr").symlink_to(tmp_path / "good.exr")
    for name, whole in {"pipe": False, "folder": False, "loop": False, "good": True, "link": True}.items():
        assert is_whole(tmp_path / f"{name}.exr") == whole
    for name in ("folder", "loop"):
        with pytest.raises(IcyMoonError):
            read_view(tmp_path / f"{name}.exr")


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    "act",
    [
        "is_whole(path)",
        "read_view(path)",
        "read_light(path)",
        "read_depth(path)",
        "read_light(path, rows=range(5, 9))",
        "list(decode_parts(path.read_bytes()))",
    ],
)
def test_one_chunk_that_is_named_often_takes_no_memory(tmp_path, act):
    one_chunk_named_often(tmp_path / "often.exr")
    ended = run_bounded(f"""
from pathlib import Path
from icymoon.support.errors import IcyMoonError
from icymoon.formats.exr_layout import is_whole
from icymoon.formats.exr_pixels import decode_parts
from icymoon.stereo.images.exr import read_depth, read_light, read_view
path = Path({str(tmp_path / "often.exr")!r})
try:
    print({act})
except (IcyMoonError, ValueError) as error:
    print("refused", error)
""")
    assert ended.startswith(("False", "refused"))


def written(parts: int, compression, tiles: bool = False) -> OpenEXR.File:
    pixels = np.random.default_rng(1).random((37, 21)).astype(np.float32)
    header = {"compression": compression, "type": OpenEXR.tiledimage if tiles else OpenEXR.scanlineimage}
    if tiles:
        header["tiles"] = OpenEXR.TileDescription()
        header["tiles"].xSize = header["tiles"].ySize = 8
    names = [*(f"Beauty.Combined.{band}" for band in "RGB"), "Beauty.Depth.Z"]
    return OpenEXR.File(
        [OpenEXR.Part(dict(header), {name: pixels.copy() for name in names}, f"p{k}") for k in range(parts)]
    )


@pytest.mark.parametrize("compression", range(12))
def test_every_compression_is_whole(tmp_path, compression):
    written(2, OpenEXR.Compression(compression)).write(str(tmp_path / "a.exr"))
    assert is_whole(tmp_path / "a.exr")


@pytest.mark.parametrize("parts", [1, 3])
def test_tiles_are_followed_where_they_are_asked_for(tmp_path, parts):
    written(parts, OpenEXR.ZIP_COMPRESSION, tiles=True).write(str(tmp_path / "a.exr"))
    data = (tmp_path / "a.exr").read_bytes()
    found = read_layout(ForeignBytes(data, len(data), Budget()), tiles=True)
    assert [len(part.places) for part in found] == [3 * 5] * parts
    assert not is_whole(tmp_path / "a.exr")
    for torn in (data[:-1], data[:200], data.replace(b"tiledesc\0\t\0\0\0\x08\0\0\0", b"tiledesc\0\t\0\0\0\0\0\0\0")):
        with pytest.raises(REFUSED):
            read_layout(ForeignBytes(torn, len(torn), Budget()), tiles=True)


@pytest.mark.parametrize("mode", range(6))
def test_the_tiles_of_all_levels_are_counted(mode):
    """Against a count of level after level: one level, MIP and RIP maps, both roundings."""
    level, up = (mode % 3, mode // 3)
    width, height, across, down = 37, 21, 8, 4

    def sizes(size: int, longest: int) -> list[int]:
        found = [(size, longest)]
        while found[-1][1] > 1:
            found.append(tuple(max(1, (n + up) // 2) for n in found[-1]))
        return [n for n, _ in found]

    columns, rows = (
        (sizes(width, max(width, height)), sizes(height, max(width, height)))
        if level == 1
        else (sizes(width, width), sizes(height, height))
    )
    pairs = (
        [(width, height)]
        if level == 0
        else list(zip(columns, rows, strict=True))
        if level == 1
        else [(x, y) for x in columns for y in rows]
    )
    count = sum(-(-x // across) * -(-y // down) for x, y in pairs)
    stated = exr(
        data_window(0, 0, width - 1, height - 1),
        version=2 | 0x200,
        extra=attribute(b"tiles", b"tiledesc", struct.pack("<2IB", across, down, level + 16 * up))
        + attribute(b"chunkCount", b"int", struct.pack("<i", count)),
    )
    with pytest.raises(ValueError, match="but it has"):  # not: another count of chunks
        read_layout(ForeignBytes(stated, len(stated), Budget()), tiles=True)


@pytest.mark.ci_takes(6)
@pytest.mark.parametrize("seed", range(12))
def test_random_damage_is_a_sentence_or_an_image(tmp_path, seed):
    random = np.random.default_rng(seed)
    path = tmp_path / "left.exr"
    written(1 + seed % 3, (OpenEXR.ZIP_COMPRESSION, OpenEXR.NO_COMPRESSION)[seed % 2]).write(str(path))
    whole = path.read_bytes()
    for k in range(100):
        data = bytearray(whole)
        # Half of the damage in the headers and the table of chunks, where it counts.
        for at in random.integers(0, len(data) if k % 2 else 1200, random.integers(1, 4)):
            data[at] = random.choice([0, 1, 127, 128, 255, random.integers(256)])
        path.write_bytes(data)
        is_whole(path)
        with suppress(*REFUSED):
            assembled = assemble([keep_part_attributes(piece, "p") for piece in read_pieces(bytes(data))])
            list(decode_parts(assembled))
            Pixels(read_pieces(assembled)[0]).decode()
        with suppress(IcyMoonError):
            read_view(path)

"""TIFF files that state what cannot be, and windows of good ones."""

from __future__ import annotations

import lzma
import os
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from bounded import run_bounded
from icymoon.formats import geotiff, tiff
from icymoon.stereo.datasets.data_files import MapFile, read_map
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import Budget, ForeignBytes
from tiffs import write_tiff

DATA = Path(__file__).parents[1] / "data" / "heights"
SHORT, LONG, DOUBLE = 3, 4, 12


def made(
    tags: dict[int, tuple[int, int, int]],
    data: bytes = bytes(64),
    big: bool = False,
    count: int | None = None,
    following: int = 0,
) -> bytes:
    """A file of ``data`` from byte 16 on, and a directory of tags: type, number of values, and the value or its place.

    ``count`` is stated in place of the true number of tags.
    """
    at = 16 + len(data)
    if big:
        head = struct.pack("<2sHHHQ", b"II", 43, 8, 0, at)
        entries = b"".join(struct.pack("<HHQQ", tag, *rest) for tag, rest in tags.items())
        return (
            head
            + data
            + struct.pack("<Q", len(tags) if count is None else count)
            + entries
            + struct.pack("<Q", following)
        )
    head = struct.pack("<2sHI8x", b"II", 42, at)
    entries = b"".join(struct.pack("<HHII", tag, *rest) for tag, rest in tags.items())
    return (
        head + data + struct.pack("<H", len(tags) if count is None else count) + entries + struct.pack("<I", following)
    )


def grey(**replaced: tuple[int, int, int]) -> dict[int, tuple[int, int, int]]:
    """The tags of 4 x 4 floats in one strip; ``t256`` replaces the tag 256."""
    tags = {
        256: (LONG, 1, 4),
        257: (LONG, 1, 4),
        258: (SHORT, 1, 32),
        259: (SHORT, 1, 1),
        262: (SHORT, 1, 1),
        273: (LONG, 1, 16),
        277: (SHORT, 1, 1),
        278: (LONG, 1, 4),
        279: (LONG, 1, 64),
        339: (SHORT, 1, 3),
    }
    return dict(sorted((tags | {int(key[1:]): value for key, value in replaced.items()}).items()))


def test_the_file_made_by_hand_is_good(tmp_path):
    values = np.arange(16, dtype="<f4")
    for big in (False, True):
        (tmp_path / "a.tif").write_bytes(made(grey(), values.tobytes(), big))
        assert np.array_equal(geotiff.read(tmp_path / "a.tif").heights_m, values.reshape(4, 4))


SPARSE = {"t273": (LONG, 1, 0), "t279": (LONG, 1, 0)}
BOMB = zlib.compress(bytes(50_000_000), 9)
BAD = {
    "no width": made({k: v for k, v in grey().items() if k != 256}),
    "width 0": made(grey(t256=(LONG, 1, 0))),
    "width -1": made(grey(t256=(9, 1, 2**32 - 1))),
    "no values of the width": made(grey(t256=(LONG, 0, 0))),
    "width as text": made(grey(t256=(2, 1, 65))),
    "width as doubles": made(grey(t256=(DOUBLE, 1, 16))),
    "sparse and huge": made(grey(t256=(LONG, 1, 2**15), t257=(LONG, 1, 2**15), t278=(LONG, 1, 2**15), **SPARSE)),
    "2^32 pixels": made(grey(t256=(LONG, 1, 2**32 - 1), t257=(LONG, 1, 2**32 - 1))),
    "huge tile": made(grey(t322=(LONG, 1, 2**20), t323=(LONG, 1, 2**20), t324=(LONG, 1, 0), t325=(LONG, 1, 0))),
    "tile of 0": made(grey(t322=(LONG, 1, 0), t323=(LONG, 1, 16), t324=(LONG, 1, 0), t325=(LONG, 1, 0))),
    "tiles without places": made(grey(t322=(LONG, 1, 16), t323=(LONG, 1, 16))),
    "offsets without end": made(grey(t273=(LONG, 2**31, 16))),
    "sizes without end": made(grey(t279=(LONG, 2**31, 16))),
    "two strips": made(grey(t273=(LONG, 2, 16), t279=(LONG, 2, 16))),
    "sizes of one more": made(grey(t279=(LONG, 2, 16))),
    "strips of 0 rows": made(grey(t278=(LONG, 1, 0))),
    "strip beyond the end": made(grey(t273=(LONG, 1, 10**6))),
    "strip cut": made(grey(t279=(LONG, 1, 63))),
    "negative offset": made(grey(t273=(9, 1, 2**32 - 1))),
    "negative size": made(grey(t279=(9, 1, 2**32 - 1))),
    "offset as a fraction": made(grey(t273=(11, 1, 2**31 - 1))),
    "predictor 9": made(grey(t317=(SHORT, 1, 9))),
    "bits 0": made(grey(t258=(SHORT, 1, 0))),
    "bits 7": made(grey(t258=(SHORT, 1, 7))),
    "bits 65528": made(grey(t258=(SHORT, 1, 65528))),
    "bands 0": made(grey(t277=(SHORT, 1, 0))),
    "torn deflate": made(grey(t259=(SHORT, 1, 8))),
    "torn LZW": made(grey(t259=(SHORT, 1, 5)), b"\xff" * 64),
    "torn LZMA": made(grey(t259=(SHORT, 1, 34925))),
    "torn ZSTD": made(grey(t259=(SHORT, 1, 50000))),
    "short PackBits": made(grey(t259=(SHORT, 1, 32773))),
    "65535 tags": made(grey(), count=65535),
    "2^64 tags": made(grey(), big=True, count=2**64 - 1),
    "no tags": made({}),
    "directory beyond the end": struct.pack("<2sHI", b"II", 42, 10**9) + bytes(100),
    "directory at the end": struct.pack("<2sHI", b"II", 42, 8),
    "next directory beyond the end": made(grey(), following=2**31),
    "no directory": struct.pack("<2sHI", b"II", 42, 0) + bytes(100),
    "empty": b"",
    "two bytes": b"II",
    "magic": b"II*\0",
    "zeros": bytes(100),
    "names of another order": b"IM" + made(grey())[2:],
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_is_refused(tmp_path, name):
    path = tmp_path / "a.tif"
    path.write_bytes(BAD[name])
    with pytest.raises(IcyMoonError) as caught:
        geotiff.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    tiff.stores_floats(path)
    with pytest.raises(IcyMoonError):
        read_map(MapFile(path))


def many_tags(path: Path, tags: int = 4000) -> Path:
    """Each tag states two million bytes, all the same ones."""
    entries = b"".join(struct.pack("<HHII", 1000 + k, 1, 2_000_000, 8) for k in range(tags))
    path.write_bytes(
        struct.pack("<2sHI", b"II", 42, 2_000_008) + bytes(2_000_000) + struct.pack("<H", tags) + entries + bytes(4)
    )
    return path


def used_tags(path: Path) -> Path:
    """The same, of tags that are read."""
    data = made(dict.fromkeys(sorted(tiff._USED_TAGS), (1, 2000000, 16)), bytes(2_000_000))
    path.write_bytes(data)
    return path


def many_directories(path: Path) -> Path:
    """A thousand images, whose tags all name the same megabyte."""
    data = bytearray(struct.pack("<2sHI", b"II", 42, 10**6 + 8) + bytes(10**6))
    for _ in range(1000):
        data += struct.pack("<HHHII", 1, 42112, 2, 10**6, 8) + struct.pack("<I", len(data) + 18)
    path.write_bytes(data)
    return path


def many_keys(path: Path) -> Path:
    """65,000 GeoKeys, each of the same 65,000 letters, beside those that are used."""
    keys = struct.pack("<4H", 1, 1, 0, 65000) + b"".join(
        struct.pack("<4H", k, 34737, 65000, 0) for k in range(5000, 65000)
    )
    path.write_bytes(made(grey(t34735=(SHORT, len(keys) // 2, 80), t34737=(2, 65000, 80)), bytes(64) + keys))
    return path


def strips_of_one_place(path: Path) -> Path:
    """Strips that all are the same megabyte."""
    places = struct.pack("<4000I", *(16,) * 4000) + struct.pack("<4000I", *(10**6,) * 4000)
    path.write_bytes(
        made(
            grey(
                t256=(LONG, 1, 2500),
                t257=(LONG, 1, 400_000),
                t278=(LONG, 1, 100),
                t273=(LONG, 4000, 16 + 10**6),
                t279=(LONG, 4000, 16 + 10**6 + 16000),
            ),
            bytes(10**6) + places,
        )
    )
    return path


def unfolding(path: Path) -> Path:
    """Strips that unfold a thousandfold."""
    places = struct.pack("<40I", *(32 + 320,) * 40) + struct.pack("<40I", *(len(BOMB),) * 40)
    path.write_bytes(
        made(
            grey(
                t256=(LONG, 1, 2**14),
                t257=(LONG, 1, 2**15),
                t278=(LONG, 1, 820),
                t259=(SHORT, 1, 8),
                t273=(LONG, 40, 16),
                t279=(LONG, 40, 176),
            ),
            places + bytes(16) + BOMB,
        )
    )
    return path


def remembering(path: Path) -> Path:
    """LZMA with a dictionary of 3 GB."""
    packed = bytearray(lzma.compress(bytes(64), lzma.FORMAT_XZ, filters=[{"id": lzma.FILTER_LZMA2, "preset": 0}]))
    at = packed.index(b"\x21\x01") + 2
    packed[at] = 39  # of 3 GB; its checksum follows
    header = bytes(packed[12:20])
    packed[20:24] = struct.pack("<I", zlib.crc32(header))
    path.write_bytes(made(grey(t259=(SHORT, 1, 34925), t279=(LONG, 1, len(packed))), bytes(packed)))
    return path


def stating(path: Path) -> Path:
    """ZSTD with a frame that states 500 GB."""
    frame = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 500 * 10**9) + b"\x01\x00\x00"
    path.write_bytes(made(grey(t259=(SHORT, 1, 50000), t279=(LONG, 1, len(frame))), frame))
    return path


def nested(path: Path) -> Path:
    """Metadata that is nested a hundred thousand times."""
    return write_tiff(path, np.zeros((4, 4), "f4"), pixel=(1.0, 1.0), metadata="<a>" * 100_000 + "</a>" * 100_000)


def long_metadata(path: Path) -> Path:
    """Metadata of a million elements."""
    return write_tiff(path, np.zeros((4, 4), "f4"), pixel=(1.0, 1.0), metadata="<a>" + "<b/>" * 10**6 + "</a>")


@pytest.mark.ci_takes(5)
@pytest.mark.heavy
@pytest.mark.parametrize(
    "make",
    [
        many_tags,
        used_tags,
        many_directories,
        many_keys,
        strips_of_one_place,
        unfolding,
        remembering,
        stating,
        nested,
        long_metadata,
    ],
    ids=lambda make: make.__name__,
)
def test_little_memory_and_time_is_taken(tmp_path, make):
    path = make(tmp_path / "a.tif")
    ended = run_bounded(f"""
from pathlib import Path
from icymoon.support.errors import IcyMoonError
from icymoon.formats.geotiff import read
from icymoon.formats.tiff import stores_floats
from icymoon.stereo.datasets.data_files import MapFile, read_map
path = Path({str(path)!r})
for act in (read, stores_floats, lambda p: read_map(MapFile(p))):
    try:
        print("read", type(act(path)))
    except IcyMoonError as error:
        print("refused", error)
""")
    lines = ended.splitlines()
    assert len(lines) == 3
    if make not in (many_keys, nested):
        assert lines[0].startswith("refused"), lines


def test_what_is_no_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.tif")
    for path in (tmp_path / "pipe.tif", tmp_path, tmp_path / "absent.tif"):
        with pytest.raises(IcyMoonError, match="cannot be read"):
            geotiff.read(path)
        assert not tiff.stores_floats(path)


def foreign(path: Path) -> ForeignBytes:
    data = path.read_bytes()
    return ForeignBytes(data, len(data), Budget())


@pytest.mark.parametrize(
    "options",
    [
        {"tile": 16},
        {"tile": 16, "deflate": True, "predictor": 3},
        {"rows_per_strip": 7},
        {"rows_per_strip": 1},
        {},
        {"rows_per_strip": 7, "deflate": True, "predictor": 3},
        {"order": ">", "tile": 32},
    ],
    ids=str,
)
def test_a_window_is_a_cut_of_the_whole(tmp_path, options):
    values = np.random.default_rng(2).random((53, 71)).astype(np.float32)
    path = write_tiff(tmp_path / "a.tif", values, **options)
    random = np.random.default_rng(3)
    edges = [
        (range(53), range(71)),
        (range(1), range(1)),
        (range(52, 53), range(70, 71)),
        (range(16, 32), range(16, 32)),
        (range(15, 17), range(31, 33)),
    ]
    for _ in range(30):
        top, left = random.integers(0, 53), random.integers(0, 71)
        edges.append((range(top, random.integers(top, 53) + 1), range(left, random.integers(left, 71) + 1)))
    image = tiff.read_directories(foreign(path))[0]
    for rows, columns in edges:
        found, number = tiff.read_pixels(foreign(path), image, (rows, columns))
        assert np.array_equal(found, values[rows.start : rows.stop, columns.start : columns.stop])
        assert number.kind == "f"
    for rows, columns in ((range(54), range(3)), (range(3), range(72)), (range(0), range(3)), (range(-1, 3), range(3))):
        with pytest.raises(ValueError, match="no window"):
            tiff.read_pixels(foreign(path), image, (rows, columns))


@pytest.mark.parametrize("name", sorted(path.stem for path in DATA.glob("*.tif") if path.stem not in ("lerc",)))
def test_a_window_of_what_gdal_wrote_is_a_cut_of_the_whole(name):
    data = foreign(DATA / f"{name}.tif")
    image = tiff.read_directories(data)[0]
    whole, _ = tiff.read_pixels(data, image)
    rows, columns = range(1, whole.shape[0] - 1), range(2, whole.shape[1])
    found, _ = tiff.read_pixels(foreign(DATA / f"{name}.tif"), image, (rows, columns))
    assert np.array_equal(found, whole[1:-1, 2:], equal_nan=True)


@pytest.mark.heavy
def test_only_the_tiles_of_a_window_are_read(tmp_path):
    """Of a file of 64 GB, whose other tiles are holes on the disk."""
    side, tile = 131072, 4096
    count = (side // tile) ** 2
    size = tile * tile * 4
    start = 16 + 16 * count
    path = tmp_path / "large.tif"
    with path.open("wb") as stream:
        stream.write(struct.pack("<2sHHHQ", b"II", 43, 8, 0, start + count * size))
        stream.write(struct.pack(f"<{count}Q", *(start + k * size for k in range(count))))
        stream.write(struct.pack(f"<{count}Q", *(size,) * count))
        stream.seek(start + 33 * size)  # the second tile of the second row
        stream.write(np.arange(tile * tile, dtype="<f4").tobytes())
        stream.seek(start + count * size)
        tags = {
            256: (LONG, 1, side),
            257: (LONG, 1, side),
            258: (SHORT, 1, 32),
            259: (SHORT, 1, 1),
            277: (SHORT, 1, 1),
            322: (LONG, 1, tile),
            323: (LONG, 1, tile),
            324: (16, count, 16),
            325: (16, count, 16 + 8 * count),
            339: (SHORT, 1, 3),
        }
        stream.write(
            struct.pack("<Q", len(tags)) + b"".join(struct.pack("<HHQQ", t, *r) for t, r in tags.items()) + bytes(8)
        )
    ended = run_bounded(f"""
from pathlib import Path
from icymoon.formats import tiff
from icymoon.support.foreign_bytes import read
def parse(foreign):
    tiff.grant_memory(foreign)
    image = tiff.read_directories(foreign)[0]
    return tiff.read_pixels(foreign, image, (range(4100, 4103), range(4090, 4099)))[0]
print(read(Path({str(path)!r}), parse, "a TIFF file", "make it again", tiff.MAX_BYTES).tolist())
""")
    found = np.array(eval(ended))
    assert np.array_equal(found[:, :6], np.zeros((3, 6)))
    assert np.array_equal(found[:, 6:], np.arange(tile * tile, dtype="f4").reshape(tile, tile)[4:7, :3])


def test_a_geokey_of_text_is_refused(tmp_path):
    keys = struct.pack("<8H", 1, 1, 0, 1, 4096, 34737, 20, 0)
    (tmp_path / "a.tif").write_bytes(made(grey(t34735=(SHORT, 8, 80)), bytes(64) + keys))
    with pytest.raises(IcyMoonError, match="GeoKey 4096"):
        geotiff.read(tmp_path / "a.tif")


@pytest.mark.parametrize("seed", range(10))
def test_random_damage_is_a_sentence_or_heights(tmp_path, seed):
    random = np.random.default_rng(seed)
    names = sorted(path.name for path in DATA.glob("*.tif"))
    path = tmp_path / "a.tif"
    for k in range(100):
        data = bytearray((DATA / names[k % len(names)]).read_bytes())
        start = int.from_bytes(data[4:8], "little" if data[:2] == b"II" else "big")
        # Half of the damage in the first directory.
        low, high = (0, len(data)) if k % 2 or not 0 < start < len(data) else (start, min(len(data), start + 200))
        for at in random.integers(low, high, random.integers(1, 4)):
            data[at] = random.choice([0, 1, 127, 128, 255, random.integers(256)])
        path.write_bytes(data)
        tiff.stores_floats(path)
        with suppress(IcyMoonError):
            assert not np.isinf(geotiff.read(path).heights_m).any()
        with suppress(IcyMoonError):
            read_map(MapFile(path))


def test_a_bomb_is_refused_by_its_budget():
    data = made(grey(t256=(LONG, 1, 2**15), t257=(LONG, 1, 2**15), t278=(LONG, 1, 2**15), **SPARSE))
    source = ForeignBytes(data, len(data), Budget())
    with pytest.raises(tiff.UnreadError, match=r"32768 x 32768 pixels.*gdal_translate"):
        tiff.read_pixels(source, tiff.read_directories(source)[0])

"""Sizes of images before they are loaded, against files that libraries wrote, and files that state what cannot be."""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress

import cv2
import numpy as np
import OpenEXR
import pytest
from exr_files import attribute, exr, window
from icymoon.formats.image_size import check_pixels, count_pixels
from icymoon.formats.png import encode_png
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import Budget, ForeignBytes, OverBudgetError, RefusedError, parse_part
from icymoon.support.png_pixels import check_png
from tiffs import write_tiff

PICTURE = np.random.default_rng(0).integers(0, 255, (37, 53, 3), np.uint8)


def foreign(data: bytes) -> ForeignBytes:
    return ForeignBytes(data, len(data), Budget())


def count(data: bytes) -> int:
    return count_pixels(foreign(data))


def encoded(suffix: str, *options: int) -> bytes:
    values = PICTURE.astype(np.float32) if suffix == ".hdr" else PICTURE
    return cv2.imencode(suffix, values, options)[1].tobytes()


def targa(width: int, height: int, kind: int = 2, bits: int = 24) -> bytes:
    return struct.pack("<3B5x4x2H2B", 0, 0, kind, width, height, bits, 0) + bytes(3 * 53 * 37)


@pytest.mark.parametrize(
    "data",
    [
        encoded(".png"),
        encoded(".jpg"),
        encoded(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        encoded(".tif"),
        encoded(".webp"),
        encoded(".webp", cv2.IMWRITE_WEBP_QUALITY, 101),
        encoded(".bmp"),
        encoded(".hdr"),
        targa(53, 37),
    ],
    ids=["png", "jpg", "progressive", "tif", "webp", "webp lossless", "bmp", "hdr", "tga"],
)
def test_the_size_is_as_it_was_written(data):
    assert count(data) == 37 * 53


@pytest.mark.parametrize("tiled", [True, False])
def test_channels_of_an_exr_count(tmp_path, tiled):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage if tiled else OpenEXR.scanlineimage}
    if tiled:
        header["tiles"] = OpenEXR.TileDescription()
        header["tiles"].xSize = header["tiles"].ySize = 16
    for channels, times in ((1, 1), (4, 1), (5, 2), (9, 3)):
        OpenEXR.File(header, {f"c{k}": np.zeros((37, 53), np.float32) for k in range(channels)}).write(
            str(tmp_path / "a.exr")
        )
        assert count((tmp_path / "a.exr").read_bytes()) == times * 37 * 53


def test_a_tile_of_a_tiff_counts(tmp_path):
    data = write_tiff(tmp_path / "a.tif", np.zeros((9, 9), np.float32), tile=64).read_bytes()
    assert count(data) == 64 * 64


def head(width: int, height: int, bits: int = 16, colours: int = 0, *more: int) -> bytes:
    body = struct.pack(">2I5B", width, height, bits, colours, *(more or (0, 0, 0)))
    return part(b"IHDR", body)


def part(kind: bytes, body: bytes, length: int | None = None) -> bytes:
    return (
        struct.pack(">I", len(body) if length is None else length)
        + kind
        + body
        + struct.pack(">I", zlib.crc32(kind + body))
    )


START, END = b"\x89PNG\r\n\x1a\n", part(b"IEND", b"")
BAD = {
    "png of 0": START + head(0, 9) + END,
    "png of 2^31": START + head(2**31, 9) + END,
    "png cut in its head": (START + head(9, 9))[:20],
    "bmp of 0": b"BM" + bytes(12) + struct.pack("<I2i", 40, 0, 9),
    "bmp cut": b"BM" + bytes(9),
    "bmp of -2^31": b"BM" + bytes(12) + struct.pack("<I2i", 40, 9, -(2**31)),
    "bmp of negative width": b"BM" + bytes(12) + struct.pack("<I2i", 40, -9, 9),
    "webp of another kind": b"RIFF\0\0\0\0WEBPVP9 " + bytes(40),
    "webp cut": b"RIFF\0\0\0\0WEBPVP8X",
    "webp of 0": b"RIFF\0\0\0\0WEBPVP8 " + bytes(40),
    "hdr of no size": b"#?RADIANCE\n\n-Y x +X 9\n",
    "hdr without end": b"#?RADIANCE\n" + b"a" * 10**5,
    "hdr of 5000 digits": b"#?RGBE\n\n-Y " + b"9" * 5000 + b" +X 9\n",
    "hdr of three words": b"#?RGBE\n\n-Y 9 +X\n",
    "hdr of -9": b"#?RGBE\n\n-Y -9 +X -9\n",
    "tga of 0": targa(0, 9),
    "jpeg of one marker": b"\xff\xd8\xff",
    "jpeg without end": b"\xff\xd8" + b"\xff" * 1000,
    "jpeg of empty parts": b"\xff\xd8" + b"\xff\xe0\0\0" * 100,
    "jpeg of part 1": b"\xff\xd8\xff\xe0\0\1" + bytes(9),
    "jpeg cut": encoded(".jpg")[:100],
    "jpeg of many scans": encoded(".jpg") + b"\xff\xda" * 101,
    "jpeg of 0": b"\xff\xd8\xff\xc0\0\x11\x08\0\0\0\0" + bytes(20),
    "tiff cut": encoded(".tif")[:-30],
    "exr cut": exr()[:-1],
    "movie": b"\0\0\0\x20ftypisom" + bytes(100),
    "empty": b"",
    "text": b"# an image" * 9,
    "zeros": bytes(100),
    "jpeg 2000": b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(100),
    "psd": b"8BPS\0\1" + bytes(100),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_image_is_refused(name):
    def check(data: ForeignBytes) -> None:
        check_pixels(data, count_pixels(data), 2**26, "make it smaller")

    with pytest.raises(IcyMoonError) as caught:
        parse_part(BAD[name], "a", check, "an image", "give another")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "data",
    [
        START + head(30000, 20000) + bytes(3_500_000),
        targa(65535, 65535),
        b"#?RGBE\n\n-Y 30000 +X 30000\n",
        b"BM" + bytes(12) + struct.pack("<I2i", 40, 30000, -30000),
        b"BM" + bytes(12) + struct.pack("<I2H", 12, 65535, 65535),
        b"RIFF\0\0\0\0WEBPVP8X" + bytes(8) + b"\xff" * 6,
        b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff" + bytes(20),
        exr({b"dataWindow": attribute(b"dataWindow", b"box2i", window(0, 0, 10**8, 3))}),
    ],
    ids=["png", "tga", "hdr", "bmp", "os2 bmp", "webp", "jpeg", "exr"],
)
def test_more_pixels_than_the_file_can_be_of_are_refused(data):
    with pytest.raises(RefusedError, match=r"million pixels.*smaller\.$"):
        check_pixels(foreign(data), count(data), 2**26, "make it smaller")


def test_a_png_is_checked_to_its_end():
    whole = encode_png(PICTURE)
    found = check_png(foreign(whole))
    assert (found.width, found.height, found.bits, found.colours) == (53, 37, 8, 2)
    assert check_png(foreign(whole + b"more")) == found
    bad = (
        [whole[:length] for length in range(len(whole))]
        if len(whole) < 300
        else [whole[:length] for length in range(0, len(whole), 97)]
    )
    bad += [
        START + END,
        START + head(9, 9) * 2 + END,
        START + part(b"tEXt", b"a") + head(9, 9) + END,
        START + head(9, 9) + part(b"IDAT", b"", 2**32 - 1) + END,
        START + head(9, 9, 3) + END,
        START + head(9, 9, 16, 5) + END,
        START + head(9, 9, 16, 0, 1, 0, 0) + END,
        START + head(9, 9, 16, 0, 0, 0, 2) + END,
        START + part(b"IHDR", bytes(12)) + END,
        b"",
        whole[1:],
    ]
    for data in bad:
        with pytest.raises((ValueError, struct.error)):
            check_png(foreign(data))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".webp", ".bmp", ".hdr"])
def test_random_damage_is_a_size_or_an_error(suffix):
    random = np.random.default_rng(len(suffix))
    whole = encoded(suffix)
    for _ in range(300):
        data = bytearray(whole)
        for at in random.integers(0, min(len(data), 400), 3):
            data[at] = random.choice([0, 1, 127, 128, 255, random.integers(256)])
        with suppress(ValueError, KeyError, IndexError, struct.error, OverBudgetError):
            assert count(bytes(data)) > 0
        with suppress(ValueError, struct.error):
            check_png(foreign(bytes(data)))

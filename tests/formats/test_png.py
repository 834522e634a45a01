"""PNG files that are encoded here and decoded by OpenCV, and the reverse."""

from __future__ import annotations

import io
import zlib

import cv2
import numpy as np
import pytest
from icymoon.formats.png import encode_png
from icymoon.support.foreign_bytes import Budget, ForeignBytes, OverBudgetError, RefusedError
from icymoon.support.png_pixels import check_png, decode_png
from PIL import Image


def foreign(data: bytes, memory: int = 10**7) -> ForeignBytes:
    return ForeignBytes(data, len(data), Budget(memory))


def smooth(shape: tuple[int, ...], most: int) -> np.ndarray:
    """Waves with a little noise, for which an encoder chooses filters row by row."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    waves = (np.sin(x / 7) + np.cos(y / 5) + 2) / 4 + np.random.default_rng(2).uniform(0, 0.02, shape[:2])
    return (waves[..., None] * np.linspace(0.5, 0.9, shape[2]) * most).astype(np.uint16 if most > 255 else np.uint8)


@pytest.mark.parametrize("level", [0, 1, 9])
@pytest.mark.parametrize("size", [(1, 1), (7, 5), (31, 200)])
def test_they_are_what_was_encoded(size, level):
    picture = np.random.default_rng(1).integers(0, 256, (*size, 3), np.uint8)
    decoded = cv2.imdecode(np.frombuffer(encode_png(picture, level), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded[..., ::-1], picture)


@pytest.mark.parametrize("most", [255, 65535])
@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("strategy", [cv2.IMWRITE_PNG_STRATEGY_DEFAULT, cv2.IMWRITE_PNG_STRATEGY_RLE])
def test_opencvs_files_are_read_exactly(most, channels, strategy):
    picture = smooth((23, 31, channels), most)
    data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_STRATEGY, strategy])[1].tobytes()
    order = [0] if channels == 1 else [2, 1, 0, 3][:channels]
    np.testing.assert_array_equal(np.rint(decode_png(foreign(data)) * most), picture[..., order])


def test_rows_with_all_filters_are_read_exactly():
    picture = smooth((60, 90, 3), 255)
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG", optimize=True)
    rows = zlib.decompress(b"".join(_parts(stream.getvalue(), b"IDAT")))
    assert len({*rows[:: 1 + 3 * 90]}) > 2
    np.testing.assert_array_equal(np.rint(decode_png(foreign(stream.getvalue())) * 255), picture)


def _parts(data: bytes, wanted: bytes) -> list[bytes]:
    at, found = 8, []
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        found += [data[at + 8 : at + 8 + length]] if data[at + 4 : at + 8] == wanted else []
        at += 12 + length
    return found


def test_black_and_white_is_read():
    picture = smooth((9, 13, 1), 255)[..., 0] > 120
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG")
    assert check_png(foreign(stream.getvalue())).bits == 1
    np.testing.assert_array_equal(decode_png(foreign(stream.getvalue()))[..., 0], picture)


def test_a_palette_and_a_bomb_are_refused():
    stream = io.BytesIO()
    Image.fromarray(smooth((9, 13, 1), 255)[..., 0]).convert("P").save(stream, "PNG")
    with pytest.raises(RefusedError, match="palette"):
        decode_png(foreign(stream.getvalue()))
    with pytest.raises(OverBudgetError):
        decode_png(foreign(encode_png(np.zeros((2000, 2000), np.uint8)), 10**6))

"""Images that viewers show turned are taken as they are stored if the truth confirms that, and refused otherwise."""

from __future__ import annotations

import struct
import zlib

import cv2
import foreign
import numpy as np
import pytest
from icymoon.stereo.datasets.data_files import read_image, read_orientation
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.images.image_headers import parse_orientation
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")


def exif(orientation, order="<"):
    """EXIF data with one tag (CIPA DC-008, 4.6.4)."""
    return {"<": b"II", ">": b"MM"}[order] + struct.pack(f"{order}HIHHHIHHI", 42, 8, 1, 274, 3, 1, orientation, 0, 0)


def with_exif(kind, image, body):
    """The bytes of an image file with EXIF data."""
    data = cv2.imencode(kind, image, [cv2.IMWRITE_WEBP_QUALITY, 101] if kind == ".webp" else [])[1].tobytes()
    if kind == ".jpg":
        part = b"Exif\0\0" + body
        return data[:2] + b"\xff\xe1" + struct.pack(">H", len(part) + 2) + part + data[2:]
    if kind == ".png":
        chunk = struct.pack(">I", len(body)) + b"eXIf" + body + struct.pack(">I", zlib.crc32(b"eXIf" + body))
        return data[:33] + chunk + data[33:]
    body += b"\0" * (len(body) & 1)
    height, width = image.shape[:2]
    extended = (
        b"VP8X"
        + struct.pack("<I", 10)
        + b"\x08\0\0\0"
        + b"".join((size - 1).to_bytes(3, "little") for size in (width, height))
    )
    content = b"WEBP" + extended + data[12:] + b"EXIF" + struct.pack("<I", len(body)) + body
    return b"RIFF" + struct.pack("<I", len(content)) + content


def oriented(image, orientation):
    """The pixels that a viewer shows as ``image`` by this orientation."""
    return np.rot90(image, {3: 2, 6: 1}[orientation])


def folder(tmp_path, kind, orientation, images=None, truth=None):
    root = foreign.plain(tmp_path, 'disparity = "truth/{pair}.npy"', "", foreign.constant() if truth is None else truth)
    (root / "pairs.toml").write_text((root / "pairs.toml").read_text().replace(".png", kind))
    for eye, image in zip(("left", "right"), images or foreign.eyes(colour=True), strict=True):
        (root / eye / f"a{kind}").write_bytes(with_exif(kind, image, exif(orientation)))
    (source,) = find_sources([root])
    return source


@pytest.mark.parametrize("kind", [".jpg", ".png", ".webp"])
@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_the_orientation_is_found_and_pixels_are_as_stored(tmp_path, kind, orientation):
    image = np.repeat(foreign.eyes()[0][..., None], 3, axis=-1)
    path = tmp_path / f"a{kind}"
    path.write_bytes(with_exif(kind, image, exif(orientation)))
    assert read_orientation(path) == orientation
    assert np.abs(read_image(path).astype(int) - image).mean() < 3  # JPEG rounds


@pytest.mark.parametrize(
    "body",
    [b"", b"Exif\0\0", exif(9), exif(0), exif(6)[:20], b"XX" + exif(6)[2:], exif(6)[:4] + b"\xff" * 4 + exif(6)[8:]],
)
def test_data_without_an_orientation_turn_nothing(body):
    assert parse_orientation(body) == 1


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("mark", [b"", b"Exif\0\0"])
def test_both_orders_of_bytes_are_read(order, mark):
    assert parse_orientation(mark + exif(6, order)) == 6


@pytest.mark.parametrize("kind", [".jpg", ".png", ".webp"])
@pytest.mark.parametrize("orientation", [3, 6])
def test_a_truth_of_the_shown_image_is_not_held_against_the_stored_one(tmp_path, kind, orientation):
    images = [np.ascontiguousarray(oriented(image, orientation)) for image in foreign.eyes(colour=True)]
    with pytest.raises(
        IcyMoonError,
        match=rf"left/a.{kind[1:]} states the EXIF orientation {orientation}, .*"
        "save it turned, as mogrify -auto-orient",
    ):
        folder(tmp_path / "tagged", kind, orientation, images).prepare({})
    prepared = folder(tmp_path / "turned", kind, 1).prepare({})  # the fix works
    assert len(prepared.facts["notes"]) == 1


@pytest.mark.parametrize("orientation", [3, 6])
def test_a_truth_that_confirms_the_stored_pixels_is_taken_with_a_note(tmp_path, orientation):
    prepared = folder(tmp_path, ".jpg", orientation).prepare({})
    assert np.isfinite(prepared.truth).all()
    assert "EXIF orientation" in prepared.facts["notes"][1]
    assert prepared.facts["warnings"] == []


def test_images_that_do_not_tell_do_not_confirm(tmp_path):
    grey = [np.full((foreign.HEIGHT, foreign.WIDTH, 3), 90, np.uint8)] * 2
    with pytest.raises(IcyMoonError, match="states the EXIF orientation 3"):
        folder(tmp_path / "tagged", ".png", 3, grey).prepare({})
    assert folder(tmp_path / "untagged", ".png", 1, grey).prepare({}).left.shape == grey[0].shape


def test_a_turned_tiff_is_refused(tmp_path):
    image = foreign.eyes()[0]
    for orientation in (1, 3):
        tags = {
            256: foreign.WIDTH,
            257: foreign.HEIGHT,
            258: 8,
            259: 1,
            262: 1,
            273: 200,
            274: orientation,
            277: 1,
            278: foreign.HEIGHT,
            279: image.size,
        }
        entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
        start = b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4)
        (tmp_path / f"{orientation}.tif").write_bytes(start.ljust(200, b"\0") + image.tobytes())
    np.testing.assert_array_equal(read_image(tmp_path / "1.tif"), image)
    with pytest.raises(IcyMoonError, match=r"3.tif: states the orientation 3, by which some programs turn it"):
        read_image(tmp_path / "3.tif")

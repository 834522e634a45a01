"""PNG, JPEG, PFM and NumPy files, written atomically."""

from __future__ import annotations

import io
import math
import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from ...errors import IcyMoonError
from ...files import write_atomically

_PNG = b"\x89PNG\r\n\x1a\n"
#: Of an npz: half the time of numpy's own level, 6, for a fifth more bytes.
_LEVEL = 4
_PFM = re.compile(rb"P([fF])\s+(\d{1,6})\s+(\d{1,6})\s+([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s")  # width, height, scale


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    write_atomically(path, lambda part: _fill(part, content))


def _fill(part: Path, content: bytes) -> None:
    part.write_bytes(content)


def write_png(path: Path, image: np.ndarray) -> None:
    """Write uint8 or uint16 grey (H, W) or BGR (H, W, 3) as PNG, atomically."""
    write_bytes(path, encoded(image, ".png"))


def encoded(image: np.ndarray, suffix: str, quality: int = 85) -> bytes:
    """The bytes of an image file of the format ``suffix``; ``quality`` is that of a JPEG."""
    parameters = [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else []
    return bytes(cv2.imencode(suffix, image, parameters)[1].tobytes())


def read_png(path: Path) -> np.ndarray:
    """A PNG file as uint8 or uint16, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).

    Raises IcyMoonError if it is missing, not a PNG, or damaged; OpenCV would fill a truncated image with black.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise IcyMoonError(f"{path} cannot be read ({error.strerror}); give an existing PNG image.") from None
    if not content.startswith(_PNG):
        raise IcyMoonError(f"{path} is not a PNG image; convert it to PNG.")
    if not _is_whole(content):
        raise IcyMoonError(f"{path} is damaged or incomplete; make it again.")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise IcyMoonError(f"{path} cannot be decoded ({error.err}); make it again.") from None
    if image is None:
        raise IcyMoonError(f"{path} cannot be decoded; make it again.")
    return image


def read_pfm(path: Path, colours: bool = False) -> np.ndarray:
    """A grey PFM file as float32 (H, W), or with ``colours`` any as (H, W) or (H, W, 3), top row first.

    The sign of its scale gives the byte order; values are not scaled. Raises IcyMoonError if it is missing, of another
    kind or damaged.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise IcyMoonError(f"{path} cannot be read ({error.strerror}); give an existing PFM image.") from None
    head = _PFM.match(content)
    if head is None or (head[1] == b"F" and not colours):
        raise IcyMoonError(f"{path} is not a grey PFM image; its first line must be Pf.")
    width, height, body = int(head[2]), int(head[3]), content[head.end():]
    shape = (height, width, 3) if head[1] == b"F" else (height, width)
    if len(body) != 4 * math.prod(shape):
        raise IcyMoonError(f"{path} is damaged or incomplete; make it again.")
    order = "<" if head[4].startswith(b"-") else ">"
    return np.frombuffer(body, f"{order}f4").reshape(shape)[::-1].astype(np.float32)


def _is_whole(content: bytes) -> bool:
    """Whether a PNG has all its chunks up to the end chunk, each with the right checksum."""
    place = len(_PNG)
    while place + 12 <= len(content):
        length = int.from_bytes(content[place:place + 4], "big")
        body = content[place + 4:place + 8 + length]
        checksum = content[place + 8 + length:place + 12 + length]
        if len(checksum) < 4 or zlib.crc32(body) != int.from_bytes(checksum, "big"):
            return False
        if body[:4] == b"IEND":
            return True
        place += 12 + length
    return False


def write_npy(path: Path, values: np.ndarray) -> None:
    """Write an array as npy, atomically."""
    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=False)
    write_bytes(path, stream.getvalue())


def write_disparity(path: Path, disparity: np.ndarray, arrays: Mapping[str, np.ndarray] | None = None,
                    **facts: float) -> None:
    """Write an npz with ``disparity`` (float32 px, NaN where invalid), named arrays and numbers, atomically."""
    values = {"disparity": disparity.astype(np.float32), **(arrays or {}),
              **{name: np.float64(value) for name, value in facts.items()}}
    # In memory first: on a full disk a zip file raises a second error when it is closed.
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as archive:
        for name, each in values.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(each), allow_pickle=False)
    write_bytes(path, stream.getvalue())

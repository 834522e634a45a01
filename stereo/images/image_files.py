"""Read and write PNG, JPEG, PFM and NumPy files; writes are atomic."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...support.arrays import Array
from ...support.files import write_bytes
from ...support.foreign_bytes import ForeignBytes, RefusedError, read
from .image_headers import MAX_IMAGE_BYTES, EncodedImage, check_size, parse_image, parse_png

#: Compression level of an npz: half the time of NumPy's own level, 6, for a fifth more bytes.
_NPZ_LEVEL = 4
#: Most pixels of a picture that this program wrote: the largest rig, with a colour bar below.
_MAX_OWN_PIXELS = 2**29
#: Bytes within which the header of a PFM ends, comments included, and bytes of one of its numbers.
_MAX_PFM_HEADER, _LONGEST_NUMBER = 4096, 24
_WHITESPACE = b" \t\r\n\v\f"
_MAKE_AGAIN = "make it again"
Decode = Callable[[EncodedImage], Array]


def write_png(path: Path, image: Array) -> None:
    """Write uint8 or uint16 grey (H, W) or BGR (H, W, 3) as PNG, atomically."""
    write_bytes(path, encode_image(image, ".png"))


def encode_image(image: Array, suffix: str, quality: int = 85) -> bytes:
    """Encode an image in the format ``suffix``; return the bytes of the file. ``quality`` is only for JPEG."""
    parameters = [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else []
    return bytes(cv2.imencode(suffix, image, parameters)[1].tobytes())


def decode_in_this_process(image: EncodedImage) -> Array:
    """Decode an image that Icy Moon wrote, by OpenCV in this process; return its pixels.

    Foreign images are decoded by ``bounded_decoding.decode``. Raises ValueError if the image is damaged.
    """
    try:
        pixels = cv2.imdecode(np.frombuffer(image.content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(error.err) from None
    if pixels is None:
        raise ValueError("its pixels cannot be decoded")
    return pixels


def read_png(path: Path, decode: Decode | None = None) -> Array:
    """Read a PNG file as uint8 or uint16, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).

    ``decode`` must be ``bounded_decoding.decode`` for foreign files. Raises IcyMoonError if the file is missing, not a
    PNG, damaged (OpenCV would fill a truncated image with black), or too large.
    """
    most = None if decode else _MAX_OWN_PIXELS
    return read(
        path,
        lambda foreign: (decode or decode_in_this_process)(parse_png(foreign, most)),
        "a whole PNG image",
        _MAKE_AGAIN,
        memory=MAX_IMAGE_BYTES if decode else 8 * _MAX_OWN_PIXELS,
    )


def read_picture(path: Path) -> Array:
    """Decode a PNG, JPEG or WebP file, as ``read_png`` does. Raises IcyMoonError for other, damaged and too large
    files."""
    return read(
        path,
        lambda foreign: decode_in_this_process(parse_image(foreign)),
        "a whole image",
        _MAKE_AGAIN,
        memory=MAX_IMAGE_BYTES,
    )


def read_pfm(path: Path, colours: bool = False) -> Array:
    """Read a grey PFM file as float32 (H, W), or with ``colours`` any PFM as (H, W) or (H, W, 3), top row first.

    The sign of its scale gives the byte order; values are not scaled. Raises IcyMoonError if it is missing, of another
    kind, damaged or too large.
    """
    return read(
        path, lambda foreign: parse_pfm(foreign, colours), "a whole PFM image", _MAKE_AGAIN, memory=MAX_IMAGE_BYTES
    )


def parse_pfm(foreign: ForeignBytes, colours: bool = False) -> Array:
    """Parse the values of a PFM file, see ``read_pfm``.

    Raises RefusedError for another kind of file and for an ambiguous one, ValueError if it is damaged.
    """
    head = foreign.part(0, min(foreign.size, _MAX_PFM_HEADER))
    kind = head[:2]
    if kind not in ((b"Pf", b"PF") if colours else (b"Pf",)):
        raise RefusedError("is not a grey PFM image; its first line must be Pf.")
    words, end = [], 2
    for _ in range(3):
        start = _skip_spaces(head, end)
        end = next((at for at in range(start, len(head)) if head[at] in _WHITESPACE), len(head))
        if start == end or end - start > _LONGEST_NUMBER or not start > 2:
            raise ValueError("its header has no width, height and scale")
        words.append(head[start:end])
    if not (words[0].isdigit() and words[1].isdigit()):
        raise ValueError("its width and height are not whole numbers")
    width, height = int(words[0]), int(words[1])
    if not math.isfinite(float(words[2])) or not set(words[2]) <= set(b"+-.eE0123456789"):
        raise ValueError("its scale is not a number")
    shape = (height, width, 3) if kind == b"PF" else (height, width)
    count = 4 * check_size(width, height) * (3 if kind == b"PF" else 1)
    body = foreign.cursor(_find_pfm_body(foreign, head, end, count), foreign.budget.charge(count, "pixels"))
    values = body.numbers("<f4" if words[2].startswith(b"-") else ">f4", count // 4)
    return values.reshape(shape)[::-1].astype(np.float32)


def _skip_spaces(head: bytes, at: int) -> int:
    """Return the offset of the next word of a header; lines that begin with # are comments."""
    while at < len(head):
        if head[at] in _WHITESPACE:
            at += 1
        elif head[at : at + 1] == b"#" and head[at - 1 : at] in (b"\r", b"\n"):
            at = head.find(b"\n", at) + 1 or len(head)
        else:
            break
    return at


def _find_pfm_body(foreign: ForeignBytes, head: bytes, end: int, count: int) -> int:
    """Find the offset at which the last ``count`` bytes of a PFM begin, from the size of the file.

    ``end`` is the end of the header's last word. After it comes one blank, or a line end with comments; sometimes a
    line end follows the body. Raises RefusedError if two offsets are possible, ValueError if no offset is.
    """
    last = foreign.part(max(0, foreign.size - 2), min(2, foreign.size))
    windows = head[2:4] == b"\r\n"  # lines end with "\r\n" from the first line on
    found = []
    for behind in (b"", b"\n", b"\r\n"):
        start = foreign.size - len(behind) - count
        if last.endswith(behind) and end < start <= len(head) and _is_header_gap(head[end:start], windows):
            found.append(start)
    if len(found) > 1:
        raise RefusedError(
            "can be read in two ways, as its lines end in two; write its header with one kind of line "
            "end, and nothing behind the pixels."
        )
    if not found:
        raise ValueError(f"{max(0, foreign.size - end - 1)} bytes follow its header, and its size needs {count}")
    return found[0]


def _is_header_gap(gap: bytes, windows: bool) -> bool:
    """Return whether bytes may separate the header of a PFM from its body. With Windows' line ends, a single carriage
    return is half of a line end.
    """
    if len(gap) == 1:
        return gap in (_WHITESPACE[k : k + 1] for k in range(len(_WHITESPACE))) and not (windows and gap == b"\r")
    first, newline, rest = gap.partition(b"\n")
    if not newline or first.strip(b" \t\r"):
        return False
    return not rest or (rest.endswith(b"\n") and all(line.startswith(b"#") for line in rest[:-1].split(b"\n")))


def write_npy(path: Path, values: Array) -> None:
    """Write an array as npy, atomically."""
    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=False)
    write_bytes(path, stream.getvalue())


def write_disparity(path: Path, disparity: Array, arrays: Mapping[str, Array] | None = None, **facts: float) -> None:
    """Write an npz with ``disparity`` (float32 px, NaN where invalid), named arrays and numbers, atomically."""
    values = {
        "disparity": disparity.astype(np.float32),
        **(arrays or {}),
        **{name: np.float64(value) for name, value in facts.items()},
    }
    write_npz(path, values)


def write_npz(path: Path, values: Mapping[str, Any]) -> None:
    """Write named arrays and numbers as npz, atomically."""
    # Written to memory first: on a full disk a zip file raises a second error when it is closed.
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=_NPZ_LEVEL) as archive:
        for name, each in values.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(each), allow_pickle=False)
    write_bytes(path, stream.getvalue())

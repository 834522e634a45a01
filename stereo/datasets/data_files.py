"""Reads images, maps of disparity or depth, and calibrations of foreign data.

Anyone may have made these files. So only files inside the data set are read, their size is checked before their pixels
are decoded, and nothing in them is run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...formats import tiff
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, RefusedError, parse_npy, parse_npz, read
from ..adapters.icymoon_serve import drop_single_axes
from ..images.bounded_decoding import decode, decode_exr
from ..images.exr_header import EXR_START, parse_channels
from ..images.image_files import parse_pfm, read_pfm
from ..images.image_headers import (
    MAX_IMAGE_BYTES,
    PNG_START,
    UPRIGHT,
    EncodedImage,
    check_size,
    parse_image,
    parse_png,
)
from ..images.image_values import to_8_bit
from .map_channels import choose_array, choose_channel, find_sibling_colours, find_stated_channel, refuse_picture

#: Most bytes of a text file.
MAX_TEXT_BYTES = 2**20
_NPY_START, _ZIP_START = b"\x93NUMPY", b"PK\x03\x04"
_TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_MAKE_AGAIN = "make it again"
#: Steps per pixel of 16-bit PNG files of disparities, as in KITTI.
PNG_STEPS_PER_PX = 256.0


@dataclass(frozen=True)
class MapFile:
    """A file with a disparity (px) or a depth (m) for each pixel.

    ``steps`` are the counts of the file per px or metre. None means 256 for a disparity in a 16-bit PNG, unknown for a
    PNG of 8 bits, and 1 otherwise. With ``along_ray``, depths are distances from the eye; else they lie along the
    optical axis. Infinity and NaN mean unknown, and so does zero unless ``zero_is_unknown`` is false.
    """

    path: Path
    kind: str = "disparity"  # or "depth"
    steps: float | None = None
    along_ray: bool = False
    sintel: bool = False  # coded in three bytes, as in Sintel
    predicted: bool = False  # the result of a method; no file states its steps
    channel: str | None = None  # the channel of an EXR file, or the array of an npz, that has the map
    zero_is_unknown: bool = True  # false for a map of other numbers, such as a confidence


def resolve_inside(root: Path, name: str | Path) -> Path:
    """Return the path of the file ``name`` in the folder ``root``. It may not be a regular file.

    Raises IcyMoonError for a path outside ``root``.
    """
    path = root / name
    try:
        inside = path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError):  # a link that leads to itself
        return path
    except ValueError:
        raise IcyMoonError(f"{root} names a file with characters that a path cannot have; write another.") from None
    if not inside:
        raise IcyMoonError(f"{path} is outside of {root}, and only files in a data set are read; copy it there.")
    return path


def read_text(path: Path) -> str:
    """Read the content of a text file. Raises IcyMoonError if it is missing, too large, or not text."""
    return read(path, ForeignBytes.text, "a text file", "save it as UTF-8", MAX_TEXT_BYTES)


def read_image(path: Path) -> Array:
    """Read a PNG, JPEG, TIFF or WebP image as uint8, grey (H, W) or BGR (H, W, 3); 16 bits are scaled down.

    Raises IcyMoonError if the file is missing, damaged, too large or of another kind.
    """
    image = read(path, _decode_image, "a whole image", _MAKE_AGAIN, memory=MAX_IMAGE_BYTES)
    if image.ndim == 3:
        image = image[..., :3]  # drops the opacity
    image = to_8_bit(image)
    if image.dtype != np.uint8:
        raise IcyMoonError(f"{path} has values of type {image.dtype}; save it with 8 or 16 bits per value.")
    return image


def read_orientation(path: Path) -> int:
    """Read the EXIF orientation, 1 to 8, by which viewers rotate a PNG, JPEG or WebP image; ``read_image`` ignores it.

    Raises IcyMoonError as ``read_image`` does.
    """
    return read(path, _parse_image, "a whole image", _MAKE_AGAIN, memory=MAX_IMAGE_BYTES).orientation


def _parse_image(foreign: ForeignBytes) -> EncodedImage:
    is_tiff = foreign.part(0, min(4, foreign.size)) in _TIFF_STARTS
    return _parse_tiff_image(foreign) if is_tiff else parse_image(foreign)


def _decode_image(foreign: ForeignBytes) -> Array:
    return decode(_parse_image(foreign))


def _parse_tiff_image(foreign: ForeignBytes) -> EncodedImage:
    image = tiff.read_directories(foreign)[0]
    orientation = image.number(274, UPRIGHT)
    if orientation != UPRIGHT:
        raise RefusedError(
            f"states the orientation {orientation}, by which some programs turn it and others do not; "
            "save it as PNG, as the calibration has it."
        )
    height, width = image.shape
    # OpenCV expands a palette to three bands, and widens small numbers.
    value_bytes = max(4, image.number(277, 1)) * max(1, -(-image.number(258, 8) // 8))
    most = foreign.budget.charge(check_size(width, height) * value_bytes, "pixels")
    return EncodedImage(foreign.content(), width, height, most)


def read_radiance(path: Path) -> Array:
    """Read a PFM image as the mean of its bands, float64 (H, W), with 0 in place of NaN and infinity."""
    values = np.nan_to_num(read_pfm(path, colours=True).astype(np.float64), posinf=0.0)
    return values if values.ndim == 2 else np.asarray(values.mean(axis=-1))


def read_map(file: MapFile) -> Array:
    """Read a map as float64 (H, W), NaN where unknown; negative numbers stay.

    The file is a PFM, PNG, npy, npz, OpenEXR or TIFF. Raises IcyMoonError if it is missing, damaged, too large or
    contains no map.
    """
    if file.sintel:
        values, usual = _read_sintel_disparity(file.path), 1.0
    else:
        values, usual = read(
            file.path, lambda foreign: _parse_map(foreign, file), "a whole map", _MAKE_AGAIN, memory=MAX_IMAGE_BYTES
        )
    if values.ndim != 2:
        raise IcyMoonError(f"{file.path} has the shape {values.shape}; give one number per pixel, rows and columns.")
    values = values.astype(np.float64)
    values /= usual if file.steps is None else file.steps
    values[~np.isfinite(values) | ((values == 0) & file.zero_is_unknown)] = np.nan
    return values


def _parse_map(foreign: ForeignBytes, file: MapFile) -> tuple[Array, float]:
    """Return the numbers of a file, and the usual steps per px or metre in its format."""
    start = foreign.part(0, min(32, foreign.size))
    if start.startswith(EXR_START):
        return _parse_exr_map(foreign, file), 1.0
    if file.channel and not start.startswith(_ZIP_START):
        raise RefusedError("has no channels with names, and truth.channel in pairs.toml states one; leave it out.")
    if start.startswith(PNG_START):
        return _read_png_numbers(
            decode(parse_png(foreign)), file
        ), PNG_STEPS_PER_PX if file.kind == "disparity" else 1.0
    if start.startswith((b"Pf", b"PF")):
        return parse_pfm(foreign), 1.0
    if start.startswith((_NPY_START, _ZIP_START)):
        values = drop_single_axes(
            parse_npy(foreign, "fiu") if start.startswith(_NPY_START) else _parse_npz_map(foreign, file)
        )
        if values.ndim == 2:
            check_size(values.shape[1], values.shape[0])
        return values, 1.0
    if start.startswith(_TIFF_STARTS):
        return _parse_tiff_map(foreign), 1.0
    raise RefusedError(f"is not a supported map; save it as PFM, npy, EXR, TIFF or {_describe_png_encoding(file)}.")


def _describe_png_encoding(file: MapFile) -> str:
    """Describe the encoding of a map in a PNG."""
    return (
        "16-bit PNG of 256 steps per px"
        if file.kind == "disparity"
        else "16-bit PNG with its steps per metre as truth.steps in pairs.toml"
    )


def _read_png_numbers(image: Array, file: MapFile) -> Array:
    """Return the numbers of a PNG. Raises RefusedError if the PNG may be an ordinary picture.

    A PNG of 8 bits needs a number of steps from the user.
    """
    if image.ndim != 2:
        raise RefusedError(
            f"is a picture, not a map: it has colours; write one number per pixel, as PFM or "
            f"{_describe_png_encoding(file)}."
        )
    if image.dtype == np.uint8 and file.steps is None:
        raise RefusedError(
            "is a picture, not a map, unless its steps are stated; "
            + (
                "write 256 steps per px with 16 bits, or PFM."
                if file.predicted
                else f"state its steps per {'px' if file.kind == 'disparity' else 'metre'} as truth.steps in "
                "pairs.toml."
            )
        )
    return image


def _read_sintel_disparity(path: Path) -> Array:
    """Read the disparity of a Sintel PNG, whose R, G and B are its three digits: 4, 1/64 and 1/16384 px."""
    image = read_image(path)
    if image.ndim != 3:
        raise IcyMoonError(f"{path} has no colours, but Sintel stores disparities as colours; download it again.")
    blue, green, red = (image[..., k].astype(np.float64) for k in range(3))
    return np.asarray(4 * red + green / 64 + blue / 16384)


def _parse_exr_map(foreign: ForeignBytes, file: MapFile) -> Array:
    channels = parse_channels(foreign)
    names = [channel.full_name for channel in channels]
    name = (
        find_stated_channel(names, file.channel) if file.channel else choose_channel(names, file.kind, file.predicted)
    )

    def decode_channel(name: str) -> Array:
        return decode_exr(file.path, channels[names.index(name)], foreign.budget.most - foreign.budget.left)

    found = decode_channel(name)
    for colour in () if file.channel else find_sibling_colours(name, names):
        if not np.array_equal(decode_channel(colour), found, equal_nan=True):
            refuse_picture(name, names, file.kind, file.predicted)
    return found


def _parse_npz_map(foreign: ForeignBytes, file: MapFile) -> Array:
    """Return the array of an npz named by ``truth.channel``, else by the map's kind, else its only array."""
    wanted = file.channel or file.kind
    found = parse_npz(foreign, {wanted}, "fiu") or parse_npz(foreign, kinds="fiu")
    names = list(found)
    return found[
        find_stated_channel(names, file.channel) if file.channel else choose_array(names, file.kind, file.predicted)
    ]


def _parse_tiff_map(foreign: ForeignBytes) -> Array:
    tiff.grant_memory(foreign)
    image = tiff.read_directories(foreign)[0]
    height, width = image.shape
    check_size(width, height)
    try:
        return tiff.read_pixels(foreign, image)[0]
    except tiff.UnreadError as error:
        fix = "" if ";" in str(error) else "; save it with one number per pixel."
        raise RefusedError(f"{error}{fix}") from None


def read_fields(path: Path, separator: str) -> dict[str, str]:
    """Read the lines ``key=value`` or ``key: value`` of a calibration.

    Raises IcyMoonError if the file cannot be read.
    """
    found = {}
    for line in read_text(path).splitlines():
        key, there, value = line.partition(separator)
        if there:
            found[key.strip()] = value.strip()
    return found


def read_numbers(path: Path, fields: dict[str, str], key: str, count: int) -> Sequence[float]:
    """Read the ``count`` numbers in a field of a calibration.

    Raises IcyMoonError if the field is missing or has another number of them.
    """
    if key not in fields:
        raise IcyMoonError(f"{path} has no {key}, which is needed to convert disparities to depths; add it.")
    try:
        values = [float(word) for word in fields[key].replace("[", " ").replace("]", " ").replace(";", " ").split()]
    except ValueError:
        values = []
    if len(values) != count or not all(np.isfinite(values)):
        what = "a number" if count == 1 else f"{count} numbers"
        raise IcyMoonError(f"{path}: {key} is {fields[key][:60]!r}, not {what}; correct it.")
    return values

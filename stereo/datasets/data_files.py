"""Reading images, maps of disparity or depth, and calibrations of foreign data.

Anyone may have made these files. So a file is read only if it lies in its data set, its size is checked before its
pixels are decoded, and nothing in it is run.
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...errors import IcyMoonError
from ...formats.tiff import UnreadError, read_directories, read_pixels
from ..adapters.icymoon_serve import drop_single_axes
from ..images.exr import silence_openexr
from ..images.image_files import read_pfm, read_png
from ..images.image_values import to_8_bit

#: Most pixels of an image, and bytes of a file and of a text: eight times the largest images of Middlebury.
MOST_PIXELS, MOST_BYTES, MOST_TEXT = 2**26, 2**30, 2**20
_PNG, _JPEG, _NPY, _ZIP, _EXR = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"\x93NUMPY", b"PK\x03\x04", b"\x76\x2f\x31\x01"
_TIFFS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
#: Channels of an EXR file that hold a map, the likeliest first; others only if the file has a single one.
_CHANNELS = ("disparity", "depth", "Z", "Y", "V", "R")
#: Steps per pixel of 16-bit PNG files of disparities, after KITTI.
PNG_STEPS = 256.0


@dataclass(frozen=True)
class MapFile:
    """A file with a disparity (px) or a depth (m) for each pixel.

    ``steps`` are what the file counts per px or metre; None is 256 for a disparity in a 16-bit PNG, and 1 otherwise.
    ``along_ray``: depths are distances from the eye instead of along the optical axis. Zero, infinity and NaN mean
    unknown.
    """

    path: Path
    kind: str = "disparity"  # or "depth"
    steps: float | None = None
    along_ray: bool = False
    sintel: bool = False  # coded in three bytes, as Sintel has it


def find_inside(root: Path, name: str | Path) -> Path:
    """The file ``name`` in the folder ``root``. Raises IcyMoonError if it is missing, no file, or outside."""
    path = root / name
    if not path.resolve().is_relative_to(root.resolve()):
        raise IcyMoonError(f"{path} is outside of {root}, and only files in a data set are read; copy it there.")
    if not path.is_file():
        raise IcyMoonError(f"{path} is missing; add it, or give another folder.")
    return path


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a file. Raises IcyMoonError if it is missing or too large."""
    try:
        _check_bytes(path, most)
        return path.read_bytes()
    except OSError as error:
        raise IcyMoonError(f"{path} cannot be read ({error.strerror or error}); give an existing file.") from None


def read_text(path: Path) -> str:
    """The content of a text file. Raises IcyMoonError if it is missing, too large, or no text."""
    try:
        return read_bytes(path, MOST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise IcyMoonError(f"{path} is not a text file; save it as UTF-8.") from None


def _check_size(path: Path, width: int, height: int) -> None:
    if not (width > 0 and height > 0 and width * height <= MOST_PIXELS):
        raise IcyMoonError(f"{path} states {width} x {height} px, and {MOST_PIXELS} pixels are the most that is read; "
                           "make it smaller.")


def read_image(path: Path) -> np.ndarray:
    """A PNG, JPEG or TIFF image as uint8, grey (H, W) or BGR (H, W, 3); 16 bits are scaled down.

    Raises IcyMoonError if it is missing, damaged, too large or of another kind.
    """
    start = _read_start(path)
    if start.startswith(_PNG):
        _check_size(path, *struct.unpack(">II", start[16:24]))
        image = read_png(path)
    elif start.startswith((_JPEG, *_TIFFS)):
        image = _read_photograph(path)
    else:
        raise IcyMoonError(f"{path} is no image that is read here; save it as PNG, JPEG or TIFF.")
    if image.ndim == 3:
        image = image[..., :3]  # without opacity
    image = to_8_bit(image)
    if image.dtype != np.uint8:
        raise IcyMoonError(f"{path} has values of type {image.dtype}; save it with 8 or 16 bits per value.")
    return image


def _read_photograph(path: Path) -> np.ndarray:
    content = read_bytes(path)
    damaged = IcyMoonError(f"{path} is damaged or incomplete; make it again.")
    try:
        if content.startswith(_JPEG):
            if b"\xff\xd9" not in content[-64:]:  # OpenCV would fill the rest with grey
                raise damaged
            _check_size(path, *_size_of_jpeg(content))
        else:
            height, width = read_directories(content)[0].shape
            _check_size(path, width, height)
    except (struct.error, KeyError, ValueError, IndexError):
        raise damaged from None
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        raise damaged from None
    if image is None:
        raise damaged
    return image


def _size_of_jpeg(content: bytes) -> tuple[int, int]:
    """Width and height, from the frame header. Raises struct.error or ValueError if there is none."""
    at = 2
    while True:
        mark, kind, length = struct.unpack_from(">BBH", content, at)
        if mark != 0xff:
            raise ValueError("no marker")
        if 0xc0 <= kind <= 0xcf and kind not in (0xc4, 0xc8, 0xcc):
            height, width = struct.unpack_from(">HH", content, at + 5)
            return width, height
        at += 2 + length


def read_radiance(path: Path) -> np.ndarray:
    """A PFM image, grey or in colours, as the mean of its bands, float64 (H, W), 0 where it is no number."""
    _check_bytes(path)
    values = np.nan_to_num(read_pfm(path, colours=True).astype(np.float64), posinf=0.0)
    return values if values.ndim == 2 else np.asarray(values.mean(axis=-1))


def read_map(file: MapFile) -> np.ndarray:
    """A map as float64 (H, W), NaN where unknown; numbers below zero stay.

    Reads PFM, 16-bit PNG, npy, npz, OpenEXR and TIFF. Raises IcyMoonError if the file is missing, damaged, too large
    or holds no map.
    """
    start = _read_start(file.path)
    if file.sintel:
        values, usual = _read_sintel(file.path), 1.0
    elif start.startswith(_PNG):
        _check_size(file.path, *struct.unpack(">II", start[16:24]))
        values, usual = _read_steps(file.path), PNG_STEPS if file.kind == "disparity" else 1.0
    else:
        values, usual = _read_numbers(file.path, start), 1.0
    if values.ndim != 2:
        raise IcyMoonError(f"{file.path} has the shape {values.shape}; give one number per pixel, rows and columns.")
    values = values.astype(np.float64) / (usual if file.steps is None else file.steps)
    values[~np.isfinite(values) | (values == 0)] = np.nan
    return values


def _read_start(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(32).ljust(32, b"\0")
    except OSError as error:
        raise IcyMoonError(f"{path} cannot be read ({error.strerror or error}); give an existing file.") from None


def _read_steps(path: Path) -> np.ndarray:
    image = read_png(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise IcyMoonError(f"{path} is a picture, not a map: 16 bits and one channel are needed; write the numbers "
                           "themselves, as 256 steps per px.")
    return image


def _read_sintel(path: Path) -> np.ndarray:
    """R, G and B are the three digits of the disparity, of 4, 1/64 and 1/16384 px."""
    image = read_image(path)
    if image.ndim != 3:
        raise IcyMoonError(f"{path} has no colours, in which Sintel codes disparities; download it again.")
    blue, green, red = (image[..., k].astype(np.float64) for k in range(3))
    return np.asarray(4 * red + green / 64 + blue / 16384)


def _read_numbers(path: Path, start: bytes) -> np.ndarray:
    if start.startswith((b"Pf", b"PF")):
        _check_bytes(path)
        return read_pfm(path)
    if start.startswith(_EXR):
        return _read_exr(path)
    if start.startswith((_NPY, _ZIP)):
        return _without_single_axes(path, _read_numpy(path, start))
    if start.startswith(_TIFFS):
        return _read_tiff(path)
    raise IcyMoonError(f"{path} is no map that is read here; save it as PFM, 16-bit PNG, npy, EXR or TIFF.")


def _check_bytes(path: Path, most: int = MOST_BYTES) -> None:
    """Raise IcyMoonError if a file is too large to be read."""
    size = path.stat().st_size
    if size > most:
        raise IcyMoonError(f"{path} has {size} bytes, and {most} are the most that is read; make it smaller.")


def _read_exr(path: Path) -> np.ndarray:
    import OpenEXR

    _check_bytes(path)
    try:
        with silence_openexr():
            head = OpenEXR.File(str(path), separate_channels=True, header_only=True)
            low, high = head.header()["dataWindow"]
        _check_size(path, int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
        with silence_openexr():
            parts = OpenEXR.File(str(path), separate_channels=True).parts
            channels = {name: channel.pixels for part in parts for name, channel in part.channels.items()}
    except IcyMoonError:
        raise
    except Exception as error:  # the binding raises RuntimeError, ValueError and its own types
        raise IcyMoonError(f"{path} is not a readable EXR file ({error}); make it again.") from None
    if len(channels) == 1:
        return np.asarray(next(iter(channels.values())))
    wanted = (name for word in _CHANNELS for name in channels if name.split(".")[-1] == word)
    name = next(wanted, None)
    if name is None:
        raise IcyMoonError(f"{path} has the channels {', '.join(channels) or 'none'}; name the one with the map Z.")
    return np.asarray(channels[name])


def _read_numpy(path: Path, start: bytes) -> np.ndarray:
    try:
        if start.startswith(_ZIP):
            return _read_npz(path)
        values = np.load(path, mmap_mode="r", allow_pickle=False)  # which no header can make larger than the file
        if values.size > MOST_PIXELS:
            _check_size(path, values.shape[-1], values.size // values.shape[-1])
    except IcyMoonError:
        raise
    except Exception as error:  # with a damaged header numpy may raise anything
        raise IcyMoonError(f"{path} is damaged or no array of numbers ({error}); make it again.") from None
    return _checked_numbers(path, values)


def _read_npz(path: Path) -> np.ndarray:
    """The array ``disparity`` of an npz, or its only one."""
    with path.open("rb") as stream, zipfile.ZipFile(stream) as archive:
        names = [info.filename for info in archive.infolist()]
        name = "disparity.npy" if "disparity.npy" in names else names[0] if len(names) == 1 else None
        if name is None:
            raise IcyMoonError(f"{path} contains the arrays {', '.join(names)}; give one, or call it disparity.")
        if archive.getinfo(name).file_size > 8 * MOST_PIXELS + 2**12:
            raise IcyMoonError(f"{path} contains more than {MOST_PIXELS} numbers; make it smaller.")
        member = io.BytesIO(archive.read(name))
    # numpy makes room for what the header states before it reads.
    header = (np.lib.format.read_array_header_1_0 if np.lib.format.read_magic(member) == (1, 0)
              else np.lib.format.read_array_header_2_0)
    if math.prod(header(member)[0]) > MOST_PIXELS:
        raise IcyMoonError(f"{path} states more than {MOST_PIXELS} numbers; make it smaller.")
    member.seek(0)
    return _checked_numbers(path, np.lib.format.read_array(member, allow_pickle=False))


def _checked_numbers(path: Path, values: Any) -> np.ndarray:
    if values.dtype.kind not in "fiu":
        raise IcyMoonError(f"{path} has values of type {values.dtype}; give numbers.")
    return np.asarray(values)


def _without_single_axes(path: Path, values: np.ndarray) -> np.ndarray:
    values = drop_single_axes(values)
    if values.ndim == 2:
        _check_size(path, values.shape[1], values.shape[0])
    return values


def _read_tiff(path: Path) -> np.ndarray:
    content = read_bytes(path)
    try:
        image = read_directories(content)[0]
        height, width = image.shape
        _check_size(path, width, height)
        return read_pixels(content, image)[0]
    except UnreadError as error:
        raise IcyMoonError(f"{path}: it {error}") from None
    except (struct.error, zlib.error, KeyError, IndexError, ValueError, TypeError, OverflowError, EOFError) as error:
        raise IcyMoonError(f"{path} is not a whole TIFF file ({error}); make it again.") from None


def read_fields(path: Path, separator: str) -> dict[str, str]:
    """The lines ``key=value`` or ``key: value`` of a calibration. Raises IcyMoonError if it cannot be read."""
    found = {}
    for line in read_text(path).splitlines():
        key, there, value = line.partition(separator)
        if there:
            found[key.strip()] = value.strip()
    return found


def numbers_of(path: Path, fields: dict[str, str], key: str, count: int) -> Sequence[float]:
    """The numbers in a field of a calibration. Raises IcyMoonError if it is missing or has another number of them."""
    if key not in fields:
        raise IcyMoonError(f"{path} has no {key}, without which disparities give no depths; add it.")
    try:
        values = [float(word) for word in fields[key].replace("[", " ").replace("]", " ").replace(";", " ").split()]
    except ValueError:
        values = []
    if len(values) != count or not all(np.isfinite(values)):
        what = "a number" if count == 1 else f"{count} numbers"
        raise IcyMoonError(f"{path}: {key} is {fields[key][:60]!r}, not {what}; correct it.")
    return values

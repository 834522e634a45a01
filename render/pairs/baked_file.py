"""Files of baked light beside the pairs of a data set, shared by all workers and resumed runs. Imports no Blender.

A file is ``light/KEY-CONTENT.npz``: the key of the bake, and the first digits of the SHA-256 checksum of the file. So a
changed file no longer fits its name. Files of older versions have other names (``light/KEY.npz``) or other keys, and
are never read. A file contains numbers only. A link, a file without the content that its key asks for, and a file with
an unexpected checksum count as absent.
"""

from __future__ import annotations

import hashlib
import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics.light.baked_rocks import TERM_COUNT
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import write_bytes
from ...support.foreign_bytes import ForeignBytes, parse_npz, parse_part, read_regular
from .dataset_file_names import check_no_link

#: Folder for baked light in a data set.
LIGHT = "light"
_FILE_NAME = re.compile(r"([0-9a-f]{12})(?:-([0-9a-f]{12}))?\.npz")
_CONTENT_DIGITS = 12
_NUMBER_MEMBERS = ("noise", "share", "samples")
_ARRAY_MEMBERS = ("key", "values", "error", "rocks")
#: Bytes of a file without its values: the headers of members and of their arrays.
_HEADER_BYTES = 2**16


@dataclass(frozen=True)
class BakedLight:
    """Indirect irradiance over pi at the vertices of a ground, (n, 3) float32, W/(m² sr) in the bands R, G, B.

    ``error`` (n,) float32 is half the difference of two bakes with half the samples each, for the mean of the bands; it
    has the same variance as the error of ``values``. ``rocks`` (rocks, terms, 3) float32 are the terms of
    ``physics.light.baked_rocks`` for the same light on rocks. ``noise`` is the standard error over the mean, from the
    same two bakes of the ``samples``. ``share`` is the mean of ``values`` over the mean of all light at the vertices.
    ``cpu_seconds`` is the processor time of the bake, which is absent from files.
    """

    values: Array
    error: Array
    rocks: Array
    noise: float
    share: float
    samples: int
    cpu_seconds: float


def make_file_name(key: str, checksum: str) -> str:
    """Make the name of a file of baked light with this key and SHA-256 checksum."""
    return f"{key}-{checksum[:_CONTENT_DIGITS]}.npz"


def parse_name(name: str) -> tuple[str, str] | None:
    """Parse the key and the checksum's first digits from a file's name; the digits are empty in older names.

    None if it is not the name of a file of baked light.
    """
    found = _FILE_NAME.fullmatch(name)
    return (found[1], found[2] or "") if found else None


def encode_baked_light(key: str, light: BakedLight) -> bytes:
    """Encode baked light as the content of a file: equal light gives equal bytes."""
    stream = io.BytesIO()
    numbers = {name: np.float64(getattr(light, name)) for name in _NUMBER_MEMBERS}
    np.savez_compressed(
        stream,
        key=np.array(key, "S12"),
        values=light.values.astype("<f4"),
        error=light.error.astype("<f4"),
        rocks=light.rocks.astype("<f4"),
        **numbers,
    )
    return stream.getvalue()


def write_baked_light(dataset: Path, key: str, light: BakedLight) -> tuple[Path, str]:
    """Write baked light, whole or not at all, and return its file and SHA-256 checksum.

    An existing file with this content stays. Raises IcyMoonError if the disk refuses, or if the folder is a link.
    """
    data = encode_baked_light(key, light)
    checksum = hashlib.sha256(data).hexdigest()
    path = dataset / LIGHT / make_file_name(key, checksum)
    check_no_link(path.parent)
    if _read_unchanged(path, checksum, len(data)) is None:
        write_bytes(path, data)
    return path, checksum


def read_baked_light(path: Path, key: str, checksum: str, vertices: int, rocks: int = 0) -> BakedLight | None:
    """Read the baked light of a ground with this number of vertices and rocks; ``cpu_seconds`` is 0.

    None without a file of this SHA-256 checksum, and for a file without such light.
    """
    most = 16 * vertices + 12 * TERM_COUNT * rocks + _HEADER_BYTES
    data = _read_unchanged(path, checksum, most)
    if data is None:
        return None
    try:
        return parse_part(
            data,
            path,
            lambda foreign: _parse_baked_light(foreign, key, vertices, rocks),
            "baked light",
            "delete it",
            most,
        )
    except IcyMoonError:
        return None


def _read_unchanged(path: Path, checksum: str, most: int) -> bytes | None:
    """Read the content of a regular file with this checksum; None for a link, and for a missing or changed file."""
    try:
        if path.is_symlink() or path.parent.is_symlink():
            return None
        data = read_regular(path, most)
    except (OSError, ValueError):
        return None
    return data if hashlib.sha256(data).hexdigest() == checksum else None


def _parse_baked_light(foreign: ForeignBytes, key: str, vertices: int, rocks: int) -> BakedLight:
    found = parse_npz(foreign, kinds="fS")
    if found.keys() != {*_NUMBER_MEMBERS, *_ARRAY_MEMBERS}:
        raise ValueError("other members")
    shapes = {"key": (), "values": (vertices, 3), "error": (vertices,), "rocks": (rocks, TERM_COUNT, 3)}
    types = {"key": np.dtype("S12"), **dict.fromkeys(("values", "error", "rocks"), np.dtype("<f4"))}
    for name, array in found.items():
        if array.shape != shapes.get(name, ()) or array.dtype != types.get(name, np.dtype("<f8")):
            raise ValueError(f"{name} of a wrong shape or type")
        if name != "key" and not np.isfinite(array).all():
            raise ValueError(f"{name} with NaN or infinity")
    if found["key"][()] != key.encode() or (found["values"] < 0).any():
        raise ValueError("light of a wrong key, or below 0")
    noise, share, samples = (float(found[name]) for name in _NUMBER_MEMBERS)
    values, error, rocks_numbers = (np.array(found[name]) for name in ("values", "error", "rocks"))
    return BakedLight(values, error, rocks_numbers, noise, share, int(samples), 0.0)

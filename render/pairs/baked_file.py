"""Files of baked light beside the pairs of a data set, for all its workers and resumed runs. Imports no Blender.

A file is ``light/KEY.npz``. It contains numbers only, and nothing in it is run: its members, their sizes and shapes are
checked before they are read, and a file that does not hold what its key asks for counts as absent.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ... import system
from ...files import write_atomically
from ...physics.light.baked_rocks import TERMS

#: Folder of a data set with baked light.
LIGHT = "light"
_NUMBERS = ("noise", "share", "samples", "cpu_seconds")
#: Bytes of a member beyond its values: the header of an array in a file.
_HEADER = 1024


@dataclass(frozen=True)
class BakedLight:
    """Indirect irradiance over pi at the vertices of a ground, (n, 3) float32, W/(m² sr) in the bands R, G, B.

    ``rocks`` (rocks, terms, 3) float32 are the numbers of ``physics.light.baked_rocks`` for the same on rocks.
    ``noise`` is its standard error over its mean, from two halves of the ``samples``. ``share`` is its mean over that
    of all light at the vertices. ``cpu_seconds`` is what it took.
    """

    values: np.ndarray
    rocks: np.ndarray
    noise: float
    share: float
    samples: int
    cpu_seconds: float


def path_of(dataset: Path, key: str) -> Path:
    """Where baked light of a key is kept."""
    return dataset / LIGHT / f"{key}.npz"


def write(path: Path, key: str, light: BakedLight) -> None:
    """Write baked light, whole or not at all. Raises IcyMoonError if the disk refuses."""
    numbers = {name: np.float64(getattr(light, name)) for name in _NUMBERS}

    def save(part: Path) -> None:
        with part.open("wb") as stream:
            np.savez_compressed(stream, key=np.array(key, "S12"), values=light.values.astype("<f4"),
                                rocks=light.rocks.astype("<f4"), **numbers)

    write_atomically(path, save)


def read(path: Path, key: str, vertices: int, rocks: int = 0) -> BakedLight | None:
    """The baked light of a ground of so many vertices and rocks; None if there is none, or the file is not what it
    should be."""
    try:
        data = system.retry(path.read_bytes)
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            sizes = {each.filename: each.file_size for each in archive.infolist()}
        most = {f"{name}.npy": _HEADER for name in (*_NUMBERS, "key")} | {
            "values.npy": 12 * vertices + _HEADER, "rocks.npy": 12 * TERMS * rocks + _HEADER}
        if sizes.keys() != most.keys() or any(sizes[name] > most[name] for name in most):
            return None
        with np.load(io.BytesIO(data), allow_pickle=False) as found:
            values, of_rocks, stated = found["values"], found["rocks"], found["key"]
            noise, share, samples, seconds = (float(found[name]) for name in _NUMBERS)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
        return None
    whole = (stated.dtype.kind == "S" and stated.shape == () and bytes(stated[()]) == key.encode()
             and values.dtype == np.dtype("<f4") and values.shape == (vertices, 3)
             and np.isfinite(values).all() and (values >= 0).all()
             and of_rocks.dtype == np.dtype("<f4") and of_rocks.shape == (rocks, TERMS, 3)
             and np.isfinite(of_rocks).all()
             and np.isfinite([noise, share, samples, seconds]).all())
    return BakedLight(values, of_rocks, noise, share, int(samples), seconds) if whole else None

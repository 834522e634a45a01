"""Reading the disparities that an evaluation stored. Needs only numpy, which Blender has."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

import numpy as np


def read_disparity(path: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    """The float32 disparity that ``image_files.write_disparity`` stored; None if it is damaged or of another shape."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            disparity = np.asarray(stored["disparity"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return None
    return disparity if disparity.shape == shape else None

"""Read the disparities that an evaluation stored. Needs only NumPy, which Blender has."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import parse_npz, read

#: Names of the arrays of a disparity file.
_DISPARITY, _FOCAL_BASELINE, _CONFIDENCE = "disparity", "focal_baseline_px_m", "confidence"
#: The measure of confidence that needs no name in the file.
_OWN = "own"
#: Most bytes of a value, and of the header of an array.
_VALUE_BYTES, _HEADER_BYTES = 8, 2**14


def read_disparity(path: Path, shape: tuple[int, ...]) -> Array | None:
    """Read the float32 disparity that ``image_files.write_disparity`` stored; None if it is damaged or of another
    shape.
    """
    disparity = _read_array(path, _DISPARITY, _VALUE_BYTES * math.prod(shape) + _HEADER_BYTES)
    return disparity if disparity is not None and disparity.shape == shape else None


def read_focal_baseline(path: Path) -> float | None:
    """Read f·B in px·m, which turns the stored disparities into depths; None if the file states none."""
    stored = _read_array(path, _FOCAL_BASELINE, _VALUE_BYTES + _HEADER_BYTES)
    if stored is None or stored.shape or stored.dtype.kind != "f":
        return None
    return float(stored)


def encode_confidences(confidences: Mapping[str, Array]) -> dict[str, Array]:
    """Encode confidences from 0 to 1, by measure, as arrays of a disparity file: uint16, where 65535 is 1."""
    return {
        _name_confidence(measure): np.rint(65535.0 * confidence).astype(np.uint16)
        for measure, confidence in confidences.items()
    }


def read_confidence(path: Path, shape: tuple[int, ...], measure: str = _OWN) -> Array | None:
    """Read the confidence, float32 from 0 to 1, beside a disparity; None if the file is missing, damaged or of another
    shape. Integers are divided by the largest number of their type."""
    stored = _read_array(path, _name_confidence(measure), _VALUE_BYTES * math.prod(shape) + _HEADER_BYTES)
    if stored is None or stored.shape != shape or stored.dtype.kind != "u":
        return None
    return np.asarray(stored / np.float32(np.iinfo(stored.dtype).max), np.float32)


def _name_confidence(measure: str) -> str:
    return _CONFIDENCE if measure == _OWN else f"{_CONFIDENCE}_{measure}"


def _read_array(path: Path, name: str, memory: int) -> Array | None:
    try:
        stored = read(
            path, lambda foreign: parse_npz(foreign, {name}), "a stored disparity", "evaluate again", memory=memory
        )
    except IcyMoonError:
        return None
    return stored.get(name)

"""Measure one depth or disparity map from a file, without a pair folder."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ...physics.random_numbers.seeds import make_generator
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, RefusedError, parse_npy, parse_npz, read
from .depth_order import measure_depth_order_disagreement, sample_disagreement
from .guiss_reference_code import compute_depth_map_metrics, compute_reference_metrics
from .metrics import compute_depth_metrics, compute_disparity_metrics, compute_total_metrics, is_usable

SAMPLED_PAIR_COUNT = 300_000
#: Entry that ``match`` writes to an npz from StereoBM, and from which the reference code's numbers recognise StereoBM.
BM_MIN_DISPARITY = "bm_min_disparity"
_DISPARITY_ENTRY = "disparity"
#: Most bytes to which the packed arrays of a file may unfold: 33 million values in single precision.
_MAX_UNPACKED_BYTES = 2**27
#: Largest accepted disparity, px, which exceeds the width of any image.
_MAX_DISPARITY_PX = 2**20


def _measure_as_reference_code(
    given: Array, true: Array, disparity: Path | None, bm_min_disparity: int | None
) -> dict[str, float]:
    """Measure the numbers of the reference code: for the depths ``given`` in m, or for disparities in px if a
    ``disparity`` file has them.
    """
    if disparity is None:
        return compute_depth_map_metrics(given, true)
    least = _read_bm_min_disparity(disparity) if bm_min_disparity is None else bm_min_disparity
    return compute_reference_metrics(given, true, least)


def measure_files(
    prediction: Path | None,
    disparity: Path | None,
    truth: Path,
    focal_baseline: float | None,
    guiss: bool,
    bm_min_disparity: int | None = None,
) -> dict[str, float]:
    """Measure the file ``prediction`` (npy, depth in m) or ``disparity`` (npy or npz, px) against ``truth`` by all
    metrics.

    These include the variants ``dod_antisymmetric`` and ``dod_sampled``. With ``focal_baseline`` (px·m), which a
    disparity needs, they include the metrics of disparities and those with ``total_``. With ``guiss``, they include the
    numbers of the reference code, with its constant and cuts for a disparity, without for a depth. ``bm_min_disparity``
    is the least disparity of StereoBM if it made the disparity; an npz of ``match`` contains it. Raises IcyMoonError
    for files that do not fit.
    """
    path = prediction or disparity
    assert path is not None
    if focal_baseline is not None and not (math.isfinite(focal_baseline) and focal_baseline > 0):
        raise IcyMoonError(f"--focal-baseline is {focal_baseline}; give a positive number in px·m.")
    if disparity is not None and focal_baseline is None:
        raise IcyMoonError(
            "--disparity needs the camera; give --focal-baseline, its focal length in px times its baseline in m."
        )
    given, true = read_map(path), read_map(truth)
    if given.shape != true.shape:
        raise IcyMoonError(
            f"{path} has the shape {given.shape}, {truth} {true.shape}; give two arrays of the same shape."
        )
    if guiss and true.ndim != 2:
        raise IcyMoonError(f"{truth} has the shape {true.shape}; --guiss needs images, rows and columns.")
    depth = given if focal_baseline is None or disparity is None else _convert_depth_disparity(given, focal_baseline)
    result: dict[str, float] = dict(compute_depth_metrics(depth, true))
    both = is_usable(depth) & is_usable(true)
    result |= {
        "dod_antisymmetric": measure_depth_order_disagreement(depth[both], true[both], antisymmetric=True),
        "dod_sampled": sample_disagreement(
            depth[both], true[both], SAMPLED_PAIR_COUNT, make_generator(0, "statistics")
        ),
    }
    if focal_baseline is not None:
        pixels = given if disparity is not None else _convert_depth_disparity(given, focal_baseline)
        true_pixels = _convert_depth_disparity(true, focal_baseline)
        result |= compute_disparity_metrics(pixels, true_pixels)
        totals = compute_total_metrics(depth, true, pixels, true_pixels, result["dod"])
        result |= {f"total_{key}": value for key, value in totals.items()}
    if guiss:
        result |= _measure_as_reference_code(given, true, disparity, bm_min_disparity)
    return result


def _convert_depth_disparity(values: Array, focal_baseline: float) -> Array:
    """Convert depth to disparity, or disparity to depth; NaN for invalid values."""
    good = is_usable(values)
    return np.where(good, focal_baseline / np.where(good, values, 1.0), np.nan)


def _read_bm_min_disparity(path: Path) -> int | None:
    """Read the least disparity that the command ``match`` has written for StereoBM into an npz; None for any other
    file.
    """

    def parse(foreign: ForeignBytes) -> int | None:
        if not _is_archive(foreign):
            return None
        stored = parse_npz(foreign, {BM_MIN_DISPARITY}).get(BM_MIN_DISPARITY)
        if stored is None:
            return None
        if stored.shape != () or not abs(float(stored)) <= _MAX_DISPARITY_PX:
            raise RefusedError(f"{BM_MIN_DISPARITY} is not a disparity; give --bm-min-disparity.")
        return int(stored)

    return read(path, parse, "an npz file", "match the images again", memory=_MAX_UNPACKED_BYTES)


def read_map(path: Path) -> Array:
    """Read an array of numbers from an npy file, or ``disparity`` from an npz, as float64. Raises IcyMoonError for
    another file.
    """
    return read(
        path,
        _parse_map,
        "an npy file of numbers",
        "give an existing one with depths in metres",
        memory=_MAX_UNPACKED_BYTES,
    )


def _parse_map(foreign: ForeignBytes) -> Array:
    if not _is_archive(foreign):
        return parse_npy(foreign, "fiu").astype(np.float64)
    stored = parse_npz(foreign, {_DISPARITY_ENTRY}, "fiu")
    if not stored:
        raise RefusedError("contains several arrays; give an npy file with one.")
    return stored[_DISPARITY_ENTRY].astype(np.float64)


def _is_archive(foreign: ForeignBytes) -> bool:
    return foreign.part(0, min(4, foreign.size)) == b"PK\x03\x04"

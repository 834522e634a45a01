"""Finding what is wrong with truth and predictions whose numbers can be read but mean something else."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from ...errors import IcyMoonError
from ...physics.camera.hidden_points import matching_column, warped
from ..measure.metrics import usable
from .data_files import MapFile

#: Numbers are of the wrong sign if at least so many of them are.
WRONG_SIGN = 0.99
#: Factors between units: steps of a PNG, of OpenCV's disparities, millimetres.
_UNITS = (256.0, 16.0, 1000.0)
#: A median ratio of prediction and truth is a factor between units if it is within this of it, and if half of the
#: ratios of single pixels are within the second number: those of a matcher that fails are scattered.
_NEAR, _TIGHT = 0.03, 0.1
#: From this correlation on, images fit each other, and up to the other they do not.
_FITS, _FITS_NOT = 0.5, 0.3
#: Window of the blur that is subtracted before images are compared, and about the most pixels that are compared.
_BLUR_PX, _MOST_COMPARED = 31, 200_000


class Files(Protocol):
    """The files of a pair that an error names."""

    @property
    def left(self) -> Path:
        """The left image."""

    @property
    def right(self) -> Path:
        """The right image."""

    @property
    def truth(self) -> MapFile:
        """The true map."""


def check_truth(pair: Files, disparity: np.ndarray, left: np.ndarray, right: np.ndarray) -> None:
    """Raise IcyMoonError if a true ``disparity`` (H, W) cannot be that of the grey images ``left`` and ``right``."""
    path = pair.truth.path
    known = np.isfinite(disparity)
    if not known.any():
        raise IcyMoonError(f"{path} has no known value in any pixel; give the file with the truth.")
    if np.mean(disparity[known] < 0) >= WRONG_SIGN:
        raise IcyMoonError(f"{path} has negative disparities (left column minus right column must be positive); negate "
                           "them (truth.steps = -1 in pairs.toml), or exchange the images.")
    here = correlation(left, right, disparity)
    if here >= _FITS_NOT:
        return
    if correlation(left, right, -disparity) > max(here, _FITS):
        raise IcyMoonError(f"{pair.left} and {pair.right} fit the truth only the other way round; exchange the images.")
    what = "depths" if pair.truth.kind == "depth" else "disparities"
    for factor in (number for unit in _UNITS for number in (unit, 1 / unit)):
        if correlation(left, right, disparity / factor) > _FITS:
            # A depth that is too large is a disparity that is too small.
            large = 1 / factor if what == "depths" else factor
            size, change = (large, "large; divide") if large > 1 else (1 / large, "small; multiply")
            raise IcyMoonError(f"{path} has {what} that are {size:g} times too {change} them by {size:g}, or state "
                               "truth.steps in pairs.toml.")


def correlation(left: np.ndarray, right: np.ndarray, disparity: np.ndarray) -> float:
    """Correlation of the details of ``left`` with those of ``right`` at ``disparity``, all (H, W); -1 if nothing can
    be compared."""
    step = max(1, round(left.size / _MOST_COMPARED))
    details = [(image - cv2.blur(image, (_BLUR_PX, _BLUR_PX)))[step // 2::step]
               for image in (left.astype(np.float32), right.astype(np.float32))]
    column = matching_column(disparity[step // 2::step])
    with np.errstate(invalid="ignore"):
        inside = (column >= 0) & (column <= left.shape[1] - 1)  # False for NaN
    if inside.sum() < 100:
        return -1.0
    one, other = details[0][inside], warped(details[1], column)[inside]
    spread = float(one.std() * other.std())
    return float(np.mean((one - one.mean()) * (other - other.mean()))) / spread if spread else -1.0


def check_prediction(path: Path, disparity: np.ndarray, true_disparity: np.ndarray, true_depth: np.ndarray) -> None:
    """Raise IcyMoonError if a ``disparity`` map, NaN where there is none, is of another size, sign or unit.

    ``true_disparity`` and ``true_depth`` are those of the pair, NaN where unknown.
    """
    _check_shape(path, disparity.shape, true_disparity.shape)
    known = np.isfinite(disparity)
    if not known.any():
        raise IcyMoonError(f"{path} has no number in any pixel; run the method on this pair again.")
    if np.mean(disparity[known] < 0) >= WRONG_SIGN:
        raise IcyMoonError(f"{path} has negative disparities, as of optical flow; negate them.")
    both = usable(disparity) & usable(true_disparity)
    if not both.any():
        return
    ratio = disparity[both] / true_disparity[both]
    for unit in _UNITS[:2]:
        if _is_unit(ratio, unit):
            raise IcyMoonError(f"{path} has disparities that are {unit:g} times too large; divide them by {unit:g}.")
        if _is_unit(ratio, 1 / unit):
            raise IcyMoonError(f"{path} has disparities that are {unit:g} times too small; multiply them by {unit:g}.")
    for factor, share in ((2, "half"), (3, "a third of"), (4, "a quarter of")):
        if _is_unit(ratio, 1 / factor):
            raise IcyMoonError(f"{path} has disparities of images of {share} the width; multiply them by {factor}.")
    if _is_unit(ratio, 1 / true_disparity.shape[1]):
        raise IcyMoonError(f"{path} has disparities as shares of the width; multiply them by "
                           f"{true_disparity.shape[1]}.")
    if _is_unit(disparity[both] / true_depth[both], 1.0) and not _is_unit(ratio, 1.0):
        raise IcyMoonError(f"{path} has depths in metres; give disparities in px of the left image.")


def _check_shape(path: Path, shape: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    if shape == wanted:
        return
    has = f"{path} is {shape[1]} x {shape[0]} px, and the pair is {wanted[1]} x {wanted[0]} px"
    share = Fraction(shape[1], wanted[1])
    if Fraction(shape[0], wanted[0]) == share and 1 in (share.numerator, share.denominator):
        raise IcyMoonError(f"{has}; enlarge the map to that size and multiply its disparities by {1 / share}."
                           if share < 1 else
                           f"{has}; reduce the map to that size and divide its disparities by {share}.")
    raise IcyMoonError(f"{has}; give a disparity for each pixel of the left image.")


def _is_unit(ratio: np.ndarray, factor: float) -> bool:
    return bool(abs(np.median(ratio) / factor - 1) <= _NEAR
                and np.mean(np.abs(ratio / factor - 1) <= _TIGHT) >= 0.5)

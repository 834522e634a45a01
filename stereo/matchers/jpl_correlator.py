"""The arithmetic of JPL's Mars stereo correlator, in integers, identical to the last bit.

Written from the behaviour of the correlator of the Mars Exploration Rovers, which M. Maimone gave to JPL's image
laboratory in 2003 (NASA-AMMOS/VICAR, ``marsjplstereo``, Apache-2.0): Goldberg, Maimone, Matthies, "Stereo vision and
rover navigation software for planetary exploration", IEEE Aerospace 2002; Matthies, "Stereo vision for planetary
rovers", IJCV 8(1), 1992.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ...support.arrays import Array

ONE = 256  # disparities are counted in 1/256 px
NO_DATA = 0x7FFF
MAX_LEVELS = 255  # disparities that one search may compare

#: Why a pixel has no disparity, in the order of the tests; ``flags`` holds the index of the first that failed.
FLAGS = ("ACCEPT", "BOUND", "BORDER", "LRLOS", "FLAT", "THRESH", "BLOB")
ACCEPT, BOUND, BORDER, LRLOS, FLAT, THRESH, BLOB = range(len(FLAGS))

_BITS = 12  # fixed point of the filters
_HALF_LEVEL = 126 << _BITS  # added to a band-pass, which has both signs
_MEAN_OF_9, _MEAN_OF_81, _MEAN_OF_121 = ((1 << _BITS) // area for area in (9, 81, 121))
_BLOB_STEP = ONE // 4  # neighbours that differ by this or more belong to different blobs


@dataclass(frozen=True)
class Search:
    """The best match of every pixel inside the rim; each array is (rows, columns) of the searched part."""

    best: Array  # int16, left disparity minus the least one
    best_right: Array  # the same for the pixels of the right image
    score: Array  # sum of absolute differences at ``best``
    before: Array  # the score at one disparity less, undefined if that is not searched
    after: Array  # the score at one disparity more, undefined if that is not searched


def band_pass(image: Array, level: int) -> tuple[Array, int]:
    """Filter a uint8 (H, W) image that is halved ``level`` times; return uint8 (h, w), and the width of its invalid rim
    in px.

    The result is the detail of the image: the difference of two box means, around a grey of 126. This removes
    differences of brightness between the cameras. The smaller box is one pixel at level 0 and 3 x 3 above, the larger
    box 9 x 9 and 11 x 11. The fixed-point factors are rounded down, so only 98.9 % of the larger mean is subtracted.
    """
    rim = 0
    for _ in range(level - 1):
        image = _halve(_blank_rim((_sum_windows(image, 3) * _MEAN_OF_9) >> _BITS, 1)).astype(np.uint8)
        rim = (rim + 2) >> 1
    if level == 0:
        detail, margin = (image.astype(np.int32) << _BITS) - _sum_windows(image, 9) * _MEAN_OF_81, 4
    else:
        detail, margin = _sum_windows(image, 3) * _MEAN_OF_9 - _sum_windows(image, 11) * _MEAN_OF_121, 5
    filtered = _blank_rim(np.clip(detail + _HALF_LEVEL, 0, 255 << _BITS) >> _BITS, margin).astype(np.uint8)
    if level == 0:
        return filtered, margin
    return _halve(filtered), (rim + margin + 1) >> 1


def search_disparities(left: Array, right: Array, least: int, most: int, window: int, rim: int) -> Search:
    """Compare windows of uint8 (h, w) images over the disparities ``least`` to ``most``.

    The searched part excludes ``rim`` and half a window on every side. The lowest score wins, and among equal scores
    the lowest disparity. A pixel near the left border is compared only over disparities that stay inside.
    """
    margin = rim + window // 2
    inside = slice(margin, left.shape[0] - margin)
    shape = left.shape[0] - 2 * margin, left.shape[1] - 2 * margin
    # 16 bits hold the sums of up to 16 x 16 differences.
    depth, worst = (
        (cv2.CV_16U, _fill_with_largest(shape, np.uint16))
        if window < 16
        else (cv2.CV_32S, _fill_with_largest(shape, np.int32))
    )
    score, score_right, before, after = worst, worst.copy(), worst.copy(), worst.copy()
    previous = worst.copy()
    won: Array = np.zeros(shape, np.uint8)
    best, best_right = np.zeros(shape, np.int16), np.zeros(shape, np.int16)
    for step, disparity in enumerate(range(least, min(most, shape[1] - 1) + 1)):
        width = shape[1] - disparity
        difference = cv2.absdiff(left[:, disparity:], right[:, : left.shape[1] - disparity])
        sums = cv2.boxFilter(difference, depth, (window, window), normalize=False)[inside, margin : margin + width]
        here, there, number = np.s_[:, disparity:], np.s_[:, :width], np.full((shape[0], width), step, np.int16)
        cv2.copyTo(sums, won[here], after[here])
        won = cv2.compare(sums, score[here], cv2.CMP_LT)
        cv2.copyTo(previous[here], won, before[here])
        cv2.copyTo(sums, won, score[here])
        cv2.copyTo(number, won, best[here])
        won_right = cv2.compare(sums, score_right[there], cv2.CMP_LT)
        cv2.copyTo(sums, won_right, score_right[there])
        cv2.copyTo(number, won_right, best_right[there])
        previous[here] = sums
        won = np.pad(won, ((0, 0), (disparity, 0)))
    return Search(best, best_right, score, before, after)


def judge_matches(found: Search, least: int, most: int, window: int, uncertainty: int) -> tuple[Array, Array]:
    """Accept or reject the matches of a search; return the disparity, int32 in 1/256 px or NO_DATA, and the flags,
    uint8.

    The disparity is refined by a parabola through three scores. If ``uncertainty`` is above 0, it is the largest
    expected error, in 1/256 px, that is accepted.
    """
    best = found.best.astype(np.int32)
    column = np.arange(best.shape[1], dtype=np.int32)
    last = np.minimum(most, column) - least  # index of the last searched disparity; below 0 where none fits
    border = (best == 0) | (best >= last)
    matched = np.take_along_axis(found.best_right, np.maximum(column - best - least, 0), axis=1)
    before, after, score = (scores.astype(np.int32) for scores in (found.before, found.after, found.score))
    curvature = before + after - 2 * score
    flat = (curvature == 0) | (before == score) | (after == score)
    rise = (before - after) << 7
    offset = np.sign(rise) * (np.abs(rise) // np.where(flat, 1, curvature))  # rounded toward zero
    flags = np.where(border, BORDER, np.where(np.abs(best - matched) > 1, LRLOS, np.where(flat, FLAT, ACCEPT)))
    if uncertainty:
        error = window**2 * (((467 * offset**2) >> 16) + 362)
        flags[(flags == ACCEPT) & (error >= uncertainty * curvature.astype(np.int64))] = THRESH
    return np.where(flags == ACCEPT, ONE * (best + least) + offset, NO_DATA), flags.astype(np.uint8)


def compute_expected_error(found: Search, disparity: Array, least: int, window: int) -> Array:
    """Compute the correlator's own estimate of its error, px, float64 in the shape of ``disparity``, which comes from
    ``judge_matches``; NaN where the disparity has no data. The ``uncertainty`` of ``judge_matches`` limits this error.
    """
    before, after, score = (scores.astype(np.int64) for scores in (found.before, found.after, found.score))
    measured = disparity != NO_DATA
    curvature = np.where(measured, before + after - 2 * score, 1)
    offset = np.where(measured, disparity - ONE * (found.best.astype(np.int64) + least), 0)
    return np.where(measured, window**2 * (((467 * offset**2) >> 16) + 362) / curvature / ONE, np.nan)


def find_blobs(disparity: Array, smallest: int) -> Array:
    """Find the measured pixels in patches of fewer than ``smallest`` pixels, as booleans (h, w).

    A patch ends where two pixels side by side, or one above the other, differ by a quarter of a pixel or more.
    """
    measured = disparity != NO_DATA
    if smallest < 2 or not measured.any():
        return np.zeros_like(measured)
    # OpenCV's filter takes 16 bits, which hold MAX_LEVELS disparities if they are centred on zero.
    centre = (int(disparity[measured].min()) + int(disparity[measured].max())) // 2
    centred = np.where(measured, disparity - centre, NO_DATA).astype(np.int16)
    cv2.filterSpeckles(centred, NO_DATA, smallest - 1, _BLOB_STEP - 1)
    return measured & (centred == NO_DATA)


def _fill_with_largest(shape: tuple[int, int], kind: type[np.integer[Any]]) -> Array:
    return np.full(shape, np.iinfo(kind).max, kind)


def _sum_windows(image: Array, side: int) -> Array:
    return cv2.boxFilter(image, cv2.CV_32S, (side, side), normalize=False)


def _blank_rim(image: Array, width: int) -> Array:
    kept = np.zeros_like(image)
    kept[width:-width, width:-width] = image[width:-width, width:-width]
    return kept


def _halve(image: Array) -> Array:
    return np.ascontiguousarray(image[::2, ::2])

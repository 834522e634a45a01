"""Measure how well a matcher's confidence predicts its errors: order, calibration, and coverage at a stated error.

All pixels count that were measured and have a true disparity, also those that the right eye does not see: a confidence
should predict these errors too. Only the order of confidences matters, except in the calibration. Pixels of equal
confidence count as in a random order: each has their mean error, so no number depends on the order of the image.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...support.arrays import Array
from .metrics import KEPT_SHARES, is_usable
from .prepare_pair import none_if_not_finite

#: Measures of confidence: the matcher's own, and two that work with any matcher.
OWN, LEFT_RIGHT, SWEEP = "own", "left_right", "sweep"
MEASURES = {OWN: "own", LEFT_RIGHT: "left-right", SWEEP: "plane sweep"}
#: The numbers of a measure; see ``measure_confidence``.
CONFIDENCE_METRICS = ("ause", "ece", "coverage_at_bad_2", "bad_2_at_90")
#: Numbers of a measure that are shares, from 0 to 1.
CONFIDENCE_SHARES = ("ece", "coverage_at_bad_2", "bad_2_at_90")
#: Largest error, px, of a right measurement; see ``calibration``.
RIGHT_PX = 1.0
#: Error, px, above which a measurement is bad; the largest accepted share of bad measurements, and the share of true
#: pixels that is kept.
BAD_PX, MAX_BAD_SHARE, KEPT_COVERAGE = 2.0, 0.03, 0.90
#: Classes of equal width of the calibration (Guo et al. 2017).
CALIBRATION_CLASSES = 15
#: Sums over the pixels of a class: all pixels, right pixels, and confidences.
CALIBRATION_SUMS = ("n", "right", "confidence")


@dataclass(frozen=True)
class _Ordered:
    """Cumulative sums over measurements in the order of falling confidence: at the end of each group of equal
    confidence, and at 0, the number of measurements, the sum of their errors in px, and the number of bad ones.

    Between these ends the sums are interpolated linearly, which is their mean over all random orders of a group.
    """

    ends: Array
    errors_px: Array
    bad: Array

    @classmethod
    def sort(cls, errors: Array, confidence: Array) -> _Ordered:
        values = confidence.astype(np.float32)
        order = np.argsort(-values)
        last = np.flatnonzero(np.diff(values[order], append=np.float32(np.inf))) if errors.size else np.zeros(0, int)
        sorted_errors = errors[order]
        sums = (np.cumsum(of)[last] for of in (sorted_errors, sorted_errors > BAD_PX))
        return cls(np.append(0, last + 1), *(np.append(0, each) for each in sums))

    def sum_errors(self, kept: Array) -> Array:
        """Return the sum of the errors, px, of the ``kept`` surest measurements."""
        return np.interp(kept, self.ends, self.errors_px)


def make_confidence_entries(
    disparity: Array, true_disparity: Array, confidences: Mapping[str, Array]
) -> dict[str, dict[str, Any]]:
    """Make the entries of a row on its confidences, see ``measure_confidence``; {} without confidences.

    ``confidence`` has the metrics by measure, None where undefined, and ``confidence_curves`` the rest by measure.
    """
    found = measure_confidence(disparity, true_disparity, confidences)
    if not found:
        return {}
    return {
        "confidence": {
            name: {key: none_if_not_finite(values[key]) for key in CONFIDENCE_METRICS} for name, values in found.items()
        },
        "confidence_curves": {
            name: {key: value for key, value in values.items() if key not in CONFIDENCE_METRICS}
            for name, values in found.items()
        },
    }


def list_confidence_columns(measures: Collection[str]) -> list[str]:
    """List the columns of a table with these measures, such as ``own_ause``."""
    return [f"{name}_{key}" for name in MEASURES if name in measures for key in CONFIDENCE_METRICS]


def list_confidence_numbers(row: Mapping[str, Any]) -> dict[str, float | None]:
    """Return the numbers of a row by the names of ``list_confidence_columns``; None where undefined."""
    return {
        f"{measure}_{key}": value
        for measure, values in row.get("confidence", {}).items()
        for key, value in values.items()
    }


def measure_confidence(
    disparity: Array, true_disparity: Array, confidences: Mapping[str, Array]
) -> dict[str, dict[str, Any]]:
    """Measure confidences (H, W) of a disparity map (H, W) in px, from 0 to 1, higher where surer.

    Return, by the name of each confidence, ``CONFIDENCE_METRICS`` (NaN where undefined), a ``curve``, ``best`` and the
    ``calibration``, see ``sum_by_confidence``. The ``curve`` is the mean error of the surest measurements for each of
    KEPT_SHARES; ``best`` is this curve in the order of the errors themselves. The metrics:

    * ``ause``: area under the sparsification error (Ilg et al. 2018). This error is the mean error of the kept
      measurements in the order of the confidence, less the same in the order of the errors. ``ause`` is its mean over
      the number of kept measurements, over the mean error of all. 0 is ideal; a confidence without information has 1
      less the ideal area;
    * ``ece``: expected calibration error (Guo et al. 2017), with ``RIGHT_PX``;
    * ``coverage_at_bad_2``: the largest share of the true pixels that a limit of the confidence keeps, if at most
      ``MAX_BAD_SHARE`` of the kept pixels are off by more than 2 px;
    * ``bad_2_at_90``: the share of pixels off by more than 2 px among the surest measurements, as many as 90 % of the
      true pixels; NaN if fewer are measured.
    """
    known = is_usable(true_disparity)
    measured = known & is_usable(disparity)
    errors = np.abs(np.asarray(disparity, np.float64)[measured] - true_disparity[measured])
    true_pixels = int(np.count_nonzero(known))
    best_sums = np.cumsum(np.sort(errors))
    found = {}
    for name, confidence in confidences.items():
        values = np.asarray(confidence, np.float64)[measured]
        ordered = _Ordered.sort(errors, values)
        calibration = sum_by_confidence(errors, values)
        found[name] = {
            "ause": compute_ause(ordered, best_sums),
            "ece": compute_calibration_error(calibration),
            "coverage_at_bad_2": find_coverage_at(ordered, true_pixels),
            "bad_2_at_90": compute_bad_share_at(ordered, true_pixels),
            "curve": keep_shares(ordered.sum_errors, errors.size),
            "best": keep_shares(lambda kept: best_sums[kept - 1], errors.size),
            "calibration": calibration,
        }
    return found


def keep_shares(sum_errors: Callable[[Array], Array], measured: int) -> list[float]:
    """Return the mean error of the first measurements, for each of KEPT_SHARES of them; [] without measurements."""
    if not measured:
        return []
    kept = np.array([max(1, round(share * measured)) for share in KEPT_SHARES])
    return list((sum_errors(kept) / kept).tolist())


def compute_ause(ordered: _Ordered, best_sums: Array) -> float:
    """Compute the area under the sparsification error, see ``measure_confidence``; NaN if no error is above 0.
    ``best_sums`` are the cumulative sums of the errors in ascending order.
    """
    if not best_sums.size or not best_sums[-1] > 0:
        return float("nan")
    kept = np.arange(1, best_sums.size + 1)
    above = float(np.mean((ordered.sum_errors(kept) - best_sums) / kept))
    return max(0.0, above * best_sums.size / float(best_sums[-1]))  # rounding may leave -1e-16


def find_coverage_at(ordered: _Ordered, true_pixels: int) -> float:
    """Find ``coverage_at_bad_2``, see ``measure_confidence``; NaN without true pixels."""
    if not true_pixels:
        return float("nan")
    return float(ordered.ends[ordered.bad <= MAX_BAD_SHARE * ordered.ends].max()) / true_pixels


def compute_bad_share_at(ordered: _Ordered, true_pixels: int) -> float:
    """Compute ``bad_2_at_90``, see ``measure_confidence``; NaN if fewer pixels are measured."""
    kept = round(KEPT_COVERAGE * true_pixels)
    if not 0 < kept <= ordered.ends[-1]:
        return float("nan")
    return float(np.interp(kept, ordered.ends, ordered.bad)) / kept


def sum_by_confidence(errors: Array, confidence: Array) -> dict[str, list[float]]:
    """Compute the CALIBRATION_SUMS of measurements with errors in px, by CALIBRATION_CLASSES of their confidence from 0
    to 1.
    """
    place = np.clip((confidence * CALIBRATION_CLASSES).astype(int), 0, CALIBRATION_CLASSES - 1)
    sums = (np.ones(errors.size), errors <= RIGHT_PX, confidence)
    return {
        name: np.bincount(place, weights, CALIBRATION_CLASSES).tolist()
        for name, weights in zip(CALIBRATION_SUMS, sums, strict=True)
    }


def add_calibration(one: Mapping[str, Sequence[float]] | None, other: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Add the calibration sums of two sets of pixels; ``one`` may be None."""
    if one is None:
        return {name: list(values) for name, values in other.items()}
    return {name: np.add(one[name], other[name]).tolist() for name in CALIBRATION_SUMS}


def compute_calibration_error(sums: Mapping[str, Sequence[float]]) -> float:
    """Compute the expected calibration error (Guo et al. 2017): the mean, over pixels, of the difference between the
    mean confidence of their class and the share of right measurements in it. NaN without pixels.
    """
    n, right, confidence = (np.asarray(sums[name], np.float64) for name in CALIBRATION_SUMS)
    return float(np.abs(right - confidence).sum() / n.sum()) if n.sum() else float("nan")

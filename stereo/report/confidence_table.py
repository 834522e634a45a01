"""The numbers of confidences in all rows: their means, curves and calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...support.arrays import Array
from ..inference.scene_means import find_mean_intervals
from ..measure.confidence_metrics import (
    BAD_PX,
    CONFIDENCE_METRICS,
    CONFIDENCE_SHARES,
    KEPT_COVERAGE,
    MAX_BAD_SHARE,
    MEASURES,
    RIGHT_PX,
    add_calibration,
)
from ..measure.metrics import KEPT_SHARES
from .table_columns import Column

#: The columns of the table of confidences.
CONFIDENCE_COLUMNS = (
    Column(
        "ause",
        "AUSE",
        "",
        3,
        "area between the mean error of the surest measurements and the same in the order of their errors, over the "
        "mean error; 0 is ideal",
    ),
    Column(
        "coverage_at_bad_2",
        f"Coverage at bad-2 ≤ {100 * MAX_BAD_SHARE:g} %",
        "%",
        1,
        f"largest share of the true pixels that a limit of the confidence keeps with at most {100 * MAX_BAD_SHARE:g} "
        f"% of the kept ones off by more than {BAD_PX:g} px",
    ),
    Column(
        "bad_2_at_90",
        f"bad-2 at {100 * KEPT_COVERAGE:g} % coverage",
        "%",
        1,
        f"share off by more than {BAD_PX:g} px of the surest measurements, as many as {100 * KEPT_COVERAGE:g} % of the "
        "true pixels",
    ),
    Column(
        "ece",
        "ECE",
        "%",
        1,
        f"expected calibration error: mean difference between confidence and share of errors within {RIGHT_PX:g} px",
    ),
)
_CURVES = ("curve", "best")


class ConfidenceTable:
    """The numbers of confidences by measure: each metric (methods, pairs), NaN where undefined, and sums over pairs."""

    def __init__(self, methods: int, pairs: int) -> None:
        self._shape = methods, pairs
        self._numbers: dict[tuple[str, str], Array] = {}
        self._curves: dict[tuple[int, str, str], list[Any]] = {}
        self._calibration: dict[tuple[int, str], dict[str, Any]] = {}

    def add(self, method: int, pair: int, row: Mapping[str, Any]) -> None:
        """Add a row of the ``method`` and ``pair`` with these numbers."""
        for measure, values in row.get("confidence", {}).items():
            for key in CONFIDENCE_METRICS:
                numbers = self._numbers.setdefault((measure, key), np.full(self._shape, np.nan))
                numbers[method, pair] = np.nan if (value := values.get(key)) is None else value
        for measure, curves in row.get("confidence_curves", {}).items():
            for key in _CURVES:
                if len(curves[key]) == len(KEPT_SHARES):
                    total = self._curves.setdefault((method, measure, key), [np.zeros(len(KEPT_SHARES)), 0])
                    total[0] += curves[key]
                    total[1] += 1
            known = self._calibration.get((method, measure))
            self._calibration[method, measure] = add_calibration(known, curves["calibration"])

    def is_known(self) -> bool:
        """Return whether any row has a confidence."""
        return bool(self._numbers)

    def summarise(self, method: int, counted: Array, scenes: Array) -> dict[str, dict[str, Any]]:
        """Summarise a method by measure of confidence. Each metric has its ``mean`` over pairs, its 95 % ``interval``
        or None, and the number of ``pairs``; ``curve`` and ``best`` are means over pairs, and ``calibration`` is over
        the pixels of all pairs.
        """
        found: dict[str, dict[str, Any]] = {}
        for measure in MEASURES:
            calibration = self._calibration.get((method, measure))
            if calibration is None:
                continue
            found[measure] = {
                key: average_with_interval(
                    self._numbers[measure, key][method][counted], scenes[counted], key in CONFIDENCE_SHARES
                )
                for key in CONFIDENCE_METRICS
            }
            for key in _CURVES:
                total, count = self._curves.get((method, measure, key), (np.zeros(0), 1))
                found[measure][key] = (total / count).tolist()
            found[measure]["calibration"] = calibration
        return found


def average_with_interval(numbers: Array, scenes: Array, share: bool = False) -> dict[str, Any]:
    """Average the numbers of pairs that are not NaN: the ``mean``, its 95 % ``interval`` or None, and the number of
    ``pairs``.
    """
    known = ~np.isnan(numbers)
    low, high = find_mean_intervals(numbers[:, None], scenes, np.array([share]))[0]
    return {
        "mean": float(numbers[known].mean()) if known.any() else None,
        "pairs": int(known.sum()),
        "interval": [float(low), float(high)] if np.isfinite(low) else None,
    }


def list_confidence_rows(summary: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, Mapping[str, Any]]]:
    """List the rows of the table: method, name of the measure, and the summary of both."""
    return [
        (entry["method"], MEASURES[measure], values)
        for entry in summary
        for measure, values in entry["confidence"].items()
    ]

"""Summarising the rows of an evaluation: averages per method with intervals, and differences between methods."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..measure import by_pixel_class
from ..measure.metrics import BAD, ERROR_STEPS_M, SHARES
from ..measure.result_row import NUMBERS, REGION_METRICS
from .bootstrap import clusters_of, intervals

#: Metrics that are means over pixels, so that the pixels of all pairs can be pooled. The scale-invariant and order
#: metrics compare pixels of one image, and cannot.
POOLED = ("l1_m", "l1_rate_10", "bias_m", "abs_rel", "l1_rate_30", "l1_rate_100", "epe_px", *BAD, "d1")
#: Metrics that are compared between methods: errors where both measured, and rates that count missing pixels.
COMPARED = ("common_l1_m", "common_epe_px", "common_si_rmse", "common_dod", "total_l1_rate_10", "total_bad_1",
            "coverage", "seconds")
#: Metrics for which more is better.
_GAINS = ("coverage",)
_PLACE = {key: place for place, key in enumerate(NUMBERS)}
#: Numbers that are counts of pixels.
_COUNTS = tuple(f"{prefix}n" for prefix, keys in REGION_METRICS.items() if "n" in keys)
_AVERAGED = tuple(key for key in NUMBERS if key not in (*_COUNTS, "true_pixels"))


class Table:
    """The numbers of all rows, and sums over pairs.

    ``values`` is (methods, pairs, NUMBERS), NaN where undefined and in rows that count in no average. ``counts`` is
    true for rows that count. ``scenes`` (pairs) is -1 until the scene of a pair is known.
    """

    def __init__(self, methods: Sequence[str], pairs: Sequence[str]) -> None:
        self.methods, self.pairs = list(methods), list(pairs)
        self.values = np.full((len(methods), len(pairs), len(NUMBERS)), np.nan)
        self.counts = np.zeros((len(methods), len(pairs)), bool)
        self.failed = np.zeros((len(methods), len(pairs)), bool)
        self.scenes = np.full(len(pairs), -1)
        self.strata: list[dict[str, Any] | None] = [None] * len(methods)
        self._curves: list[dict[str, list[Any]]] = [{key: [np.zeros(steps), 0] for key, steps in (
            ("error_curve", len(ERROR_STEPS_M)), ("texture", len(SHARES)), ("best", len(SHARES)))} for _ in methods]

    def add(self, pair: int, row: Mapping[str, Any]) -> None:
        """Add the row of a method on the pair with this number."""
        method = self.methods.index(row["method"])
        self.failed[method, pair] = row["status"] == "failed"
        if row["status"] != "ok":
            return
        self.counts[method, pair] = True
        self.values[method, pair] = [np.nan if row[key] is None else row[key] for key in NUMBERS]
        self.strata[method] = by_pixel_class.add_sums(self.strata[method], row["strata"])
        for key, curve in (("error_curve", row["error_curve"]), *row["sparsification"].items()):
            if curve and None not in curve:
                self._curves[method][key][0] += curve
                self._curves[method][key][1] += 1

    def column(self, method: int, key: str) -> np.ndarray:
        """One number for all pairs, NaN where undefined."""
        return self.values[method, :, _PLACE[key]]

    def curve(self, method: int, key: str) -> list[float]:
        """The mean ``error_curve``, or mean sparsification by ``texture`` or ``best``; empty if none is defined."""
        total, count = self._curves[method][key]
        return list((total / count).tolist()) if count else []


def summarise_method(table: Table, method: int, seed: int) -> dict[str, Any]:
    """Summarise one method over all pairs that count.

    Every metric is the mean over the pairs where it is defined, each with equal weight, as in the tables of the GUISS
    paper; ``n`` is the sum. ``intervals`` are the 95 % bounds of each mean (see ``bootstrap``), ``scenes`` is the
    number of scenes behind them. ``pooled_*`` are means over the pixels of all pairs. ``pairs`` is the number of pairs
    that count; ``failed`` and ``suspect`` count the others. ``strata`` contains, per factor, the ``classes`` and, per
    class, the ``by_pixel_class.SUMS`` over the pixels of all pairs.
    """
    values = table.values[method]
    counted = table.counts[method]
    result: dict[str, Any] = {
        "method": table.methods[method], "pairs": int(counted.sum()), "failed": int(table.failed[method].sum()),
        "suspect": int((~counted & ~table.failed[method]).sum()),
        "scenes": len(np.unique(table.scenes[counted]))}
    columns = values[:, [_PLACE[key] for key in _AVERAGED]]
    result |= {key: _number(mean) for key, mean in zip(_AVERAGED, _means(columns), strict=True)}
    result |= {key: int(np.nansum(table.column(method, key))) for key in _COUNTS}
    bounds = intervals(columns[counted], clusters_of(table.scenes[counted]), seed)
    result["intervals"] = {key: [float(low), float(high)] for key, (low, high) in zip(_AVERAGED, bounds, strict=True)
                           if np.isfinite(low)}
    weights = table.column(method, "n")
    for metric in POOLED:
        numbers = table.column(method, metric)
        known = ~np.isnan(numbers) & (weights > 0)
        result[f"pooled_{metric}"] = _ratio(float((numbers * weights)[known].sum()), float(weights[known].sum()))
    result["pooled_coverage"] = _ratio(result["n"], float(np.nansum(table.column(method, "true_pixels"))))
    result["error_curve"] = table.curve(method, "error_curve")
    result["sparsification"] = {key: table.curve(method, key) for key in ("texture", "best")}
    result["strata"] = {factor.key: {"classes": list(factor.classes), **sums} for factor in by_pixel_class.FACTORS
                        if (sums := (table.strata[method] or {}).get(factor.key))}
    return result


def differences(table: Table, seed: int) -> list[dict[str, Any]]:
    """The difference in each of COMPARED between every two methods, over the pairs where both are defined.

    Each entry has ``a``, ``b``, ``metric``, the ``mean`` of a - b with its 95 % bounds ``low`` and ``high`` (null with
    fewer than two clusters), the number of ``pairs``, and ``better``, the share of pairs where a is better (a tie
    counts half). What makes a pair easy or hard for both methods cancels in the difference, so it can show what the
    intervals of the two methods cannot.
    """
    found = []
    for a, b in itertools.combinations(range(len(table.methods)), 2):
        columns = np.stack([table.column(a, key) - table.column(b, key) for key in COMPARED], axis=1)
        both = table.counts[a] & table.counts[b]
        bounds = intervals(columns[both], clusters_of(table.scenes[both]), seed)
        for k, metric in enumerate(COMPARED):
            known = columns[~np.isnan(columns[:, k]), k]
            sign = 1 if metric in _GAINS else -1
            found.append({"a": table.methods[a], "b": table.methods[b], "metric": metric, "pairs": len(known),
                          "mean": float(known.mean()) if len(known) else None,
                          "low": _number(bounds[k, 0]), "high": _number(bounds[k, 1]),
                          "better": float(np.mean((np.sign(known) * sign + 1) / 2)) if len(known) else None})
    return found


def _means(columns: np.ndarray) -> np.ndarray:
    known = ~np.isnan(columns)
    count = known.sum(axis=0)
    total = np.where(known, columns, 0.0).sum(axis=0)
    return np.divide(total, count, out=np.full(columns.shape[1], np.nan), where=count > 0)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None

"""Summarise the rows of an evaluation: averages per method with intervals, and differences between methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...support.arrays import Array
from ..inference.scene_means import average_by_scene, find_mean_intervals, find_simultaneous_intervals
from ..inference.typical_scene import compare_in_typical_scene, find_differences, find_rank_ranges, list_method_pairs
from ..measure import by_pixel_class, common_pixels, disparity_histograms
from ..measure.metrics import BAD_RATES, ERROR_QUANTILES, ERROR_STEPS_M, KEPT_SHARES, L1_RATES
from ..measure.row_metrics import NUMBERS, REGION_METRICS
from .confidence_table import ConfidenceTable, average_with_interval
from .schema import Comparison

#: Metrics that are means over pixels, so that the pixels of all pairs can be pooled. The scale-invariant and order
#: metrics compare pixels of one image, and cannot.
POOLED_METRICS = ("l1_m", "l1_rate_10", "bias_m", "abs_rel", "l1_rate_30", "l1_rate_100", "epe_px", *BAD_RATES, "d1")


@dataclass(frozen=True)
class ComparedMetric:
    """A metric by which methods are compared.

    ``key`` names the comparison; a key that starts with ``common_`` is over the pixels that both methods measured. A
    ``ratio`` compares sizes by the logarithm of their ratio in each scene, so that few scenes suffice and hard scenes
    weigh no more than easy ones. Other metrics are compared by their difference in each scene.
    """

    key: str
    ratio: bool = False
    more_is_better: bool = False


#: Errors are compared where both methods measured, and rates also over all true pixels, where a missing one is wrong.
#: A method that measures few pixels gains by neither.
COMPARED = (
    *(
        ComparedMetric(f"common_{prefix}{key}", key in ("l1_m", "rmse_m", "si_rmse", "epe_px"))
        for prefix in common_pixels.REGIONS
        for key in common_pixels.METRICS
    ),
    *(ComparedMetric(f"total_{key}") for key in ("bad_0_5", "bad_1", "bad_2", "d1", "l1_rate_10", "dod")),
    ComparedMetric("coverage", more_is_better=True),
    ComparedMetric("visible_coverage", more_is_better=True),
    ComparedMetric("seconds", ratio=True),
)
#: Least error or time in a comparison: 1 µm, 1 µpx or 1 µs, so that 0 has a logarithm.
_MIN_COMPARED = 1e-6
_COLUMN_BY_NUMBER = {key: place for place, key in enumerate(NUMBERS)}
#: Numbers that are counts of pixels.
_PIXEL_COUNTS = tuple(f"{prefix}n" for prefix, keys in REGION_METRICS.items() if "n" in keys)
_AVERAGED_NUMBERS = tuple(key for key in NUMBERS if key not in (*_PIXEL_COUNTS, "true_pixels"))
#: Numbers that are infinite, and so null, in a pair with too few measured pixels.
_TOTAL_QUANTILES = tuple(f"total_{key}" for key in ("median_m", *ERROR_QUANTILES))
#: The ends of the names of shares, which no interval may exceed.
_SHARE_NAMES = ("coverage", *BAD_RATES, "d1", *L1_RATES, "dod")
_COMMON_PLACE = {f"common_{key}": place for place, key in enumerate(common_pixels.NUMBERS)}


class ResultTable:
    """The numbers of all rows, and sums over pairs.

    ``values`` is (methods, pairs, NUMBERS), NaN where undefined and in rows that count in no average. ``common`` is
    (methods, methods, pairs, common_pixels.NUMBERS): numbers of the first method on the pixels that the second measured
    too. ``counts`` is true for rows that count. ``scenes`` (pairs,) is -1 until the scene of a pair is known.
    """

    def __init__(self, methods: Sequence[str], pairs: Sequence[str]) -> None:
        self.methods, self.pairs = list(methods), list(pairs)
        self.values = np.full((len(methods), len(pairs), len(NUMBERS)), np.nan)
        self.common = np.full((len(methods), len(methods), len(pairs), len(_COMMON_PLACE)), np.nan)
        self.counts = np.zeros((len(methods), len(pairs)), bool)
        self.failed = np.zeros((len(methods), len(pairs)), bool)
        self.scenes = np.full(len(pairs), -1)
        self.by_noise = np.zeros(len(pairs), bool)  # whether noise of the render decides the result of a pair
        self.confidence = ConfidenceTable(len(methods), len(pairs))
        self.plugins: dict[str, Array] = {}  # (methods, pairs) of each metric of a plug-in, NaN where undefined
        self.strata: list[dict[str, Any] | None] = [None] * len(methods)
        self.histograms: list[disparity_histograms.Histograms | None] = [None] * len(methods)
        self._curves: list[dict[str, list[Any]]] = [
            {
                key: [np.zeros(steps), 0]
                for key, steps in (
                    ("error_curve", len(ERROR_STEPS_M)),
                    ("texture", len(KEPT_SHARES)),
                    ("best", len(KEPT_SHARES)),
                )
            }
            for _ in methods
        ]

    def add(self, pair: int, row: Mapping[str, Any]) -> None:
        """Add the row of a method on the pair with this number."""
        method = self.methods.index(row["method"])
        self.failed[method, pair] = row["status"] == "failed"
        if row["status"] != "ok":
            return
        self.counts[method, pair] = True
        self.values[method, pair] = [np.nan if row[key] is None else row[key] for key in NUMBERS]
        self.confidence.add(method, pair, row)
        for name, value in row.get("plug_ins", {}).items():
            column = self.plugins.setdefault(name, np.full((len(self.methods), len(self.pairs)), np.nan))
            column[method, pair] = np.nan if value is None else value
        for other in row["common"].keys() & set(self.methods):
            self.common[method, self.methods.index(other), pair] = [
                np.nan if (value := row["common"][other][key]) is None else value for key in common_pixels.NUMBERS
            ]
        self.strata[method] = by_pixel_class.add_sums(self.strata[method], row["strata"])
        self.histograms[method] = disparity_histograms.add_histograms(self.histograms[method], row["histograms"])
        for key, curve in (("error_curve", row["error_curve"]), *row["sparsification"].items()):
            if curve and None not in curve:
                self._curves[method][key][0] += curve
                self._curves[method][key][1] += 1

    def scene_count(self) -> int:
        """Count the scenes with a pair that counts."""
        return len(np.unique(self.scenes[self.counts.any(axis=0)]))

    def where(self, pairs: Array) -> ResultTable:
        """Return the numbers of the pairs where the boolean ``pairs`` is true, without sums over pixels."""
        part = ResultTable(self.methods, [pair for pair, kept in zip(self.pairs, pairs, strict=True) if kept])
        part.values, part.common = self.values[:, pairs], self.common[:, :, pairs]
        part.counts, part.failed, part.scenes = self.counts[:, pairs], self.failed[:, pairs], self.scenes[pairs]
        part.by_noise = self.by_noise[pairs]
        return part

    def column(self, method: int, key: str) -> Array:
        """Return one number for all pairs, NaN where undefined."""
        return self.values[method, :, _COLUMN_BY_NUMBER[key]]

    def curve(self, method: int, key: str) -> list[float]:
        """Return the mean ``error_curve``, or the mean sparsification by ``texture`` or ``best``; [] if no pair
        has it.
        """
        total, count = self._curves[method][key]
        return list((total / count).tolist()) if count else []


def _pool_over_pixels(table: ResultTable, method: int) -> dict[str, float | None]:
    """Average ``POOLED_METRICS`` over the pixels of all pairs of a method, as ``pooled_*``."""
    weights = table.column(method, "n")
    pooled: dict[str, float | None] = {}
    for metric in POOLED_METRICS:
        numbers = table.column(method, metric)
        known = ~np.isnan(numbers) & (weights > 0)
        total = float((numbers * weights)[known].sum())
        pooled[f"pooled_{metric}"] = _divide_or_none(total, float(weights[known].sum()))
    return pooled


def summarise_method(table: ResultTable, method: int) -> dict[str, Any]:
    """Summarise one method over all pairs that count.

    Every metric is the mean over the pairs where it is defined, each with equal weight, as in the tables of the GUISS
    paper; ``n`` is the sum. ``intervals`` are the 95 % bounds of the means with enough scenes (see ``scene_means``),
    and ``scenes`` is the number of scenes behind them. ``pooled_*`` are means over the pixels of all pairs. ``pairs``
    is the number of pairs that count; ``failed`` and ``suspect`` count the others. ``strata`` contains, per factor, the
    ``classes`` and, per class, the ``by_pixel_class.SUMS`` over the pixels of all pairs, and ``histograms`` the sums of
    ``disparity_histograms``. For ``confidence`` see ``ConfidenceTable.summarise``. A quantile over all true pixels is
    infinite in a pair with too few measured pixels; its mean is then null.
    """
    counted = table.counts[method]
    result: dict[str, Any] = {
        "method": table.methods[method],
        "pairs": int(counted.sum()),
        "failed": int(table.failed[method].sum()),
        "suspect": int((~counted & ~table.failed[method]).sum()),
        "scenes": len(np.unique(table.scenes[counted])),
    }
    columns = table.values[method][:, [_COLUMN_BY_NUMBER[key] for key in _AVERAGED_NUMBERS]]
    result |= {
        key: _none_if_not_finite(mean) for key, mean in zip(_AVERAGED_NUMBERS, _average_columns(columns), strict=True)
    }
    result |= {key: int(np.nansum(table.column(method, key))) for key in _PIXEL_COUNTS}
    with_truth = counted & (table.column(method, "true_pixels") > 0)
    result |= {key: None for key in _TOTAL_QUANTILES if np.isnan(table.column(method, key)[with_truth]).any()}
    shares = np.array([is_share(key) for key in _AVERAGED_NUMBERS])
    bounds = find_mean_intervals(columns[counted], table.scenes[counted], shares)
    result["intervals"] = {
        key: [float(low), float(high)]
        for key, (low, high) in zip(_AVERAGED_NUMBERS, bounds, strict=True)
        if np.isfinite(low) and result[key] is not None
    }
    result |= _pool_over_pixels(table, method)
    result["pooled_coverage"] = _divide_or_none(result["n"], float(np.nansum(table.column(method, "true_pixels"))))
    result["error_curve"] = table.curve(method, "error_curve")
    result["sparsification"] = {key: table.curve(method, key) for key in ("texture", "best")}
    result["histograms"] = table.histograms[method] or {}
    result["plug_ins"] = {
        name: average_with_interval(numbers[method][counted], table.scenes[counted])
        for name, numbers in table.plugins.items()
    }
    result["confidence"] = table.confidence.summarise(method, counted, table.scenes)
    result["strata"] = {
        factor.key: {"classes": list(factor.classes), **sums}
        for factor in by_pixel_class.FACTORS
        if (sums := (table.strata[method] or {}).get(factor.key))
    }
    return result


def is_share(key: str) -> bool:
    """Return whether a number is a share, from 0 to 1."""
    return key.endswith(_SHARE_NAMES)


def compare_methods(
    table: ResultTable, seed: int, with_means: bool = False
) -> tuple[list[Comparison], list[dict[str, tuple[int, int]]]]:
    """Compare every two methods by each of COMPARED. Also return the ``typical_scene.find_rank_ranges`` of each method
    by metric.

    The means over scenes have bounds if ``with_means``, and if there are enough scenes. For the typical scene see
    ``typical_scene.ComparisonFamily``. Conditions that make a scene easy or hard for both methods cancel. Methods that
    measured nothing are not compared. There are ranks only if there are enough scenes for a verdict.
    """
    methods = [k for k in range(len(table.methods)) if np.nansum(table.column(k, "n")) > 0]
    chosen = [(methods[a], methods[b]) for a, b in list_method_pairs(len(methods))]
    found: list[Comparison] = []
    placed: list[dict[str, tuple[int, int]]] = [{} for _ in table.methods]
    for metric in COMPARED if chosen else ():
        columns, pairs = zip(*(_subtract_by_scene(table, a, b, metric) for a, b in chosen), strict=True)
        differences = np.stack(columns, axis=1)
        family, means = compare_in_typical_scene(differences, seed), _average_columns(differences)
        bounds = find_simultaneous_intervals(differences, seed) if with_means else np.full((len(chosen), 2), np.nan)
        better = np.zeros((len(table.methods), len(table.methods)), bool)
        for k, (a, b) in enumerate(chosen):
            sign = 1 if (family.typical[k] > 0) == metric.more_is_better else -1
            better[a, b], better[b, a] = family.found[k] and sign > 0, family.found[k] and sign < 0
            number = partial(_find_number, k, np.exp if metric.ratio else float)
            found.append(
                {
                    "a": table.methods[a],
                    "b": table.methods[b],
                    "metric": metric.key,
                    "kind": "ratio" if metric.ratio else "difference",
                    "pairs": pairs[k],
                    "scenes": int(family.scenes[k]),
                    "value": number(means),
                    "low": number(bounds[:, 0]),
                    "high": number(bounds[:, 1]),
                    "typical": number(family.typical),
                    "typical_low": number(family.low),
                    "typical_high": number(family.high),
                    "detectable": number(family.detectable),
                    "p": _none_if_not_finite(family.p[k]),
                    "scenes_needed": family.needed,
                    "better": table.methods[a if better[a, b] else b] if family.found[k] else None,
                }
            )
        if np.isfinite(family.p).any():
            for k, place in zip(methods, find_rank_ranges(better[np.ix_(methods, methods)]), strict=True):
                placed[k][metric.key] = place
    return found, placed


def _subtract_by_scene(table: ResultTable, a: int, b: int, metric: ComparedMetric) -> tuple[Array, int]:
    """Subtract two methods in each scene, or the logarithms of their means for a ratio, NaN where undefined. Also
    return the number of pairs with both methods.
    """
    if metric.key in _COMMON_PLACE:
        place = _COMMON_PLACE[metric.key]
        one, other = table.common[a, b, :, place], table.common[b, a, :, place]
    else:
        one, other = table.column(a, metric.key), table.column(b, metric.key)
    both = np.stack([one, other], axis=1)
    both[np.isnan(both).any(axis=1) | ~(table.counts[a] & table.counts[b])] = np.nan
    means = average_by_scene(both, table.scenes)
    if metric.ratio:
        means = np.maximum(means, _MIN_COMPARED)
    return find_differences(means[:, 0], means[:, 1], metric.ratio), int((~np.isnan(both[:, 0])).sum())


def _average_columns(columns: Array) -> Array:
    known = ~np.isnan(columns)
    count = known.sum(axis=0)
    total = np.where(known, columns, 0.0).sum(axis=0)
    return np.divide(total, count, out=np.full(columns.shape[1], np.nan), where=count > 0)


def _none_if_not_finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _divide_or_none(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _find_number(place: int, turn: Callable[[float], float], values: Array) -> float | None:
    return _none_if_not_finite(turn(values[place]))

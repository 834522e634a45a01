"""Errors against the number of range points, from the rows of an evaluation."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .evaluated_pairs import Source
from .fusion.match_prepared import find_search_ranges, match_prepared
from .matchers.lidar_options import LIDAR, complete_lidar_options
from .matchers.methods import Method
from .measure.prepare_pair import PreparedPair
from .measure.row_metrics import disparity_to_depth
from .report.row_log import Row

#: The metrics of a curve, by their columns in the table.
METRICS = {"bad_1": "total_bad_1", "over_10_cm": "total_l1_rate_10"}
#: Columns of the table.
COLUMNS = ("pair", "matcher", "points", "noise_cm", "shift_px", "method", *METRICS, "cpu_s")


@dataclass(frozen=True)
class PointSweep:
    """The range points of a comparison: all combinations of points, noise and shift, and the ways in which matchers use
    the points.

    ``ways`` are pairs of ``rule`` and ``guide``, see ``lidar_options``. ``shared`` are options of all methods, as
    texts.
    """

    points: Sequence[int]
    noise_cm: Sequence[float]
    shift_px: Sequence[float]
    ways: Sequence[tuple[str, str]]
    shared: Mapping[str, str]

    def list_methods(self, matchers: Sequence[Method]) -> list[Method]:
        """List the matchers alone, the interpolation alone, and both together. Raises IcyMoonError for bad or repeated
        numbers.
        """
        found = [*matchers]
        for points, noise, shift in product(self.points, self.noise_cm, self.shift_px):
            given = {"points": f"{points}", "noise_cm": f"{noise:g}", "shift_px": f"{shift:g}", **self.shared}
            found.append(Method(_format_method("", given), LIDAR, {}, complete_lidar_options(LIDAR, given)))
            for matcher, (rule, guide) in product(matchers, self.ways):
                more = given | {"rule": rule, "guide": guide}
                options = complete_lidar_options(matcher.name, more)
                found.append(replace(matcher, label=_format_method(matcher.label, more), lidar=options))
        if len({method.label for method in found}) < len(found):
            raise IcyMoonError("A number of points, a noise, a shift or a way is stated twice; leave one out.")
        return found


def _format_method(matcher: str, given: Mapping[str, str]) -> str:
    """Write a method in the spelling of ``--methods``, without options that have their defaults."""
    usual = complete_lidar_options(matcher or LIDAR, {})
    asked = complete_lidar_options(matcher or LIDAR, given)
    stated = [f"{key}={given[key]}" for key in given if key == "points" or asked[key] != usual[key]]
    return ":".join((f"{matcher}+{LIDAR}" if matcher else LIDAR, *stated))


def list_curves(rows: Sequence[Row], methods: Sequence[Method]) -> list[dict[str, Any]]:
    """Make an entry with the COLUMNS for each result. ``points`` is 0 for a matcher alone; ``matcher`` is "" for the
    interpolation alone.
    """
    named = {method.label: method for method in methods}
    found = []
    for row in rows:
        method = named.get(row["method"])
        if method is None or row["status"] == "failed":
            continue
        lidar = method.lidar or {}
        found.append(
            {
                "pair": row["pair"],
                "matcher": "" if method.name == LIDAR else _name_matcher(method),
                "points": lidar.get("points", 0),
                "noise_cm": lidar.get("noise_cm", 0.0),
                "shift_px": lidar.get("shift_px", 0.0),
                "method": method.label,
                **{name: row[key] for name, key in METRICS.items()},
                "cpu_s": row["seconds"],
            }
        )
    return found


def measure_curves(
    sources: Sequence[Source],
    methods: Sequence[Method],
    response: Mapping[str, Mapping[str, Any]],
    tell: Callable[[dict[str, Any]], None],
) -> list[Row]:
    """Measure rows for ``list_curves``, without the other metrics and the pictures of an evaluation, which take longer.

    ``tell`` gets a progress event for each pair. Raises IcyMoonError with the first error.
    """
    rows: list[Row] = []
    for done, source in enumerate(sources):
        total = len(sources)
        tell({"type": "progress", "fraction": done / total, "done": done, "total": total, "message": source.name})
        prepared = source.prepare(response)
        ranges = cache(partial(find_search_ranges, prepared))
        for method in methods:
            disparity, info = match_prepared(method, prepared, ranges)
            rows.append(
                {
                    "pair": source.name,
                    "method": method.label,
                    "status": "ok",
                    "seconds": info["seconds"],
                    **_measure_rates(prepared, disparity),
                }
            )
    return rows


def _measure_rates(prepared: PreparedPair, disparity: Array) -> dict[str, float]:
    """Measure the METRICS of a disparity (H, W), px: shares of the pixels with a true depth. A missing disparity counts
    as wrong.
    """
    true_m = prepared.truth[prepared.known]
    depth_m = disparity_to_depth(prepared, disparity)[prepared.known]
    off_px = np.abs(disparity[prepared.known] - prepared.pair.camera.disparity(true_m))
    rates = np.mean(~(off_px <= 1)), np.mean(~(np.abs(depth_m - true_m) <= 0.1))
    return {key: float(rate) for key, rate in zip(METRICS.values(), rates, strict=True)}


def _name_matcher(method: Method) -> str:
    return method.label.rpartition(f"+{LIDAR}")[0] if method.lidar is not None else method.label


def find_crossover(curves: Sequence[Mapping[str, Any]], pair: str, matcher: str, metric: str) -> int | None:
    """Find the smallest number of points from which on the interpolation alone has fewer errors on a pair than a
    matcher alone; None if there is no such number. ``curves`` have one noise and one shift.
    """
    alone = next(
        row[metric] for row in curves if row["pair"] == pair and row["matcher"] == matcher and not row["points"]
    )
    last = None
    for row in sorted(curves, key=lambda row: -row["points"]):
        if row["pair"] == pair and not row["matcher"]:
            if row[metric] is None or alone is None or row[metric] >= alone:
                break
            last = row["points"]
    return last


def encode_curves(curves: Sequence[Mapping[str, Any]]) -> str:
    """Encode the curves as CSV; shares are numbers from 0 to 1."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(curves)
    return stream.getvalue()

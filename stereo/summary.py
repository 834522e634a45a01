"""Rows of an evaluation put together: averages per method, and the table as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

from .metrics import DEPTH_METRICS, DISPARITY_METRICS

METRICS = (*DEPTH_METRICS, *DISPARITY_METRICS)
#: Prefixes of the metrics -> the pixels that they are over, for people to read.
REGIONS = {"": "all pixels with a true depth; a missing measurement lowers the coverage and is no error",
           "visible_": "pixels that the right eye sees too: neither occluded nor outside its image",
           "common_": "pixels that every method measured, the only ones on which their errors compare like with like"}

#: Means over pixels, so that the pixels of all pairs can be thrown together. The scale-invariant
#: and order metrics compare pixels of one image and have no such sum.
POOLED = ("l1_m", "l1_rate_10", "bias_m", "abs_rel", "l1_rate_30", "l1_rate_100", *DISPARITY_METRICS)

_COLUMNS = ("pair", "method", "status", *(prefix + metric for prefix in REGIONS for metric in METRICS),
            "true_pixels", "seconds", "error")

Row = Mapping[str, Any]


def summary(label: str, rows: Sequence[Row]) -> dict[str, Any]:
    """One method over all pairs.

    Every metric is the mean over the pairs where it is defined, each pair counting alike, as in the
    paper's tables; ``n`` is the sum. ``pooled_*`` are over the pixels of all pairs, each pixel
    counting alike. ``pairs`` counts those that could be evaluated, ``failed`` the others.
    """
    own = [row for row in rows if row["method"] == label]
    scored = [row for row in own if row["status"] == "ok"]
    result: dict[str, Any] = {"method": label, "pairs": len(scored), "failed": len(own) - len(scored)}
    for prefix in REGIONS:
        result |= {prefix + metric: _mean(scored, prefix + metric) for metric in METRICS}
        result[f"{prefix}n"] = sum(row[f"{prefix}n"] for row in scored)
    result["seconds"] = _mean(scored, "seconds")
    for metric in POOLED:
        result[f"pooled_{metric}"] = _ratio(math.fsum(row[metric] * row["n"] for row in scored if row["n"]),
                                            result["n"])
    result["pooled_coverage"] = _ratio(result["n"], sum(row["true_pixels"] for row in scored))
    curves = [row["error_curve"] for row in scored if row["true_pixels"]]
    result["error_curve"] = [math.fsum(shares) / len(curves) for shares in zip(*curves, strict=True)]
    return result


def csv_table(rows: Sequence[Row]) -> str:
    """All rows as CSV text, with a header line; undefined numbers are empty."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, _COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _mean(rows: Sequence[Row], key: str) -> float | None:
    values = [row[key] for row in rows if row[key] is not None]
    return _ratio(math.fsum(values), len(values))


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None

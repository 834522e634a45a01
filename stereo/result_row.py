"""A result row: the metrics, costs and facts of one method on one pair, measured or failed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..support.arrays import Array
from .matchers.methods import Method
from .measure.confidence_metrics import make_confidence_entries
from .measure.metrics import COSTS
from .measure.plug_in import measure_plugin_metrics
from .measure.prepare_pair import PreparedPair
from .measure.row_metrics import NUMBERS, measure_row_numbers
from .report.row_log import Row


def make_result_row(
    prepared: PreparedPair,
    method: Method,
    key: str,
    disparity: Array,
    info: Mapping[str, Any],
    confidences: Mapping[str, Array],
) -> Row:
    """Make the row of a method from its disparity (H, W), px, the facts ``info`` of ``match``, and the ``confidences``
    of its pixels, by measure.

    ``key`` is the digest by which a later run recognises the row. Metrics over common pixels and the paths of pictures
    are added later.
    """
    return {
        "pair": prepared.pair.name,
        "method": method.label,
        "key": key,
        "status": "ok" if prepared.check.ok else "suspect",
        **measure_row_numbers(prepared, disparity, _find_bm_least(method, info)),
        **measure_plugin_metrics(prepared, disparity),
        **make_confidence_entries(disparity, prepared.pair.camera.disparity(prepared.truth), confidences),
        "common": {},
        **{cost: info[cost] for cost in COSTS},
        "options": info["options"],
        "search": info["search"],
        "counts": info["counts"],
        "facts": info["facts"],
        "error": "",
        "images": {},
    }


def _find_bm_least(method: Method, info: Mapping[str, Any]) -> int | None:
    """Find the least disparity of a map that StereoBM alone computed. None for other maps, also for maps that were
    joined with range points, in which failed matches have no mark.
    """
    return info["options"]["min_disparity"] if method.name == "bm" and method.lidar is None else None


def make_failed_row(pair: str, method: Method, key: str, message: str) -> Row:
    """Make the row of a method that failed on a pair; ``message`` is the error."""
    return {
        "pair": pair,
        "method": method.label,
        "key": key,
        "status": "failed",
        **dict.fromkeys(NUMBERS),
        "error_curve": [],
        "sparsification": {},
        "strata": {},
        "histograms": {},
        "common": {},
        "options": method.options,
        "search": None,
        "counts": {},
        "facts": {},
        "error": message,
        "images": {},
    }

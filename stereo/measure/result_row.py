"""The numbers of a row: one disparity map, measured against the truth of its pair."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .by_pixel_class import sums_by_class
from .costs import COSTS
from .disparity_histograms import histograms_of
from .guiss_reference_code import METRICS as GUISS_METRICS
from .guiss_reference_code import reference_metrics
from .metrics import (
    DEPTH_METRICS,
    DISPARITY_METRICS,
    TOTAL_METRICS,
    depth_metrics,
    disparity_metrics,
    error_curve,
    sparsification,
    total_metrics,
    usable,
)
from .prepare import Prepared, none_for_nan

METRICS = (*DEPTH_METRICS, *DISPARITY_METRICS)
#: Prefix of metrics -> the pixels that they are computed over, in words.
REGIONS = {"": "all pixels with a true depth; a missing measurement lowers the coverage and is no error",
           "total_": "all pixels with a true depth; a missing measurement counts as wrong",
           "visible_": "pixels that the right eye sees too: neither occluded nor outside its image"}
#: Prefix -> the metrics that rows have with it.
REGION_METRICS = {prefix: TOTAL_METRICS if prefix == "total_" else METRICS for prefix in REGIONS}
#: Everything in a row that is a number, or None if it is undefined.
NUMBERS = (*(prefix + key for prefix, keys in REGION_METRICS.items() for key in keys), *GUISS_METRICS, "true_pixels",
           *COSTS)


def depth_of(prepared: Prepared, disparity: np.ndarray) -> np.ndarray:
    """Planar depth in m, float64, of a disparity map; NaN where there is no valid disparity."""
    return np.where(usable(disparity), prepared.pair.camera.depth(disparity), np.nan)


def own_numbers(prepared: Prepared, disparity: np.ndarray, bm_min_disparity: int | None = None) -> dict[str, Any]:
    """NUMBERS except COSTS, and ``error_curve``, ``sparsification``, ``strata`` and ``histograms``, of a
    disparity map.

    ``bm_min_disparity``: see ``guiss_reference_code.reference_metrics``.
    """
    disparity = np.where(usable(disparity), disparity, np.nan)
    depth, truth = depth_of(prepared, disparity), prepared.truth
    true_disparity = prepared.pair.camera.disparity(truth)
    known = prepared.known
    visible = prepared.visible[known]
    maps = depth[known], truth[known], disparity[known], true_disparity[known]
    seen = maps[0][visible], maps[1][visible], maps[2][visible], maps[3][visible]
    order, visible_order = prepared.true_order.disagreements(maps[0], usable(maps[0]), visible)
    result = _numbers(*maps, order)
    result |= {f"total_{key}": value for key, value in total_metrics(*maps, order).items()}
    result |= {f"visible_{key}": value if prepared.occlusion_known else float("nan")
               for key, value in _numbers(*seen, visible_order).items()}
    result |= reference_metrics(disparity, truth, bm_min_disparity)
    error = np.abs(np.where(prepared.visible, disparity - true_disparity, np.nan)).ravel()
    return _json(result) | {
        "true_pixels": maps[1].size, "error_curve": _list(error_curve(*maps[:2])),
        "sparsification": {"texture": _list(sparsification(error[prepared.by_texture])),
                           "best": _list(sparsification(np.sort(error)))},
        "strata": sums_by_class(prepared.classes, depth, truth, disparity, true_disparity,
                                prepared.pair.camera.doffs_px),
        "histograms": histograms_of(*maps[2:])}


def _numbers(depth: np.ndarray, truth: np.ndarray, disparity: np.ndarray, true_disparity: np.ndarray, dod: float
             ) -> dict[str, float]:
    return depth_metrics(depth, truth, dod) | disparity_metrics(disparity, true_disparity)


def _json(numbers: Mapping[str, float]) -> dict[str, float | None]:
    return {key: none_for_nan(value) for key, value in numbers.items()}


def _list(numbers: list[float]) -> list[float | None]:
    return [None if (value := none_for_nan(number)) is None else float(f"{value:.7g}") for number in numbers]

"""The numbers of a result row: one disparity map, measured against the truth of its pair."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...support.arrays import Array
from .by_pixel_class import sum_by_class
from .disparity_histograms import make_histograms
from .guiss_reference_code import METRICS as GUISS_METRICS
from .guiss_reference_code import compute_reference_metrics
from .metrics import (
    COSTS,
    DEPTH_METRICS,
    DISPARITY_METRICS,
    TOTAL_METRICS,
    Errors,
    compute_depth_metrics_of_errors,
    compute_disparity_metrics_of_errors,
    compute_error_curve_of_errors,
    compute_sparsification,
    compute_total_metrics_of_errors,
    is_usable,
)
from .prepare_pair import PreparedPair, none_if_not_finite

METRICS = (*DEPTH_METRICS, *DISPARITY_METRICS)
#: Prefix of metrics -> their pixels, in words.
REGIONS = {
    "": "all pixels with a true depth; a missing measurement lowers the coverage and raises no error",
    "total_": "all pixels with a true depth; a missing measurement counts as wrong",
    "visible_": "pixels that the right eye sees too: neither occluded nor outside its image",
}
#: Prefix -> the metrics that rows have with it.
REGION_METRICS = {prefix: TOTAL_METRICS if prefix == "total_" else METRICS for prefix in REGIONS}
#: All numbers of a row; an undefined number is None.
NUMBERS = (
    *(prefix + key for prefix, keys in REGION_METRICS.items() for key in keys),
    *GUISS_METRICS,
    "true_pixels",
    *COSTS,
)


def disparity_to_depth(prepared: PreparedPair, disparity: Array) -> Array:
    """Convert a disparity map to planar depth in m, float64; NaN where there is no valid disparity."""
    return np.where(is_usable(disparity), prepared.depth_camera.depth(disparity), np.nan)


def measure_row_numbers(
    prepared: PreparedPair, disparity: Array, bm_min_disparity: int | None = None
) -> dict[str, Any]:
    """Measure a disparity map: NUMBERS except COSTS, and ``error_curve``, ``sparsification``, ``strata`` and
    ``histograms``.

    ``bm_min_disparity``: see ``guiss_reference_code.compute_reference_metrics``.
    """
    disparity = np.where(is_usable(disparity), disparity, np.nan)
    depth, truth = disparity_to_depth(prepared, disparity), prepared.truth
    true_disparity = prepared.pair.camera.disparity(truth)
    known = prepared.known
    visible = prepared.visible[known]
    depths, true_depths = depth[known], truth[known]
    disparities, true_disparities = disparity[known], true_disparity[known]
    order, visible_order = prepared.true_order.disagreements(depths, is_usable(depths), visible)
    errors_m, errors_px = Errors(depths, true_depths), Errors(disparities, true_disparities)
    result = compute_depth_metrics_of_errors(errors_m, order) | compute_disparity_metrics_of_errors(errors_px)
    result |= {
        f"total_{key}": value for key, value in compute_total_metrics_of_errors(errors_m, errors_px, order).items()
    }
    seen = compute_depth_metrics_of_errors(
        Errors(depths[visible], true_depths[visible]), visible_order
    ) | compute_disparity_metrics_of_errors(Errors(disparities[visible], true_disparities[visible]))
    result |= {f"visible_{key}": value if prepared.occlusion_known else float("nan") for key, value in seen.items()}
    result |= compute_reference_metrics(disparity, truth, bm_min_disparity)
    error = np.abs(np.where(prepared.visible, disparity - true_disparity, np.nan)).ravel()
    return _to_json_numbers(result) | {
        "true_pixels": errors_m.total,
        "error_curve": _to_json_list(compute_error_curve_of_errors(errors_m)),
        "sparsification": {
            "texture": _to_json_list(compute_sparsification(error[prepared.by_texture])),
            "best": _to_json_list(compute_sparsification(np.sort(error))),
        },
        "strata": sum_by_class(
            prepared.cells, depths, true_depths, disparities, true_disparities, prepared.pair.camera.doffs_px
        ),
        "histograms": make_histograms(disparities, true_disparities),
    }


def _to_json_numbers(numbers: Mapping[str, float]) -> dict[str, float | None]:
    return {key: none_if_not_finite(value) for key, value in numbers.items()}


def _to_json_list(numbers: list[float]) -> list[float | None]:
    return [None if (value := none_if_not_finite(number)) is None else float(f"{value:.7g}") for number in numbers]

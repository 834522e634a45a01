"""The numbers that the GUISS reference code would report for a disparity map, for comparison with published tables.

It differs from the metrics here in ways that matter (nasa-jpl/guiss: ``stereoBM_eval.py``, ``IGEV_eval.py``,
``utils.calc_metrics``, ``gen_res.calc_metrics_offline``, ``get_pairs``):

* depth is 80 / disparity, "scaled by 10", although f·B is 85.333 px·m, so every depth is 6.25 % too small;
* 1e-4 px is added to disparities, and StereoBM's mark of a failed match, one less than its least disparity, counts as a
  disparity;
* pixels count if the predicted depth is in [0.01, 100] m and the true one in (0.05, 100] m, in rows 48 to 432 of 480
  and, for StereoBM, in columns 125 to 600 of 640;
* the order of depths is compared on a lattice of positions in the list of these pixels; fewer than about 10 100 pixels
  give no pair;
* everything is in single precision, in which the scale-invariant error of a nearly perfect map may be NaN.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from .depth_order import measure_pair_disagreement

FOCAL_BASELINE_PX_M = 80.0
METRICS = (
    "guiss_l1_m",
    "guiss_l1_rate_10",
    "guiss_l1_rate_30",
    "guiss_l1_rate_100",
    "guiss_rmse_m",
    "guiss_si_rmse",
    "guiss_dod",
    "guiss_n",
)
# The lattice: the number of pixels that are skipped at both ends, and the steps of the two indices of a pair.
_SKIPPED_PIXELS, _FINE_STEP, _COARSE_STEP = 5000, 100, 1000


def compute_reference_metrics(
    disparity: Array, truth: Array, bm_min_disparity: int | None = None
) -> dict[str, float | int]:
    """Compute the numbers METRICS of the reference code, for a disparity map (px) and the true depth (m), both (H, W).

    For StereoBM give its least disparity, ``bm_min_disparity``: failed matches (NaN) then get its mark, and columns are
    cut as the reference code does for this matcher. The cuts are those for 640 x 480 px, in proportion.
    """
    height, width = truth.shape
    rows, columns = slice(height * 48 // 480, height * 432 // 480), slice(None)
    if bm_min_disparity is not None:
        disparity = np.where(np.isnan(disparity), bm_min_disparity - 1, disparity)
        columns = slice(width * 125 // 640, width * 600 // 640)
    shift = disparity[rows, columns].astype(np.float32) + np.float32(1e-4)
    with np.errstate(divide="ignore", invalid="ignore"):
        return compute_depth_map_metrics(np.float32(FOCAL_BASELINE_PX_M) / shift, truth[rows, columns])


def compute_depth_map_metrics(prediction: Array, truth: Array) -> dict[str, float | int]:
    """Compute the numbers of ``compute_reference_metrics`` for a depth map, without the constant and the cuts."""
    prediction, truth = prediction.astype(np.float32), truth.astype(np.float32)
    counted = (prediction >= 0.01) & (prediction <= 100) & (truth > 0.05) & (truth <= 100)  # False for NaN
    predicted, true = prediction[counted], truth[counted]
    n = int(counted.sum())
    result: dict[str, float | int] = dict.fromkeys(METRICS, float("nan")) | {"guiss_n": n}
    if n == 0:
        return result
    distance = np.abs(predicted - true)
    ratio = np.log(predicted) - np.log(true)
    with np.errstate(invalid="ignore"):
        si_rmse = float(np.sqrt(np.mean(ratio**2) - np.mean(ratio) ** 2))
    return result | {
        "guiss_l1_m": float(distance.mean()),
        "guiss_rmse_m": float(np.sqrt(np.mean(distance**2))),
        **{f"guiss_l1_rate_{cm}": float(np.mean(distance > np.float32(cm / 100))) for cm in (10, 30, 100)},
        "guiss_si_rmse": si_rmse,
        "guiss_dod": measure_pair_disagreement(predicted, true, *choose_lattice_pairs(n)),
        "guiss_n": n,
    }


def choose_lattice_pairs(count: int) -> tuple[Array, Array]:
    """Choose the pairs of indices i < j, among ``count`` pixels, whose order of depths the reference code compares.

    It skips the first 5000 and the last 5000 pixels. Counted from pixel 5000, one index of a pair is a multiple of 1000
    and the other a multiple of 100.
    """
    fine = np.arange(_SKIPPED_PIXELS, count - _SKIPPED_PIXELS, _FINE_STEP)
    coarse = np.arange(_SKIPPED_PIXELS, count - _SKIPPED_PIXELS, _COARSE_STEP)
    first, second = np.broadcast_arrays(fine[:, None], coarse)
    before = first < second
    # A pair of two coarse positions occurs twice; count it once.
    after = (first > second) & ((fine - _SKIPPED_PIXELS) % _COARSE_STEP != 0)[:, None]
    return (np.concatenate([first[before], second[after]]), np.concatenate([second[before], first[after]]))

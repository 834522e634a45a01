"""Metrics of a predicted depth or disparity against the truth, in float64.

The pixels that count, V, are those where both depths are finite and positive. An invalid prediction is never a depth.
Coverage is the share of the true pixels that are in V. Rates and coverage are fractions. An undefined metric (no pixel,
or the order of one pixel) is NaN, never a flattering 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...support.arrays import Array
from .depth_order import measure_depth_order_disagreement

#: CPU seconds, elapsed seconds, seconds and MiB of a GPU, MiB of memory. The first two are known for every matcher.
COSTS = ("seconds", "wall_seconds", "gpu_seconds", "gpu_mb", "memory_mb")

DEPTH_METRICS = (
    "l1_m",
    "l1_rate_10",
    "si_mse",
    "si_rmse",
    "dod",
    "coverage",
    "n",
    "rmse_m",
    "median_m",
    "bias_m",
    "abs_rel",
    "l1_rate_30",
    "l1_rate_100",
)
#: Key of a rate -> the depth error, m, above which a pixel counts.
L1_RATES = {"l1_rate_10": 0.10, "l1_rate_30": 0.30, "l1_rate_100": 1.00}
#: Errors, m, of the cumulative curve: 1 cm to 10 m, ten steps per decade.
ERROR_STEPS_M = tuple(float(f"{step:.4g}") for step in np.geomspace(0.01, 10.0, 31))
#: Shares of the measurements that a sparsification curve keeps.
KEPT_SHARES = tuple(k / 20 for k in range(1, 21))
#: Key of a rate -> the disparity error, px, above which a pixel counts.
BAD_RATES = {"bad_0_5": 0.5, "bad_1": 1.0, "bad_2": 2.0, "bad_3": 3.0}
#: Key of a quantile of the disparity error (Middlebury's A50 and so on) -> the share of pixels below it.
ERROR_QUANTILES = {"a50_px": 0.50, "a90_px": 0.90, "a95_px": 0.95, "a99_px": 0.99}
DISPARITY_METRICS = ("epe_px", *BAD_RATES, "d1", *ERROR_QUANTILES)
#: Metrics that are defined when a missing measurement counts as an infinite error.
TOTAL_METRICS = ("median_m", "l1_rate_10", "l1_rate_30", "l1_rate_100", "dod", *BAD_RATES, "d1", *ERROR_QUANTILES)


def is_usable(depth: Array) -> Array:
    """Return where a depth or disparity is finite and positive: boolean, of the same shape."""
    return np.isfinite(depth) & (depth > 0)


def find_wrong_share(disparity: Array, truth: Array, judged: Array, most_px: float = 1.0) -> float:
    """Find the share of the ``judged`` pixels, bool (H, W), whose disparity is missing or off by more than ``most_px``;
    NaN without such pixels.
    """
    if not judged.any():
        return float("nan")
    with np.errstate(invalid="ignore"):
        agrees = np.abs(disparity - truth)[judged] <= most_px  # False for NaN
    return float(np.mean(~agrees))


class Errors:
    """The errors of a prediction where both prediction and truth, arrays of the same shape, are usable."""

    def __init__(self, prediction: Array, truth: Array) -> None:
        known = is_usable(truth)
        both = known & is_usable(prediction)
        self.total = int(known.sum())  # pixels that have a truth
        self.predicted, self.true = (np.asarray(values, np.float64)[both] for values in (prediction, truth))
        self.error = self.predicted - self.true
        self.distance = np.abs(self.error)

    def within(self, step: float) -> int:
        """Count the absolute errors up to ``step``."""
        return int(np.count_nonzero(self.distance <= step))

    def smallest(self, *ranks: int) -> Array:
        """Return the absolute errors with these ranks in ascending order; the smallest has rank 0. This is faster than
        sorting.
        """
        return np.asarray(np.partition(self.distance, ranks)[list(ranks)])

    def wrong_by_kitti(self) -> int:
        """Count the errors above 3 px and above 5 % of the true disparity."""
        return int(np.count_nonzero((self.distance > 3) & (self.distance > 0.05 * self.true)))


def compute_depth_metrics(prediction: Array, truth: Array) -> dict[str, float | int]:
    """Compute metrics of planar depths in metres; two arrays of the same shape, NaN where there is no depth.

    With e = prediction - truth and d = ln prediction - ln truth on V, N = |V|:

    * ``l1_m`` mean |e|, ``median_m`` median |e|, ``rmse_m`` root of mean e², ``bias_m`` mean e, ``abs_rel`` mean |e| /
      truth; ``l1_rate_10``, ``_30``, ``_100`` share of |e| > 0.10, 0.30, 1.00 m;
    * ``si_mse`` mean d² - (mean d)² (Eigen et al. 2014 with λ = 1; the formula of the GUISS paper), computed as the
      variance of d in two passes, so that a prediction that is right except for its scale gives 0 and not rounding
      noise; ``si_rmse`` its root (which the code of the paper prints);
    * ``dod`` depth order disagreement, see ``depth_order``;
    * ``coverage`` N / number of true pixels, ``n`` N.
    """
    errors = Errors(prediction, truth)
    return compute_depth_metrics_of_errors(errors, measure_depth_order_disagreement(errors.predicted, errors.true))


def compute_depth_metrics_of_errors(errors: Errors, dod: float) -> dict[str, float | int]:
    """Compute ``compute_depth_metrics`` from errors in metres. ``dod`` is given, because it takes most of the time."""
    n, distance, true = errors.error.size, errors.distance, errors.true
    result: dict[str, float | int] = dict.fromkeys(DEPTH_METRICS, float("nan"))
    result |= {"n": n, "coverage": n / errors.total if errors.total else float("nan")}
    if n == 0:
        return result
    with np.errstate(over="ignore"):  # the square of an absurd depth may be infinite, and so is the metric then
        ratio = np.log(errors.predicted) - np.log(true)
        si_mse = float(np.mean((ratio - ratio.mean()) ** 2))
        result |= {
            "l1_m": float(distance.mean()),
            **{key: (n - errors.within(step)) / n for key, step in L1_RATES.items()},
            "si_mse": si_mse,
            "si_rmse": si_mse**0.5,
            "dod": dod,
            "rmse_m": float(np.mean(distance**2)) ** 0.5,
            "median_m": float(np.mean(errors.smallest((n - 1) // 2, n // 2))),
            "bias_m": float(errors.error.mean()),
            "abs_rel": float(np.mean(distance / true)),
        }
    return result


def compute_disparity_metrics(prediction: Array, truth: Array) -> dict[str, float]:
    """Compute metrics of disparities in px; two arrays of the same shape. With e = prediction - truth on V:

    ``epe_px`` mean |e|; ``bad_0_5``, ``bad_1``, ``_2``, ``_3`` share of |e| > 0.5, 1, 2, 3 px; ``d1`` share of |e| > 3
    px and > 5 % of the true disparity (KITTI 2015); ``a50_px``, ``a90_px``, ``a95_px``, ``a99_px`` the 50, 90, 95 and
    99 % quantiles of |e| (Middlebury).
    """
    return compute_disparity_metrics_of_errors(Errors(prediction, truth))


def compute_disparity_metrics_of_errors(errors: Errors) -> dict[str, float]:
    """Compute ``compute_disparity_metrics`` from errors in px."""
    n = errors.distance.size
    if not n:
        return dict.fromkeys(DISPARITY_METRICS, float("nan"))
    return {
        "epe_px": float(errors.distance.mean()),
        **{key: (n - errors.within(step)) / n for key, step in BAD_RATES.items()},
        "d1": errors.wrong_by_kitti() / n,
        **_find_quantiles_by_name(errors, n),
    }


def compute_total_metrics(
    depth: Array, true_depth: Array, disparity: Array, true_disparity: Array, dod: float
) -> dict[str, float]:
    """Compute TOTAL_METRICS over all true pixels, where a missing measurement counts as wrong (Middlebury's "totbad").

    Rates are (wrong + missing) / true. For quantiles (``median_m`` is one) a missing measurement has an infinite error,
    so a quantile is infinite if too many are missing. For ``dod`` every pair with a missing pixel disagrees; the
    argument ``dod`` is the value over the measured pixels. NaN if there is no true pixel.
    """
    return compute_total_metrics_of_errors(Errors(depth, true_depth), Errors(disparity, true_disparity), dod)


def compute_total_metrics_of_errors(errors_m: Errors, errors_px: Errors, dod: float) -> dict[str, float]:
    """Compute ``compute_total_metrics`` from errors of depth and disparity."""
    total, measured = errors_m.total, errors_m.error.size
    if not total:
        return dict.fromkeys(TOTAL_METRICS, float("nan"))
    right = {key: errors_m.within(step) for key, step in L1_RATES.items()}
    right |= {key: errors_px.within(step) for key, step in BAD_RATES.items()}
    right["d1"] = errors_px.distance.size - errors_px.wrong_by_kitti()
    agreeing = (1 - dod) * measured * (measured - 1) if measured > 1 else 0.0
    return {
        "median_m": _find_quantiles(errors_m, [0.5], total)[0],
        **{key: 1 - count / total for key, count in right.items()},
        "dod": 1 - agreeing / (total * (total - 1)) if total > 1 else float("nan"),
        **_find_quantiles_by_name(errors_px, total),
    }


def _find_quantiles_by_name(errors: Errors, total: int) -> dict[str, float]:
    return dict(zip(ERROR_QUANTILES, _find_quantiles(errors, list(ERROR_QUANTILES.values()), total), strict=True))


def _find_quantiles(errors: Errors, shares: Sequence[float], total: int) -> list[float]:
    """Find, for each share, the smallest error that at least this share of ``total`` pixels does not exceed; infinite
    if too few pixels are measured.

    It is always one of the errors, never a mean of two, so that infinite errors need no other rule.
    """
    ranks = [max(0, int(np.ceil(share * total - 1e-9)) - 1) for share in shares]
    measured = [rank for rank in ranks if rank < errors.distance.size]
    found = dict(zip(measured, errors.smallest(*measured).tolist(), strict=True)) if measured else {}
    return [found.get(rank, float("inf")) for rank in ranks]


def compute_error_curve(prediction: Array, truth: Array) -> list[float]:
    """Compute the share of all true pixels that are measured with an error within each of ERROR_STEPS_M; NaN without
    truth.

    A missing measurement counts as outside every limit, so the curve ends at the coverage and shows coverage and
    accuracy together.
    """
    return compute_error_curve_of_errors(Errors(prediction, truth))


def compute_error_curve_of_errors(errors: Errors) -> list[float]:
    """Compute ``compute_error_curve`` from errors in metres."""
    if not errors.total:
        return [float("nan")] * len(ERROR_STEPS_M)
    return [errors.within(step) / errors.total for step in ERROR_STEPS_M]


def sort_by_confidence(confidence: Array) -> Array:
    """Return the indices of all pixels, the most confident first; pixels of equal confidence keep the order of the
    image.

    Confidence is compared in single precision: its bits are sorted in two halves, which is four times as fast as
    sorting numbers.
    """
    with np.errstate(over="ignore"):
        # Adding 0 turns -0 into 0, so that both sort alike.
        bits = (confidence.ravel() + 0.0).astype(np.float32).view(np.uint32)
    descending = np.where(bits >> 31, bits, ~bits ^ 0x80000000)
    order = np.argsort(descending.astype(np.uint16), kind="stable")
    return np.asarray(order[np.argsort((descending >> 16).astype(np.uint16)[order], kind="stable")])


def compute_sparsification(error_px: Array) -> list[float]:
    """Compute the mean |error| of the most confident measurements, for each of KEPT_SHARES; NaN if all are missing.

    ``error_px`` (pixels,) is in the order of ``sort_by_confidence``, and NaN where nothing was measured. Errors in
    ascending order give the best possible curve.
    """
    errors = error_px[np.isfinite(error_px)]
    if not errors.size:
        return [float("nan")] * len(KEPT_SHARES)
    kept = [max(1, round(share * errors.size)) for share in KEPT_SHARES]
    return [float(total) / count for total, count in zip(np.cumsum(errors)[np.array(kept) - 1], kept, strict=True)]

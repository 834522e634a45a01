"""How far a predicted depth is from the true one. Everything is float64, masked before it is computed.

The pixels that count, V, are those where both depths are finite and positive; an invalid prediction
is never a depth. Coverage says how many of the true pixels V is. Rates and coverage are fractions.
Anything that is not defined (no pixel, order of one pixel) is NaN, never a flattering zero.
"""

from __future__ import annotations

import numpy as np

from .dod import depth_order_disagreement

DEPTH_METRICS = ("l1_m", "l1_rate_10", "si_mse", "si_rmse", "dod", "coverage", "n", "rmse_m", "median_m", "bias_m",
                 "abs_rel", "l1_rate_30", "l1_rate_100")
#: Errors, m, of the cumulative curve: one centimetre to ten metres, ten steps per decade.
ERROR_STEPS_M = tuple(float(f"{step:.4g}") for step in np.geomspace(0.01, 10.0, 31))
DISPARITY_METRICS = ("epe_px", "bad_1", "bad_2", "bad_3")


def usable(depth: np.ndarray) -> np.ndarray:
    """Where a depth or disparity is one: finite and positive. Boolean, of the same shape."""
    return np.isfinite(depth) & (depth > 0)


def depth_metrics(prediction: np.ndarray, truth: np.ndarray) -> dict[str, float | int]:
    """Metrics of planar depths in metres, two arrays of one shape, NaN where there is none.

    With e = prediction - truth and d = ln prediction - ln truth on V, N = |V|:

    * ``l1_m`` mean |e|, ``median_m`` median |e|, ``rmse_m`` root of mean e², ``bias_m`` mean e,
      ``abs_rel`` mean |e| / truth; ``l1_rate_10``, ``_30``, ``_100`` share of |e| > 0.10, 0.30, 1.00 m;
    * ``si_mse`` mean d² - (mean d)² (Eigen et al. 2014 with λ = 1; the GUISS paper's formula), taken
      as the variance of d in two passes so that a prediction right up to scale gives 0, not rounding
      noise; ``si_rmse`` its root (what the paper's code prints);
    * ``dod`` depth order disagreement, see ``dod``;
    * ``coverage`` N / number of true pixels, ``n`` N.
    """
    prediction, truth = np.asarray(prediction, np.float64), np.asarray(truth, np.float64)
    known = usable(truth)
    both = known & usable(prediction)
    n, total = int(both.sum()), int(known.sum())
    result: dict[str, float | int] = dict.fromkeys(DEPTH_METRICS, float("nan"))
    result |= {"n": n, "coverage": n / total if total else float("nan")}
    if n == 0:
        return result
    predicted, true = prediction[both], truth[both]
    with np.errstate(over="ignore"):  # absurd depths may square to infinity, which is then the answer
        error = predicted - true
        distance = np.abs(error)
        ratio = np.log(predicted) - np.log(true)
        si_mse = float(np.mean((ratio - ratio.mean()) ** 2))
        result |= {
            "l1_m": float(distance.mean()),
            "l1_rate_10": float(np.mean(distance > 0.10)),
            "si_mse": si_mse,
            "si_rmse": si_mse ** 0.5,
            "dod": depth_order_disagreement(predicted, true),
            "rmse_m": float(np.mean(error ** 2)) ** 0.5,
            "median_m": float(np.median(distance)),
            "bias_m": float(error.mean()),
            "abs_rel": float(np.mean(distance / true)),
            "l1_rate_30": float(np.mean(distance > 0.30)),
            "l1_rate_100": float(np.mean(distance > 1.00)),
        }
    return result


def disparity_metrics(prediction: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Metrics of disparities in px on V: ``epe_px`` mean |error|, ``bad_k`` share of |error| > k px."""
    both = usable(truth) & usable(prediction)
    if not both.any():
        return dict.fromkeys(DISPARITY_METRICS, float("nan"))
    distance = np.abs(prediction[both].astype(np.float64) - truth[both].astype(np.float64))
    return {"epe_px": float(distance.mean())} | {f"bad_{k}": float(np.mean(distance > k)) for k in (1, 2, 3)}


def error_curve(prediction: np.ndarray, truth: np.ndarray) -> list[float]:
    """Share of all true pixels that are measured to within each of ERROR_STEPS_M; NaN without truth.

    It shows coverage and accuracy at once: it ends at the coverage, and a missing measurement is
    never within anything.
    """
    known = usable(truth)
    if not known.any():
        return [float("nan")] * len(ERROR_STEPS_M)
    both = known & usable(prediction)
    distance = np.sort(np.abs(prediction[both].astype(np.float64) - truth[both]))
    return [float(count) / int(known.sum()) for count in np.searchsorted(distance, ERROR_STEPS_M, side="right")]

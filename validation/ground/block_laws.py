"""Estimators of the size laws of rocks, by maximum likelihood above a completeness limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

_BISECTIONS = 60
_LARGEST_INDEX = 20.0


@dataclass(frozen=True)
class Estimate:
    """A fitted number and its standard error."""

    value: float
    error: float


def fit_power_index(diameters_m: Array, least_m: float, most_m: float = math.inf) -> Estimate:
    """Fit the index a of N(>D) ~ D^-a to diameters (n,) from ``least_m``, below which they are incomplete, to
    ``most_m``.

    Without an upper end this is the estimator of Clauset et al. 2009 (SIAM Review 51, 661), n over the sum of ln(D /
    least). With an upper end, the mean of ln(D / least) has the value of a law that is cut there. The error is by
    Fisher's information. NaN for fewer than two rocks.
    """
    logs = np.log(diameters_m[(diameters_m >= least_m) & (diameters_m <= most_m)] / least_m)
    if len(logs) < 2:
        return Estimate(math.nan, math.nan)
    span, mean = math.log(most_m / least_m), float(logs.mean())
    low, high = -_LARGEST_INDEX, _LARGEST_INDEX
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if _mean_log(middle, span) > mean else (low, middle)
    index = (low + high) / 2
    return Estimate(index, 1.0 / math.sqrt(len(logs) * _variance_of_log(index, span)))


def _mean_log(index: float, span: float) -> float:
    """Return the mean of ln(D / least) under the law, which ends at ``span``; it falls with the index."""
    if math.isinf(span):
        return 1.0 / index if index > 0 else math.inf
    turn = index * span
    return span * (0.5 - turn / 12.0) if abs(turn) < 1e-4 else 1.0 / index - span / math.expm1(turn)


def _variance_of_log(index: float, span: float) -> float:
    if math.isinf(span):
        return 1.0 / index**2
    turn = index * span
    if abs(turn) < 1e-2:
        return span**2 / 12.0
    return 1.0 / index**2 - (span / (2.0 * math.sinh(turn / 2.0))) ** 2


@dataclass(frozen=True)
class ExponentialCover:
    """The cover F(>D) = k exp(-q D) of Golombek's law: share ``k`` and decay ``q`` per metre."""

    k: Estimate
    q_per_m: Estimate


def fit_exponential_cover(diameters_m: Array, area_m2: float, least_m: float, most_m: float) -> ExponentialCover:
    """Fit the covered share of rocks with diameters (n,) from ``least_m`` to ``most_m`` on an area.

    Each square metre under rocks has the diameter of its rock. Under the law these diameters are exponential, so q is 1
    over their mean excess above ``least_m`` (cut at ``most_m``). The error of q is the error of a mean weighted by
    areas, for rocks drawn independently; the error of k adds the error of the covered area.
    """
    kept = diameters_m[(diameters_m >= least_m) & (diameters_m <= most_m)]
    area = math.pi / 4 * kept**2
    covered = float(area.sum())
    excess = float((area * (kept - least_m)).sum()) / covered
    low, high = 1e-3, 1e3
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if _mean_log(middle, most_m - least_m) > excess else (low, middle)
    decay = math.sqrt(low * high)
    whole = covered / area_m2 / -math.expm1(-decay * (most_m - least_m))
    k = whole * math.exp(decay * least_m)
    of_decay = math.sqrt(float(((area * (kept - least_m - excess)) ** 2).sum())) / (covered * excess)
    of_area = math.sqrt(float((area**2).sum())) / covered
    of_k = math.hypot(of_area, decay * least_m * of_decay)
    return ExponentialCover(Estimate(k, k * of_k), Estimate(decay, decay * of_decay))

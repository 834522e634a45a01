"""A single-photon detector: pile-up of its histogram, dead time, and their inverse.

Time is in bins. A bin with N expected photons fires with the probability 1 - exp(-N) if the detector is awake. The
detector then is dead for a number of bins, and light in them does not prolong this.
"""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..random_numbers.seeds import make_generator
from .noise_streams import ARRIVALS, JITTER

#: Number of random numbers that are drawn at once.
_AT_ONCE = 4_000_000


def detection_probability(photons: Array, dead_bins: int | None = None) -> Array:
    """Compute the probability (..., bins) of a count in each bin of a shot, from expected photons (..., bins).

    P_i = (1 - exp(-N_i)) (1 - Σ P_j over the bins j < i that leave the detector dead). If ``dead_bins`` is None, one
    photon a shot is counted, and P_i is (1 - exp(-N_i)) exp(-Σ_{j<i} N_j).
    """
    rate = _check(photons)
    fires = -np.expm1(-rate)
    if dead_bins is None:
        before = np.cumsum(rate, axis=-1) - rate
        return np.asarray(fires * np.exp(-before))
    found = np.zeros_like(fires)
    dead = np.zeros(fires.shape[:-1])
    for i in range(fires.shape[-1]):
        if i > dead_bins:
            dead = dead - found[..., i - dead_bins - 1]
        found[..., i] = fires[..., i] * (1.0 - dead)
        dead = dead + found[..., i]
    return found


def count_photons(photons: Array, shots: int, seed: int, scan: int = 0, dead_bins: int | None = None) -> Array:
    """Draw the counts (bins,) of a histogram over shots, each with expected photons (bins,). The same seed and scan
    give the same bits.
    """
    rate = _check(photons)
    if rate.ndim != 1 or shots < 0:
        raise IcyMoonError("A histogram needs a list of expected photons by bin and 0 shots or more.")
    random = make_generator(seed, "lidar", scan, ARRIVALS)
    counts = np.zeros(len(rate), np.int64)
    total = np.concatenate([[0.0], np.cumsum(rate)])
    for start in range(0, shots, _AT_ONCE):
        awake = np.zeros(min(_AT_ONCE, shots - start), np.int64)
        while len(awake):
            # The next count comes after an exponential variate of expected photons.
            at = np.searchsorted(total, total[awake] + random.standard_exponential(len(awake)), side="left") - 1
            at = at[at < len(rate)]
            counts += np.bincount(at, minlength=len(rate))
            awake = at[:0] if dead_bins is None else at + dead_bins + 1
            awake = awake[awake < len(rate)]
    return counts


def draw_first_counts(photons: Array, seed: int, scan: int = 0) -> Array:
    """Draw the bin (beams,) of the first count for one shot per beam with expected photons (beams, bins); -1 without a
    count."""
    rate = np.atleast_2d(_check(photons))
    drawn = make_generator(seed, "lidar", scan, ARRIVALS).standard_exponential(len(rate))
    reached = np.cumsum(rate, axis=1) >= drawn[:, None]
    return np.where(reached.any(axis=1), reached.argmax(axis=1), -1)


def correct_pile_up(counts: Array, shots: int, dead_bins: int | None = None) -> Array:
    """Estimate the expected photons (bins,) from the counts of a histogram; NaN where the detector was never awake,
    infinite where it always fired.

    The estimate is -ln(1 - h_i / n_i), where n_i is the number of shots in which the detector was awake at bin i
    (Coates 1968, Journal of Physics E 1, 878).
    """
    counted = np.asarray(counts, np.float64)
    before = np.concatenate([[0.0], np.cumsum(counted)])
    bins = np.arange(len(counted))
    first = np.zeros(len(counted), np.int64) if dead_bins is None else np.maximum(bins - dead_bins, 0)
    awake = shots - (before[bins] - before[first])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(awake > 0.0, -np.log1p(-counted / awake), np.nan))


def expect_pulse(
    time_s: float, photons: float, background_1_s: float, bins: int, bin_s: float, pulse_fwhm_s: float
) -> Array:
    """Compute the expected photons (bins,) of a Gaussian pulse that arrives at a time, and of an even background."""
    if not pulse_fwhm_s > 0.0 or not bin_s > 0.0:
        raise IcyMoonError(f"The pulse is {pulse_fwhm_s:g} s and a bin {bin_s:g} s long; give more than 0 s.")
    deviation = pulse_fwhm_s / (2.0 * math.sqrt(2.0 * math.log(2.0)))
    edge = (np.arange(bins + 1) * bin_s - time_s) / (deviation * math.sqrt(2.0))
    below = np.array([math.erf(one) for one in edge.tolist()]) / 2.0
    return np.asarray(photons * np.diff(below) + background_1_s * bin_s)


def add_jitter(bins: Array, deviation_bins: float, seed: int, scan: int = 0) -> Array:
    """Move the bins (n,) of counts by the detector's Gaussian jitter; bins without a count (-1) stay."""
    moved = bins + deviation_bins * make_generator(seed, "lidar", scan, JITTER).standard_normal(np.shape(bins))
    return np.where(np.asarray(bins) < 0, -1.0, moved)


def _check(photons: Array) -> Array:
    rate = np.asarray(photons, np.float64)
    if not (rate >= 0.0).all():
        raise IcyMoonError("The expected photons of a bin are negative or unknown; give 0 or more.")
    return rate

"""Exposure brackets: several exposures of one scene merged into one image of a wider range."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...settings.topics.camera import SensorSettings
from ...support.arrays import Array, Numbers
from .sensor import black_dn, capacity_e, gain_dn_per_e, top_dn

#: Bits of a value in the merged image.
MERGED_BITS = 16


def list_exposure_times(seconds: float, sensor: SensorSettings) -> list[float]:
    """List the exposure times in seconds, longest first, ``bracket_stops`` apart; their geometric mean is
    ``seconds``.
    """
    count = int(sensor.brackets)
    return [seconds * 2.0 ** (float(sensor.bracket_stops) * ((count - 1) / 2 - k)) for k in range(count)]


def merge_exposures(numbers: Sequence[Array], seconds: Sequence[float], sensor: SensorSettings) -> Array:
    """Merge the digital numbers of several exposures, longest first, into electrons per second (H, W).

    The result is the mean of each exposure's electrons per second, weighted by the inverse variance of its shot noise,
    read noise and converter step. A pixel that may be full is left out of an exposure, unless it is the shortest one. A
    pixel may be full if it is nearer to full than half a number plus five standard deviations of the read noise.
    """
    gain = gain_dn_per_e(sensor)
    steady = float(sensor.read_noise_e) ** 2 + 1 / (12 * gain**2)
    reading = math.hypot(float(sensor.read_noise_e), float(sensor.dsnu_e))
    full_dn = min(capacity_e(sensor) * gain + black_dn(sensor), float(top_dn(sensor))) - 0.5 - 5 * reading * gain
    charge = [(image - black_dn(sensor)) / gain for image in numbers]
    usable = [(image < full_dn) | (k == len(numbers) - 1) for k, image in enumerate(numbers)]

    def mean(weights: Sequence[Numbers]) -> Array:
        total = sum(w * use for w, use in zip(weights, usable, strict=True))
        parts = (w * use * e / t for w, use, e, t in zip(weights, usable, charge, seconds, strict=True))
        return np.asarray(sum(parts) / total)

    # Weights from each exposure's own noisy electrons would favour electrons that are low by chance.
    rough = np.maximum(mean(list(seconds)), 0.0)
    return mean([t**2 / (rough * t + steady) for t in seconds])


def find_full_rate(left_rate: Array, shortest_s: float, sensor: SensorSettings) -> float:
    """Find the electrons per second at full scale of the merged image of both eyes: a little above the 99.9 % quantile
    of the left image, and at most the rate that saturates the shortest exposure.
    """
    full = capacity_e(sensor) / shortest_s
    return min(float(np.quantile(left_rate, 0.999)) / 0.9, full) if left_rate.max() > 0 else full


def quantise_merged(rate: Array, full: float) -> Array:
    """Convert merged electrons per second to linear uint16, so that ``full`` becomes the largest number."""
    top = 2**MERGED_BITS - 1
    return np.clip(np.rint(rate / max(full, 1e-300) * top), 0, top).astype(np.uint16)

"""Statistics of a grid of heights: RMS deviation against distance, power spectrum, slope, Hurst exponent.

Definitions after Shepard et al. 2001 (JGR 106 E12, "The roughness of natural terrain").
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....support.arrays import Array

#: Number of grid lines that ``measure_roughness`` uses along each axis: enough for 1 %, and fast on any mesh.
_MAX_LINES = 256


def remove_plane(heights_m: Array) -> Array:
    """Subtract their least-squares plane from heights (rows, columns)."""
    rows, columns = heights_m.shape
    y, x = (np.arange(n) - (n - 1) / 2 for n in (rows, columns))
    slope_x = (heights_m.mean(axis=0) @ x) / max(x @ x, 1.0)
    slope_y = (heights_m.mean(axis=1) @ y) / max(y @ y, 1.0)
    return heights_m - heights_m.mean() - slope_x * x[None, :] - slope_y * y[:, None]


def rms_deviation(heights_m: Array, lag: int, every: int = 1) -> float:
    """Compute the RMS deviation nu in metres of a height grid at a lag of whole vertex spacings; NaN if the grid is
    smaller than the lag. nu² = <(z(p + lag) - z(p))²> over pairs along both axes, on every ``every``-th line of the
    grid.
    """
    if not 0 < lag < min(heights_m.shape):
        return math.nan
    along_x = heights_m[::every, lag:] - heights_m[::every, :-lag]
    along_y = heights_m[lag:, ::every] - heights_m[:-lag, ::every]
    return math.sqrt((np.vdot(along_x, along_x) / along_x.size + np.vdot(along_y, along_y) / along_y.size) / 2)


def list_lags(longest: int, per_octave: int = 3) -> list[int]:
    """List whole lags from 1 to ``longest``, about evenly spaced in the logarithm."""
    count = max(1, math.ceil(per_octave * math.log2(max(longest, 1)))) + 1
    return sorted({round(longest ** (k / (count - 1))) for k in range(count)}) if longest > 1 else [1]


def power_spectrum(heights_m: Array, spacing_m: float, bins_per_octave: int = 3) -> tuple[Array, Array]:
    """Compute the radially averaged 2-D power spectral density of a square grid.

    Returns wave numbers in cycles per metre and densities in m⁴ (m² per (cycle/m)²), whose integral over the plane of
    wave vectors is the variance. The grid is detrended and windowed (Hann), since it is not periodic: without that the
    step between opposite edges adds a false k⁻² spectrum.
    """
    n = min(heights_m.shape)
    window = np.hanning(n + 2)[1:-1]
    window = window[:, None] * window[None, :]
    spectrum = np.abs(np.fft.rfft2(remove_plane(heights_m[:n, :n]) * window)) ** 2
    density = spectrum * spacing_m**2 / np.sum(window**2)
    k_x, k_y = np.fft.rfftfreq(n, spacing_m), np.fft.fftfreq(n, spacing_m)
    radius = np.hypot(k_x[None, :], k_y[:, None])
    # The window smears two wave numbers and the plane was removed, so start at the third.
    bins = max(1, round(bins_per_octave * math.log2(max(n, 8) / 6)))
    edges = np.geomspace(3.0 / (n * spacing_m), 0.5 / spacing_m, bins + 1)
    which = np.digitize(radius.ravel(), edges)
    # Columns 0 and n/2 count once; all others also represent their mirror images.
    weight = np.where((k_x == 0) | (np.arange(len(k_x)) * 2 == n), 1.0, 2.0)
    weight = np.broadcast_to(weight, density.shape).ravel()
    counts, powers, waves = (
        np.bincount(which, weight * values, len(edges) + 1)[1:-1] for values in (1.0, density.ravel(), radius.ravel())
    )
    filled = counts > 0
    return waves[filled] / counts[filled], powers[filled] / counts[filled]


@dataclass(frozen=True)
class Roughness:
    """The measured roughness of a grid: ``lag_m`` and RMS deviation ``deviation_m`` (equal lengths), the RMS slope
    ``slope_deg`` at ``baseline_m`` (NaN if the grid has too few lags), the ``hurst`` exponent, and the RMS ``height_m``
    about the mean plane. ``hurst`` is the slope of the deviation in logarithms over the lags for which the settings ask
    for the law."""

    lag_m: Array
    deviation_m: Array
    baseline_m: float
    slope_deg: float
    hurst: float
    height_m: float

    def numbers(self) -> dict[str, float | None]:
        """Return the numbers that ``pair.json`` stores beside the requested ones; None if the grid has too few lags."""
        found = {"rms_slope_deg": self.slope_deg, "rms_height_m": self.height_m, "hurst": self.hurst}
        return {key: None if math.isnan(value) else float(f"{value:.4g}") for key, value in found.items()}


def measure_roughness(
    heights_m: Array, spacing_m: float, baseline_m: float, law_m: tuple[float, float] = (0.0, math.inf)
) -> Roughness:
    """Measure the roughness of a square height grid, relative to its mean plane, at lags up to a quarter of its side.
    ``law_m`` are the shortest and longest lag over which the Hurst exponent is fitted."""
    level = remove_plane(heights_m)
    whole = np.array(list_lags(max(1, (min(heights_m.shape) - 1) // 4)))
    lag_m = whole * spacing_m
    every = max(1, min(level.shape) // _MAX_LINES)
    deviation = np.array([rms_deviation(level, int(k), every) for k in whole])
    slope = math.nan
    if lag_m[0] * 0.999 <= baseline_m <= lag_m[-1] * 1.001 and deviation.min() > 0:
        nu = math.exp(np.interp(math.log(baseline_m), np.log(lag_m), np.log(deviation)))
        slope = math.degrees(math.atan(nu / baseline_m))
    elif deviation.max() == 0:
        slope = 0.0
    fitted = (lag_m >= law_m[0]) & (lag_m <= law_m[1]) & (deviation > 0)
    hurst = float(np.polyfit(np.log(lag_m[fitted]), np.log(deviation[fitted]), 1)[0]) if fitted.sum() > 1 else math.nan
    return Roughness(lag_m, deviation, baseline_m, slope, hurst, float(np.sqrt(np.mean(level**2))))

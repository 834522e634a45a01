"""The random surface with a stated RMS deviation: nu(dx) = C dx^H between two cut-offs.

The surface is a sum of noise octaves, whose amplitudes are a power of their wavelengths, so that the power
spectrum falls as k^-(2H + 2). The waves missing beyond the cut-offs would bend the law near them, so
the octaves at the ends are larger, by non-negative fitting of the octaves' structure functions,
which are known in closed form: the sum is then within 6 % of the law from half the shortest wavelength to 0.3
of the longest for H from 0.5 to 0.9, within 11 % for H from 0.2 to 1. (Spectral synthesis of a
periodic patch is not: with a target of 0.9 it gives 0.74, because periodicity flattens the long lags.)

One patch holds only a few of the longest waves, whose height may be anything by chance; the long
octaves are therefore measured on the patch, about its mean plane, and the fit is made to the measured waves.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....settings.topics.ground import TerrainSettings
from ....support.arrays import Array, Numbers
from ....support.errors import IcyMoonError
from ..noise.lattice_noise import gradient_noise
from .statistics import remove_plane
from .structure_function import NOISE_DEVIATION, structure_function

#: The power law holds from this multiple of the shortest wavelength
LAW_FROM = 0.5
#: to this multiple of the longest.
LAW_TO = 0.3
MAX_OCTAVES = 48
#: Rotation between octaves, so that their lattices do not line up and show as a grid.
_OCTAVE_TURN_RAD = math.radians(37.0)
_LAGS_PER_OCTAVE = 6
_FIT_STEPS = 400
#: Half the range of the logarithm of wavelengths that is used for an infinite range.
_LOG_RANGE = 40.0
#: Points per side of the grid on which the patch is measured.
_GRID_SIDE = 129
#: Largest factor on an octave's amplitude that corrects for chance in a patch.
_MAX_CORRECTION = 3.0
#: Number of wavelengths across a patch at which an octave's amplitude may be corrected by a factor of 2.
_WAVES_FOR_FACTOR_2 = 3.0
#: Range of relief, in standard deviations of the ground so far, over which multifractal weights rise from 0 to 1.
RELIEF_SPAN = 4.0
#: Octaves that add less than this share to the variance leave the weights unchanged.
_MIN_VARIANCE_SHARE = 0.01


def octave_wavelengths_m(terrain: TerrainSettings) -> Array:
    """Compute the wavelengths of the octaves, longest first, from one cut-off to the other: evenly spaced in the
    logarithm, with ratios of at most the lacunarity. Raises IcyMoonError for contradictory cut-offs.
    """
    outer, inner, lacunarity = (float(terrain[k]) for k in ("outer_scale_m", "inner_scale_m", "lacunarity"))
    if inner > outer:
        raise IcyMoonError(
            f"terrain.inner_scale_m ({inner:g} m) is longer than terrain.outer_scale_m ({outer:g} m); "
            "lower the first or raise the second."
        )
    steps = math.ceil(math.log(outer / inner) / math.log(lacunarity) - 1e-6)
    if steps >= MAX_OCTAVES:
        raise IcyMoonError(
            f"From terrain.inner_scale_m ({inner:g} m) to terrain.outer_scale_m ({outer:g} m) it takes "
            f"{steps + 1} octaves, more than {MAX_OCTAVES}; raise terrain.lacunarity or inner_scale_m."
        )
    return _round_digits(outer * (inner / outer) ** (np.arange(steps + 1) / max(steps, 1)))


def _fit_squared_amplitudes(
    squares: Array,
    target: Array,
    model: Array,
    low: Array,
    high: Array,
    cross: Array | None = None,
) -> Array:
    """Fit squared amplitudes between ``low`` and ``high`` for which ``model @ squares`` (plus the cross terms of the
    first octaves) has the ratios of ``target``. The start is ``squares``. Multiplicative updates keep every amplitude
    positive.
    """
    long = 0 if cross is None else cross.shape[1]
    for _ in range(_FIT_STEPS):
        made = model @ squares
        if cross is not None:
            amplitude = np.sqrt(squares[:long])
            made = np.maximum(made + np.einsum("kij,i,j->k", cross, amplitude, amplitude), 0.05 * made)
        share = model / made[:, None]
        # The same as np.clip, which takes three times as long for so few numbers.
        squares = np.minimum(np.maximum(squares * (share.T @ (target / made)) / share.sum(axis=0), low), high)
    return squares


def _law_factor_squared(hurst: float, lacunarity: float, dimensions: int) -> float:
    """Compute the square of the factor c for which a complete range of octaves with amplitudes c wavelength^H sums to
    nu(dx) = dx^H.
    """
    octaves = lacunarity ** np.arange(-1, 2 * math.ceil(_LOG_RANGE / math.log(lacunarity)), dtype=np.float64)
    octaves /= math.exp(_LOG_RANGE)
    lag = lacunarity ** ((np.arange(8) + 0.5) / 8)
    made = structure_function(lag[:, None] / octaves, dimensions) @ octaves ** (2 * hurst)
    return float(np.mean(lag ** (2 * hurst) / made))


def fit_amplitudes(wavelength_m: Array, hurst: float, dimensions: int = 2) -> Array:
    """Fit amplitudes of octaves of independent unit noise whose sum has nu(dx) = dx^H.

    They are a power of the wavelength, which gives the power spectrum its slope of -(2H + 2). The first two and the
    last also represent the missing waves beyond them, and are fitted to the law.
    """
    return np.array(_fit_cached_amplitudes(tuple(np.asarray(wavelength_m, np.float64)), hurst, dimensions))


@functools.lru_cache(maxsize=64)
def _fit_cached_amplitudes(wavelengths: tuple[float, ...], hurst: float, dimensions: int) -> tuple[float, ...]:
    """Fit as ``fit_amplitudes`` does, cached, because the many grounds of a plan differ only in their seeds."""
    wavelength_m = np.array(wavelengths)
    first, last = LAW_FROM * wavelength_m[-1], max(LAW_TO * wavelength_m[0], LAW_FROM * wavelength_m[-1] * 1.01)
    lag = np.geomspace(first, last, max(2, math.ceil(_LAGS_PER_OCTAVE * math.log2(last / first))))
    lacunarity = float(wavelength_m[0] / wavelength_m[1]) if len(wavelength_m) > 1 else 2.0
    squares = _law_factor_squared(hurst, lacunarity, dimensions) * wavelength_m ** (2 * hurst)
    most = squares.copy()
    most[[0, min(1, len(most) - 1), -1]] = np.inf
    target, model = lag ** (2 * hurst), structure_function(lag[:, None] / wavelength_m, dimensions)
    return tuple(np.sqrt(_fit_squared_amplitudes(squares, target, model, squares, most)))


def list_stated_statistics(terrain: TerrainSettings) -> dict[str, float | None]:
    """List the random surface's statistics by the ``terrain`` settings, with the keys of ``Roughness.numbers``.

    The RMS height is for endless ground with these octaves. Raises IcyMoonError if the cut-offs contradict each other.
    """
    wavelength = octave_wavelengths_m(terrain)
    squares = _compute_stated_amplitudes(terrain, wavelength) ** 2
    return {
        "rms_slope_deg": float(terrain.rms_slope_deg),
        "rms_height_m": float(f"{NOISE_DEVIATION * math.sqrt(squares.sum()):.4g}"),
        "hurst": float(terrain.hurst),
    }


def _compute_stated_amplitudes(terrain: TerrainSettings, wavelength_m: Array) -> Array:
    """Compute the amplitudes of octaves with the stated deviation at the baseline, also outside the cut-offs."""
    baseline = float(terrain.slope_baseline_m)
    at_baseline = math.tan(math.radians(terrain.rms_slope_deg)) * baseline
    unit = fit_amplitudes(wavelength_m, float(terrain.hurst))
    return unit * (at_baseline / math.sqrt(float(structure_function(baseline / wavelength_m) @ unit**2)))


@dataclass(frozen=True)
class RoughSurface:
    """A random surface: its octaves, longest first. Build it with :func:`make_rough_surface`.

    Octave k is amplitude_m[k] times unit noise of wavelength_m[k], times a weight. The weight is between 1 -
    multifractality in hollows and 1 on heights, divided by its RMS ``level[k]``. So the weights redistribute roughness
    and keep its mean square.
    """

    wavelength_m: Array
    amplitude_m: Array
    keys: tuple[int, ...]
    offsets: Array
    multifractality: float
    level: Array
    mean_m: float = 0.0

    def octave(self, k: int, x_m: Array, y_m: Array) -> Array:
        """Compute the unit noise of octave k."""
        return _compute_octave(k, self.wavelength_m[k], self.offsets[k], self.keys[k], x_m, y_m)

    def weight(self, k: int, total_m: Array, variance: float) -> Array:
        """Compute the multifractal weight of the octave after k, from the relief so far, before division by its
        level.
        """
        relief = total_m * (1.0 / (RELIEF_SPAN * math.sqrt(variance)))
        relief += 0.5
        np.clip(relief, 0.0, 1.0, out=relief)
        relief *= self.multifractality
        relief += 1.0 - self.multifractality
        return relief

    def heights(self, x_m: Array, y_m: Array, shortest_m: Numbers = 0.0) -> Array:
        """Compute heights in metres; ``x_m`` and ``y_m`` broadcast, ``shortest_m`` is a number or one per point.

        Octaves fade out between 1.5 and 1 times ``shortest_m``.
        """
        shape = np.broadcast_shapes(np.shape(x_m), np.shape(y_m))
        total = np.zeros(shape)
        weight: Array | None = None
        variance = 0.0
        varies = np.ndim(shortest_m) > 0
        for k, wavelength in enumerate(self.wavelength_m):
            carried = resolved_share(wavelength, shortest_m)
            if not np.any(carried):
                break
            if self.amplitude_m[k] == 0.0:
                continue
            signal = self.octave(k, x_m, y_m)
            signal *= self.amplitude_m[k] / self.level[k] if varies else carried * self.amplitude_m[k] / self.level[k]
            if varies:
                signal *= carried
            if weight is not None:
                signal *= weight
            total += signal
            if self.multifractality:
                added = (self.amplitude_m[k] * NOISE_DEVIATION) ** 2
                variance += added
                if added > _MIN_VARIANCE_SHARE * variance:
                    weight = self.weight(k, total, variance)
        total -= self.mean_m
        return total


def _compute_octave(k: int, wavelength_m: float, offset: Sequence[float], key: int, x_m: Array, y_m: Array) -> Array:
    cos, sin = math.cos(k * _OCTAVE_TURN_RAD) / wavelength_m, math.sin(k * _OCTAVE_TURN_RAD) / wavelength_m
    # In this order a grid's rows and columns cost nothing until they meet.
    return gradient_noise((cos * x_m + offset[0]) - sin * y_m, (sin * x_m + offset[1]) + cos * y_m, key)


@functools.lru_cache(maxsize=MAX_OCTAVES)
def _sample_octave(k: int, wavelength_m: float, offset: tuple[float, float], key: int, size_m: float) -> Array:
    """Sample the unit noise (n, n) of octave k on a coarse grid over the patch, kept for the next ground: heights do
    not change it.
    """
    axis = _make_grid_axis(size_m)
    return _compute_octave(k, wavelength_m, offset, key, axis[None, :], axis[:, None])


def _make_grid_axis(size_m: float) -> Array:
    return np.linspace(-size_m / 2, size_m / 2, _GRID_SIDE)


def resolved_share(wavelength_m: Numbers, shortest_m: Numbers) -> Numbers:
    """Compute the share of a wave that a mesh carries: 1 from 1.5 times its shortest wavelength on, 0 below that
    wavelength.
    """
    shortest_m = np.maximum(shortest_m, 1e-300)
    share = np.clip(2.0 * (wavelength_m / shortest_m) - 2.0, 0.0, 1.0)
    return share if np.ndim(share) else float(share)


def _round_digits(values: Array) -> Array:
    """Round values to ten digits. Sums and powers differ between machines in the last digits; heights must not."""
    return np.array([float(f"{v:.9e}") for v in values])


def make_rough_surface(terrain: TerrainSettings, size_m: float, random: np.random.Generator) -> RoughSurface:
    """Make the random surface of ``terrain`` settings on a patch of side ``size_m``.

    Raises IcyMoonError if the cut-offs contradict each other.
    """
    wavelength = octave_wavelengths_m(terrain)
    n = len(wavelength)
    keys = tuple(int(k) for k in random.integers(0, 2**32, MAX_OCTAVES)[:n])
    offsets = random.uniform(0.0, 1024.0, (MAX_OCTAVES, 2))[:n]
    baseline, hurst = float(terrain.slope_baseline_m), float(terrain.hurst)
    at_baseline = math.tan(math.radians(terrain.rms_slope_deg)) * baseline
    plain = RoughSurface(
        wavelength,
        _round_digits(_compute_stated_amplitudes(terrain, wavelength)),
        keys,
        offsets,
        float(terrain.multifractality),
        np.ones(n),
    )
    if at_baseline == 0.0:
        return plain
    return _fit_to_patch(plain, size_m, baseline, at_baseline, hurst)


def _measure_long_octaves(surface: RoughSurface, size_m: float) -> tuple[Array, Array]:
    """Measure the weighted unit octaves (long, n, n) that a coarse grid over the patch carries, and the RMS of the
    weight of every octave.
    """
    axis = _make_grid_axis(size_m)
    long = int(np.sum(surface.wavelength_m >= 4 * (axis[1] - axis[0])))
    level = np.ones(len(surface.wavelength_m))
    fields: list[Array] = []
    total, variance, weight = np.zeros((_GRID_SIDE, _GRID_SIDE)), 0.0, None
    for k in range(len(level)):
        if weight is not None:
            level[k] = math.sqrt(np.mean(weight**2)) or 1.0
        if k >= long and not surface.multifractality:
            break
        added = (surface.amplitude_m[k] * NOISE_DEVIATION) ** 2
        if k >= long and added <= _MIN_VARIANCE_SHARE * (variance + added):
            level[k:] = level[k]
            break
        offset = float(surface.offsets[k, 0]), float(surface.offsets[k, 1])
        field = _sample_octave(k, float(surface.wavelength_m[k]), offset, surface.keys[k], size_m) / level[k]
        if weight is not None:
            field *= weight
        if k < long:
            fields.append(field)
        total += surface.amplitude_m[k] * field
        variance += added
        if surface.multifractality and added > _MIN_VARIANCE_SHARE * variance:
            weight = surface.weight(k, total, variance)
    return np.array(fields).reshape(len(fields), _GRID_SIDE, _GRID_SIDE), level


def _fit_to_patch(
    surface: RoughSurface, size_m: float, baseline: float, at_baseline: float, hurst: float
) -> RoughSurface:
    """Fit the amplitudes of a surface's octaves to the long octaves as measured on the patch."""
    fields, level = _measure_long_octaves(surface, size_m)
    wavelength, long = surface.wavelength_m, len(fields)
    means = fields.mean(axis=(1, 2))
    # Roughness is defined relative to the mean plane.
    fields = np.array([remove_plane(field) for field in fields]).reshape(fields.shape)
    spacing = size_m / (_GRID_SIDE - 1)
    first, last = LAW_FROM * wavelength[-1], min(LAW_TO * wavelength[0], size_m / 4)
    squares: Array = surface.amplitude_m**2
    if long and last > max(first, spacing):
        whole = np.unique(np.geomspace(max(1, math.ceil(first / spacing)), last / spacing, 16).astype(int))
        finer = np.geomspace(first, spacing, 24, endpoint=False) if first < spacing else np.zeros(0)
        lag = np.concatenate([finer, whole * spacing])
        measured = np.array([_mean_products(fields, int(k)) for k in whole])
        # Below the coarse grid's spacing the long octaves are planes: their squares go as distance².
        planes = np.minimum(lag / lag[-len(whole)], 1.0)[:, None, None] ** 2
        cross = planes * measured[np.maximum(np.arange(len(lag)) - (len(lag) - len(whole)), 0)]
        model = structure_function(lag[:, None] / wavelength)
        own = np.einsum("kii->ki", cross).copy()
        model[:, :long] = own
        np.einsum("kii->ki", cross)[...] = 0.0
        target = (at_baseline * (lag / baseline) ** hurst) ** 2
        # Short waves are many on the patch, so that chance matters less for them.
        free = np.minimum(1.0 + _WAVES_FOR_FACTOR_2 * wavelength / size_m, _MAX_CORRECTION) ** 2
        free[long:] = 1.0
        low, high = squares / free, squares * free
        squares = _fit_squared_amplitudes(squares, target, model, low, high, cross)
        if lag[0] <= baseline <= lag[-1]:
            amplitude = np.sqrt(squares[:long])
            made = model @ squares + np.einsum("kij,i,j->k", cross, amplitude, amplitude)
            squares = squares * math.exp(np.interp(math.log(baseline), np.log(lag), np.log(target / made)))
    amplitude = _round_digits(np.sqrt(squares))
    mean = float(f"{amplitude[:long] @ means:.9e}")
    return replace(surface, amplitude_m=amplitude, level=_round_digits(level), mean_m=mean)


def _mean_products(fields: Array, lag: int) -> Array:
    """Compute the mean products (long, long) of the octaves' differences at a whole lag, over both axes."""
    along_x = (fields[:, :, lag:] - fields[:, :, :-lag]).reshape(len(fields), -1)
    along_y = (fields[:, lag:, :] - fields[:, :-lag, :]).reshape(len(fields), -1)
    return (along_x @ along_x.T / along_x.shape[1] + along_y @ along_y.T / along_y.shape[1]) / 2

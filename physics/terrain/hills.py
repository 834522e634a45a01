"""Hills and ranges between the patch and the horizon: a second law of roughness, for lengths of tens of metres to
kilometres.

Slopes of icy moons are known at such lengths, but not at the metres of a workspace: Europa's ridged plains have an RMS
slope of 10 to 15 degrees at 10 to 100 m, its smooth bands about 5 (Schenk 2009, GRL 36, L15204). The patch keeps its
own statistics: no hill begins within it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np

from ...settings.topics.ground import HillsSettings, TerrainLayer
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from .landforms.landform import Landform, evaluate_where, smooth_step
from .noise_layers import MAX_OCTAVES, NoiseLayer, make_layer
from .outcrops import make_outcrops
from .roughness.roughness import LAW_TO

#: Distance, in half diagonals of the patch, at which hills have their full height; they then rise no faster than
#: self-affine ground.
_FULL_HEIGHT_AT = 30.0
_LACUNARITY = 2.0
#: Number of directions in which the mean height of hills around the patch is taken.
_RIM_AZIMUTHS = 24
#: Sideways shift that keeps crests from lying on a lattice, as a share of the longest wavelength.
_WARP_SHARE = 0.12
#: Number of corrections in the fit of the law.
_FIT_CORRECTIONS = 5
#: Number of pairs of points between which the slope is measured.
_POINT_PAIRS = 8192
#: Side of the square that contains them, in longest wavelengths.
_SPAN_WAVELENGTHS = 64.0


def make_hills(settings: HillsSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make hills around a patch of side ``size_m``, with the patch's level as their mean height; None for a slope of 0.
    Raises IcyMoonError for contradictory lengths.
    """
    if settings.rms_slope_deg == 0.0:
        return None
    hills = _make_endless_hills(settings, random)
    start = size_m * math.sqrt(0.5)
    level = _mean_at_rim_m(hills, start)
    outcrops = make_outcrops(settings, random)

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        x_m, y_m, shortest_m = np.broadcast_arrays(x_m, y_m, shortest_m)
        return evaluate_where(np.hypot(x_m, y_m) > start, beyond, x_m, y_m, shortest_m)

    def beyond(x_m: Array, y_m: Array, shortest_m: Array) -> Array:
        share = smooth_step(np.log(np.hypot(x_m, y_m) / start) / math.log(_FULL_HEIGHT_AT))
        total = hills.heights(x_m, y_m, shortest_m) - level
        return share * (total if outcrops is None else total + outcrops.heights(x_m, y_m, shortest_m))

    return Landform(math.inf, heights)


def _mean_at_rim_m(hills: NoiseLayer, start_m: float) -> float:
    """Compute the mean height in metres of endless hills where they rise from the patch, which keeps the site from
    being a summit or a pit.
    """
    turn = np.arange(_RIM_AZIMUTHS) * (2.0 * np.pi / _RIM_AZIMUTHS)
    radius = np.geomspace(start_m, _FULL_HEIGHT_AT * start_m, _RIM_AZIMUTHS)[:, None]
    return float(f"{np.mean(hills.heights(radius * np.cos(turn), radius * np.sin(turn))):.9e}")


def _make_endless_hills(settings: HillsSettings, random: np.random.Generator) -> NoiseLayer:
    """Make endless hills with the stated RMS slope between points one baseline apart. Their RMS deviation grows by the
    Hurst exponent up to 0.3 of the largest length. Raises IcyMoonError for contradictory lengths.
    """
    largest, smallest, baseline = (float(settings[k]) for k in ("largest_m", "smallest_m", "slope_baseline_m"))
    if smallest > largest:
        raise IcyMoonError(
            f"hills.smallest_m ({smallest:g} m) is longer than hills.largest_m ({largest:g} m); lower the first or "
            "raise the second."
        )
    octaves = 1 + round(math.log(largest / smallest, _LACUNARITY))
    if octaves > MAX_OCTAVES:
        raise IcyMoonError(
            f"From hills.smallest_m ({smallest:g} m) to hills.largest_m ({largest:g} m) it takes "
            f"{octaves} octaves, more than {MAX_OCTAVES}; raise hills.smallest_m or lower "
            "hills.largest_m."
        )
    roughness, deviation_m = _fit_law(settings.fractal, largest, octaves, float(settings.hurst), baseline)
    rise_m = baseline * math.tan(math.radians(settings.rms_slope_deg))
    return replace(_make_layer(settings.fractal, largest, octaves, roughness, random), factor=rise_m / deviation_m)


def _make_layer(
    fractal: str, largest_m: float, octaves: int, roughness: float, random: np.random.Generator
) -> NoiseLayer:
    entry = TerrainLayer(
        basis="GRADIENT",
        amplitude_m=1.0,
        scale_m=largest_m,
        octaves=octaves,
        lacunarity=_LACUNARITY,
        roughness=roughness,
        warp_m=_WARP_SHARE * largest_m,
    ) | {"fractal": fractal}
    made = make_layer(entry, random)
    assert made is not None
    return made


@functools.lru_cache(maxsize=16)
def _fit_law(fractal: str, largest_m: float, octaves: int, hurst: float, baseline_m: float) -> tuple[float, float]:
    """Fit the ratio of successive octaves for which the deviation of heights grows by the exponent. Also return the
    deviation of their sum at the baseline, before any factor. It is measured on separate hills, equal for all seeds,
    and cached for the many grounds of a plan.
    """
    random = np.random.default_rng(0)
    surface = replace(_make_layer(fractal, largest_m, octaves, 0.5, random), factor=1.0)
    x, y = random.uniform(-0.5, 0.5, (2, _POINT_PAIRS)) * (_SPAN_WAVELENGTHS * largest_m)
    turn = random.uniform(0.0, 2.0 * np.pi, _POINT_PAIRS)

    def deviation_m(lag_m: float) -> float:
        rise = surface.heights(x + lag_m * np.cos(turn), y + lag_m * np.sin(turn)) - surface.heights(x, y)
        return math.sqrt(float(np.mean(rise**2)))

    # The missing octaves beyond both ends bend the law; some corrections make the present ones follow it.
    exponent = hurst
    shorter, longer = max(baseline_m, largest_m * _LACUNARITY ** (1 - octaves)), LAW_TO * largest_m
    for _ in range(_FIT_CORRECTIONS if longer > 2.0 * shorter else 1):
        surface = replace(surface, roughness=float(f"{_LACUNARITY**-exponent:.9e}"))
        exponent += hurst - math.log(deviation_m(longer) / deviation_m(shorter)) / math.log(longer / shorter)
    return surface.roughness, float(f"{deviation_m(baseline_m):.9e}")

"""Fine relief on the vertices of any mesh, imported or sculpted: noise in space, along the normals.

The octaves are those of the ground's random surface (``roughness``). Their amplitudes are solved for noise in three
dimensions cut by a surface, so that a flat mesh has the same RMS deviation against distance as flat ground. Landforms
and layers, which are height fields, are left out.
"""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..random_numbers.seeds import make_ground_generator
from .noise.lattice_noise import gradient_noise_3d
from .roughness.roughness import RELIEF_SPAN, fit_amplitudes, octave_wavelengths_m, resolved_share
from .roughness.structure_function import structure_function

_DIMENSIONS = 3


def relief_heights_m(
    points_m: Array, settings: Settings, seed: int, longest_m: float = math.inf, shortest_m: Numbers = 0.0
) -> Array:
    """Compute the heights (n,) in metres of the described roughness at points (n, 3) in metres, in any order.

    Waves above ``longest_m`` are left out, because the mesh has them already (it is about two of the lengths that the
    mesh resolves). Waves below ``shortest_m`` (a number, or one per point) are left out, because its vertices cannot
    carry them. Raises IcyMoonError for contradictory cut-offs.
    """
    ground = settings.terrain
    wavelength = octave_wavelengths_m(ground)
    random = make_ground_generator(seed, int(ground.variant), 4)
    keys = [int(k) for k in random.integers(0, 2**32, len(wavelength))]
    offsets = random.uniform(0.0, 1024.0, (len(wavelength), 3))
    baseline, hurst = float(ground.slope_baseline_m), float(ground.hurst)
    amplitude = fit_amplitudes(wavelength, hurst, _DIMENSIONS)
    at_baseline = math.tan(math.radians(ground.rms_slope_deg)) * baseline
    amplitude *= at_baseline / math.sqrt(float(structure_function(baseline / wavelength, _DIMENSIONS) @ amplitude**2))
    total, weight, variance = np.zeros(len(points_m)), np.ones(len(points_m)), 0.0
    mixing, unit_variance = float(ground.multifractality), float(structure_function(np.array(9.0), _DIMENSIONS)) / 2
    for k in np.flatnonzero((wavelength <= longest_m) & (amplitude > 0)):
        share = resolved_share(wavelength[k], shortest_m)
        if not np.any(share):
            break
        signal = gradient_noise_3d(np.asarray(points_m, np.float64) / wavelength[k] + offsets[k], keys[k])
        total += weight * share * amplitude[k] * signal
        if mixing:
            variance += amplitude[k] ** 2 * unit_variance
            weight = 1.0 - mixing * (1.0 - np.clip(0.5 + total / (RELIEF_SPAN * math.sqrt(variance)), 0.0, 1.0))
            weight /= _expected_weight(mixing)
    return total


def _expected_weight(mixing: float) -> float:
    """Compute the RMS of the multifractal weight over normally distributed relief."""
    # The relief over its span is normal with a deviation of 1/4 about 1/2, cut at 2 deviations.
    mean_square = 1.0 - mixing + mixing**2 * (0.25 + _CUT_VARIANCE)
    return math.sqrt(mean_square)


#: Variance of a normal variable of mean 1/2 and deviation 1/4 that is held between 0 and 1.
_CUT_VARIANCE = (1.0 - 2.0 * 2.0 * math.exp(-2.0) / math.sqrt(2 * math.pi) + 3.0 * math.erfc(math.sqrt(2.0))) / 16.0


def displace_by_relief(
    points_m: Array,
    normals: Array,
    settings: Settings,
    seed: int,
    longest_m: float = math.inf,
    shortest_m: Numbers = 0.0,
) -> Array:
    """Move points (n, 3) by ``relief_heights_m`` along their unit ``normals`` (n, 3)."""
    heights = relief_heights_m(points_m, settings, seed, longest_m, shortest_m)
    return np.asarray(points_m, np.float64) + heights[:, None] * normals

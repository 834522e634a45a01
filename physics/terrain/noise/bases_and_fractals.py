"""Noise bases and the fractal sums over their octaves.

The sums are Musgrave's (Ebert et al., "Texturing and Modeling", 3rd ed. 2003, ch. 16), with his offset
and gain of 1. Each makes a signal of the noise, in about [-1, 1], and sums the signals of the octaves;
``signal(k)`` is the signal of octave k at the points and ``roughness`` the ratio of the amplitudes of successive
octaves. A signal that is held at its mean leaves an octave out, without moving the mean height.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....support.arrays import Array, Numbers
from .broken import broken_noise
from .lattice_noise import cell_noise, gradient_noise, value_noise
from .voronoi import nearest_distances

Noise = Callable[[Array, Array, int], Array]
Octaves = Callable[[int], Numbers]


def _noise_from_distances(function: Callable[[Array, Array], Array]) -> Noise:
    return lambda x, y, key: 2.0 * function(*nearest_distances(x, y, key)) - 1.0


#: Noises of unit wavelength, ``noise(x, y, key)`` in lattice units.
BASES: dict[str, Noise] = {
    "GRADIENT": gradient_noise,
    "MIDPOINT": value_noise,
    "CELLS": cell_noise,
    "VORONOI_F1": _noise_from_distances(lambda f1, f2: f1),
    "VORONOI_F2": _noise_from_distances(lambda f1, f2: f2),
    "VORONOI_F2_F1": _noise_from_distances(lambda f1, f2: f2 - f1),
    "CRACKLE": _noise_from_distances(lambda f1, f2: np.minimum(10.0 * (f2 - f1), 1.0)),
    "BROKEN": broken_noise,
}


@dataclass(frozen=True)
class Fractal:
    """A fractal sum: ``signal`` converts an octave's noise, and ``of(signal, octaves, roughness)`` sums the octaves."""

    signal: Callable[[Array], Array]
    of: Callable[[Octaves, int, float], Numbers]


def _keep_noise(noise: Array) -> Array:
    return noise


def _raise_noise(noise: Array) -> Array:
    return 1.0 + noise


def _crest_noise(noise: Array) -> Array:
    return (1.0 - np.abs(noise)) ** 2


def add_octaves(signal: Octaves, octaves: int, roughness: float) -> Numbers:
    """Sum weighted octaves: fractional Brownian motion if the signal is the noise, turbulence if its magnitude."""
    total = signal(0)
    for k in range(1, octaves):
        total = total + roughness**k * signal(k)
    return total


def sum_multifractal(signal: Octaves, octaves: int, roughness: float) -> Numbers:
    """Multiply the factors (1 + octave): smooth plains between rough heights."""
    total = 1.0 + signal(0)
    for k in range(1, octaves):
        total = total * (1.0 + roughness**k * signal(k))
    return total


def sum_hetero_terrain(signal: Octaves, octaves: int, roughness: float) -> Numbers:
    """Sum octaves that are each scaled by the height so far, so that low ground is smooth (hetero terrain)."""
    total = signal(0)
    for k in range(1, octaves):
        total = total + roughness**k * signal(k) * total
    return total


def sum_hybrid_multifractal(signal: Octaves, octaves: int, roughness: float) -> Numbers:
    """Sum octaves that are each scaled by the octave before, so that valleys are smooth at all heights."""
    total = weight = signal(0)
    for k in range(1, octaves):
        weight = np.minimum(weight, 1.0)
        part = roughness**k * signal(k)
        total = total + weight * part
        weight = weight * part
    return total


def sum_ridged_multifractal(signal: Octaves, octaves: int, roughness: float) -> Numbers:
    """Sum octaves to sharp crests where the noise passes zero; the sum is rough near crests only."""
    total = part = signal(0)
    for k in range(1, octaves):
        part = signal(k) * np.clip(part, 0.0, 1.0)
        total = total + roughness**k * part
    return total


FRACTALS: dict[str, Fractal] = {
    "FBM": Fractal(_keep_noise, add_octaves),
    "MULTIFRACTAL": Fractal(_keep_noise, sum_multifractal),
    "HYBRID": Fractal(_raise_noise, sum_hybrid_multifractal),
    "RIDGED": Fractal(_crest_noise, sum_ridged_multifractal),
    "HETERO": Fractal(_raise_noise, sum_hetero_terrain),
    "TURBULENCE": Fractal(np.abs, add_octaves),
    "CRESTS": Fractal(_crest_noise, add_octaves),
}

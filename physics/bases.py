"""Noise bases and the fractal sums over their octaves.

The sums are Musgrave's (Ebert et al., "Texturing and Modeling", 3rd ed. 2003, ch. 16), with his offset
and gain of 1: ``noise(k)`` is octave k at the points, in about [-1, 1], and ``roughness`` the ratio of
the amplitudes of successive octaves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .noise import cell_noise, gradient_noise, value_noise
from .voronoi import distances

Noise = Callable[[np.ndarray, np.ndarray, int], np.ndarray]
Octaves = Callable[[int], np.ndarray]
Fractal = Callable[[Octaves, int, float], np.ndarray]


def _of_distances(function: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Noise:
    return lambda x, y, key: 2.0 * function(*distances(x, y, key)) - 1.0


#: Noises of unit wavelength, ``noise(x, y, key)`` in lattice units.
BASES: dict[str, Noise] = {
    "GRADIENT": gradient_noise,
    "MIDPOINT": value_noise,
    "CELLS": cell_noise,
    "VORONOI_F1": _of_distances(lambda f1, f2: f1),
    "VORONOI_F2": _of_distances(lambda f1, f2: f2),
    "VORONOI_F2_F1": _of_distances(lambda f1, f2: f2 - f1),
    "CRACKLE": _of_distances(lambda f1, f2: np.minimum(10.0 * (f2 - f1), 1.0)),
}


def fbm(noise: Octaves, octaves: int, roughness: float) -> np.ndarray:
    """Fractional Brownian motion: the plain sum, equally rough everywhere."""
    total = noise(0)
    for k in range(1, octaves):
        total = total + roughness**k * noise(k)
    return total


def multifractal(noise: Octaves, octaves: int, roughness: float) -> np.ndarray:
    """The product of (1 + octave): smooth plains between rough heights."""
    total = 1.0 + noise(0)
    for k in range(1, octaves):
        total = total * (1.0 + roughness**k * noise(k))
    return total


def hetero(noise: Octaves, octaves: int, roughness: float) -> np.ndarray:
    """Hetero terrain: each octave scaled by the height so far, so that low ground is smooth."""
    total = 1.0 + noise(0)
    for k in range(1, octaves):
        total = total + roughness**k * (1.0 + noise(k)) * total
    return total


def hybrid(noise: Octaves, octaves: int, roughness: float) -> np.ndarray:
    """Hybrid multifractal: each octave scaled by the one before, so that valleys are smooth at all heights."""
    total = 1.0 + noise(0)
    weight = total
    for k in range(1, octaves):
        weight = np.minimum(weight, 1.0)
        signal = roughness**k * (1.0 + noise(k))
        total = total + weight * signal
        weight = weight * signal
    return total


def ridged(noise: Octaves, octaves: int, roughness: float) -> np.ndarray:
    """Ridged multifractal: sharp crests where the noise passes zero, rough near crests only."""
    signal = (1.0 - np.abs(noise(0))) ** 2
    total = signal
    for k in range(1, octaves):
        signal = (1.0 - np.abs(noise(k))) ** 2 * np.clip(signal, 0.0, 1.0)
        total = total + roughness**k * signal
    return total


def turbulence(noise: Octaves, octaves: int, roughness: float) -> np.ndarray:
    """The sum of magnitudes: rounded lumps with creases between them."""
    total = np.abs(noise(0))
    for k in range(1, octaves):
        total = total + roughness**k * np.abs(noise(k))
    return total


FRACTALS: dict[str, Fractal] = {"FBM": fbm, "MULTIFRACTAL": multifractal, "HYBRID": hybrid, "RIDGED": ridged,
                                "HETERO": hetero, "TURBULENCE": turbulence}

"""Statistics of a grid of heights beside those of ``physics.terrain.roughness``: curvature and shadows.

A Gaussian surface is described by its power spectrum alone. Its curvature has a kurtosis of 3, and its shadows depend
on its spectrum only. Surfaces of facets, with the same spectrum, have their curvature at edges.
"""

from __future__ import annotations

import math

import numpy as np

from ...physics.terrain.noise.lattice_noise import quintic_fade
from ...physics.terrain.roughness.roughness import RoughSurface, resolved_share
from ...physics.terrain.roughness.statistics import rms_deviation
from ...physics.terrain.roughness.structure_function import NOISE_DEVIATION
from ...support.arrays import Array


def measure_spectral_slope(waves_per_m: Array, density: Array, longest_m: float, shortest_m: float) -> float:
    """Measure the exponent of a power spectrum between two wavelengths, by a line through its logarithms."""
    fitted = (waves_per_m >= 1.0 / longest_m) & (waves_per_m <= 1.0 / shortest_m) & (density > 0)
    return float(np.polyfit(np.log(waves_per_m[fitted]), np.log(density[fitted]), 1)[0])


def measure_curvature_kurtosis(heights: Array) -> float:
    """Measure the kurtosis of the discrete Laplacian of heights (rows, columns); 3 for a Gaussian surface, more with
    edges."""
    inner = heights[1:-1, 1:-1]
    curvature = heights[1:-1, 2:] + heights[1:-1, :-2] + heights[2:, 1:-1] + heights[:-2, 1:-1] - 4 * inner
    curvature = curvature - curvature.mean()
    return float(np.mean(curvature**4) / np.mean(curvature**2) ** 2)


def measure_point_slope(heights_m: Array, spacing_m: float) -> float:
    """Measure the RMS slope, as a tangent, between neighbours of a grid of heights along its axes."""
    return rms_deviation(heights_m, 1) / spacing_m


def measure_shadow_share(heights_m: Array, spacing_m: float, sun_deg: float, margin: int) -> float:
    """Measure the share of a square grid of heights that lies in shadow, as a mean over Suns in the four directions of
    the axes.

    ``sun_deg`` is the elevation of the Sun, a point. The outer ``margin`` points of every side cast shadows and are not
    counted. Points that turn away from the Sun are in shadow.
    """
    tangent = math.tan(math.radians(sun_deg))
    shares = []
    for turn in range(4):
        rows = np.rot90(heights_m, turn)[margin : len(heights_m) - margin]
        # A ray toward the Sun falls by the tangent on its way to a point: in these heights it is level.
        level = rows + np.arange(rows.shape[1]) * (spacing_m * tangent)
        lit = level >= np.maximum.accumulate(level, axis=1)
        shares.append(1.0 - float(lit[:, margin : rows.shape[1] - margin].mean()))
    return sum(shares) / len(shares)


def predict_shadow_share(sun_deg: float, slope: float) -> float:
    """Predict the share in shadow of a Gaussian surface whose RMS slope along the light is ``slope``, as a tangent.

    This is the closed form of Smith 1967 (J. Geophys. Res. 72, 4059), which neglects that heights along a ray are
    correlated.
    """
    tangent = math.tan(math.radians(sun_deg))
    v = tangent / (math.sqrt(2.0) * slope)
    hidden = (math.exp(-v * v) / (math.sqrt(math.pi) * v) - math.erfc(v)) / 2
    return 1.0 - (1.0 - math.erfc(v) / 2) / (1.0 + hidden)


def draw_gaussian_surface(surface: RoughSurface, points: int, spacing_m: float, random: np.random.Generator) -> Array:
    """Draw the heights (n, n), m, of a periodic Gaussian surface with the power spectrum of a random surface on a grid.

    The spectrum of an octave is the sum of the spectra of its two kernels, fade and fade times distance (see
    ``roughness.structure_function``). Phases are random, so nothing but the spectrum is the same.
    """
    along = np.fft.fftfreq(points, 1.0 / points) * spacing_m
    power = np.zeros((points, points))
    for wavelength, amplitude in zip(surface.wavelength_m, surface.amplitude_m, strict=True):
        share = float(resolved_share(float(wavelength), 2 * spacing_m))
        if share == 0.0 or amplitude == 0.0:
            continue
        t = along / wavelength
        kernel = 1.0 - quintic_fade(np.minimum(np.abs(t), 1.0))
        of_fade, of_distance = (np.abs(np.fft.fft(each)) ** 2 for each in (kernel, t * kernel))
        density = np.outer(of_fade, of_distance) + np.outer(of_distance, of_fade)
        power += density * ((amplitude * share * NOISE_DEVIATION) ** 2 / density.mean())
    noise = np.fft.rfft2(random.standard_normal((points, points)))
    return np.fft.irfft2(noise * np.sqrt(power[:, : points // 2 + 1]), (points, points))

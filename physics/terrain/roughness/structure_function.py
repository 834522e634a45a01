"""The structure function of gradient noise: mean square difference of points at a distance, in closed form."""

from __future__ import annotations

import functools
import math

import numpy as np

from ....support.arrays import Array
from ..noise.lattice_noise import quintic_fade

#: Standard deviation of the unit noise; its structure function saturates at twice the square.
NOISE_DEVIATION = 0.30506


@functools.cache
def _kernel_autocorrelations() -> tuple[Array, Array, Array]:
    """Compute lags (n,) and the autocorrelations there of the noise's two one-dimensional kernels.

    Noise is a sum over lattice points of g_x psi(x) phi(y) + g_y phi(x) psi(y), with phi = 1 - fade(|t|) and psi = t
    phi, so the covariance of the noise is made of the kernels' autocorrelations.
    """
    n = 512  # samples per lattice unit
    t = (np.arange(2 * n) + 0.5) / n - 1.0
    phi = 1.0 - quintic_fade(np.abs(t))
    of_phi, of_psi = (np.correlate(f, f, "full")[2 * n - 1 :] / n for f in (phi, t * phi))
    return np.arange(2 * n) / n, of_phi, of_psi


@functools.cache
def _structure_table(dimensions: int) -> tuple[Array, Array]:
    """Tabulate distances in wavelengths and the structure function of unit noise, averaged over directions."""
    lag, phi, psi = _kernel_autocorrelations()
    r = np.concatenate([np.linspace(0.02, 1.0, 99), np.linspace(1.02, 3.5, 125)])
    if dimensions == 2:
        angle = (np.arange(24) + 0.5) / 24 * math.pi / 2
        ways = np.stack([np.cos(angle), np.sin(angle)])
    else:  # Fibonacci points on one octant
        k = np.arange(400) + 0.5
        up = 1 - 2 * k / 400
        turn, out = 2.399963 * k, np.sqrt(1 - up**2)
        ways = np.abs(np.stack([out * np.cos(turn), out * np.sin(turn), up]))
    along = r[:, None, None] * ways.T[None]
    near_phi, near_psi = (np.interp(along, lag, table, right=0.0) for table in (phi, psi))

    def covariance(of_phi: Array, of_psi: Array) -> Array:
        parts = [
            np.prod(of_phi, axis=-1) / np.where(of_phi[..., k] == 0, 1, of_phi[..., k]) * of_psi[..., k]
            for k in range(dimensions)
        ]
        return (2.0 / dimensions) * np.sum(parts, axis=0)

    at_zero = covariance(np.full((1, dimensions), phi[0]), np.full((1, dimensions), psi[0]))[0]
    return r, 2.0 * (at_zero - covariance(near_phi, near_psi).mean(axis=1))


def structure_function(distance: Array, dimensions: int = 2) -> Array:
    """Compute the mean square difference of unit noise at points ``distance`` wavelengths apart."""
    r, table = _structure_table(dimensions)
    near = table[0] * (distance / r[0]) ** 2  # the noise is smooth: a parabola at the origin
    return np.where(distance < r[0], near, np.interp(distance, r, table))

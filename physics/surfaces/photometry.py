"""Albedos and the phase function of any photometric law, by numerical integration; the simple laws.

A law is a function of incidence, emission and azimuth in radians (azimuth 0: the Sun behind the observer). It
broadcasts, and returns the bidirectional reflectance r in 1/sr: radiance over the irradiance of a surface that faces
the Sun. Definitions are as in Hapke 2012, chapter 11.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...support.arrays import Array, Numbers

Law = Callable[[Array, Array, Array], Array]

#: Bond albedo of the law 2 µ0/(µ0 + µ), whose normal albedo is 1.
LOMMEL_SEELIGER_BOND = 16 / 3 * (1 - math.log(2))
_GAUSS_NODES = 48


def lunar_lambert(albedo: Numbers, share: Numbers) -> Law:
    """Make McEwen's law (1991, Icarus 92, 298) without phase dependence, ``share`` of it Lommel-Seeliger, the rest
    Lambert.

    I/F = A [2 s µ0/(µ0 + µ) + (1 - s) µ0], scaled so that ``albedo`` is the Bond albedo. With share 0 it is Lambert's
    law, with 1 Lommel and Seeliger's.
    """
    normal = lunar_lambert_normal_albedo(albedo, share)

    def law(incidence: Array, emission: Array, azimuth: Array) -> Array:
        mu0, mu = np.cos(incidence) + 0 * azimuth, np.cos(emission)
        both = np.maximum(mu0 + mu, 1e-300)
        r: Array = np.where((mu0 > 0) & (mu >= 0), normal / np.pi * mu0 * (2 * share / both + 1 - share), 0.0)
        return r

    return law


def lunar_lambert_normal_albedo(albedo: Numbers, share: Numbers) -> Numbers:
    """Compute the normal albedo of ``lunar_lambert`` with this Bond albedo and Lommel-Seeliger share."""
    return albedo / (1 + share * (LOMMEL_SEELIGER_BOND - 1))


def _gauss_nodes(low: Numbers, high: Numbers) -> tuple[Array, Array]:
    """Make nodes and weights on [low, high] along a last axis, denser at both ends, where laws have peaks and edges."""
    x, weight = np.polynomial.legendre.leggauss(_GAUSS_NODES)
    t = (x + 1) / 2
    place, slope = t**3 * (10 - 15 * t + 6 * t * t), 30 * t * t * (1 - t) ** 2
    width = np.asarray(high - low, np.float64)[..., None]
    return np.asarray(low, np.float64)[..., None] + width * place, width * slope * weight / 2


def normal_albedo(law: Law) -> float:
    """Compute the radiance factor I/F of a surface that is lit and seen along its normal."""
    return float(np.pi * law(np.zeros(()), np.zeros(()), np.zeros(())))


def hemispherical_albedo(law: Law, incidence: Numbers) -> Array:
    """Compute the share of a beam's light that the surface returns, at incidence angles in radians below π/2.

    For a reciprocal law it is also the radiance factor at this emission angle under light from the whole sky. The
    integration uses polar coordinates about the source, where the opposition surge is.
    """
    flat = np.atleast_1d(np.asarray(incidence, np.float64))
    i = flat[:, None, None]
    total = np.zeros(len(flat))
    # Rings about the source that are wholly above the horizon, then those that it cuts.
    for low, high in ((0 * flat, np.pi / 2 - flat), (np.pi / 2 - flat, np.pi / 2 + flat)):
        g, ring = _gauss_nodes(low, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = -1 / (np.tan(i[..., 0]) * np.tan(g))
        end = np.where(g + i[..., 0] <= np.pi / 2, np.pi, np.arccos(np.clip(np.nan_to_num(cut), -1, 1)))
        phi, arc = _gauss_nodes(np.zeros_like(end), end)
        g = g[..., None]
        x = np.cos(g) * np.sin(i) - np.sin(g) * np.cos(i) * np.cos(phi)
        y = np.sin(g) * np.sin(phi)
        mu = np.maximum(np.cos(g) * np.cos(i) + np.sin(g) * np.sin(i) * np.cos(phi), 0.0)
        r = law(i, np.arctan2(np.hypot(x, y), mu), np.arctan2(y, x))
        total += 2 * np.einsum("kgp,kg->k", r * mu * arc, np.sin(g[..., 0]) * ring)
    return (total / np.cos(flat)).reshape(np.shape(incidence))


def hemispherical_fit(law_of: Callable[[float, float], Law], gammas: Array, slopes: tuple[float, float]) -> Array:
    """Fit the hemispherical albedo by a polynomial in cos i, r0 = (1 - γ)/(1 + γ) and t. Return its coefficients (4, 3,
    5).

    ``law_of(w, theta_bar)`` is the law with this single-scattering albedo w, where γ = √(1 - w), and this mean slope in
    radians. ``gammas`` are the values of γ to fit, one or at least three. t goes from -1 to 1 as the mean slope goes
    from the first to the second of ``slopes``. Over all of them and all angles to 87 degrees the error is about 0.005,
    and 0.01 if w is 1 or slopes go to 60 degrees.
    """
    low, high = slopes
    mu, t = np.linspace(0.05, 1.0, 12), np.linspace(-1.0, 1.0, 7) if high > low else np.zeros(1)
    albedo = np.stack(
        [
            [
                hemispherical_albedo(law_of(1 - gamma**2, (low + high) / 2 + x * (high - low) / 2), np.arccos(mu))
                for x in t
            ]
            for gamma in gammas
        ]
    )
    powers = (4, min(3, len(gammas)), min(5, len(t)))
    r0 = ((1 - gammas) / (1 + gammas))[:, None]
    columns = [mu**k * (r0**n * t**m)[..., None] for k, n, m in np.ndindex(powers)]
    found = np.linalg.lstsq(np.stack([c.ravel() for c in columns], axis=1), albedo.ravel(), rcond=None)[0]
    coefficients = np.zeros((4, 3, 5))
    coefficients[:, : powers[1], : powers[2]] = found.reshape(powers)
    return coefficients


def disc_brightness(law: Law, phase: Numbers) -> Array:
    """Compute the brightness of a sphere at phase angles in radians, relative to a white Lambert disc of its size that
    faces the observer and the Sun.
    """
    alpha = np.atleast_1d(np.asarray(phase, np.float64))
    longitude, along = _gauss_nodes(alpha - np.pi / 2, np.full_like(alpha, np.pi / 2))
    latitude, across = _gauss_nodes(0.0, np.pi / 2)
    a, lam = alpha[:, None, None], longitude[..., None]
    mu0, mu = (np.maximum(np.cos(latitude) * np.cos(angle), 0.0) for angle in (lam - a, lam))
    psi = np.arctan2(np.sin(a) * np.sin(latitude), np.cos(a) - mu0 * mu)
    r = law(np.arccos(mu0), np.arccos(mu), psi)
    bright = 2 * np.einsum("klb,kl,b->k", r * mu, along, across * np.cos(latitude))
    return np.asarray(bright.reshape(np.shape(phase)))


def geometric_albedo(law: Law) -> float:
    """Compute the brightness of a sphere at phase angle 0, relative to a white Lambert disc of its size that faces the
    observer and the Sun.
    """
    return float(disc_brightness(law, 0.0))


def phase_curve(law: Law, phase: Numbers) -> Array:
    """Compute the brightness of a sphere at phase angles in radians over its brightness at phase angle 0."""
    return disc_brightness(law, phase) / geometric_albedo(law)


def equigonal_albedo(law: Law) -> float:
    """Compute the radiance factor I/F on the mirror meridian, i = e = g/2, extrapolated to g = 0 without the opposition
    surge.

    The quadratic fit over phase angles g from 10 to 120 degrees is the method of Filacchione et al. 2022 (arXiv
    2111.15541). The result is a reflectance in one geometry, not the albedo of a sphere or a plane.
    """
    degrees = np.arange(10.0, 121.0)
    half = np.radians(degrees) / 2
    return float(np.polyfit(degrees, np.pi * law(half, half, np.full_like(half, np.pi)), 2)[-1])


def bond_albedo(law: Law) -> float:
    """Compute the share of sunlight that a sphere returns: p q. A plane returns the same share of light from an even
    sky.
    """
    alpha, weight = _gauss_nodes(0.0, np.pi)
    return float(2 * (disc_brightness(law, alpha) * np.sin(alpha)) @ weight)

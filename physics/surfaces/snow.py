"""Reflectance of bright snow on Earth as measured, by asymptotic radiative transfer.

Source: Kokhanovsky and Zege 2004, Applied Optics 43, 1589, with the constants of measured snow in the reflectance of a
layer without absorption. The reflectance of snow whose grains absorb follows from that reflectance and the snow's
spherical albedo.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array, Numbers
from .photometry import Law

#: Constant A of the reflectance without absorption.
LEVEL = 1.247
#: Constant B.
LINEAR = 1.186
#: Constant C.
PRODUCT = 5.157
#: Amplitude and decay per degree of the two parts of the phase function.
PHASE_TERMS = ((11.1, 0.087), (1.1, 0.014))
#: Least sum of the cosines of incidence and emission. Below it, at very grazing angles, the formula is invalid and
#: grows without limit.
MIN_COSINE_SUM = 0.2
#: Largest incidence, in degrees, for which the law is within about 5 % of measurements, off the principal plane.
LARGEST_INCIDENCE_DEG = 70.0
#: Largest emission angle, in degrees, of this range.
LARGEST_EMISSION_DEG = 60.0


def escape_function(mu: Numbers) -> Array:
    """Compute the escape function of a cosine µ, K = (3/7)(1 + 2µ); its mean over the hemisphere is 1."""
    return np.asarray(3 / 7 * (1 + 2 * np.asarray(mu, np.float64)))


def reflectance_factor(incidence: Numbers, emission: Numbers, azimuth: Numbers, albedo: Numbers) -> Array:
    """Compute the radiance relative to a white Lambert surface in the same light, at angles in radians, azimuth 0 on
    the Sun's side. ``albedo`` is the spherical albedo, the share of light from all sides that is reflected. The
    radiance is 0 where the Sun or the observer is below the surface.

    Measurements agree within about 5 % for i up to 70 and e up to 60 degrees, off the principal plane. With an albedo
    of 1 the law returns 2 % more light than it receives where the Sun is 10 degrees high, and 8 % at 1 degree.
    """
    i, e, psi = (np.asarray(angle, np.float64) for angle in (incidence, emission, azimuth))
    mu0, mu = np.cos(i), np.cos(e)
    cos_phase = np.clip(mu0 * mu + np.sin(i) * np.sin(e) * np.cos(psi), -1.0, 1.0)
    scattering_deg = 180.0 - np.degrees(np.arccos(cos_phase))
    lit = (mu0 > 0) & (mu >= 0)
    both = np.maximum(mu0 + mu, MIN_COSINE_SUM)
    phase = sum(amplitude * np.exp(-decay * scattering_deg) for amplitude, decay in PHASE_TERMS)
    white = (LEVEL + LINEAR * both + PRODUCT * mu0 * mu + phase) / (4 * both)
    absorbed = np.asarray(albedo, np.float64) ** (escape_function(mu0) * escape_function(mu) / white)
    return np.asarray(np.where(lit, white * absorbed, 0.0))


def snow_law(albedo: Numbers) -> Law:
    """Make the bidirectional reflectance of snow in 1/sr, see ``photometry``; ``albedo`` is the spherical albedo."""

    def law(incidence: Array, emission: Array, azimuth: Array) -> Array:
        r: Array = reflectance_factor(incidence, emission, azimuth, albedo) * np.cos(incidence) / np.pi
        return r

    return law

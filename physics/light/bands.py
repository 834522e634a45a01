"""The bands R, G, B of a pair: the meaning of its channels, and the conversion of spectra to them.

A channel is a radiance in W/(m² sr) over all wavelengths: the radiance in the band relative to sunlight in the band,
times all sunlight. Grey ground therefore has equal channels, and π L / E is the radiance factor in each band. The light
in a camera's band is the channel times the share of sunlight in that band.

The bands are at 620, 550 and 460 nm, about at the primaries of screens. Between them the light relative to sunlight is
interpolated linearly; beyond the outer two it is constant. The signal of a camera with any filters follows from this
spectrum, see ``camera.colour``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ...support.arrays import Array
from ..surfaces.spectra import MATERIALS, bubbly_ice_reflectance, ice_absorption_1_m, snow_reflectance
from .photons import planck_radiance
from .sunlight import BANDS_M, SUN_TEMPERATURE_K

#: Wavelengths in nm of the visible range, within which materials are fitted.
VISIBLE_NM = np.arange(400.0, 701.0, 2.0)


def band_shares(wavelength_m: Array) -> Array:
    """Compute the weights (3, n) of R, G, B at wavelengths (n,) in metres; their sum over the bands is 1."""
    ascending = np.argsort(BANDS_M)
    centres = np.array(BANDS_M)[ascending]
    return np.stack([np.interp(wavelength_m, centres, one) for one in np.eye(3)[:, ascending]])


def band_reflectances(reflectance: Callable[[Array], Array]) -> tuple[float, float, float]:
    """Fit the reflectances in R, G, B that represent a spectrum, a function of wavelengths in nm.

    The lines between them at the bands' wavelengths fit the spectrum by least squares over the visible range, weighted
    by the Sun's photons. A camera whose response is a sum of the bands receives exactly the light of the spectrum; any
    camera in the visible is within 5 % for the materials of ``spectra``. Bands are at least 0: a band whose line would
    be negative, as for ice that is dark except in the blue, is 0, and the others are fitted again.
    """
    wavelength = VISIBLE_NM * 1e-9
    shares = band_shares(wavelength)
    weighted = shares * planck_radiance(wavelength, SUN_TEMPERATURE_K) * wavelength
    of_bands, of_spectrum = weighted @ shares.T, weighted @ reflectance(VISIBLE_NM)
    found, kept = np.zeros(3), np.ones(3, bool)
    while kept.any():
        found[kept] = np.linalg.solve(of_bands[np.ix_(kept, kept)], of_spectrum[kept])
        if found.min() >= 0.0:
            break
        kept &= found > 0.0
        found[~kept] = 0.0
    red, green, blue = found.tolist()
    return red, green, blue


@lru_cache(maxsize=64)
def material_bands(name: str) -> tuple[float, float, float]:
    """Return the reflectances in R, G, B of a material, a key of ``spectra.MATERIALS``."""
    return band_reflectances(MATERIALS[name].reflectance)


@lru_cache(maxsize=64)
def snow_bands(grain_radius_m: float) -> tuple[float, float, float]:
    """Return the reflectances in R, G, B of clean snow with grains of this radius."""
    return band_reflectances(lambda wavelength_nm: snow_reflectance(wavelength_nm, grain_radius_m))


@lru_cache(maxsize=64)
def bubbly_ice_bands(bubble_radius_m: float, bubble_share: float) -> tuple[float, float, float]:
    """Return the reflectances in R, G, B of clean, deep ice with bubbles of this radius and share of the volume."""
    return band_reflectances(lambda wavelength_nm: bubbly_ice_reflectance(wavelength_nm, bubble_radius_m, bubble_share))


def clear_ice_absorption_1_m() -> tuple[float, float, float]:
    """Return the absorption coefficients of pure ice at the wavelengths of the bands R, G, B, in 1/m."""
    red, green, blue = ice_absorption_1_m(np.array(BANDS_M) * 1e9).tolist()
    return red, green, blue

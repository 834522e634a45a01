"""Constants of pure ice at the wavelengths of lasers, 400 to 1650 nm.

In the visible they are the constants of the surfaces' colours; the table continues them into the infrared.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..surfaces.spectra import ice_absorption_1_m

#: Shortest and longest wavelength in nm.
WAVELENGTHS_NM = (400.0, 1650.0)
_VISIBLE_NM = 700.0

#: Imaginary part of the refractive index of ice: Warren and Brandt 2008, J. Geophys. Res. 113, D14220, as in the
#: package snowoptics 0.99.2; 700 to 1440 nm in steps of 10 nm, then at the wavelengths listed.
_INFRARED_NM = np.array(
    [
        *np.arange(700.0, 1441.0, 10.0).tolist(),
        1449.0,
        1460.0,
        1471.0,
        1481.0,
        1493.0,
        1504.0,
        1515.0,
        1527.0,
        1538.0,
        1563.0,
        1587.0,
        1613.0,
        1650.0,
    ]
)
# fmt: off
_INFRARED_K = np.array([
    2.900e-08, 3.440e-08, 4.030e-08, 4.300e-08, 4.920e-08, 5.870e-08, 7.080e-08, 8.580e-08, 1.020e-07, 1.180e-07,
    1.340e-07, 1.400e-07, 1.430e-07, 1.450e-07, 1.510e-07, 1.830e-07, 2.150e-07, 2.650e-07, 3.350e-07, 3.920e-07,
    4.200e-07, 4.440e-07, 4.740e-07, 5.110e-07, 5.530e-07, 6.020e-07, 7.550e-07, 9.260e-07, 1.120e-06, 1.330e-06,
    1.620e-06, 2.000e-06, 2.250e-06, 2.330e-06, 2.330e-06, 2.170e-06, 1.960e-06, 1.810e-06, 1.740e-06, 1.730e-06,
    1.700e-06, 1.760e-06, 1.820e-06, 2.040e-06, 2.250e-06, 2.290e-06, 3.040e-06, 3.840e-06, 4.770e-06, 5.760e-06,
    6.710e-06, 8.660e-06, 1.020e-05, 1.130e-05, 1.220e-05, 1.290e-05, 1.320e-05, 1.350e-05, 1.330e-05, 1.320e-05,
    1.320e-05, 1.310e-05, 1.320e-05, 1.320e-05, 1.340e-05, 1.390e-05, 1.420e-05, 1.480e-05, 1.580e-05, 1.740e-05,
    1.980e-05, 3.442e-05, 5.959e-05, 1.028e-04, 1.516e-04, 2.030e-04, 2.942e-04, 3.987e-04, 4.941e-04, 5.532e-04,
    5.373e-04, 5.143e-04, 4.908e-04, 4.594e-04, 3.858e-04, 3.105e-04, 2.659e-04, 2.361e-04,
])
# fmt: on
#: Real part of the refractive index, from the same source.
_REAL_NM = np.array(
    [
        400.0,
        450.0,
        500.0,
        550.0,
        600.0,
        700.0,
        800.0,
        900.0,
        1000.0,
        1100.0,
        1200.0,
        1300.0,
        1400.0,
        1504.0,
        1587.0,
        1650.0,
    ]
)
_REAL = np.array(
    [
        1.3194,
        1.3157,
        1.3130,
        1.3110,
        1.3094,
        1.3069,
        1.3049,
        1.3032,
        1.3015,
        1.2998,
        1.2980,
        1.2961,
        1.2937,
        1.2916,
        1.2897,
        1.2879,
    ]
)


def laser_absorption_1_m(wavelength_nm: float) -> float:
    """Compute the absorption coefficient 4πk/λ of pure ice in 1/m. Raises IcyMoonError beyond ``WAVELENGTHS_NM``."""
    _check(wavelength_nm)
    if wavelength_nm <= _VISIBLE_NM:
        return float(ice_absorption_1_m(wavelength_nm))
    k = np.exp(np.interp(np.log(wavelength_nm), np.log(_INFRARED_NM), np.log(_INFRARED_K)))
    return float(4.0 * np.pi * k / (wavelength_nm * 1e-9))


def refractive_index(wavelength_nm: float) -> float:
    """Find the real refractive index n of ice. Raises IcyMoonError beyond ``WAVELENGTHS_NM``."""
    _check(wavelength_nm)
    return float(np.interp(wavelength_nm, _REAL_NM, _REAL))


def group_index(wavelength_nm: float) -> float:
    """Compute the group index n - λ dn/dλ, which sets the speed of a pulse in ice. Raises IcyMoonError beyond
    ``WAVELENGTHS_NM``.
    """
    slope: Array = np.gradient(_REAL, _REAL_NM)
    return refractive_index(wavelength_nm) - wavelength_nm * float(np.interp(wavelength_nm, _REAL_NM, slope))


def _check(wavelength_nm: float) -> None:
    low, high = WAVELENGTHS_NM
    if not low <= wavelength_nm <= high:
        raise IcyMoonError(f"The laser's wavelength is {wavelength_nm:g} nm; give {low:g} to {high:g} nm.")

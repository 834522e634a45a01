"""Compares colours of the materials with published spectra that were not used to make them."""

from __future__ import annotations

import numpy as np

from ..physics.surfaces.spectra import MATERIALS, snow_reflectance
from . import published_spectra as published
from .comparison import Bench, Comparison, Row

#: Reflectance at 550 nm of Europa's trailing hemisphere: the lower end of the moon's Bond albedo, as it is the darker
#: side.
_TRAILING_GREEN = 0.62
_COLOURS_NM = (400.0, 460.0, 620.0, 700.0)
#: Largest error of the closed form for snow that counts as agreement.
_SNOW_TOLERANCE = 0.005
#: Largest error of Enceladus' ratios that counts as agreement.
_RATIO_TOLERANCE = 0.03
# ``tests/validation/test_colours.py`` predicts the sizes of both causes.
_WHY_COARSE_SNOW = (
    "Cause unknown: the closed form meets this firn to 0.011 with twice the radius. Its smooth surface, which the form "
    "leaves out, would alone darken it by 1.6 to 1.7 times the difference"
)
_WHY_SULPHUR = (
    "Likely cause: sulphur stains plains of the trailing side too (Carlson et al. 1999, Science 286, 97). With 20 to "
    "30 % `SULPHUR` all four ratios pass, with none of the salts or tholin; its colour is assumed"
)


def _make_snow_rows() -> list[Row]:
    rows = []
    for radius, albedos in published.SNOW.items():
        for wavelength in _COLOURS_NM:
            ours = float(snow_reflectance(wavelength, radius))
            rows.append(
                Row(
                    f"clean snow, grains of {radius * 1e6:g} µm: albedo at {wavelength:g} nm",
                    ours,
                    albedos[published.WAVELENGTHS_NM.index(wavelength)],
                    _SNOW_TOLERANCE,
                    published.SNOW_SOURCE,
                    why=_WHY_COARSE_SNOW,
                )
            )
    return rows


def _make_enceladus_rows() -> list[Row]:
    plains = MATERIALS["ENCELADUS_PLAINS"].reflectance(np.array(published.WAVELENGTHS_NM))
    ours, theirs = (spectrum / spectrum[published.GREEN_INDEX] for spectrum in (plains, published.ENCELADUS))
    return [
        Row(
            f"`ENCELADUS_PLAINS`, {wavelength:g} over 550 nm",
            float(ours[published.WAVELENGTHS_NM.index(wavelength)]),
            float(theirs[published.WAVELENGTHS_NM.index(wavelength)]),
            _RATIO_TOLERANCE,
            published.ENCELADUS_SOURCE,
        )
        for wavelength in _COLOURS_NM
    ]


def find_dark_matter_share() -> float:
    """Find the share of dark matter beside plains that gives Europa's trailing hemisphere its reflectance at 550 nm."""
    plains, dark = (float(MATERIALS[name].reflectance(550.0)) for name in ("EUROPA_PLAINS", "EUROPA_DARK"))
    return (plains - _TRAILING_GREEN) / (plains - dark)


def _make_europa_rows() -> list[Row]:
    share, rows = find_dark_matter_share(), []
    for wavelength in _COLOURS_NM:
        plains, dark = (float(MATERIALS[name].reflectance(wavelength)) for name in ("EUROPA_PLAINS", "EUROPA_DARK"))
        theirs, error = published.read_europa_over_green(wavelength)
        rows.append(
            Row(
                f"`EUROPA_PLAINS` with {100 * share:.0f} % `EUROPA_DARK`, {wavelength:g} over 550 nm",
                ((1 - share) * plains + share * dark) / _TRAILING_GREEN,
                theirs,
                error,
                published.EUROPA_SOURCE,
                why=_WHY_SULPHUR,
            )
        )
    return rows


def _compare_colours(bench: Bench) -> list[Row]:
    return [*_make_snow_rows(), *_make_enceladus_rows(), *_make_europa_rows()]


COMPARISON = Comparison(
    "colours",
    "Colours",
    "Reflectances of materials at 400, 460, 620 and 700 nm are compared with published spectra. No material was "
    "made from these spectra. They were read from the tables of the program TrueColorTools. Europa's trailing "
    "hemisphere is compared with plains that have enough dark matter for a reflectance of 0.62 at 550 nm. For "
    "salts, sulphur and tholin no spectrum was found: their numbers are assumed.",
    _compare_colours,
)

"""What the comparisons compute from published spectra and from laws, by cases that are known."""

import math
from functools import partial

import numpy as np
import pytest
from icymoon.physics.surfaces import photometry
from icymoon.physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from icymoon.physics.surfaces.spectra import MATERIALS, snow_reflectance
from icymoon.validation import published_spectra as published
from icymoon.validation.colours import find_dark_matter_share
from icymoon.validation.moon_albedos import compute_albedo_without_surge, compute_opposition_effect


def test_dark_matter_beside_plains_has_the_level_of_the_trailing_side():
    plains, dark = (MATERIALS[name].reflectance(550.0) for name in ("EUROPA_PLAINS", "EUROPA_DARK"))
    assert 0 < find_dark_matter_share() < 0.3
    assert (1 - find_dark_matter_share()) * plains + find_dark_matter_share() * dark == pytest.approx(0.62)


def test_ratios_of_europa_are_the_mean_of_two_spectra():
    assert published.read_europa_over_green(550.0) == (1.0, 0.0)
    ratio, error = published.read_europa_over_green(700.0)
    assert (ratio - error, ratio + error) == pytest.approx((0.6394 / 0.6110, 1.0066 / 0.8459))
    assert all(len(spectrum) == len(published.WAVELENGTHS_NM) for spectrum in published.SNOW.values())


def pass_with(name: str, share: float) -> list[bool]:
    """For each of four wavelengths, whether Europa's trailing side passes with this share of a material in it.

    Plains and dark matter share the rest so that the reflectance at 550 nm stays; False if they cannot.
    """
    parts = [MATERIALS[each] for each in (name, "EUROPA_DARK", "EUROPA_PLAINS")]
    green, dark_green, plains_green = (float(part.reflectance(550.0)) for part in parts)
    plains = (0.62 - share * green - (1 - share) * dark_green) / (plains_green - dark_green)
    shares = (share, 1 - share - plains, plains)
    found = []
    for wavelength in (400.0, 460.0, 620.0, 700.0):
        mixed = sum(one * float(part.reflectance(wavelength)) for one, part in zip(shares, parts, strict=True))
        ratio, error = published.read_europa_over_green(wavelength)
        found.append(min(shares) >= 0 and abs(mixed / 0.62 - ratio) <= error)
    return found


def test_sulphur_and_nothing_else_explains_the_missing_blue_of_europas_trailing_side():
    assert pass_with("SULPHUR", 0.0) == [False, False, True, True]
    assert all(all(pass_with("SULPHUR", share)) for share in (0.2, 0.25, 0.3))
    others = ("SULPHATE_SALTS", "ACID_HYDRATE", "IRRADIATED_SALT", "EUROPA_SALT", "THOLIN")
    assert set(others) == set(MATERIALS) - {"SULPHUR", "EUROPA_PLAINS", "EUROPA_DARK", "ENCELADUS_PLAINS"}
    assert not any(all(pass_with(name, share)) for name in others for share in np.linspace(0, 1, 21))


def test_what_the_page_states_of_firn():
    """A smooth surface reflects diffuse light from above and more of it from below, by total reflection."""
    index, sines = 1.31, (np.arange(2000) + 0.5) / 2000
    into = np.sqrt(1 - (sines / index) ** 2)
    cosine = np.sqrt(1 - sines**2)
    across, along = (cosine - index * into) / (cosine + index * into), (index * cosine - into) / (index * cosine + into)
    above = float(((across**2 + along**2) * sines).mean())  # mean of both, over sin² of the angle
    below = 1 - (1 - above) / index**2
    for wavelength in (460.0, 620.0, 700.0):
        theirs = published.SNOW[2500e-6][published.WAVELENGTHS_NM.index(wavelength)]
        bare = float(snow_reflectance(wavelength, 2500e-6))
        covered = above + (1 - above) * (1 - below) * bare / (1 - below * bare)
        assert 1.55 < (bare - covered) / (bare - theirs) < 1.75
        assert abs(float(snow_reflectance(wavelength, 5000e-6)) - theirs) < 0.011


def test_an_albedo_in_a_line_from_larger_phases_leaves_a_narrow_surge_out():
    surging, bare = (
        partial(
            bidirectional_reflectance,
            parameters=HapkeParameters(
                w=0.964,
                b=0.429,
                c=0.113,
                b_s0=amplitude,
                h_s=0.0002,
                b_c0=0.0,
                h_c=0.0,
                theta_bar=0.17,
                h_function="1981",
            ),
        )
        for amplitude in (0.5, 0.0)
    )
    without = photometry.geometric_albedo(bare)
    # 2 % of the surge's amplitude is left at 1.5°, and the rest of the curve bends.
    assert compute_albedo_without_surge(surging) == pytest.approx(without, rel=0.03)
    assert photometry.geometric_albedo(surging) > 1.15 * without


def test_the_opposition_effect_of_laws_without_a_surge():
    assert compute_opposition_effect(photometry.lunar_lambert(0.5, 0.0)) == pytest.approx(0.0, abs=1e-12)
    # I/F of Lommel and Seeliger's law is proportional to 1/(1 + cos e).
    assert compute_opposition_effect(photometry.lunar_lambert(0.5, 1.0)) == pytest.approx(
        (1 + math.cos(math.radians(5))) / 2 - 1
    )
    assert np.isfinite(compute_opposition_effect(photometry.lunar_lambert(0.5, 0.5)))

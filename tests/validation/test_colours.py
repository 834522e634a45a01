"""What the comparisons compute from published spectra and from laws, by cases that are known."""

import math
from functools import partial

import numpy as np
import pytest
from icymoon.physics.surfaces import photometry
from icymoon.physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from icymoon.physics.surfaces.spectra import MATERIALS
from icymoon.validation import published_spectra as published
from icymoon.validation.colours import dark_share
from icymoon.validation.moon_albedos import albedo_without_surge, opposition_effect


def test_dark_matter_beside_plains_has_the_level_of_the_trailing_side():
    plains, dark = (MATERIALS[name].reflectance(550.0) for name in ("EUROPA_PLAINS", "EUROPA_DARK"))
    assert 0 < dark_share() < 0.3
    assert (1 - dark_share()) * plains + dark_share() * dark == pytest.approx(0.62)


def test_ratios_of_europa_are_the_mean_of_two_spectra():
    assert published.read_europa_over_green(550.0) == (1.0, 0.0)
    ratio, error = published.read_europa_over_green(700.0)
    assert (ratio - error, ratio + error) == pytest.approx((0.6394 / 0.6110, 1.0066 / 0.8459))
    assert all(len(spectrum) == len(published.WAVELENGTHS_NM) for spectrum in published.SNOW.values())


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
    assert albedo_without_surge(surging) == pytest.approx(without, rel=0.03)
    assert photometry.geometric_albedo(surging) > 1.15 * without


def test_the_opposition_effect_of_laws_without_a_surge():
    assert opposition_effect(photometry.lunar_lambert(0.5, 0.0)) == pytest.approx(0.0, abs=1e-12)
    # I/F of Lommel and Seeliger's law is proportional to 1/(1 + cos e).
    assert opposition_effect(photometry.lunar_lambert(0.5, 1.0)) == pytest.approx(
        (1 + math.cos(math.radians(5))) / 2 - 1
    )
    assert np.isfinite(opposition_effect(photometry.lunar_lambert(0.5, 0.5)))

"""The snow law against numbers that others computed from it, and laws of reflection."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.surfaces import photometry, snow, surface_law
from icymoon.settings.description import defaults


@pytest.mark.parametrize(("emission_deg", "azimuth_deg", "value"), [(0, 0, 0.968), (60, 180, 1.064), (60, 0, 0.953)])
def test_white_snow_under_a_sun_at_30_degrees(emission_deg, azimuth_deg, value):
    found = snow.reflectance_factor(np.radians(60), np.radians(emission_deg), np.radians(azimuth_deg), 1.0)
    assert float(found) == pytest.approx(value, abs=5e-4)


def test_it_is_reciprocal_and_dark_below_the_horizon():
    random = np.random.default_rng(1)
    i, e, azimuth = random.uniform(0, 1.57, 200), random.uniform(0, 1.57, 200), random.uniform(0, 2 * np.pi, 200)
    for albedo in (0.0, 0.5, 1.0):
        there, back = (snow.reflectance_factor(*pair, azimuth, albedo) for pair in ((i, e), (e, i)))
        assert there == pytest.approx(back, rel=1e-12)
        assert np.isfinite(there).all()
        assert (there >= 0).all()
    assert not snow.reflectance_factor(np.array([1.6, 0.1]), np.array([0.1, 1.6]), 0.3, 0.9).any()


def test_the_escape_function_has_the_mean_of_a_normalized_flux():
    mu, weight = np.polynomial.legendre.leggauss(8)
    assert 2 * np.sum(snow.escape_function((mu + 1) / 2) * (mu + 1) / 2 * weight / 2) == pytest.approx(1.0)


@pytest.mark.parametrize("albedo", [0.6, 0.8, 0.9, 0.98, 1.0])
def test_the_albedo_is_the_spherical_albedo(albedo):
    """Theory has it exactly; the measured constants keep it within 2 %."""
    surface = defaults().surface | {"model": "SNOW", "albedo": albedo}
    law = surface_law.make_law(surface, defaults().hapke)
    assert photometry.bond_albedo(law) == pytest.approx(albedo, rel=0.02)

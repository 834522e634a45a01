"""Spectra of ice and of what lies on it, against published values and limits."""

import numpy as np
import pytest
from icymoon.physics.surfaces.spectra import MATERIALS, bubbly_ice_reflectance, ice_absorption_1_m, snow_reflectance

VISIBLE_NM = np.linspace(400, 700, 61)


def test_light_goes_as_far_in_pure_ice_as_published():
    # 4πk/λ of Warren and Brandt 2008 by hand: k = 2.289e-9 at 550 nm, 1.43e-8 at 650 nm.
    assert ice_absorption_1_m(550.0) == pytest.approx(0.0523, rel=2e-3)
    assert 1 / ice_absorption_1_m(650.0) == pytest.approx(3.62, rel=2e-3)


@pytest.mark.parametrize(
    ("radius_m", "red", "green", "blue"),
    [
        (25e-6, 0.986, 0.994, 0.997),
        (100e-6, 0.973, 0.987, 0.995),
        (0.5e-3, 0.940, 0.971, 0.988),
        (2e-3, 0.884, 0.944, 0.977),
    ],
)
def test_snow_is_as_white_as_the_closed_form_of_others(radius_m, red, green, blue):
    # The same formula evaluated by the package snoWoptics 0.99.2 at 630, 544 and 480 nm, three digits.
    assert snow_reflectance(np.array([630.0, 544.0, 480.0]), radius_m) == pytest.approx([red, green, blue], abs=6e-4)


def test_coarse_snow_is_darker_and_bluer():
    fine, coarse = (snow_reflectance(VISIBLE_NM, radius) for radius in (50e-6, 2e-3))
    assert (coarse < fine).all()
    assert coarse[0] / coarse[-1] > fine[0] / fine[-1] > 1


@pytest.mark.parametrize(
    ("share", "red", "green", "blue"), [(0.05, 0.77, 0.89, 0.95), (0.01, 0.56, 0.76, 0.89), (0.001, 0.15, 0.41, 0.70)]
)
def test_ice_is_as_blue_as_its_bubbles_are_few(share, red, green, blue):
    # The same formula evaluated by the package snowoptics 0.99.2 at 630, 544 and 480 nm, two digits.
    made = bubbly_ice_reflectance(np.array([630.0, 544.0, 480.0]), 5e-4, share)
    assert made == pytest.approx([red, green, blue], abs=6e-3)


def test_only_the_surface_of_few_bubbles_counts():
    # Twice the radius and twice the share are the same area across light.
    small, large = (bubbly_ice_reflectance(VISIBLE_NM, size * 1e-4, size * 1e-5) for size in (1.0, 2.0))
    assert small == pytest.approx(large, rel=1e-4)
    assert bubbly_ice_reflectance(VISIBLE_NM, 1e-9, 0.1) == pytest.approx(np.ones(61), abs=2e-3)


def test_snow_of_no_grain_is_white():
    assert snow_reflectance(VISIBLE_NM, 1e-12) == pytest.approx(np.ones(61), abs=1e-4)


@pytest.mark.parametrize("name", MATERIALS)
def test_materials_reflect_no_more_than_all_and_state_their_source(name):
    material = MATERIALS[name]
    assert (np.abs(material.reflectance(VISIBLE_NM) - 0.5) < 0.5).all()
    assert list(material.wavelength_nm) == sorted(material.wavelength_nm)
    assert any(word in material.source for word in ("guess", "assumed"))


def test_dark_matter_of_europa_is_brown():
    dark, plains = MATERIALS["EUROPA_DARK"], MATERIALS["EUROPA_PLAINS"]
    assert dark.reflectance(560.0) == pytest.approx(0.17, rel=0.05)  # Helfenstein et al. 1998
    redness = [material.reflectance(620.0) / material.reflectance(460.0) for material in (dark, plains)]
    assert redness[0] > 1.5 * redness[1]

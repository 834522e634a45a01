"""The bands R, G, B of a pair: what a spectrum becomes in them."""

import numpy as np
import pytest
from icymoon.physics.light.bands import (
    VISIBLE_NM,
    band_reflectances,
    band_shares,
    bubbly_ice_bands,
    material_bands,
    snow_bands,
)
from icymoon.physics.light.photons import planck_radiance
from icymoon.physics.light.sunlight import BANDS_M, SUN_TEMPERATURE_K
from icymoon.physics.surfaces.spectra import MATERIALS
from icymoon.support.arrays import Array


def sunlit(response: Array, reflectance: Array) -> float:
    """Photons of sunlight that a surface sends into a response, by a sum over wavelengths."""
    wavelength = VISIBLE_NM * 1e-9
    return float((planck_radiance(wavelength, SUN_TEMPERATURE_K) * wavelength * response * reflectance).sum())


def test_bands_share_each_wavelength_and_have_their_own():
    shares = band_shares(np.linspace(300e-9, 1100e-9, 101))
    assert shares.sum(axis=0) == pytest.approx(np.ones(101))
    assert (shares >= 0).all()
    assert band_shares(np.array(BANDS_M)) == pytest.approx(np.eye(3))


def test_a_grey_surface_is_as_grey_in_all_bands():
    assert band_reflectances(lambda nm: np.full(nm.shape, 0.6)) == pytest.approx([0.6] * 3)


def test_lines_between_the_bands_are_found_again():
    wanted = np.array([0.3, 0.2, 0.1])
    assert band_reflectances(lambda nm: wanted @ band_shares(nm * 1e-9)) == pytest.approx(wanted)


@pytest.mark.parametrize("name", MATERIALS)
def test_a_camera_whose_response_is_a_sum_of_bands_sees_the_spectrum(name):
    shares = band_shares(VISIBLE_NM * 1e-9)
    response = np.array([0.2, 0.9, 0.4]) @ shares
    seen = sunlit(response, np.array(material_bands(name)) @ shares)
    assert seen == pytest.approx(sunlit(response, MATERIALS[name].reflectance(VISIBLE_NM)), rel=1e-9)


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize(("centre_nm", "half_nm"), [(630, 43), (544, 41), (480, 46)])
def test_filters_of_a_camera_see_a_material_within_5_percent(name, centre_nm, half_nm):
    response = 2.0 ** -(((VISIBLE_NM - centre_nm) / half_nm) ** 2)
    seen = sunlit(response, np.array(material_bands(name)) @ band_shares(VISIBLE_NM * 1e-9))
    assert seen == pytest.approx(sunlit(response, MATERIALS[name].reflectance(VISIBLE_NM)), rel=0.05)


def test_snow_becomes_blue_with_the_size_of_its_grains():
    red, green, blue = snow_bands(2e-3)
    assert red < green < blue < 1
    assert snow_bands(25e-6) == pytest.approx([1, 1, 1], abs=0.02)


@pytest.mark.parametrize("share", [1e-9, 1e-6, 1e-4, 1e-3, 0.5])
@pytest.mark.parametrize("radius_m", [1e-6, 5e-4, 1e-2, 0.1])
def test_no_band_of_bubbly_ice_is_below_0_or_above_1(radius_m, share):
    red, green, blue = bubbly_ice_bands(radius_m, share)
    assert 0.0 <= min(red, green, blue) <= max(red, green, blue) <= 1.0
    assert red <= green <= blue or green == 0.0

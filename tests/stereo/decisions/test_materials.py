"""Albedo and salts as a lander finds them, against ground by the laws of Lambert and of mixture by area."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pairs
import pytest
from icymoon.physics.light.bands import material_bands
from icymoon.physics.light.ground_colours import ice_and_salt_bands
from icymoon.physics.light.sunlight import sun_colour
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import check, defaults, merged
from icymoon.stereo.decisions.dem import Dem, Grid
from icymoon.stereo.decisions.footprints import fit_planes
from icymoon.stereo.decisions.materials import (
    Materials,
    compute_white_radiance,
    make_true_materials,
    measure_materials,
    refuse_lamps,
)
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.safe_sites import SAFE, judge_sites, measure_layers
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.exr import Light
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

IRRADIANCE = 50.0
#: Unit vector toward a Sun in the east, 40 degrees high, and the slope of the ground eastward and northward.
SUN, EAST, NORTH = np.array([np.cos(np.radians(40.0)), 0.0, np.sin(np.radians(40.0))]), -0.2, 0.1
#: Cosine of incidence: the plane's normal (0.2, -0.1, 1) / 1.05^0.5 on the Sun.
COSINE = (0.2 * SUN[0] + SUN[2]) / np.sqrt(1.05)
SHARES = np.array([0.0, 0.3, 1.0, 0.6])
QUIET = {"shot_noise": False, "read_noise_e": 0.0, "dark_current_e_s": 0.0, "bits": 14}
SALTY = {"surface": {"albedo": 0.7, "salt": "IRRADIATED_SALT", "ice_colour": "EUROPA_PLAINS"}}
CELL, ROWS, COLUMNS = 0.02, 36, 64


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    return read_pair(pairs.write_pair(tmp_path_factory.mktemp("materials") / "pair"))


def found(pair, *parts, share=SHARES, dim=1.0):
    """Measured in cells of 4 x 4 pixels of an image whose quarters, side by side, are ice with these shares of salt."""
    settings = merged(pair.settings, {"sensor": QUIET}, SALTY, *parts)
    height, width = pair.camera.height_px, pair.camera.width_px
    ice, salt = (np.array(each) for each in ice_and_salt_bands(settings.surface, settings.hapke))
    mixed = np.repeat((1 - share)[:, None] * ice + share[:, None] * salt, width // 4, axis=0)
    radiance = mixed * sun_colour(settings.light.sun_temperature_k) * IRRADIANCE * COSINE / np.pi * dim
    light = Light(np.broadcast_to(radiance, (height, width, 3)).astype(np.float32), {})
    images = develop(pair, light, light, settings)
    row, column = (each.ravel() for each in np.mgrid[:height, :width])
    east, north = (column + 0.5) * CELL / 4, ROWS * CELL - (row + 0.5) * CELL / 4
    position = np.stack([east, north, EAST * east + NORTH * north], axis=1)
    grid = Grid(CELL, ROWS, COLUMNS, 0.0, ROWS * CELL)
    x, y = grid.centres()
    planes = fit_planes(EAST * x + NORTH * y, CELL, 0.1)
    white = compute_white_radiance(images, settings)
    made = measure_materials(white, position, np.arange(len(position)), grid, planes, SUN, IRRADIANCE, settings)
    middles = slice(4, -4), np.arange(4) * COLUMNS // 4 + COLUMNS // 8  # away from edges, which demosaicing blurs
    return made.albedo[middles], made.salt[middles], mixed.mean(axis=1)[:: width // 4]


@pytest.mark.parametrize("colour", ["MONO", "BAYER"])
@pytest.mark.parametrize("balance", ["SUN", "NONE"])
def test_the_albedo_of_grey_lambert_ground_is_found_on_a_slope(pair, colour, balance):
    """Bands of grey ice and salt are one, so neither the filters nor the balance matter."""
    grey = {"ice_colour": "GREY", "salt": "OWN", "salt_red": 0.5, "salt_green": 0.5, "salt_blue": 0.5}
    camera = {"colour": colour, "white_balance": balance, "black_level": 0.02}
    albedo, salt, true = found(pair, {"sensor": camera, "surface": grey})
    np.testing.assert_allclose(albedo, np.broadcast_to(true, albedo.shape), rtol=0.002)  # rounding of 14 bits, times 10
    assert np.isnan(salt).all()  # there is no colour by which to tell them apart


def test_the_share_of_salt_is_found_by_its_colour(pair):
    _, salt, _ = found(pair, {"sensor": {"colour": "BAYER"}})
    np.testing.assert_allclose(salt, np.broadcast_to(SHARES, salt.shape), atol=0.005)  # of 14 bits, over the angle 0.1


def test_shading_is_no_salt(pair):
    """A third of the light is the same mixture."""
    _, salt, _ = found(pair, {"sensor": {"colour": "BAYER"}}, dim=1 / 3)
    np.testing.assert_allclose(salt, np.broadcast_to(SHARES, salt.shape), atol=0.005)
    uneven = np.repeat([1.0, 0.3], 128)[:, None]
    _, even, _ = found(pair, {"sensor": {"colour": "BAYER"}}, share=np.full(4, 0.4), dim=uneven)
    np.testing.assert_allclose(even, 0.4, atol=0.015)  # three times less light in as many numbers


def test_a_monochrome_camera_tells_no_salt_and_white_salts_look_like_ice(pair):
    assert np.isnan(found(pair, {"sensor": {"colour": "MONO"}})[1]).all()
    white = {"surface": {"salt": "SULPHATE_SALTS", "ice_colour": "GREY"}, "sensor": {"colour": "BAYER"}}
    assert np.isnan(found(pair, white)[1]).all()


def test_saturated_pixels_are_not_known(pair):
    bright = {"sensor": {"colour": "BAYER", "auto_exposure": False, "exposure_s": 10.0}}
    albedo, salt, _ = found(pair, bright)
    assert np.isnan(albedo).all()
    assert np.isnan(salt).all()


def test_ice_and_salt_are_those_of_the_settings():
    surface = merged(defaults(), SALTY).surface
    ice, salt = ice_and_salt_bands(surface, defaults().hapke)
    assert np.mean(ice) == pytest.approx(0.7)
    assert salt == pytest.approx(material_bands("IRRADIATED_SALT"))
    bubbly = surface | {"bubble_share": 0.01, "salt": "OWN", "salt_red": 1.0, "salt_green": 0.5, "salt_blue": 0.25}
    ice, salt = ice_and_salt_bands(bubbly, defaults().hapke)
    assert ice[2] > ice[0]
    assert np.array(salt) / ice == pytest.approx([1.0, 0.5, 0.25])


SIZE = 60


def sites(**rules):
    """Level ground in light whose west is dark, whose east is bright, and whose north is salt."""
    height = np.zeros((SIZE, SIZE))
    dem = Dem(Grid(CELL, SIZE, SIZE, 0.0, 0.0), height, np.ones(height.shape, int))
    row, column = np.mgrid[:SIZE, :SIZE]
    maps = np.stack([*[np.select([column < 20, column < 40], [0.2, 0.5], 0.9)] * 3, row < 30.0]).astype(float)
    maps[:, 40:, 20:40] = np.nan
    rule = replace(read_rules().site, **rules)
    made = measure_layers(
        dem, height + 90.0, height + 1.0, rule, materials=make_true_materials(maps) if rules else None
    )
    return judge_sites(made, rule).failed


def test_rules_of_albedo_and_salts_fail_where_they_are_broken():
    dark, bright, little = 7, 8, 9  # in the order of the rules
    assert sites()[30, 10] == SAFE
    least, most, salty = sites(least_albedo=0.4), sites(most_albedo=0.7), sites(salt_share=0.6)
    assert (least[15, 10], least[15, 30], least[15, 50]) == (dark, SAFE, SAFE)
    assert (most[15, 10], most[15, 30], most[15, 50]) == (SAFE, SAFE, bright)
    assert (salty[15, 50], salty[45, 50]) == (SAFE, little)
    assert least[50, 30] == dark  # it is not known there
    # On the border half of the disc is dark: the mean of 0.2 and 0.5 is below 0.4.
    assert sites(least_albedo=0.3)[15, 20] == SAFE
    assert least[15, 20] == dark


def test_a_rule_without_materials_is_failed():
    height = np.zeros((SIZE, SIZE))
    dem = Dem(Grid(CELL, SIZE, SIZE, 0.0, 0.0), height, np.ones(height.shape, int))
    rule = replace(read_rules().site, salt_share=0.1)
    unknown = Materials(*[np.full(height.shape, np.nan)] * 2)
    for materials in (None, unknown):
        made = judge_sites(measure_layers(dem, height + 90.0, height + 1.0, rule, materials=materials), rule)
        assert not made.safe.any()
        assert np.isneginf(made.margin).all()


def test_light_of_lamps_gives_no_albedo_unless_it_is_switched_off():
    lit = merged(defaults(), check({"light": {"lamps": [{"power_w": 5.0}]}}, "test"))
    with pytest.raises(IcyMoonError, match="lamps shine too"):
        refuse_lamps(Path("pair"), lit)
    refuse_lamps(Path("pair"), merged(lit, {"light": {"lamp_scales": "0"}}))
    refuse_lamps(Path("pair"), defaults())

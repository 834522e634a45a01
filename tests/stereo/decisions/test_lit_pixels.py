"""The study of pixels that a lander takes for lit: its rules on images of known light, and its truth."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.benchmarks.stereo import lit_pixels as study
from icymoon.physics.light.directions import direction_toward
from icymoon.stereo.design.made_workspaces import draw_recipes
from icymoon.stereo.learning.grounds import Variety, build_ground, release_ground
from icymoon.stereo.learning.radiance import Lighting
from icymoon.stereo.measure.by_pixel_class import MATERIAL
from stand_ins import stand_in


def look_at(levels):
    """A pair whose left image has these grey levels, all of ground."""
    image = np.array(levels, np.uint8)
    material = {MATERIAL.key: np.zeros(image.shape, np.int8)}
    facts = {"settings": study.SMALL}
    return stand_in(left=image, known=np.ones(image.shape, bool), classes=material, facts=facts)


@pytest.mark.parametrize(("dark", "fooled"), [(3, ()), (7, ("median",))])
def test_the_median_takes_shade_for_light_where_most_ground_is_in_shade(dark, fooled):
    """Shade has a twentieth of the level of light."""
    levels = np.full((10, 10), 200)
    levels[:dark] = 10
    for name, find in study.FINDERS.items():
        lit = find(look_at(levels))
        assert lit[dark:].all()
        assert (lit[:dark] == (name in fooled)).all()


def test_even_ground_is_lit():
    levels = np.full((10, 10), 100)
    levels[::2] = 90
    assert all(find(look_at(levels)).all() for find in study.FINDERS.values())


def test_shares_are_counted_by_hand():
    lit, sunlit = np.array([True, True, False, False, False]), np.array([True, False, False, False, True])
    assert study.count(lit, sunlit) == pytest.approx((2 / 5, 1 / 3, 1 / 2))
    assert np.isnan(study.count(lit, np.ones(5, bool))[1])
    assert np.isnan(study.count(lit, np.zeros(5, bool))[2])


def test_a_sun_overhead_reaches_all_bare_ground_and_one_below_it_nothing():
    recipe = next(each for each in draw_recipes(0, "ground", 20, Variety(("smooth",))) if each.rocks is None)
    ground = build_ground(recipe)
    try:
        for elevation, share in ((90.0, 1.0), (-30.0, 0.0)):
            light = Lighting(direction_toward(40.0, elevation), 50.0, 0.001, 0.0, np.ones(32))
            assert study.find_sunlit(ground, light).mean() == share
    finally:
        release_ground(ground)

"""Which disparities a rig can meet: against rays to level and to rough ground."""

from types import SimpleNamespace

import ground_rays
import numpy as np
import pytest
from icymoon.physics.camera.nearest_ground import greatest_disparity_px
from icymoon.physics.camera.search_range import disparity_range_px, flat_disparities_px
from icymoon.physics.rig.focal_length import focal_px
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset, preset_names

RIGS = preset_names("rigs")
LEVEL = SimpleNamespace(heights=lambda x, y: np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y))))


def rig_of(name, **changes):
    return merged(defaults(), load_preset(name), {"rig": changes}).rig


@pytest.mark.parametrize("name", RIGS)
def test_level_ground_has_exactly_the_disparities_of_its_rows(name):
    rig = rig_of(name, heading_deg=30.0)
    top, bottom = flat_disparities_px(rig)
    rows = 16
    seen = ground_rays.disparities(LEVEL, rig, 2, rows)[:, 1]
    step = (bottom - seen[-1]) * 2  # of a row; rays are in the middle of rows
    np.testing.assert_allclose(np.diff(seen[rows // 2:]), step, rtol=1e-3)
    if top > 5:  # beyond, the ground is farther than rays go
        assert seen[0] - step / 2 == pytest.approx(top, rel=1e-3)


def test_the_range_grows_with_relief_and_is_none_above_the_horizon():
    rig = rig_of("rigs/guiss")
    flat, high = (disparity_range_px(rig, relief)[1] for relief in (0.0, 0.5))
    assert high == pytest.approx(2 * flat)
    assert disparity_range_px(rig_of("rigs/guiss", pitch_deg=-60.0)) is None


@pytest.mark.heavy
@pytest.mark.parametrize("scene", ["scenes/europa_rough_ice", "scenes/europa_penitentes"])
@pytest.mark.parametrize("name", RIGS)
def test_no_more_than_one_per_cent_of_described_ground_is_nearer(name, scene):
    scene = merged(defaults(), load_preset(scene), load_preset(name))
    ground = make_terrain(scene, int(scene.dataset.seed))
    for heading in (0.0, 90.0):
        settings = merged(scene, {"rig": {"heading_deg": heading}})
        seen = ground_rays.disparities(ground, settings.rig)
        seen = seen[np.isfinite(seen)]
        assert np.mean(seen > greatest_disparity_px(settings, focal_px(settings.rig))) <= 0.01


@pytest.mark.heavy
@pytest.mark.parametrize("name", RIGS)
def test_no_more_than_one_per_cent_of_rough_ice_is_outside(name):
    scene = merged(defaults(), load_preset("scenes/europa_rough_ice"))
    ground = make_terrain(scene, int(scene.dataset.seed))
    for k, (x, y) in enumerate([(-3.0, 2.0), (4.0, 5.0)]):
        rig = rig_of(name, heading_deg=90.0 * k, x_m=x, y_m=y)
        low, high = disparity_range_px(rig)
        seen = ground_rays.disparities(ground, rig)
        seen = seen[np.isfinite(seen)]
        assert seen.size > 100
        assert np.mean((seen < low) | (seen > high)) <= 0.01

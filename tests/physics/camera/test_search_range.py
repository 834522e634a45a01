"""Which disparities a rig can meet: against rays to level and to rough ground."""

from types import SimpleNamespace
from typing import Any

import ground_rays
import numpy as np
import pytest
from icymoon.physics.camera import nearest_ground
from icymoon.physics.camera.nearest_ground import find_greatest_disparity_px, make_ground_name_key
from icymoon.physics.camera.search_range import disparity_range_px, level_ground_disparities_px
from icymoon.physics.rig.focal_length import focal_px
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset, preset_names
from icymoon.settings.table import TOPICS

RIGS = preset_names("rigs")
LEVEL = SimpleNamespace(heights=lambda x, y: np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y))))


def rig_of(name, **changes):
    return merged(defaults(), load_preset(name), {"rig": changes}).rig


@pytest.mark.parametrize("name", RIGS)
def test_level_ground_has_exactly_the_disparities_of_its_rows(name):
    rig = rig_of(name, heading_deg=30.0)
    top, bottom = level_ground_disparities_px(rig)
    rows = 16
    seen = ground_rays.disparities(LEVEL, rig, 2, rows)[:, 1]
    step = (bottom - seen[-1]) * 2  # of a row; rays are in the middle of rows
    np.testing.assert_allclose(np.diff(seen[rows // 2 :]), step, rtol=1e-3)
    if top > 5:  # beyond, the ground is farther than rays go
        assert seen[0] - step / 2 == pytest.approx(top, rel=1e-3)


def test_the_range_grows_with_relief_and_is_none_above_the_horizon():
    rig = rig_of("rigs/guiss")
    flat, high = (disparity_range_px(rig, relief)[1] for relief in (0.0, 0.5))
    assert high == pytest.approx(2 * flat)
    assert disparity_range_px(rig_of("rigs/guiss", pitch_deg=-60.0)) is None


ROCKY: dict[str, dict[str, Any]] = {
    "mesh": {"kind": "GRADED"},
    "terrain": {"size_m": 6.0},
    "rocks": {"coverage": 0.2, "smallest_m": 0.2, "largest_m": 0.8, "beyond_px": 8.0, "clear_radius_m": 0.0},
}


def test_the_rocks_beyond_the_patch_are_those_of_the_pairs_own_rig():
    """A camera that stands higher sees fewer of them large, whatever pair comes before."""
    low, high = (merged(defaults(), ROCKY, {"rig": {"height_m": height}}) for height in (1.0, 3.0))
    found = {}
    for order in ((low, high), (high, low)):
        nearest_ground._last_ground.clear()
        found[order[0].rig.height_m] = [len(nearest_ground._get_ground(settings).rocks.reach_m) for settings in order]
    assert found[1.0] == found[3.0][::-1]
    assert len(set(found[1.0])) == 2


@pytest.mark.parametrize(
    "part",
    [
        {"surface": {"grain_amplitude_m": 0.01}},
        {"light": {"body": "ENCELADUS"}},
        {"rig": {"x_m": 1.5, "heading_deg": 40.0}},
        {"dataset": {"headings": 3}},
    ],
)
def test_the_ground_is_the_same_under_another_light_surface_or_site(part):
    settings = merged(defaults(), ROCKY)
    assert make_ground_name_key(settings) == make_ground_name_key(merged(settings, part))


def test_all_else_that_shapes_it_makes_another_ground():
    """A setting that builds other ground has a topic that names it; the path of a scoop does not move rocks."""
    settings = merged(defaults(), ROCKY)
    assert make_ground_name_key(settings) != make_ground_name_key(merged(settings, {"dataset": {"seed": 5}}))
    shaping = {
        topic.key
        for topic in TOPICS.values()
        for each in topic.settings
        if each.effect == "geometry" and not each.key.startswith("frost_")  # a mark of vertices that stay in place
    }
    assert not (shaping - {"dataset", "excavation"}) & nearest_ground._TOPICS_NOT_OF_GROUND


@pytest.mark.heavy
@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("scene", ["scenes/europa_rough_ice", "scenes/europa_penitentes"])
@pytest.mark.parametrize("name", RIGS)
def test_no_more_than_one_per_cent_of_described_ground_is_nearer(name, scene):
    scene = merged(defaults(), load_preset(scene), load_preset(name))
    ground = make_terrain(scene, int(scene.dataset.seed))
    for heading in (0.0, 90.0):
        settings = merged(scene, {"rig": {"heading_deg": heading}})
        seen = ground_rays.disparities(ground, settings.rig)
        seen = seen[np.isfinite(seen)]
        assert np.mean(seen > find_greatest_disparity_px(settings, focal_px(settings.rig))) <= 0.01


@pytest.mark.heavy
@pytest.mark.ci_takes(1)
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

"""Training pairs made by rays: their disparity by rays of the other eye, their light by formulas, and their splits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from icymoon.physics.light.directions import camera_axes, direction_toward
from icymoon.physics.surfaces.photometry import lunar_lambert
from icymoon.physics.surfaces.snow import snow_law
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.rays.embree import load_library
from icymoon.rays.engine import open_tracer
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.rays.stereo_truth import Eye
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.learning import grounds, made_pairs
from icymoon.stereo.learning.grounds import Ground, build_ground, draw_recipe, draw_sun_elevation_deg
from icymoon.stereo.learning.made_pairs import MadePairs, draw_view
from icymoon.stereo.learning.radiance import Lighting, PointLamp, compute_radiance, measure_indirect
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.skipif(load_library() is None, reason="there is no Embree; pip install embreex")
CROP = (64, 48)
SUN = direction_toward(100.0, 25.0)


@pytest.fixture(scope="module")
def coarse():
    """Grounds with few vertices."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grounds, "_SPACING", 0.1)
        grounds._make_rings.cache_clear()
        yield
    grounds._make_rings.cache_clear()


def flat_pattern(pattern):
    return replace(pattern, albedo=0 * pattern.albedo, slope=0 * pattern.slope)


def make_flat_ground(wall_m=0.0, **changes):
    """A plane at height 0, with a wall of this height in the south, of an even Lambert surface of albedo 0.6."""
    corners = [[-1e3, -1e3, 0], [1e3, -1e3, 0], [1e3, 1e3, 0], [-1e3, 1e3, 0]]
    quads = [corners] + ([[[-1e3, -5, 0], [1e3, -5, 0], [1e3, -5, wall_m], [-1e3, -5, wall_m]]] if wall_m else [])
    placed = [
        Placed(
            Shape(
                np.array(each, np.float32),
                np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
                np.zeros(2, bool),
                np.full(2, grounds.GROUND, np.uint8),
            ),
            np.eye(4)[None],
            np.array([k]),
        )
        for k, each in enumerate(quads)
    ]
    recipe = draw_recipe(0, "train", 0)
    named = {"law": lambda albedo: lunar_lambert(albedo, 0.0), "albedo": 0.6, "pattern": flat_pattern(recipe.pattern)}
    world = World(placed)
    return Ground(
        replace(recipe, **(named | changes)), world, open_tracer(world), 0.0, grounds.make_shading_tables(world)
    )


def light(sky=0.0):
    return Lighting(SUN, 50.0, 0.0, sky, np.full(4, 0.5))


def see(ground, lighting=None, indirect=0.0):
    """Rays down from 2 m, their points, and their radiance."""
    direction = np.random.default_rng(1).normal([0.0, 0.8, -1.0], 0.4, (64, 3))
    origin = np.array([0.0, 0.0, 2.0])
    random = np.random.default_rng(2)
    return direction, compute_radiance(
        ground, lighting or light(), origin, direction, 1e-3, np.full(len(direction), indirect), random
    )


def test_disparity_leads_to_the_same_point_in_the_right_eye(coarse):
    ground = build_ground(draw_recipe(3, "train", 1))
    random = np.random.default_rng(5)
    view = draw_view(ground, "train", CROP, random)
    depth, hidden = made_pairs.trace_truth(ground, view)
    disparity = view.left.focal_px * view.baseline_m / depth
    row, column = np.indices(depth.shape)
    other = column - disparity
    asked = np.isfinite(depth) & ~hidden & (other > 0)
    assert asked.mean() > 0.2
    own = np.stack(
        [
            (other[asked] + 0.5 - view.left.cx_px) / view.left.focal_px,
            (row[asked] + 0.5 - view.left.cy_px) / view.left.focal_px,
            np.ones(asked.sum()),
        ],
        axis=1,
    )
    along = ground.tracer.intersect(view.right.position, own @ view.left.axes.T, 1e-3, 1e4).along
    error = np.abs(view.left.focal_px * view.baseline_m / along - disparity[asked])
    # Rays that graze an edge may pass it on the other side: a point that is not hidden is at most MIN_GAP_PX behind.
    assert np.quantile(error, 0.98) < 0.01
    assert error.max() < 0.26


def test_disparity_of_a_plane_is_its_formula():
    ground = make_flat_ground()
    axes, height, pitch = camera_axes(30.0, 20.0), 1.7, np.radians(20.0)
    left = Eye(64, 48, 90.0, 30.0, 20.0, axes, np.array([1.0, 2.0, height]))
    right = replace(left, position=left.position + 0.3 * axes[:, 0])
    view = made_pairs.View(left, right, right, 0.3, light(), made_pairs.Faults(np.zeros(3), 0.0, 1.0))
    depth, hidden = made_pairs.trace_truth(ground, view)
    down = (np.arange(48) + 0.5 - 20.0) / 90.0
    expected = 90.0 * 0.3 * (np.sin(pitch) + down * np.cos(pitch)) / height
    seen = np.broadcast_to(expected[:, None] > 0.05, depth.shape)
    assert np.abs(90.0 * 0.3 / depth - expected[:, None])[seen].max() < 0.01
    assert not hidden.any()


@pytest.mark.parametrize("law", [lambda a: lunar_lambert(a, 0.0), lambda a: lunar_lambert(a, 0.6), snow_law])
def test_radiance_is_that_of_the_law(law):
    ground = make_flat_ground(law=law)
    direction, radiance = see(ground)
    back = -direction / np.linalg.norm(direction, axis=1, keepdims=True)
    azimuth = np.arctan2(back[:, 0], back[:, 1]) - np.radians(100.0)
    expected = 50.0 * law(0.6)(np.full(len(back), np.radians(65.0)), np.arccos(back[:, 2]), azimuth)
    down = direction[:, 2] < -0.1
    assert radiance[down] == pytest.approx(expected[down], rel=1e-4)


def test_a_wall_in_front_of_the_sun_casts_a_shadow_as_long_as_its_height_demands():
    ground = make_flat_ground(wall_m=20.0)
    lighting = replace(light(), sun=direction_toward(180.0, 45.0))
    place = np.array([[0.0, 14.0, 0], [0.0, 16.0, 0]])
    origin = np.array([0.0, 0.0, 30.0])
    radiance = compute_radiance(ground, lighting, origin, place - origin, 1e-3, np.zeros(2), np.random.default_rng(0))
    assert radiance == pytest.approx([0.0, 50.0 * 0.6 / np.pi * np.sqrt(0.5)], rel=1e-4)


def test_level_ground_gets_the_light_of_the_whole_sky_and_none_of_itself():
    direction = np.array([[0.1, 0.2, -1.0], [0.0, 0.1, -1.0]])
    found = measure_indirect(
        make_flat_ground(), light(sky=0.1), np.array([0.0, 0, 2.0]), direction, 16, np.random.default_rng(0)
    )
    assert found == pytest.approx(5.0, rel=1e-6)


def test_ground_before_an_endless_lit_wall_gets_half_of_its_light():
    """The Sun on the horizon lights the wall alone. Wall and ground fill half of each other's sky."""
    lighting = replace(light(), sun=direction_toward(0.0, 0.0))
    foot = np.array([[0.0, -4.9, -2.0]])
    origin, random = np.array([0.0, 0, 2.0]), np.random.default_rng(0)
    found = measure_indirect(make_flat_ground(wall_m=1e3), lighting, origin, foot, 8000, random)
    wall = 0.6 * 50.0 / (1 - (0.6 * 0.5) ** 2)
    # Half of 8000 directions meet the wall: a deviation of 1.1 %.
    assert found[0] == pytest.approx(0.5 * wall, rel=0.03)


def test_a_sample_depends_on_its_number_alone(coarse, monkeypatch):
    monkeypatch.setattr(made_pairs, "CROPS_PER_GROUND", 3)
    pairs = MadePairs("train", 3, CROP)
    whole = list(pairs.list_ground(1))
    again = pairs.make_sample(build_ground(draw_recipe(3, "train", 1)), 5)
    assert all(np.array_equal(whole[2][key], again[key]) for key in again)
    assert [each["pair"] for each in whole] == [f"train-3-{k}" for k in (3, 4, 5)]
    assert not np.array_equal(whole[0]["left"], whole[1]["left"])
    assert whole[0]["left"].shape == (1, 48, 64)
    assert 0 <= min(each["left"].min() for each in whole) < max(each["right"].max() for each in whole) <= 1


def test_training_shows_nothing_that_is_held_out():
    hidden = {*grounds.HELD_OUT_LANDFORMS, *grounds.HELD_OUT_BODY}
    assert not hidden & set(grounds.TERRAINS)
    drawn = [draw_recipe(0, split, k) for split in ("train", "ground") for k in range(40)]
    assert all(each.terrain not in hidden and each.rocks != "rocks/block_field" for each in drawn)
    assert {draw_recipe(0, "landform", k).terrain for k in range(20)} == set(grounds.HELD_OUT_LANDFORMS)
    assert {draw_recipe(0, "body", k).terrain for k in range(40)} == set(grounds.HELD_OUT_BODY)
    low, high = grounds.HELD_OUT_SUN_DEG
    random = np.random.default_rng(0)
    training = np.array([draw_sun_elevation_deg("train", random) for _ in range(300)])
    assert not ((training > low) & (training < high)).any()
    assert 3 <= training.min() < 5
    assert 50 < training.max() <= 65
    assert low <= draw_sun_elevation_deg("sun", random) <= high


def test_made_grounds_keep_the_snow_on_which_the_weights_were_judged():
    assert load_preset("terrains/settled_snow").mantle.feather_m > 0
    drawn = [draw_recipe(0, "body", k) for k in range(40)]
    assert any(each.terrain == "settled_snow" for each in drawn)
    assert all(each.mantle.feather_m == 0 for recipe in drawn for each in (recipe.bare, recipe.rocks) if each)


@pytest.mark.parametrize(
    ("wrong", "told"), [({"split": "tset"}, "no split 'tset'"), ({"crop_px": (100, 64)}, "multiples of 8")]
)
def test_wrong_requests_name_a_fix(wrong, told):
    with pytest.raises(IcyMoonError, match=told):
        MadePairs(**wrong)


def test_the_ground_may_be_of_the_users_own_settings():
    blades = merged(defaults(), load_preset("scenes/europa_penitentes"))
    own = grounds.Variety(own=blades)
    recipe = draw_recipe(0, "train", 3, own)
    assert recipe.terrain == grounds.OWN
    assert recipe.bare is blades
    assert recipe.rocks is None
    rocky = merged(blades, {"rocks": {"coverage": 0.1}})
    assert draw_recipe(0, "train", 3, grounds.Variety(own=rocky)).rocks is rocky
    assert (recipe.place_m, recipe.law_name) == ((usual := draw_recipe(0, "train", 3)).place_m, usual.law_name)
    names = {MadePairs(variety=each).name for each in (own, grounds.FULL, grounds.Variety(own=rocky))}
    assert len(names) == 3  # no file of one is taken for another's


def test_own_ground_stands_where_the_terrain_of_the_settings_does():
    blades = merged(defaults(), load_preset("terrains/penitentes"))
    ground = build_ground(draw_recipe(0, "train", 3, grounds.Variety(own=blades)))
    try:
        seed = int(grounds.make_split_generator(0, "train", 3, 1).integers(2**31 - 1))
        x, y = (np.array(ground.recipe.place_m) + 0.7)[:, None]  # beyond the first ring
        above = np.array([[x[0], y[0], 30.0]])
        met = ground.tracer.intersect(above, np.array([[0.0, 0.0, -1.0]]), 0.0, 100.0)
        height = make_terrain(blades, seed).heights(x, y, 0.01)[0]
        assert 30.0 - met.along[0] == pytest.approx(height, abs=0.02)  # triangles of 1.2 cm
    finally:
        grounds.release_ground(ground)


def test_own_ground_has_the_skirts_of_its_rocks(monkeypatch):
    monkeypatch.setattr(grounds, "_SPACING", 0.04)  # 8 cm at 2 m, and skirts are 11 cm wide and more
    grounds._make_rings.cache_clear()
    own = merged(defaults(), {"rocks": {"coverage": 0.2, "smallest_m": 0.4, "skirt": 0.4}})
    recipe = replace(draw_recipe(0, "train", 3, grounds.Variety(own=own)), shapes=0)
    ground = build_ground(recipe)
    bare = build_ground(replace(recipe, rocks=merged(own, {"rocks": {"skirt": 0.0}})))
    try:
        vertices, level = (each.world.placed[0].shape.vertices for each in (ground, bare))
        raised = (vertices - level)[:, 2]
        assert (raised >= 0.0).all()
        assert np.array_equal(vertices[:, :2], level[:, :2])
        rocks = [np.concatenate([each.places for each in made.world.placed[1:]]) for made in (ground, bare)]
        assert np.array_equal(rocks[0], rocks[1])
        away = np.hypot(*(vertices[:, None, :2] - rocks[0][None, :, :2, 3]).transpose(2, 0, 1)).min(axis=1)
        near = np.hypot(*(vertices[:, :2] - recipe.place_m).T) < 2.0
        assert (near & (away < 0.15)).any()
        # A rock that is nearly buried has hardly a skirt.
        assert (raised[near & (away < 0.15)] > 0.02).mean() > 0.9
        assert (raised[away > 3.0] == 0.0).all()
    finally:
        grounds._make_rings.cache_clear()
        grounds.release_ground(ground)
        grounds.release_ground(bare)


NIGHT = Lighting(SUN, 0.0, 0.0, 0.3, np.full(4, 0.5))
LAMP = PointLamp(np.array([0.5, 0.2, 1.5]), 7.0)


def find_on_plane(direction):
    """The points where rays down from 2 m meet the plane."""
    return np.array([0.0, 0.0, 2.0]) + direction * (2.0 / -direction[:, 2:])


def test_a_lamp_lights_a_plane_by_the_inverse_square_and_lambert():
    """Shadow rays start 2e-4 of the ray above the plane, so distances err by 1e-3 and their squares by 2e-3."""
    direction, found = see(make_flat_ground(), replace(NIGHT, lamp=LAMP))
    down = direction[:, 2] < -0.2
    way = LAMP.position_m - find_on_plane(direction[down])
    distance = np.linalg.norm(way, axis=1)
    assert found[down] == pytest.approx(0.6 / np.pi * 7.0 / distance**2 * way[:, 2] / distance, rel=4e-3)


def test_a_night_without_a_lamp_is_dark_and_lights_add_up():
    ground = make_flat_ground()
    assert not see(ground, NIGHT)[1].any()
    both, day, night = (
        see(ground, each)[1] for each in (replace(light(), lamp=LAMP), light(), replace(NIGHT, lamp=LAMP))
    )
    assert both == pytest.approx(day + night, rel=1e-12)


def test_the_shadow_of_a_wall_is_at_the_side_away_from_the_lamp():
    """The wall of 1 m in the south hides what lies beyond it and below the line from the lamp over its edge."""
    lamp = PointLamp(np.array([0.0, 0.0, 2.0]), 7.0)
    ground, origin = make_flat_ground(wall_m=1.0), np.array([0.0, -7.0, 8.0])
    y = np.linspace(-14.0, -1.0, 53)
    direction = np.stack([np.full(y.size, 0.1), y, np.zeros(y.size)], axis=1) - origin
    seen = compute_radiance(
        ground, replace(NIGHT, lamp=lamp), origin, direction, 1e-3, np.zeros(y.size), np.random.default_rng(0)
    )
    hidden = (y < -5.0) & (y > -10.0)  # the line from 2 m over the edge of 1 m at 5 m ends at 10 m
    clear = (np.abs(y + 5.0) > 1.0) & (np.abs(y + 10.0) > 0.1)  # beside the wall itself and the edge of its shadow
    assert ((seen > 0) == ~hidden)[clear].all()


def test_a_wall_returns_the_light_of_a_lamp_and_a_bare_plane_none():
    direction, count = np.tile([0.0, -2.0, -1.0], (8, 1)), 64
    origin, night = np.array([0.0, 0.0, 2.0]), replace(NIGHT, lamp=LAMP)
    bare, walled = (
        measure_indirect(make_flat_ground(wall), night, origin, direction, count, np.random.default_rng(0))
        for wall in (0.0, 4.0)
    )
    assert not bare.any()
    assert walled.min() > 0

"""The ground as a whole: a function of position and seed, finite wherever it is asked for."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis
from hypothesis import strategies as st
from icymoon.physics.terrain import terrain
from icymoon.physics.terrain.fine_detail import relief_heights_m
from icymoon.physics.terrain.landforms import MAKERS
from icymoon.physics.terrain.roughness import roughness
from icymoon.physics.terrain.terrain import Terrain, advise_on_terrain, make_terrain
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.preset_files import load_preset, preset_names
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array

#: Every landform at once, two layers, snow and a slope.
EVERYTHING = check(
    {
        "terrain": {
            "regional_slope_deg": 5.0,
            "layers": [
                {"basis": "VORONOI_F2", "fractal": "HETERO", "amplitude_m": 0.1},
                {"fractal": "RIDGED", "amplitude_m": 0.1, "warp_m": 0.3},
            ],
        },
        "ridges": {"height_m": 0.5},
        "cracks": {"depth_m": 0.3, "rim_m": 0.05},
        "chaos": {"relief_m": 0.8, "matrix_m": 0.1},
        "craters": {"coverage": 0.2},
        "hollows": {"depth_m": 0.05},
        "penitentes": {"height_m": 0.6},
        "pits": {"depth_m": 0.2},
        "mantle": {"thickness_m": 0.1},
    },
    "test",
)
LANDSCAPES = {"default": {}, "everything": EVERYTHING}


def _settings(*parts: dict) -> Settings:
    return merged(defaults(), *parts)


def _ground(*parts: dict, seed: int = 1) -> Terrain:
    return make_terrain(_settings(*parts), seed)


def _grid(ground: Terrain, n: int = 65, shortest_m: float = 0.0) -> Array:
    axis = np.linspace(-ground.size_m / 2, ground.size_m / 2, n)
    return ground.heights(axis[None, :], axis[:, None], shortest_m)


@pytest.mark.parametrize("landscape", LANDSCAPES)
@pytest.mark.parametrize("shortest", [0.0, 0.04])
def test_heights_are_a_function_of_position(landscape, shortest):
    """Of no other point, of no order, and of no grid: the same bits."""
    ground = _ground(LANDSCAPES[landscape])
    axis = np.linspace(-10, 10, 161)
    grid = ground.heights(axis[None, :], axis[:, None], shortest)
    x, y = np.meshgrid(axis, axis)
    order = np.random.default_rng(2).permutation(x.size)
    scattered = ground.heights(x.ravel()[order], y.ravel()[order], shortest)
    assert np.array_equal(scattered, grid.ravel()[order])
    few = order[:5]
    for k in few:
        assert float(ground.heights(x.ravel()[k], y.ravel()[k], shortest)) == grid.ravel()[k]
    each = ground.heights(x.ravel()[few], y.ravel()[few], np.full(5, shortest))
    assert np.allclose(each, grid.ravel()[few], rtol=0, atol=1e-12)


@pytest.mark.parametrize("landscape", LANDSCAPES)
def test_detail_fades_without_a_step_where_a_mesh_gets_coarser(landscape):
    ground = _ground(LANDSCAPES[landscape])
    x, y = np.random.default_rng(3).uniform(-10, 10, (2, 4000))
    shortest = np.geomspace(0.01, 30.0, 4000)
    here, there = (ground.heights(x, y, s) for s in (shortest, shortest * (1 + 1e-7)))
    # A wave or a landform of a metre fades while the shortest wave grows by half: 1e-7 of that are micrometres.
    assert np.abs(here - there).max() < 2e-5
    flat = ground.heights(x, y, 100.0)
    plane = ground.slope_east * x + ground.slope_north * y
    assert np.ptp(flat - plane) < 1e-9  # nothing but the slope is left


@pytest.mark.parametrize("topic", ["terrain", *MAKERS])
def test_one_seed_moves_everything(topic):
    def only(seed: int) -> Array:
        parts = {key: value for key, value in EVERYTHING.items() if key == topic}
        if topic != "terrain":
            parts["terrain"] = {"rms_slope_deg": 0.0}
        return _grid(_ground(parts, seed=seed))

    assert np.ptp(only(1)) > 0
    assert np.array_equal(only(1), only(1))
    assert not np.array_equal(only(1), only(2))


@pytest.mark.parametrize("topic", ["terrain", *MAKERS])
def test_one_variant_moves_everything(topic):
    """Relief and layers with the topic ``terrain``, each landform by itself with its own topic."""

    def only(variant: int) -> Array:
        parts = {key: value for key, value in EVERYTHING.items() if key == topic}
        return _grid(
            _ground(
                merged(
                    parts,
                    {"terrain": {"variant": variant}},
                    {} if topic == "terrain" else {"terrain": {"rms_slope_deg": 0.0}},
                )
            )
        )

    assert np.array_equal(only(3), only(3))
    assert len({only(variant).tobytes() for variant in (0, 3, 2**31 - 1)}) == 3


def test_a_variant_moves_layers_and_fine_relief_too():
    layers = check({"terrain": {"rms_slope_deg": 0.0, "layers": [{"amplitude_m": 0.2}]}}, "test")
    points = np.random.default_rng(0).uniform(-20, 20, (500, 3))
    for make in (
        lambda variant: _grid(_ground(layers, {"terrain": {"variant": variant}})),
        lambda variant: relief_heights_m(points, _settings({"terrain": {"variant": variant}}), 1),
    ):
        first, other = make(0), make(1)
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.5


def test_variant_0_is_the_ground_of_versions_without_variants():
    """Heights that commit c926394 gave. Data sets of those versions go on with the same ground."""
    x, y = np.array([-9.0, -3.7, 0.0, 2.2, 8.1]), np.array([4.0, -7.3, 0.0, 6.6, -0.5])
    known = {
        "default": [
            0.6392535214305333,
            0.29836391504626586,
            -0.7126776640981908,
            1.0837312130997259,
            0.5341358415555235,
        ],
        "everything": [
            1.9875845154196188,
            0.46763719985507424,
            -0.2730179078225282,
            1.8166696560932998,
            0.6560488184471522,
        ],
    }
    for landscape, heights in known.items():
        ground = _ground(LANDSCAPES[landscape], {"pits": {"depth_m": 0.0}})
        assert np.allclose(ground.heights(x, y), heights, rtol=0, atol=1e-12)
    detail = [0.034927785216915724, -0.41137797994166303, -0.1615126772637722, -0.8241138366359264, 0.03156309846204845]
    assert np.allclose(relief_heights_m(np.stack([x, y, 0.1 * x], axis=1), _settings(), 1), detail, rtol=0, atol=1e-12)


def test_a_landform_more_does_not_move_the_others():
    base, cracked = (_ground({"ridges": {"height_m": 0.5}, "cracks": {"depth_m": depth}}) for depth in (0.0, 0.3))
    x, y = np.random.default_rng(0).uniform(-10, 10, (2, 500))
    assert np.array_equal(base.base.heights(x, y), cracked.base.heights(x, y))
    difference = cracked.heights(x, y) - base.heights(x, y)
    assert np.mean(difference == 0.0) > 0.6  # beside the cracks


def test_flat_and_sloping_ground():
    assert np.all(_grid(_ground({"terrain": {"rms_slope_deg": 0.0}})) == 0.0)
    tilted = _ground(
        {"terrain": {"rms_slope_deg": 0.0, "regional_slope_deg": 10.0, "regional_slope_azimuth_deg": 90.0}}
    )
    # Falls toward the east by tan 10 degrees.
    assert float(tilted.heights(5.0, 3.0)) == pytest.approx(-5.0 * math.tan(math.radians(10.0)))
    assert abs(_grid(_ground(), 129).mean()) < 0.02  # the patch lies at height 0


@pytest.mark.parametrize("landscape", LANDSCAPES)
def test_far_away_ground_is_finite_and_has_no_steps(landscape):
    ground = _ground(LANDSCAPES[landscape])
    for x in (1.0e5, -1.0e5):
        axis = x + np.linspace(0.0, 1.0e-3, 101)
        line = ground.heights(axis, np.full(101, 1.0e5))
        assert np.isfinite(line).all()
        # At 1e5 m a float64 has steps of 1.5e-11 m; the steepest slope of the landforms is about 20.
        assert np.abs(np.diff(line)).max() < 30 * 1.0e-5


def test_a_patch_may_be_tiny_or_huge():
    for size in (0.01, 1.0e5):
        ground = _ground(
            {
                "terrain": {
                    "size_m": size,
                    "outer_scale_m": size / 2,
                    "inner_scale_m": size / 500,
                    "slope_baseline_m": size / 20,
                }
            }
        )
        heights = _grid(ground, 129)
        lag = size / 128 * 6
        slope = np.sqrt(np.mean((heights[:, 6:] - heights[:, :-6]) ** 2)) / lag
        # 12 degrees at 6.4 of these lags, by the power law; the shapes do not know their size.
        assert slope == pytest.approx(math.tan(math.radians(12.0)) * (6 / 6.4) ** -0.2, rel=0.2)


def _extremes() -> list[tuple[str, str, object]]:
    """Both ends of the range of every setting of the ground."""
    settings = [(topic, setting) for topic in ("terrain", *MAKERS, "mantle") for setting in TOPICS[topic].settings]
    return [
        (topic, setting.key, value)
        for topic, setting in settings
        if setting.kind in ("float", "int")
        for value in (setting.minimum, setting.maximum)
    ]


@pytest.mark.ci_takes(10)
@pytest.mark.parametrize(("topic", "key", "value"), _extremes())
def test_every_setting_may_be_at_the_end_of_its_range(topic, key, value):
    rough = {"lacunarity": 2.0} if key != "lacunarity" else {}
    settings = _settings(EVERYTHING, {"terrain": {"size_m": 20.0, **rough}}, {topic: {key: value}})
    ground_settings = settings.terrain
    ground_settings.inner_scale_m = min(ground_settings.inner_scale_m, ground_settings.outer_scale_m)
    if key == "outer_scale_m":
        ground_settings.inner_scale_m = value / 100
    if key == "inner_scale_m":
        ground_settings.outer_scale_m = max(value, 1.0)
    if topic == "craters":
        settings.craters.smallest_m = min(settings.craters.smallest_m, settings.craters.largest_m)
        # Not more craters than one may ask for.
        few = {"smallest_m": 1e-5, "largest_m": 1e-10}.get(key, 2.0)
        settings.craters.update(coverage=min(settings.craters.coverage, few), most=50_000)
    if key == "size_m":
        settings.craters.coverage = 0.0
    with np.errstate(all="raise", under="ignore"):
        ground = make_terrain(settings, 1)
        heights = _grid(ground, 33, 2 * ground.size_m / 32)
        fine = _grid(ground, 33)
    assert np.isfinite(heights).all()
    assert np.isfinite(fine).all()


ALL = _ground(EVERYTHING)


@hypothesis(deadline=None, max_examples=15)
@given(st.lists(st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)), min_size=1, max_size=20))
def test_any_points_in_any_order(points):
    x, y = np.array(points).T
    ground = ALL
    heights = ground.heights(x, y)
    assert np.isfinite(heights).all()
    assert np.array_equal(ground.heights(x[::-1], y[::-1]), heights[::-1])


def test_no_points_have_no_heights():
    assert _ground(EVERYTHING).heights(np.empty(0), np.empty(0)).shape == (0,)


def test_what_a_mesh_cannot_show_is_said():
    settings = _settings({"penitentes": {"height_m": 1.0, "spacing_m": 1.0}})
    assert advise_on_terrain(settings, 0.04) == []
    (gone,) = advise_on_terrain(settings, 1.2)[-1:]
    assert "penitentes" in gone
    assert "left out" in gone
    (lower,) = advise_on_terrain(settings, 0.8)[-1:]
    assert "50% of their height" in lower
    assert any("the ground is flat" in note for note in advise_on_terrain(settings, 9.0))


@pytest.mark.parametrize("name", preset_names("terrains"))
def test_a_preset_is_what_its_mesh_can_show(name):
    settings = _settings(load_preset(name))
    ground = settings.terrain
    spacing = ground.size_m / (ground.resolution - 1)
    assert advise_on_terrain(settings, 2 * spacing) == []
    assert np.isfinite(_grid(make_terrain(settings, 1), 65, 2 * spacing)).all()


def test_the_papers_terrains_get_rougher_from_low_to_very_high():
    def slope(name: str) -> float:
        heights = _grid(_ground(load_preset(f"terrains/{name}")), 257, 2 * 20 / 256)
        lag = round(1.0 / (20 / 256))
        return float(np.sqrt(np.mean((heights[:, lag:] - heights[:, :-lag]) ** 2)))

    classes = [[slope(f"{kind}_{k}") for k in range(1, n + 1)] for kind, n in (("low", 3), ("medium", 4), ("high", 3))]
    classes.append([slope("very_high")])
    for gentler, rougher in pairwise(classes):
        assert max(gentler) < min(rougher)


@pytest.mark.parametrize(
    "changes",
    [
        {"terrain": {"rms_slope_deg": 9.0}},
        {"terrain": {"size_m": 8.0}},
        {"terrain": {"variant": 1}},
        {"terrain": {"lacunarity": 1.9}},
        {"hills": {"rms_slope_deg": 5.0}},
        {"hills": {"fractal": "CRESTS"}},
        {"terrain": {"layers": [{"amplitude_m": 0.2}]}},
        {"dataset": {"seed": 4}},
    ],
    ids=str,
)
def test_a_ground_made_after_another_is_as_if_made_first(changes):
    """Layers, hills and octaves are kept from one ground to the next while a slider moves; to the bit they are those
    of a new process."""
    start = merged(defaults(), EVERYTHING, {"hills": {"rms_slope_deg": 10.0}})
    x, y = np.random.default_rng(0).uniform(-40, 40, (2, 500))
    kept = (terrain._make_layer, terrain._make_hills, roughness._sample_octave)

    def heights(settings: Settings) -> Array:
        return make_terrain(settings, int(settings.dataset.seed)).heights(x, y)

    before, after = heights(start), heights(merged(start, check(changes, "test")))
    assert all(each.cache_info().currsize for each in kept)
    for each in kept:
        each.cache_clear()
    np.testing.assert_array_equal(after, heights(merged(start, check(changes, "test"))))
    assert not np.array_equal(before, after)

"""Whether light is baked, by the images that share it."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.rocks.place_rocks import scatter_rocks
from icymoon.physics.rocks.rock_shapes import make_rock_shapes
from icymoon.physics.scene_requirements import find_why_not_baked, is_baked
from icymoon.render.plans.baked_or_traced import (
    choose_indirect,
    estimate_bake_seconds,
    estimate_light_bytes,
    find_break_even,
    resolve_auto_indirect,
)
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings

LAMBERT = {
    "surface": {"model": "LAMBERT"},
    "mesh": {"kind": "GRID"},
    "terrain": {"resolution": 258},
    "quality": {"indirect": "AUTO", "samples": 9, "denoiser": "OIDN", "diffuse_bounces": 3},
}


def described(*parts: dict) -> Settings:
    return description.merged(description.defaults(), *(description.check(part, "test") for part in (LAMBERT, *parts)))


def headings(settings: Settings, count: int) -> list[str]:
    pairs = expand_headings(description.merged(settings, {"dataset": {"headings": count}}))
    return [pair.settings.quality.indirect for pair in pairs]


def test_enough_images_of_one_ground_and_sun_are_baked():
    # The prototype's figures for 640 x 480: six images with 256 samples, two with 64.
    settings = described()
    enough = find_break_even(settings)
    assert 4 <= enough <= 8
    assert find_break_even(described({"quality": {"bake_samples": 64}})) in (1, 2, 3)
    assert set(headings(settings, enough)) == {"BAKED"}
    assert set(headings(settings, enough - 1)) == {"TRACED"}


def test_images_of_other_grounds_and_suns_do_not_count():
    enough = find_break_even(described())
    several = [described({"dataset": {"seed": seed}}) for seed in range(enough)]
    low = [described({"light": {"sun_elevation_deg": 10.0 + k}}) for k in range(enough)]
    assert {each.quality.indirect for each in choose_indirect(several + low)} == {"TRACED"}
    seen = [described({"rig": {"heading_deg": 10.0 * k, "pitch_deg": 20.0}}) for k in range(enough)]
    assert {each.quality.indirect for each in choose_indirect(seen)} == {"BAKED"}


def test_light_that_is_baked_where_it_is_seen_pays_for_one_image_and_is_not_shared():
    """A fifth of the ground is seen: the bake of it with 64 samples takes less than tracing one image."""
    seen = {"quality": {"bake_area": "VIEW", "bake_samples": 64}}
    part = estimate_bake_seconds(described(seen)) / estimate_bake_seconds(described({"quality": {"bake_samples": 64}}))
    assert 0.1 < part < 0.4
    assert find_break_even(described(seen)) == 1
    assert headings(described(seen), 1) == ["BAKED"]
    dear = {"quality": {"bake_area": "VIEW", "bake_samples": 1024}}
    assert find_break_even(described(dear)) > 1
    assert set(headings(described(dear), 36)) == {"TRACED"}  # each image has its own bake
    alike = [described(dear, {"sensor": {"full_well_e": 9000.0 + k}}) for k in range(find_break_even(described(dear)))]
    assert {each.quality.indirect for each in choose_indirect(alike)} == {"BAKED"}


def test_fewer_samples_than_direct_light_takes_are_never_baked():
    settings = described({"quality": {"samples": 2, "denoiser": "NONE", "direct_samples": 4}})
    assert find_break_even(settings) == 0
    assert set(headings(settings, 90)) == {"TRACED"}


def test_what_is_not_automatic_stays():
    for choice in ("TRACED", "BAKED"):
        assert headings(described({"quality": {"indirect": choice}}), 3) == [choice] * 3


def test_light_of_a_planet_is_baked_too_and_takes_as_long_as_that_of_the_sun():
    with_planet = described({"light": {"planet": True, "stars": True}, "quality": {"indirect": "BAKED"}})
    assert is_baked(with_planet)
    assert estimate_bake_seconds(with_planet) == pytest.approx(2 * estimate_bake_seconds(described()))


@pytest.mark.parametrize("most", [100_000, 2000])
def test_baked_light_counts_the_fragments_that_are_scattered(most):
    rocks = {"coverage": 0.1, "smallest_m": 0.1, "largest_m": 1.0, "debris": 0.1, "debris_most": most}
    without, found = (
        estimate_light_bytes(described({"rocks": {**rocks, "debris": share}, "light": {"planet": False}}))
        for share in (0.0, 0.1)
    )
    settings = described({"rocks": rocks})
    shapes = make_rock_shapes(settings.rocks.family, settings.rocks.angularity, 1)
    size_m = settings.terrain.size_m
    made = scatter_rocks(settings.rocks, size_m, 1, lambda x, y: 0.0 * x, shapes, (0.0, 0.0, -np.inf))
    fragments = len(made.diameter_m) - made.debris_start
    # A fragment takes as many bytes as a rock, 140. Volumes and so counts vary with the few largest rocks.
    assert (found - without) / 140.0 == pytest.approx(fragments, rel=0.05)


def test_rocks_are_baked_too_and_take_longer_the_more_there_are():
    seconds = [
        estimate_bake_seconds(described({"rocks": {"coverage": coverage}})) for coverage in (0.0, 0.01, 0.05, 0.2)
    ]
    assert np.all(np.diff(seconds) > 0)
    assert is_baked(described({"rocks": {"coverage": 0.1}, "quality": {"indirect": "BAKED"}}))


@pytest.mark.parametrize(
    "part",
    [
        {"surface": {"model": "PRINCIPLED"}},
        {"surface": {"model": "HAPKE"}},
        {"rocks": {"coverage": 0.1, "own_surface": True}, "rock_surface": {"model": "PRINCIPLED"}},
        {"lander": {"kind": "PARAMETRIC"}},
    ],
)
def test_what_cannot_be_baked_is_traced_and_told(part):
    settings = described(part, {"quality": {"indirect": "BAKED"}})
    assert find_why_not_baked(settings)
    assert not is_baked(settings)
    assert set(headings(described(part), 90)) == {"TRACED"}


def test_a_mesh_is_baked_in_proportion_to_its_triangles_whatever_the_grid_of_made_up_ground():
    def seconds(key: str, resolution: int = 258) -> float:
        return estimate_bake_seconds(
            described({"source": {"kind": "STAND_IN", "stand_in": key}, "terrain": {"resolution": resolution}})
        )

    start = estimate_bake_seconds(described({"quality": {"bake_samples": 4}})) - seconds_of_corners(4 * 258**2, 4)
    few, many = seconds("ATHABASCA"), seconds("GLACIER_42M")  # 30000 and 60000 triangles
    assert many - start == pytest.approx(2 * (few - start))
    assert few - start == pytest.approx(seconds_of_corners(3 * 30000, 256))
    assert seconds("ATHABASCA", 1025) == few


def seconds_of_corners(corners: float, samples: int) -> float:
    """Of the time that more samples of a grid take."""
    most, least = (estimate_bake_seconds(described({"quality": {"bake_samples": n}})) for n in (1000, 500))
    return (most - least) / 500 / (4 * 258**2) * corners * samples


def test_automatic_light_is_settled_by_the_images_that_share_it():
    shared, own = described(), described({"quality": {"bake_area": "VIEW"}})
    enough = find_break_even(shared)
    assert [resolve_auto_indirect(shared, n).quality.indirect for n in (enough - 1, enough)] == ["TRACED", "BAKED"]
    # Light that is baked where it is seen is not shared, however many images there are.
    assert resolve_auto_indirect(own, 100) == choose_indirect([own])[0]
    assert resolve_auto_indirect(described({"quality": {"indirect": "TRACED"}}), 100).quality.indirect == "TRACED"

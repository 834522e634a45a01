"""Rocks beyond the patch: of the same law, wide enough to be seen, and the same wherever the camera stands."""

import itertools
import math

import numpy as np
import pytest
from icymoon.physics.rocks.beyond_patch import ViewBeyond, draw_beyond, make_view_beyond
from icymoon.physics.rocks.place_rocks import scatter_rocks
from icymoon.physics.rocks.rock_shapes import make_rock_shapes
from icymoon.physics.rocks.size_laws import make_law_beyond, make_size_law
from icymoon.settings.description import defaults, merged

SIZE_M, VIEW = 20.0, ViewBeyond(0.003, 1.6, 1e5)
LAWS = {"power": {"law": "POWER", "coverage": 0.1}, "golombek": {"law": "GOLOMBEK", "coverage": 0.1}}


def _rocks(**changes):
    return merged(defaults(), {"rocks": {"coverage": 0.1, "most": 200_000, **changes}}).rocks


def _nearest_m(places):
    return np.hypot(np.maximum(np.hypot(*places.T) - SIZE_M * math.sqrt(0.5), 0.0), VIEW.height_m)


@pytest.mark.parametrize("law", LAWS)
def test_they_lie_outside_the_patch_and_are_wide_enough(law):
    drawn = draw_beyond(_rocks(**LAWS[law]), SIZE_M, VIEW, np.random.default_rng(1))
    assert len(drawn.diameter_m) > 1000
    assert (np.abs(drawn.places_m).max(axis=1) > SIZE_M / 2 + drawn.diameter_m / 2).all()
    assert (drawn.diameter_m >= 0.999 * VIEW.smallest_rad * _nearest_m(drawn.places_m)).all()
    assert np.allclose(drawn.angle_rad, drawn.diameter_m / _nearest_m(drawn.places_m))
    assert (np.diff(drawn.diameter_m) <= 0).all()


@pytest.mark.parametrize("law", LAWS)
def test_there_are_as_many_as_the_law_has_of_those_that_are_seen(law):
    rocks = _rocks(**LAWS[law])
    drawn, sizes = draw_beyond(rocks, SIZE_M, VIEW, np.random.default_rng(2)), make_size_law(rocks)
    radius = np.hypot(*drawn.places_m.T)
    edges = np.array([16.0, 25.0, 40.0, 80.0, 160.0])
    for low, high in itertools.pairwise(edges):
        r = np.linspace(low, high, 2000)
        smallest = np.maximum(
            VIEW.smallest_rad * np.hypot(r - SIZE_M * math.sqrt(0.5), VIEW.height_m), sizes.smallest_m
        )
        density = np.where(smallest < rocks.largest_m, sizes.per_m2_above(np.minimum(smallest, rocks.largest_m)), 0.0)
        expected = np.sum(2 * np.pi * r * density) * (r[1] - r[0])
        found = np.sum((radius >= low) & (radius < high))
        assert found == pytest.approx(expected, abs=5 + 4 * math.sqrt(expected))


@pytest.mark.parametrize("law", LAWS)
def test_the_law_goes_on_beyond_the_patch_with_as_many_of_each_size(law):
    rocks = _rocks(**LAWS[law])
    patch, beyond = make_size_law(rocks), make_law_beyond(_rocks(**LAWS[law], beyond_largest=8.0))
    assert float(beyond.diameter_m(np.zeros(1))[0]) == pytest.approx(8.0 * rocks.largest_m)
    sizes = np.geomspace(rocks.smallest_m, rocks.largest_m, 20)
    on_it, past_it = (-np.diff(each.per_m2_above(sizes)) for each in (patch, beyond))
    assert np.allclose(on_it, past_it, rtol=1e-3)  # the table of Golombek's law has other nodes
    larger = float(beyond.per_m2_above(np.array(rocks.largest_m)))
    assert beyond.total_per_m2 == pytest.approx(patch.total_per_m2 + larger, rel=1e-3)
    if law == "power":
        assert larger == pytest.approx(
            patch.total_per_m2 * (1 - 8.0**-3) / ((rocks.largest_m / rocks.smallest_m) ** 3 - 1), rel=1e-9
        )


def test_larger_rocks_beyond_the_patch_are_seen_farther_and_none_reaches_onto_it():
    near, far = (
        draw_beyond(_rocks(beyond_largest=times), SIZE_M, VIEW, np.random.default_rng(2)) for times in (1.0, 8.0)
    )
    assert near.diameter_m.max() <= 0.8 < far.diameter_m.max() <= 6.4
    assert np.hypot(*far.places_m.T).max() > 3.0 * np.hypot(*near.places_m.T).max()
    assert (np.abs(far.places_m).max(axis=1) > SIZE_M / 2 + far.diameter_m / 2).all()


def test_rocks_of_one_size_have_no_law_that_goes_on():
    rocks = _rocks(smallest_m=0.3, largest_m=0.3, beyond_largest=8.0)
    assert make_law_beyond(rocks) == make_size_law(rocks)


def test_rocks_beside_the_patch_have_all_sizes_of_the_law():
    """Just outside, the smallest are drawn as on the patch, so that no edge shows."""
    rocks = _rocks()
    drawn = draw_beyond(rocks, SIZE_M, ViewBeyond(0.003, 1.6, 1e5), np.random.default_rng(3))
    beside = (np.hypot(*drawn.places_m.T) < 30.0) & (np.abs(drawn.places_m).max(axis=1) > 10.5)
    area = np.pi * 30.0**2 - 21.0**2
    assert beside.sum() == pytest.approx(make_size_law(rocks).total_per_m2 * area, rel=0.05)


@pytest.mark.long
def test_clusters_keep_the_number_and_lie_close():
    loose, gathered = (
        draw_beyond(
            _rocks(clustering=share, cluster_blocks=50.0, cluster_radius_m=0.2), SIZE_M, VIEW, np.random.default_rng(4)
        )
        for share in (0.0, 1.0)
    )
    assert len(gathered.diameter_m) == pytest.approx(len(loose.diameter_m), rel=0.05)

    def lonely(drawn):
        near = drawn.places_m[np.hypot(*drawn.places_m.T) < 20.0]
        apart = np.hypot(*(near[:, None] - near[None]).transpose(2, 0, 1))
        return np.median(np.sort(apart, axis=1)[:, 5])

    assert lonely(gathered) < 0.5 * lonely(loose)


@pytest.mark.parametrize("most", [0, 1, 500])
def test_too_many_are_limited_by_a_larger_angle(most):
    drawn = draw_beyond(_rocks(most=most), SIZE_M, VIEW, np.random.default_rng(5))
    assert len(drawn.diameter_m) <= most
    assert drawn.smallest_rad > VIEW.smallest_rad
    assert len(drawn.diameter_m) >= 0.5 * most - 1


def test_a_law_of_one_size_and_one_smaller_than_the_patch_allows():
    drawn = draw_beyond(_rocks(smallest_m=0.5, largest_m=0.5), SIZE_M, VIEW, np.random.default_rng(6))
    assert np.allclose(drawn.diameter_m, 0.5)
    assert np.hypot(*drawn.places_m.T).max() < 0.5 / VIEW.smallest_rad + 15.0
    assert len(draw_beyond(_rocks(), SIZE_M, ViewBeyond(5.0, 1.6, 1e5), np.random.default_rng(6)).diameter_m) == 0


def _scattered(beyond):
    rocks = _rocks(most=300, smallest_m=0.2)
    return scatter_rocks(
        rocks, SIZE_M, 7, lambda x, y: 0.1 * np.asarray(x), make_rock_shapes("MIXED", 0.7, 7), (0.0, 0.0, 0.0), beyond
    )


def test_rocks_on_the_patch_are_the_same_and_come_first():
    alone, both = _scattered(None), _scattered(VIEW)
    n = len(alone.shape)
    assert len(both.shape) > n
    for name in ("position_m", "rotation", "scale_m", "level", "shape", "diameter_m", "reach_m"):
        assert np.array_equal(getattr(alone, name), getattr(both, name)[:n])
    assert (alone.smallest_m, alone.beyond_rad) == (both.smallest_m, 0.0)
    assert both.beyond_rad >= VIEW.smallest_rad
    # Centres are at most half a rock above the ground, or its burial under it.
    far = both.position_m[n:]
    assert (np.abs(far[:, 2] - 0.1 * far[:, 0]) < both.diameter_m[n:]).all()


def test_the_view_is_of_the_camera_and_not_of_where_it_stands():
    asked = {"rocks": {"beyond_px": 2.0}, "rig": {"width_px": 640, "focal_length_mm": 32.0, "sensor_width_mm": 64.0}}
    here, there = (
        make_view_beyond(merged(defaults(), asked, {"rig": {"x_m": x, "heading_deg": 9 * x}})) for x in (0.0, 5.0)
    )
    assert here == there
    assert here.smallest_rad == pytest.approx(2.0 / 320.0)


@pytest.mark.parametrize(
    "changes", [{"rocks": {"beyond_px": 0.0}}, {"mesh": {"kind": "GRID"}}, {"source": {"kind": "MESH"}}]
)
def test_none_lie_where_there_is_no_ground(changes):
    assert make_view_beyond(merged(defaults(), {"rocks": {"beyond_px": 2.0}}, changes)) is None

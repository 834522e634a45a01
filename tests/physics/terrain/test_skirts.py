"""Skirts at the feet of rocks: their volume, their slope, how they merge and drift, and what they cost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.mesh.preview_ground import make_preview_ground
from icymoon.physics.rocks.own_rock import find_rock_shapes
from icymoon.physics.rocks.place_rocks import Footprints, draw_footprints, euler_matrices, scatter_rocks
from icymoon.physics.terrain.skirts import Skirts, advise_on_skirts, build_skirts, make_skirts, make_skirts_of_scene
from icymoon.physics.terrain.standing_places import make_rocky_ground
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

#: A patch of ground with a few hundred rocks and skirts.
STREWN: dict[str, dict[str, Any]] = {
    "terrain": {"size_m": 8.0, "resolution": 257},
    "rocks": {"coverage": 0.15, "smallest_m": 0.1, "skirt": 0.3},
}


def described(*changes: dict[str, dict[str, Any]]) -> Settings:
    return merged(defaults(), STREWN, *changes)


def skirts_of(*rocks: tuple[float, float, float, float, float, float], **changes: float) -> Skirts:
    """Skirts of rocks (east, north, longer and shorter half axis, direction, height above the ground)."""
    table = np.array(rocks, float)
    made = build_skirts(
        Footprints(table[:, :2], table[:, 2:4], table[:, 4], table[:, 5]), described({"rocks": changes}).rocks
    )
    assert made is not None
    return made


def grid(half_m: float, n: int) -> tuple[Array, Array]:
    axis = np.linspace(-half_m, half_m, n)
    return axis[None, :], axis[:, None]


def steepest(skirts: Skirts, half_m: float, n: int = 301) -> float:
    """The largest slope between points of a grid, in degrees, in eight directions. Between two points it is at most the
    slope of the surface somewhere between them."""
    x, y = grid(half_m, n)
    z, step = skirts.heights(x, y), 2 * half_m / (n - 1)
    rise = [
        np.abs(z[i:, j:] - z[: n - i, : n - j]).max() / math.hypot(i, j)
        for i, j in ((0, 1), (1, 0), (1, 1), (1, 2), (2, 1))
    ]
    rise += [np.abs(z[i:, :-j] - z[: n - i, j:]).max() / math.hypot(i, j) for i, j in ((1, 1), (1, 2), (2, 1))]
    return math.degrees(math.atan(max(rise) / step))


@pytest.mark.parametrize("axes", [(0.5, 0.5), (0.8, 0.3)])
def test_the_volume_around_a_rock_is_that_of_the_rounded_cone(axes):
    """Steiner's formula: at the distance d from a convex outline with the perimeter P, the outline is P + 2 pi d long.
    The profile falls from h at the outline along the slope t to a parabola that begins at the height r = h/2 and ends
    r / t beyond the cone's foot."""
    long, short = axes
    skirts = skirts_of((0.0, 0.0, long, short, 0.4, 1.0), skirt=0.2)
    height, slope, rounded = 0.2, skirts.slope, 0.1
    x, y = grid(2.0, 801)
    along, across = math.cos(0.4) * x + math.sin(0.4) * y, math.cos(0.4) * y - math.sin(0.4) * x
    outside = np.hypot(np.maximum(np.abs(along) - (long - short), 0.0), across) > short
    measured = float(skirts.heights(x, y)[outside].sum()) * (4.0 / 800) ** 2
    perimeter = 2 * math.pi * short + 4 * (long - short)
    area = height**2 / 2 + rounded**2 / 6
    moment = height * area - height**3 / 3
    expected = perimeter * area / slope + 2 * math.pi * moment / slope**2
    # The sum over cells is wrong only along the outline: half a cell of height h on a part of its length.
    assert measured == pytest.approx(expected, rel=0.01)


def test_a_skirt_is_as_high_as_stated_at_the_outline_and_ends_at_its_foot():
    skirts = skirts_of((0.0, 0.0, 0.5, 0.5, 0.0, 1.0), skirt=0.2)
    foot = 0.5 + 1.5 * 0.2 / skirts.slope
    assert skirts.heights(0.5, 0.0) == pytest.approx(0.2, abs=1e-7)
    assert skirts.heights(foot - 1e-3, 0.0) > 0.0
    assert skirts.heights(foot + 1e-7, 0.0) == 0.0  # heights are kept in single precision
    # Without a crease: the slope at the foot is as small as the distance to it.
    ends = skirts.heights(np.array([foot - 2e-3, foot - 1e-3]), 0.0)
    assert ends[0] == pytest.approx(4 * ends[1], rel=1e-3)


@pytest.mark.parametrize("repose_deg", [15.0, 35.0, 60.0])
@pytest.mark.parametrize("drift", [1.0, 3.0])
def test_no_skirt_is_steeper_than_repose(repose_deg, drift):
    random = np.random.default_rng(3)
    rocks = [
        (*random.uniform(-1, 1, 2), long, long * random.uniform(0.4, 1.0), random.uniform(0, 6), long)
        for long in random.uniform(0.05, 0.4, 60)
    ]
    skirts = skirts_of(*rocks, skirt=0.5, skirt_repose_deg=repose_deg, skirt_drift=drift, skirt_azimuth_deg=70.0)
    found = steepest(skirts, 1.5)
    # Heights of a metre are rounded to 1e-15, over 1 cm.
    assert 0.8 * repose_deg < found <= repose_deg + 1e-6


def test_neighbours_merge_without_a_crease_and_a_lone_skirt_is_unchanged():
    pair = [(-0.6, 0.0, 0.4, 0.4, 0.0, 1.0), (0.6, 0.0, 0.4, 0.4, 0.0, 1.0)]
    both, left, right = (skirts_of(*rocks, skirt=0.3) for rocks in (pair, pair[:1], pair[1:]))
    x, y = grid(2.0, 401)
    merged_m, larger = both.heights(x, y), np.maximum(left.heights(x, y), right.heights(x, y))
    lone = (left.heights(x, y) == 0) | (right.heights(x, y) == 0)
    assert np.array_equal(merged_m[lone], larger[lone])
    assert (merged_m >= larger).all()
    # On the middle line two equal skirts meet in a crease; merged, the slope there is 0 by symmetry.
    step = 1e-4
    crease, smooth = (
        (f(step) - f(0.0)) / step
        for f in (
            lambda east: max(float(left.heights(east, 0.0)), float(right.heights(east, 0.0))),
            lambda east: float(both.heights(east, 0.0)),
        )
    )
    assert crease == pytest.approx(both.slope, rel=1e-3)
    assert abs(smooth) < 0.02 * both.slope


@given(st.integers(0, 2**32 - 1))
@budget(max_examples=20)
def test_skirts_do_not_depend_on_the_order_of_rocks_or_points(seed):
    random = np.random.default_rng(seed)
    rocks = [(*random.uniform(-2, 2, 2), s, s * 0.7, random.uniform(0, 3), s) for s in random.uniform(0.01, 0.5, 30)]
    skirts, shuffled = skirts_of(*rocks), skirts_of(*(rocks[k] for k in random.permutation(30)))
    x, y = random.uniform(-3, 3, (2, 500))
    order = random.permutation(500)
    expected = skirts.heights(x, y)
    assert np.array_equal(shuffled.heights(x[order], y[order]), expected[order])
    assert float(skirts.heights(x[0], y[0])) == expected[0]


def test_skirts_turn_with_their_rock():
    straight = skirts_of((0.0, 0.0, 0.6, 0.3, 0.0, 1.0))
    turned = skirts_of((0.0, 0.0, 0.6, 0.3, math.pi / 2, 1.0))
    x, y = grid(1.5, 151)
    heights = straight.heights(x, y)
    # Outlines are kept in single precision, 1e-7 of a metre.
    assert turned.heights(x, y) == pytest.approx(heights.T, abs=1e-6)
    assert heights == pytest.approx(heights[::-1], abs=1e-12)
    assert heights == pytest.approx(heights[:, ::-1], abs=1e-12)


def test_a_drift_lies_behind_the_rock_and_nowhere_else():
    even = skirts_of((0.0, 0.0, 0.4, 0.4, 0.0, 1.0), skirt=0.2)
    drift = skirts_of((0.0, 0.0, 0.4, 0.4, 0.0, 1.0), skirt=0.2, skirt_drift=3.0, skirt_azimuth_deg=270.0)
    width, rounded = 0.2 / even.slope, 0.1 / even.slope
    # Material from the west lies in the east: the foot is three widths away there and one width in the west.
    east = np.array([0.4 + 3 * width + rounded - 1e-3, 0.4 + 3 * width + rounded + 1e-3])
    assert drift.heights(east[0], 0.0) > 0.0 == drift.heights(east[1], 0.0)
    x, y = grid(2.0, 201)
    windward = np.broadcast_to(x < 0.0, (201, 201))
    assert drift.heights(x, y)[windward] == pytest.approx(even.heights(x, y)[windward], abs=1e-12)
    assert (drift.heights(x, y) >= even.heights(x, y) - 1e-12).all()


def test_a_drift_is_the_envelope_of_sinking_cones():
    """Against the greatest of 2000 cones, which is too low by less than half a step's sinking."""
    skirts = skirts_of((0.0, 0.0, 0.4, 0.4, 0.0, 1.0), skirt=0.2, skirt_drift=2.5, skirt_azimuth_deg=180.0)
    x, y = (each.ravel() for each in np.meshgrid(*(np.linspace(-1.5, 1.5, 41),) * 2))
    outside = np.hypot(x, y) > 0.4
    x, y = x[outside], y[outside]
    share = np.linspace(0.0, 1.0, 2000)[:, None]
    away = np.hypot(x, y - share * 2.5 * 0.2 / skirts.slope) - 0.4
    expected = (0.2 * (1.0 - share) - skirts.slope * np.maximum(away, 0.0)).max(axis=0)
    high = expected > 0.1  # above the rounded foot
    assert high.sum() > 100
    assert skirts.heights(x, y)[high] == pytest.approx(expected[high], abs=0.2 / 2000)


# On the ground


def test_without_skirts_the_ground_is_the_same_to_the_bit():
    bare = merged(defaults(), {"terrain": {"size_m": 8.0}})
    x, y = grid(4.0, 129)
    expected = make_terrain(bare, 1).heights(x, y, 0.05)
    for change in ({"skirt": 0.0}, {"skirt": 0.0, "skirt_repose_deg": 20.0, "skirt_drift": 4.0}, {"coverage": 0.0}):
        ground = make_terrain(described({"rocks": change}), 1)
        assert ground.skirts is None
        assert np.array_equal(ground.heights(x, y, 0.05), expected)
    assert not np.array_equal(make_terrain(described(), 1).heights(x, y, 0.05), expected)


def test_a_skirt_surrounds_each_rock_and_the_ground_is_unchanged_elsewhere():
    settings = described()
    ground = make_terrain(settings, 1)
    shapes = find_rock_shapes(settings.rocks, 1)
    rocks = scatter_rocks(settings.rocks, 8.0, 1, ground.without_skirts().heights, shapes, (0.0, 0.0, 0.0))
    assert ground.skirts is not None
    assert len(ground.skirts.height_m) == len(rocks.diameter_m) > 300
    assert (ground.skirts.heights(*rocks.position_m[:, :2].T) >= ground.skirts.height_m).all()
    x, y = np.random.default_rng(1).uniform(-4, 4, (2, 4000))
    away = (
        np.hypot(x[:, None] - rocks.position_m[:, 0], y[:, None] - rocks.position_m[:, 1]) > 3.0 * rocks.diameter_m
    ).all(axis=1)
    assert away.sum() > 50
    assert (ground.skirts.heights(x[away], y[away]) == 0.0).all()


def test_no_rock_floats_or_climbs_on_its_skirt():
    settings = described({"rocks": {"skirt": 0.5}})
    ground, bare = make_terrain(settings, 1), make_terrain(settings, 1).without_skirts()
    shapes = find_rock_shapes(settings.rocks, 1)
    site = (0.0, 0.0, 0.0)
    rocks = scatter_rocks(settings.rocks, 8.0, 1, bare.heights, shapes, site)
    without = described({"rocks": {"skirt": 0.0}})
    expected = scatter_rocks(without.rocks, 8.0, 1, make_terrain(without, 1).heights, shapes, site)
    assert np.array_equal(rocks.position_m, expected.position_m)
    assert np.array_equal(rocks.rotation, expected.rotation)
    for k, turn in enumerate(euler_matrices(rocks.rotation)):
        shape = shapes[rocks.level[k]][rocks.shape[k]]
        points = rocks.position_m[k] + (shape.vertices * rocks.scale_m[k]) @ turn.T
        # A point is in contact or buried: the gap between rock and ground is 0.
        assert (points[:, 2] - ground.heights(points[:, 0], points[:, 1])).min() <= 1e-9


def test_no_skirt_stays_where_the_clear_circle_removes_a_rock():
    settings = described({"rocks": {"clear_radius_m": 1.5, "coverage": 0.3}})
    shapes = find_rock_shapes(settings.rocks, 1)
    clear = (0.0, 0.0, 1.5)
    ground = make_terrain(settings, 1)
    rocks = scatter_rocks(settings.rocks, 8.0, 1, ground.without_skirts().heights, shapes, clear)
    outlines = draw_footprints(settings.rocks, 8.0, 1, shapes, clear)
    left = {tuple(place) for place in rocks.position_m[:, :2].tolist()}
    assert {tuple(place) for place in outlines.places_m.tolist()} <= left
    # Only rocks at the very edge of the circle lack a skirt, because the ground decides whether they stay.
    assert len(rocks.diameter_m) - len(outlines.above_m) <= 0.02 * len(rocks.diameter_m)
    x, y = grid(1.0, 51)
    near = np.hypot(x, y) < 0.5
    assert (ground.skirts.heights(x, y)[near] == 0.0).all()


def test_a_coarse_mesh_leaves_narrow_skirts_out_and_fades_them_without_a_step():
    skirts = skirts_of((0.0, 0.0, 0.1, 0.1, 0.0, 0.2), skirt=0.2)
    width = 0.04 / skirts.slope
    shortest = np.linspace(0.0, 4 * width, 400)
    heights = skirts.heights(0.1, 0.0, shortest)
    assert heights[0] == pytest.approx(0.04, abs=1e-7)
    assert (heights[shortest >= 2 * width] == 0.0).all()
    assert (np.diff(heights) <= 0.0).all()
    assert np.abs(np.diff(heights)).max() < 0.04 * 0.05


@pytest.mark.parametrize("kind", ["GRADED", "GRID"])
def test_preview_and_fine_ground_have_the_same_skirts(kind):
    settings = described({"mesh": {"kind": kind}, "rocks": {"beyond_px": 20.0}})
    ground = make_terrain(settings, 1)
    preview = make_preview_ground(ground, settings, 5000)
    x, y = np.random.default_rng(4).uniform(-3, 3, (2, 200))
    fine = grade_ground(ground, settings) if kind == "GRADED" else ground
    step = 8.0 / 256
    assert np.allclose(preview.heights(x, y, 2 * step), fine.heights(x, y, 2 * step), rtol=0, atol=1e-12)
    assert preview.skirts is not None
    raised = preview.heights(x, y, 0.0) - preview.without_skirts().heights(x, y, 0.0)
    assert raised == pytest.approx(preview.skirts.heights(x, y, preview.shortest_m), abs=1e-12)


def test_the_mesh_minus_its_skirts_is_the_mesh_without_them_at_its_vertices():
    settings = described({"mesh": {"error_px": 4.0, "edge_px": 16.0}})
    graded = grade_ground(make_terrain(settings, 1), settings)
    positions, _, _ = graded.mesh()
    near = positions[np.hypot(positions[:, 0], positions[:, 1]) < 10.0]
    skirts = graded.compute_skirts(near[:, 0], near[:, 1])
    assert skirts.max() > 0.05
    bare = graded.without_skirts().heights(near[:, 0], near[:, 1], graded.find_carried_wavelengths(*near[:, :2].T))
    # Vertices and wavelengths are rounded to single precision: 1e-6 m on slopes under 1.
    assert near[:, 2] - skirts == pytest.approx(bare, abs=1e-5)


def test_ground_from_a_file_and_ground_without_rocks_have_no_skirts():
    mapped = described({"source": {"kind": "HEIGHT_MAP"}})
    assert make_skirts_of_scene(mapped, 1) is None
    (said,) = advise_on_skirts(mapped)
    assert "rocks.skirt is 0.3" in said
    assert advise_on_skirts(merged(mapped, {"rocks": {"skirt": 0.0}})) == advise_on_skirts(described()) == []
    assert make_skirts_of_scene(described({"rocks": {"coverage": 0.0}}), 1) is None


def test_a_camera_is_checked_on_ground_with_skirts():
    ground = make_rocky_ground(described({"rig": {"x_m": 1.0}}))
    elsewhere = make_rocky_ground(described({"rig": {"x_m": -2.0}}))
    rocks = ground.rocks
    assert rocks is not None
    x, y = rocks.position_m[:, :2].T
    assert np.array_equal(ground.heights(x, y), elsewhere.heights(x, y))
    assert (ground.heights(x, y) > ground.ground.without_skirts().heights(x, y, ground.shortest_m)).mean() > 0.5


def test_rocks_of_a_table_have_skirts(tmp_path):
    table = tmp_path / "rocks.csv"
    table.write_text("x_m,y_m,diameter_m\n1,1,0.5\n-20,0.5,10\n2,-1,0.01\n")
    settings = described({"rocks": {"law": "TABLE", "file": str(table), "height_ratio": 1.0}})
    skirts = make_skirts_of_scene(settings, 1)
    assert skirts is not None
    assert skirts.places_m.tolist() == [[-20.0, 0.5], [1.0, 1.0], [2.0, -1.0]]
    assert (skirts.heights(*skirts.places_m.T) >= skirts.height_m).all()
    table.write_text("x_m,y_m,diameter_m\n1,1,0.5\n")
    changed = make_skirts_of_scene(settings, 1)
    assert changed is not None
    assert len(changed.height_m) == 1


@pytest.mark.parametrize(("key", "value"), [("skirt", 0.6), ("skirt_repose_deg", 61.0), ("skirt_drift", 0.5)])
def test_a_value_out_of_range_is_refused_in_one_sentence(key, value):
    with pytest.raises(IcyMoonError, match=key):
        check({"rocks": {key: value}}, "test")


# What it costs


@pytest.mark.parametrize(("smallest_m", "largest_m", "index"), [(0.01, 10.0, 2.0), (0.06, 0.06001, 3.0)])
def test_each_point_meets_few_skirts_among_a_hundred_thousand(smallest_m, largest_m, index):
    """As many as overlap: a box of 1.7 diameters with a cell of twice its side meets at most 16 boxes' area, so rocks
    that cover a tenth of the ground meet a point 6 times per factor of two in size."""
    rocks = described(
        {
            "rocks": {
                "coverage": 0.1,
                "smallest_m": smallest_m,
                "largest_m": largest_m,
                "power_index": index,
                "most": 100_000,
            }
        }
    ).rocks
    skirts = make_skirts(rocks, 60.0, 1, (0.0, 0.0, 0.0))
    assert skirts is not None
    assert len(skirts.height_m) > 90_000
    x, y = np.random.default_rng(2).uniform(-30, 30, (2, 4000))
    pairs = [len(p) for cells in skirts.cells for p, _ in cells.list_pairs(x, y, np.zeros(4000))]
    assert sum(pairs) <= 8 * 4000
    assert sum(len(cells.skirts) for cells in skirts.cells) <= 4 * len(skirts.height_m)
    assert sum(len(cells.first) for cells in skirts.cells) <= 17 * len(skirts.height_m) + 17 * len(skirts.cells)

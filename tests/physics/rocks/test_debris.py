"""Debris: its volume, sizes, places and number, and that it changes no rock."""

from __future__ import annotations

import math
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from icymoon.physics.rocks.beyond_patch import ViewBeyond
from icymoon.physics.rocks.debris import Debris, Outlines, count_debris, shed_debris
from icymoon.physics.rocks.place_rocks import Rocks, scatter_rocks
from icymoon.physics.rocks.rock_shapes import make_rock_shapes
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.rocks import RocksSettings
from icymoon.support.arrays import Array

ARRAYS = ("position_m", "rotation", "scale_m", "level", "shape", "diameter_m", "reach_m")
FIELD = {"coverage": 0.1, "smallest_m": 0.1, "largest_m": 1.0, "clustering": 0.3}
#: Largest fragment over its rock, as the setting states.
LARGEST = 0.3


def described(**changes: Any) -> RocksSettings:
    return merged(defaults(), {"rocks": {**FIELD, "debris": 0.1, **changes}}).rocks


def shed(diameter_m: Array, *, seed: int = 1, seen_m: float = 0.0, **changes: Any) -> Debris:
    """The debris of rocks at the origin, whose outlines are twice as long as wide, turned by 0.7 rad."""
    n = len(diameter_m)
    half = diameter_m[:, None] / 2 * np.array([math.sqrt(2.0), math.sqrt(0.5)])
    outlines = Outlines(np.zeros((n, 2)), half, np.full(n, 0.7))
    return shed_debris(described(**changes), diameter_m, outlines, np.full(n, seen_m), np.random.default_rng(seed))


def level(x: Array, y: Array) -> Array:
    return np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))


def strewn(*args: Any, size_m: float = 12.0, **changes: Any) -> Rocks:
    rocks = described(**changes)
    shapes = make_rock_shapes(rocks.family, rocks.angularity, 3)
    return scatter_rocks(rocks, size_m, 3, level, shapes, (1.0, -1.0, 0.5), *args)


@given(
    st.floats(0.01, 0.5), st.floats(0.5, 6.0) | st.sampled_from([2.0, 3.0]), st.floats(0.005, 0.1), st.floats(0.2, 3.0)
)
@budget(deadline=None)
def test_debris_has_its_share_of_the_volume_and_never_more(share, index, smallest, diameter):
    found = shed(
        np.array([diameter]), debris=share, debris_index=index, debris_smallest_m=smallest, debris_most=1_000_000
    )
    volume, asked = float((found.diameter_m**3).sum()), share * diameter**3
    assert volume <= asked * (1 + 1e-9)
    assert (found.diameter_m >= found.smallest_m * (1 - 1e-9)).all()
    assert (found.diameter_m <= LARGEST * diameter * (1 + 1e-9)).all()
    if found.smallest_m == smallest and len(found.diameter_m):
        # What is left is less than one more fragment, none larger than the smallest of these.
        assert asked - volume <= found.diameter_m[-1] ** 3 * (1 + 1e-9)


@pytest.mark.parametrize("index", [1.5, 2.5, 3.0, 3.5])
def test_the_number_above_any_size_is_that_of_the_power_law(index):
    diameter, share, smallest = 2.0, 0.2, 0.01
    given = {"debris": share, "debris_index": index, "debris_smallest_m": smallest, "debris_most": 1_000_000}
    found = shed(np.array([diameter]), **given).diameter_m
    assert len(found) > 100
    # The law by quadrature, from its definition: dN = -c a d^(-a - 1), with the volume that is asked.
    nodes, weights = np.polynomial.legendre.leggauss(200)
    log_d = math.log(smallest) + (nodes + 1) / 2 * math.log(LARGEST * diameter / smallest)
    cubes = (weights * index * np.exp((3.0 - index) * log_d)).sum() / 2 * math.log(LARGEST * diameter / smallest)
    factor = share * diameter**3 / cubes
    sizes = np.geomspace(1.01 * smallest, 0.99 * LARGEST * diameter, 200)
    expected = factor * (sizes**-index - (LARGEST * diameter) ** -index)
    # One fragment stands for each part of the law that has one.
    assert np.abs((found[:, None] > sizes).sum(axis=0) - expected).max() <= 1.0 + 1e-6


@pytest.mark.parametrize("index", [2.0, 2.5, 3.2])
def test_a_fit_recovers_the_exponent(index):
    found = shed(np.linspace(1.0, 2.0, 20), debris_index=index, debris_most=1_000_000).diameter_m
    ratio = np.log(found / 0.02)
    # Hill's estimator: with the largest ones so far above, the upper end matters less than its error.
    assert 1.0 / ratio.mean() == pytest.approx(index, abs=4 * index / math.sqrt(len(found)) + 0.03)


def test_larger_rocks_have_more_and_larger_fragments_and_small_ones_have_none():
    diameters = np.array([1.0, 0.5, 0.25, 0.06])
    found = shed(diameters, debris_smallest_m=0.02)
    counts = np.bincount(found.parent, minlength=4)
    assert counts[0] > counts[1] > counts[2] > counts[3] == 0
    assert counts.tolist() == count_debris(described(debris_smallest_m=0.02), diameters).tolist()
    largest = [found.diameter_m[found.parent == k].max() for k in range(3)]
    assert largest == sorted(largest, reverse=True)
    assert (np.diff(found.diameter_m) <= 0).all()


def test_without_debris_no_rock_has_a_fragment():
    assert count_debris(described(debris=0.0), np.array([0.5, 3.0])).tolist() == [0, 0]


def from_outline_m(found: Debris, diameter_m: float) -> Array:
    """Distances from the outline of ``shed``, positive outside it, from dense points on it."""
    turn = np.linspace(0.0, 2 * np.pi, 4001)
    x, y = diameter_m / 2 * np.stack([math.sqrt(2.0) * np.cos(turn), math.sqrt(0.5) * np.sin(turn)])
    outline = np.stack([math.cos(0.7) * x - math.sin(0.7) * y, math.sin(0.7) * x + math.cos(0.7) * y], axis=1)
    nearest = np.array([np.hypot(*(outline - place).T).min() for place in found.places_m])
    east, north = found.places_m.T
    along, across = math.cos(0.7) * east + math.sin(0.7) * north, math.cos(0.7) * north - math.sin(0.7) * east
    inside = (along / math.sqrt(2.0)) ** 2 + (across / math.sqrt(0.5)) ** 2 < (diameter_m / 2) ** 2
    return np.where(inside, -nearest, nearest)


@pytest.mark.parametrize("reach", [0.0, 1.0, 2.5])
def test_fragments_lie_outside_the_outline_at_exponential_distances(reach):
    diameter = 1.6
    found = shed(np.array([diameter]), debris_reach=reach)
    away = from_outline_m(found, diameter) - found.diameter_m / 2
    # The points on the outline are up to 1.8 mm apart, which adds up to 0.0018² / 8 / 0.01 m to a distance of 1 cm.
    assert away.min() > -1e-9
    mean = reach * diameter / 2 * np.sqrt(found.diameter_m / (LARGEST * diameter))
    if reach == 0.0:
        assert away.max() < 5e-5
        return
    share = away / mean
    n = len(share)
    # Mean and variance of an exponential variable are 1; the errors of their estimates are 1 and sqrt(8) over sqrt(n).
    assert share.mean() == pytest.approx(1.0, abs=4 / math.sqrt(n))
    assert share.var() == pytest.approx(1.0, abs=4 * math.sqrt(8 / n))
    coarse = found.diameter_m > 4 * 0.02
    assert away[coarse].mean() > 1.5 * away[~coarse].mean()


def test_fragments_lie_all_around():
    turn = np.arctan2(*shed(np.array([1.6])).places_m.T) - 0.7
    n = len(turn)
    assert np.abs(np.exp(1j * turn).mean()) < 4 / math.sqrt(n)


def assert_largest_of_each_rock(some: Debris, every: Debris) -> None:
    for rock in np.unique(every.parent):
        kept, all_of_it = (each.diameter_m[each.parent == rock] for each in (some, every))
        np.testing.assert_array_equal(kept, all_of_it[: len(kept)])


def test_too_many_fragments_lose_the_smallest_and_keep_the_others():
    diameters = np.linspace(2.0, 0.3, 40)
    every, some = shed(diameters), shed(diameters, debris_most=1000)
    assert len(every.diameter_m) > 2000
    assert 900 < len(some.diameter_m) <= 1000
    assert every.smallest_m == 0.02 < some.smallest_m <= some.diameter_m[-1]
    assert_largest_of_each_rock(some, every)
    assert len(shed(diameters, debris_most=0).diameter_m) == 0


def test_fragments_that_look_too_small_are_left_out():
    diameters = np.linspace(2.0, 0.3, 40)
    every, some = shed(diameters), shed(diameters, seen_m=0.06)
    assert 0 < len(some.diameter_m) < len(every.diameter_m)
    assert_largest_of_each_rock(some, every)
    assert some.diameter_m[-1] >= 0.06


# On the ground


@pytest.mark.parametrize("family", ["MIXED", "BROKEN_ICE"])
@pytest.mark.parametrize(
    ("view", "most_seen"), [(None, None), (ViewBeyond(0.01, 1.6, 500.0), None), (None, 40), (None, 100_000)]
)
def test_debris_changes_no_rock(family, view, most_seen):
    without = strewn(view, most_seen, family=family, debris=0.0)
    found = strewn(view, most_seen, family=family)
    start = found.debris_start
    assert start == len(without.diameter_m) == without.debris_start
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(found, name)[:start], getattr(without, name), err_msg=name)
    assert without.debris_smallest_m == 0.0
    # Fragments only fill up what a preview shows.
    assert (len(found.diameter_m) > start) == (most_seen != 40)


def test_a_seed_gives_the_same_debris_and_a_preview_moves_none():
    one, two = strewn(), strewn()
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
    some = strewn(None, one.debris_start + 50)
    there = {tuple(row) for row in np.column_stack([one.position_m, one.rotation, one.scale_m]).tolist()}
    start = some.debris_start
    rows = np.column_stack([some.position_m, some.rotation, some.scale_m])[start:].tolist()
    assert 0 < len(rows) <= 50
    assert {tuple(row) for row in rows} <= there


def test_debris_lies_beyond_the_patch_where_it_is_wide_enough():
    view = ViewBeyond(0.004, 1.6, 500.0)
    found = strewn(view)
    of = slice(found.debris_start, None)
    xy, size = found.position_m[of, :2], found.diameter_m[of]
    # A fragment may lie nearer than its rock, and its distance is measured from the nearest place of the patch.
    far = np.abs(xy).max(axis=1) > 12.0
    assert far.sum() > 20
    assert (size[far] >= view.smallest_rad * 0.9 * (np.hypot(*xy[far].T) - 12.0 * math.sqrt(0.5))).all()


def test_debris_rests_on_skirts_and_its_rocks_do_not():
    def raised(x: Array, y: Array) -> Array:
        return level(x, y) + 0.25

    flat, on_skirts = strewn(), strewn(None, None, raised)
    start = flat.debris_start
    np.testing.assert_array_equal(on_skirts.position_m[:start], flat.position_m[:start])
    lifted = on_skirts.position_m[start:] - flat.position_m[start:]
    np.testing.assert_allclose(lifted, np.broadcast_to([0.0, 0.0, 0.25], lifted.shape), atol=1e-12)


def test_fragments_stay_out_of_the_clear_circle():
    found = strewn(coverage=0.3)
    of = slice(found.debris_start, None)
    assert (np.hypot(*(found.position_m[of, :2] - [1.0, -1.0]).T) > 0.5 + found.reach_m[of]).all()


def test_few_rocks_at_once_are_in_memory():
    """Four numbers for each vertex of all rocks would take 1 GB here."""
    rocks = described(family="BROKEN_ICE", debris=0.0, most=190_000, smallest_m=0.01, largest_m=0.011)
    shapes = tuple(row[:1] for row in make_rock_shapes("BROKEN_ICE", 0.9, 3))
    tracemalloc.start()
    try:
        found = scatter_rocks(rocks | {"coverage": 0.1}, 5.0, 3, level, shapes, (0.0, 0.0, 0.0))
        assert len(found.diameter_m) > 25_000
        assert tracemalloc.get_traced_memory()[1] < 150e6
    finally:
        tracemalloc.stop()

"""Rocks at rest: on slopes that hold them, on three points around their middle, beside each other."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from icymoon.physics.rocks import rest
from icymoon.physics.rocks.place_rocks import Rocks, euler_matrices, scatter_rocks
from icymoon.physics.rocks.rock_shapes import make_rock_shapes
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.rocks import RocksSettings

SHAPES = make_rock_shapes("FRAGMENTS", 0.7, 5)
SIZE_M = 6.0


def described(**changes: Any) -> RocksSettings:
    rocks = {
        "coverage": 0.1,
        "smallest_m": 0.12,
        "largest_m": 0.6,
        "family": "FRAGMENTS",
        "burial": 0.0,
        "at_rest": True,
    }
    return merged(defaults(), {"rocks": rocks | changes}).rocks


def hilly(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Waves of 0.3 m with slopes up to 43 degrees, and smaller ones."""
    return 0.3 * np.sin(np.pi * x) + 0.03 * np.sin(7.0 * y + 3.0 * x)


def scatter(clear_m: tuple[float, float, float] = (0.0, 0.0, -math.inf), ground=hilly, **changes: Any) -> Rocks:
    return scatter_rocks(described(**changes), SIZE_M, 5, ground, SHAPES, clear_m)


def make_mesh(rocks: Rocks, k: int) -> np.ndarray:
    """Vertices (n, 3) in metres of one rock."""
    shape = SHAPES[rocks.level[k]][rocks.shape[k]]
    return (shape.vertices * rocks.scale_m[k]) @ euler_matrices(rocks.rotation[k : k + 1])[0].T + rocks.position_m[k]


def cross_outlines(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether the convex hulls of two sets of points on the map overlap, by the normals of both hulls."""
    for points in (first, second):
        hull = find_hull(points)
        edges = np.roll(hull, -1, axis=0) - hull
        for normal in np.column_stack([edges[:, 1], -edges[:, 0]]):
            a, b = first @ normal, second @ normal
            if a.max() <= b.min() or b.max() <= a.min():
                return False
    return True


def find_hull(points: np.ndarray) -> np.ndarray:
    """The convex hull of points (n, 2), counter-clockwise, by Andrew's chains."""
    order = points[np.lexsort((points[:, 1], points[:, 0]))]

    def chain(along: np.ndarray) -> list[np.ndarray]:
        kept: list[np.ndarray] = []
        for point in along:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-1] - kept[-2], point - kept[-2]
                if ax * by - ay * bx > 0:
                    break
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return np.array(chain(order) + chain(order[::-1]))


def test_planes_rest_on_the_facet_under_the_middle():
    """Against all planes through three points that are under every gap."""
    random = np.random.default_rng(1)
    x, y = random.normal(size=(2, 20, 14))
    gap = random.uniform(0.0, 1.0, (20, 14))
    found = rest.find_resting_planes(x, y, gap)
    triples = np.array(list(itertools.combinations(range(14), 3)))
    for k in range(20):
        basis = np.column_stack([np.ones(14), x[k], y[k]])
        planes = np.linalg.solve(basis[triples], gap[k][triples][..., None])[..., 0]
        under = (basis @ planes.T <= gap[k][:, None] + 1e-9).all(axis=0)
        assert found[k, 0] == pytest.approx(planes[under, 0].max(), abs=1e-9)


def test_rocks_have_rolled_to_slopes_that_hold_them():
    """On a plane that is too steep they stop at its foot; on one that is not they stay."""
    places = np.random.default_rng(2).uniform(-2.5, 2.5, (60, 2))
    size = np.full(60, 0.2)

    def valley(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.7 * np.abs(x) + 0.0 * y

    fallen = rest.roll_down(places, size, valley, SIZE_M, 25.0)
    # The ring of a rock spans the fold where the mean slope falls below the limit, within a step of it.
    assert np.abs(fallen[:, 0]).max() < 0.2
    assert fallen[:, 1] == pytest.approx(places[:, 1], abs=1e-6)
    assert (rest.roll_down(places, size, valley, SIZE_M, 36.0) == places).all()


def test_rocks_touch_the_ground_and_none_hangs_over_it():
    """The largest gap under a rock is none, and contacts within 2 % of its size surround its middle for 9 of 10."""
    rocks = scatter()
    around = []
    for k in range(40):
        points = make_mesh(rocks, k)
        gap = (points[:, 2] - hilly(points[:, 0], points[:, 1])) / rocks.diameter_m[k]
        assert gap.min() < 1e-3
        assert gap.min() > -0.1
        touching = points[gap < 0.02, :2] - rocks.position_m[k, :2]
        turn = np.sort(np.arctan2(touching[:, 1], touching[:, 0]))
        around.append(np.diff(np.append(turn, turn[0] + 2 * math.pi)).max() < math.pi)
    assert np.mean(around) >= 0.9
    laid = scatter(at_rest=False)
    assert len(rocks.diameter_m) + rocks.crowded_out == len(laid.diameter_m)


def test_rocks_do_not_reach_into_each_other():
    rocks = scatter(coverage=0.2)
    outlines = [make_mesh(rocks, k)[:, :2] for k in range(len(rocks.diameter_m))]
    near = 0
    for a, b in itertools.combinations(range(len(outlines)), 2):
        if np.hypot(*(rocks.position_m[a, :2] - rocks.position_m[b, :2])) < rocks.reach_m[a] + rocks.reach_m[b]:
            near += 1
            assert not cross_outlines(outlines[a], outlines[b])
    assert near > 20
    laid = scatter(coverage=0.2, at_rest=False)
    assert any(
        cross_outlines(make_mesh(laid, a)[:, :2], make_mesh(laid, b)[:, :2])
        for a, b in itertools.combinations(range(40), 2)
    )


def test_a_clear_circle_moves_no_other_rock():
    every, some = scatter(), scatter((0.5, 0.0, 1.0))
    kept = np.hypot(every.position_m[:, 0] - 0.5, every.position_m[:, 1]) > 1.0 + every.reach_m
    assert 0 < kept.sum() < len(kept)
    assert (every.position_m[kept] == some.position_m).all()


def test_equal_settings_give_equal_rocks():
    first, second = scatter(), scatter()
    assert (first.position_m == second.position_m).all()
    assert (first.rotation == second.rotation).all()


def test_rocks_at_rest_may_be_buried():
    shallow, deep = scatter(), scatter(burial=0.3)
    assert (deep.position_m[:20, 2] - hilly(*deep.position_m[:20, :2].T)).mean() < (
        shallow.position_m[:20, 2] - hilly(*shallow.position_m[:20, :2].T)
    ).mean() - 0.03


def test_debris_does_not_reach_into_rocks():
    rocks = scatter(debris=0.1, debris_smallest_m=0.04)
    start = rocks.debris_start
    assert len(rocks.diameter_m) > start + 50
    large = [make_mesh(rocks, k)[:, :2] for k in range(start)]
    for k in range(start, len(rocks.diameter_m), 5):
        own = make_mesh(rocks, k)[:, :2]
        away = np.hypot(*(rocks.position_m[:start, :2] - rocks.position_m[k, :2]).T)
        for other in np.flatnonzero(away < rocks.reach_m[:start] + rocks.reach_m[k]):
            assert not cross_outlines(own, large[other])


def test_without_ground_there_is_no_rock():
    rocks = scatter(ground=lambda x, y: np.where(x > 0.0, hilly(x, y), np.nan))
    assert len(rocks.diameter_m)
    assert (rocks.position_m[:, 0] > -0.3).all()
    assert np.isfinite(rocks.position_m).all()
    assert not len(scatter(ground=lambda x, y: np.full(np.shape(x), np.nan)).diameter_m)

"""Rays grouped to returns, on echoes that are written down."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.lidar.beam import SubRays, make_sub_rays
from icymoon.physics.lidar.returns import NO_RETURNS, Echoes, find_returns, join_returns, select_returns

INF = np.inf


def echoes_of(range_m, energy=None, normal=(-1.0, 0, 0)):
    """Echoes of rays along x, whose facets face the sensor."""
    range_m = np.array(range_m, float)
    shape = range_m.shape
    energy = np.where(np.isfinite(range_m), 1.0, 0.0) if energy is None else np.array(energy, float)
    number = np.arange(range_m.size).reshape(shape)
    return Echoes(
        range_m,
        energy,
        np.broadcast_to([1.0, 0, 0], (*shape, 3)).copy(),
        np.broadcast_to(normal, (*shape, 3)).copy(),
        np.ones(shape, np.uint8),
        number,
    )


def some_rays(count):
    """Rays in a row beside the axis, which has a share too."""
    return SubRays(np.stack([np.arange(count), np.zeros(count)], axis=1), np.full(count, 1 / count))


def test_rays_apart_by_more_than_the_gate_are_two_returns():
    found = find_returns(echoes_of([[5.0, 8.0, 5.1, 8.05]]), some_rays(4), 0.1, first_beam=7)
    assert found.beam.tolist() == [7, 7]
    assert found.order.tolist() == [1, 2]
    assert found.of.tolist() == [2, 2]
    assert found.range_m == pytest.approx([5.05, 8.025], rel=1e-15)
    assert found.spread_m == pytest.approx([0.05, 0.025])
    assert found.energy_j.tolist() == [2, 2]
    assert found.share.tolist() == [0.5, 0.5]
    assert found.true_range_m.tolist() == [5.0, 8.0]
    assert found.number.tolist() == [0, 1]
    assert found.on_axis.tolist() == [True, False]
    assert found.point_m[1] == pytest.approx([8.025, 0, 0])


def test_the_gate_is_between_neighbours_in_range():
    chain = find_returns(echoes_of([[5.0, 5.09, 5.18, 5.27]]), some_rays(4), 0.1)
    assert len(chain) == 1
    assert chain.range_m[0] == pytest.approx(5.135)


def test_range_is_the_mean_by_energy():
    found = find_returns(echoes_of([[5.0, 5.1]], [[3.0, 1.0]]), some_rays(2), 0.2)
    assert found.range_m[0] == pytest.approx(5.025, rel=1e-14)
    assert found.true_range_m[0] == 5.0


def test_beams_without_a_hit_or_without_energy_have_no_return():
    found = find_returns(echoes_of([[INF, INF], [4.0, INF], [4.0, 4.0]], [[0, 0], [1, 0], [0, 0]]), some_rays(2), 0.1)
    assert found.beam.tolist() == [1]
    assert not len(find_returns(echoes_of([[INF, INF]]), some_rays(2), 0.1))


def test_an_axis_without_energy_joins_a_return_and_makes_none():
    rays = SubRays(np.array([[0, 0], [1.0, 0], [-1.0, 0]]), np.array([0, 0.5, 0.5]))
    beside = find_returns(echoes_of([[5.0, 9.0, 9.0]], [[0, 1, 1]]), rays, 0.1)
    assert beside.true_range_m.tolist() == [9.0]
    assert beside.on_axis.tolist() == [False]
    within = find_returns(echoes_of([[9.02, 9.0, 9.04]], [[0, 1, 1]]), rays, 0.1)
    assert within.true_range_m.tolist() == [9.02]
    assert within.range_m == pytest.approx([9.02])
    assert within.on_axis.tolist() == [True]


def test_one_of_several_returns():
    every = find_returns(
        echoes_of([[5.0, 8.0, 11.0, 8.0], [3.0, INF, INF, INF], [INF] * 4, [9.0, 9.0, 6.0, INF]]), some_rays(4), 0.1
    )
    assert len(every) == 6
    assert select_returns(every, "ALL") is every
    assert select_returns(every, "FIRST").range_m.tolist() == [5, 3, 6]
    assert select_returns(every, "STRONGEST").range_m.tolist() == [8, 3, 9]
    assert select_returns(every, "LAST").range_m.tolist() == [11, 3, 9]
    assert select_returns(every, "LAST").order.tolist() == [3, 1, 2]


def test_returns_are_joined():
    found = find_returns(echoes_of([[5.0, 8.0]]), some_rays(2), 0.1)
    assert join_returns([found, NO_RETURNS, found]).range_m.tolist() == [5, 8, 5, 8]
    assert len(join_returns([])) == 0
    assert len(select_returns(NO_RETURNS, "FIRST")) == 0


def test_same_echoes_same_returns_whatever_is_beside_them():
    rays = make_sub_rays(20)
    range_m = np.random.default_rng(5).uniform(5, 9, (30, 21))
    whole = find_returns(echoes_of(range_m), rays, 0.15)
    parts = join_returns(find_returns(echoes_of(range_m[k : k + 7]), rays, 0.15, k) for k in range(0, 30, 7))
    assert whole.beam.tolist() == parts.beam.tolist()
    assert np.array_equal(whole.range_m, parts.range_m)
    assert np.array_equal(whole.energy_j, parts.energy_j)

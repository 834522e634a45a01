"""Outcrops of broken ice on distant hills: their share, their places, and hills without them."""

import math

import numpy as np
import pytest
from icymoon.physics.terrain.hills import make_hills
from icymoon.physics.terrain.outcrops import advise_on_outcrops, make_outcrops
from icymoon.settings.description import defaults, merged


def _hills(**changes):
    return merged(defaults(), {"hills": {"rms_slope_deg": 10.0, **changes}}).hills


def _scatter(count):
    return np.random.default_rng(5).uniform(-2e4, 2e4, (2, count))


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_outcrops_cover_their_share(share):
    """Half of the border, which is 0.6 deviations of the pieces high, counts; means of a field of kilometres vary."""
    x, y = _scatter(40_000)
    found = [
        np.mean(made.heights(x, y, 0.0) > 0.075 * made.scale_m)
        for made in (make_outcrops(_hills(outcrops=share), np.random.default_rng(seed)) for seed in range(4))
    ]
    assert np.mean(found) == pytest.approx(share, abs=0.05)


def test_outcrops_are_as_high_as_a_part_of_what_the_law_states():
    hills = _hills(outcrops=1.0, outcrop_m=10.0)
    x, y = _scatter(40_000)
    made = make_outcrops(hills, np.random.default_rng(1))
    # 10 degrees over 30 m, and 5 m by the exponent 0.75; half of it, over the root of two.
    stated = 30.0 * math.tan(math.radians(10.0)) * (5.0 / 30.0) ** 0.75 / math.sqrt(2.0) / 2.0
    assert np.std(made.scale_m * made.pieces.heights(x, y)) == pytest.approx(stated, rel=0.05)


def test_outcrops_gather_in_places_and_leave_slopes_between_them_as_they_are():
    with_them, without = (make_hills(_hills(outcrops=share), np.random.default_rng(3), 20.0) for share in (0.2, 0.0))
    x = np.arange(2000.0, 12000.0, 1.0)
    added = with_them.heights(x, 0 * x, np.zeros(1)) - without.heights(x, 0 * x, np.zeros(1))
    assert added.min() == 0.0
    assert 0.5 < np.mean(added == 0.0) < 0.95
    # In clusters: where one is, others are within metres far more often than the share of the ground.
    bare = added == 0.0
    assert np.mean(bare[10:][bare[:-10]]) > 1.1 * bare.mean()


def test_the_patch_has_no_outcrops():
    made = make_hills(_hills(outcrops=0.9), np.random.default_rng(3), 20.0)
    axis = np.linspace(-10, 10, 41)
    assert np.all(made.heights(axis[None, :], axis[:, None], np.zeros(1)) == 0.0)


def test_outcrops_that_a_mesh_does_not_carry_are_left_out():
    made = make_outcrops(_hills(outcrops=0.5, outcrop_m=8.0), np.random.default_rng(1))
    x = np.arange(0.0, 4000.0, 1.0)
    fine, coarse = (np.abs(np.diff(made.heights(x, 0 * x, shortest), 2)).max() for shortest in (0.0, 100.0))
    assert coarse < 0.02 * fine


@pytest.mark.parametrize("changes", [{}, {"outcrops": 0.3, "largest_m": 20.0}])
def test_hills_without_outcrops_and_hills_narrower_than_them_have_none(changes):
    assert make_outcrops(_hills(**changes), np.random.default_rng(0)) is None


@pytest.mark.parametrize(("width_m", "there"), [(500.0, True), (500.1, False)])
def test_hills_too_narrow_for_outcrops_are_told(width_m, there):
    hills = _hills(outcrops=0.3, outcrop_m=width_m, largest_m=2000.0)
    assert (make_outcrops(hills, np.random.default_rng(1)) is not None) == there
    said = advise_on_outcrops(hills)
    assert len(said) == (not there)
    assert all("lower hills.outcrop_m or raise hills.largest_m" in each for each in said)
    assert advise_on_outcrops(_hills(outcrop_m=width_m, largest_m=10.0)) == []

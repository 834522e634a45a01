"""Distant hills: their statistics are those asked for, and the patch does not know of them."""

import numpy as np
import pytest
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.mesh.horizon import horizon_m
from icymoon.physics.terrain.hills import make_hills
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.support.errors import IcyMoonError

KINDS = ("FBM", "CRESTS", "HETERO")


def _settings(**changes):
    return merged(defaults(), {"hills": {"rms_slope_deg": 12.0, **changes}})


def _hills(seed=1, **changes):
    made = make_hills(_settings(**changes).hills, np.random.default_rng(seed), 20.0)
    assert made is not None
    return lambda x, y: made.heights(x, y, 0.0)


def _deviation_m(heights, lag_m):
    """RMS difference of heights ``lag_m`` apart, far from the patch, where hills are whole."""
    random = np.random.default_rng(9)
    x, y = random.uniform(1e5, 4e5, (2, 60_000))
    turn = random.uniform(0, 2 * np.pi, x.size)
    return np.sqrt(np.mean((heights(x + lag_m * np.cos(turn), y + lag_m * np.sin(turn)) - heights(x, y)) ** 2))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("baseline_m", [30.0, 100.0])
def test_the_slope_at_the_baseline_is_the_one_asked(kind, baseline_m):
    # 8192 pairs have an RMS within 1/sqrt(2 * 8192) = 0.8 %, crests make heavy tails: five standard deviations.
    deviation = _deviation_m(_hills(fractal=kind, slope_baseline_m=baseline_m), baseline_m)
    assert deviation / baseline_m == pytest.approx(np.tan(np.radians(12.0)), rel=0.04)


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("hurst", [0.5, 0.75])
def test_heights_grow_with_width_by_the_hurst_exponent(kind, hurst):
    lags = np.array([30.0, 60.0, 120.0, 300.0, 600.0])
    made = np.polyfit(np.log(lags), np.log([_deviation_m(_hills(fractal=kind, hurst=hurst), lag) for lag in lags]), 1)
    assert made[0] == pytest.approx(hurst, abs=0.06)


def test_the_patch_is_as_without_hills_and_they_begin_without_a_step():
    with_hills, without = (make_terrain(settings, 3) for settings in (_settings(), defaults()))
    x, y = np.linspace(-10.0, 10.0, 65)[None, :], np.linspace(-10.0, 10.0, 65)[:, None]
    assert np.array_equal(with_hills.heights(x, y), without.heights(x, y))
    # Across the start the share of the hills grows with the square of the distance past it.
    along = 10.0 * np.sqrt(2.0) + np.linspace(-0.01, 0.5, 52)
    hills = _hills(3)(along, np.zeros_like(along))
    assert not hills[along <= 10.0 * np.sqrt(2.0)].any()
    assert 0.0 < np.abs(hills).max() < 0.05
    assert np.abs(np.diff(hills)).max() < 0.005


def test_the_patch_lies_at_the_level_of_the_hills_around_it():
    """Else it were a summit or the bottom of a pit: at the deviation of the heights that far away."""
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    radius = np.geomspace(15.0, 400.0, 48)[:, None]
    levels, deviations = [], []
    for seed in range(12):
        around = _hills(seed)(radius * np.cos(turn), radius * np.sin(turn))
        levels.append(around.mean())
        deviations.append(around.std())
    assert np.abs(levels).max() < 0.7 * np.mean(deviations)


def test_grounds_differ_by_seed_and_variant_and_are_the_same_twice():
    x = np.linspace(500.0, 5000.0, 400)

    def line(seed, variant):
        return make_terrain(merged(_settings(), {"terrain": {"variant": variant}}), seed).heights(x, 0 * x)

    assert np.array_equal(line(1, 0), line(1, 0))
    for other in (line(2, 0), line(1, 5)):
        assert np.abs(line(1, 0) - other).max() > 10.0


def test_waves_that_a_mesh_does_not_carry_are_left_out():
    made = make_hills(_settings(largest_m=1000.0).hills, np.random.default_rng(1), 20.0)
    x = np.linspace(5e4, 6e4, 4000)
    smooth, full = (made.heights(x, 0 * x, shortest) for shortest in (200.0, 0.0))
    assert np.abs(np.diff(smooth, 2)).max() < 0.2 * np.abs(np.diff(full, 2)).max()
    assert np.corrcoef(smooth, full)[0, 1] > 0.9


def test_snow_lies_on_the_hills_and_does_not_fill_their_valleys():
    snowy = merged(_settings(), {"mantle": {"thickness_m": 0.3}})
    x = np.linspace(300.0, 3000.0, 2000)
    lifted = make_terrain(snowy, 1).heights(x, 0 * x) - make_terrain(_settings(), 1).heights(x, 0 * x)
    assert np.abs(lifted).max() <= 0.3 + 1e-9


def test_the_mesh_reaches_as_far_as_the_highest_hills_are_seen():
    settings = merged(_settings(), {"rig": {"width_px": 128, "height_px": 128}})
    graded, flat = (
        grade_ground(make_terrain(s, 1), s) for s in (settings, merged(settings, {"hills": {"rms_slope_deg": 0.0}}))
    )
    radius = settings.terrain.body_radius_m
    highest = graded.mesh()[0][:, 2] + graded.drop_m(*graded.mesh()[0][:, :2].T)
    assert flat.grading.farthest_m < 3 * horizon_m(1.6, radius)
    assert graded.grading.farthest_m > horizon_m(float(highest.max()), radius)


def test_lengths_that_contradict_each_other_are_refused():
    with pytest.raises(IcyMoonError, match=r"hills\.smallest_m \(500 m\) is longer than hills\.largest_m \(100 m\)"):
        _hills(smallest_m=500.0, largest_m=100.0)
    with pytest.raises(IcyMoonError, match="it takes 21 octaves, more than 16"):
        _hills(smallest_m=0.1, largest_m=1e5)


@pytest.mark.ci_takes(10)
@pytest.mark.parametrize(
    "changes",
    [
        {"largest_m": 1.0, "smallest_m": 1.0},
        {"largest_m": 1e5, "smallest_m": 4.0},
        {"slope_baseline_m": 1e5},
        {"slope_baseline_m": 0.1},
        {"hurst": 0.05},
        {"hurst": 1.0},
        {"rms_slope_deg": 45.0},
        {"rms_slope_deg": 1e-6},
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_extreme_settings_give_finite_hills(kind, changes):
    x = np.linspace(20.0, 3e4, 500)
    heights = _hills(fractal=kind, **changes)(x, 0 * x)
    assert np.isfinite(heights).all()
    assert heights.any()

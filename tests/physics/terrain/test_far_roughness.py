"""Places of unlike roughness among the hills: their mean square, where they begin, and what they leave alone."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.terrain.far_roughness import make_far_roughness
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import check, defaults, merged

#: Half the diagonal of the patch, in metres.
START_M = 10.0 * np.sqrt(2.0)
LAYER = {"basis": "BROKEN", "amplitude_m": 0.1, "scale_m": 2.0}


def settings(patchiness=0.7, slope=8.0, **terrain):
    described = {"hills": {"rms_slope_deg": slope, "patchiness": patchiness}, "terrain": terrain}
    return merged(defaults(), check(described, "test"))


def test_far_away_the_logarithm_has_the_stated_deviation_and_the_mean_square_is_1():
    made = make_far_roughness(settings(0.7).hills, 8.0, np.random.default_rng(1), 20.0)
    x, y = np.random.default_rng(2).uniform(-2e6, 2e6, (2, 200_000))
    factor = made.factor(x, y)
    # The deviation is brought to its value on 8192 points: 1/sqrt(2 * 8192) = 0.8 %, five standard deviations.
    assert np.log(factor).std() == pytest.approx(0.7, rel=0.04)
    assert np.log(factor).mean() == pytest.approx(-0.49, abs=0.03)
    # A sum of some octaves of noise is nearly normal, with shorter tails, which carry a part of the mean square.
    assert np.mean(factor**2) == pytest.approx(1.0, abs=0.1)


def test_the_patch_and_hills_do_not_know_of_it_and_it_begins_without_a_step():
    at = np.linspace(-10.0, 10.0, 65)
    plain, patchy = (make_terrain(settings(each, layers=[LAYER]), 3) for each in (0.0, 0.8))
    assert np.array_equal(plain.heights(at[None], at[:, None]), patchy.heights(at[None], at[:, None]))
    far = make_far_roughness(settings(0.8).hills, 8.0, np.random.default_rng(1), 20.0)
    along = START_M + np.linspace(-0.5, 1.0, 151)
    factor = far.factor(along, 0.0 * along)
    assert (factor[along <= START_M] == 1.0).all()
    # The share of the places is 3 t² with t = log(r / start) / log 4: 0.008 at 1 m, times a few deviations.
    assert np.abs(np.diff(factor)).max() < 0.005
    # Without roughness and layers only hills are left.
    x = np.linspace(200.0, 3000.0, 500)
    bare = [make_terrain(settings(each, rms_slope_deg=0.0), 3).heights(x, x) for each in (0.0, 0.8)]
    assert np.abs(bare[0]).max() > 1.0
    assert np.array_equal(bare[0], bare[1])


@pytest.mark.parametrize("layers", [[], [LAYER]])
def test_roughness_and_layers_beyond_the_patch_are_rough_in_places_and_smooth_in_others(layers):
    slope = 8.0 if not layers else 0.0
    plain, patchy = (make_terrain(settings(p, rms_slope_deg=slope, layers=layers), 3) for p in (0.0, 0.8))
    x, y = np.random.default_rng(4).uniform(2e4, 9e4, (2, 400, 1))
    offset = np.linspace(0.0, 4.0, 40)
    rises = [np.diff(each.heights(x + offset, y), axis=1).std(axis=1) for each in (plain, patchy)]
    ratio = np.log(rises[1] / rises[0])
    # The narrowest places are as wide as 16 m, so the factor hardly changes over 4 m; hills add a little to both.
    assert ratio.std() == pytest.approx(0.8, abs=0.2)
    assert np.mean(rises[1] ** 2) == pytest.approx(np.mean(rises[0] ** 2), rel=0.6)


def test_grounds_differ_by_seed_and_variant_and_are_the_same_twice():
    x = np.linspace(300.0, 900.0, 50)

    def line(seed, **terrain):
        return make_terrain(settings(0.8, **terrain), seed).far_roughness.factor(x, x)

    assert np.array_equal(line(1), line(1))
    assert not np.allclose(line(1), line(2))
    assert not np.allclose(line(1), line(1, variant=1))


@pytest.mark.parametrize(
    "changes", [{"slope": 0.0}, {"patchiness": 0.0}, {"outer_scale_m": 1500.0}], ids=["no hills", "even", "too wide"]
)
def test_without_hills_patchiness_or_room_there_is_none(changes):
    assert make_terrain(settings(**changes), 1).far_roughness is None

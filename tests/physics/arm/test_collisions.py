"""Distances of capsules, and what an arm touches."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.arm.collisions import (
    find_link_around,
    find_self_collisions,
    ground_clearances_m,
    segment_distance,
)
from icymoon.physics.arm.kinematics import Capsule, forward_kinematics
from icymoon.physics.arm.parametric_arm import make_parametric_arm
from icymoon.settings.description import defaults
from icymoon.support.arrays import Array

ARM = make_parametric_arm(defaults())
STRETCHED = np.zeros(5)


def points(a: Array, b: Array, count: int = 801) -> Array:
    return np.asarray(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))


@pytest.mark.parametrize("seed", range(12))
def test_the_distance_of_segments_is_that_of_their_nearest_points(seed):
    a, b, c, d = np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 3))
    nearest = np.linalg.norm(points(a, b)[:, None] - points(c, d)[None], axis=-1).min()
    # Samples are at most 4.4 mm apart on each, so the nearest are that much farther than the true ones at most.
    assert nearest - 4.4e-3 <= segment_distance(a, b, c, d) <= nearest + 1e-12


def test_parallel_and_empty_segments_have_distances_too():
    o, x, z = np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.3])
    assert segment_distance(o, x, o + z, x + z) == pytest.approx(0.3)
    assert segment_distance(o, x, 3 * x, 5 * x) == pytest.approx(2.0)
    assert segment_distance(z, z, o, x) == pytest.approx(0.3)
    assert segment_distance(o, o, z, z) == pytest.approx(0.3)


def test_a_stretched_arm_touches_nothing_and_a_folded_one_itself():
    assert find_self_collisions(ARM, STRETCHED) == []
    folded = np.radians([0.0, 30.0, -179.5, 0.0, 0.0])
    assert ("turret", "forearm") in find_self_collisions(ARM, folded)


def test_the_lander_is_touched_where_the_arm_reaches_into_it():
    block = (Capsule(-1, (0.8, -0.5, 0.0), (0.8, 0.5, 0.0), 0.05),)
    assert find_self_collisions(ARM, STRETCHED, block) == [("upper_arm", "lander")]


def test_clearance_over_level_ground_is_the_height_less_the_radius():
    found = ground_clearances_m(ARM, STRETCHED, lambda x, y: np.full_like(x, 0.1))
    assert found["forearm"] == pytest.approx(0.6 - 0.1 - 0.045, abs=1e-6)
    assert list(found) == ["turret", "upper_arm", "forearm", "hand", "scoop"]


def test_a_scoop_in_the_ground_has_its_depth_as_negative_clearance():
    down = np.radians([0.0, -30.0, -60.0, 0.0, 0.0])  # forearm and hand straight down from 0.6 - 0.5 m
    found = ground_clearances_m(ARM, down, lambda x, y: np.zeros_like(x))
    assert found["scoop"] == pytest.approx(0.6 - 0.5 - 0.9 - 0.15 - 0.1, abs=1e-3)
    assert found["upper_arm"] > 0


def test_beside_the_ground_there_is_no_clearance():
    assert all(np.isnan(v) for v in ground_clearances_m(ARM, STRETCHED, lambda x, y: np.full_like(x, np.nan)).values())


def test_an_eye_in_a_link_is_found():
    middle = forward_kinematics(ARM, STRETCHED)[1] @ [0.5, 0.0, 0.0, 1.0]
    assert find_link_around(ARM, STRETCHED, middle[:3]) == "upper_arm"
    assert find_link_around(ARM, STRETCHED, middle[:3] + np.array([0.0, 0.0, 0.06])) == ""

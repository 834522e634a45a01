"""Poses of a scoop that is made by hand: an open box of 12 x 8 x 6 cm, seen from one side."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.stereo.decisions.scoop_pose import find_pose, measure_pose_error, sample_surface

#: Corners of the box, and its bottom and four sides as pairs of triangles with normals outward.
CORNERS = np.array([[x, y, z] for x in (0.0, 0.12) for y in (-0.04, 0.04) for z in (0.0, 0.06)])
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4))
TRIANGLES = np.array([corner for a, b, c, d in SIDES for corner in ((a, b, c), (a, c, d))])
#: It sees the bottom and two sides, which hold each other in all directions.
EYE = np.array([-0.9, -1.0, -0.9])


def turned(axis, degrees, place):
    """A pose (4, 4) by Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(degrees)
    found = np.eye(4)
    found[:3, :3] = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    found[:3, 3] = place
    return found


def test_points_are_spread_over_the_surface():
    cloud = sample_surface(CORNERS, TRIANGLES, 20000, np.random.default_rng(0))
    on = [
        np.isclose(cloud[:, 0], 0.0),
        np.isclose(cloud[:, 0], 0.12),
        np.isclose(np.abs(cloud[:, 1]), 0.04),
        np.isclose(cloud[:, 2], 0.0),
    ]
    areas = np.array([0.08 * 0.06, 0.08 * 0.06, 2 * 0.12 * 0.06, 0.12 * 0.08])
    np.testing.assert_allclose([each.mean() for each in on], areas / areas.sum(), atol=0.012)  # 3 standard errors
    np.testing.assert_allclose(np.linalg.norm(cloud[:, 3:], axis=1), 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_pose_is_found_from_3_degrees_and_10_mm_off(seed):
    random = np.random.default_rng(seed)
    true = turned(random.standard_normal(3), random.uniform(-20, 20), random.normal(0, 0.1, 3))
    model = sample_surface(CORNERS, TRIANGLES, 6000, random)
    cloud = model[:, :3] @ true[:3, :3].T + true[:3, 3]
    normals = model[:, 3:] @ true[:3, :3].T
    seen = ((EYE - cloud) * normals).sum(axis=1) > 0
    points = cloud[seen] + random.normal(0, 0.002, (seen.sum(), 3))
    commanded = turned(random.standard_normal(3), 3.0, random.normal(0, 0.006, 3)) @ true
    before = measure_pose_error(commanded, true, np.array([0.06, 0.0, 0.03]))
    found = find_pose(model, points, commanded, EYE, random)
    after = measure_pose_error(found, true, np.array([0.06, 0.0, 0.03]))
    # Points of 2 mm noise, 500 of them on three sides: 0.2 mm each, and a pull to the commanded pose by the damping.
    assert before[0] > 3.0
    assert after[0] < 4.0
    assert after[1] < 3.0


@pytest.mark.parametrize("seed", range(6))
def test_the_pose_is_found_from_farther_away_than_the_box_is_long(seed):
    random = np.random.default_rng(100 + seed)
    way = random.standard_normal(3)
    commanded = turned(random.standard_normal(3), 4.0, 0.13 * way / np.linalg.norm(way))
    model = sample_surface(CORNERS, TRIANGLES, 6000, random)
    seen = ((EYE - model[:, :3]) * model[:, 3:]).sum(axis=1) > 0
    found = find_pose(model, model[seen, :3] + random.normal(0, 0.001, (seen.sum(), 3)), commanded, EYE, random)
    mm, degrees = measure_pose_error(found, np.eye(4), np.array([0.06, 0.0, 0.03]))
    assert mm < 4.0
    assert degrees < 3.0


def test_a_site_far_from_its_origin_changes_nothing():
    random, far = np.random.default_rng(9), np.array([3000.0, -2000.0, 50.0])
    model = sample_surface(CORNERS, TRIANGLES, 4000, random)
    shift = turned((0, 0, 1), 0.0, far)
    seen = ((EYE - model[:, :3]) * model[:, 3:]).sum(axis=1) > 0
    found = find_pose(model, model[seen, :3] + far, shift, EYE + far, random)
    assert measure_pose_error(found, shift, np.zeros(3))[0] < 2.0


def test_too_few_points_are_no_pose():
    model = sample_surface(CORNERS, TRIANGLES, 4000, np.random.default_rng(1))
    assert find_pose(model, model[:30, :3], np.eye(4), EYE, np.random.default_rng(1)) is None


def test_errors_of_poses_are_what_was_put_in():
    true = turned((1, 2, 3), 70.0, (1.0, 2.0, 3.0))
    off = true @ turned((0, 0, 1), 0.01, (0.0, 0.0, 0.0))
    off[:3, 3] += (0.003, 0.0, -0.004)
    mm, degrees = measure_pose_error(off, true, np.zeros(3))
    assert mm == pytest.approx(5.0, rel=1e-9)
    assert degrees == pytest.approx(0.01, rel=1e-6)
    assert measure_pose_error(true @ turned((0, 1, 0), 180.0, (0, 0, 0)), true, np.zeros(3))[1] == pytest.approx(180.0)

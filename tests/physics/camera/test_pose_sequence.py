"""Motion between poses, by paths whose motion is known."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest
from icymoon.physics.camera.pose_sequence import PoseSequence
from icymoon.physics.camera.rotations import from_vector


def sequence(seconds, position, rotation):
    stamps = tuple(Decimal(repr(float(t))) for t in seconds)
    return PoseSequence(np.array(position), np.array(rotation), stamps, tuple(range(1, len(stamps) + 1)))


def test_a_steady_path_has_its_own_motion_at_every_pose():
    """Position p + v t and rotation R exp(w t): v in the camera's axes turns with it, w stays."""
    seconds = np.array([0.0, 0.1, 0.25, 0.3, 0.5])  # uneven
    start, w, v = from_vector(np.array([0.3, -1.0, 0.2])), np.array([0.2, -0.7, 0.4]), np.array([1.0, -2.0, 0.5])
    turned = [start @ from_vector(w * t) for t in seconds]
    velocity, turn = sequence(seconds, [v * t for t in seconds], turned).motion()
    np.testing.assert_allclose(turn, np.tile(w, (5, 1)), atol=1e-9)
    np.testing.assert_allclose(velocity, [r.T @ v for r in turned], atol=1e-9)


def test_an_accelerated_path_is_exact_between_neighbours():
    """The derivative of a parabola, whatever its steps; at the ends the chord to the neighbour."""
    seconds = np.array([0.0, 0.1, 0.4, 0.5])
    path = np.stack([3 * seconds**2, seconds, 0 * seconds], axis=1)
    velocity, _ = sequence(seconds, path, [np.eye(3)] * 4).motion()
    np.testing.assert_allclose(velocity[:, 0], [0.3, 0.6, 2.4, 2.7], atol=1e-9)
    np.testing.assert_allclose(velocity[:, 1], 1.0, atol=1e-9)


def test_no_motion_is_taken_across_a_gap():
    seconds = np.array([0.0, 1.0, 2.0, 9.0, 20.0])
    path = np.stack([seconds**2, 0 * seconds, 0 * seconds], axis=1)
    poses = sequence(seconds, path, [np.eye(3)] * 5)
    assert poses.gaps().tolist() == [False, False, False, False]  # five median steps of 4 s are 20 s
    assert poses.gaps(5.0).tolist() == [False, False, True, True]
    velocity, _ = poses.motion(5.0)
    np.testing.assert_allclose(velocity[:, 0], [1.0, 2.0, 3.0, 0.0, 0.0])


def test_a_single_pose_stands_still():
    velocity, turn = sequence([4.0], [[1.0, 2.0, 3.0]], [np.eye(3)]).motion()
    np.testing.assert_array_equal([velocity, turn], np.zeros((2, 1, 3)))


def test_a_path_may_begin_at_another_pose():
    """As seen from the first camera, all others stay where they are."""
    rotation = [from_vector(np.array([0.1 * k, 0.2, -0.3 * k])) for k in range(3)]
    poses = sequence([0, 1, 2], [[1.0, 2.0, 3.0], [2.0, 2.0, 3.0], [2.0, 4.0, 3.5]], rotation)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = from_vector(np.array([1.0, 0.5, -0.2])), [7.0, 8.0, 9.0]
    moved = poses.from_first(pose)
    np.testing.assert_allclose(moved.position_m[0], pose[:3, 3])
    np.testing.assert_allclose(moved.rotation[0], pose[:3, :3], atol=1e-12)
    for k in range(3):
        for each in (poses, moved):
            seen = each.rotation[0].T @ (each.position_m[k] - each.position_m[0])
            np.testing.assert_allclose(seen, rotation[0].T @ (poses.position_m[k] - poses.position_m[0]), atol=1e-12)
            np.testing.assert_allclose(each.rotation[0].T @ each.rotation[k], rotation[0].T @ rotation[k], atol=1e-12)


def test_a_constant_rate_takes_the_place_of_stamps():
    poses = sequence([5, 5, 5], np.zeros((3, 3)), [np.eye(3)] * 3).at_rate(3.0)
    assert poses.stamp == (Decimal(0), Decimal("0.333333333"), Decimal("0.666666667"))
    assert poses.every(2).line == (1, 3)


@pytest.mark.parametrize(("world", "up"), [(np.eye(3), 3.0), (np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]), -3.0)])
def test_a_world_of_other_axes_and_origin(world, up):
    placed = sequence([0], [[11.0, 22.0, 33.0]], [np.eye(3)]).placed(world, np.array([10.0, 20.0, 30.0]))
    assert placed.position_m[0, 2] == up
    assert sorted(placed.position_m[0, :2]) == [1.0, 2.0]
    np.testing.assert_array_equal(placed.rotation[0], world)

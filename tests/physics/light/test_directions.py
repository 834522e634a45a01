"""Directions against the compass."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.light.directions import camera_angles, camera_axes, direction_toward


@given(st.floats(-360, 360), st.floats(-90, 90))
def test_camera_axes_are_a_rotation_that_looks_where_it_is_told(heading, pitch):
    axes = camera_axes(heading, pitch)
    assert np.allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.allclose(axes[:, 2], direction_toward(heading, -pitch))
    assert axes[2, 0] == 0.0  # x right is level
    assert axes[2, 1] <= 1e-12  # y down is down


@given(st.floats(-360, 360), st.floats(-90, 90), st.floats(-180, 180))
def test_angles_of_axes_give_the_axes(heading, pitch, roll):
    axes = camera_axes(heading, pitch, roll)
    assert np.allclose(camera_axes(*camera_angles(axes)), axes, atol=1e-10)


def test_a_roll_is_clockwise_as_seen_from_behind():
    level, rolled = camera_axes(30.0, 20.0), camera_axes(30.0, 20.0, 90.0)
    assert np.allclose(rolled[:, 2], level[:, 2])
    assert np.allclose(rolled[:, 0], level[:, 1])  # right is where down was
    assert np.allclose(rolled[:, 1], -level[:, 0])


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_a_camera_that_looks_straight_down_or_up_has_no_roll(pitch):
    heading, down, roll = camera_angles(camera_axes(40.0, pitch, 25.0))
    assert down == pytest.approx(pitch)
    assert roll == pytest.approx(0.0, abs=1e-9)
    assert heading == pytest.approx(40.0 + math.copysign(25.0, pitch))


def test_directions_by_the_compass():
    assert np.allclose(direction_toward(0, 0), [0, 1, 0])
    assert np.allclose(direction_toward(90, 0), [1, 0, 0])
    assert np.allclose(direction_toward(123, 90), [0, 0, 1])

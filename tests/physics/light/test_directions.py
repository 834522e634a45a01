"""Directions against the compass."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.light.directions import camera_axes, direction_toward


@given(st.floats(-360, 360), st.floats(-90, 90))
def test_camera_axes_are_a_rotation_that_looks_where_it_is_told(heading, pitch):
    axes = camera_axes(heading, pitch)
    assert np.allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.allclose(axes[:, 2], direction_toward(heading, -pitch))
    assert axes[2, 0] == 0.0  # x right is level
    assert axes[2, 1] <= 1e-12  # y down is down


def test_directions_by_the_compass():
    assert np.allclose(direction_toward(0, 0), [0, 1, 0])
    assert np.allclose(direction_toward(90, 0), [1, 0, 0])
    assert np.allclose(direction_toward(123, 90), [0, 0, 1])

"""Gravity, and the slopes that strength holds against it."""

import pytest
from icymoon.physics.gravity.standing_slopes import GRAVITY_M_S2, critical_height_m


def test_gravity_is_that_of_the_moons():
    # Rounded values of any table: 1.315 and 0.113 m/s².
    assert GRAVITY_M_S2["EUROPA"] == pytest.approx(1.315, abs=0.002)
    assert GRAVITY_M_S2["ENCELADUS"] == pytest.approx(0.113, abs=0.001)


def test_a_wall_of_a_third_of_a_metre_needs_little_cohesion():
    # 4 · 24 Pa · tan 64° / (500 kg/m³ · 1.315 m/s²) = 0.30 m on Europa; 2 Pa do on Enceladus.
    assert critical_height_m(24.0, 38.0, 500.0, GRAVITY_M_S2["EUROPA"]) == pytest.approx(0.30, abs=0.005)
    assert critical_height_m(2.0, 38.0, 500.0, GRAVITY_M_S2["ENCELADUS"]) == pytest.approx(0.29, abs=0.005)


def test_nothing_stands_without_cohesion():
    assert critical_height_m(0.0, 38.0, 500.0, 1.3) == 0.0

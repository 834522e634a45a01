"""Frost of falling grains: laws of what falls and holds, and grains thrown one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.surfaces.fallen_frost import fallen_share, find_origin
from icymoon.settings.description import defaults
from icymoon.settings.topics.surfaces import SurfaceSettings
from icymoon.support.arrays import Array


def frosted(**changes: float | str) -> SurfaceSettings:
    return defaults().surface | {"frost_from": "FALL", "frost_share": 0.6, **changes}


def facing(slope_deg: Array | float, azimuth_deg: float = 0.0) -> Array:
    """Normals (n, 3) of surfaces that slope down toward a direction."""
    slope = np.radians(np.atleast_1d(slope_deg))
    azimuth = math.radians(azimuth_deg)
    return np.stack([np.sin(slope) * math.sin(azimuth), np.sin(slope) * math.cos(azimuth), np.cos(slope)], axis=1)


@given(
    st.floats(0.01, 1.0), st.floats(0.0, 80.0), st.floats(-360.0, 360.0), st.floats(15.0, 90.0), st.floats(0.0, 360.0)
)
def test_walls_and_overhangs_have_none_and_the_open_plain_has_its_share(share, tilt, origin, hold, azimuth):
    surface = frosted(frost_share=share, frost_tilt_deg=tilt, frost_azimuth_deg=origin, frost_hold_deg=hold)
    steep = fallen_share(surface, facing(np.linspace(90.0, 180.0, 7), azimuth))
    assert steep == pytest.approx(0.0, abs=1e-12)
    assert fallen_share(surface, facing(0.0))[0] == pytest.approx(min(share, 0.9999), rel=1e-12)
    everywhere = fallen_share(surface, facing(np.linspace(0.0, 90.0, 50), azimuth))
    assert ((everywhere >= 0.0) & (everywhere <= 1.0)).all()


def test_straight_down_a_steeper_slope_has_less():
    shares = fallen_share(frosted(), facing(np.linspace(0.0, 90.0, 200)))
    assert (np.diff(shares) <= 1e-15).all()
    assert shares[0] == pytest.approx(0.6)
    assert (fallen_share(frosted(frost_hold_deg=30.0), facing(45.01)) == 0.0).all()


def test_a_slope_toward_the_origin_gets_more_than_one_away_from_it():
    surface = frosted(frost_tilt_deg=30.0, frost_azimuth_deg=90.0)
    toward, away = (fallen_share(surface, facing(20.0, azimuth))[0] for azimuth in (90.0, 270.0))
    assert toward > 0.6 > away > 0.0
    assert fallen_share(surface, facing(65.0, 270.0), 1.0)[0] == 0.0


def test_ground_in_the_lee_of_other_ground_has_none_and_half_the_grains_leave_more_free():
    level = facing(0.0)
    assert fallen_share(frosted(), level, 0.0)[0] == 0.0
    assert 1.0 - fallen_share(frosted(), level, 0.5)[0] == pytest.approx(math.sqrt(0.4))


def test_grains_thrown_one_by_one_cover_the_share_of_the_law():
    """Discs of equal size on parallel paths, thrown at random on a tilted plate: the share of its cells that any disc
    hits. On level ground the same number for the same area of the path covers the stated share."""
    random = np.random.default_rng(5)
    surface = frosted(frost_share=0.5, frost_tilt_deg=40.0, frost_azimuth_deg=30.0, frost_hold_deg=90.0)
    origin = np.array(find_origin(surface))
    for slope, azimuth in ((0.0, 0.0), (25.0, 30.0), (30.0, 210.0)):
        normal = facing(slope, azimuth)[0]
        along = np.cross(normal, [0.3, -0.7, 0.2])
        along /= np.linalg.norm(along)
        axes = np.stack([along, np.cross(normal, along)])
        # Grains per square metre of the plate, each with an area of 1e-4 m²: on level ground tau is ln 2.
        per_m2 = math.log(2.0) / 1e-4 / origin[2] * max(normal @ origin, 0.0)
        places = random.uniform(0.0, 1.0, (random.poisson(per_m2), 2))
        hit = np.zeros((100, 100), bool)
        hit[tuple((places * 100).astype(int).T)] = True  # a grain covers the cell of 1 cm that it falls on
        expected = -math.expm1(-per_m2 * 1e-4)
        assert hit.mean() == pytest.approx(expected, abs=0.02)  # 1e4 cells: a standard deviation of 0.005
        held = np.clip(normal[2] / math.cos(math.radians(75.0)), 0.0, 1.0)
        holds = held * held * (3.0 - 2.0 * held)
        assert fallen_share(surface, normal[None])[0] == pytest.approx(expected * holds, rel=1e-9)
        assert abs(axes @ normal).max() < 1e-12

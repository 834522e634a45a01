"""The skyline against hills whose elevation is known, and what Build says of a hidden Sun."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from icymoon.physics.terrain import skyline
from icymoon.physics.terrain.skyline import advise_on_skyline, find_skyline_deg
from icymoon.physics.terrain.terrain import Terrain
from icymoon.settings.description import defaults, merged

FLAT = 1e12  # a body's radius that falls away by nothing


@dataclass(frozen=True)
class _Wall(Terrain):
    """A wall ``height_m`` high, ``away_m`` north of the origin, on level ground 2 m up."""

    size_m: float = 20.0
    base: Any = None
    height_m: float = 50.0
    away_m: float = 300.0

    def heights(self, x_m, y_m, shortest_m=0.0):
        return 2.0 + np.where(np.asarray(y_m) > self.away_m, self.height_m, 0.0)


def test_a_wall_is_as_high_as_it_is():
    # The wall is met within a step of 1 % of its distance.
    def seen_deg(north_m, azimuth_deg):
        return find_skyline_deg(_Wall(), (0.0, north_m), azimuth_deg, FLAT, 1e4)

    assert seen_deg(0.0, 0.0) == pytest.approx(math.degrees(math.atan(50 / 300)), rel=0.01)
    assert seen_deg(150.0, 0.0) == pytest.approx(math.degrees(math.atan(50 / 150)), rel=0.01)
    assert seen_deg(0.0, 180.0) == pytest.approx(0.0, abs=1e-6)
    # At 60 degrees from north the ray meets the wall at twice the distance.
    assert seen_deg(0.0, 60.0) == pytest.approx(math.degrees(math.atan(50 / 600)), rel=0.01)


def test_the_body_falls_away_and_the_ground_ends():
    radius = 2.5e5
    fallen = 50.0 - 3000.0**2 / (2 * radius)
    assert find_skyline_deg(_Wall(away_m=3000.0), (0.0, 0.0), 0.0, radius, 1e5) == pytest.approx(
        math.degrees(math.atan(fallen / 3000)), rel=0.01
    )
    assert find_skyline_deg(_Wall(away_m=3000.0), (0.0, 0.0), 0.0, radius, 2000.0) < 0.0


@pytest.mark.parametrize(
    ("elevation_deg", "begins"),
    [
        (5.0, "Hills hide the Sun from the site: it is 5.0 degrees above the horizon and the skyline there 9.4;"),
        (9.4, "Hills hide a part of the Sun from the site"),
        (15.0, None),
        (-5.0, None),
    ],
)
def test_what_is_said_of_a_hidden_sun(monkeypatch, elevation_deg, begins):
    monkeypatch.setattr(skyline, "make_terrain", lambda settings, seed, with_skirts: _Wall())
    settings = merged(defaults(), {"hills": {"rms_slope_deg": 10.0}, "terrain": {"body_radius_m": 1e8}})
    up = math.radians(elevation_deg)
    said = advise_on_skyline(settings, np.array([0.0, math.cos(up), math.sin(up)]), 0.1)
    assert bool(said) == bool(begins)
    assert not begins or said[0].startswith(begins)


@pytest.mark.parametrize(
    "changes", [{"hills": {"rms_slope_deg": 0.0}}, {"mesh": {"kind": "GRID"}}, {"source": {"kind": "MESH"}}]
)
def test_ground_without_hills_is_not_asked(monkeypatch, changes):
    monkeypatch.setattr(skyline, "make_terrain", lambda settings, seed, with_skirts: pytest.fail("asked"))
    settings = merged(defaults(), {"hills": {"rms_slope_deg": 10.0}}, changes)
    assert advise_on_skyline(settings, np.array([0.0, 1.0, 0.01]), 0.1) == []

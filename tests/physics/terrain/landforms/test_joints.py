"""Walls of jointed ice against what brittle ice does: it breaks along planes, behind the edge, and spalls at rims."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.terrain.landforms import MAKERS
from icymoon.physics.terrain.landforms.joints import JointedWall
from icymoon.physics.terrain.landforms.landform import broken_step
from icymoon.settings.description import defaults, merged

_WALL = JointedWall(foot=0.2, width=0.2, height=1.5, faces=1.0, spalls=(0.5, 0.2))
_STEP = 1.0 / 160
_KEYS = (11, 12, 13)


def _wall(function, step=_STEP):
    """A step over a straight edge along x: its heights by row (behind the edge) and column (along it)."""
    along, behind = np.arange(0.0, 8.0, step)[None, :], np.arange(0.0, 1.6, step)[:, None]
    along, behind = np.broadcast_arrays(along, behind)
    return function(behind, along, behind)


def _is_plane(heights):
    """Whether the places on a wall, without those beside its ends, lie in a plane with their four neighbours."""
    bend = sum(
        (np.abs(np.roll(heights, 1, k) + np.roll(heights, -1, k) - 2.0 * heights) for k in (0, 1)), start=np.zeros(())
    )
    wall = (heights > 0.02) & (heights < 0.98)
    return bend[1:-1, 1:-1][wall[1:-1, 1:-1]] < 1e-9


def test_faces_of_jointed_walls_are_planes_and_chips_of_broken_ones_are_not():
    """Points that lie in no plane are beside a corner, and corners are lines: half the step has half their share."""

    def bent(wall, step):
        return 1.0 - _is_plane(_wall(wall, step)).mean()

    jointed, chipped = (
        bent(wall, _STEP / 2) / bent(wall, _STEP)
        for wall in (
            lambda d, u, v: _WALL.step(d, u, v, _KEYS),
            lambda d, u, v: broken_step(d, u, v, 0.2, 0.2, (0.2, 0.4, 0.65), _KEYS),
        )
    )
    assert jointed == pytest.approx(0.5, abs=0.1)
    assert chipped > 0.75


def test_jointed_walls_stand_behind_the_straight_edge_and_leave_the_ground_behind_whole():
    heights = _wall(lambda d, u, v: _WALL.step(d, u, v, _KEYS))
    straight = _wall(lambda d, u, v: np.clip((d - 0.2) / 0.2, 0.0, 1.0))
    assert (heights <= straight + 1e-12).all()
    assert (heights[: int(0.2 / _STEP)] == 0.0).all()
    # Faces stand back by at most 0.45 of their width. Spalls take at most 0.4 of their length, tilted by half to
    # either axis over a cell, no point of which is farther than 2**0.5 from its middle.
    reach = 0.4 + 0.45 + 0.5 * (0.4 + 0.5 * 2.0)
    rows = np.arange(len(heights)) * _STEP
    assert (heights[rows > reach] == 1.0).all()
    assert (heights < straight).mean() > 0.1


def test_faces_are_turned_and_rims_are_spalled_as_stated():
    heights = _wall(lambda d, u, v: _WALL.step(d, u, v, _KEYS))
    flat = np.zeros(heights.shape, bool)
    wall = (heights > 0.02) & (heights < 0.98)
    flat[1:-1, 1:-1][wall[1:-1, 1:-1]] = _is_plane(heights)
    back, along = np.gradient(heights * _WALL.height, _STEP)
    slopes, turned = np.hypot(back, along)[flat], np.degrees(np.arctan2(along, back))[flat]
    # A wall of 1.5 over 0.2 has a slope of 7.5, which a face turned by half to either axis keeps to a half. What spalls
    # leave is gentler: 2.14, tilted by half to either axis.
    joint = slopes > 3.7
    assert 0.2 < np.mean(~joint) < 0.6
    assert slopes[~joint].max() < 2.14 * 1.5 * math.sqrt(2.0)
    # Slopes on the map toward either axis are even in -0.5 to 0.5: their deviation is 16 degrees.
    assert turned[joint].std() == pytest.approx(math.degrees(0.5 / math.sqrt(3)), rel=0.4)
    assert abs(np.mean(turned[joint])) < 8.0


@pytest.mark.parametrize(
    ("topic", "asked", "floor", "face", "cell"),
    [
        ("cracks", {"depth_m": 0.5, "width_m": 0.4}, 0.65 * 0.4, 3.0 * 0.2, 3.0),
        ("chaos", {"relief_m": 0.5, "plate_share": 1.0, "gap_m": 0.4, "tilt_deg": 0.0}, 0.4, 0.3 * 4.0, 4.0),
    ],
)
def test_floors_between_jointed_walls_are_wider_than_stated_by_what_broke_off(topic, asked, floor, face, cell):
    """Cells of width 1 have edges of length 2 per area. Faces stand back by 0.45 of their width."""
    settings = merged(defaults(), {topic: asked | {"edges": "JOINTED", "plate_m": cell}})[topic]
    made = MAKERS[topic](settings, np.random.default_rng(1), 20.0)
    assert made is not None
    assert made.walls is not None
    axis = np.linspace(-15.0, 15.0, 601)
    heights = made.heights(axis[None, :], axis[:, None], 0.0)
    # Fragments on the floors of cracks are lower than half of the walls nearly everywhere.
    low = np.mean(heights < heights.min() + 0.25) if topic == "cracks" else np.mean(heights == 0.0)
    assert floor * 2.0 / cell < low < (floor + 2.0 * 0.45 * face) * 2.0 / cell

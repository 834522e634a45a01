"""What the eyes of a rig can see of points and facets."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.rig.focal_length import focal_px
from icymoon.physics.rig.seen_points import find_seen_facets, find_sides_passed, is_in_view
from icymoon.settings import description
from icymoon.settings.topics.camera import RigSettings


def described(**rig: float) -> RigSettings:
    return description.merged(description.defaults(), description.check({"rig": rig}, "test")).rig


def test_points_are_seen_from_the_place_that_the_image_shows():
    rig = described(pitch_deg=0.0, heading_deg=90.0)
    half = rig.sensor_width_mm / rig.focal_length_mm / 2
    east = np.full(5, 10.0)
    north = -east * half * np.array([-1.3, -0.9, 0.0, 0.9, 1.3])  # south is to the right of east
    assert is_in_view(rig, east, north, np.zeros(5)).tolist() == [False, True, True, True, False]
    assert not is_in_view(rig, -east, north, np.zeros(5)).any()


def test_a_rolled_rig_sees_what_its_axes_say():
    """A wide image on its side is a high one."""
    level, rolled = (described(pitch_deg=0.0, heading_deg=0.0, baseline_m=1e-3, roll_deg=roll) for roll in (0.0, 90.0))
    half = level.sensor_width_mm / level.focal_length_mm / 2
    beside, above = np.array([9.5 * half]), np.zeros(1)
    assert is_in_view(level, beside, np.array([10.0]), above).all()
    assert not is_in_view(level, above, np.array([10.0]), beside).any()
    assert is_in_view(rolled, above, np.array([10.0]), beside).all()
    assert not is_in_view(rolled, beside, np.array([10.0]), above).any()


@pytest.mark.parametrize("rig", [{}, {"toe_in_deg": 3.0}, {"principal_x_px": 60.0, "principal_y_px": -40.0}])
def test_every_point_that_either_eye_projects_into_its_frame_is_seen(rig):
    """By the pinhole camera alone: u = f X/Z + cx, for an eye that is turned in and shifted by the baseline."""
    rig = described(**rig)
    right, down, depth = np.random.default_rng(5).uniform(-4.0, 4.0, (3, 20000))
    seen = np.zeros(len(right), bool)
    for shift, sign in ((0.0, 1.0), (rig.baseline_m, -1.0)):
        turn = math.radians(sign * rig.toe_in_deg)  # the left eye turns to the right
        across = (right - shift) * math.cos(turn) - depth * math.sin(turn)
        ahead = (right - shift) * math.sin(turn) + depth * math.cos(turn)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = focal_px(rig) * across / ahead + rig.width_px / 2 + rig.principal_x_px
            v = focal_px(rig) * down / ahead + rig.height_px / 2 + rig.principal_y_px
        seen |= (ahead > 0) & (u >= 0) & (u <= rig.width_px) & (v >= 0) & (v <= rig.height_px)
    inside = ~find_sides_passed(rig, right, down, depth).any(axis=-1)
    assert inside[seen].all()
    assert seen.sum() > 0.5 * inside.sum()  # and not much more


def test_a_facet_of_which_any_point_is_seen_is_found():
    """Also one that is larger than the image, of which no corner is seen."""
    rig, random = described(), np.random.default_rng(6)
    corners = random.uniform(-6.0, 6.0, (3000, 3, 3))
    passed = find_sides_passed(rig, *corners.reshape(-1, 3).T)
    found = find_seen_facets(passed, 3 * np.arange(3000), np.arange(9000))
    weights = random.dirichlet((0.6, 0.6, 0.6), 400)
    points = np.einsum("pk,nkd->npd", weights, corners).reshape(-1, 3)
    seen = (~find_sides_passed(rig, *points.T).any(axis=-1)).reshape(3000, 400).any(axis=1)
    assert found[seen].all()
    by_a_corner = (~passed.any(axis=-1)).reshape(3000, 3).any(axis=1)
    assert (seen & ~by_a_corner).any()
    assert not found.all()


def test_a_mesh_without_facets_has_none_that_are_seen():
    assert find_seen_facets(np.zeros((0, 5), bool), np.zeros(0, int), np.zeros(0, int)).shape == (0,)

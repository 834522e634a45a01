"""Solids of which the lander is made: closed, turned outward, of the volume that they should have."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.arm.keypoints import describe_keypoints
from icymoon.physics.arm.kinematics import forward_kinematics, make_rigid_transform
from icymoon.physics.arm.lander_arm import list_keypoints, make_solids
from icymoon.physics.arm.lander_solids import BODY, LEGS, MAST, make_body_capsules, make_head
from icymoon.physics.arm.parametric_arm import find_real_angles_rad, make_parametric_arm
from icymoon.physics.arm.solids import (
    Solid,
    join_solids,
    make_ball,
    make_box,
    make_lathe,
    make_prism,
    make_rod,
    transform_solid,
)
from icymoon.settings.description import defaults, merged
from icymoon.support.arrays import Array


def volume_m3(solid: Solid) -> float:
    """By the divergence theorem, which holds for closed surfaces that are turned outward."""
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def area_vector(solid: Solid) -> Array:
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    return np.asarray(np.cross(b - a, c - a).sum(axis=0) / 2)


SOLIDS = {
    "box": make_box("metal", (0.3, 0.2, 0.1), (1.0, 2.0, 3.0)),
    "ball": make_ball("metal", (1.0, 0.0, 0.0), 0.2),
    "rod": make_rod("metal", (0.0, 0.0, 0.0), (1.0, 2.0, 0.5), 0.1, 0.05),
    "prism": make_prism("metal", [(0, 0), (1, 0), (1, 1), (0, 1)], 0.0, 0.5, 0.05, 0.8),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_turned_outward(name):
    assert np.abs(area_vector(SOLIDS[name])).max() < 1e-12  # a closed surface has none
    assert volume_m3(SOLIDS[name]) > 0


def test_volumes_are_those_of_their_formulas():
    assert volume_m3(make_box("metal", (0.3, 0.2, 0.1), bevel_m=1e-6)) == pytest.approx(0.006, rel=1e-4)
    sides = 40
    polygon = sides / 2 * math.sin(2 * math.pi / sides)  # area of a ring of 40 corners on the unit circle
    tube = make_lathe("metal", [(0.0, 0.0), (0.0, 0.1), (2.0, 0.1), (2.0, 0.0)], sides)
    assert volume_m3(tube) == pytest.approx(2.0 * polygon * 0.01, rel=1e-12)
    cone = make_lathe("metal", [(0.0, 0.0), (0.0, 0.3), (1.0, 0.0)], sides)
    assert volume_m3(cone) == pytest.approx(polygon * 0.09 / 3, rel=1e-12)
    assert volume_m3(make_prism("metal", [(0, 0), (2, 0), (2, 1), (0, 1)], 1.0, 1.5)) == pytest.approx(1.0, rel=1e-12)


def test_moving_and_joining_keep_volumes():
    solid = make_box("black", (0.3, 0.2, 0.1))
    turned = transform_solid(
        solid, make_rigid_transform(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), (5.0, 6.0, 7.0))
    )
    both = join_solids([solid, turned])
    assert volume_m3(both) == pytest.approx(2 * volume_m3(solid), rel=1e-9)
    assert len(both.materials) == len(both.triangles) == len(both.smooth)


def test_the_lander_has_a_solid_for_each_link_whose_vertices_are_near_its_capsules():
    settings = defaults()
    found = make_solids(settings)
    assert list(found) == [BODY, MAST, *LEGS, "turret", "upper_arm", "forearm", "hand", "scoop"]
    for solid in found.values():
        assert np.isfinite(solid.vertices).all()
        assert solid.triangles.max() < len(solid.vertices)
    tip = found["scoop"].vertices[:, 0].max()
    assert tip == pytest.approx(settings.arm.scoop_length_m, rel=0.05)


def test_the_pads_stand_in_the_ground_under_them():
    settings = merged(defaults(), {"lander": {"pad_sink_m": 0.05}})
    level, raised = make_solids(settings), make_solids(settings, (0.3, 0.0))
    assert [level[leg].vertices[:, 2].min() for leg in LEGS] == pytest.approx([-0.05, -0.05], abs=1e-6)
    assert [raised[leg].vertices[:, 2].min() for leg in LEGS] == pytest.approx([0.25, -0.05], abs=1e-6)
    assert [np.sign(level[leg].vertices[:, 1].mean()) for leg in LEGS] == [1.0, -1.0]


def test_the_housing_of_the_cameras_is_behind_both_eyes():
    assert make_head(defaults()).vertices[:, 2].max() < -0.01


@pytest.mark.parametrize("height_m", [0.3, 1.0, 2.0])
def test_no_part_of_the_lander_is_around_an_eye(height_m):
    settings = merged(defaults(), {"rig": {"height_m": height_m}})
    found = make_solids(settings)
    assert (MAST in found) == (height_m > settings.lander.deck_height_m + 0.27)
    still = np.concatenate([found[part].vertices for part in (BODY, MAST) if part in found])
    mast = still[(np.abs(still[:, 1]) < 0.1) & (np.abs(still[:, 0] + 0.09) < 0.06)]
    assert mast[:, 2].max(initial=0.0) <= max(height_m, settings.lander.deck_height_m + 0.3)
    assert len(make_body_capsules(settings)) > 5


def test_keypoints_are_where_a_pinhole_puts_them_and_hidden_where_something_is_nearer():
    settings = defaults()
    links = {
        **dict.fromkeys((BODY, *LEGS), np.eye(4)),
        **dict(
            zip(
                make_parametric_arm(settings).links,
                forward_kinematics(make_parametric_arm(settings), find_real_angles_rad(settings.arm)),
                strict=True,
            )
        ),
    }
    down = make_rigid_transform(np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), (1.0, 0.2, 5.0))
    matrix = np.array([[100.0, 0.0, 160.0], [0.0, 100.0, 120.0], [0.0, 0.0, 1.0]])
    far, near = np.full((240, 320), 9.0), np.full((240, 320), 1.0)
    found = {
        entry["name"]: entry
        for entry in describe_keypoints(
            settings, [0.0, 0.0], links, {"left": down, "right": down}, matrix, {"left": far, "right": near}
        )
    }
    assert set(found) == {name for name, *_ in list_keypoints(settings)}
    tip = found["tip"]
    x, y, z = tip["position_m"]
    # Straight down from (1, 0.2, 5): to the right is -y, down the image is -x.
    assert tip["left_px"] == pytest.approx([160 + 100 * (0.2 - y) / (5 - z), 120 + 100 * (1 - x) / (5 - z)])
    assert (tip["visible_left"], tip["visible_right"]) == (True, False)


def test_keypoints_behind_an_eye_have_no_pixel():
    settings = defaults()
    links = {link: np.eye(4) for link in (BODY, *LEGS, *make_parametric_arm(settings).links)}
    away = make_rigid_transform(place=(0.0, 0.0, 9.0))  # looks up, all is below
    found = describe_keypoints(settings, [0.0, 0.0], links, {"left": away}, np.eye(3), {"left": np.zeros((2, 2))})
    assert all(entry["left_px"] is None and not entry["visible_left"] for entry in found)

"""The lander in a built scene: where its links are, its labels, and that it follows the settings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from built_scenes import everything
from edits import TINY
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.change_scene import adapt_scene
from icymoon.nodes.datablocks.fingerprint import find_built_objects
from icymoon.nodes.lander.contact import find_contact
from icymoon.nodes.lander.objects import ROLES, find_link_poses
from icymoon.support.labels import FIRST_LINK_INSTANCE, LANDER
from rendering import complete, empty_scene

WITH: dict[str, Any] = {**TINY, "lander": {"kind": "PARAMETRIC"}}


def turned(**arm: float) -> dict[str, Any]:
    return {**WITH, "arm": arm}


def links(built: scenes.Built) -> dict[str, Any]:
    return {role: item for role, item in find_built_objects(built.collection).items() if role in ROLES.values()}


def check_poses(built: scenes.Built, settings: Any) -> None:
    there = links(built)
    assert set(there) == {ROLES[link] for link in find_link_poses(settings, built.site_m)}
    for link, pose in find_link_poses(settings, built.site_m).items():
        # Blender stores single precision: 1e-7 of a few metres, taken apart into location and rotation.
        assert np.abs(np.array(there[ROLES[link]].matrix_basis) - pose).max() < 5e-6


def test_links_are_where_the_settings_put_them_with_labels_of_their_own():
    built = scenes.build_scene(empty_scene(), complete(WITH))
    check_poses(built, built.settings)
    assert sorted(item.pass_index for item in links(built).values()) == [FIRST_LINK_INSTANCE + k for k in range(10)]
    assert {material.pass_index for item in links(built).values() for material in item.data.materials} == {LANDER}
    # Where the view shows colours of vertices, as decisions need it, an object without them has its own; the default
    # is white, which outshines the ground.
    assert {tuple(np.round(item.color, 3)) for item in links(built).values()} == {(0.2, 0.2, 0.2, 1.0)}
    assert not built.edited


def test_an_angle_moves_the_arm_and_keeps_the_ground_and_its_meshes():
    built = scenes.build_scene(empty_scene(), complete(WITH))
    ground = built.terrain.data.session_uid
    meshes = {role: item.data.session_uid for role, item in links(built).items()}
    settings = complete(turned(elbow_deg=-40.0, yaw_offset_deg=2.0))
    assert not preview.show_settings(built, settings, 33)
    check_poses(built, settings)
    assert built.terrain.data.session_uid == ground
    assert {role: item.data.session_uid for role, item in links(built).items()} == meshes
    assert not built.preview
    assert not built.edited
    assert built.settings == settings


def test_a_size_builds_the_lander_again_and_the_choice_removes_it():
    scene = empty_scene()
    before = everything()
    built = scenes.build_scene(scene, complete(TINY))
    without = everything()
    settings = complete({**WITH, "lander": {"kind": "PARAMETRIC", "deck_width_m": 0.8}})
    preview.show_settings(built, settings, 33)
    check_poses(built, settings)
    preview.show_settings(built, complete(TINY), 33)
    assert links(built) == {}
    assert everything() == without
    scenes.clear_scene(scene)
    assert everything() == before


def test_the_lander_moves_with_the_rig():
    built = scenes.build_scene(empty_scene(), complete(WITH))
    settings = complete({**WITH, "rig": {"x_m": 0.2, "heading_deg": 30.0}})
    preview.show_settings(built, settings, 33)
    check_poses(built, settings)


def test_a_joint_beyond_its_limit_is_a_note_and_the_arm_stays():
    built = scenes.build_scene(empty_scene(), complete(WITH))
    shown = built.settings
    preview.show_settings(built, complete(turned(yaw_deg=170.0)), 33)
    assert "limits" in preview.read_notes(built.scene)[0]
    check_poses(built, shown)


def test_a_link_moved_by_hand_is_an_edit():
    built = scenes.build_scene(empty_scene(), complete(WITH))
    links(built)[ROLES["scoop"]].location.x += 0.1
    assert built.edited_parts("lander") == {"lander scoop object"}
    preview.show_settings(built, complete(turned(yaw_deg=10.0)), 33)
    assert "edited by hand" in preview.read_notes(built.scene)[0]


def test_a_plan_that_turns_joints_keeps_the_scene():
    built, _ = adapt_scene(None, complete(WITH))
    settings = complete(turned(shoulder_deg=40.0))
    built, kept = adapt_scene(built, settings)
    assert kept
    check_poses(built, settings)


@pytest.mark.parametrize(("shoulder_deg", "reached"), [(30.0, False), (-25.0, True)])
def test_an_arm_that_is_lowered_reaches_the_ground_and_there_is_advice(shoulder_deg, reached):
    level = {**turned(shoulder_deg=shoulder_deg), "terrain": {"rms_slope_deg": 0.0, "resolution": 33, "size_m": 10.0}}
    built = scenes.build_scene(empty_scene(), complete(level))
    contact = find_contact(built.settings, built.site_m, built.terrain)
    assert contact.reached_ground == reached
    assert bool([text for text in built.warnings if "inside the ground" in text]) == reached

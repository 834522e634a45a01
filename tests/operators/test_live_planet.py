"""A slider of the Sun sets values in the nodes of planet and planetshine, and comes to what a build makes."""

from __future__ import annotations

import bpy
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks.fingerprint import TAG, read_parts
from icymoon.nodes.tree.builder import Tree
from icymoon.nodes.tree.followed_tree import FollowedTree, OtherTreeError
from icymoon.settings.blender import scene_properties


@pytest.fixture
def planetary(small: bpy.types.Scene) -> bpy.types.Scene:
    """The small scene, built under a planet that shines."""
    light = small.icymoon.light
    light.planet, light.planet_azimuth_deg, light.planet_elevation_deg, light.planet_least = True, 30.0, 30.0, 0.0
    scenes.build_scene(small, scene_properties.read_settings(small.icymoon))
    return small


def find(scene: bpy.types.Scene, role: str) -> bpy.types.Object:
    return next(item for item in scenes.find_built(scene).collection.all_objects if item.get(TAG) == role)


def show(scene: bpy.types.Scene) -> scenes.Built:
    """Show the settings as a slider does."""
    built = scenes.find_built(scene)
    preview.show_settings(built, scene_properties.read_settings(scene.icymoon), 33)
    return built


def build_afresh(scene: bpy.types.Scene) -> dict[str, str]:
    scenes.clear_scene(scene)
    return read_parts(scenes.build_scene(scene, scene_properties.read_settings(scene.icymoon)).collection)


@pytest.mark.parametrize("face", ["PLAIN", "JUPITER", "SATURN"])
def test_the_nodes_stay_and_have_the_values_of_a_build(planetary, face):
    planetary.icymoon.light.planet_face = face
    show(planetary)
    before = find(planetary, "planet").data.materials[0].session_uid, find(planetary, "planetshine").data.session_uid
    planetary.icymoon.light.sun_elevation_deg, planetary.icymoon.light.sun_azimuth_deg = 21.0, 250.0
    built = show(planetary)
    after = find(planetary, "planet").data.materials[0].session_uid, find(planetary, "planetshine").data.session_uid
    assert after == before
    assert not built.edited
    shown = read_parts(built.collection)
    assert shown == build_afresh(planetary)


def test_another_face_gets_nodes_of_its_own(planetary):
    before = find(planetary, "planet").data.materials[0].session_uid
    planetary.icymoon.light.planet_face = "JUPITER"
    built = show(planetary)
    assert find(planetary, "planet").data.materials[0].session_uid != before
    shown = read_parts(built.collection)
    assert shown == build_afresh(planetary)


def test_nodes_that_were_edited_by_hand_are_built_anew(planetary):
    material = find(planetary, "planet").data.materials[0]
    material.node_tree.nodes["Limb"].mute = True  # no value that a builder sets
    before = material.session_uid
    planetary.icymoon.light.sun_elevation_deg = 21.0
    built = show(planetary)
    assert find(planetary, "planet").data.materials[0].session_uid != before
    shown = read_parts(built.collection)
    assert shown == build_afresh(planetary)


def fill(tree: Tree, factor: float, *, longer: bool = False, other: bool = False) -> None:
    value = tree.math("ADD" if not other else "SUBTRACT", "Sum", factor, 2.0)
    tree.emission("Shine", (1.0, 0.5, 0.0, 1.0), tree.math("MULTIPLY", "More", value, 3.0) if longer else value)
    tree.arrange()


def make_tree(**options: bool) -> bpy.types.NodeTree:
    tree = bpy.data.node_groups.new("Try", "ShaderNodeTree")
    fill(Tree(tree), 1.0, **options)
    return tree


def test_a_followed_tree_has_the_new_values():
    tree = make_tree()
    fill(FollowedTree(tree), 0.1)
    assert tree.nodes["Sum"].inputs[0].default_value == pytest.approx(0.1)
    assert len(tree.nodes) == 2
    bpy.data.node_groups.remove(tree)


@pytest.mark.parametrize(
    ("there", "wanted"),
    [({}, {"longer": True}), ({"longer": True}, {}), ({}, {"other": True})],
    ids=["more nodes", "fewer nodes", "another property"],
)
def test_another_tree_is_told_apart(there, wanted):
    tree = make_tree(**there)
    with pytest.raises(OtherTreeError):
        fill(FollowedTree(tree), 1.0, **wanted)
    bpy.data.node_groups.remove(tree)


def test_another_link_is_told_apart():
    tree = make_tree(longer=True)
    tree.links.new(tree.nodes["Sum"].outputs[0], tree.nodes["Shine"].inputs["Strength"])
    with pytest.raises(OtherTreeError):
        fill(FollowedTree(tree), 1.0, longer=True)
    bpy.data.node_groups.remove(tree)

"""A group of shader nodes of the user's multiplies the albedo, survives builds, and makes the scene one by hand."""

from __future__ import annotations

import bpy
import pytest
from icymoon.benchmarks.light.furnace import albedo as furnace
from icymoon.nodes.build_scene import build_scene
from icymoon.nodes.built_scene import find_built
from icymoon.nodes.datablocks.fingerprint import is_stand_in, list_own_nodes
from icymoon.nodes.preview import show_settings
from icymoon.nodes.stored_build import read_build, write_build
from icymoon.nodes.surface.ice_material import build_material
from icymoon.nodes.surface.own_groups import explain_unusable_group
from icymoon.settings.blender import scene_properties
from icymoon.settings.description import check, defaults, merged
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import TERRAIN
from own_groups import make_group

NAME = "Soot"


def ask(scene, name=NAME, **surface):
    """The settings of a scene, with an own group."""
    given = {"surface": {"albedo_group": name, "model": "LAMBERT", **surface}}
    return merged(scene_properties.read_settings(scene.icymoon), check(given, "test"))


def groups_of(built):
    return [node.node_tree for node in list_own_nodes(built.materials)]


@pytest.mark.parametrize(("factor", "counts"), [(0.5, 0.5), (0.0, 0.02), (7.0, 1.0)])
def test_a_white_furnace_measures_albedo_times_factor_within_its_bounds(scene, factor, counts):
    changes = {"model": "LAMBERT", "albedo": 0.8, "albedo_group": NAME, "grain_amplitude_m": 0.0}

    def build():
        make_group(NAME, factor)
        return build_material("Test", defaults().surface | changes, 1, TERRAIN)

    measured = furnace(build, view_m=1.0)
    assert measured == pytest.approx([0.8 * counts] * 3, rel=0.01)


def test_inputs_of_the_contract_are_connected(small):
    make_group(NAME, 0.5, takes=("Position", "Normal", "Else"))
    node = next(list_own_nodes(build_scene(small, ask(small)).materials))
    linked = {socket.name: socket.links[0].from_socket.name for socket in node.inputs if socket.is_linked}
    assert linked == {"Position": "Position", "Normal": "True Normal"}


def test_the_scene_counts_as_edited_and_its_id_follows_the_group_but_not_its_name(small):
    settings = ask(small)
    group = make_group(NAME, 0.5)
    built = build_scene(small, settings)
    assert built.edited
    first = built.extra
    group.nodes["Factor"].outputs[0].default_value = 0.4
    second = built.extra
    group.name = "Another Name"
    assert built.extra == second != first
    group.nodes["Factor"].outputs[0].default_value = 0.5
    assert built.extra == first


def test_builds_and_sliders_keep_the_group(small):
    group = make_group(NAME, 0.5)
    built = build_scene(small, ask(small))
    show_settings(built, ask(small, albedo=0.6), 17)
    assert set(groups_of(built)) == {group}
    assert not built.edited_parts()  # so that sliders still change the surface
    built = build_scene(small, ask(small, albedo=0.7))
    assert set(groups_of(built)) == {group}
    assert group.use_fake_user


def test_a_build_of_another_process_gets_the_group_of_this_file(small, tmp_path):
    settings = ask(small)
    stored = build_scene(small, settings)  # as in a process that has no groups
    assert all(map(is_stand_in, groups_of(stored)))
    with pytest.raises(IcyMoonError, match=f"the node group {NAME} .*not in this file"):
        stored.extra  # noqa: B018 - no pair gets an id
    write_build(stored, tmp_path / "stored.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    group = make_group(NAME, 0.5)
    built = build_scene(bpy.context.scene, settings, take_over=lambda: read_build(tmp_path / "stored.blend"))
    assert set(groups_of(built)) == {group}
    assert built.edited
    assert not any(each.get("icymoon") for each in bpy.data.node_groups if each.bl_idname == "ShaderNodeTree")


def test_a_saved_file_has_it(small, tmp_path):
    make_group(NAME, 0.5)
    extra = build_scene(small, ask(small)).extra
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "own.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "own.blend"))
    assert find_built(bpy.context.scene).extra == extra


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: None, "This file has no node group named Soot"),
        (lambda: bpy.data.node_groups.new(NAME, "GeometryNodeTree"), "is not a group of shader nodes"),
        (lambda: make_group(NAME, 1.0, output="Albedo"), "has no output Albedo Factor of the type Float"),
        (lambda: make_group(NAME, 1.0, kind="NodeSocketColor"), "has no output Albedo Factor of the type Float"),
    ],
)
def test_a_group_that_cannot_be_used_is_a_sentence(scene, make, sentence):
    make()
    assert sentence in explain_unusable_group(NAME)

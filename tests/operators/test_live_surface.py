"""A slider of the surface sets values in the nodes of ground and rocks, and comes to what a build makes."""

from __future__ import annotations

import bpy
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks.fingerprint import TAG, find_instanced_objects, read_parts
from icymoon.nodes.tree.builder import Tree
from icymoon.nodes.tree.followed_tree import FollowedTree, OtherTreeError
from icymoon.settings import preset_files
from icymoon.settings.blender import scene_properties

SURFACES = [name for name in preset_files.preset_names() if name.startswith("surfaces/")]
#: Surfaces with nodes that are no builder's calls, or that are removed after their call.
BUILT_ANEW = "HAPKE"


@pytest.fixture
def rocky(small: bpy.types.Scene) -> bpy.types.Scene:
    """The small scene with rocks, not built."""
    small.icymoon.rocks.coverage = 0.05
    return small


def settings(scene: bpy.types.Scene):
    return scene_properties.read_settings(scene.icymoon)


def find_materials(scene: bpy.types.Scene) -> list[bpy.types.Material]:
    """The materials of ground and rocks."""
    built = scenes.find_built(scene)
    rock = next(item for item in built.collection.all_objects if item.get(TAG) == "rock")
    return [built.terrain.data.materials[0], next(find_instanced_objects(rock)).data.materials[0]]


def slide(scene: bpy.types.Scene) -> scenes.Built:
    """Change values of the surface, and show them as a slider does."""
    surface = scene.icymoon.surface
    surface.albedo, surface.slope_dirt = 0.61, 0.9 * surface.slope_dirt
    built = scenes.find_built(scene)
    preview.show_settings(built, settings(scene), 33)
    return built


def build_afresh(scene: bpy.types.Scene) -> dict[str, str]:
    scenes.clear_scene(scene)
    return read_parts(scenes.build_scene(scene, settings(scene)).collection)


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("preset", SURFACES)
def test_nodes_have_the_values_of_a_build(rocky, preset, monkeypatch):
    scene_properties.write_settings(rocky.icymoon, preset_files.load_preset(preset))
    scenes.build_scene(rocky, settings(rocky))
    before = [material.session_uid for material in find_materials(rocky)]
    added: list[str] = []
    add = Tree.node

    def note(self, kind, label, *arguments, **options):
        added.append(label)
        return add(self, kind, label, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Tree, "node", note)
        built = slide(rocky)
    if rocky.icymoon.surface.model != BUILT_ANEW:
        assert [material.session_uid for material in find_materials(rocky)] == before
        assert added == []
    assert not built.edited
    shown = read_parts(built.collection)
    assert shown == build_afresh(rocky)


def test_other_nodes_are_built_anew(rocky):
    scenes.build_scene(rocky, settings(rocky))
    rocky.icymoon.surface.frost_share, rocky.icymoon.surface.crust_share = 0.3, 0.2
    rocky.icymoon.surface.relief = "DISPLACEMENT"
    built = slide(rocky)
    assert not built.edited
    shown = read_parts(built.collection)
    assert shown == build_afresh(rocky)


def test_a_material_that_was_edited_by_hand_stays(rocky):
    scenes.build_scene(rocky, settings(rocky))
    ground, rock = find_materials(rocky)
    node = next(node for node in ground.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    node.inputs["Roughness"].default_value = 0.987
    slide(rocky)
    assert node.inputs["Roughness"].default_value == pytest.approx(0.987)
    assert [each.session_uid for each in find_materials(rocky)] == [ground.session_uid, rock.session_uid]


def fill(tree: Tree, factors: tuple[float, ...]) -> None:
    total = tree.math("ADD", "Sum", factors[0], 1.0)
    for factor in factors[1:]:
        total = tree.math("MULTIPLY", "Product", total, factor)
    tree.emission("Shine", (1.0, 1.0, 1.0, 1.0), total)
    tree.arrange()


@pytest.fixture
def tree():
    found = bpy.data.node_groups.new("Try", "ShaderNodeTree")
    yield found
    bpy.data.node_groups.remove(found)


def test_nodes_of_one_label_are_followed_in_their_order(tree):
    fill(Tree(tree), (1.0, 2.0, 3.0, 4.0))
    fill(FollowedTree(tree), (5.0, 6.0, 7.0, 8.0))
    assert [tree.nodes[name].inputs[1].default_value for name in ("Product", "Product.001", "Product.002")] == [6, 7, 8]
    for factors in ((5.0, 6.0, 7.0), (5.0, 6.0, 7.0, 8.0, 9.0)):
        with pytest.raises(OtherTreeError):
            fill(FollowedTree(tree), factors)
    assert len(tree.nodes) == 5


def test_a_builder_that_adds_or_removes_nodes_itself_leaves_the_followed_tree_as_it_is(tree):
    fill(Tree(tree), (1.0, 2.0))
    followed = FollowedTree(tree)
    for change in (followed.tree.nodes.new, followed.tree.nodes.remove, followed.tree.links.new):
        with pytest.raises(OtherTreeError):
            change("ShaderNodeMath")
    assert len(tree.nodes) == 3


def test_another_curve_is_told_apart(tree):
    def fill_curve(into: Tree, height: float) -> None:
        into.emission("Shine", into.curve("Curve", (0.5, 0.5, 0.5, 1.0), (0.0, 0.4, 1.0), (0.0, height, 1.0)), 1.0)
        into.arrange()

    fill_curve(Tree(tree), 0.3)
    fill_curve(FollowedTree(tree), 0.3)
    with pytest.raises(OtherTreeError):
        fill_curve(FollowedTree(tree), 0.4)


def test_parts_of_a_tree_are_followed_apart(tree):
    fill(Tree(tree), (1.0, 2.0))
    later = Tree(tree, keep=True)
    later.math("ADD", "Later", 1.0, 2.0)
    fill(FollowedTree(tree, without=("Later",)), (3.0, 4.0))
    FollowedTree(tree, only=("Later",)).math("ADD", "Later", 5.0, 6.0)
    assert [socket.default_value for socket in tree.nodes["Later"].inputs][:2] == [5.0, 6.0]

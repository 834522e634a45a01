"""Shader node groups of the user's that vary the albedo of the ice: the contract, and how they enter a material.

Settings name a group, and only a .blend file has one. A scene with such a group counts as edited by hand, so its pairs
are rendered from the .blend file and their ids depend on the group's content. A build in another process has no groups
of the file; it leaves a stand-in, which ``connect_own_groups`` replaces where the group is.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from ...support.errors import IcyMoonError
from ..datablocks.fingerprint import OWN_GROUP, STAND_IN, TAG, is_stand_in, list_own_nodes
from ..tree.builder import Node, Socket, Tree
from ..tree.formula import Number

#: The output of a group that multiplies the albedo, and its bounds. Hapke's law is fitted for albedos in between.
FACTOR, MIN_FACTOR, MAX_FACTOR = "Albedo Factor", 0.02, 1.0
#: The inputs of a group that Icy Moon connects, if the group has them, with the outputs of the Geometry node.
INPUTS = {"Position": "Position", "Normal": "True Normal"}
#: Label of the node that bounds the factor from below.
_NAME = "icymoon_group"  # property of a stand-in: the name of the group that it stands for
_BOUND = "Own Factor at Least"


def add_own_factor(tree: Tree, name: str, geometry: Node) -> Socket:
    """Add the group ``name``, and return the output socket of its factor, held within its bounds.

    Raises IcyMoonError if the window's file has no such group. A process without a window makes a stand-in.
    """
    if not bpy.app.background and (why := explain_unusable_group(name)):
        raise IcyMoonError(why)
    node = tree.tree.nodes.new("ShaderNodeGroup")
    node.name = node.label = OWN_GROUP
    bound = tree.math("MAXIMUM", _BOUND, MAX_FACTOR, MIN_FACTOR)
    _connect(tree.tree, node, _find_group(name) or _make_stand_in(name))
    return Number(tree, bound).at_most(MAX_FACTOR).named("Own Factor").value


def explain_unusable_group(name: str) -> str:
    """Explain in a sentence why the open file has no group ``name`` that keeps the contract; empty if it has one."""
    group = bpy.data.node_groups.get(name)
    if group is None:
        return (
            f"This file has no node group named {name}, which surface.albedo_group names; make it in the Shader "
            "Editor, or empty the field."
        )
    if group.bl_idname != "ShaderNodeTree":
        return f"The node group {name} is not a group of shader nodes; make one in the Shader Editor."
    outputs = {item.name: item for item in group.interface.items_tree if getattr(item, "in_out", "") == "OUTPUT"}
    if FACTOR not in outputs or outputs[FACTOR].socket_type != "NodeSocketFloat":
        return f"The node group {name} has no output {FACTOR} of the type Float; add it in the Shader Editor."
    return ""


def connect_own_groups(materials: Iterable[bpy.types.Material | None]) -> None:
    """Replace stand-ins in built materials by the groups of the open file."""
    for node in list(list_own_nodes(materials)):
        stand_in = node.node_tree
        group = _find_group(stand_in[_NAME]) if stand_in is not None and is_stand_in(stand_in) else None
        if group is None:
            continue
        _connect(node.id_data, node, group)
        if stand_in.users == 0:
            bpy.data.node_groups.remove(stand_in)


def refuse_stand_ins(materials: Iterable[bpy.types.Material | None]) -> None:
    """Raise IcyMoonError if a material has a stand-in, whose albedo is not the albedo of the settings."""
    for node in list_own_nodes(materials):
        if is_stand_in(node.node_tree):
            name = node.node_tree[_NAME] if node.node_tree is not None else ""
            raise IcyMoonError(
                f"The surface has the node group {name} (albedo_group), which is not in this file; append it from the "
                "file that has it and press Build Scene, or empty the field Own Node Group."
            )


def _find_group(name: str) -> bpy.types.NodeTree | None:
    """Find the group of the open file that keeps the contract; None without one."""
    return None if explain_unusable_group(name) else bpy.data.node_groups[name]


def _make_stand_in(name: str) -> bpy.types.NodeTree:
    group = bpy.data.node_groups.new(f"{name} (not in this file)", "ShaderNodeTree")
    group[TAG], group[_NAME] = STAND_IN, name
    group.interface.new_socket(FACTOR, in_out="OUTPUT", socket_type="NodeSocketFloat")
    constant = group.nodes.new("ShaderNodeValue")
    constant.outputs[0].default_value = MAX_FACTOR
    group.links.new(constant.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    return group


def _connect(tree: bpy.types.NodeTree, node: Node, group: bpy.types.NodeTree) -> None:
    """Let a node use the group, and link its sockets to the geometry and to the bound of the factor."""
    node.node_tree = group
    group.use_fake_user = True  # a group outlives its materials, which every build makes anew
    geometry = next(each for each in tree.nodes if each.type == "NEW_GEOMETRY")
    for name, of_geometry in INPUTS.items():
        if name in node.inputs:
            tree.links.new(geometry.outputs[of_geometry], node.inputs[name])
    tree.links.new(node.outputs[FACTOR], tree.nodes[_BOUND].inputs[0])

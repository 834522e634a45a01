"""Groups of shader nodes as users make them, for the ice's albedo."""

from __future__ import annotations

from collections.abc import Iterable

import bpy


def make_group(
    name: str,
    factor: float,
    kind: str = "NodeSocketFloat",
    output: str = "Albedo Factor",
    takes: Iterable[str] = (),
) -> bpy.types.NodeTree:
    """A group that gives a constant, whatever its inputs, which are vectors."""
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for taken in takes:
        group.interface.new_socket(taken, in_out="INPUT", socket_type="NodeSocketVector")
    group.interface.new_socket(output, in_out="OUTPUT", socket_type=kind)
    value = group.nodes.new("ShaderNodeValue")
    value.name, value.outputs[0].default_value = "Factor", factor
    group.links.new(value.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    return group

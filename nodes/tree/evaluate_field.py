"""Evaluates a shader's formula at points by geometry nodes, which have the same textures and the same arithmetic.

Cycles computes a shader only where a ray meets it, and returns values only through a bake. Geometry nodes compute the
same formula for any points, to the last bits of single precision.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...support.arrays import Array

#: Node types with the same meaning in shaders and in geometry.
_SHARED_NODES = {
    "ShaderNodeMath",
    "ShaderNodeVectorMath",
    "ShaderNodeMapRange",
    "ShaderNodeClamp",
    "ShaderNodeTexNoise",
    "ShaderNodeCombineXYZ",
    "ShaderNodeSeparateXYZ",
    "ShaderNodeMix",
    "ShaderNodeValue",
}
_OF_ANY_NODE = {prop.identifier for prop in bpy.types.Node.bl_rna.properties}
_GROUP_NAME = "Icy Moon Field"


class NoGeometryNodeError(ValueError):
    """Geometry nodes have no equivalent of a shader's node."""


class _Translation:
    """A geometry node group with the formula of a shader's socket."""

    def __init__(self, group: bpy.types.NodeTree) -> None:
        self.group = group
        self.attributes: set[str] = set()
        self._made: dict[str, Any] = {}

    def translate(self, socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """Return the output in the group that corresponds to an output in the shader. Raises NoGeometryNodeError if
        geometry nodes have no such node."""
        node = socket.node
        if node.bl_idname == "ShaderNodeNewGeometry" and socket.identifier == "Position":
            return self._make(node.name, "GeometryNodeInputPosition").outputs[0]
        if node.bl_idname == "ShaderNodeAttribute" and (node.attribute_type, socket.identifier) == ("GEOMETRY", "Fac"):
            made = self._make(node.name, "GeometryNodeInputNamedAttribute")
            made.data_type, made.inputs["Name"].default_value = "FLOAT", node.attribute_name
            self.attributes.add(node.attribute_name)
            return next(each for each in made.outputs if each.enabled)
        if node.bl_idname not in _SHARED_NODES:
            raise NoGeometryNodeError(node.bl_idname)
        if node.name not in self._made:
            self._copy(node, self._make(node.name, node.bl_idname))
        return next(each for each in self._made[node.name].outputs if each.identifier == socket.identifier)

    def _make(self, name: str, kind: str) -> bpy.types.Node:
        if name not in self._made:
            self._made[name] = self.group.nodes.new(kind)
        return self._made[name]

    def _copy(self, node: bpy.types.Node, made: bpy.types.Node) -> None:
        for prop in node.bl_rna.properties:
            if not prop.is_readonly and prop.identifier not in _OF_ANY_NODE:
                setattr(made, prop.identifier, getattr(node, prop.identifier))
        for source, target in zip(node.inputs, made.inputs, strict=True):
            if source.is_linked:
                self.group.links.new(self.translate(source.links[0].from_socket), target)
            elif hasattr(source, "default_value"):
                target.default_value = source.default_value


def evaluate_field(socket: bpy.types.NodeSocket, points: Array, mesh: bpy.types.Mesh, some: Array) -> Array:
    """Evaluate a shader's output at ``points`` (k, 3) in world coordinates, which are the vertices ``some`` (k,) of
    ``mesh``. Returns float32 (k,).

    Raises NoGeometryNodeError if geometry nodes cannot compute the values, or if the mesh lacks the vertex attributes
    that they need.
    """
    group = bpy.data.node_groups.new(_GROUP_NAME, "GeometryNodeTree")
    held: list[tuple[Any, Any]] = [(bpy.data.node_groups, group)]
    try:
        found = _Translation(group)
        _add_output(group, found.translate(socket))
        cloud = bpy.data.meshes.new(_GROUP_NAME)
        held.append((bpy.data.meshes, cloud))
        cloud.vertices.add(len(points))
        cloud.vertices.foreach_set("co", np.ascontiguousarray(points, np.float32).ravel())
        for name in found.attributes:
            _copy_attribute(name, mesh, cloud, some)
        item = bpy.data.objects.new(_GROUP_NAME, cloud)
        held.append((bpy.data.objects, item))
        item.modifiers.new(_GROUP_NAME, "NODES").node_group = group
        scene = bpy.data.scenes.new(_GROUP_NAME)
        held.append((bpy.data.scenes, scene))
        scene.collection.objects.link(item)
        layer = scene.view_layers[0]
        layer.update()
        values = np.empty(3 * len(points), np.float32)
        item.evaluated_get(layer.depsgraph).data.vertices.foreach_get("co", values)
        return values[::3].copy()
    finally:
        for kind, made in reversed(held):
            kind.remove(made)


def _add_output(group: bpy.types.NodeTree, value: bpy.types.NodeSocket) -> None:
    """Make a group return its points with a value as their x coordinate."""
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    given, result = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    place, moved = group.nodes.new("ShaderNodeCombineXYZ"), group.nodes.new("GeometryNodeSetPosition")
    for source, target in (
        (value, place.inputs["X"]),
        (given.outputs[0], moved.inputs["Geometry"]),
        (place.outputs[0], moved.inputs["Position"]),
        (moved.outputs[0], result.inputs[0]),
    ):
        group.links.new(source, target)


def _copy_attribute(name: str, source: bpy.types.Mesh, target: bpy.types.Mesh, some: Array) -> None:
    values = read_numbers(source, name)
    if values is None:
        raise NoGeometryNodeError(name)
    target.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", np.ascontiguousarray(values[some]))


def read_numbers(mesh: bpy.types.Mesh, name: str) -> Array | None:
    """Read the values (n,) float32 of an attribute of the vertices of a mesh; None if it has no such numbers."""
    there = mesh.attributes.get(name)
    if there is None or (there.data_type, there.domain) != ("FLOAT", "POINT"):
        return None
    values = np.empty(len(there.data), np.float32)
    there.data.foreach_get("value", values)
    return values

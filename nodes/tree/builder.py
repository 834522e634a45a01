"""Builds node trees, one call for each node.

A call must set every input of the node, because Blender's defaults differ between versions (Displacement Scale changed
from 1.0 to 0.01). An input that is neither given nor named in ``leave`` is an error. Sockets are found by their
identifiers, which no version has renamed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import bpy

COLUMN, ROW = 220.0, 260.0


def non_socket_values(node: Any) -> list[Any]:
    """Values of a node that are not in sockets: the name of its image, the points of its curves, its UV layer."""
    image, mapping = getattr(node, "image", None), getattr(node, "mapping", None)
    curves = getattr(mapping, "curves", ())
    points = [[tuple(point.location) for point in curve.points] for curve in curves]
    return [image.name if image else "", points, *([node.uv_map] if hasattr(node, "uv_map") else [])]


def output(node: Any, identifier: str) -> Any:
    """The output socket with an identifier. Unlike names, no version has renamed identifiers."""
    return next(socket for socket in node.outputs if socket.identifier == identifier)


class Tree:
    """A node tree under construction. Existing nodes are removed first, unless ``keep`` is true."""

    def __init__(self, node_tree: bpy.types.NodeTree, keep: bool = False) -> None:
        self.tree = node_tree
        if not keep:
            self.tree.nodes.clear()

    def node(
        self,
        kind: str,
        label: str,
        inputs: Mapping[str, Any] | None = None,
        *,
        leave: Iterable[str] = (),
        if_present: Mapping[str, Any] | None = None,
        **properties: Any,
    ) -> Any:
        """Add a node and return it. Raises ValueError if an input is missing or unknown.

        ``inputs`` maps identifiers of sockets to values, or to output sockets that are linked to them. ``if_present``
        is the same for sockets that only some versions of Blender have. ``leave`` names inputs that stay unconnected,
        such as a Normal input that then is the surface's own normal. ``properties`` are set first, since the sockets
        depend on them.
        """
        node = self.tree.nodes.new(kind)
        node.name = node.label = label
        for name, value in properties.items():
            setattr(node, name, value)
        given = dict(inputs or {})
        present = {s.identifier: s for s in node.inputs if s.enabled}
        given |= {k: v for k, v in (if_present or {}).items() if k in present}
        missing = present.keys() - given.keys() - set(leave)
        unknown = given.keys() - present.keys()
        if missing or unknown:
            raise ValueError(f"{kind} {label!r}: inputs not set {sorted(missing)}, unknown {sorted(unknown)}")
        for identifier, value in given.items():
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, present[identifier])
            else:
                present[identifier].default_value = value
        return node

    def math(self, operation: str, label: str, a: Any, b: Any = None, c: Any = None) -> Any:
        """Output socket of a Math node of one operand, two or three."""
        operands = zip(("Value", "Value_001", "Value_002"), (a, b, c), strict=True)
        inputs = {key: value for key, value in operands if value is not None}
        return self.node("ShaderNodeMath", label, inputs, operation=operation, use_clamp=False).outputs[0]

    def curve(self, label: str, colour: Any, x: Any, y: Any) -> Any:
        """Output socket of a colour after linear interpolation of each band between points (x, y)."""
        node = self.node("ShaderNodeRGBCurve", label, {"Fac": 1.0, "Color": colour})
        points = node.mapping.curves[3].points  # the curve of all bands, which has two points at first
        while len(points) < len(x):
            points.new(0.5, 0.5)
        for point, a, b in zip(points, x, y, strict=True):
            point.location, point.handle_type = (float(a), float(b)), "VECTOR"
        node.mapping.update()
        return node.outputs[0]

    def arrange(self) -> None:
        """Arrange the nodes in columns by their distance from the outputs, always in the same way."""
        depth = {node.name: 0 for node in self.tree.nodes}
        links = [(link.from_node.name, link.to_node.name) for link in self.tree.links]  # read once, since this is slow
        for _ in depth:
            before = dict(depth)
            for source, target in links:
                depth[source] = max(depth[source], depth[target] + 1)
            if depth == before:
                break
        rows: dict[int, int] = {}
        places: list[float] = []
        for node in self.tree.nodes:
            column = depth[node.name]
            row = rows[column] = rows.get(column, -1) + 1
            places += (-COLUMN * column, -ROW * row)
        self.tree.nodes.foreach_set("location", places)  # to move one node would update the whole tree


def _plain(struct: Any) -> dict[str, Any]:
    """The plain properties of a node, without properties of the node editor."""
    return {
        p.identifier: getattr(struct, p.identifier)
        for p in struct.bl_rna.properties
        if p.type in ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM")
        and not p.is_readonly
        and not getattr(p, "is_array", False)
        and p.identifier not in _EDITOR
    }


#: Properties of a node that affect only the node editor.
_EDITOR = {
    "select",
    "hide",
    "width",
    "height",
    "show_options",
    "show_preview",
    "show_texture",
    "use_custom_color",
    "is_active_output",
    "warning_propagation",
}


def take_values(target: bpy.types.NodeTree, source: bpy.types.NodeTree) -> bool:
    """Copy the values of a tree to another with the same nodes and links; False, without a change, if they differ.

    A tree that keeps its nodes also keeps its compiled shader, so that the view can follow a slider.
    """

    def structure(tree: bpy.types.NodeTree) -> list[Any]:
        return [
            [(n.bl_idname, n.name, _plain(n), non_socket_values(n)) for n in tree.nodes],
            [(k.from_node.name, k.from_socket.identifier, k.to_node.name, k.to_socket.identifier) for k in tree.links],
        ]

    if structure(target) != structure(source) or any(getattr(n, "node_tree", None) for n in source.nodes):
        return False
    for node in source.nodes:
        for old, new in zip(target.nodes[node.name].inputs, node.inputs, strict=True):
            if hasattr(new, "default_value"):
                old.default_value = new.default_value
    return True

"""Gives a tree that was built earlier the values that a builder would set in a new tree.

To add a node takes some 0.3 ms, and a slider changes a few values of a hundred nodes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np

from ...support.arrays import Array
from .builder import Socket, Tree


class OtherTreeError(Exception):
    """The builder would make other nodes or links than the tree has."""


class _Fixed:
    """Nodes or links of a tree that a builder may not add or remove itself."""

    def new(self, *_: object) -> Any:
        """Raise OtherTreeError."""
        raise OtherTreeError

    remove = new


class FollowedTree(Tree):
    """A tree with nodes. A call that would add a node sets the values of the node that is there instead.

    Raises OtherTreeError where nodes, links or properties of nodes differ. Some values are set then; build a new tree.
    """

    def __init__(self, node_tree: bpy.types.NodeTree, *, without: Collection[str] = (), only: Collection[str] = ()):
        """Follow the nodes of a tree whose names are in ``only`` (all nodes if it is empty), except the nodes in
        ``without``.

        Another builder has added the nodes in ``without``; this builder has added the nodes in ``only``.
        """
        fixed: Any = SimpleNamespace(nodes=_Fixed(), links=_Fixed())
        super().__init__(fixed, keep=True)
        self._nodes = {
            node.name: node for node in node_tree.nodes if node.name not in without and (not only or node.name in only)
        }
        self._left = set(self._nodes)
        self._times: dict[str, int] = {}  # number of nodes that have got each label so far
        self._sources = {
            (link.to_node.name, link.to_socket.identifier): (link.from_node.name, link.from_socket.identifier)
            for link in node_tree.links
        }

    def node(
        self,
        kind: str,
        label: str,
        inputs: Mapping[str, Any] | None = None,
        *,
        if_present: Mapping[str, Any] | None = None,
        **properties: object,
    ) -> bpy.types.Node:
        """Return the node that ``Tree.node`` would add, with its values."""
        before = self._times.get(label, 0)
        self._times[label] = before + 1
        name = f"{label}.{before:03d}" if before else label  # as Blender names nodes of the same name
        node = self._nodes.get(name)
        if node is None or node.bl_idname != kind or name not in self._left:
            raise OtherTreeError(label)
        self._left.remove(name)
        if any(getattr(node, key) != value for key, value in properties.items()):
            raise OtherTreeError(label)
        given = {**(if_present or {}), **(inputs or {})}
        for socket in node.inputs:
            if socket.enabled:
                self._follow(socket, given.get(socket.identifier), self._sources.get((name, socket.identifier)))
        return node

    def _follow(self, socket: bpy.types.NodeSocket, value: Any, source: tuple[str, str] | None) -> None:
        linked = isinstance(value, bpy.types.NodeSocket)
        if source != ((value.node.name, value.identifier) if linked else None):
            raise OtherTreeError(socket.node.name)
        if value is not None and not linked and _differs(socket.default_value, value):
            socket.default_value = value  # Blender updates the tree for each value, so equal ones are not set

    def bands(
        self, label: str, place: Any, positions: Sequence[float], colours: Sequence[Sequence[float]]
    ) -> bpy.types.Node:
        """Return the node that ``Tree.bands`` would add, if its bands are the same."""
        node = self.node("ShaderNodeValToRGB", label, {"Fac": place})
        there = [(element.position, *element.color) for element in node.color_ramp.elements]
        wanted = np.column_stack([positions, colours, np.ones(len(colours))]).astype(np.float32)
        if not np.array_equal(np.array(there, np.float32), wanted):
            raise OtherTreeError(label)
        return node

    def curve(self, label: str, colour: Any, x: Sequence[float] | Array, y: Sequence[float] | Array) -> Socket:
        """Return the output that ``Tree.curve`` would add, if its points are the same."""
        node = self.node("ShaderNodeRGBCurve", label, {"Fac": 1.0, "Color": colour})
        there = np.array([point.location for point in node.mapping.curves[3].points], np.float32)
        if not np.array_equal(there, np.column_stack([x, y]).astype(np.float32)):
            raise OtherTreeError(label)
        return node.outputs[0]

    def arrange(self) -> None:
        """Check that no node is left over; the nodes are in their places. Raises OtherTreeError otherwise."""
        if self._left:
            raise OtherTreeError(min(self._left))


def _differs(there: Any, value: Any) -> bool:
    """Return whether a socket's numbers differ from a value in single precision."""
    if isinstance(there, float):
        return there != np.float32(value)
    return not np.array_equal(np.asarray(there, np.float32), np.asarray(value, np.float32))

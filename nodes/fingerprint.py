"""Whether a built scene is still what its settings say.

A pair is named by the settings that made it. When a person has sculpted the ground, moved the
camera, edited the material or put a lander in, the settings no longer say it all, and the name
must change. The fingerprint covers what the builders make; anything else counts as added.
"""

from __future__ import annotations

import hashlib
from typing import Any

import bpy
import numpy as np

TAG = "icymoon"  # custom property that marks what the builders made, its value the role

#: Attributes of vertices that are hashed: how they are read, and how many numbers each has.
_NUMBERS = {"FLOAT": (np.float32, "value", 1), "FLOAT_VECTOR": (np.float32, "vector", 3), "INT": (np.int32, "value", 1)}


def _socket_value(socket: Any) -> Any:
    value: Any = getattr(socket, "default_value", None)
    if isinstance(value, bpy.types.Collection):  # the shapes of instanced blocks
        return [(item.name, _rows(item), _data(item.data)) for item in sorted(value.all_objects, key=lambda o: o.name)]
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def _tree(node_tree: bpy.types.NodeTree | None) -> list[Any]:
    if node_tree is None:
        return []
    nodes = [(n.bl_idname, n.name, n.mute, [(s.identifier, _socket_value(s)) for s in n.inputs if not s.is_linked])
             for n in node_tree.nodes]
    links = [(k.from_node.name, k.from_socket.identifier, k.to_node.name, k.to_socket.identifier)
             for k in node_tree.links]
    return [sorted(nodes, key=repr), sorted(links)]


def _rows(item: bpy.types.Object) -> list[tuple[float, ...]]:
    return [tuple(row) for row in item.matrix_basis]


def _points(mesh: bpy.types.Mesh) -> dict[str, str]:
    """Hashes of the numbers that the vertices carry: positions, and what places instanced blocks."""
    hashes = {}
    for attribute in mesh.attributes:
        kind, key, width = _NUMBERS.get(attribute.data_type, (None, "", 0))
        if kind and attribute.domain == "POINT" and not attribute.name.startswith("."):
            values = np.empty(len(mesh.vertices) * width, kind)
            attribute.data.foreach_get(key, values)
            hashes[attribute.name] = hashlib.sha256(values.tobytes()).hexdigest()
    return hashes


def _mesh(mesh: bpy.types.Mesh) -> list[Any]:
    return [sorted(_points(mesh).items()), len(mesh.polygons),
            [[*_tree(m.node_tree), m.pass_index] if m else [] for m in mesh.materials]]


def _data(data: Any) -> list[Any]:
    if isinstance(data, bpy.types.Mesh):
        return _mesh(data)
    if isinstance(data, bpy.types.Camera):
        return [data.type, data.lens, data.sensor_width, data.sensor_fit, data.shift_x, data.shift_y,
                data.dof.use_dof, data.stereo.interocular_distance, data.stereo.convergence_mode, data.stereo.pivot]
    if isinstance(data, bpy.types.SunLight):
        return [data.energy, data.angle, tuple(data.color)]
    return [type(data).__name__]


def fingerprint(collection: bpy.types.Collection) -> str:
    """Hash of everything in a built collection, equal in every process that loads it."""
    shared: dict[Any, list[Any]] = {}
    digest = hashlib.sha256()
    for item in sorted(collection.all_objects, key=lambda o: o.name):
        if item.data not in shared:
            shared[item.data] = _data(item.data)
        digest.update(repr([
            item.name, item.get(TAG), item.type, item.hide_render, item.pass_index, len(item.constraints),
            [[m.type, *_tree(getattr(m, "node_group", None))] for m in item.modifiers],
            item.parent.name if item.parent else "", _rows(item), shared[item.data]]).encode())
    return digest.hexdigest()


def added_objects(collection: bpy.types.Collection) -> list[str]:
    """Names of the objects in a built collection that the builders did not make."""
    return sorted(item.name for item in collection.all_objects if TAG not in item)

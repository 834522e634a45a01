"""Whether a built scene is still what its settings say.

A pair is named by the settings that made it. When a person has sculpted the ground, moved the
camera, edited the material or put a lander in, the settings no longer say it all, and the name
must change. The fingerprint covers what the builders make, in parts, so that an edit of one part
leaves the others to the settings; anything else counts as added.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

import bpy
import numpy as np

from .builder import held

NAME = "Icy Moon"  # what the names of all that the builders make begin with
TAG = "icymoon"  # custom property that marks what the builders made, its value the role

#: Attributes that are hashed, by domain and type: how they are read, and how many numbers each has.
_NUMBERS = {("POINT", "FLOAT"): (np.float32, "value", 1), ("POINT", "FLOAT_VECTOR"): (np.float32, "vector", 3),
            ("POINT", "INT"): (np.int32, "value", 1), ("CORNER", "FLOAT2"): (np.float32, "vector", 2)}


def _socket_value(socket: Any) -> Any:
    value: Any = getattr(socket, "default_value", None)
    if isinstance(value, bpy.types.Collection):  # the shapes of instanced blocks
        return [(item.name, _rows(item), _geometry(item.data))
                for item in sorted(value.all_objects, key=lambda o: o.name)]
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def _tree(node_tree: bpy.types.NodeTree | None) -> list[Any]:
    if node_tree is None:
        return []
    nodes = [(n.bl_idname, n.name, n.mute, held(n), [(s.identifier, _socket_value(s)) for s in n.inputs
                                                     if not s.is_linked]) for n in node_tree.nodes]
    links = [(k.from_node.name, k.from_socket.identifier, k.to_node.name, k.to_socket.identifier)
             for k in node_tree.links]
    return [sorted(nodes, key=repr), sorted(links)]


def _rows(item: bpy.types.Object) -> list[tuple[float, ...]]:
    return [tuple(row) for row in item.matrix_basis]


def _carried(mesh: bpy.types.Mesh) -> dict[str, str]:
    """Hashes of the numbers that vertices and corners carry: positions, what places instanced blocks, and UV."""
    hashes = {}
    for attribute in mesh.attributes:
        kind, key, width = _NUMBERS.get((attribute.domain, attribute.data_type), (None, "", 0))
        if kind and not attribute.name.startswith("."):
            values = np.empty(len(attribute.data) * width, kind)
            attribute.data.foreach_get(key, values)
            hashes[attribute.name] = hashlib.sha256(values.tobytes()).hexdigest()
    return hashes


def _geometry(data: Any) -> list[Any]:
    if isinstance(data, bpy.types.Mesh):
        return [sorted(_carried(data).items()), len(data.polygons)]
    if isinstance(data, bpy.types.Camera):
        return [data.type, data.lens, data.sensor_width, data.sensor_fit, data.shift_x, data.shift_y,
                data.dof.use_dof, data.stereo.interocular_distance, data.stereo.convergence_mode, data.stereo.pivot]
    if isinstance(data, bpy.types.SunLight):
        return [data.energy, data.angle, tuple(data.color), *_tree(data.node_tree if data.use_nodes else None)]
    return [type(data).__name__]


def instanced(item: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects that the node groups of an object's modifiers put into instances."""
    for tree in (getattr(modifier, "node_group", None) for modifier in item.modifiers):
        for socket in (s for node in tree.nodes for s in node.inputs if s.type == "COLLECTION") if tree else ():
            yield from sorted(socket.default_value.all_objects if socket.default_value else (), key=lambda o: o.name)


def _materials(item: bpy.types.Object) -> list[Any]:
    used = [m for each in (item, *instanced(item)) if isinstance(each.data, bpy.types.Mesh)
            for m in each.data.materials]
    return [[*_tree(m.node_tree), m.pass_index] if m else [] for m in dict.fromkeys(used)]


def _object(item: bpy.types.Object) -> list[Any]:
    return [item.name, item.type, item.hide_render, item.pass_index, len(item.constraints),
            [[m.type, *_tree(getattr(m, "node_group", None))] for m in item.modifiers],
            item.parent.name if item.parent else "", _rows(item)]


def _among(part: str, wanted: tuple[str, ...]) -> bool:
    return not wanted or part in wanted or part.split()[0] in wanted


def parts(collection: bpy.types.Collection, *wanted: str) -> dict[str, str]:
    """Hashes of everything in a built collection, or of wanted parts and roles, equal in every process that loads it.

    The parts are called "ROLE object", "ROLE data" and "ROLE materials"; the role of what a person
    has put in is "added".
    """
    data: dict[Any, list[Any]] = {}

    def geometry(item: bpy.types.Object) -> list[Any]:
        if item.data not in data:  # which objects may share
            data[item.data] = _geometry(item.data)
        return data[item.data]

    found: dict[str, list[Any]] = {}
    for item in sorted(collection.all_objects, key=lambda o: o.name):
        for aspect, read in (("object", _object), ("data", geometry), ("materials", _materials)):
            part = f"{item.get(TAG, 'added')} {aspect}"
            if _among(part, wanted):
                found.setdefault(part, []).append(read(item))
    return {part: hashlib.sha256(repr(content).encode()).hexdigest() for part, content in found.items()}


def fingerprint(collection: bpy.types.Collection) -> str:
    """Hash of everything in a built collection."""
    return hashlib.sha256(repr(sorted(parts(collection).items())).encode()).hexdigest()


def edited(collection: bpy.types.Collection, known: Mapping[str, str], *wanted: str) -> set[str]:
    """Names of the parts, all or the wanted parts and roles, that are not as ``known``; added objects do not count."""
    now, known = parts(collection, *wanted), {part: mark for part, mark in known.items() if _among(part, wanted)}
    return {part for part in now.keys() | known.keys()
            if part.split()[0] != "added" and now.get(part) != known.get(part)}


def updated(collection: bpy.types.Collection, known: Mapping[str, str], *changed: str) -> dict[str, str]:
    """``known`` with the changed parts and roles as they are now."""
    kept = {part: mark for part, mark in known.items() if not (changed and _among(part, changed))}
    return kept | (parts(collection, *changed) if changed else {})


def added_objects(collection: bpy.types.Collection) -> list[str]:
    """Names of the objects in a built collection that the builders did not make."""
    return sorted(item.name for item in collection.all_objects if TAG not in item)

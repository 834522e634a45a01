"""Marks (hashes) of data-blocks and of the data-blocks that they refer to. They cover everything that a render can
show.

Marks are equal in every process that loads the file and do not depend on the names of data-blocks. Data that Blender
stores elsewhere, or that changes by itself, cannot be marked. It is refused with a sentence.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ...support.blender import compat
from ...support.files import hash_file
from .array_marks import list_attribute_marks, list_mesh_marks, mark_array
from .mesh_arrays import read_property
from .stored_properties import OF_THE_VIEW, stored_properties

#: Modifiers whose result is in a cache or comes from particles.
_SIMULATION_MODIFIERS = {
    "PARTICLE_SYSTEM",
    "PARTICLE_INSTANCE",
    "EXPLODE",
    "CLOTH",
    "SOFT_BODY",
    "FLUID",
    "DYNAMIC_PAINT",
}
_OF_TIME = {"WAVE", "BUILD", "OCEAN", "MESH_CACHE", "MESH_SEQUENCE_CACHE"}
_OF_CLIPS = {"CAMERA_SOLVER", "OBJECT_SOLVER", "FOLLOW_TRACK"}
#: Inputs that ``sun_inputs.set_light_inputs`` sets for each render: prefixes of their identifiers, by name and kind of
#: the node.
_AIMED_INPUTS = {
    ("Sun Direction", "ShaderNodeCombineXYZ"): ("X", "Y", "Z"),
    ("Surge Blur", "ShaderNodeMath"): ("Value",),
    ("Hapke", "ShaderNodeScript"): ("Sun", "Planet"),
}
_CACHED_NODES = ("GeometryNodeSimulationOutput", "GeometryNodeBake")
#: Kinds of data-blocks that an object may refer to without an effect on its picture.
_IGNORED_KINDS = (
    bpy.types.Scene,
    bpy.types.World,
    bpy.types.Screen,
    bpy.types.WindowManager,
    bpy.types.WorkSpace,
    bpy.types.Library,
)


class BlockHasher:
    """One pass that hashes data-blocks. Data-blocks in ``known`` count by their names there, without their content."""

    def __init__(self, known: Mapping[Any, str], aimed: Collection[Any] = ()) -> None:
        """Start a pass. ``aimed`` are the node trees with inputs that are set for every render."""
        self.refused: list[str] = []
        self.changes_with_time = False
        self.known = known
        self._aimed = aimed
        self._marks: dict[Any, str] = {}
        self._open: dict[Any, int] = {}
        self._lowest = 0
        self._structs: list[tuple[int, type]] = []
        #: The marks of the arrays of meshes that were read before.
        self.mesh_marks: dict[bpy.types.Mesh, list[Any]] = {}

    def mark(self, block: bpy.types.ID) -> str:
        """Hash the content of a data-block and of all data-blocks that it refers to.

        A reference back to a data-block that is still being read counts by its distance, so that circular references
        end.
        """
        if isinstance(block, _IGNORED_KINDS):
            return "elsewhere"
        found = self.known.get(block) or self._marks.get(block)
        if found:
            return found
        depth = len(self._open)
        if block in self._open:
            self._lowest = min(self._lowest, self._open[block])
            return f"up {depth - self._open[block]}"
        self._open[block], outside, self._lowest = depth, self._lowest, depth
        found = hash_marks(self.content(block))
        del self._open[block]
        if self._lowest >= depth:  # no reference in it leads to a data-block that is still being read
            self._marks[block] = found
        self._lowest = min(outside, self._lowest)
        return found

    def content(self, block: bpy.types.ID, omit: tuple[str, ...] = ()) -> list[Any]:
        """Return the content of a data-block, without the properties to ``omit``."""
        if getattr(block, "is_missing", False):
            self._refuse(block, "is missing in the library it is linked from; restore the library, or remove it.")
        if isinstance(block, bpy.types.Material) and compat.uses_nodes(block):
            omit = (*omit, *OF_THE_VIEW)
        if getattr(block, "use_auto_texspace", False):  # Blender computes the space on access
            omit = (*omit, "texspace_location", "texspace_size")
        return [
            *self._read_struct(block, omit),
            *self._read_custom(block),
            *self._read_special(_HASHER_BY_BLOCK_TYPE, block),
        ]

    def _read_special(self, readers: tuple[tuple[Any, Any], ...], struct: bpy.types.bpy_struct) -> list[Any]:
        read = next((read for kind, read in readers if isinstance(struct, kind)), None)
        return read(self, struct) if read else []

    def _refuse(self, struct: bpy.types.bpy_struct, why: str) -> None:
        self.refused.append(f"{_name_block(struct)} {why}")

    def _read_struct(self, struct: bpy.types.bpy_struct, omit: tuple[str, ...] = ()) -> list[Any]:
        kind: Any = type(struct)
        key = (struct.as_pointer(), kind)
        if key in self._structs:
            return ["up"]
        self._structs.append(key)
        found: list[Any] = [kind.bl_rna.identifier]
        for name, how in stored_properties(kind):
            if name not in omit:
                found.append((name, self._read_property(struct, name, how)))
        self._structs.pop()
        return found

    def _read_property(self, struct: bpy.types.bpy_struct, name: str, how: str) -> object:
        value = getattr(struct, name)
        if how == "value":
            return _to_plain_value(value)
        if how == "file":
            return self._mark_file(struct, value)
        if how == "name":
            return value.name if value else None
        if how == "items":
            return [self.value(item) for item in value]
        return self.ordered(value) if isinstance(struct, bpy.types.PropertyGroup) else self.value(value)

    def value(self, value: object) -> object:
        """Return what identifies a value: the target of a pointer, the input of a socket, or the value itself."""
        if isinstance(value, bpy.types.ID):
            return self.mark(value)
        if isinstance(value, bpy.types.bpy_struct):
            return [*self._read_struct(value), *self._read_special(_HASHER_BY_STRUCT_TYPE, value)]
        return _to_plain_value(value)

    def _read_custom(self, block: bpy.types.ID) -> list[Any]:
        """Read the custom properties of a data-block, because attribute and geometry nodes read them. Groups of
        properties belong to other add-ons and do not count."""
        values = [
            (key, block[key]) for key in sorted(set(compat.list_custom_properties(block)) - {"icymoon", "_RNA_UI"})
        ]
        return [
            (key, self.ordered(value))
            for key, value in values
            if isinstance(value, bpy.types.ID) or not hasattr(value, "keys")
        ]

    def ordered(self, value: object) -> object:
        """Return what identifies a value, as ``value`` does; for a collection also its items in the order of names, by
        which geometry nodes pick them."""
        if not isinstance(value, bpy.types.Collection):
            return self.value(value)
        items = sorted([*value.children, *value.objects], key=lambda item: item.name)
        return [self.mark(value), [self.ordered(item) for item in items]]

    def _mark_file(self, struct: bpy.types.bpy_struct, path: str) -> object:
        """Hash a file's content, independent of its path."""
        packed = getattr(struct, "packed_file", None)
        if packed or not path or path == "<builtin>" or getattr(struct, "mode", "") == "INTERNAL":
            return self.packed(packed)
        if getattr(struct, "is_sequence", False) or getattr(struct, "is_cached", False):
            self._refuse(struct, "is read from many files; use a single one.")
        owner = struct.id_data
        file = Path(bpy.path.abspath(path, library=owner.library))
        if file.is_dir():  # the path was empty before Blender made it relative
            return ""
        if file.is_file():
            state = file.stat()
            return _hash_file(str(file), state.st_size, state.st_mtime_ns)
        if not isinstance(struct, bpy.types.OceanModifier):  # the path is set before the file exists
            self.refused.append(
                f"{file}: this file of {_name_block(owner)} does not exist; restore it or choose another."
            )
        return "missing"

    def packed(self, packed: bpy.types.PackedFile | None) -> str:
        """Hash a file that is packed into the .blend; empty without one."""
        return hashlib.sha256(packed.data).hexdigest() if packed else ""

    # Content of data-blocks and structures that is not in their properties, by kind.

    def of_object(self, item: bpy.types.Object) -> list[Any]:
        """Return the name, shape key and weights of an object, as far as they have an effect, and refuse content that
        cannot be marked."""
        for modifier in item.modifiers:
            if modifier.type in _SIMULATION_MODIFIERS and modifier.show_render:
                self._refuse(
                    item,
                    f"has the modifier {modifier.name!r}, whose result is kept in a cache; apply it, "
                    "convert it to a mesh or curves, or switch it off for renders.",
                )
            self.changes_with_time |= modifier.type in _OF_TIME
        for constraint in item.constraints:
            if constraint.type in _OF_CLIPS:
                self._refuse(item, f"follows a movie clip by the constraint {constraint.name!r}; apply it.")
        if item.rigid_body:
            self._refuse(
                item,
                "is a rigid body, and simulations are not rendered; apply its transform and remove the rigid body.",
            )
        if item.type in ("GREASEPENCIL", "GPENCIL"):
            self._refuse(item, "is made of Grease Pencil strokes; convert it to curves or a mesh.")
        if item.mode == "SCULPT" and item.use_dynamic_topology_sculpting:
            self._refuse(item, "is being sculpted with dynamic topology; leave Sculpt Mode first.")
        slots = [slot.material for slot in item.material_slots if slot.material]
        counts = item.type == "META" or any(is_random_by_object(material.node_tree) for material in slots)
        key = [item.active_shape_key_index] if item.show_only_shape_key else []
        weights = (
            [[(g.group, g.weight) for g in vertex.groups] for vertex in item.data.vertices]
            if (item.type == "MESH" and item.vertex_groups and item.modifiers)
            else []
        )
        return [item.name if counts else "", key, weights]

    def of_mesh(self, mesh: bpy.types.Mesh) -> list[Any]:
        """Return the marks of all arrays of a mesh. In Edit Mode they are read from a copy, since the mesh itself has
        none."""
        if mesh in self.mesh_marks and not mesh.is_editmode:
            return self.mesh_marks[mesh]
        if not mesh.is_editmode:
            return list_mesh_marks(mesh)
        for item in bpy.data.objects:
            if item.data == mesh and item.mode == "EDIT":
                item.update_from_editmode()
        copy = mesh.copy()
        try:
            return list_mesh_marks(copy)
        finally:
            bpy.data.meshes.remove(copy)

    def of_image(self, image: bpy.types.Image) -> list[Any]:
        """Return the content of an image's files, one for each tile."""
        if image.source in ("MOVIE", "SEQUENCE", "VIEWER"):
            self._refuse(
                image, f"is a {image.source.lower()}, whose pictures have no marks of their own; use a single image."
            )
            return []
        if image.is_dirty:
            self._refuse(image, "was painted on and not saved; save or pack it.")
        if image.packed_files:
            return [(each.view, each.tile_number, self.packed(each.packed_file)) for each in image.packed_files]
        if image.source == "GENERATED":
            return []
        return (
            [self._mark_file(image, _find_tile_path(image.filepath, tile.number)) for tile in image.tiles]
            if (image.source == "TILED")
            else [self._mark_file(image, image.filepath or f"//{image.name}")]
        )

    def of_tree(self, tree: bpy.types.NodeTree) -> list[Any]:
        """Return the nodes of a tree with the values of their sockets, and its links. Nodes count by name, since the
        builders find their own nodes by name."""
        nodes = []
        for node in sorted(tree.nodes, key=lambda n: n.name):
            if node.bl_idname == "NodeFrame":
                continue
            if node.bl_idname in _CACHED_NODES or node.bl_idname.startswith("GeometryNodeImport"):
                self._refuse(
                    tree,
                    f"has the node {node.name!r}, whose result is stored outside the scene; apply the "
                    "modifier or remove the node.",
                )
            self.changes_with_time |= node.bl_idname == "GeometryNodeInputSceneTime"
            nodes.append([node.bl_idname, self._read_struct(node), self._read_sockets(node, tree in self._aimed)])
        links = [
            (
                k.from_node.name,
                k.from_socket.identifier,
                k.to_node.name,
                k.to_socket.identifier,
                k.is_muted,
                getattr(k, "multi_input_sort_id", 0),
            )
            for k in tree.links
        ]
        return [nodes, sorted(links)]

    def _read_sockets(self, node: bpy.types.Node, aimed: bool) -> list[Any]:
        return [
            (socket.identifier, socket.bl_idname, self.ordered(getattr(socket, "default_value", None)))
            for side in (node.inputs, node.outputs)
            for socket in side
            if not (aimed and not socket.is_output and is_light_input(node, socket.identifier))
        ]

    def of_collection(self, collection: bpy.types.Collection) -> list[Any]:
        """Return the objects and children of a collection, independent of their order."""
        items = [
            (self.mark(item), each.light_linking.link_state)
            for item, each in zip(collection.objects, collection.collection_objects, strict=True)
        ]
        children = [
            (self.mark(item), each.light_linking.link_state)
            for item, each in zip(collection.children, collection.collection_children, strict=True)
        ]
        return [sorted(items), sorted(children)]

    def of_driver(self, driver: bpy.types.Driver) -> list[Any]:
        """Refuse drivers whose value in a render differs from the value in the window."""
        self.changes_with_time = True
        if driver.type == "SCRIPTED" and not driver.is_simple_expression:
            self._refuse(
                driver.id_data,
                f"has the driver {driver.expression!r}, which runs Python, but renders do not "
                "run Python from a file; use a simple expression.",
            )
        if any(variable.type == "CONTEXT_PROP" for variable in driver.variables):
            self._refuse(
                driver.id_data,
                "has a driver that reads the active scene, which is another one in a render; let it read an object.",
            )
        return []

    def of_target(self, target: bpy.types.DriverTarget) -> list[Any]:
        """Return the value that a driver reads."""
        try:
            return [
                _to_plain_value(target.id.path_resolve(target.data_path)) if target.id and target.data_path else None
            ]
        except (ValueError, TypeError):
            return ["?"]

    def of_nodes(self, modifier: bpy.types.NodesModifier) -> list[Any]:
        """Return the inputs of a modifier of nodes. An input that is missing in the modifier has the default of the
        group.

        From Blender 5.2 on they are ordinary properties.
        """
        items = modifier.node_group.interface.items_tree if modifier.node_group else ()
        given = {key: modifier[key] for key in compat.list_custom_properties(modifier)}
        return [
            (
                item.identifier,
                self.ordered(given.get(item.identifier, getattr(item, "default_value", None))),
                bool(given.get(f"{item.identifier}_use_attribute", False)),
                given.get(f"{item.identifier}_attribute_name", ""),
            )
            for item in items
            if item.item_type == "SOCKET"
        ]

    def of_shape(self, key: bpy.types.Key) -> list[Any]:
        """Return the mark of the positions of a shape key's points."""
        if len(key.data) and type(key.data[0]).bl_rna.identifier == "ShapeKeyPoint":
            return [mark_array(read_property(key.data, "co", width=3))]
        return [self.value(item) for item in key.data]

    def of_animation(self, animation: bpy.types.AnimData) -> list[Any]:
        """Note whether the content changes with the frame; animation itself has no marks."""
        self.changes_with_time |= bool(animation.action or animation.nla_tracks)
        return []


_HASHER_BY_BLOCK_TYPE: tuple[tuple[Any, Callable[[BlockHasher, Any], list[Any]]], ...] = (
    (bpy.types.Object, BlockHasher.of_object),
    (bpy.types.Mesh, BlockHasher.of_mesh),
    (bpy.types.Image, BlockHasher.of_image),
    (bpy.types.NodeTree, BlockHasher.of_tree),
    (bpy.types.Collection, BlockHasher.of_collection),
    (bpy.types.Text, lambda walk, text: [text.as_string()]),
    (
        bpy.types.Curves,
        lambda walk, curves: [list_attribute_marks(curves), [item.first_point_index for item in curves.curves]],
    ),
    (bpy.types.PointCloud, lambda walk, points: list_attribute_marks(points)),
)
_HASHER_BY_STRUCT_TYPE: tuple[tuple[Any, Callable[[BlockHasher, Any], list[Any]]], ...] = (
    (bpy.types.Driver, BlockHasher.of_driver),
    (bpy.types.DriverTarget, BlockHasher.of_target),
    (bpy.types.AnimData, BlockHasher.of_animation),
    (bpy.types.ShapeKey, BlockHasher.of_shape),
    (bpy.types.NodesModifier, BlockHasher.of_nodes),
    (bpy.types.PoseBone, lambda walk, bone: walk._read_custom(bone)),
)


def hash_marks(content: object) -> str:
    """Return the SHA-256, as hexadecimal text, of marks or of the content that ``BlockHasher.content`` returns."""
    return hashlib.sha256(repr(content).encode()).hexdigest()


def is_random_by_object(tree: bpy.types.NodeTree | None) -> bool:
    """Return whether a node tree uses the random number of an object, which Cycles computes from the object's name."""
    return tree is not None and any(
        node.outputs["Random"].is_linked
        if node.bl_idname == "ShaderNodeObjectInfo"
        else is_random_by_object(getattr(node, "node_tree", None))
        for node in tree.nodes
    )


def is_light_input(node: bpy.types.Node, socket: str) -> bool:
    """Return whether a node's input describes the Sun or the planet and is therefore set for every render."""
    prefixes = _AIMED_INPUTS.get((node.name, node.bl_idname))
    return prefixes is not None and socket.startswith(prefixes)


def _name_block(block: bpy.types.ID) -> str:
    return f"{type(block).bl_rna.identifier} {block.name!r}"


def _find_tile_path(path: str, number: int) -> str:
    return path.replace("<UDIM>", str(number)).replace(
        "<UVTILE>", f"u{(number - 1001) % 10 + 1}_v{(number - 1001) // 10 + 1}"
    )


@lru_cache(maxsize=4096)
def _hash_file(file: str, size: int, modified_ns: int) -> str:
    """Return the SHA-256 of a file, which is read once for each size and time of change."""
    return hash_file(Path(file))


def _to_plain_value(value: Any) -> object:
    """Convert a value to a number, a text, or tuples of them."""
    if isinstance(value, (str, int, float, bytes)) or value is None:
        return value
    if isinstance(value, (set, frozenset)):
        return tuple(sorted(value))
    return tuple(_to_plain_value(item) for item in value)  # arrays, also of mathutils

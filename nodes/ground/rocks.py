"""Rocks as instances: one object of points, one node group, a few meshes.

To render 100 000 objects takes half a minute and five gigabytes. The same number of instances takes three seconds and
0.2 gigabytes (``python benchmarks rocks``). An attribute of each instance is its label, which the material of rocks
writes into a value pass.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from ...physics.rocks.place_rocks import Rocks
from ...physics.rocks.rock_shapes import RockShape
from ...rays.rock_exposure import RockShelter
from ...support.arrays import Array
from ...support.labels import FACE_ATTRIBUTE, FIRST_ROCK_INSTANCE, INSTANCE_AOV, INSTANCE_ATTRIBUTE
from ..tree.builder import Tree
from .terrain_mesh import build_mesh_from_arrays, has_faces

#: Angle between triangles of broken ice above which their edge is sharp, rad.
_SHARP_ANGLE_RAD = math.radians(28.0)
SHAPE, ROTATION, SCALE = "shape", "rotation", "scale"
#: Attributes of points: the two parts of ``RockShelter``.
ROCK_SHELTER, ROCK_SHELTER_SLOPE = "icymoon_rock_shelter", "icymoon_rock_shelter_slope"


#: Names of the nodes of ``add_instance_label_pass``.
LABEL_NODES = _INSTANCE, _EXACT, _LABEL = "Instance", "Exact", "Instance Label"


def add_instance_label_pass(tree: Tree) -> None:
    """Make a material's tree write the label of its instance into the value pass ``INSTANCE_AOV``."""
    # The Vector output is exact; Factor is the mean of three equal numbers, which rounding changes above 2^23.
    label = tree.attribute(_INSTANCE, INSTANCE_ATTRIBUTE, "Vector", "INSTANCER")
    tree.value_pass(_LABEL, INSTANCE_AOV, value=tree.separated(_EXACT, label)[0])
    tree.arrange()


def build_shapes(
    name: str, shapes: Sequence[Sequence[RockShape]], used: Array, material: bpy.types.Material
) -> list[bpy.types.Object]:
    """Build an object for each of the ``shapes[level][shape]`` whose number is in ``used``.

    The number is level times the number of shapes, plus shape. Objects are in the order of numbers, and so of names.
    """
    objects = []
    for number in used.tolist():
        level, shape = divmod(number, len(shapes[0]))
        mesh = build_mesh_from_arrays(
            f"{name} Shape {number:03d}", shapes[level][shape].vertices, shapes[level][shape].triangles
        )
        plane = shapes[level][shape].plane
        if plane.all():  # broken ice has sharp edges at its steps and is smooth between them
            mesh.shade_smooth()
            mesh.set_sharp_from_angle(angle=_SHARP_ANGLE_RAD)
        else:
            mesh.polygons.foreach_set("use_smooth", ~plane)
        attribute = mesh.attributes.new(FACE_ATTRIBUTE, "FLOAT", "FACE")
        attribute.data.foreach_set("value", shapes[level][shape].face.astype(np.float32))
        mesh.materials.append(material)
        objects.append(bpy.data.objects.new(mesh.name, mesh))
    return objects


def _add_named_attribute(tree: Tree, label: str, attribute: str, data_type: str) -> bpy.types.NodeSocket:
    """Add a node for an attribute of points, and return its output socket."""
    node = tree.node("GeometryNodeInputNamedAttribute", label, {"Name": attribute}, data_type=data_type)
    return next(socket for socket in node.outputs if socket.enabled)


def _build_group(name: str, shapes: bpy.types.Collection) -> bpy.types.NodeTree:
    """Build the node group that puts a shape on each point, rotated and scaled by the attributes of the point."""
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    _, result = (
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry").identifier
        for direction in ("INPUT", "OUTPUT")
    )
    tree = Tree(group)
    points = tree.node("NodeGroupInput", "Points")
    library = tree.node(
        "GeometryNodeCollectionInfo",
        "Shapes",
        {"Collection": shapes, "Separate Children": True, "Reset Children": True},
        transform_space="ORIGINAL",
    )
    instances = tree.node(
        "GeometryNodeInstanceOnPoints",
        "Blocks",
        {
            "Points": points.outputs[0],
            "Selection": True,
            "Instance": library.outputs[0],
            "Pick Instance": True,
            "Instance Index": _add_named_attribute(tree, "Shape", SHAPE, "INT"),
            "Rotation": _add_named_attribute(tree, "Rotation", ROTATION, "FLOAT_VECTOR"),
            "Scale": _add_named_attribute(tree, "Scale", SCALE, "FLOAT_VECTOR"),
        },
    )
    tree.node("NodeGroupOutput", "Geometry", {result: instances.outputs[0], "__extend__": None})
    tree.arrange()
    return group


def _set_attribute(mesh: bpy.types.Mesh, name: str, data_type: str, values: Array) -> None:
    """Add an attribute to the points of a mesh."""
    attribute = mesh.attributes.new(name, data_type, "POINT")
    kind, key = (np.int32, "value") if data_type == "INT" else (np.float32, "value" if values.ndim == 1 else "vector")
    attribute.data.foreach_set(key, np.ascontiguousarray(values, kind).ravel())


def build_rocks(
    name: str,
    rocks: Rocks,
    shapes: Sequence[Sequence[RockShape]],
    material: bpy.types.Material,
    tag: str,
    shelter: RockShelter | None = None,
) -> bpy.types.Object:
    """Build the object whose points are the rocks. ``find_rock_parts`` returns the other data-blocks that it needs.

    Labels follow the order of the rocks. ``shelter`` is from falling frost. Everything except the object itself gets
    the custom property ``tag``.
    """
    used, pick = _number_shapes(rocks, shapes)
    library = bpy.data.collections.new(f"{name} Shapes")
    for item in build_shapes(name, shapes, used, material):
        item[tag] = "rock shape"
        library.objects.link(item)
    group = _build_group(name, library)
    library[tag] = group[tag] = "rock shapes"

    mesh = bpy.data.meshes.new(name)
    _fill_points(mesh, rocks, pick, shelter)
    item = bpy.data.objects.new(name, mesh)
    item.modifiers.new("Blocks", "NODES").node_group = group
    return item


def _number_shapes(rocks: Rocks, shapes: Sequence[Sequence[RockShape]]) -> tuple[Array, Array]:
    """Return the numbers of the shapes that the rocks use, see ``build_shapes``, and the index of each rock's shape
    among them."""
    used, pick = np.unique(rocks.level * len(shapes[0]) + rocks.shape, return_inverse=True)
    return used, pick


def _fill_points(mesh: bpy.types.Mesh, rocks: Rocks, pick: Array, shelter: RockShelter | None) -> None:
    """Replace the points of a mesh by rocks."""
    mesh.clear_geometry()
    mesh.vertices.add(len(pick))
    mesh.vertices.foreach_set("co", rocks.position_m.astype(np.float32).ravel())
    _set_attribute(mesh, INSTANCE_ATTRIBUTE, "FLOAT", FIRST_ROCK_INSTANCE + np.arange(len(pick)))
    _set_attribute(mesh, SHAPE, "INT", pick)
    _set_attribute(mesh, ROTATION, "FLOAT_VECTOR", rocks.rotation)
    _set_attribute(mesh, SCALE, "FLOAT_VECTOR", rocks.scale_m)
    if shelter is not None:
        _set_attribute(mesh, ROCK_SHELTER, "FLOAT", shelter.level)
        _set_attribute(mesh, ROCK_SHELTER_SLOPE, "FLOAT_VECTOR", shelter.slope)
    mesh.update()


def move_rocks(
    item: bpy.types.Object,
    rocks: Rocks,
    shapes: Sequence[Sequence[RockShape]],
    tag: str,
    shelter: RockShelter | None = None,
) -> bool:
    """Replace the rocks of an unedited object of ``build_rocks``, if it has the shapes of the new rocks and no copy
    shares its points. Returns whether the rocks were replaced."""
    used, pick = _number_shapes(rocks, shapes)
    there = sorted(
        (each for each in find_rock_parts(item, tag) if isinstance(each, bpy.types.Object)), key=lambda each: each.name
    )
    numbers = [divmod(number, len(shapes[0])) for number in used.tolist()]
    if (
        item.data.users > 1
        or len(there) != len(numbers)
        or not all(
            _has_shape(each.data, shapes[level][shape]) for each, (level, shape) in zip(there, numbers, strict=True)
        )
    ):
        return False
    _fill_points(item.data, rocks, pick, shelter)
    return True


def _has_shape(mesh: bpy.types.Mesh, shape: RockShape) -> bool:
    """Return whether a mesh of ``build_shapes`` has this shape."""
    if len(mesh.vertices) != len(shape.vertices) or not has_faces(mesh, shape.triangles):
        return False
    positions, faces = np.empty(shape.vertices.size, np.float32), np.empty(len(shape.face), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", positions)
    mesh.attributes[FACE_ATTRIBUTE].data.foreach_get("value", faces)
    return np.array_equal(positions, shape.vertices.astype(np.float32).ravel()) and np.array_equal(faces, shape.face)


def find_rock_parts(item: bpy.types.Object, tag: str) -> list[Any]:
    """Find the node groups, collections and shape objects that an object of rocks uses; empty for other objects."""
    groups = [m.node_group for m in item.modifiers if m.type == "NODES" and m.node_group and tag in m.node_group]
    libraries = [
        socket.default_value
        for group in groups
        for node in group.nodes
        for socket in node.inputs
        if socket.type == "COLLECTION" and socket.default_value
    ]
    return [*groups, *libraries, *(shape for library in libraries for shape in library.objects if tag in shape)]

"""Collects the triangles that Cycles traces of a scene, with their matrices and labels, for rays that Icy Moon traces.

Blender evaluates the objects of a view layer for its window. An object without a mesh, or one that looks different in a
render, is refused with a reason. Cycles then renders the truth too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ..nodes.datablocks.fingerprint import TAG
from ..nodes.ground.terrain_mesh import LOOSE
from ..nodes.light.celestial_meshes import TRANSMISSION
from ..nodes.tree.evaluate_field import read_numbers
from ..rays.engine import open_tracer
from ..rays.shapes import Placed, Shape, World
from ..rays.stereo_truth import Stage
from ..rays.surface import Tracer
from ..support.arrays import Array
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.labels import INSTANCE_ATTRIBUTE, SKY_TAGS
from .displaced_vertices import displace_corners, is_moved
from .mesh_arrays import (
    is_rendered,
    read_corners,
    read_material_slots,
    read_smooth_shading,
    read_triangles,
    read_vertices,
)
from .tree_tracer import TreeTracer
from .truth_without_light import is_opaque

#: Types of objects without a surface.
_SURFACELESS_TYPES = {"CAMERA", "LIGHT", "EMPTY", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE"}
_GROUND_TAGS, _ROCK_TAGS = ("terrain",), ("rock", "rock shape")


class CannotTrace(Exception):  # noqa: N818  it is an answer, not a fault
    """Raised if Icy Moon's rays would not hit the surfaces that Cycles renders; its message is a clause."""


@dataclass
class _LabelledMesh:
    """A mesh with the labels of its materials, and the matrices and the numbers of its instances."""

    shape: Shape | None
    places: list[Array]
    numbers: list[int]
    role: str


class SceneRays:
    """Rays through a scene that is rendered for one pair after another. Trees are built for the first pair."""

    def __init__(self, scene: bpy.types.Scene, still_m: float) -> None:
        """Prepare rays through a scene, without building trees yet. For ``still_m`` see
        ``displaced_vertices.open_rendered_mesh``."""
        self._scene, self._still_m = scene, still_m
        self._meshes: list[Any] = []
        self._standing: list[Any] = []
        self._parts: list[_LabelledMesh] = []
        self._refused: list[str] = []
        self._stage: Stage | None = None

    def prepare(self) -> Stage:
        """Prepare the stage for the present scene, and return it.

        Raises CannotTrace, and MemoryError if the trees need too much memory.
        """
        self._refresh()
        if self._refused:
            raise CannotTrace(self._refused[0])
        return self._open_stage()

    def require(self, what: str) -> Stage:
        """Return the stage of ``prepare``. Raises IcyMoonError if rays cannot be traced; its sentence begins with
        ``what``, such as "The scene cannot be scanned"."""
        try:
            return self.prepare()
        except CannotTrace as reason:
            raise IcyMoonError(
                f"{what} by rays, because {reason}; change the scene so that its truth is traced by rays."
            ) from None

    @contextmanager
    def open_ground(self, rocks: bool) -> Iterator[tuple[World, Tracer]]:
        """Yield the ground of the site in the present scene, with or without its rocks, and a tracer of rays through
        it. Other objects are omitted. Raises MemoryError as ``prepare`` does.
        """
        self._refresh()
        stage, roles = self._open_stage(), _GROUND_TAGS + (_ROCK_TAGS if rocks else ())
        near = [part for part in self._parts if part.role not in SKY_TAGS]
        world = World(
            [
                placed if part.role in roles else Placed(placed.shape, placed.places[:0], placed.numbers[:0])
                for part, placed in zip(near, stage.ground.placed, strict=True)
            ]
        )
        stage.ground_tracer.place(world)
        try:
            yield world, stage.ground_tracer
        finally:
            stage.ground_tracer.place(stage.ground)

    def _refresh(self) -> None:
        """Read the changed parts of the scene again."""
        items = [item for item in self._scene.objects if item.type not in _SURFACELESS_TYPES]
        meshes = [(item.name_full, item.data.as_pointer(), item.hide_render) for item in items]
        standing = [tuple(map(tuple, item.matrix_world)) for item in items]
        if meshes != self._meshes:
            self._read_scene()
        elif standing != self._standing:
            self._move_shapes()
        self._meshes, self._standing = meshes, standing

    def _read_scene(self) -> None:
        self.close()
        self._parts, self._refused = _collect_parts(self._scene, self._still_m)

    def _move_shapes(self) -> None:
        """Move the unchanged shapes to their new matrices."""
        made = _find_meshes(self._scene, read=False)
        found, self._refused = list(made.parts.values()), made.refused
        if len(found) != len(self._parts):
            self._read_scene()
            return
        for part, now in zip(self._parts, found, strict=True):
            part.places, part.numbers = now.places, now.numbers
        if self._stage is not None:
            ground, sky = self._make_worlds()
            self._stage.ground_tracer.place(ground)
            self._stage.sky_tracer.place(sky)
            self._stage = Stage(ground, self._stage.ground_tracer, sky, self._stage.sky_tracer)

    def _open_stage(self) -> Stage:
        """Build the stage, with trees, of the scene that was read."""
        if self._stage is None:
            ground, sky = self._make_worlds()
            tracers = [open_tracer(world, compat.list_library_folders(), TreeTracer) for world in (ground, sky)]
            self._stage = Stage(ground, tracers[0], sky, tracers[1])
        return self._stage

    def _make_worlds(self) -> tuple[World, World]:
        """Make the world of all near objects, and the world of the sky."""
        made: tuple[list[Placed], list[Placed]] = [], []
        for part in self._parts:
            assert part.shape is not None
            made[part.role in SKY_TAGS].append(
                Placed(part.shape, np.array(part.places), np.array(part.numbers, np.int64))
            )
        return World(made[0]), World(made[1])

    def close(self) -> None:
        """Free the memory of the search trees."""
        if self._stage is not None:
            self._stage.ground_tracer.close()
            self._stage.sky_tracer.close()
            self._stage = None


def _list_instances(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, bpy.types.DepsgraphObjectInstance]]:
    """Yield the instances of a scene that a render shows, with their objects."""
    layer = scene.view_layers[0]
    layer.update()
    for found in layer.depsgraph.object_instances:
        item = found.object
        if (
            is_rendered(found)
            and item.type not in _SURFACELESS_TYPES
            and item.original.get(TAG) != "stars"
            and (item.type != "MESH" or len(item.data.polygons))
        ):
            yield item, found


def _collect_parts(scene: bpy.types.Scene, still_m: float) -> tuple[list[_LabelledMesh], list[str]]:
    """Collect the meshes of a scene with their triangles, and the reasons why other objects are refused."""
    found = _find_meshes(scene, read=True)
    for key, (mesh, labels) in found.moved.items():
        found.parts[key].shape = _read_moved(mesh, labels, found.parts[key].places[0], still_m)
    return list(found.parts.values()), found.refused


_Key = tuple[int, tuple[int, ...]]


@dataclass
class _FoundMeshes:
    """The meshes of a scene with their labels, the meshes that their materials move, and the reasons why other objects
    are refused.
    """

    parts: dict[_Key, _LabelledMesh] = field(default_factory=dict)
    moved: dict[_Key, tuple[bpy.types.Mesh, tuple[int, ...]]] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)


def _find_meshes(scene: bpy.types.Scene, read: bool) -> _FoundMeshes:
    """Find the meshes of a scene with their instances.

    With ``read``, their shapes are read, except the shapes of moved meshes. The vertices of moved meshes are found in a
    separate scene, which discards the objects that are evaluated here.
    """
    made = _FoundMeshes()
    points: dict[str, Array] = {}
    for item, found in _list_instances(scene):
        try:
            _check_traceable(item)
            number = _find_label(item, found, points)
        except CannotTrace as reason:
            made.refused.append(str(reason))
            continue
        labels = tuple(slot.material.pass_index if slot.material else 0 for slot in item.material_slots) or (0,)
        key = item.data.as_pointer(), labels
        if key not in made.parts:
            made.parts[key] = _LabelledMesh(None, [], [], item.original.get(TAG, ""))
            if read and is_moved(item.data):
                made.moved[key] = item.original.data, labels
            elif read:
                made.parts[key].shape = _read_shape(item.data, labels)
        made.parts[key].places.append(np.array(found.matrix_world, np.float64))
        made.parts[key].numbers.append(number)
    return made


def _check_traceable(item: bpy.types.Object) -> None:
    """Raise CannotTrace if rays would not hit an object as it is rendered."""
    own = item.original
    if item.type != "MESH":
        raise CannotTrace(f"the object {own.name} has no mesh")
    if not item.visible_camera or item.is_holdout or item.is_shadow_catcher:
        raise CannotTrace(f"the camera does not see the object {own.name} in its place")
    if TAG in own:
        return
    for modifier in own.modifiers:
        levels = getattr(modifier, "render_levels", None)
        if modifier.show_viewport != modifier.show_render or levels not in (None, getattr(modifier, "levels", None)):
            raise CannotTrace(f"the object {own.name} has another mesh in renders than in the window")
    if own.modifiers and is_moved(item.data):
        raise CannotTrace(f"the object {own.name} has modifiers and a material that moves its vertices")
    for slot in item.material_slots:
        tree = slot.material.node_tree if slot.material else None
        output = tree.get_output_node("CYCLES") if tree is not None else None
        if tree is not None and output is not None and not is_opaque(tree, output):
            raise CannotTrace(f"the object {own.name} may let rays pass")


def _find_label(item: bpy.types.Object, found: bpy.types.DepsgraphObjectInstance, points: dict[str, Array]) -> int:
    """Find the label of an instance: the label of its point for a rock, else its pass index. Raises CannotTrace."""
    parent = found.parent.original if found.is_instance and found.parent is not None else None
    if parent is None or INSTANCE_ATTRIBUTE not in getattr(parent.data, "attributes", ()):
        return int(item.original.pass_index)
    if parent.name_full not in points:
        attribute = parent.data.attributes[INSTANCE_ATTRIBUTE]
        values = np.empty(len(attribute.data), np.float32)
        attribute.data.foreach_get("value", values)
        points[parent.name_full] = values
    index = found.persistent_id[0]
    if not 0 <= index < len(points[parent.name_full]):
        raise CannotTrace(f"the rocks of {parent.name} have other numbers than its points")
    return int(points[parent.name_full][index])


def _label_triangles(mesh: bpy.types.Mesh, labels: Sequence[int], facets: Array) -> Array:
    """Return the label (m,) uint8 of each triangle. ``labels``, by material slot, are looked up by the triangle's facet
    (m,)."""
    return np.asarray(labels, np.uint8)[np.clip(read_material_slots(mesh), 0, len(labels) - 1)[facets]]


def _read_shape(mesh: bpy.types.Mesh, labels: Sequence[int]) -> Shape:
    """Read the triangles of an evaluated mesh."""
    loops, facets = read_triangles(mesh)
    label = _label_triangles(mesh, labels, facets)
    return Shape(
        read_vertices(mesh),
        read_corners(mesh)[loops].astype(np.uint32),
        read_smooth_shading(mesh)[facets],
        label,
        read_numbers(mesh, TRANSMISSION),  # of a disc of rings
        read_numbers(mesh, LOOSE),
    )


def _read_moved(mesh: bpy.types.Mesh, labels: Sequence[int], place: Array, still_m: float) -> Shape:
    """Read the triangles of a mesh whose material displaces its vertices, in its first instance (4, 4)."""
    vertices, groups = displace_corners(mesh, place, still_m=still_m)
    loops, facets = read_triangles(mesh)
    loose = read_numbers(mesh, LOOSE)
    if loose is not None:
        of_groups = np.zeros(len(vertices), np.float32)
        of_groups[groups] = loose[read_corners(mesh)]
        loose = of_groups
    return Shape(
        vertices,
        groups[loops].astype(np.uint32),
        read_smooth_shading(mesh)[facets],
        _label_triangles(mesh, labels, facets),
        loose_m=loose,
    )

"""The share of falling frost that other ground and rocks keep from each vertex of the ground."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import bpy
import numpy as np

from ...physics.rocks.place_rocks import Rocks, make_instance_matrices
from ...physics.rocks.rock_shapes import RockShape
from ...physics.scene_requirements import needs_shelter
from ...physics.surfaces.fallen_frost import find_origin
from ...rays.engine import open_tracer, require_embree
from ...rays.exposure import find_exposed, list_directions
from ...rays.shapes import Placed, Shape, World
from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array
from ...support.blender import compat
from ...support.steps import Steps, finish
from ..datablocks.mesh_arrays import read_property

#: Attribute of vertices: the share of falling grains that other ground and rocks keep away. A mesh without it has none.
SHELTERED = "icymoon_sheltered"


def check_shelter(surface: SurfaceSettings) -> None:
    """Raise IcyMoonError if ``surface`` settings need rays and none can be traced."""
    if needs_shelter(surface):
        require_embree(compat.list_library_folders())


def mark_shelter(
    mesh: bpy.types.Mesh,
    surface: SurfaceSettings,
    rocks: Rocks | None = None,
    shapes: Sequence[Sequence[RockShape]] = (),
) -> None:
    """As ``mark_shelter_in_steps``, at once."""
    finish(mark_shelter_in_steps(mesh, surface, rocks, shapes))


def mark_shelter_in_steps(
    mesh: bpy.types.Mesh,
    surface: SurfaceSettings,
    rocks: Rocks | None = None,
    shapes: Sequence[Sequence[RockShape]] = (),
) -> Steps[None]:
    """Set the attribute ``SHELTERED`` of the ground's mesh if ``surface`` settings need it; otherwise remove it.

    ``rocks`` of the ``shapes`` hide ground too. A thread may trace the rays. Raises IcyMoonError if none can be traced.
    """
    existing = mesh.attributes.get(SHELTERED)
    if not needs_shelter(surface):
        if existing is not None:
            mesh.attributes.remove(existing)
        return
    folders = compat.list_library_folders()  # not in the thread, which may ask Blender nothing
    exposed = yield partial(_find_exposed, _read_shape(mesh), surface, rocks, shapes, folders)
    attribute = mesh.attributes.get(SHELTERED) or mesh.attributes.new(SHELTERED, "FLOAT", "POINT")
    attribute.data.foreach_set("value", (1.0 - exposed).astype(np.float32))


def _find_exposed(
    ground: Shape,
    surface: SurfaceSettings,
    rocks: Rocks | None,
    shapes: Sequence[Sequence[RockShape]],
    folders: Sequence[Path],
) -> Array:
    """Shares (n,) of the falling grains that reach the vertices of the ground; Embree may be in one of ``folders``."""
    world = World([Placed(ground, np.eye(4)[None], np.ones(1, np.int64)), *_place_rocks(rocks, shapes)])
    tracer = open_tracer(world, folders)
    try:
        directions = list_directions(find_origin(surface), surface.frost_spread_deg)
        return find_exposed(world, tracer, ground.vertices, directions)
    finally:
        tracer.close()


def _read_shape(mesh: bpy.types.Mesh) -> Shape:
    vertices = read_property(mesh.attributes["position"].data, "vector", width=3)
    corners = read_property(mesh.attributes[".corner_vert"].data, "value", np.int32)
    triangles = read_property(mesh.loop_triangles, "loops", np.int32, 3)
    return _make_shape(vertices.reshape(-1, 3), corners[triangles].reshape(-1, 3))


def _make_shape(vertices: Array, triangles: Array) -> Shape:
    count = len(triangles)
    return Shape(
        np.ascontiguousarray(vertices, np.float32),
        np.ascontiguousarray(triangles, np.uint32),
        np.zeros(count, bool),
        np.zeros(count, np.uint8),
    )


def _place_rocks(rocks: Rocks | None, shapes: Sequence[Sequence[RockShape]]) -> list[Placed]:
    """The rocks as instances of their shapes."""
    if rocks is None or not len(rocks.shape):
        return []
    matrices = make_instance_matrices(rocks.position_m, rocks.rotation, rocks.scale_m)
    found = []
    for level, shape in sorted(set(zip(rocks.level.tolist(), rocks.shape.tolist(), strict=True))):
        these = np.flatnonzero((rocks.level == level) & (rocks.shape == shape))
        made = _make_shape(shapes[level][shape].vertices, shapes[level][shape].triangles)
        found.append(Placed(made, matrices[these], these.astype(np.int64)))
    return found

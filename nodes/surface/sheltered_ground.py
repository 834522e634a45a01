"""The share of falling frost that ground and rocks keep from each vertex of the ground, and from each rock."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import bpy
import numpy as np

from ...physics.rocks.place_rocks import Rocks, make_instance_matrices
from ...physics.rocks.rock_shapes import RockShape
from ...physics.scene_requirements import needs_shelter, surface_topics
from ...physics.surfaces.fallen_frost import find_origin
from ...rays.engine import open_tracer, require_embree
from ...rays.exposure import find_exposed_share, list_directions
from ...rays.rock_exposure import RockShelter, find_rock_shelter
from ...rays.shapes import Placed, Shape, World
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array
from ...support.blender import compat
from ...support.steps import Steps, finish
from ..datablocks.mesh_arrays import read_property

#: Attribute of vertices: the share of falling grains that other ground and rocks keep away. A mesh without it has none.
SHELTERED = "icymoon_sheltered"


def check_shelter(settings: Settings) -> None:
    """Raise IcyMoonError if a surface of complete ``settings`` needs rays and none can be traced."""
    if any(needs_shelter(settings[topic]) for topic in surface_topics(settings)):
        require_embree(compat.list_library_folders())


def mark_shelter(
    mesh: bpy.types.Mesh,
    settings: Settings,
    rocks: Rocks | None = None,
    shapes: Sequence[Sequence[RockShape]] = (),
) -> RockShelter | None:
    """Mark the shelter at once, see ``mark_shelter_in_steps``."""
    return finish(mark_shelter_in_steps(mesh, settings, rocks, shapes))


def mark_shelter_in_steps(
    mesh: bpy.types.Mesh,
    settings: Settings,
    rocks: Rocks | None = None,
    shapes: Sequence[Sequence[RockShape]] = (),
) -> Steps[RockShelter | None]:
    """Set the attribute ``SHELTERED`` of the ground's mesh if its surface needs it; otherwise remove it. Return the
    shelter of ``rocks`` of the ``shapes``; None if they need none.

    Rocks and ground shelter each other. A thread may trace the rays. Raises IcyMoonError if none can be traced.
    """
    existing = mesh.attributes.get(SHELTERED)
    on_rocks = settings[surface_topics(settings)[-1]] if rocks is not None and len(rocks.shape) else None
    on_rocks = on_rocks if on_rocks is not None and needs_shelter(on_rocks) else None
    on_ground = settings.surface if needs_shelter(settings.surface) else None
    if existing is not None and on_ground is None:
        mesh.attributes.remove(existing)
    if on_ground is None and on_rocks is None:
        return None
    folders = compat.list_library_folders()  # not in the thread, which may ask Blender nothing
    exposed, shelter = yield partial(_trace_shelter, _read_shape(mesh), on_ground, on_rocks, rocks, shapes, folders)
    if exposed is not None:
        attribute = mesh.attributes.get(SHELTERED) or mesh.attributes.new(SHELTERED, "FLOAT", "POINT")
        attribute.data.foreach_set("value", (1.0 - exposed).astype(np.float32))
    return shelter


def _trace_shelter(
    ground: Shape,
    on_ground: SurfaceSettings | None,
    on_rocks: SurfaceSettings | None,
    rocks: Rocks | None,
    shapes: Sequence[Sequence[RockShape]],
    folders: Sequence[Path],
) -> tuple[Array | None, RockShelter | None]:
    """Trace the shares (n,) of the grains that reach the vertices of the ground, for its surface, and the shelter of
    the rocks, for theirs; None without a surface. Embree may be in one of ``folders``."""
    placed = _place_rocks(rocks, shapes)
    world = World([Placed(ground, np.eye(4)[None], np.ones(1, np.int64)), *placed])
    tracer, exposed, shelter = open_tracer(world, folders), None, None
    try:
        if on_ground is not None:
            exposed = find_exposed_share(world, tracer, ground.vertices, _list_directions(on_ground))
        if on_rocks is not None and rocks is not None:
            shelter = find_rock_shelter(world, tracer, placed, len(rocks.shape), _list_directions(on_rocks))
        return exposed, shelter
    finally:
        tracer.close()


def _list_directions(surface: SurfaceSettings) -> Array:
    """List the unit vectors (n, 3) toward the origin of the grains that fall on a surface."""
    return list_directions(find_origin(surface), surface.frost_spread_deg)


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
    """Return the rocks as instances of their shapes."""
    if rocks is None or not len(rocks.shape):
        return []
    matrices = make_instance_matrices(rocks.position_m, rocks.rotation, rocks.scale_m)
    found = []
    for level, shape in sorted(set(zip(rocks.level.tolist(), rocks.shape.tolist(), strict=True))):
        these = np.flatnonzero((rocks.level == level) & (rocks.shape == shape))
        made = _make_shape(shapes[level][shape].vertices, shapes[level][shape].triangles)
        found.append(Placed(made, matrices[these], these.astype(np.int64)))
    return found

"""Finds the heights of a mesh under given points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

import bpy
import numpy as np
from mathutils import Matrix

from ...physics.mesh.faces_under_points import FacesOnMap
from ...physics.rocks.place_rocks import HeightAt
from ...support.arrays import Array
from ..datablocks.mesh_arrays import fill_with_polygons, read_property

_ABOVE_M = 1.0


@contextmanager
def probe_heights(ground: bpy.types.Object) -> Iterator[HeightAt]:
    """Yield a function that returns the heights of the highest surface of a mesh object, at east and north coordinates.

    All are in metres; heights are NaN where there is no mesh. They are the heights of the triangles, not of the
    function that the mesh was made from, so that rocks lie on the rendered ground even if the mesh is coarse. A
    temporary scene computes the heights of 140 000 points on three million triangles in 1.4 processor seconds. The mesh
    must stay as it is until the end of the ``with`` block.
    """
    corners = np.array(ground.bound_box)
    start_m = float(np.float32(corners[:, 2].max() + _ABOVE_M))
    scene = bpy.data.scenes.new("Icy Moon Probe")
    points = bpy.data.objects.new("Icy Moon Probe", bpy.data.meshes.new("Icy Moon Probe"))
    near = bpy.data.objects.new("Icy Moon Probed", bpy.data.meshes.new("Icy Moon Probed"))
    choose_faces = _make_chooser(ground, near.data) if _is_mesh_in_place(ground) else None
    try:
        drop = points.modifiers.new("Drop", "SHRINKWRAP")
        drop.target, drop.wrap_method, drop.wrap_mode = near if choose_faces else ground, "PROJECT", "ON_SURFACE"
        drop.use_project_z, drop.use_positive_direction, drop.use_negative_direction = True, False, True
        drop.project_limit, drop.offset, drop.cull_face = 0.0, 0.0, "OFF"
        scene.collection.objects.link(drop.target)
        scene.collection.objects.link(points)

        def heights(x_m: Array, y_m: Array) -> Array:
            x, y = np.broadcast_arrays(x_m, y_m)
            if choose_faces is not None and not choose_faces(x.ravel(), y.ravel()):
                return np.full(x.shape, np.nan)
            return _drop_points(scene, points, x.ravel(), y.ravel(), start_m).reshape(x.shape)

        yield heights
    finally:
        meshes = [points.data, near.data]
        bpy.data.scenes.remove(scene)
        bpy.data.batch_remove([points, near, *meshes])


def _is_mesh_in_place(ground: bpy.types.Object) -> bool:
    """Return whether the vertices of an object's mesh are where the object shows them, in metres of the world."""
    moves = ground.parent or ground.constraints or ground.animation_data or ground.matrix_basis != Matrix()
    changes = ground.modifiers or ground.data.shape_keys or ground.data.is_editmode
    return not (moves or changes)


def _make_chooser(ground: bpy.types.Object, near: bpy.types.Mesh) -> Callable[[Array, Array], bool]:
    """Make a function that fills the mesh ``near`` with the faces of a ground that can lie under points, and returns
    whether there are any. Blender's tree of all triangles would take most of the time."""

    @cache
    def measure() -> tuple[Array, FacesOnMap]:
        mesh = ground.data
        at = read_property(mesh.attributes["position"].data, "vector", width=3).reshape(-1, 3)
        corners = read_property(mesh.attributes[".corner_vert"].data, "value", np.int32)
        starts = read_property(mesh.polygons, "loop_start", np.int32)
        return at, FacesOnMap.measure(at, corners, starts)

    def choose(x_m: Array, y_m: Array) -> bool:
        near.clear_geometry()
        if not len(ground.data.polygons):
            return False
        positions, faces = measure()
        corners, starts = faces.pick(faces.find_under(x_m.astype(np.float32), y_m.astype(np.float32)))
        used, place = np.unique(corners, return_inverse=True)
        fill_with_polygons(near, positions[used], place, np.diff(np.append(starts, len(corners))))
        return bool(len(starts))

    return choose


def _drop_points(scene: bpy.types.Scene, points: bpy.types.Object, x_m: Array, y_m: Array, start_m: float) -> Array:
    """Drop points from ``start_m`` and return the heights (n,) in metres where they hit the ground; NaN if they hit
    none."""
    if len(x_m) == 0:
        return np.zeros(0)
    positions = np.column_stack([x_m, y_m, np.full(len(x_m), start_m)])
    # Sorted in strips of the map: neighbours then use the same cached part of the tree of triangles, 7 times faster.
    strip = np.floor((y_m - y_m.min()) / max(float(np.ptp(y_m)), 1e-9) * 400)
    order = np.lexsort((x_m, strip))
    mesh = points.data
    mesh.clear_geometry()
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", positions[order].astype(np.float32).ravel())
    mesh.update()
    layer = scene.view_layers[0]
    layer.update()
    fallen = np.empty(positions.size, np.float32)
    points.evaluated_get(layer.depsgraph).data.vertices.foreach_get("co", fallen)
    heights = np.empty(len(positions))
    heights[order] = fallen[2::3]
    return np.where(heights >= start_m, np.nan, heights)

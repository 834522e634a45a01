"""Heights of a mesh under given points."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ...physics.rocks.place_rocks import HeightAt
from ...support.arrays import Array

_ABOVE_M = 1.0


@contextmanager
def probe_heights(ground: bpy.types.Object) -> Iterator[HeightAt]:
    """A function that returns the heights of the highest surface of a mesh object, at east and north coordinates.

    All are in metres; heights are NaN where there is no mesh. The triangles have these heights, not the function that
    the mesh was made from, so that rocks lie on the rendered ground even if the mesh is coarse. A temporary scene
    computes the heights, in about 4 µs for each point on two million triangles.
    """
    corners = np.array(ground.bound_box)
    start_m = float(np.float32(corners[:, 2].max() + _ABOVE_M))
    scene = bpy.data.scenes.new("Icy Moon Probe")
    points = bpy.data.objects.new("Icy Moon Probe", bpy.data.meshes.new("Icy Moon Probe"))
    try:
        drop = points.modifiers.new("Drop", "SHRINKWRAP")
        drop.target, drop.wrap_method, drop.wrap_mode = ground, "PROJECT", "ON_SURFACE"
        drop.use_project_z, drop.use_positive_direction, drop.use_negative_direction = True, False, True
        drop.project_limit, drop.offset, drop.cull_face = 0.0, 0.0, "OFF"
        scene.collection.objects.link(ground)
        scene.collection.objects.link(points)

        def heights(x_m: Array, y_m: Array) -> Array:
            x, y = np.broadcast_arrays(x_m, y_m)
            return _drop_points(scene, points, x.ravel(), y.ravel(), start_m).reshape(x.shape)

        yield heights
    finally:
        mesh = points.data
        bpy.data.scenes.remove(scene)
        bpy.data.objects.remove(points)
        bpy.data.meshes.remove(mesh)


def _drop_points(scene: bpy.types.Scene, points: bpy.types.Object, x_m: Array, y_m: Array, start_m: float) -> Array:
    """Heights (n,) in metres where points that drop from ``start_m`` hit the ground; NaN if they hit none."""
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

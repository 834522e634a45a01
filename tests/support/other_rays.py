"""A ray caster that is not Cycles': Blender's BVH tree over all triangles of a built scene, those of instances too."""

from __future__ import annotations

import bpy
import numpy as np
from icymoon.render.pairs.pair_folder import Pair
from mathutils.bvhtree import BVHTree


def tree_of_scene() -> BVHTree:
    """All triangles of the present scene as it is evaluated, in world axes, m."""
    bpy.context.view_layer.update()
    corners: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    count = 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        mesh = instance.object.data
        if not isinstance(mesh, bpy.types.Mesh) or not mesh.polygons:
            continue
        mesh.calc_loop_triangles()
        places, faces = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.vertices.foreach_get("co", places)
        mesh.loop_triangles.foreach_get("vertices", faces)
        pose = np.array(instance.matrix_world)
        corners.append(places.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3])
        triangles.append(faces.reshape(-1, 3) + count)
        count += len(corners[-1])
    return BVHTree.FromPolygons(np.concatenate(corners).tolist(), np.concatenate(triangles).tolist(),
                                all_triangles=True)


def cast_from_other_eye(tree: BVHTree, pair: Pair, eye: str, disparity: np.ndarray) -> np.ndarray:
    """Disparity (H, W), px, of what the other eye's ray to the point of each pixel of ``eye`` meets; NaN for sky.

    ``disparity`` (H, W), px, is that of the pixels; NaN for sky.
    """
    camera = pair.camera
    own, away = (pair.rectified_pose(each) for each in (eye, "right" if eye == "left" else "left"))
    assert own is not None
    assert away is not None
    met = np.full(disparity.shape, np.nan)
    rows, columns = np.nonzero(np.isfinite(disparity))
    depth = camera.depth(disparity[rows, columns])
    rays = np.stack([(columns + 0.5 - camera.cx_px) / camera.focal_px, (rows + 0.5 - camera.cy_px) / camera.focal_px,
                     np.ones(len(rows))], axis=-1)
    toward = (depth[:, None] * rays) @ own[:3, :3].T + own[:3, 3] - away[:3, 3]
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    start, forward = away[:3, 3].tolist(), away[:3, 2]
    for v, u, direction in zip(rows, columns, toward, strict=True):
        _, _, _, distance = tree.ray_cast(start, direction.tolist())
        if distance is not None:
            met[v, u] = camera.disparity(np.array(distance * (direction @ forward)))
    return met

"""A ray caster that is not Cycles': Blender's BVH tree over all triangles of a built scene, those of instances too."""

from __future__ import annotations

import bpy
import numpy as np
from icymoon.render.pairs.pair_folder import EYES, Pair
from icymoon.support.arrays import Array
from mathutils.bvhtree import BVHTree


def tree_of_scene(pair: Pair) -> BVHTree:
    """The triangles of the present scene as it is evaluated, in world axes, m, of which a part may be in the frame of
    an eye of ``pair``: rocks have far too many behind and beside the camera."""
    bpy.context.view_layer.update()
    corners: list[Array] = []
    triangles: list[Array] = []
    count = 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        mesh = instance.object.data
        if not isinstance(mesh, bpy.types.Mesh) or not mesh.polygons:
            continue
        pose = np.array(instance.matrix_world)
        box = np.array(instance.object.bound_box) @ pose[:3, :3].T + pose[:3, 3]
        if not any((_sides(pair, eye, box) <= 0).any(axis=1).all() for eye in EYES):
            continue
        mesh.calc_loop_triangles()
        places, faces = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.vertices.foreach_get("co", places)
        mesh.loop_triangles.foreach_get("vertices", faces)
        there = places.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]
        in_sight = np.any(
            [(_sides(pair, eye, there)[:, faces.reshape(-1, 3)] <= 0).any(axis=2).all(axis=0) for eye in EYES], axis=0
        )
        used, renumbered = np.unique(faces.reshape(-1, 3)[in_sight], return_inverse=True)
        corners.append(there[used])
        triangles.append(renumbered.reshape(-1, 3) + count)
        count += len(used)
    return BVHTree.FromPolygons(
        np.concatenate(corners).tolist(), np.concatenate(triangles).tolist(), all_triangles=True
    )


def _sides(pair: Pair, eye: str, points: Array) -> Array:
    """How far points (N, 3) are beyond each of the four sides and behind the plane of an eye's pyramid, (5, N), m."""
    camera, pose = pair.camera, pair.rectified_pose(eye)
    assert pose is not None
    right, down, ahead = ((points - pose[:3, 3]) @ pose[:3, :3]).T
    left_of, below = camera.cx_px / camera.focal_px, camera.cy_px / camera.focal_px
    right_of = (camera.width_px - camera.cx_px) / camera.focal_px
    above = (camera.height_px - camera.cy_px) / camera.focal_px
    return np.stack(
        [right - right_of * ahead, -right - left_of * ahead, down - above * ahead, -down - below * ahead, -ahead]
    )


def cast_from_other_eye(tree: BVHTree, pair: Pair, eye: str, disparity: Array) -> Array:
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
    rays = np.stack(
        [
            (columns + 0.5 - camera.cx_px) / camera.focal_px,
            (rows + 0.5 - camera.cy_px) / camera.focal_px,
            np.ones(len(rows)),
        ],
        axis=-1,
    )
    toward = (depth[:, None] * rays) @ own[:3, :3].T + own[:3, 3] - away[:3, 3]
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    start, forward = away[:3, 3].tolist(), away[:3, 2]
    for v, u, direction in zip(rows, columns, toward, strict=True):
        _, _, _, distance = tree.ray_cast(start, direction.tolist())
        if distance is not None:
            met[v, u] = camera.disparity(np.array(distance * (direction @ forward)))
    return met

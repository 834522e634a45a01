"""Exported meshes as foreign readers read them, and rays through them at the centres of a pair's pixels."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.render.pairs.pair_folder import Pair
from icymoon.stereo.images.exr import read_truth
from icymoon.support.arrays import Array
from rendering import empty_scene


def read_mesh(path: Path) -> tuple[Array, Array]:
    """Positions (n, 3) in the site's axes and triangles (m, 3) of all that is in a file."""
    if path.suffix == ".obj":
        return _read_obj(path)
    if path.suffix == ".usd":
        return _read_usd(path)
    trimesh = pytest.importorskip("trimesh")
    found = trimesh.load_scene(path, process=False).to_mesh()
    places = np.asarray(found.vertices)
    if path.suffix == ".glb":  # y up
        places = np.stack([places[:, 0], -places[:, 2], places[:, 1]], axis=1)
    return places, np.asarray(found.faces)


def _read_obj(path: Path) -> tuple[Array, Array]:
    lines = path.read_text(encoding="utf-8").splitlines()
    places = [line.split()[1:] for line in lines if line.startswith("v ")]
    corners = [[corner.split("/")[0] for corner in line.split()[1:]] for line in lines if line.startswith("f ")]
    return np.array(places, float), np.array(corners, int) - 1


def _read_usd(path: Path) -> tuple[Array, Array]:
    """What Blender's importer makes of it, which is Pixar's own reader, with all instances."""
    scene = empty_scene()
    bpy.ops.wm.usd_import(filepath=str(path))
    scene.view_layers[0].update()
    places, triangles, count = [], [], 0
    for found in scene.view_layers[0].depsgraph.object_instances:
        if found.object.type != "MESH" or not found.show_self:
            continue
        mesh, matrix = found.object.data, np.array(found.matrix_world)
        positions, corners = np.empty(3 * len(mesh.vertices), np.float32), np.empty(len(mesh.loops), np.int32)
        mesh.vertices.foreach_get("co", positions)
        mesh.loops.foreach_get("vertex_index", corners)
        places.append(positions.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(corners.reshape(-1, 3) + count)
        count += len(mesh.vertices)
    return np.concatenate(places), np.concatenate(triangles)


def depth_errors(pair: Pair, places: Array, triangles: Array) -> Array:
    """Relative differences (H, W) of the depth of a mesh from the true depth of the left eye; NaN where both are sky,
    infinity where one of them is."""
    pytest.importorskip("embreex")
    from trimesh import Trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    truth = read_truth(pair.truth("left"), "left").depth.astype(np.float64)
    camera, pose = pair.camera, pair.rectified_pose("left")
    assert pose is not None
    rows, columns = np.indices(truth.shape)
    rays = (
        np.stack(
            [
                (columns + 0.5 - camera.cx_px) / camera.focal_px,
                (rows + 0.5 - camera.cy_px) / camera.focal_px,
                np.ones(truth.shape),
            ],
            axis=-1,
        ).reshape(-1, 3)
        @ pose[:3, :3].T
    )
    eye = pose[:3, 3]
    hit = RayMeshIntersector(Trimesh(places - eye, triangles, process=False), scale_to_box=False).intersects_first(
        np.zeros_like(rays), rays
    )
    corners = (places - eye)[triangles]
    depth = np.where(hit < 0, np.inf, _planes(corners[hit], rays))
    wanted = np.where(np.isfinite(truth), truth, np.inf).ravel()
    for pixel in np.flatnonzero(_differ(depth, wanted) > 1e-5):  # embree's single precision takes a neighbour at edges
        depth[pixel] = _nearest(corners, rays[pixel])
    return _differ(depth, wanted).reshape(truth.shape)


def heights_below(east: Array, north: Array, places: Array, triangles: Array) -> Array:
    """Heights (n,) of a mesh at coordinates (n,), by rays from above."""
    pytest.importorskip("embreex")
    from trimesh import Trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    top = np.stack([east, north, np.full(len(east), places[:, 2].max() + 1.0)], axis=1)
    down = np.broadcast_to([0.0, 0.0, -1.0], top.shape)
    hit = RayMeshIntersector(Trimesh(places, triangles, process=False), scale_to_box=False).intersects_first(top, down)
    assert (hit >= 0).all()
    return np.asarray(top[:, 2] - _planes(places[triangles[hit]] - top[:, None], down))


def _differ(depth: Array, wanted: Array) -> Array:
    with np.errstate(invalid="ignore"):
        return np.where(
            np.isinf(depth) & np.isinf(wanted),
            np.nan,
            np.where(np.isinf(depth) | np.isinf(wanted), np.inf, np.abs(depth / wanted - 1.0)),
        )


def _planes(corners: Array, rays: Array) -> Array:
    """Multiples (n,) of rays (n, 3) from the origin at which they meet the planes of triangles (n, 3, 3)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("ij,ij->i", corners[:, 0], normals) / np.einsum("ij,ij->i", rays, normals)


def _nearest(corners: Array, ray: Array) -> float:
    """The smallest multiple of a ray from the origin that is on one of the triangles (n, 3, 3); infinity for none."""
    across, along = np.linalg.svd(ray[None])[2][1:]
    x, y = corners @ across, corners @ along
    turns = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y  # on which side the ray passes each edge
    through = np.flatnonzero((turns >= 0).all(axis=1) | (turns <= 0).all(axis=1))
    found = _planes(corners[through], np.broadcast_to(ray, (len(through), 3)))
    return float(found[found > 0].min(initial=np.inf))

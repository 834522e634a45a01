"""Heights of a mesh under points: equal to a search through all faces, and to the planes of the triangles."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.nodes.ground import heights_under
from icymoon.nodes.ground.heights_under import probe_heights
from icymoon.nodes.ground.terrain_mesh import build_mesh_from_arrays
from icymoon.support.arrays import Array
from rendering import empty_scene

#: Triangles that overlap on the map, and points.
TRIANGLES, POINTS = 400, 3000


def draw_triangles(random: np.random.Generator) -> Array:
    """Corners (m, 3, 3): triangles 1 cm to 10 m wide, some of them upright, a line or a point."""
    width = 10.0 ** random.uniform(-2.0, 1.0, (TRIANGLES, 1, 1))
    corners = random.uniform(-10.0, 10.0, (TRIANGLES, 1, 3)) + random.normal(size=(TRIANGLES, 3, 3)) * width
    corners[0::20, 1] = corners[0::20, 0]
    corners[1::20, :] = corners[1::20, :1]
    corners[2::20, :, 0] = corners[2::20, :1, 0]
    corners[3::20, 2] = corners[3::20, :2].mean(axis=1)
    return corners.astype(np.float32)


def draw_points(random: np.random.Generator, corners: Array) -> Array:
    """Places (n, 2) on the map: in triangles, on their edges, at their corners, and beside all of them."""
    some = corners[random.integers(0, TRIANGLES, POINTS), :, :2].astype(float)
    share = random.dirichlet(np.ones(3), POINTS)
    share[0::4] = np.eye(3)[random.integers(0, 3, len(share[0::4]))]
    share[1::4, 2], share[1::4, :2] = 0.0, 0.5
    places = (share[..., None] * some).sum(axis=1)
    places[-300:] = random.uniform(-60.0, 60.0, (300, 2))
    return places


def make_ground(positions: Array, faces: Array) -> bpy.types.Object:
    ground = bpy.data.objects.new("Ground", build_mesh_from_arrays("Ground", positions, faces))
    bpy.context.scene.collection.objects.link(ground)
    bpy.context.view_layer.update()
    return ground


def probe(ground: bpy.types.Object, places: Array, pieces: int = 1) -> Array:
    with probe_heights(ground) as height_at:
        return np.concatenate([height_at(*some.T) for some in np.array_split(places, pieces)])


def probe_all_faces(ground: bpy.types.Object, places: Array, monkeypatch: pytest.MonkeyPatch) -> Array:
    """The heights that a search through all faces finds."""
    with monkeypatch.context() as patch:
        patch.setattr(heights_under, "_is_mesh_in_place", lambda ground: False)
        return probe(ground, places)


def find_by_planes(corners: Array, places: Array) -> tuple[Array, Array]:
    """Heights (n,) of the highest triangle at places by barycentric coordinates in double precision; NaN where there is
    none. And whether a place (n,) is so close to an edge or an upright triangle that rounding decides."""
    a, b, c = (corners[:, k].astype(float) for k in range(3))
    u, v, w = (b - a)[:, :2], (c - a)[:, :2], places[:, None, :] - a[:, :2]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (w[..., 0] * v[:, 1] - w[..., 1] * v[:, 0]) / area
        t = (u[:, 0] * w[..., 1] - u[:, 1] * w[..., 0]) / area
        border = np.minimum(np.minimum(s, t), 1.0 - s - t)
        height = a[:, 2] + s * (b - a)[:, 2] + t * (c - a)[:, 2]
    thin = np.abs(area) < 1e-3 * (np.hypot(*u.T) + np.hypot(*v.T)) ** 2
    low, high = corners[:, :, :2].min(axis=1) - 1e-4, corners[:, :, :2].max(axis=1) + 1e-4
    near = ((places[:, None] > low) & (places[:, None] < high)).all(axis=2)
    unsure = (near & (thin | (np.abs(border) < 1e-3))).any(axis=1)
    hit = np.where((border > 0.0) & ~thin, height, -np.inf).max(axis=1)
    return np.where(np.isfinite(hit), hit, np.nan), unsure


@pytest.mark.parametrize("seed", range(3))
def test_the_heights_are_those_of_all_faces_and_of_planes(seed, monkeypatch):
    empty_scene()
    random = np.random.default_rng(seed)
    corners = draw_triangles(random)
    places = draw_points(random, corners)
    ground = make_ground(corners.reshape(-1, 3), np.arange(3 * TRIANGLES, dtype=np.int32).reshape(-1, 3))
    found = probe(ground, places)
    assert np.array_equal(found, probe_all_faces(ground, places, monkeypatch), equal_nan=True)
    assert np.array_equal(found, probe(ground, places, pieces=50), equal_nan=True)
    expected, unsure = find_by_planes(corners, places)
    assert 0.2 < np.mean(~unsure) < 0.9
    assert np.isnan(expected[~unsure]).any()
    # A place has the error of single precision at 60 m, 4 µm, times a slope under 1000, as no triangle is thinner.
    assert np.allclose(found[~unsure], expected[~unsure], rtol=0.0, atol=4e-3, equal_nan=True)


def test_quads_that_are_not_flat_keep_their_diagonals(monkeypatch):
    """Blender chooses the diagonal of a quad, which decides the height in its middle."""
    empty_scene()
    n, random = 60, np.random.default_rng(5)
    positions = np.stack([*np.meshgrid(np.arange(n), np.arange(n)), random.uniform(0, 1, (n, n))], axis=-1)
    positions[..., :2] += random.uniform(-0.6, 0.6, (n, n, 2))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.stack([corner, corner + 1, corner + n + 1, corner + n], axis=1).astype(np.int32)
    ground = make_ground(positions.reshape(-1, 3).astype(np.float32), faces)
    places = np.concatenate([random.uniform(-2.0, n + 1.0, (2000, 2)), positions[..., :2].reshape(-1, 2)])
    found = probe(ground, places)
    assert np.isfinite(found).mean() > 0.8
    assert np.array_equal(found, probe_all_faces(ground, places, monkeypatch), equal_nan=True)


def test_only_near_faces_are_searched(monkeypatch):
    """A grid of 9801 quads has few near three points; Blender's search would take long for all."""
    empty_scene()
    n, many = 100, []
    positions = np.stack([*np.meshgrid(np.arange(n), np.arange(n)), np.zeros((n, n))], axis=-1).astype(np.float32)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.stack([corner, corner + 1, corner + n + 1, corner + n], axis=1).astype(np.int32)
    ground = make_ground(positions.reshape(-1, 3), faces)
    drop = heights_under._drop_points

    def count(scene: bpy.types.Scene, points: bpy.types.Object, *more: Any) -> Array:
        many.append(len(points.modifiers[0].target.data.polygons))
        return drop(scene, points, *more)

    monkeypatch.setattr(heights_under, "_drop_points", count)
    assert probe(ground, np.array([[5.5, 5.5], [50.5, 50.5], [90.5, 5.5]])).tolist() == [0.0, 0.0, 0.0]
    assert 3 <= many[0] < 0.05 * len(faces)


@pytest.mark.parametrize("change", ["modifier", "location", "parent", "shape key"])
def test_what_moves_the_mesh_moves_the_heights(change):
    empty_scene()
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    ground = make_ground(square, np.arange(4, dtype=np.int32)[None])
    if change == "modifier":
        array = ground.modifiers.new("Array", "ARRAY")
        array.relative_offset_displace = (2.0, 0.0, 0.0)
    elif change == "shape key":
        ground.shape_key_add(name="Basis", from_mix=False)
        key = ground.shape_key_add(name="Moved", from_mix=False)
        for point in key.data:
            point.co.x += 4.0
        key.value = 1.0
    elif change == "parent":
        ground.parent = bpy.data.objects.new("Parent", None)
        bpy.context.scene.collection.objects.link(ground.parent)
        ground.parent.location.x = 4.0
    else:
        ground.location.x = 4.0
    bpy.context.view_layer.update()
    heights = probe(ground, np.array([[4.2, 0.3], [0.2, 0.3], [9.0, 0.0]]))
    assert heights[0] == 0.0
    assert np.isnan(heights[1]) == (change != "modifier")
    assert np.isnan(heights[2])


def test_a_mesh_without_faces_and_no_points_have_no_heights():
    empty_scene()
    bare = make_ground(np.zeros((3, 3), np.float32), np.empty((0, 3), np.int32))
    with probe_heights(bare) as height_at:
        assert np.isnan(height_at(np.zeros((2, 1)), np.zeros(3))).tolist() == [[True] * 3] * 2
        assert height_at(np.zeros(0), np.zeros(0)).shape == (0,)


def test_a_probe_leaves_nothing_behind():
    empty_scene()
    ground = make_ground(np.eye(3, dtype=np.float32), np.arange(3, dtype=np.int32)[None])
    kinds = ("objects", "meshes", "scenes", "collections")
    before = [len(getattr(bpy.data, kind)) for kind in kinds]
    assert np.isfinite(probe(ground, np.array([[0.3, 0.3]]))).all()
    assert [len(getattr(bpy.data, kind)) for kind in kinds] == before

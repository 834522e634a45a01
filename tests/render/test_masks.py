"""Labels of pixels: against a second ray caster, against silhouettes known by geometry, left against right."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.nodes.ground.terrain_mesh import build_mesh_from_arrays
from icymoon.physics.rocks.rock_shapes import make_icosphere
from icymoon.render.pairs.pair_folder import EYES, Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.images.disparity_and_occlusion import find_visible_in_right
from icymoon.stereo.images.exr import View, read_view
from icymoon.support.arrays import Array
from icymoon.support.labels import FIRST_OBJECT_INSTANCE, FIRST_ROCK_INSTANCE, LANDER, ROCK, TERRAIN, TERRAIN_INSTANCE
from rendering import complete, empty_scene

FLAT = {"terrain": {"rms_slope_deg": 0.0}, "quality": {"samples": 1}}


def shoot(folder: Path, *parts: dict, add: Callable[[Built], object] = lambda built: None) -> tuple[Pair, Built]:
    """Build, let ``add`` put something in, render one pair."""
    settings = complete(*parts)
    built = build_scene(empty_scene(), settings)
    add(built)
    folders = render_pairs(built, expand_headings(settings), folder, 1, time.perf_counter(), lambda *a, **k: None)
    return read_pair(folders[0]), built


def views(pair: Pair) -> dict[str, View]:
    return {eye: read_view(pair.image(eye)) for eye in EYES}


def rays(pair: Pair, eye: str) -> tuple[Array, Array]:
    """Optical centre (3,) and the directions (H, W, 3) through the pixel centres, of planar depth 1, in the world."""
    pose, camera = np.array(pair.data["poses_camera_to_world"][eye]), pair.camera
    u, v = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    x, y = (u - camera.cx_px) / camera.focal_px, (v - camera.cy_px) / camera.focal_px
    return pose[:3, 3], np.stack([x, y, np.ones_like(x)], axis=-1) @ pose[:3, :3].T


def own_object(built: Built, name: str, shape: str, size_m: float, place: tuple, **properties) -> bpy.types.Object:
    """Put a sphere (diameter) or a cube (edge) of the user's own into the collection."""
    if shape == "sphere":
        directions, faces = make_icosphere(6)
        corners = directions / 2
    else:
        corners = np.array(list(np.ndindex(2, 2, 2))) - 0.5
        faces = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    item = bpy.data.objects.new(name, build_mesh_from_arrays(name, corners * size_m, faces))
    item.location = place
    for key, value in properties.items():
        setattr(item, key, value)
    built.collection.objects.link(item)
    return item


def test_every_pixel_has_the_label_that_another_ray_caster_finds(tmp_path):
    pair, built = shoot(
        tmp_path,
        {
            "rocks": {"coverage": 0.15, "smallest_m": 0.25, "largest_m": 1.0, "clustering": 0.5},
            "terrain": {"rms_slope_deg": 15.0},
            "quality": {"samples": 1},
        },
    )
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    places = np.empty(built.rock_count * 3, np.float32)
    next(o for o in built.collection.all_objects if o.name == "Icy Moon Rock").data.vertices.foreach_get("co", places)
    block = {tuple(np.round(p, 4)): FIRST_ROCK_INSTANCE + k for k, p in enumerate(places.reshape(-1, 3).tolist())}
    for eye, view in views(pair).items():
        origin, directions = rays(pair, eye)
        expected = np.zeros(view.instance.shape, int)
        for at in np.ndindex(expected.shape):
            hit, _, _, _, item, matrix = bpy.context.scene.ray_cast(graph, origin.tolist(), directions[at].tolist())
            if hit:
                place = tuple(np.round(list(matrix.translation), 4))
                expected[at] = TERRAIN_INSTANCE if item.original == built.terrain else block[place]
        assert len(np.unique(expected)) > 15
        # A handful of rays graze an edge, where the two casters' single precision decides.
        assert np.mean(view.instance != expected) < 1e-3
        assert np.array_equal(
            view.semantic,
            np.select([view.instance >= FIRST_ROCK_INSTANCE, view.instance == TERRAIN_INSTANCE], [ROCK, TERRAIN], 0),
        )
        assert set(np.unique(view.instance)) <= {0, TERRAIN_INSTANCE, *block.values()}


def test_sky_is_zero_in_both_eyes(tmp_path):
    pair, _ = shoot(
        tmp_path, {"rocks": {"coverage": 0.1, "smallest_m": 0.2}, "rig": {"pitch_deg": 5.0}, "quality": {"samples": 1}}
    )
    for view in views(pair).values():
        sky = np.isnan(view.depth)
        assert 0.1 < sky.mean() < 0.9
        assert np.array_equal(view.semantic == 0, sky)
        assert np.array_equal(view.instance == 0, sky)


def test_left_labels_are_right_labels_where_the_true_depth_leads(tmp_path):
    pair, _ = shoot(
        tmp_path,
        {
            "rocks": {"coverage": 0.15, "smallest_m": 0.2, "largest_m": 1.0},
            "rig": {"width_px": 320, "height_px": 240},
            "quality": {"samples": 1},
        },
    )
    left, right = views(pair).values()
    camera = pair.camera
    visible = find_visible_in_right(left.depth, right.depth, camera)
    rows, columns = np.nonzero(visible)
    disparity = camera.disparity(left.depth[visible])
    x = columns - disparity
    low = np.clip(np.floor(x).astype(int), 0, camera.width_px - 2)
    across = [camera.disparity(right.depth[rows, low + k]) for k in (0, 1)]
    labels = [right.instance[rows, low + k] for k in (0, 1)]
    mine = left.instance[visible]
    # Where both pixels beside the point are of one thing at its disparity, nothing is left to interpretation.
    inside = (labels[0] == labels[1]) & (np.abs(across[0] - disparity) < 0.3) & (np.abs(across[1] - disparity) < 0.3)
    assert inside.mean() > 0.85
    assert len(np.unique(mine[inside])) > 20
    assert np.mean(labels[0][inside] != mine[inside]) < 1e-3
    # At edges the point is of one of the two neighbours, but for slivers between pixel centres.
    assert np.mean((labels[0] != mine) & (labels[1] != mine)) < 0.01
    assert np.array_equal(left.semantic == ROCK, left.instance >= FIRST_ROCK_INSTANCE)


def test_a_cubes_mask_is_its_silhouette(tmp_path):
    edge, centre = 0.5, np.array([0.1, 1.7, 0.9])
    pair, _ = shoot(tmp_path, FLAT, add=lambda b: own_object(b, "Lander", "cube", edge, tuple(centre)))
    for eye, view in views(pair).items():
        origin, directions = rays(pair, eye)
        sides = [((centre + s * edge / 2) - origin) / directions for s in (-1, 1)]
        enters, leaves = np.minimum(*sides).max(axis=-1), np.maximum(*sides).min(axis=-1)
        inside = leaves > enters
        assert 300 < inside.sum() < 4000
        assert np.array_equal(view.semantic == LANDER, inside)
        assert np.array_equal(view.instance == FIRST_OBJECT_INSTANCE, inside)
        assert np.allclose(view.depth[inside], enters[inside], rtol=1e-4)


def test_a_spheres_mask_is_its_silhouette(tmp_path):
    diameter, centre = 0.6, np.array([-0.1, 1.8, 1.0])
    pair, _ = shoot(tmp_path, FLAT, add=lambda b: own_object(b, "Lander", "sphere", diameter, tuple(centre)))
    for eye, view in views(pair).items():
        origin, directions = rays(pair, eye)
        along = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        nearest = np.linalg.norm(np.cross(along, centre - origin), axis=-1)
        mask = view.semantic == LANDER
        # 81920 triangles lie within 4e-4 of the radius inside the sphere.
        assert mask[nearest < diameter / 2 * (1 - 4e-4)].all()
        assert not mask[nearest > diameter / 2 * (1 + 1e-5)].any()
        assert mask.sum() > 200
        # Its own material does not say which way a facet faces; the shading normal does.
        assert np.abs(np.linalg.norm(view.normal[mask], axis=-1) - 1).max() < 5e-4


def test_what_is_the_persons_has_labels_and_is_left_as_it_was(tmp_path):
    made = {}

    def add(built: Built) -> None:
        painted, known = bpy.data.materials.new("Painted"), bpy.data.materials.new("Known")
        known.pass_index = 4
        bare = own_object(built, "A Bare", "cube", 0.3, (-0.6, 1.7, 0.5))
        plain = own_object(built, "B Painted", "cube", 0.3, (-0.15, 1.7, 0.5))
        plain.data.materials.append(painted)
        half = own_object(built, "C Empty Slot", "cube", 0.3, (0.3, 1.7, 0.5))
        half.data.materials.append(None)
        chosen = own_object(built, "D Chosen", "cube", 0.3, (0.75, 1.7, 0.5), pass_index=77)
        chosen.data.materials.append(known)
        part = bpy.data.objects.new("E Part", bare.data)
        library = bpy.data.collections.new("Library")
        library.objects.link(part)
        holder = bpy.data.objects.new("F Holder", None)
        holder.instance_type, holder.instance_collection, holder.location = "COLLECTION", library, (0.0, 2.3, 0.5)
        built.collection.objects.link(holder)
        made.update({o.name: o for o in (bare, plain, half, chosen, part)} | {"painted": painted, "known": known})

    pair, built = shoot(tmp_path, FLAT, add=add)
    for view in views(pair).values():
        found = {int(i): set(np.unique(view.semantic[view.instance == i]).tolist()) for i in np.unique(view.instance)}
        assert found == {TERRAIN_INSTANCE: {TERRAIN}, 2: {LANDER}, 3: {LANDER}, 4: {LANDER}, 5: {LANDER}, 77: {4}}
    assert [made[n].pass_index for n in ("A Bare", "B Painted", "C Empty Slot", "D Chosen", "E Part")] == [
        0,
        0,
        0,
        77,
        0,
    ]
    assert (made["painted"].pass_index, made["known"].pass_index) == (0, 4)
    assert list(made["A Bare"].data.materials) == []
    assert list(made["C Empty Slot"].data.materials) == [None]
    assert not any("Unlabelled" in m.name for m in bpy.data.materials)
    assert built.edited


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(600)
def test_labels_of_a_hundred_thousand_blocks_are_exact(tmp_path):
    pair, built = shoot(
        tmp_path,
        {
            "rocks": {"coverage": 0.4, "smallest_m": 0.01, "most": 100_000},
            "rig": {"width_px": 640, "height_px": 480},
            "quality": {"samples": 1},
        },
    )
    known = FIRST_ROCK_INSTANCE + built.rock_count
    for view in views(pair).values():
        assert view.instance.max() < known
        assert len(np.unique(view.instance)) > 2000
        assert np.array_equal(view.semantic == ROCK, view.instance >= FIRST_ROCK_INSTANCE)

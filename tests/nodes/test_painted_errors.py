"""The errors of a matcher painted on the ground: against rays to the vertices, and without a trace in a render."""

from __future__ import annotations

import threading
import time
from typing import Any

import bpy
import numpy as np
import pytest
from built_scenes import everything
from evaluations import evaluated
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import painted_errors
from icymoon.nodes.datablocks.array_marks import read_property
from icymoon.nodes.datablocks.fingerprint import find_instanced_objects, read_parts
from icymoon.operators import live_preview, recolour_errors
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings.blender import scene_properties
from icymoon.stereo.ground_errors import COARSE, MEASURED, MISSING, UNSEEN, read_depth_errors
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.images.image_files import write_disparity
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.support.errors import IcyMoonError
from icymoon.support.steps import finish
from mathutils import Vector
from pieces import count_pauses, stop_after, walk
from rendering import render
from thread_asks import list_asks_of_threads

SCENE = {
    "rig": {"width_px": 240, "height_px": 180},
    "terrain": {"resolution": 257, "size_m": 8.0},
    "rocks": {"coverage": 0.1, "smallest_m": 0.2},
}


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A rendered pair, its scene, and files of depths that are 10 % too far on the left and missing on the right."""
    folder = tmp_path_factory.mktemp("painted")
    pair, built = render(folder, SCENE)
    truth = prepare_pair(pair.folder, {}).truth
    there = np.arange(truth.shape[1]) < truth.shape[1] // 2
    files = folder / "evaluation_scene" / "pairs" / pair.id
    files.mkdir(parents=True)
    write_disparity(files / "far.npz", pair.camera.disparity(np.where(there, 1.1 * truth, np.nan)))
    write_disparity(files / "near.npz", pair.camera.disparity(0.95 * truth))
    scene_properties.write_settings(bpy.context.scene.icymoon, pair.settings)
    return pair, built, {name: files / f"{name}.npz" for name in ("far", "near")}


def paint(shown, name="far", full_m=1.0, full_at_start_m=None):
    pair, built, files = shown
    errors = painted_errors.find_errors(
        finish(painted_errors.read_meshes(built)),
        [read_depth_errors(pair.folder, files[name])],
        full_at_start_m or full_m,
    )
    return finish(painted_errors.show_errors(lambda: built, errors, name, lambda: full_m))


def read(mesh):
    """Error, kind and colour of the vertices."""
    colour = read_property(mesh.attributes[painted_errors.COLOUR].data, "color_srgb", width=4).reshape(-1, 4)[:, :3]
    return (
        read_property(mesh.attributes[painted_errors.ERROR_M].data, "value"),
        read_property(mesh.attributes[painted_errors.KIND].data, "value", np.int8),
        np.rint(255 * colour),
    )


@pytest.mark.long
def test_a_range_of_colours_that_changes_while_errors_are_found_holds(shown):
    mesh = shown[1].terrain.data
    found = [
        (paint(shown, full_m=full_m, full_at_start_m=start_m), read(mesh)[2])[1]
        for full_m, start_m in ((0.3, 0.3), (0.3, 5.0), (5.0, 5.0))
    ]
    assert (found[0] == found[1]).all()
    assert (found[0] != found[2]).any()


def test_vertices_that_rays_reach_have_the_error_of_their_depth(shown):
    pair, built, _ = shown
    paint(shown)
    error, kind, colour = read(built.terrain.data)
    camera, scene = built.camera, bpy.context.scene
    eye, graph = Vector(camera.matrix_world.translation), bpy.context.evaluated_depsgraph_get()
    scene.collection.children[painted_errors.NAME].hide_viewport = True  # rays shall meet the rocks themselves
    graph.update()
    positions = read_property(built.terrain.data.vertices, "co", width=3).reshape(-1, 3)
    local = np.array([camera.matrix_world.inverted() @ Vector(p) for p in positions[::7].tolist()])
    depth = -local[:, 2]
    column = pair.camera.cx_px + pair.camera.focal_px * local[:, 0] / depth
    row = pair.camera.cy_px - pair.camera.focal_px * local[:, 1] / depth
    inside = (depth > 0) & (column > 2) & (column < 238) & (row > 2) & (row < 178)

    def free(k: int, right_px: float = 0.0, up_px: float = 0.0) -> float:
        """The share of the way to a vertex that a ray can go, which may pass it by some pixels."""
        beside = Vector((right_px, up_px, 0.0)) * (depth[k] / pair.camera.focal_px)
        ray = Vector(positions[::7][k]) + camera.matrix_world.to_3x3() @ beside - eye
        hit, where, *_ = scene.ray_cast(graph, eye, ray.normalized(), distance=2 * ray.length)
        return (where - eye).length / ray.length if hit else 1.0

    rays = np.flatnonzero(inside)
    assert len(rays) > 300
    share = np.array([free(k) for k in rays])
    sampled, kinds = error[::7][rays], kind[::7][rays]
    hidden = np.array(
        [
            share < 0.95
            and all(free(k, *beside) < 0.95 for beside in ((-1.5, -1.5), (-1.5, 1.5), (1.5, -1.5), (1.5, 1.5)))
            for k, share in zip(rays, share, strict=True)
        ]
    )
    assert hidden.sum() > 20
    assert (kinds[hidden] == UNSEEN).all()
    assert np.mean(kinds[share > 0.999] < UNSEEN) > 0.98
    measured, left = kinds == MEASURED, column[rays] < 120
    np.testing.assert_allclose(sampled[measured], 0.1 * depth[rays][measured], rtol=0.1)
    assert (kinds[(column[rays] > 122) & (share > 0.999)] == MISSING).mean() > 0.9
    assert left[measured].mean() > 0.97
    assert (colour[kind == MISSING] == 150).all()
    assert (colour[kind == UNSEEN] == 60).all()
    assert (colour[error > 0.05, 0] > colour[error > 0.05, 2]).all()
    assert np.isnan(error[kind != MEASURED]).all()
    painted_errors.clear_painted(scene)


def test_rocks_that_are_seen_show_their_errors_too(shown):
    _, built, _ = shown
    collection = paint(shown, "near")
    (copies,) = collection.objects
    (field,) = (item for item in built.collection.all_objects if item.get("icymoon") == "rock")
    shapes = list(find_instanced_objects(field))
    assert shapes
    for shape in shapes:  # what is behind the copies is dark, never white
        assert (read(shape.data)[2] == 60).all()
    error, kind, _ = read(copies.data)
    depth = np.linalg.norm(
        read_property(copies.data.vertices, "co", width=3).reshape(-1, 3)
        - np.array(built.camera.matrix_world.translation),
        axis=1,
    )
    assert copies.hide_render
    rays = [name for name in dir(copies) if name.startswith("visible_") and name != "visible_get"]
    # Or they hide the rocks in a rendered view; Grease Pencil's masks and the like are no rays.
    assert len(rays) >= 6
    assert not any(getattr(copies, name) for name in rays if isinstance(getattr(copies, name), bool))
    assert (kind == MEASURED).sum() > 50
    assert (error[kind == MEASURED] < 0).all()
    assert (-error[kind == MEASURED] < 0.07 * depth[kind == MEASURED]).all()
    assert (kind == UNSEEN).sum() > 50  # their backs
    assert not (kind == COARSE).any()  # copies are divided
    painted_errors.clear_painted(bpy.context.scene)
    assert all(painted_errors.COLOUR not in shape.data.attributes for shape in shapes)


def read_copies(collection):
    """Position, error and kind of all vertices of copies, sorted."""
    rows = [
        np.column_stack([read_property(item.data.vertices, "co", width=3).reshape(-1, 3), *read(item.data)[:2]])
        for item in collection.objects
    ]
    found = np.concatenate(rows)
    return found[np.lexsort(found.T)]


def test_many_copies_are_made_object_by_object_in_pieces(shown, monkeypatch):
    most = 45_000  # a rock has 40 962 at most
    whole = read_copies(paint(shown))
    assert len(whole) > 3 * most
    monkeypatch.setattr(painted_errors, "_MAX_COPIED", most)
    meshes, steps = [len(bpy.data.meshes)], begin_to_paint(shown)()
    collection = walk(steps, lambda: meshes.append(len(bpy.data.meshes)))
    sizes = [len(item.data.vertices) for item in collection.objects]
    assert max(np.diff(meshes)) == 1
    assert max(sizes) <= most
    assert len(sizes) < 2.5 * len(whole) / most  # small ones are joined: two neighbours fill an object
    np.testing.assert_array_equal(read_copies(collection), whole)
    painted_errors.clear_painted(bpy.context.scene)
    assert not [item for item in bpy.data.objects if painted_errors.NAME in item.name]


@pytest.mark.heavy
def test_nothing_that_is_rendered_or_identified_changes(shown, tmp_path):
    pair, built, _ = shown
    scene, mesh = bpy.context.scene, built.terrain.data
    blocks = [len(data) for data in (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.collections)]
    before = read_parts(built.collection), built.extra, set(mesh.attributes.keys()), mesh.attributes.default_color_name
    paint(shown)
    assert (read_parts(built.collection), built.extra) == before[:2]
    assert not built.edited
    (planned,) = expand_headings(pair.settings, built.extra)
    assert planned.id == pair.id
    (again,) = render_pairs(built, [planned], tmp_path, 1, 0.0, lambda *a, **k: None)
    assert painted_errors.find_painted(scene) is None  # a material of the user's could read it
    assert set(mesh.attributes.keys()) == before[2]
    assert read_parts(built.collection) == before[0]
    assert mesh.attributes.default_color_name == before[3]
    assert blocks == [
        len(data) for data in (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.collections)
    ]
    for eye in ("left", "right"):
        one, other = (read_view(folder / f"{eye}.exr", eye) for folder in (pair.folder, again))
        np.testing.assert_array_equal(one.radiance, other.radiance)
        np.testing.assert_array_equal(one.depth, other.depth)


def test_the_users_own_colours_are_active_again_afterwards(shown):
    _, built, _ = shown
    mesh = built.terrain.data
    for name in ("First", "Second"):
        mesh.color_attributes.new(name, "BYTE_COLOR", "POINT")
    mesh.attributes.active_color_name, mesh.attributes.default_color_name = "Second", "First"
    marked = read_parts(built.collection)
    try:
        paint(shown)
        paint(shown, "near")
        assert mesh.attributes.active_color_name == painted_errors.COLOUR
        assert mesh.attributes.default_color_name == "First"
        assert read_parts(built.collection) == marked
        assert painted_errors.clear_painted(bpy.context.scene)
        assert not painted_errors.clear_painted(bpy.context.scene)
        assert (mesh.attributes.active_color_name, mesh.attributes.default_color_name) == ("Second", "First")
    finally:
        for name in ("First", "Second"):
            mesh.attributes.remove(mesh.attributes[name])


def test_a_ground_of_wide_triangles_is_refused_and_one_of_both_kinds_says_so(shown):
    pair, built, _ = shown
    scene, known = bpy.context.scene, np.isfinite(prepare_pair(pair.folder, {}).truth)
    paint(shown)
    lines = dict(line.split(": ") for line, _ in painted_errors.make_legend(scene) if ": " in line)
    assert sum(float(lines[key].removesuffix(" %")) for key in lines if "Triangles" not in key) == pytest.approx(
        100, abs=0.2
    )
    assert float(lines["Not measured, grey"].removesuffix(" %")) == pytest.approx(
        100 * known[:, 120:].sum() / known.sum(), abs=0.06
    )
    fine, coarse = built.terrain.data, bpy.data.meshes.new("Coarse")
    corners = [(-4.0, -4.0, 0.0), (4.0, -4.0, 0.0), (4.0, 4.0, 0.0), (-4.0, 4.0, 0.0)]
    coarse.from_pydata(corners, [], [(0, 1, 2, 3)])
    built.terrain.data = coarse
    rocks = [item for item in built.collection.all_objects if item.get("icymoon") == "rock"]
    for item in rocks:
        item.hide_viewport = True
    try:
        with pytest.raises(IcyMoonError, match="too wide"):
            paint(shown)
    finally:
        built.terrain.data = fine
        for item in rocks:
            item.hide_viewport = False
        bpy.data.meshes.remove(coarse)
    assert painted_errors.find_painted(scene) is not None  # a refusal leaves what is shown
    painted_errors.clear_painted(scene)
    assert painted_errors.make_legend(scene) == ()
    assert painted_errors.find_title(scene) == ""


@pytest.fixture
def evaluated_pair(shown):
    """A scene whose pair was evaluated."""
    pair, *_ = shown
    scene = bpy.context.scene
    rows = [
        {"method": name, "pair": pair.id, "images": {"disparity": f"pairs/{pair.id}/{file}.npz"}}
        for name, file in (("far", "far"), ("near", "near"), ("bm:window=7", "far"))
    ]
    summary = [
        {"method": name, "l1_m": l1, "l1_rate_10": 0, "si_rmse": 0, "dod": 0, "coverage": 1}
        for name, l1 in (("far", 0.3), ("near", 0.1), ("bm:window=7", 0.3))
    ]
    evaluated(scene, pair.folder.parent.parent, *summary, shown=rows)
    yield scene
    painted_errors.clear_painted(scene)
    scene.icymoon.results = ""


@pytest.mark.long
def test_by_operator_with_its_range(shown, evaluated_pair):
    _, built, _ = shown
    scene, mesh = evaluated_pair, built.terrain.data
    assert bpy.ops.icymoon.paint_errors() == {"FINISHED"}
    assert painted_errors.make_legend(scene)[0][0] == "Depth error of near on the ground"
    assert bpy.ops.icymoon.paint_errors(method="bm:window=7") == {"FINISHED"}
    assert painted_errors.make_legend(scene)[0][0] == "Depth error of StereoBM window=7 on the ground"  # as its tick
    assert painted_errors.find_title(scene) == "StereoBM window=7"
    assert bpy.ops.icymoon.paint_errors(method="far") == {"FINISHED"}
    error, _, colour = read(mesh)
    large = error > 0.15
    assert (colour[large] != [0xC4, 0x2B, 0x2B]).any(axis=1).all()
    scene.icymoon.error_range_m = 0.15
    assert (read(mesh)[2][large] == [0xC4, 0x2B, 0x2B]).all()
    scene.icymoon.error_range_m = 1.0
    np.testing.assert_array_equal(read(mesh)[2], colour)
    with pytest.raises(RuntimeError, match="no stored disparities"):
        bpy.ops.icymoon.paint_errors(method="sgbm")
    assert bpy.ops.icymoon.hide_surface() == {"FINISHED"}
    assert painted_errors.find_painted(scene) is None
    assert not bpy.ops.icymoon.hide_surface.poll()


def test_the_range_is_followed_in_pieces_up_to_its_last_value(shown, evaluated_pair, monkeypatch):
    """To colour a ground of a million vertices takes half a second, in which the window must stay usable."""
    scene, mesh = evaluated_pair, shown[1].terrain.data
    bpy.ops.icymoon.paint_errors(method="far")
    before = read(mesh)[2].copy()
    scene.icymoon.error_range_m = 0.15
    at_once = read(mesh)[2].copy()
    assert (at_once != before).any()
    scene.icymoon.error_range_m = 1.0
    threads, colour = list[bool](), painted_errors.colour_errors
    monkeypatch.setattr(
        painted_errors,
        "colour_errors",
        lambda *of: threads.append(threading.current_thread() is not threading.main_thread()) or colour(*of),
    )
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    asked = list_asks_of_threads(monkeypatch)
    scene.icymoon.error_range_m = 0.4
    assert threads == []
    recolour_errors._recolour_next()
    scene.icymoon.error_range_m = 0.15  # while a thread colours for 0.4 m
    while recolour_errors._recolour_next() is not None:
        time.sleep(0.001)
    np.testing.assert_array_equal(read(mesh)[2], at_once)
    assert threads
    assert all(threads)
    assert asked == []


def test_errors_that_are_removed_while_they_are_coloured_stay_removed(shown, evaluated_pair, monkeypatch):
    scene, mesh = evaluated_pair, shown[1].terrain.data
    bpy.ops.icymoon.paint_errors(method="far")
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    scene.icymoon.error_range_m = 0.4
    recolour_errors._recolour_next()
    bpy.ops.icymoon.hide_surface()
    while recolour_errors._recolour_next() is not None:
        time.sleep(0.001)
    assert painted_errors.COLOUR not in mesh.attributes


def test_undo_has_the_colours_of_its_range(shown, evaluated_pair, monkeypatch):
    """Undo may bring the range back without the colours, which follow a slider after its step."""
    scene, mesh = evaluated_pair, shown[1].terrain.data
    bpy.ops.icymoon.paint_errors(method="far")
    expected = read(mesh)[2].copy()
    mesh.attributes[painted_errors.COLOUR].data.foreach_set("color", np.zeros(4 * len(expected), np.float32))
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    monkeypatch.setattr(recolour_errors, "_list_shown_scenes", lambda: [scene])
    recolour_errors._follow_undo()
    while recolour_errors._recolour_next() is not None:
        time.sleep(0.001)
    np.testing.assert_array_equal(read(mesh)[2], expected)


@pytest.mark.long
@pytest.mark.usefixtures("evaluated_pair")
def test_other_sampling_light_and_surface_are_painted_as_the_same(shown):
    _, built, _ = shown
    bpy.ops.icymoon.paint_errors(method="far")
    painted = read(built.terrain.data)
    for topic, key, value in (
        ("quality", "samples", 77),
        ("light", "sun_elevation_deg", 41.0),
        ("surface", "albedo", 0.31),
        ("quality", "diffuse_bounces", 2),
    ):
        group = getattr(bpy.context.scene.icymoon, topic)
        was = getattr(group, key)
        setattr(group, key, value)
        painted_errors.clear_painted(bpy.context.scene)
        assert bpy.ops.icymoon.paint_errors(method="far") == {"FINISHED"}
        for one, other in zip(painted, read(built.terrain.data), strict=True):
            np.testing.assert_array_equal(one, other)
        setattr(group, key, was)


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("topic", "key", "other"),
    [("terrain", "rms_slope_deg", "ground"), ("rig", "pitch_deg", "camera"), ("rig", "heading_deg", "camera")],
)
@pytest.mark.usefixtures("evaluated_pair")
def test_another_ground_or_camera_is_refused_by_name(shown, topic, key, other):
    """Before it is built, and after: ``remember`` is what a build leaves."""
    pair, built, _ = shown
    group, before = getattr(bpy.context.scene.icymoon, topic), built.settings
    was = getattr(group, key)
    setattr(group, key, was + 1)
    try:
        with pytest.raises(RuntimeError, match=f"{topic}.{key} has changed since .* press Build Scene first"):
            bpy.ops.icymoon.paint_errors()
        built.remember(scene_properties.read_settings(bpy.context.scene.icymoon), {})
        with pytest.raises(RuntimeError, match=rf"pair {pair.id} has another {other} .*: {topic}.{key} differs\."):
            bpy.ops.icymoon.paint_errors()
    finally:
        setattr(group, key, was)
        built.remember(before, {})
    assert bpy.ops.icymoon.paint_errors() == {"FINISHED"}


@pytest.mark.usefixtures("evaluated_pair")
def test_another_heading_of_the_scene_is_no_other_camera(shown):
    """The pair is that of the second of four headings of a scene that looks elsewhere first."""
    pair, built, _ = shown
    before, root = built.settings, bpy.context.scene.icymoon
    was = root.rig.heading_deg
    root.rig.heading_deg = was - 90.0
    built.remember(scene_properties.read_settings(root), {})
    try:
        assert "another camera" in finish(painted_errors.why_not_shown(built, 1, pair))
        assert finish(painted_errors.why_not_shown(built, 4, pair)) == ""
    finally:
        root.rig.heading_deg = was
        built.remember(before, {})


@pytest.mark.usefixtures("evaluated_pair")
def test_edits_of_the_ground_are_refused_and_those_of_the_light_are_not(shown):
    pair, built, _ = shown
    built.sun.rotation_euler.x += 0.2
    corner = built.terrain.data.vertices[0].co.copy()
    try:
        assert built.edited
        assert bpy.ops.icymoon.paint_errors() == {"FINISHED"}
        built.terrain.data.vertices[0].co.z += 0.5
        with pytest.raises(RuntimeError, match=f"other edits by hand than those of the evaluated pair {pair.id}"):
            bpy.ops.icymoon.paint_errors()
    finally:
        built.terrain.data.vertices[0].co = corner
        built.sun.rotation_euler.x -= 0.2


def linked() -> tuple[list[str], list[str], list[str]]:
    """What the scene shows: collections, objects, and the attributes of the ground."""
    scene, attributes = bpy.context.scene, scenes.find_built(bpy.context.scene).terrain.data.attributes
    return scene.collection.children.keys(), scene.objects.keys(), attributes.keys()


def state() -> list[object]:
    """What the scene shows, and the attributes of all meshes in use."""
    shown = [(mesh.name, sorted(mesh.attributes.keys())) for mesh in bpy.data.meshes if mesh.users]
    return [shown, linked()]


def begin_to_paint(shown, full_m=1.0):
    """The steps that paint errors, and the errors."""
    pair, built, files = shown
    found = [read_depth_errors(pair.folder, files["far"])]
    errors = painted_errors.find_errors(finish(painted_errors.read_meshes(built)), found, 1.0)
    return lambda: painted_errors.show_errors(lambda: built, errors, "far", lambda: full_m)


@pytest.mark.parametrize("full_m", [1.0, 0.3])
def test_the_last_piece_alone_changes_the_scene(shown, full_m):
    painted_errors.clear_painted(bpy.context.scene)
    before, paint_in_steps, states = linked(), begin_to_paint(shown, full_m), []
    collection = walk(paint_in_steps(), lambda: states.append(linked()))
    assert states
    assert all(each == before for each in states)
    assert painted_errors.COLOUR in shown[1].terrain.data.attributes
    assert [item.name for item in collection.objects] == [painted_errors.NAME + " on Rocks"]


def test_nothing_is_left_wherever_painting_stops(shown):
    painted_errors.clear_painted(bpy.context.scene)
    before, counts, paint_in_steps = state(), everything(), begin_to_paint(shown)
    pauses, _ = count_pauses(paint_in_steps())
    painted_errors.clear_painted(bpy.context.scene)
    for number in range(1, pauses + 1):
        stop_after(paint_in_steps(), number)
        assert (state(), everything()) == (before, counts), f"after {number} pauses"


def test_what_was_painted_stays_if_a_part_of_the_new_painting_is_purged(shown):
    paint(shown)
    counts, steps = everything(), begin_to_paint(shown)()
    with pytest.raises(IcyMoonError, match="was removed while it was made"):
        walk(steps, lambda: bpy.ops.outliner.orphans_purge(do_recursive=True))
    assert painted_errors.find_painted(bpy.context.scene) is not None
    assert everything() == counts


def test_repainted_copies_keep_their_name(shown):
    for _ in range(2):
        assert paint(shown).objects.keys() == [painted_errors.NAME + " on Rocks"]


def test_each_large_array_of_the_ground_is_read_in_a_piece_of_its_own(shown, monkeypatch):
    """A piece holds the window for the time that it takes to copy what it reads."""
    sizes, pieces, read_one = [0], [], painted_errors.read_property

    def note(*arguments: Any, **options: Any) -> Any:
        found = read_one(*arguments, **options)
        sizes[-1] += found.nbytes
        return found

    monkeypatch.setattr(painted_errors, "read_property", note)
    meshes = walk(painted_errors.read_meshes(shown[1]), lambda: sizes.append(0))
    pieces = sorted(sizes)[::-1]
    assert pieces[:2] == sorted([meshes.edges.nbytes, meshes.position.nbytes])[::-1]

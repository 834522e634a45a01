"""The measured surface back in Blender, beside the true one."""

import bpy
import numpy as np
import pytest
from evaluations import evaluated
from icymoon.formats import ply
from icymoon.nodes import measured_surface
from icymoon.operators import results
from icymoon.stereo.export.points import write_points
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from rendering import render


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A rendered pair, its scene, and the file of a surface that a perfect and a wrong matcher measured."""
    folder = tmp_path_factory.mktemp("points")
    pair, built = render(folder)
    prepared = prepare_pair(pair.folder, {})
    true = pair.camera.disparity(prepared.truth)
    # A quarter too far, a quarter too near, a quarter right and a quarter missing.
    quarters = true * np.repeat([0.9, 1.1, 1.0, np.nan], true.shape[1] // 4)
    for name, disparity in (("right", true), ("wrong", true * 0.9), ("blind", true * np.nan), ("quarters", quarters)):
        write_points(folder / f"{name}.ply", prepared, disparity)
    return folder, built


def corners(item: bpy.types.Object) -> Array:
    values = np.empty(len(item.data.vertices) * 3, np.float32)
    item.data.vertices.foreach_get("co", values)
    return values.reshape(-1, 4, 3)


def test_a_perfect_measurement_lies_on_the_ground_that_was_built(shown):
    folder, built = shown
    item = measured_surface.build_points(bpy.context.scene, [folder / "right.ply"], "right")
    ground = BVHTree.FromObject(built.terrain, bpy.context.evaluated_depsgraph_get())
    centres = corners(item).mean(axis=1)
    away = np.array([ground.find_nearest(Vector(c))[3] for c in centres.tolist()])
    # Depth is true to 1e-4 of it, some metres here; blocks are off the ground, and there are none.
    assert built.rock_count == 0
    assert np.median(away) < 1e-3
    assert np.quantile(away, 0.99) < 1e-2
    wrong = measured_surface.build_points(bpy.context.scene, [folder / "wrong.ply"], "wrong")
    away = np.array([ground.find_nearest(Vector(c))[3] for c in corners(wrong).mean(axis=1)[::50].tolist()])
    assert np.median(away) > 0.02


def test_squares_face_the_camera_and_keep_their_colour(shown):
    folder, built = shown
    item = measured_surface.build_points(bpy.context.scene, [folder / "wrong.ply"], "wrong")
    position, _, width, _ = measured_surface.read_points(folder / "wrong.ply")
    colour = ply.read_properties(folder / "wrong.ply", "red", "green", "blue") / 255.0
    quads = corners(item)
    np.testing.assert_allclose(quads.mean(axis=1), position, atol=1e-4)
    normals = np.empty(len(item.data.polygons) * 3, np.float32)
    item.data.polygons.foreach_get("normal", normals)
    eye = np.array(built.camera.matrix_world.translation) - position
    cosine = np.sum(normals.reshape(-1, 3) * eye / np.linalg.norm(eye, axis=1, keepdims=True), axis=1)
    assert cosine.min() > 0.99
    np.testing.assert_allclose(np.linalg.norm(quads[:, 1] - quads[:, 0], axis=1), width, rtol=2e-2)
    stored = np.empty(len(item.data.vertices) * 4, np.float32)
    item.data.color_attributes["error"].data.foreach_get("color_srgb", stored)
    np.testing.assert_allclose(stored.reshape(-1, 4, 4)[:, 0, :3], colour, atol=0.51 / 255)
    assert item.data.color_attributes.active_color.name == "error"


def test_errors_of_either_sign_are_seen(shown):
    """What is too far lies under the ground: it is drawn in front of it, or only half of the errors would be seen."""
    folder, built = shown
    scene = bpy.context.scene
    before = built.terrain.hide_viewport, built.terrain.display_type, built.terrain.show_in_front
    item = measured_surface.build_points(scene, [folder / "quarters.ply"], "quarters")
    assert item.show_in_front
    assert not item.hide_viewport
    assert item.display_type == "TEXTURED"
    error = measured_surface.read_points(folder / "quarters.ply")[3]
    colour = ply.read_properties(folder / "quarters.ply", "red", "green", "blue")
    ground = BVHTree.FromObject(built.terrain, bpy.context.evaluated_depsgraph_get())
    eye = Vector(built.camera.matrix_world.translation)
    centres = corners(item).mean(axis=1)
    for sign, hidden, red in ((1, 1.0, True), (-1, 0.0, False)):
        own = error * sign > 0.05
        assert own.sum() > 100
        assert ((colour[own, 0] > colour[own, 2]) == red).all()
        rays = [Vector(centre) - eye for centre in centres[own][::40].tolist()]
        met = [(ground.ray_cast(eye, ray)[3] or np.inf) < ray.length for ray in rays]
        assert np.mean(met) == pytest.approx(hidden, abs=0.05)  # the ground is before it, seen from the camera
    assert (built.terrain.hide_viewport, built.terrain.display_type, built.terrain.show_in_front) == before
    assert not built.edited
    shares = dict(line.split(": ") for line, _ in measured_surface.make_legend(scene) if ": " in line)
    assert set(shares) == {"Too far, red", "Too near, blue", "Within 1 cm, white", "Missing, no point"}
    assert sum(float(share.removesuffix(" %")) for share in shares.values()) == pytest.approx(100, abs=0.2)
    assert float(shares["Missing, no point"].removesuffix(" %")) == pytest.approx(25, abs=5)
    icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()
    assert {icon for _, icon in measured_surface.make_legend(scene)} <= set(icons)
    item["icymoon_points"] = "of a file that someone made"
    assert measured_surface.make_legend(scene) == ()
    measured_surface.clear_points(scene)
    assert measured_surface.make_legend(scene) == ()


def test_a_surface_of_an_older_evaluation_does_not_say_what_is_missing(shown, tmp_path):
    folder, _ = shown
    content = (folder / "quarters.ply").read_bytes().split(b"\n")
    old = tmp_path / "old.ply"
    old.write_bytes(
        b"\n".join(line for line in content[:5] if not line.startswith(b"comment missing"))
        + b"\n"
        + b"\n".join(content[5:])
    )
    assert measured_surface.find_title(bpy.context.scene) == ""
    measured_surface.build_points(bpy.context.scene, [old], "old")
    assert measured_surface.find_title(bpy.context.scene) == "old"
    assert not any("Missing" in line for line, _ in measured_surface.make_legend(bpy.context.scene))
    assert any("Too far" in line for line, _ in measured_surface.make_legend(bpy.context.scene))
    measured_surface.clear_points(bpy.context.scene)


def test_squares_of_any_line_of_sight():
    random = np.random.default_rng(0)
    toward = random.standard_normal((200, 3))
    toward = np.concatenate([toward / np.linalg.norm(toward, axis=1, keepdims=True), [[0, 0, 1], [0, 0, -1]]])
    quads = measured_surface.make_squares(np.zeros((202, 3)), toward, np.full(202, 2.0))
    sides = np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=2)
    np.testing.assert_allclose(sides, 2.0)
    normal = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 1]) / 4
    np.testing.assert_allclose(normal, toward, atol=1e-12)


def test_it_is_not_rendered_not_part_of_the_scene_and_goes_without_a_trace(shown):
    folder, built = shown
    scene = bpy.context.scene
    measured_surface.clear_points(scene)
    before = {len(data) for data in (bpy.data.objects, bpy.data.meshes)}, len(bpy.data.materials)
    item = measured_surface.build_points(scene, [folder / "right.ply"], "right")
    assert item.hide_render
    assert not built.edited
    assert item.name not in built.collection.all_objects
    measured_surface.build_points(scene, [folder / "right.ply", folder / "wrong.ply"], "again")
    assert len([o for o in bpy.data.objects if o.name.startswith(measured_surface.NAME)]) == 1
    assert measured_surface.clear_points(scene)
    assert not measured_surface.clear_points(scene)
    assert ({len(data) for data in (bpy.data.objects, bpy.data.meshes)}, len(bpy.data.materials)) == before


def test_files_that_cannot_be_used_change_nothing(shown, tmp_path):
    folder, _ = shown
    scene = bpy.context.scene
    item = measured_surface.build_points(scene, [folder / "right.ply"], "right")
    content = (folder / "right.ply").read_bytes()
    (tmp_path / "cut.ply").write_bytes(content[:-100])
    for paths, reason in (
        ([tmp_path / "none.ply"], "cannot be read"),
        ([tmp_path / "cut.ply"], "it is cut off"),
        ([folder / "blind.ply"], "measured nothing"),
    ):
        with pytest.raises(IcyMoonError, match=reason):
            measured_surface.build_points(scene, paths, "bad")
    assert measured_surface.find_points(scene) == item
    measured_surface.clear_points(scene)


def test_by_operator(shown, tmp_path):
    folder, _ = shown
    (tmp_path / "evaluation_scene").mkdir()
    for name in ("right", "wrong"):
        (tmp_path / "evaluation_scene" / f"{name}.ply").write_bytes((folder / f"{name}.ply").read_bytes())
    summary = [
        {"method": name, "l1_m": l1, "l1_rate_10": 0, "si_rmse": 0, "dod": 0, "coverage": 1}
        for name, l1 in (("wrong", 0.3), ("right", 0.0))
    ]
    rows = [{"method": name, "pair": "p", "images": {"points": f"{name}.ply"}} for name in ("wrong", "right")]
    scene = bpy.context.scene
    evaluated(scene, tmp_path, *summary, shown=rows)
    try:
        assert results.list_methods_with_points(scene) == ["right", "wrong"]
        assert bpy.ops.icymoon.show_surface() == {"FINISHED"}
        assert measured_surface.find_points(bpy.context.scene).name.endswith("right")
        assert bpy.ops.icymoon.show_surface(method="wrong") == {"FINISHED"}
        assert measured_surface.find_points(bpy.context.scene).name.endswith("wrong")
        with pytest.raises(RuntimeError, match="no measured surfaces"):
            bpy.ops.icymoon.show_surface(method="sgbm")
        assert bpy.ops.icymoon.hide_surface() == {"FINISHED"}
        assert not bpy.ops.icymoon.hide_surface.poll()
    finally:
        scene.icymoon.results = ""

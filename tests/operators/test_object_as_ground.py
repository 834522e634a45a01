"""Use Selected Object as Ground: what was modelled in Blender, in metres and in its place."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from built_beside import build_beside
from built_scenes import everything
from icymoon.formats.ply import read_triangles
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.datablocks.fingerprint import read_parts
from icymoon.nodes.ground import object_mesh
from icymoon.operators import live_preview, object_as_ground, refine_ground
from icymoon.operators.import_ground import GroundOperator
from icymoon.operators.sidebar_text import describe_ground_file
from icymoon.operators.work_in_pieces import WorkInPieces
from icymoon.settings.blender import scene_properties
from icymoon.support.errors import IcyMoonError
from icymoon.support.steps import finish
from panel_drawing import drawn, texts
from pieces import count_pauses, stop_after
from rendering import empty_scene
from thread_asks import list_asks_of_threads


@pytest.fixture
def scene(tmp_path):
    scene = empty_scene()
    scene.icymoon.dataset.folder = str(tmp_path / "data")
    scene.icymoon.rocks.coverage = 0.0
    return scene


def add_grid(cells: int = 4, size_m: float = 8.0, name: str = "Hill") -> bpy.types.Object:
    at = np.linspace(-size_m / 2, size_m / 2, cells + 1)
    x, y = np.meshgrid(at, at)
    first = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :cells].reshape(-1, 1)
    mesh = bpy.data.meshes.new(name)
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    mesh.from_pydata(vertices.tolist(), [], (first + np.array([0, 1, cells + 2, cells + 1])).tolist())
    return select(bpy.data.objects.new(name, mesh))


def select(item: bpy.types.Object) -> bpy.types.Object:
    if item.name not in bpy.context.scene.collection.all_objects:
        bpy.context.scene.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item
    item.select_set(True)
    return item


def read(scene) -> tuple[np.ndarray, np.ndarray]:
    """What the object's file would have."""
    bpy.context.view_layer.update()
    return object_mesh.read_object_mesh(bpy.context.active_object, scene, bpy.context.evaluated_depsgraph_get())


def areas(positions, triangles):
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def test_the_ground_is_the_object_in_its_place(scene):
    item = add_grid()
    item.location, item.rotation_euler[2], item.scale[2] = (0.5, -0.25, 2.0), 0.3, 3.0
    for vertex in item.data.vertices:
        vertex.co.z = 0.01 * vertex.index
    bpy.context.view_layer.update()
    wanted = np.array([item.matrix_world @ vertex.co for vertex in item.data.vertices])
    assert bpy.ops.icymoon.object_as_ground() == {"FINISHED"}
    source = scene.icymoon.source
    assert (source.kind, source.scale, source.up_axis, source.centre) == ("MESH", 1.0, "Z", False)
    positions, _ = read_triangles(Path(source.file))
    assert np.allclose(np.sort(positions, axis=0), np.sort(wanted, axis=0), atol=1e-6)
    built = scenes.find_built(scene)
    low, high = (np.array(built.terrain.bound_box).reshape(8, 3).__getattribute__(what)(0) for what in ("min", "max"))
    assert np.allclose([low, high], [wanted.min(0), wanted.max(0)], atol=1e-5)


def test_the_panels_name_the_object_although_its_file_has_another_name(scene):
    add_grid(name="Crater")
    assert bpy.ops.icymoon.object_as_ground() == {"FINISHED"}
    for record in (live_preview.list_lines(scene), drawn(bpy.types.ICYMOON_PT_source)):
        assert "Ground: copy of Crater" in texts(record)
    file = scene.icymoon.source.file
    scene.icymoon.source.file = "/work/ridge.obj"
    assert describe_ground_file(scene) == "Ground: ridge.obj"
    scene.icymoon.source.file = file
    assert describe_ground_file(scene) == "Ground: copy of Crater"
    scene.icymoon.source.kind = "PROCEDURAL"
    assert describe_ground_file(scene) == ""


@pytest.mark.parametrize(("flat_share", "is_flat"), [(0.0, False), (0.25, False), (0.75, True), (1.0, True)])
def test_the_ground_is_shaded_as_most_of_the_object(scene, flat_share, is_flat):
    hill = select(add_grid())
    count = len(hill.data.polygons)
    hill.data.polygons.foreach_set("use_smooth", np.arange(count) >= flat_share * count)
    assert bpy.ops.icymoon.object_as_ground() == {"FINISHED"}
    assert scene.icymoon.source.flat_faces is is_flat
    smooth = [face.use_smooth for face in scenes.find_built(scene).terrain.data.polygons]
    assert smooth == [not is_flat] * len(smooth)


def test_modifiers_count_as_they_are_shown(scene):
    item = add_grid()
    flat = len(read(scene)[1])
    item.modifiers.new("Finer", "SUBSURF").levels = 1
    assert len(read(scene)[1]) == 4 * flat


def test_lengths_are_metres_as_the_scene_shows_them(scene):
    add_grid(size_m=8.0)
    for system, unit, wanted in (("METRIC", 0.01, 0.08), ("NONE", 0.01, 8.0), ("METRIC", 1.0, 8.0)):
        scene.unit_settings.system, scene.unit_settings.scale_length = system, unit
        assert np.ptp(read(scene)[0][:, 0]) == pytest.approx(wanted)


def test_a_mirrored_object_keeps_its_upper_side(scene):
    item = add_grid()
    up = areas(*read(scene))[:, 2]
    item.scale.x = -1.0
    assert np.allclose(areas(*read(scene))[:, 2], up)
    item.scale.z = -1.0  # upside down as well
    assert np.allclose(areas(*read(scene))[:, 2], -up)


def test_instances_are_in_the_ground(scene):
    item = add_grid(1)
    one = len(read(scene)[1])
    parent = bpy.data.objects.new("Group", None)
    collection = bpy.data.collections.new("Shapes")
    bpy.context.scene.collection.objects.unlink(item)
    collection.objects.link(item)
    parent.instance_type, parent.instance_collection = "COLLECTION", collection
    parent.location.x = 5.0
    select(parent)
    positions, triangles = read(scene)
    assert len(triangles) == one
    assert positions[:, 0].mean() == pytest.approx(5.0)
    assert object_as_ground.why_not_usable(bpy.context) == ""


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        ([], []),
        ([(0, 0, 0), (1, 0, 0)], []),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)]),
    ],
    ids=["nothing", "no faces", "no area"],
)
def test_an_object_without_a_surface_is_refused_and_changes_nothing(scene, vertices, faces, tmp_path):
    mesh = bpy.data.meshes.new("Empty")
    mesh.from_pydata(vertices, [], faces)
    select(bpy.data.objects.new("Empty", mesh))
    with pytest.raises(RuntimeError, match="has no face with an area"):
        bpy.ops.icymoon.object_as_ground()
    assert scene.icymoon.source.kind == "PROCEDURAL"
    assert not (tmp_path / "data").exists()


def test_too_many_triangles_are_refused(scene, monkeypatch):
    add_grid()
    monkeypatch.setattr(object_mesh, "MAX_TRIANGLES", 3)
    with pytest.raises(RuntimeError, match="has more than 3 triangles"):
        bpy.ops.icymoon.object_as_ground()


def test_a_mesh_that_is_no_surface_is_repaired_or_told(scene):
    flat = add_grid().data
    vertices = [*(vertex.co for vertex in flat.vertices), (0.0, 0.0, 1.0)]
    faces = [*(tuple(face.vertices) for face in flat.polygons), (6, 7, 25)]  # the third face at an edge
    mesh = bpy.data.meshes.new("Fin")
    mesh.from_pydata(vertices, [], faces)
    select(bpy.data.objects.new("Fin", mesh))
    assert bpy.ops.icymoon.object_as_ground() == {"FINISHED"}


def test_parts_of_the_built_scene_are_refused_with_the_reason(scene):
    add_grid()
    bpy.ops.icymoon.object_as_ground()
    select(scenes.find_built(scene).terrain)
    assert "part of the built scene" in object_as_ground.why_not_usable(bpy.context)
    assert not bpy.ops.icymoon.object_as_ground.poll()


def test_without_a_mesh_the_button_is_grey(scene):
    assert object_as_ground.why_not_usable(bpy.context) == "Select a mesh object"
    lamp = select(bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN")))
    assert object_as_ground.why_not_usable(bpy.context) == "The active object is not a mesh"
    lamp.select_set(False)
    assert object_as_ground.why_not_usable(bpy.context) == "Select a mesh object"


def test_the_file_follows_from_the_content(scene, tmp_path):
    item = add_grid()
    files = []
    for height_m in (0.0, 0.1, 0.0):
        item.data.vertices[0].co.z = height_m
        item.data.update()
        bpy.ops.icymoon.object_as_ground()
        files.append(scene.icymoon.source.file)
        select(item)
    assert files[0] == files[2] != files[1]
    assert len(list((tmp_path / "data" / "inputs").iterdir())) == 2


def test_a_linked_object_is_read_and_not_changed(scene, tmp_path):
    item = add_grid(name="Linked")
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {item})
    bpy.data.objects.remove(item)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, linked):
        linked.objects = ["Linked"]
    select(linked.objects[0])
    assert bpy.ops.icymoon.object_as_ground() == {"FINISHED"}


def test_the_file_lies_beside_the_blend_if_the_data_set_does(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.path, "abspath", lambda path: path.replace("//", f"{tmp_path}/"))
    path = tmp_path / "data" / "inputs" / "a.ply"
    assert object_as_ground.shorten_path(path, "//data").replace("\\", "/") == "//data/inputs/a.ply"
    assert object_as_ground.shorten_path(path, "~/data") == str(path)


def test_settings_that_place_other_files_are_reset(scene):
    scene.icymoon.source.origin_x_m, scene.icymoon.source.scale = 3.0, 0.001
    add_grid()
    bpy.ops.icymoon.object_as_ground()
    source = scene_properties.read_settings(scene.icymoon).source
    assert (source.origin_x_m, source.origin_y_m, source.scale) == (0.0, 0.0, 1.0)


class Operator(object_as_ground.SelectedMeshOperator, GroundOperator):
    """The operator as Blender holds it after ``invoke``."""

    make_source = object_as_ground.ICYMOON_OT_object_as_ground.make_source

    def __init__(self) -> None:
        self.said: list[str] = []
        self._scene_uid = bpy.context.scene.session_uid

    def report(self, kind: set[str], message: str, /) -> None:
        self.said.append(message)


@pytest.fixture
def hill(scene, tmp_path, monkeypatch):
    """A scene with a selected object, where another Blender builds."""
    monkeypatch.setattr(refine_ground, "start_building", lambda of: build_beside(of, tmp_path / "built.blend"))
    add_grid(cells=40)
    bpy.context.view_layer.update()
    return scene


def test_pieces_come_to_what_a_build_at_once_comes_to(hill, monkeypatch):
    bpy.ops.icymoon.object_as_ground()
    at_once, file = read_parts(scenes.find_built(hill).collection), hill.icymoon.source.file
    scenes.clear_scene(hill)
    hill.icymoon.source.kind, hill.icymoon.source.file = "PROCEDURAL", ""
    asked, threads, encode = list_asks_of_threads(monkeypatch), list[bool](), object_as_ground.encode_triangles
    monkeypatch.setattr(
        object_as_ground,
        "encode_triangles",
        lambda *of: threads.append(threading.current_thread() is not threading.main_thread()) or encode(*of),
    )
    work = WorkInPieces(Operator().make_steps(bpy.context), "the ground")
    while not (messages := work.poll()):
        time.sleep(0.001)
    assert [kind for kind, _ in messages[-1]["value"]] == ["INFO"]
    built = scenes.find_built(hill)
    assert read_parts(built.collection) == at_once
    assert not built.edited
    assert hill.icymoon.source.file == file
    assert threads == [True]
    assert asked == []


def test_the_window_is_as_before_wherever_the_pieces_stop(hill):
    before, count = everything(), count_pauses(Operator().make_steps(bpy.context))[0]
    scenes.clear_scene(hill)
    hill.icymoon.source.kind, hill.icymoon.source.file = "PROCEDURAL", ""
    assert count >= 4
    for pauses in range(1, count + 1):
        operator = Operator()
        stop_after(operator.make_steps(bpy.context), pauses)
        operator.clean_up_after_stop()
        assert (hill.icymoon.source.kind, hill.icymoon.source.file) == ("PROCEDURAL", "")
        assert everything() == before, f"after {pauses} pauses"


def test_an_object_without_an_area_leaves_the_settings(hill):
    bpy.context.active_object.scale = (0.0, 1.0, 0.0)
    bpy.context.view_layer.update()
    operator = Operator()
    with pytest.raises(IcyMoonError, match="no face with an area"):
        finish(operator.make_steps(bpy.context))
    assert hill.icymoon.source.kind == "PROCEDURAL"

"""Building: what is made, what is replaced, what is the person's and stays."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from built_scenes import everything, positions
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import scene_objects
from icymoon.nodes.datablocks.fingerprint import TAG, make_fingerprint
from icymoon.nodes.tree.builder import Tree
from icymoon.physics.light.directions import direction_toward
from icymoon.settings import description, preset_files
from icymoon.settings.blender import scene_properties
from icymoon.support.blender import compat
from icymoon.support.errors import IcyMoonError
from rendering import complete, empty_scene


def test_two_builds_of_one_seed_are_equal_and_leave_nothing_behind():
    scene = empty_scene()
    settings = complete({"rocks": {"coverage": 0.1}})
    first = scenes.build_scene(scene, settings)
    vertices, mark, counts = positions(first.terrain), make_fingerprint(first.collection), everything()
    names = sorted(o.name for o in bpy.data.objects)
    for _ in range(3):
        again = scenes.build_scene(scene, settings)
        assert np.array_equal(positions(again.terrain), vertices)
        assert make_fingerprint(again.collection) == mark
    assert everything() == counts
    assert sorted(o.name for o in bpy.data.objects) == names
    assert not any("." in o.name for o in bpy.data.objects)
    other = scenes.build_scene(scene, description.merged(settings, {"dataset": {"seed": 2}}))
    assert not np.array_equal(positions(other.terrain), vertices)


def test_the_mesh_is_a_regular_grid_of_the_height_function():
    settings = complete({"terrain": {"resolution": 33, "size_m": 8.0}})
    built = scenes.build_scene(empty_scene(), settings)
    grid = positions(built.terrain).reshape(33, 33, 3)
    assert np.allclose(np.diff(grid[..., 0], axis=1), 0.25)
    assert np.allclose(np.diff(grid[..., 1], axis=0), 0.25)
    ground = scenes.make_ground(settings)
    assert np.allclose(grid[..., 2], ground.heights(grid[..., 0], grid[..., 1], 0.5), atol=1e-6)
    assert all(polygon.normal.z > 0 for polygon in built.terrain.data.polygons)
    assert built.terrain.data.validate() is False


def test_what_is_the_persons_stays():
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    world, camera, cube = scene.world, scene.camera, bpy.data.objects["Cube"]
    before = {o.name: (o.matrix_world.copy(), o.hide_render) for o in bpy.data.objects}
    cycles_samples, engine = scene.cycles.samples, scene.render.engine
    built = scenes.build_scene(scene, complete())
    lander = bpy.data.objects.new("Lander", bpy.data.meshes.new("Lander"))
    built.collection.objects.link(lander)
    cube.parent = built.camera
    assert built.edited
    built = scenes.build_scene(scene, complete({"terrain": {"rms_slope_deg": 5.0}}))
    assert cube.parent == built.camera
    cube.parent = None
    assert lander.name in built.collection.objects
    assert {n: (o.matrix_world.copy(), o.hide_render) for n, o in bpy.data.objects.items() if n in before} == before
    assert (scene.cycles.samples, scene.render.engine) == (cycles_samples, engine)
    assert scene.camera == built.camera
    scene.camera, scene.world = camera, world
    built = scenes.build_scene(scene, complete())
    assert (scene.camera, scene.world) == (camera, world)  # what a person chose after the first build
    scene.camera = built.camera
    assert scenes.clear_scene(scene)
    assert (scene.camera, scene.world) == (camera, world)
    assert {o.name for o in bpy.data.objects} == set(before) | {"Lander"}
    assert not any(TAG in block for kind in (bpy.data.meshes, bpy.data.materials, bpy.data.worlds) for block in kind)
    assert not scenes.clear_scene(scene)


def test_every_edit_by_hand_is_noticed():
    def vertex(b):
        b.terrain.data.vertices[7].co.z += 1e-3

    def roughness(b):
        b.terrain.data.materials[0].node_tree.nodes["Snow"].inputs["Roughness"].default_value = 0.1

    def camera(b):
        b.camera.location.x += 0.01

    def sun(b):
        b.sun.data.energy *= 2

    def modifier(b):
        b.terrain.modifiers.new("Smooth", "SMOOTH")

    def added(b):
        b.collection.objects.link(bpy.data.objects.new("Lander", None))

    for edit in (vertex, roughness, camera, sun, modifier, added):
        built = scenes.build_scene(empty_scene(), complete())
        assert not built.edited
        edit(built)
        assert built.edited, edit.__name__


def test_fingerprint_survives_saving_and_loading(tmp_path):
    scene = empty_scene()
    built = scenes.build_scene(scene, complete({"rocks": {"coverage": 0.05}}))
    mark, name = make_fingerprint(built.collection), scene.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    found = scenes.find_built(bpy.data.scenes[name])
    assert found is not None
    assert make_fingerprint(found.collection) == mark
    assert not found.edited
    assert found.settings == complete({"rocks": {"coverage": 0.05}})


def test_sun_and_camera_stand_as_described():
    settings = complete(
        {
            "light": {
                "sun_elevation_deg": 15.0,
                "sun_azimuth_deg": 200.0,
                "sun_irradiance_wm2": 50.26,
                "sun_angular_diameter_deg": 0.1024,
            },
            "rig": {"height_m": 2.0, "pitch_deg": 30.0, "heading_deg": 90.0},
        }
    )
    built = scenes.build_scene(empty_scene(), settings)
    bpy.context.view_layer.update()
    assert np.allclose(built.sun.matrix_world.to_3x3().col[2], direction_toward(200.0, 15.0), atol=1e-6)
    assert built.sun.data.energy == pytest.approx(50.26)
    assert built.sun.data.angle == pytest.approx(math.radians(0.1024), rel=1e-6)
    ground = scenes.find_site_ground_m(settings, scenes.make_ground(settings))
    assert built.camera.matrix_world.translation.z == pytest.approx(ground + 2.0, abs=1e-6)
    assert np.allclose(-built.camera.matrix_world.to_3x3().col[2], direction_toward(90.0, -30.0), atol=1e-6)
    stereo = built.camera.data.stereo
    assert (stereo.convergence_mode, stereo.pivot) == ("PARALLEL", "LEFT")
    assert stereo.interocular_distance == pytest.approx(0.25)


def test_a_camera_may_be_rolled_and_stand_above_zero():
    rig = {"x_m": 2.0, "y_m": -1.0, "height_m": 1.0, "height_from": "ZERO", "z_m": 3.5, "roll_deg": 90.0}
    built = scenes.build_scene(empty_scene(), complete({"rig": {"heading_deg": 90.0, "pitch_deg": 0.0, **rig}}))
    bpy.context.view_layer.update()
    assert np.allclose(built.camera.matrix_world.translation, [2.0, -1.0, 3.5], atol=1e-6)
    # Blender's x is right, where down was, and its y up, where right was.
    expected = [[0, 0, -1], [0, -1, 0], [-1, 0, 0]]
    assert np.allclose(np.array(built.camera.matrix_world.to_3x3()).T, expected, atol=1e-6)


def test_the_sky_gives_no_light_and_the_only_lamp_is_the_sun():
    built = scenes.build_scene(empty_scene(), complete())
    assert bpy.context.scene.world.node_tree.nodes["Space"].inputs["Strength"].default_value == 0.0
    assert [o.type for o in built.collection.all_objects].count("LIGHT") == 1


def test_a_node_with_an_input_nobody_set_is_refused():
    material = bpy.data.materials.new("Test")
    tree = Tree(compat.ensure_nodes(material))
    with pytest.raises(ValueError, match="Value_001"):
        tree.node("ShaderNodeMath", "Half set", {"Value": 1.0}, operation="ADD")
    with pytest.raises(ValueError, match="Heihgt"):
        tree.node("ShaderNodeMath", "Misspelt", {"Value": 1.0, "Value_001": 0.0, "Heihgt": 1.0}, operation="ADD")


def test_property_groups_hold_a_description_and_give_it_back(scene):
    loaded = description.merged(description.defaults(), preset_files.load_preset("scenes/europa_rough_ice"))
    scene_properties.write_settings(scene.icymoon, loaded)
    assert scene_properties.read_settings(scene.icymoon) == loaded


def test_too_little_memory_is_a_sentence_and_changes_nothing(monkeypatch):
    scene = empty_scene()
    scenes.build_scene(scene, complete())
    mark, counts = make_fingerprint(scenes.find_collection(scene)), everything()

    def no_memory(*_):
        raise MemoryError

    monkeypatch.setattr(scene_objects, "mesh_whole_ground", no_memory)
    with pytest.raises(IcyMoonError, match=r"terrain\.resolution"):
        scenes.build_scene(scene, complete())
    assert make_fingerprint(scenes.find_collection(scene)) == mark
    assert everything() == counts

"""Building again in what is there: what points to the ground, the Sun or the camera still does, and what a person has
copied, renamed, moved or deleted is told from what is built by its mark alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
import pytest
from built_scenes import everything, positions
from edits import EDITS, TINY, populate
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks.fingerprint import TAG, read_parts
from icymoon.operators import live_preview, render
from icymoon.settings import description
from icymoon.settings.blender import scene_properties
from icymoon.support.errors import IcyMoonError
from rendering import SMALL, complete, empty_scene

ROUGHER: dict[str, Any] = {**TINY, "terrain": {"resolution": 9, "rms_slope_deg": 30.0}}
OSL: dict[str, Any] = {**TINY, "surface": {"model": "HAPKE"}, "hapke": {"accuracy": "ACCURATE"}}


def held(built: scenes.Built) -> dict[str, int]:
    """What stays the same block when it is built again."""
    return {item[TAG]: item.session_uid for item in built.collection.all_objects if TAG in item}


def test_what_points_to_the_ground_still_does_when_it_is_built_again():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(TINY))
    before, counts = held(built), everything()
    ball = bpy.data.objects.new("Ball", bpy.data.meshes.new("Ball"))
    scene.collection.objects.link(ball)
    ball.constraints.new("SHRINKWRAP").target = built.terrain
    ball.constraints.new("TRACK_TO").target = built.sun
    ball.modifiers.new("Wrap", "SHRINKWRAP").target = built.terrain
    ball.parent, ball.location = built.terrain, (1.0, 2.0, 3.0)
    ball.data.materials.append(built.terrain.data.materials[0])
    twin = bpy.data.objects.new("Twin", built.terrain.data)
    scene.collection.objects.link(twin)
    eye = scene.camera
    built.terrain.select_set(True)
    bpy.context.view_layer.objects.active = built.terrain
    built.terrain.show_name = True
    for settings in (ROUGHER, TINY, ROUGHER):
        built = scenes.build_scene(scene, complete(settings))
    assert held(built) == before
    assert [c.target for c in ball.constraints] == [built.terrain, built.sun]
    assert ball.modifiers[0].target == ball.parent == built.terrain
    assert ball.data.materials[0] == built.terrain.data.materials[0]
    assert twin.data == built.terrain.data
    assert scene.camera == eye == built.camera
    assert built.terrain.select_get()
    assert bpy.context.view_layer.objects.active == built.terrain
    assert built.terrain.show_name
    assert not built.edited
    now = everything()
    assert {kind: now[kind] - counts[kind] for kind in now if now[kind] != counts[kind]} == {"objects": 2, "meshes": 1}


@pytest.mark.parametrize("populated", [False, True])
def test_what_is_built_again_is_what_a_first_build_makes(populated):
    """Whatever was done to it."""
    scene = empty_scene()
    fresh = read_parts(scenes.build_scene(scene, complete(TINY)).collection)
    if populated:
        populate()
    counts = everything()
    of_added = ("material_of_an_object", "material_of_the_ground", "parented_sun", "constraint_on_the_sun")
    for name in (
        "moved_vertex",
        "turned_faces",
        "attribute_of_the_ground",
        "modifier_on_the_ground",
        "kind of noise of the ground",
        "displacement",
        "not rendered",
        "sun's colour",
        "delta",
        "holdout",
        "near end of the camera",
        "place of the camera",
        "surface_of_a_rock",
        "removed_rocks",
        *(of_added if populated else ()),
    ):
        EDITS[name](scenes.find_built(scene))
    built = scenes.find_built(scene)
    built.terrain["mine"] = 1.0
    built.camera.keyframe_insert("location", frame=1)
    built.sun.rotation_mode = "QUATERNION"
    built = scenes.build_scene(scene, complete(TINY))
    assert {k: v for k, v in read_parts(built.collection).items() if k != "added"} == fresh
    assert {kind: n for kind, n in everything().items() if n != counts[kind]} == {}


def test_a_file_can_be_saved_after_rocks_were_built_again(tmp_path):
    # Blender 5.2 crashes here, and when it quits, if a script has written the properties of a modifier's inputs.
    scene = empty_scene()
    for coverage in (0.05, 0.1):
        built = scenes.build_scene(scene, complete({**TINY, "rocks": {"coverage": coverage}}))
    assert built.rock_count > 0
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), copy=True)
    with bpy.data.libraries.load(str(tmp_path / "a.blend")) as (saved, _):
        assert scene.name in saved.scenes


def test_renaming_and_moving_leave_it_the_same_scene():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(TINY))
    before = held(built)
    built.terrain.name, built.terrain.data.name, built.sun.name = "Ground.v2", "Ground.v2", "Helios"
    built.collection.name = "Landing Site"
    scene.collection.objects.link(built.terrain)
    built.collection.objects.unlink(built.terrain)  # out of what is rendered
    assert scenes.find_built(scene) is None
    built = scenes.build_scene(scene, complete(ROUGHER))
    assert held(built) == before
    assert (built.terrain.name, built.terrain.data.name, built.sun.name) == ("Ground.v2", "Ground.v2", "Helios")
    assert built.collection.name == "Landing Site"
    assert not built.edited


@pytest.mark.parametrize("how", ["in the outliner", "with all in it", "by a script"])
def test_a_deleted_collection_leaves_one_ground_one_sun_and_one_camera(how):
    scene = empty_scene()
    previous = scene.camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    scene.collection.objects.link(previous)
    built = scenes.build_scene(scene, complete(TINY))
    before, counts = held(built), everything()
    children = [built.collection, *built.collection.children_recursive]
    if how == "in the outliner":  # which hands what is in it to the collection above
        for child in children:
            for item in child.objects:
                scene.collection.objects.link(item)
    elif how == "with all in it":
        bpy.data.batch_remove(list(built.collection.all_objects))
    bpy.data.batch_remove(children)
    assert scenes.find_built(scene) is None
    built = scenes.build_scene(scene, complete(TINY))
    roles = sorted(item[TAG] for item in bpy.data.objects if item.get(TAG) in scenes.OBJECTS)
    assert roles == sorted(before)
    if how != "with all in it":
        assert held(built) == before
        assert {kind: n for kind, n in everything().items() if n != counts[kind]} == {}
    assert not [item.name for item in scene.collection.objects if TAG in item]
    assert not built.edited
    scenes.clear_scene(scene)
    assert not [item for item in bpy.data.objects if TAG in item]


def test_a_deleted_ground_is_built_again_in_its_place():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(TINY))
    before, counts = held(built), everything()
    for item in scene.objects:
        item.select_set(item == built.terrain)
    bpy.ops.object.delete()
    assert scenes.find_built(scene) is None
    built = scenes.build_scene(scene, complete(TINY))
    assert held(built).keys() == before.keys()
    assert {kind: n for kind, n in everything().items() if n != counts[kind]} == {}
    assert not built.edited


def test_copies_of_what_is_built_are_the_persons_own():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(TINY))
    before = held(built)
    terrain = built.terrain
    for linked in (False, True):
        copy = terrain.copy()
        if not linked:
            copy.data = terrain.data.copy()
        copy.name = "A copy"  # before the built one in every order of names
        built.collection.objects.link(copy)
    sun = built.sun.copy()
    built.collection.objects.link(sun)
    rock = next(item for item in built.collection.all_objects if item.get(TAG) == "rock").copy()
    built.collection.objects.link(rock)
    found = scenes.find_built(scene)
    assert (found.terrain, found.edited, found.edited_parts()) == (terrain, True, set())
    scenes.separate_from_copies(found)
    assert held(found) == before
    built = scenes.build_scene(scene, complete(ROUGHER))
    assert held(built) == before
    assert sorted(o.name for o in built.collection.all_objects if TAG not in o) == sorted(
        [sun.name, rock.name, "A copy", "A copy.001"]
    )
    assert len(list(scenes.find_instanced_objects(rock))) > 0  # its shapes are still there
    assert all(shape.data is not None for shape in scenes.find_instanced_objects(rock))
    scenes.clear_scene(scene)
    assert {o.name for o in scene.objects} == {sun.name, rock.name, "A copy", "A copy.001"}


@pytest.mark.parametrize("settings", [TINY, OSL])
def test_the_full_copy_of_a_scene_is_a_built_scene_of_its_own(settings):
    scene = empty_scene()
    scene_properties.write_settings(scene.icymoon, description.merged(description.check(SMALL, "x"), settings))
    first = scenes.build_scene(scene, scene_properties.read_settings(scene.icymoon))
    marks = read_parts(first.collection)
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    built = render.bring_up_to_date(copy, scene_properties.read_settings(copy.icymoon))
    assert built.terrain not in (None, first.terrain)
    assert not built.edited
    assert built.extra == first.extra == scenes.make_build_facts(built.settings)
    assert "press Build Scene" in scenes.why_shared(built)
    light = copy.icymoon.light
    light.sun_elevation_deg += 5.0
    built = scenes.build_scene(copy, scene_properties.read_settings(copy.icymoon))
    assert scenes.why_shared(built) == ""
    assert read_parts(scenes.find_built(scene).collection) == marks
    assert not scenes.find_built(scene).edited
    bpy.data.scenes.remove(copy)
    assert not scenes.build_scene(scene, scene_properties.read_settings(scene.icymoon)).edited


def test_live_settings_of_a_full_copy_change_no_other_scene(monkeypatch):
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    scene = empty_scene()
    scene_properties.write_settings(scene.icymoon, description.merged(description.check(SMALL, "x"), TINY))
    first = scenes.build_scene(scene, scene_properties.read_settings(scene.icymoon))
    marks = read_parts(first.collection)
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    copy.icymoon.surface.albedo = 0.2
    live_preview.update_scene(copy)
    live_preview.show_waiting()
    assert any("press Build Scene" in line for line in preview.read_notes(copy))
    assert read_parts(scenes.find_built(scene).collection) == marks


def test_two_scenes_of_a_file_are_built_apart():
    scene = empty_scene()
    first = scenes.build_scene(scene, complete(TINY))
    marks, before = read_parts(first.collection), held(first)
    other = bpy.data.scenes.new("Other")
    second = scenes.build_scene(other, complete(ROUGHER))
    for settings in (TINY, ROUGHER):
        second = scenes.build_scene(other, complete(settings))
    assert held(first) == before
    assert read_parts(first.collection) == marks
    assert not scenes.find_built(scene).edited
    assert not second.edited
    assert not set(first.collection.all_objects) & set(second.collection.all_objects)
    scenes.clear_scene(other)
    assert read_parts(first.collection) == marks


def test_a_mesh_of_the_persons_own_on_the_ground_is_not_overwritten():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(TINY))
    mine = built.terrain.data.copy()
    mine.name = "Mine"
    mine.vertices[0].co.z = 77.0
    keeper = bpy.data.objects.new("Keeper", mine)
    scene.collection.objects.link(keeper)
    built.terrain.data = mine
    built = scenes.build_scene(scene, complete(TINY))
    assert built.terrain.data != mine
    assert keeper.data == mine
    assert mine.vertices[0].co.z == 77.0
    assert not built.edited


def test_a_ground_that_is_being_edited_is_not_built_anew():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(TINY))
    before = positions(built.terrain)
    bpy.context.view_layer.objects.active = built.terrain
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(IcyMoonError, match="Object Mode"):
        scenes.build_scene(scene, complete(ROUGHER))
    scene_properties.write_settings(scene.icymoon, complete(ROUGHER))
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}  # which leaves Edit Mode by itself
    assert built.terrain.mode == "OBJECT"
    assert not np.array_equal(positions(built.terrain), before)


@contextmanager
def cycles_off() -> Iterator[None]:
    import addon_utils  # which is there once Blender is

    addon_utils.disable("cycles")
    try:
        yield
    finally:
        addon_utils.enable("cycles")


@pytest.mark.parametrize("operator", ["build_scene", "render_pair", "add_terrain", "add_block"])
def test_without_cycles_nothing_is_made(operator, small):
    before = everything()
    with cycles_off(), pytest.raises(RuntimeError, match="enable the add-on Cycles Render Engine"):
        getattr(bpy.ops.icymoon, operator)()
    assert everything() == before


def test_a_built_scene_outlives_a_while_without_cycles(small, monkeypatch):
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    built = render.bring_up_to_date(small, scene_properties.read_settings(small.icymoon))
    with cycles_off():
        before = everything()
        for operator in ("build_scene", "render_pair", "evaluate"):
            with pytest.raises(RuntimeError, match="enable the add-on Cycles Render Engine"):
                getattr(bpy.ops.icymoon, operator)()
        small.icymoon.light.sun_elevation_deg += 1.0
        live_preview.update_scene(small)
        small.icymoon.light.sun_elevation_deg -= 1.0
        assert "Cycles" in preview.read_notes(small)[0]
        assert everything() == before
    live_preview.update_scene(small)
    assert preview.read_notes(small) == []
    assert not built.edited
    with cycles_off():
        assert bpy.ops.icymoon.clear_scene() == {"FINISHED"}

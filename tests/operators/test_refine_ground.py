"""A chosen scene is shown coarsely at once, and at full resolution while the user looks."""

from __future__ import annotations

import time
from itertools import count

import bpy
import numpy as np
import pytest
from built_beside import build_beside
from built_scenes import everything, positions
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks import known_marks
from icymoon.nodes.datablocks.fingerprint import list_meshes, read_marks, read_parts
from icymoon.operators import jobs, keep_marks, live_preview, refine_ground, view_exposure, work_in_pieces
from icymoon.operators import session as session_module
from icymoon.operators.render import bring_up_to_date
from icymoon.operators.session import session
from icymoon.operators.sidebar_text import replace_keys_by_labels
from icymoon.panels import previews
from icymoon.settings import description, preset_files
from icymoon.settings.blender import scene_properties
from stand_ins import stand_in

RIDGES, ROCKS = "scenes/europa_ridged_plain", "scenes/enceladus_block_field"


@pytest.fixture
def watched(scene, monkeypatch, tmp_path):
    """An empty file in a window, and scenes that are small."""
    number = count()
    monkeypatch.setattr(
        refine_ground, "start_building", lambda settings: build_beside(settings, tmp_path / f"{next(number)}.blend")
    )
    load = preset_files.load
    monkeypatch.setattr(
        preset_files,
        "load",
        lambda path: description.merged(
            load(path),
            {
                "mesh": {"error_px": 8.0, "edge_px": 24.0},
                "rig": {"width_px": 240, "height_px": 180},
                "rocks": {"most": 60},
            },
        ),
    )
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    monkeypatch.setattr(preview, "MAX_VERTICES", 1200)
    monkeypatch.setattr(preview, "MAX_ROCKS", 20)
    yield scene
    refine_ground.unregister()
    refine_ground.register()


def choose(name: str) -> scenes.Built:
    """Choose a scene by its picture."""
    setattr(bpy.context.window_manager, previews.CHOICE, name)
    return scenes.find_built(bpy.context.scene)


def look() -> scenes.Built:
    """What the event loop does while the user looks, until no ground follows any more."""
    while refine_ground._refine_next() is not None:
        time.sleep(0.01)
    return scenes.find_built(bpy.context.scene)


def settings():
    return scene_properties.read_settings(bpy.context.scene.icymoon)


def is_as_built_at_once(built: scenes.Built) -> bool:
    """Whether everything is as Build Scene makes it from the settings in an empty file."""
    shown = read_parts(built.collection)
    scenes.clear_scene(bpy.context.scene)
    return shown == read_parts(scenes.build_scene(bpy.context.scene, settings()).collection)


@pytest.mark.usefixtures("watched")
def test_faint_planetshine_is_in_no_view_of_it():
    choose(RIDGES)
    assert view_exposure.is_without_planetshine(bpy.context.scene)
    look()
    assert view_exposure.is_without_planetshine(bpy.context.scene)


@pytest.mark.long
def test_a_chosen_scene_is_coarse_at_once_and_then_as_build_scene_makes_it(watched):
    built = choose(ROCKS)
    assert len(built.terrain.data.vertices) <= 1.5 * preview.MAX_VERTICES
    assert built.rock_count == preview.MAX_ROCKS
    assert np.ptp(positions(built.terrain)[:, 0]) > 10 * settings().terrain.size_m  # out to the horizon
    assert built.settings.light == settings().light
    assert live_preview.list_lines(watched) == [refine_ground.NOTE]
    assert preview.has_coarse_ground(watched)
    assert not built.edited
    terrain, exposure = built.terrain, watched.view_settings.exposure
    built = look()
    assert watched.view_settings.exposure == exposure
    assert not preview.has_coarse_ground(watched)
    assert built.terrain == terrain  # what refers to it stays valid
    assert len(terrain.data.vertices) > 3 * preview.MAX_VERTICES
    assert " ".join(live_preview.list_lines(watched)).startswith("Rocks under 0.356 m are left out to keep to 60 rocks")
    assert is_as_built_at_once(built)


@pytest.mark.long
def test_a_second_choice_before_the_first_is_refined_gives_the_second(watched):
    choose(ROCKS)
    refine_ground._refine_next()  # the ground of the first is being made
    built = choose(RIDGES)
    assert built.preview
    assert is_as_built_at_once(look())


@pytest.mark.long
@pytest.mark.heavy
def test_a_render_before_it_is_refined_is_of_the_full_scene(watched):
    choose(ROCKS)
    refine_ground._refine_next()
    built = bring_up_to_date(watched, settings())
    mark, mesh = read_parts(built.collection), built.terrain.data.vertices[0].as_pointer()
    look()
    assert built.terrain.data.vertices[0].as_pointer() == mesh  # not made a second time
    assert read_parts(built.collection) == mark
    assert is_as_built_at_once(built)


@pytest.mark.usefixtures("watched")
def test_the_first_choice_is_a_step_of_undo():
    """Blender makes none for an operator that ends otherwise, and none for those that it calls."""
    assert bpy.ops.icymoon.load_preset(preset=RIDGES, build=True) == {"FINISHED"}
    assert scenes.find_built(bpy.context.scene).preview


def test_a_setting_that_is_typed_ends_the_process_that_builds(watched, monkeypatch, tmp_path):
    ended = []

    def start(settings):
        running = stand_in(
            cancelled=False, left=False, running=True, poll=lambda: [], stop=lambda: ended.append(settings)
        )
        return jobs.Job("Fine Ground", running)

    monkeypatch.setattr(refine_ground, "start_building", start)
    choose(RIDGES)
    first = settings()
    assert refine_ground._refine_next() is not None
    watched.icymoon.light.sun_elevation_deg = 33.0  # the ground stays, and so does the process
    assert refine_ground._refine_next() is not None
    assert not ended
    watched.icymoon.terrain.rms_slope_deg += 5.0
    assert refine_ground._refine_next() is None
    assert ended == [first]


def test_the_ground_that_the_user_changes_meanwhile_is_theirs(watched):
    choose(RIDGES)
    watched.icymoon.terrain.rms_slope_deg += 5.0
    assert look().preview
    assert live_preview.list_lines(watched) == [preview.COARSE_MESSAGE]
    built = choose(ROCKS)
    built.terrain.data.vertices[7].co.z += 0.5
    before = positions(built.terrain)
    assert np.array_equal(positions(look().terrain), before)
    assert any("edited" in line for line in live_preview.list_lines(watched))


@pytest.mark.long
@pytest.mark.heavy
def test_a_light_that_changes_meanwhile_is_kept(watched):
    choose(RIDGES)
    refine_ground._refine_next()
    watched.icymoon.light.sun_elevation_deg = 33.0
    built = look()
    assert built.preview == {}
    assert built.settings.light.sun_elevation_deg == 33.0
    assert is_as_built_at_once(built)


@pytest.mark.long
def test_warnings_about_the_fine_ground_stay_in_the_panel_until_a_setting_changes(watched, monkeypatch):
    load = preset_files.load
    monkeypatch.setattr(preset_files, "load", lambda path: description.merged(load(path), {"mesh": {"most": 2000}}))
    choose(RIDGES)
    assert live_preview.list_lines(watched) == [refine_ground.NOTE]
    look()
    told = " ".join(live_preview.list_lines(watched))
    reported = scenes.build_scene(bpy.data.scenes.new("Other"), settings()).warnings  # what Build Scene reports
    assert len(reported) == 1
    assert told == replace_keys_by_labels(reported[0])
    assert "Mesh ▸ " in told
    assert "mesh." not in told
    watched.icymoon.light.sun_elevation_deg = 33.0
    live_preview.show_waiting()
    assert live_preview.list_lines(watched) == ["Ground in full detail"]


def test_without_a_window_a_choice_only_loads(watched, monkeypatch):
    monkeypatch.setattr(live_preview, "has_window", lambda: False)
    assert choose(RIDGES) is None
    assert watched.icymoon.preset == RIDGES


@pytest.mark.long
@pytest.mark.heavy
@pytest.mark.usefixtures("watched")
def test_the_fine_ground_follows_again_after_redo():
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="Empty")
    choose(RIDGES)
    bpy.ops.ed.undo_push(message="Choice")
    look()
    assert bpy.ops.ed.undo() == bpy.ops.ed.redo() == {"FINISHED"}
    assert scenes.find_built(bpy.context.scene).preview
    assert is_as_built_at_once(look())


@pytest.mark.long
def test_undo_of_a_step_before_the_fine_ground_keeps_no_object_with_freed_data(watched):
    """The step of the Sun has the coarse ground, and so has the one before: Blender would keep the objects, whose data
    has been replaced meanwhile, and crash."""
    bpy.context.preferences.edit.use_global_undo = True
    choose(RIDGES)
    for message in ("Choice", "Look"):  # Blender finds the same in two steps from the second one on
        bpy.context.view_layer.update()
        bpy.ops.ed.undo_push(message=message)
    watched.icymoon.light.sun_elevation_deg = 33.0
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="Sun")
    look()
    before = bpy.context.preferences.experimental.use_undo_legacy
    assert bpy.ops.ed.undo() == {"FINISHED"}
    built = scenes.find_built(bpy.context.scene)
    meshes = {mesh.as_pointer() for mesh in bpy.data.meshes}
    assert {item.data.as_pointer() for item in built.collection.all_objects if item.type == "MESH"} <= meshes
    assert built.preview
    assert bpy.context.preferences.experimental.use_undo_legacy == before
    assert settings().light.sun_elevation_deg != 33.0
    assert is_as_built_at_once(look())


@pytest.fixture
def built_elsewhere(small, monkeypatch, tmp_path):
    """The small scene with a coarse ground whose fine one is in a file, and a function that runs the next piece of
    taking it over."""
    small.icymoon.rocks.coverage = 0.05
    monkeypatch.setattr(work_in_pieces, "_BUDGET_S", -1.0)
    monkeypatch.setattr(preview, "MAX_VERTICES", 400)
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    fine = tmp_path / "fine.blend"
    monkeypatch.setattr(refine_ground, "start_building", lambda settings: build_beside(settings, fine))
    preview.build_coarse(small, settings())
    refine_ground._refine_next()
    yield small
    refine_ground._stop_placing()
    refine_ground.unregister()
    refine_ground.register()


def test_the_fine_scene_comes_in_pieces_and_shows_at_the_last(built_elsewhere):
    counts, states = everything(), []
    while refine_ground._refine_next() is not None:
        states.append(bool(scenes.find_built(built_elsewhere).preview))
    assert states[:2] == [True, True]
    built = scenes.find_built(built_elsewhere)
    assert not built.preview
    assert not built.edited
    assert session.placing is None
    assert everything() == counts
    assert is_as_built_at_once(built)


def test_the_marks_of_the_fine_ground_are_known_when_it_is_shown(built_elsewhere):
    built = look()
    meshes = list_meshes(built.collection)
    assert len(meshes) > 2
    assert set(known_marks.find_known_marks(meshes)) == set(meshes)
    assert read_marks(built.collection, trusts=True) == read_marks(built.collection)
    bpy.context.view_layer.update()
    assert set(known_marks.find_known_marks(meshes)) == set(meshes)


def test_a_mesh_that_is_removed_while_its_marks_are_read_leaves_the_coarse_ground(built_elsewhere, monkeypatch):
    def remove(meshes):
        yield None
        bpy.data.meshes.remove(meshes[0])
        _ = meshes[0].name

    monkeypatch.setattr(keep_marks, "read_marks_in_steps", remove)
    built = look()
    assert built.preview
    assert "were removed while it was built" in " ".join(preview.read_notes(built_elsewhere))


def test_a_long_wait_for_the_fine_ground_is_counted(built_elsewhere, monkeypatch):
    redrawn = []
    monkeypatch.setattr(session_module, "redraw_sidebars", lambda: redrawn.append(1))
    refine_ground.start_refining()
    assert refine_ground.describe_refining(built_elsewhere) == refine_ground.NOTE
    session.meshing.started -= 38.2
    assert refine_ground.describe_refining(built_elsewhere) == f"{refine_ground.NOTE}, 38 s so far"
    for _ in range(3):
        session.show_seconds(session.meshing.past_s)
    assert len(redrawn) == 1


def read_fine() -> None:
    """Run pieces until objects of the fine scene are there, which a thread prepares."""
    before = everything()
    while everything() == before:
        refine_ground._refine_next()
        time.sleep(0.001)


def test_an_edit_between_two_pieces_stays(built_elsewhere):
    before = everything()
    read_fine()
    refine_ground._refine_next()  # it was unedited
    terrain = scenes.find_built(built_elsewhere).terrain
    terrain.location.z += 1.0
    refine_ground._note_change()  # what Blender's handler does
    look()
    built = scenes.find_built(built_elsewhere)
    assert built.terrain.location.z == 1.0
    assert built.preview
    assert "edited while its ground was coarse" in " ".join(preview.read_notes(built_elsewhere))
    assert everything() == before


def test_a_slider_of_the_sun_between_two_pieces_is_in_the_fine_scene(built_elsewhere):
    read_fine()
    built_elsewhere.icymoon.light.sun_elevation_deg = 41.0
    live_preview.update_scene(built_elsewhere)
    built = look()
    assert not built.preview
    assert not built.edited
    assert built.settings.light.sun_elevation_deg == 41.0


@pytest.mark.parametrize("event", ["undo", "new ground", "delete"])
def test_nothing_of_the_fine_scene_is_left_if_it_is_not_wanted_any_more(built_elsewhere, event):
    before, scene = everything(), built_elsewhere
    read_fine()
    if event == "undo":
        refine_ground._stop_placing()
    elif event == "new ground":
        scene.icymoon.live = False  # the live preview would change the scene too
        scene.icymoon.terrain.hurst += 0.01
        refine_ground._refine_next()
    else:
        del scenes.find_built(scene).collection[scenes.REFINED]
        refine_ground._refine_next()
    assert session.placing is None
    assert everything() == before

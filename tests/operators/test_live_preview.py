"""Live preview: what is built follows the settings, and nothing that is rendered, or a person's, is lost by it."""

from __future__ import annotations

import json
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from built_scenes import everything, positions
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import built_scene, preview
from icymoon.nodes.datablocks.fingerprint import TAG, find_built_objects, make_fingerprint, read_parts
from icymoon.operators import build, live_preview
from icymoon.operators.render import bring_up_to_date, plan_pairs
from icymoon.operators.session import session
from icymoon.panels import sidebar
from icymoon.render.worker import render_pairs
from icymoon.settings import change_announcements, description
from icymoon.settings.blender import scene_properties
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError
from panel_drawing import drawn, texts

SIDE = 33


@pytest.fixture
def watched(small, monkeypatch):
    """The small scene, built, as in a window: changes are shown at once and coarsely."""
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    for module in (live_preview, build):
        monkeypatch.setattr(module, "SIDES", (SIDE,))
    monkeypatch.setattr(session, "preview_side", SIDE)
    small.icymoon.rocks.coverage = 0.05
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    _turn()
    yield small
    monkeypatch.undo()
    _turn()


def _turn() -> None:
    """What the event loop does after the change: let the timer show what waits."""
    if bpy.app.timers.is_registered(live_preview.show_waiting):
        bpy.app.timers.unregister(live_preview.show_waiting)
    live_preview.show_waiting()


def change(scene: bpy.types.Scene, name: str, value: object) -> scenes.Built:
    """Change one setting as a slider does, and what is built then."""
    topic, key = name.split(".")
    setattr(getattr(scene.icymoon, topic), key, value)
    _turn()
    return scenes.find_built(scene)


def current(scene: bpy.types.Scene) -> Settings:
    return scene_properties.read_settings(scene.icymoon)


def state(built: scenes.Built) -> dict[str, str]:
    """Hashes of everything that is built."""
    return read_parts(built.collection)


def blocks(built: scenes.Built) -> bpy.types.Object | None:
    return next((item for item in built.collection.all_objects if item.get(TAG) == "rock"), None)


def fresh(scene: bpy.types.Scene, settings: Settings) -> dict[str, str]:
    """What Build Scene makes of settings where nothing was built before."""
    scenes.clear_scene(scene)
    return state(scenes.build_scene(scene, settings))


def test_a_terrain_slider_shows_the_height_function_on_a_coarse_mesh(watched):
    mesh = scenes.find_built(watched).terrain.data
    built = change(watched, "terrain.rms_slope_deg", 25.0)
    assert built.terrain.data == mesh
    assert 0.5 * SIDE**2 < len(mesh.vertices) < 2 * SIDE**2
    grid = positions(built.terrain)
    settings = current(watched)
    half = settings.terrain.size_m / 2
    assert np.array_equal(np.abs(grid[:, :2]).max(axis=0), [half, half])  # the patch, with straight sides
    # Of the waves that this mesh carries, none is shorter than what the grid of Build Scene carries.
    error = grid[:, 2] - scenes.make_ground(settings).heights(grid[:, 0], grid[:, 1], 2 * half / 32)
    assert error.std() < 0.2 * grid[:, 2].std()
    assert built.preview.terrain.rms_slope_deg == 25.0
    assert built.settings.terrain.rms_slope_deg == 12.0
    assert not built.edited
    built = change(watched, "terrain.rms_slope_deg", 5.0)
    assert np.ptp(positions(built.terrain)[:, 2]) < np.ptp(grid[:, 2]) / 2


@pytest.mark.long
def test_coarse_ground_follows_the_cameras(watched):
    """It is finest where they look; fine ground stays as it is."""
    before = positions(scenes.find_built(watched).terrain)
    built = change(watched, "rig.heading_deg", 90.0)
    assert np.array_equal(positions(built.terrain), before)
    change(watched, "terrain.rms_slope_deg", 25.0)
    found = []
    for heading, ahead in ((90.0, (1.0, 0.0)), (270.0, (-1.0, 0.0))):
        built = change(watched, "rig.heading_deg", heading)
        assert not built.edited
        found.append(float(np.mean(positions(built.terrain)[:, :2] @ ahead > 0.0)))
    assert min(found) > 0.7


def test_the_previewed_blocks_lie_on_the_previewed_ground(watched):
    mark = next(iter(preview.find_instanced_objects(blocks(scenes.find_built(watched))))).data.materials[0]
    built = change(watched, "rocks.coverage", 0.1)
    settings, carrier = current(watched), blocks(built)
    assert len(carrier.data.vertices) > 10
    assert next(iter(preview.find_instanced_objects(carrier))).data.materials[0] == mark
    shapes = {len(shape.data.polygons) for shape in preview.find_instanced_objects(carrier)}
    assert shapes == {320}  # triangles of the coarsest shapes
    where = positions(carrier)
    ground = scenes.make_ground(settings).heights(where[:, 0], where[:, 1], 2 * settings.terrain.size_m / SIDE)
    # A block's centre is within its own size of the ground, and blocks are at most largest_m wide.
    assert np.all(np.abs(where[:, 2] - ground) < settings.rocks.largest_m)
    assert not built.edited
    assert blocks(change(watched, "rocks.coverage", 0.0)) is None
    assert blocks(change(watched, "rocks.coverage", 0.02)) is not None
    assert not scenes.find_built(watched).edited


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("light.sun_elevation_deg", 3.0),
        ("light.sun_irradiance_wm2", 50.26),
        ("light.sun_angular_diameter_deg", 5.0),
        ("rig.heading_deg", 40.0),
        ("rig.focal_length_mm", 20.0),
        ("rig.baseline_m", 0.5),
        ("rig.x_m", 2.5),
        ("surface.albedo", 0.4),
        ("surface.albedo_variation", 0.5),
        ("surface.grain_amplitude_m", 0.0),
        ("rocks.own_surface", True),
        ("surface.trough_dirt", 0.5),
        ("surface.salt_share", 0.2),
        ("textures.set", "CRACKS"),
    ],
)
def test_light_camera_and_surface_become_what_build_scene_makes(watched, name, value):
    before = positions(scenes.find_built(watched).terrain)
    built = change(watched, name, value)
    shown, names = state(built), sorted(o.name for o in built.collection.all_objects)
    assert not built.edited
    assert built.preview == {}
    assert scenes.list_changed_settings(built, current(watched)) == []
    assert preview.read_notes(watched) == []
    assert np.array_equal(positions(built.terrain), before)  # at full resolution
    assert bring_up_to_date(watched, current(watched)).collection == built.collection
    assert shown == fresh(watched, current(watched))
    assert names == sorted(o.name for o in scenes.find_built(watched).collection.all_objects)


def test_build_after_previews_is_build_without(watched):
    counts = everything()
    for name, value in (
        ("terrain.hurst", 0.6),
        ("rocks.angularity", 0.2),
        ("dataset.seed", 7),
        ("cracks.depth_m", 0.3),
        ("surface.albedo_variation", 0.4),
        ("rig.x_m", 1.0),
        ("light.sun_azimuth_deg", 200.0),
    ):
        built = change(watched, name, value)
        assert not built.edited, name
    assert built.preview
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    built = scenes.find_built(watched)
    after = state(built)
    assert built.preview == {}
    assert preview.read_notes(watched) == []
    assert everything() == counts
    assert not any(
        "." in block.name for kind in (bpy.data.objects, bpy.data.meshes, bpy.data.materials) for block in kind
    )
    assert after == fresh(watched, current(watched))


def test_a_new_seed_shows_ground_blocks_and_grain_of_that_seed(watched):
    built = change(watched, "dataset.seed", 5)
    assert built.preview.dataset.seed == 5
    assert state(built)["terrain materials"] == fresh(watched, current(watched))["terrain materials"]


def test_a_preset_is_one_update(watched, monkeypatch):
    updates = []
    monkeypatch.setattr(live_preview, "update_scene", lambda scene: updates.append(scene))
    assert bpy.ops.icymoon.load_preset(preset="scenes/europa_rough_ice") == {"FINISHED"}
    assert updates == [watched]


def test_changes_of_a_script_are_two_updates(watched, monkeypatch):
    updates = []
    monkeypatch.setattr(live_preview, "update_scene", lambda scene: updates.append(scene) or False)
    for degrees in range(10):
        watched.icymoon.terrain.rms_slope_deg = degrees
    assert bpy.app.timers.is_registered(live_preview.show_waiting)
    assert len(updates) == 1
    _turn()
    assert len(updates) == 2


def test_a_list_of_layers_is_listened_to(watched):
    assert bpy.ops.icymoon.layer_add() == {"FINISHED"}
    _turn()
    assert len(scenes.find_built(watched).preview["terrain"]["layers"]) == 1
    assert bpy.ops.icymoon.layer_remove() == {"FINISHED"}
    _turn()
    assert scenes.find_built(watched).preview["terrain"]["layers"] == []


def test_what_changes_no_picture_changes_nothing(watched):
    before = scenes.find_built(watched).collection["icymoon_settings"]
    built = change(watched, "quality.samples", 7)
    change(watched, "sensor.bits", 10)
    assert built.collection["icymoon_settings"] == before
    assert not bpy.app.timers.is_registered(live_preview.show_waiting)


def test_without_a_window_nothing_is_previewed(small):
    bpy.ops.icymoon.build_scene()
    mark = make_fingerprint(scenes.find_collection(small))
    small.icymoon.terrain.rms_slope_deg = 30.0
    assert make_fingerprint(scenes.find_collection(small)) == mark
    assert not bpy.app.timers.is_registered(live_preview.show_waiting)


def test_switched_off_the_panel_says_that_settings_have_changed(watched):
    watched.icymoon.live = False
    before = state(scenes.find_built(watched))
    built = change(watched, "light.sun_elevation_deg", 50.0)
    assert state(built) == before
    assert "Settings have changed" in texts(drawn(sidebar.ICYMOON_PT_main))
    built = change(watched, "light.sun_elevation_deg", 20.0)
    assert "Settings have changed" not in texts(drawn(sidebar.ICYMOON_PT_main))
    change(watched, "light.sun_elevation_deg", 50.0)
    watched.icymoon.live = True
    _turn()
    assert state(scenes.find_built(watched)) != before
    assert preview.read_notes(watched) == []


def test_kernels_that_are_missing_are_told_once_at_their_field(watched):
    before = state(scenes.find_built(watched))
    built = change(watched, "light.directions_from", "KERNELS")
    assert state(built) == before
    panels = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("ICYMOON_PT_")]
    telling = [panel.bl_idname for panel in panels if "Kernels is empty" in texts(drawn(panel))]
    assert telling == ["ICYMOON_PT_light"]
    shown = drawn(bpy.types.ICYMOON_PT_light)
    field = next(k for k, entry in enumerate(shown) if entry[:2] == ("prop", "icymoon.light.kernels"))
    assert "Kernels is empty" in texts(shown[field + 1 :])
    assert live_preview.list_lines(watched) == ["The light is as before: see Light"]
    assert drawn(bpy.types.ICYMOON_PT_sky) == []
    change(watched, "light.directions_from", "ANGLES")
    assert "empty" not in texts(drawn(bpy.types.ICYMOON_PT_light))
    assert drawn(bpy.types.ICYMOON_PT_sky) != []


def test_settings_out_of_sense_are_a_sentence_and_keep_the_picture(watched):
    assert len(live_preview.list_lines(watched)) == 1
    change(watched, "terrain.rms_slope_deg", 20.0)
    before = state(scenes.find_built(watched))
    built = change(watched, "terrain.inner_scale_m", 9.0)  # longer than the outer scale, 8 m
    assert state(built) == before
    assert any("inner_scale_m" in sentence for sentence in preview.read_notes(watched))
    assert "Ground ▸ Smallest Feature" in texts(drawn(sidebar.ICYMOON_PT_main))  # as the sidebar names it
    built = change(watched, "light.sun_elevation_deg", 60.0)  # what makes sense is still shown
    assert built.settings.light.sun_elevation_deg == 60.0
    assert any("inner_scale_m" in sentence for sentence in preview.read_notes(watched))
    built = change(watched, "terrain.inner_scale_m", 0.02)
    assert len(live_preview.list_lines(watched)) == 1
    assert preview.read_notes(watched) == [preview.COARSE_MESSAGE]
    with pytest.raises(IcyMoonError):
        bring_up_to_date(watched, description.merged(current(watched), {"rocks": {"smallest_m": 5.0}}))


def test_edits_by_hand_stay(watched):
    built = scenes.find_built(watched)
    built.terrain.data.vertices[7].co.z += 0.5
    before = positions(built.terrain)
    built = change(watched, "terrain.rms_slope_deg", 30.0)
    assert np.array_equal(positions(built.terrain), before)
    assert built.edited
    assert any("ground was edited by hand" in sentence for sentence in preview.read_notes(watched))
    built = change(watched, "light.sun_elevation_deg", 60.0)  # of the rest, the settings still decide
    assert built.edited_parts() == {"terrain data"}
    change(watched, "terrain.rms_slope_deg", 12.0)
    assert preview.read_notes(watched) == []
    assert bring_up_to_date(watched, current(watched)).edited  # the sculpted ground under the new Sun is rendered
    built.sun.rotation_euler.x += 0.1
    turned = built.sun.matrix_basis.copy()
    built = change(watched, "light.sun_elevation_deg", 10.0)
    assert built.sun.matrix_basis == turned
    assert any("Sun was edited" in sentence for sentence in preview.read_notes(watched))


@pytest.mark.parametrize(
    ("edit", "name", "value", "said"),
    [
        (lambda b: setattr(b.camera.location, "x", 3.0), "rig.height_m", 2.0, "camera was edited"),
        (
            lambda b: setattr(
                b.terrain.data.materials[0].node_tree.nodes["Snow"].inputs["Roughness"], "default_value", 0.1
            ),
            "surface.albedo",
            0.3,
            "surface of the ground",
        ),
        (lambda b: setattr(blocks(b).data.vertices[0].co, "z", 3.0), "rocks.coverage", 0.1, "field of rocks"),
    ],
)
def test_each_edited_part_says_so_and_stays(watched, edit, name, value, said):
    built = scenes.find_built(watched)
    edit(built)
    role = built.edited_parts()
    before = {part: mark for part, mark in state(built).items() if part in role}
    built = change(watched, name, value)
    assert {part: mark for part, mark in state(built).items() if part in role} == before
    assert built.edited_parts() == role
    assert any(said in sentence for sentence in preview.read_notes(watched))


def shapes_of(built: scenes.Built) -> list[bpy.types.Mesh]:
    return [shape.data for shape in preview.find_instanced_objects(blocks(built))]


def test_blocks_keep_their_shapes_while_the_ground_moves(watched, monkeypatch):
    """To the last mark they are as if built anew."""
    shapes = shapes_of(change(watched, "terrain.rms_slope_deg", 25.0))
    built = change(watched, "terrain.rms_slope_deg", 20.0)
    assert shapes_of(built) == shapes
    assert not built.edited
    moved = state(built)
    monkeypatch.setattr(preview, "move_rocks", lambda *_: False)
    change(watched, "terrain.rms_slope_deg", 25.0)
    built = change(watched, "terrain.rms_slope_deg", 20.0)
    assert set(shapes_of(built)).isdisjoint(shapes)
    assert state(built) == moved


def test_other_shapes_of_blocks_replace_the_shapes(watched):
    before = [positions_of(mesh) for mesh in shapes_of(change(watched, "terrain.rms_slope_deg", 25.0))]
    after = [positions_of(mesh) for mesh in shapes_of(change(watched, "rocks.angularity", 0.1))]
    assert not any(np.array_equal(a, b) for a in before for b in after)
    assert not scenes.find_built(watched).edited


def positions_of(mesh: bpy.types.Mesh) -> np.ndarray:
    return np.array([vertex.co for vertex in mesh.vertices])


def test_an_edited_shape_of_the_previewed_blocks_stays(watched):
    built = change(watched, "terrain.rms_slope_deg", 25.0)
    shapes_of(built)[0].vertices[0].co.z += 1.0
    before = state(built)
    built = change(watched, "terrain.rms_slope_deg", 20.0)
    assert state(built) == before
    assert built.edited_parts() == {"rock object"}
    assert any("field of rocks" in sentence for sentence in preview.read_notes(watched))


def test_a_copy_of_the_blocks_stays_where_it_was(watched):
    built = change(watched, "terrain.rms_slope_deg", 25.0)
    copy = blocks(built).copy()  # as Duplicate Linked makes it
    watched.collection.objects.link(copy)
    before = positions(copy)
    built = change(watched, "terrain.rms_slope_deg", 20.0)
    assert np.array_equal(positions(copy), before)
    assert not np.array_equal(positions(blocks(built)), before)


def test_an_update_of_the_ground_reads_marks_once_before_and_once_after_it(watched, monkeypatch):
    change(watched, "terrain.rms_slope_deg", 25.0)
    read = []
    for name in ("find_edited_parts", "update_marks"):
        of = getattr(built_scene, name)
        monkeypatch.setattr(
            built_scene, name, lambda *given, of=of, **how: read.append(of.__name__) or of(*given, **how)
        )
    built = change(watched, "terrain.rms_slope_deg", 20.0)
    assert read == ["find_edited_parts", "update_marks"]
    assert not built.edited


def test_a_preview_is_never_rendered(watched, tmp_path):
    built = change(watched, "terrain.rms_slope_deg", 25.0)
    settings = current(watched)
    with pytest.raises(IcyMoonError, match="preview"):
        render_pairs(built, plan_pairs(watched, settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    change(watched, "terrain.rms_slope_deg", 12.0)  # as it was built: still a coarse grid
    assert scenes.list_changed_settings(scenes.find_built(watched), current(watched)) == []
    planned = [pair.id for pair in plan_pairs(watched, current(watched))]
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    built = scenes.find_built(watched)
    assert built.preview == {}
    assert len(built.terrain.data.vertices) == current(watched).terrain.resolution ** 2
    pairs = list((tmp_path / "dataset" / "pairs").iterdir())
    assert [pair.name for pair in pairs] == planned
    assert not json.loads((pairs[0] / "pair.json").read_text())["edited_by_hand"]


def test_an_edited_preview_is_not_rendered(watched):
    built = change(watched, "terrain.rms_slope_deg", 25.0)
    built.terrain.data.vertices[7].co.z += 0.5
    with pytest.raises(IcyMoonError, match="preview"):
        bring_up_to_date(watched, current(watched))
    before = positions(built.terrain)
    assert np.array_equal(positions(change(watched, "terrain.rms_slope_deg", 5.0).terrain), before)


def test_a_lander_does_not_keep_a_preview_from_being_built(watched):
    lander = bpy.data.objects.new("Lander", None)
    scenes.find_built(watched).collection.objects.link(lander)
    change(watched, "terrain.rms_slope_deg", 25.0)
    built = bring_up_to_date(watched, current(watched))
    assert built.preview == {}
    assert lander.name in built.collection.objects
    assert built.edited


def test_a_surface_that_differs_from_rock_to_rock_is_no_edit_by_hand(watched):
    """Nor a preset with one, whose rocks are made again together with their surface."""
    for name, value in (("surface.bubble_share", 0.02), ("surface.bubble_band_m", 0.5), ("surface.bubble_band_m", 0.0)):
        assert not change(watched, name, value).edited, (name, value)
    watched.icymoon.rocks.own_surface, watched.icymoon.surface.model = True, "HAPKE"
    bpy.ops.icymoon.build_scene()
    bpy.ops.icymoon.load_preset(preset="scenes/europa_rough_ice")
    _turn()
    assert not scenes.find_built(watched).edited_parts()
    change(watched, "rocks.own_surface", True)
    moved = next(item for item in scenes.find_built(watched).collection.all_objects if item.get(scenes.TAG) == "rock")
    moved.location.x += 1.0
    change(watched, "rock_surface.bubble_share", 0.02)
    assert scenes.find_built(watched).edited_parts() == {"rock object"}, "what is edited by hand stays edited"


def test_a_ground_of_ones_own_is_left_but_light_and_camera_follow(watched, tmp_path):
    heights = np.add.outer(np.linspace(0, 1, 50), np.linspace(0, 2, 50))
    np.save(tmp_path / "dem.npy", heights)
    scene_properties.write_settings(
        watched.icymoon, {"source": {"kind": "HEIGHT_MAP", "file": str(tmp_path / "dem.npy"), "metres_per_pixel": 0.2}}
    )
    _turn()
    assert any("no live preview" in sentence for sentence in preview.read_notes(watched))
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    before = positions(scenes.find_built(watched).terrain)
    built = change(watched, "source.height_scale_m", 3.0)
    assert np.array_equal(positions(built.terrain), before)
    assert any("no live preview" in sentence for sentence in preview.read_notes(watched))
    change(watched, "source.height_scale_m", 1.0)
    change(watched, "light.sun_elevation_deg", 50.0)
    built = change(watched, "rig.height_m", 2.5)
    assert built.preview == {}
    shown = state(built)
    assert shown == fresh(watched, current(watched))
    built = change(watched, "rig.x_m", 3.0)
    assert built.preview == {"rig": {"x_m": 3.0, "y_m": 0.0}}
    near = built.camera.location.z
    assert not built.edited
    assert scenes.list_changed_settings(built, current(watched)) == ["rig.x_m"]
    built = bring_up_to_date(watched, current(watched))
    assert built.preview == {}
    # The mesh is bilinear between vertices as the height map is, but for the diagonal of each square.
    assert built.camera.location.z == pytest.approx(near, abs=1e-3)


def test_ground_stays_where_the_rays_of_falling_frost_cannot_be_traced(watched, monkeypatch):
    monkeypatch.setattr("icymoon.rays.engine._load_library", lambda folders: None)
    watched.icymoon.surface.model, watched.icymoon.surface.frost_share = "PRINCIPLED", 0.5
    before = positions(scenes.find_built(watched).terrain)
    watched.icymoon.terrain.rms_slope_deg = 25.0
    built = change(watched, "surface.frost_from", "FALL")
    assert np.array_equal(positions(built.terrain), before)
    assert any("lacks Embree" in sentence for sentence in preview.read_notes(watched))


def test_a_ground_in_sculpt_mode_waits(watched, monkeypatch):
    built = scenes.find_built(watched)
    bpy.context.view_layer.objects.active = built.terrain
    bpy.ops.object.mode_set(mode="SCULPT")
    before = positions(built.terrain)
    built = change(watched, "terrain.rms_slope_deg", 30.0)
    assert np.array_equal(positions(built.terrain), before)
    assert any("Sculpt Mode" in sentence for sentence in preview.read_notes(watched))
    bpy.ops.object.mode_set(mode="OBJECT")
    live_preview.update_scene(watched)
    assert len(scenes.find_built(watched).terrain.data.vertices) < len(before)


def test_a_preview_tells_that_it_has_no_trench(watched):
    change(watched, "excavation.path", "LINE")
    assert preview.read_notes(watched) == ["Coarse ground without the trench: press Build Scene"]
    change(watched, "excavation.path", "NONE")
    assert "trench" not in " ".join(preview.read_notes(watched))


def test_a_preview_survives_saving_and_loading(watched, tmp_path):
    before = state(change(watched, "terrain.rms_slope_deg", 25.0))
    _turn()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    scene = bpy.context.scene
    built = scenes.find_built(scene)
    assert state(built) == before
    assert not built.edited
    assert preview.read_notes(scene) == [preview.COARSE_MESSAGE]
    assert not bpy.app.timers.is_registered(live_preview.show_waiting)  # loading a file changes no setting


def test_undo_and_redo_bring_back_what_was_shown(watched):
    bpy.context.preferences.edit.use_global_undo = True
    name = watched.name
    bpy.ops.ed.undo_push(message="Built")
    first = state(scenes.find_built(watched))
    change(watched, "terrain.rms_slope_deg", 25.0)
    bpy.ops.ed.undo_push(message="Slope")
    second = state(scenes.find_built(watched))
    change(watched, "light.sun_elevation_deg", 50.0)
    bpy.ops.ed.undo_push(message="Sun")
    third = state(scenes.find_built(watched))

    def there() -> tuple[dict[str, str], scenes.Built]:
        scene = bpy.data.scenes[name]
        built = scenes.find_built(scene)
        assert not built.edited
        before = state(built)
        live_preview.update_scene(scene)
        assert state(built) == before, "the preview was not what the settings say"
        return before, built

    for operator, expected in (
        (bpy.ops.ed.undo, second),
        (bpy.ops.ed.undo, first),
        (bpy.ops.ed.redo, second),
        (bpy.ops.ed.redo, third),
    ):
        assert operator() == {"FINISHED"}
        found, built = there()
        assert found == expected
    assert built.preview.terrain.rms_slope_deg == 25.0


def test_the_view_follows_unless_a_person_has_set_it(watched):
    live_preview.frame_and_expose(watched, current(watched))
    change(watched, "light.sun_irradiance_wm2", 29.64)  # twice 14.82
    change(watched, "rig.width_px", 200)
    assert watched.render.resolution_x == 200
    dimmed = watched.view_settings.exposure
    change(watched, "light.sun_irradiance_wm2", 14.82)
    assert watched.view_settings.exposure == pytest.approx(dimmed + 1.0, abs=1e-5)
    watched.view_settings.exposure = 0.5
    change(watched, "light.sun_irradiance_wm2", 29.64)
    assert watched.view_settings.exposure == 0.5


def test_the_grid_is_as_fine_as_the_time_allows():
    sides = live_preview.SIDES
    assert live_preview.choose_next_side(sides[-1], 10 * live_preview.BUDGET_S) == sides[-2]
    assert live_preview.choose_next_side(sides[0], 10 * live_preview.BUDGET_S) == sides[0]
    assert live_preview.choose_next_side(sides[0], 0.01 * live_preview.BUDGET_S) == sides[1]
    assert live_preview.choose_next_side(sides[-1], 0.01 * live_preview.BUDGET_S) == sides[-1]
    # A step up that would be taken back at once is not taken.
    assert live_preview.choose_next_side(sides[0], 0.79 * live_preview.BUDGET_S) == sides[0]


def test_the_first_step_after_a_build_is_the_coarsest(watched):
    session.preview_side = 10 * SIDE
    bpy.ops.icymoon.build_scene()
    assert session.preview_side == SIDE


def test_a_failing_listener_does_not_hold_back_the_next_changes(scene, monkeypatch):
    heard = []
    monkeypatch.setattr(change_announcements, "listeners", [lambda scene, effects: heard.append(effects)])

    def fail() -> None:
        with change_announcements.batch_changes():
            change_announcements.announce(scene, "light")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    change_announcements.announce(SimpleNamespace(), "camera")
    assert heard == [frozenset({"light"}), frozenset({"camera"})]


@pytest.mark.long
def test_a_surface_that_knows_the_sun_follows_light_and_accuracy(watched):
    for name, value, traced in (
        ("surface.model", "HAPKE", False),
        ("light.sun_azimuth_deg", 10.0, False),
        ("hapke.accuracy", "ACCURATE", True),
        ("hapke.w", 0.5, True),
        ("light.sun_elevation_deg", 50.0, True),
        ("hapke.backend", "NODES", False),
        ("light.sun_angular_diameter_deg", 1.0, False),
        ("surface.model", "LUNAR_LAMBERT", False),
        ("light.sun_azimuth_deg", 70.0, False),
    ):
        built = change(watched, name, value)
        assert not built.edited
        assert (built.sun.light_linking.receiver_collection is not None) == traced
        shown = state(built)
        assert shown == fresh(watched, current(watched)), name
    assert not watched.cycles.shading_system


def test_turning_the_camera_away_from_real_relief_says_what_is_not_shown(watched):
    watched.icymoon.mesh.kind = "GRADED"
    watched.icymoon.surface.relief = "REAL"
    watched.icymoon.surface.grain_amplitude_m = 0.2
    watched.icymoon.surface.grain_size_m = 0.5
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    _turn()
    assert preview.read_notes(watched) == []
    change(watched, "rig.heading_deg", watched.icymoon.rig.heading_deg + 40.0)
    (sentence,) = preview.read_notes(watched)
    assert "fine relief" in sentence
    assert "press Build Scene" in sentence


def test_the_first_build_of_untouched_settings_is_lit(scene):
    """The button of the window turns the Sun; scripts, plans and scenes with a setting of their own keep theirs."""
    default = scene.icymoon.light.sun_azimuth_deg
    scene.icymoon.rig.heading_deg = 10.0
    assert not build.light_untouched_scene(scene)
    scene.icymoon.rig.heading_deg = 0.0
    assert scene.icymoon.light.sun_azimuth_deg == default
    assert build.light_untouched_scene(scene)
    assert scene.icymoon.light.sun_azimuth_deg == build.LIT_AZIMUTH_DEG
    assert not build.light_untouched_scene(scene)


def test_a_change_evaluates_nothing_before_it_is_complete(watched):
    """A rendered view reads its scene whenever anything is evaluated; Cycles would read freed meshes in the middle."""
    evaluated: list[object] = []

    def note(*said: object) -> None:
        evaluated.append(said)

    handlers = bpy.app.handlers.depsgraph_update_pre
    handlers.append(note)
    try:
        for name, value in (
            ("terrain.rms_slope_deg", 31.0),
            ("rocks.coverage", 0.11),
            ("surface.albedo", 0.71),
            ("light.sun_elevation_deg", 41.0),
            ("rig.pitch_deg", 41.0),
        ):
            change(watched, name, value)
            assert (name, evaluated) == (name, [])
        bpy.context.view_layer.update()
        assert evaluated  # what the window does next
    finally:
        handlers.remove(note)


@pytest.mark.parametrize("kind", ["GRID", "GRADED"])
def test_a_lander_of_a_moved_camera_stands_below_it(watched, kind):
    """The ground of a graded mesh stays that of the former site, so the height of the site is not that of the build."""
    change(watched, "mesh.kind", kind)
    bpy.ops.icymoon.build_scene()
    before = scenes.find_built(watched).site_m
    change(watched, "rig.x_m", 1.1)
    for arm in ("PARAMETRIC", "NONE", "PARAMETRIC"):
        built = change(watched, "lander.kind", arm)
    built = change(watched, "arm.shoulder_deg", watched.icymoon.arm.shoulder_deg + 3)
    bpy.context.view_layer.update()
    parts = find_built_objects(built.collection)
    body = parts["lander body"].matrix_world.translation
    above = built.camera.matrix_world.translation.z - body.z
    assert watched.icymoon.rig.height_m == pytest.approx(above, abs=1e-4)
    assert abs(built.camera.matrix_world.translation.z - watched.icymoon.rig.height_m - before) > 0.01


def test_a_moved_camera_with_a_lander_makes_the_ground_once(watched, monkeypatch):
    change(watched, "mesh.kind", "GRADED")
    change(watched, "lander.kind", "PARAMETRIC")
    bpy.ops.icymoon.build_scene()
    made, make = [], scenes.make_ground
    monkeypatch.setattr(scenes, "make_ground", lambda settings: made.append(settings) or make(settings))
    change(watched, "rig.x_m", 0.4)
    assert len(made) == 1

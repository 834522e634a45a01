"""Vary This Scene: the list, the plan that is made of it, and its pairs."""

from __future__ import annotations

import json
import time
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from evaluations import ROW, write_evaluation
from icymoon.nodes import build_scene as scenes
from icymoon.operators import (
    dataset,
    evaluate,
    export_pairs,
    last_variations,
    render_variations,
    results,
    show_pair,
    variation_curves,
    variation_plan,
    varied_settings,
    window_events,
)
from icymoon.operators.variation_plan import find_folder_fault, find_free_folder
from icymoon.render.pairs.pair_folder import find_pairs
from icymoon.render.plans import vary_scene
from icymoon.render.plans.frozen_plan import freeze_plan
from icymoon.render.plans.plan_file import read_plan
from icymoon.render.plans.vary_scene import SceneVariations, VariedSetting
from icymoon.settings.blender import scene_properties
from icymoon.settings.description import merged
from icymoon.settings.table import TOPICS
from plans import TINY
from stand_ins import stand_in

ELEVATION = "light.sun_elevation_deg"


@pytest.fixture
def tiny(scene, tmp_path, monkeypatch):
    """A scene whose pairs are small, and whose data set is in a folder of the test's own."""
    monkeypatch.setattr(dataset, "find_state_folder", lambda: tmp_path / "running")
    scene_properties.write_settings(scene.icymoon, {**TINY, "dataset": {"folder": str(tmp_path / "set")}})
    dataset.readout.update(plan="", lines=[], set_aside=[], last=None)
    yield scene
    process = dataset.find_unwatched_process(tmp_path / "running")
    if process is not None:
        process.stop()


def varied(scene):
    return scene_properties.read_variations(scene.icymoon).varied


def plan_of(folder):
    return read_plan(folder / "plan.toml")


def test_a_setting_varies_about_its_value_unless_told_otherwise(tiny):
    tiny.icymoon.light.sun_elevation_deg = 20
    assert bpy.ops.icymoon.vary(setting=ELEVATION) == {"FINISHED"}
    assert varied(tiny) == (VariedSetting(ELEVATION, 10.0, 40.0, 5),)
    assert bpy.ops.icymoon.vary(setting=ELEVATION, first=5, last=60.5, count=4, spacing="RATIO") == {"FINISHED"}
    assert varied(tiny) == (VariedSetting(ELEVATION, 5.0, 60.5, 4, "RATIO"),)
    assert bpy.ops.icymoon.vary(setting=ELEVATION, count=7) == {"FINISHED"}  # what is not told stays
    assert varied(tiny) == (VariedSetting(ELEVATION, 5.0, 60.5, 7, "RATIO"),)


def test_whole_numbers_choices_and_ticks_vary(tiny):
    bpy.ops.icymoon.vary(setting="quality.samples", first_whole=2, last_whole=8, count=3)
    bpy.ops.icymoon.vary(setting="surface.model")
    bpy.ops.icymoon.vary(setting="rocks.family", values={"SLABS", "BOULDERS"})
    bpy.ops.icymoon.vary(setting="light.planet")
    models = tuple(choice[0] for choice in vary_scene.VariedSetting("surface.model").setting.choices)
    assert varied(tiny) == (
        VariedSetting("quality.samples", 2, 8, 3),
        VariedSetting("surface.model", values=models),
        VariedSetting("rocks.family", values=("BOULDERS", "SLABS")),
        VariedSetting("light.planet"),
    )
    assert all(isinstance(end, int) for end in (varied(tiny)[0].first, varied(tiny)[0].last))
    tiny.icymoon.variations.varied[1].ticks["HAPKE"].on = False
    assert varied(tiny)[1].values == tuple(name for name in models if name != "HAPKE")


def test_the_list_is_no_setting_and_changes_no_pair(tiny):
    before = scene_properties.read_settings(tiny.icymoon)
    bpy.ops.icymoon.vary(setting=ELEVATION)
    assert scene_properties.read_settings(tiny.icymoon) == before


def test_the_list_is_saved_with_the_scene(tiny, tmp_path):
    bpy.ops.icymoon.vary(setting=ELEVATION, first=5, last=60)
    bpy.ops.icymoon.vary(setting="surface.model", values={"LAMBERT", "HAPKE"})
    tiny.icymoon.variations.combine, tiny.icymoon.variations.seeds = "SOBOL", 3
    before = scene_properties.read_variations(tiny.icymoon)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert varied(bpy.context.scene) == ()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert scene_properties.read_variations(bpy.context.scene.icymoon) == before


def test_values_out_of_range_are_refused_with_the_range(tiny):
    with pytest.raises(RuntimeError, match=r"95 deg, outside -90 to 90 deg"):
        bpy.ops.icymoon.vary(setting=ELEVATION, first=5, last=95)
    with pytest.raises(RuntimeError, match="two or more"):
        bpy.ops.icymoon.vary(setting="surface.model", values={"HAPKE"})
    assert varied(tiny) == ()


def test_settings_are_moved_and_removed(tiny):
    remove, move = bpy.ops.icymoon.variation_remove, bpy.ops.icymoon.variation_move
    assert not remove.poll()
    for name in (ELEVATION, "surface.albedo", "rig.baseline_m"):
        bpy.ops.icymoon.vary(setting=name)
    assert tiny.icymoon.variations.active == 2
    assert move(direction="DOWN") == {"CANCELLED"}
    assert move(direction="UP") == {"FINISHED"}
    assert [each.name for each in varied(tiny)] == [ELEVATION, "rig.baseline_m", "surface.albedo"]
    assert remove() == {"FINISHED"}
    assert [each.name for each in varied(tiny)] == [ELEVATION, "surface.albedo"]
    remove()
    remove()
    assert varied(tiny) == ()


def test_a_context_menu_knows_the_setting_under_the_mouse(tiny):
    def under(group, key):
        return varied_settings.find_setting_of_button(
            SimpleNamespace(button_prop=group.bl_rna.properties[key], button_pointer=group)
        )

    assert under(tiny.icymoon.light, "sun_elevation_deg") == ELEVATION
    assert under(tiny.icymoon.rock_surface, "albedo") == "rock_surface.albedo"
    assert under(tiny.icymoon, "live") == under(tiny.render, "resolution_x") == ""
    assert under(tiny.icymoon.variations, "seeds") == ""
    assert varied_settings.find_setting_of_button(bpy.context) == ""


def test_the_tooltip_of_vary_tells_what_the_field_tells():
    given = SimpleNamespace(is_property_set=lambda name: True, setting=ELEVATION)
    told = varied_settings.ICYMOON_OT_vary.description(bpy.context, given)
    assert told.startswith("Vary Sun Elevation: ")
    assert told.endswith(TOPICS["light"]["sun_elevation_deg"].description)
    none = SimpleNamespace(is_property_set=lambda name: False)
    assert varied_settings.ICYMOON_OT_vary.description(bpy.context, none) == varied_settings.ICYMOON_OT_vary.__doc__


@pytest.mark.parametrize(
    ("topic", "key", "possible"),
    [("light", "sun_elevation_deg", True), ("sensor", "bits", False), ("light", "body", False)],
)
def test_what_cannot_vary_is_grey_in_the_context_menu(tiny, topic, key, possible):
    group = getattr(tiny.icymoon, topic)
    context = SimpleNamespace(button_prop=group.bl_rna.properties[key], button_pointer=group)
    assert (varied_settings.ICYMOON_OT_vary.find_obstacle(context) == "") is possible


def test_the_lines_follow_the_settings_and_the_list(tiny):
    assert render_variations.list_lines(tiny)[0] == "1 pair"
    bpy.ops.icymoon.vary(setting=ELEVATION)
    assert render_variations.list_lines(tiny)[0] == "5 values of Sun Elevation = 5 pairs"
    tiny.icymoon.variations.seeds = 3
    tiny.icymoon.dataset.headings = 2
    told = render_variations.list_lines(tiny)
    assert told[0] == "5 values of Sun Elevation x 3 seeds x 2 headings = 30 pairs"
    assert told[1].startswith("About ")
    tiny.icymoon.rig.width_px = 3200
    assert render_variations.list_lines(tiny)[1] != told[1]
    tiny.icymoon.variations.varied[0].last = 200
    assert "outside -90 to 90 deg" in render_variations.list_lines(tiny)[0]
    tiny.icymoon.variations.varied[0].setting = "light.no_such"
    assert "unknown setting" in render_variations.list_lines(tiny)[0]


def test_lines_that_are_known_cost_nothing(tiny, monkeypatch):
    bpy.ops.icymoon.vary(setting=ELEVATION)
    render_variations.list_lines(tiny)
    monkeypatch.setattr(render_variations, "describe_variations", lambda *_: pytest.fail("computed again"))
    render_variations.list_lines(tiny)


def test_undo_brings_the_lines_back(tiny):
    bpy.ops.icymoon.vary(setting=ELEVATION)
    render_variations.list_lines(tiny)
    for handler in bpy.app.handlers.undo_post:
        handler(tiny)
    assert not window_events._known


def test_the_saved_plan_makes_the_scenes_pairs(tiny, tmp_path):
    with pytest.raises(RuntimeError, match="No setting varies yet"):
        bpy.ops.icymoon.save_plan(filepath=str(tmp_path / "mine.toml"))
    bpy.ops.icymoon.vary(setting=ELEVATION, first=10, last=50, count=3)
    tiny.icymoon.terrain.layers.add().amplitude_m = 0.2
    assert bpy.ops.icymoon.save_plan(filepath=str(tmp_path / "mine")) == {"FINISHED"}
    pairs = read_plan(tmp_path / "mine.toml").pairs()
    present = scene_properties.read_settings(tiny.icymoon)
    assert [pair.settings for pair in pairs] == [
        merged(present, {"light": {"sun_elevation_deg": e}, "dataset": pair.settings.dataset})
        for e, pair in zip((10.0, 30.0, 50.0), pairs, strict=True)
    ]


def test_a_file_beside_the_blend_is_found_from_the_plan(tiny, tmp_path):
    (tmp_path / "ground.obj").write_text("v -5 -5 0\nv 5 -5 0\nv 5 5 0\nv -5 5 0\nf 1 2 3 4\n")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    source = bpy.context.scene.icymoon.source
    source.kind, source.file, source.up_axis = "MESH", "//ground.obj", "Z"
    bpy.ops.icymoon.vary(setting=ELEVATION)
    (tmp_path / "elsewhere").mkdir()
    bpy.ops.icymoon.save_plan(filepath=str(tmp_path / "elsewhere" / "mine.toml"))
    pairs = read_plan(tmp_path / "elsewhere" / "mine.toml").pairs()
    assert {pair.settings.source.file for pair in pairs} == {str(tmp_path / "ground.obj")}


def test_a_scene_edited_by_hand_is_refused_and_objects_of_ones_own_are_told_at_once(tiny, tmp_path):
    bpy.ops.icymoon.vary(setting=ELEVATION)
    bpy.ops.icymoon.build_scene()
    assert variation_plan.why_not_a_plan(tiny, thorough=True) == ""
    built = scenes.find_built(tiny)
    built.sun.data.energy *= 2
    for call in (
        lambda: bpy.ops.icymoon.save_plan(filepath=str(tmp_path / "mine.toml")),
        bpy.ops.icymoon.render_variations,
    ):
        with pytest.raises(RuntimeError, match="edited by hand, and a plan contains settings only"):
            call()
    bpy.ops.icymoon.build_scene()
    lander = bpy.data.objects.new("Lander", bpy.data.meshes.new("Lander"))
    scenes.find_collection(tiny).objects.link(lander)
    assert "The scene contains Lander, and a plan contains settings only" in variation_plan.why_not_a_plan(tiny)
    with pytest.raises(RuntimeError, match="contains Lander"):
        bpy.ops.icymoon.render_variations()
    assert not (tmp_path / "set").exists()


def variations_of(scene, *steps, **also):
    """The text of a plan of the scene at these elevations."""
    each = VariedSetting(ELEVATION, float(steps[0]), float(steps[-1]), len(steps))
    return vary_scene.make_plan_text(scene_properties.read_settings(scene.icymoon), SceneVariations((each,), **also))


def freeze(folder, text):
    """A data set that was begun with a plan, as the operator and ``icymoon batch`` leave it."""
    folder.mkdir()
    (folder / "plan.toml").write_text(text)
    freeze_plan(folder, plan_of(folder).pairs(), text)


def test_a_plan_is_rendered_into_an_empty_folder_or_its_own(tiny, tmp_path):
    folder, text = tmp_path / "set", variations_of(tiny, 10, 20)
    assert find_folder_fault(folder, text) == ""
    freeze(folder, text)
    assert find_folder_fault(folder, text) == ""
    # The same with other seeds has all pairs of the first.
    assert find_folder_fault(folder, variations_of(tiny, 10, 20, seeds=2)) == ""
    assert "other pairs" in find_folder_fault(folder, variations_of(tiny, 10, 30))
    (folder / "plan.toml").write_text("# mine\n")
    assert "another plan" in find_folder_fault(folder, text)


def test_pairs_of_no_plan_are_not_mixed_with_those_of_one(tiny, tmp_path):
    folder = tmp_path / "set"
    (folder / "pairs" / "0123456789ab").mkdir(parents=True)
    assert "other pairs" in find_folder_fault(folder, variations_of(tiny, 10, 20))


def test_a_free_folder_is_named_after_what_varies(tiny, tmp_path):
    folder, text = tmp_path / "set", variations_of(tiny, 10, 20)
    beside = tmp_path / "set_sun_elevation_3_seeds"
    assert find_free_folder(folder, text, "Sun Elevation, 3 Seeds") == beside  # the scene's own gets single pairs
    freeze(folder, variations_of(tiny, 10, 30))
    assert find_free_folder(folder, text, "Sun Elevation, 3 Seeds") == beside
    freeze(beside, variations_of(tiny, 10, 30))
    assert find_free_folder(folder, text, "Sun Elevation, 3 Seeds") == tmp_path / "set_sun_elevation_3_seeds_2"


def test_variations_are_continued_where_they_were_begun(tiny, tmp_path):
    begun, more = variations_of(tiny, 10, 20), variations_of(tiny, 10, 20, seeds=2)
    freeze(tmp_path / "mine", begun)
    assert find_free_folder(tmp_path / "set", more, "2 Seeds", tmp_path / "mine") == tmp_path / "mine"
    assert find_free_folder(tmp_path / "mine", more, "2 Seeds") == tmp_path / "mine"
    other = variations_of(tiny, 10, 30)
    assert find_free_folder(tmp_path / "set", other, "Sun", tmp_path / "mine") == tmp_path / "set_sun"


def start_rendering(scene, monkeypatch, **options):
    """Begin to render the variations as the window does, without another process."""

    def begin(settings, command, plan, scope):
        facts = {"dataset": str(settings.dataset.folder), "scope": scope, "started": time.time()}
        return SimpleNamespace(facts=facts)

    monkeypatch.setattr(dataset, "start_batch", begin)
    monkeypatch.setattr(dataset, "make_batch_command", lambda *_: [])
    kind: Any = render_variations.ICYMOON_OT_render_variations
    operator = stand_in(bl_label=kind.bl_label, **{"folder": "", "use_for_scene": False} | options)
    operator._make_job = lambda process, context: kind._make_job(operator, process, context)
    kind.start(operator, SimpleNamespace(scene=scene))
    return operator


def test_the_folder_of_variations_leaves_the_scenes_as_it_is_unless_asked(tiny, tmp_path, monkeypatch):
    bpy.ops.icymoon.vary(setting=ELEVATION, first=10, last=20, count=2)
    group, other = tiny.icymoon.dataset, str(tmp_path / "other")
    operator = start_rendering(tiny, monkeypatch, folder=other)
    assert group.folder == str(tmp_path / "set")
    assert last_variations.find_folder(tiny) == tmp_path / "other"
    assert operator._keeper._settings.dataset.folder == other
    start_rendering(tiny, monkeypatch, folder=other, use_for_scene=True)
    assert group.folder == other


def test_variations_are_measured_and_exported_from_their_folder(tiny, tmp_path):
    with pytest.raises(RuntimeError, match="press Render These Variations first"):
        bpy.ops.icymoon.evaluate(scope="VARIATIONS")
    (tmp_path / "other" / "pairs" / "0123456789ab").mkdir(parents=True)
    (tmp_path / "other" / "pairs" / "0123456789ab" / "pair.json").write_text("{}")
    last_variations.remember_folder(tiny, tmp_path / "other")
    assert export_pairs.find_sources(tiny) == {"VARIATIONS": [tmp_path / "other"]}
    settings = results.select_dataset(tiny, scene_properties.read_settings(tiny.icymoon), "VARIATIONS")
    write_evaluation(results.find_evaluation_folder(settings, "VARIATIONS"), {**ROW, "pairs": 2})
    evaluate.ResultKeeper(tiny, "VARIATIONS", settings)({"type": "result"})
    assert results.find_report_folder(tiny) == tmp_path / "other" / "evaluation"
    (only,) = results.list_notes(tiny)
    assert only.startswith("Of the variations, 2 pairs")
    tiny.icymoon.dataset.folder = str(tmp_path / "elsewhere")  # their results do not depend on it
    assert results.list_notes(tiny) == [only]
    last_variations.remember_folder(tiny, tmp_path / "later")
    assert "Other variations were rendered since" in results.list_notes(tiny)[1]


def test_another_data_set_is_not_overwritten(tiny, tmp_path):
    bpy.ops.icymoon.vary(setting=ELEVATION, first=10, last=20, count=2)
    freeze(tmp_path / "set", variations_of(tiny, 10, 30))
    before = {path: path.read_bytes() for path in (tmp_path / "set").iterdir()}
    with pytest.raises(RuntimeError, match="choose another folder"):
        bpy.ops.icymoon.render_variations()
    assert before == {path: path.read_bytes() for path in (tmp_path / "set").iterdir()}


@pytest.mark.long
def test_variations_are_rendered_evaluated_and_their_curve_is_shown(tiny, tmp_path, monkeypatch):
    bpy.ops.icymoon.vary(setting=ELEVATION, first=20, last=40, count=2)
    group = tiny.icymoon.dataset
    group.evaluate, group.methods, group.workers = True, "sgbm", 1
    shown = []
    monkeypatch.setattr(results, "show_images", lambda paths, open_window, names=None: shown.append(paths))
    assert not bpy.ops.icymoon.show_curve.poll()
    assert bpy.ops.icymoon.render_variations(folder=str(tmp_path / "other")) == {"FINISHED"}
    assert group.folder == str(tmp_path / "set")
    pairs = find_pairs(tmp_path / "other")
    assert {pair.settings.light.sun_elevation_deg for pair in pairs} == {20.0, 40.0}
    assert {pair.folder.name for pair in pairs} == {pair.id for pair in plan_of(tmp_path / "other").pairs()}
    assert [path.name for path in show_pair.find_pairs_to_show(tiny)] == [
        p.id for p in plan_of(tmp_path / "other").pairs()
    ]
    assert results.list_notes(tiny)[0].startswith("Of the variations, 2 pairs; measured ")
    curve = tmp_path / "other" / "evaluation" / "curves" / f"{ELEVATION}.png"
    assert results.find_curves(tiny) == {ELEVATION: curve}
    image = bpy.data.images.load(str(curve))
    assert image.size[0] > 2 * image.size[1] > 400
    assert shown[-1] == [curve]
    assert bpy.ops.icymoon.show_curve(setting=ELEVATION) == {"FINISHED"}
    assert shown[-1] == [curve]
    # Again: nothing is left to do, and more seeds continue the data set.
    written = {p.folder: (p.folder / "pair.json").stat().st_mtime_ns for p in pairs}
    tiny.icymoon.variations.seeds, group.evaluate = 2, False
    assert bpy.ops.icymoon.render_variations(folder=str(tmp_path / "other")) == {"FINISHED"}
    assert (
        written.items()
        <= {p.folder: (p.folder / "pair.json").stat().st_mtime_ns for p in find_pairs(tmp_path / "other")}.items()
    )
    assert len(find_pairs(tmp_path / "other")) == 4


@pytest.mark.parametrize(("count", "shown"), [(1, [0]), (5, [0, 1, 2, 3, 4]), (1000, None)])
def test_the_first_and_the_last_pair_are_among_those_shown(count, shown):
    found = [int(name) for name in last_variations.choose_spread([str(k) for k in range(count)])]
    assert (found[0], found[-1]) == (0, count - 1)
    assert found == shown if shown else len(set(found)) == len(found) == last_variations.MAX_PICTURES


def test_a_confirmed_dialog_reports_what_cannot_be(tiny, tmp_path):
    bpy.ops.icymoon.vary(setting=ELEVATION, first=10, last=20, count=2)
    freeze(tmp_path / "set", variations_of(tiny, 10, 30))
    said = []
    dialog: Any = SimpleNamespace(
        _asked=True, folder=str(tmp_path / "set"), use_for_scene=False, report=lambda kind, text: said.append(text)
    )
    assert render_variations.ICYMOON_OT_render_variations.execute(dialog, bpy.context) == {"CANCELLED"}
    assert len(said) == 1
    assert said[0].startswith(str(tmp_path / "set"))
    assert said[0].endswith("choose another folder.")


def test_nothing_is_written_if_there_is_no_evaluator(tiny, tmp_path, monkeypatch):
    bpy.ops.icymoon.vary(setting=ELEVATION)
    tiny.icymoon.dataset.evaluate = True
    monkeypatch.setenv("ICYMOON_EVALUATOR", str(tmp_path / "no_python"))
    with pytest.raises(RuntimeError, match="no_python"):
        bpy.ops.icymoon.render_variations()
    assert not (tmp_path / "set").exists()


def test_only_curves_inside_the_evaluation_are_shown(tiny, tmp_path):
    folder = tmp_path / "set" / "evaluation"
    folder.mkdir(parents=True)
    write_evaluation(folder)
    stated = json.loads((folder / "summary.json").read_text())
    (tmp_path / "outside.png").write_bytes(b"x")
    (folder / "inside.png").write_bytes(b"x")
    stated["curves"] = {"a.b": "../../outside.png", "c.d": "inside.png", "e.f": "gone.png"}
    (folder / "summary.json").write_text(json.dumps(stated))
    results.keep_results(tiny, "DATASET", scene_properties.read_settings(tiny.icymoon))
    assert results.find_curves(tiny) == {"c.d": folder / "inside.png"}


def test_curves_of_settings_in_the_list_come_first(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(results, "find_curves", lambda _: {"a.b": tmp_path / "a", ELEVATION: tmp_path / "e"})
    assert list(variation_curves.sort_curves(tiny)) == ["a.b", ELEVATION]
    bpy.ops.icymoon.vary(setting=ELEVATION)
    assert list(variation_curves.sort_curves(tiny)) == [ELEVATION, "a.b"]
    shown: list = []
    called: dict = {}
    monkeypatch.setattr(
        results, "show_images", lambda paths, open_window, names: (shown.append(paths), called.update(names))
    )
    bpy.ops.icymoon.show_curve(setting="a.b")
    bpy.ops.icymoon.show_curve()
    assert called[tmp_path / "e"] == "Error against Sun Elevation"  # what the Image Editor shows, not the file's name
    assert shown == [[tmp_path / "a", tmp_path / "e"], [tmp_path / "e", tmp_path / "a"]]


def test_drawing_takes_no_time_once_it_is_known(tiny):
    for name in (ELEVATION, "surface.albedo", "terrain.rms_slope_deg"):
        bpy.ops.icymoon.vary(setting=name)
    render_variations.list_lines(tiny)
    start = time.thread_time()
    for _ in range(100):
        render_variations.list_lines(tiny)
    assert time.thread_time() - start < 0.1

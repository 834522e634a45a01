"""Find Setting: words that users type, the fields that they get, and why one is grey."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from evaluations import evaluated
from icymoon.operators.session import session
from icymoon.panels import CLASSES, find_setting, sidebar_buttons
from icymoon.settings.blender import scene_properties
from icymoon.settings.find_settings import SYNONYMS, find_near_settings, find_settings
from icymoon.settings.table import TOPICS, list_all_settings
from panel_drawing import Layout, drawn, texts
from stand_ins import stand_in


def draw(typed: str) -> list:
    bpy.context.window_manager.icymoon_sought = typed
    layout = Layout()
    if find_setting.draw_search(layout, bpy.context):
        find_setting.draw_found(layout, bpy.context)
    return layout.record


@pytest.fixture(autouse=True)
def forget():
    yield
    bpy.context.window_manager.icymoon_sought = ""


@pytest.mark.parametrize(
    ("typed", "first"),
    [
        ("albedo", ("surface", "albedo")),
        ("rig.baseline_m", ("rig", "baseline_m")),
        ("baseline", ("rig", "baseline_m")),
        ("BASE", ("rig", "baseline_m")),
        ("seed", ("dataset", "seed")),
        ("up axis", ("source", "up_axis")),
        ("boulders coverage", ("rocks", "coverage")),
    ],
)
def test_typed_words_find_the_setting_first(typed, first):
    assert find_settings(typed)[0] == first


@pytest.mark.parametrize("typed", ["", "   ", "_", "zzz", "albedo zzz", "\0", "(", "ß" * 300])
def test_other_words_find_nothing(typed):
    assert find_settings(typed) == ()


def test_a_setting_is_found_first_by_its_name():
    for topic, setting in list_all_settings()[::17]:
        assert find_settings(f"{topic}.{setting.key}")[0] == (topic, setting.key)


@pytest.mark.parametrize("word", SYNONYMS)
def test_synonyms_find_what_they_stand_for(word):
    assert {*find_settings(SYNONYMS[word])} <= {*find_settings(word)} != set()


def test_a_longer_text_finds_no_more():
    for typed in ("albedo", "sun", "depth truth"):
        assert {*find_settings(typed)} <= {*find_settings(typed[:-2])}


def test_the_best_are_drawn_and_the_rest_is_counted(scene):
    record = draw("the")
    found, buttons = find_settings("the"), sidebar_buttons.find_buttons("the")
    assert len(found) > find_setting.MAX_FOUND
    assert len(buttons) > find_setting.MAX_BUTTONS
    shown = sum(entry[0] == "separator" for entry in record)
    assert shown == find_setting.MAX_FOUND + find_setting.MAX_BUTTONS
    assert f"{len(found) - find_setting.MAX_FOUND + len(buttons) - find_setting.MAX_BUTTONS} more" in texts(record)


def test_fields_are_the_live_properties_with_their_panel(scene):
    record = draw("baseline")
    assert "Stereo Camera   rig.baseline_m" in texts(record)
    assert any(entry[0] == "prop" and str(entry[1]).endswith("rig.baseline_m") for entry in record)
    assert "Nothing has these words" in texts(draw("zzz"))
    assert len(draw("")) == 2  # the row and the field


#: Words that new users typed or would type, with a button that they sought and the panel where it is.
SOUGHT = {
    "export": ("icymoon.export_pairs", "Icy Moon"),
    "render": ("icymoon.render_pair", "Icy Moon"),
    "trench": ("icymoon.place_on_ground", "Excavation"),
    "click": ("icymoon.place_on_ground", "Stereo Camera"),
    "lidar": ("icymoon.scan_lidar", "LiDAR"),
    "measure": ("icymoon.evaluate", "Icy Moon"),
    "dig": ("icymoon.decide", "Evaluation"),
    "sweep": ("icymoon.vary", "Vary This Scene"),
    "import": ("icymoon.import_ground", "Ground from a File"),
    "kitti": ("icymoon.export_pairs", "Icy Moon"),
    "save": ("icymoon.save_settings", "Render ▸ Icy Moon ▸ Load and Save"),
    "paint": ("icymoon.paint_errors", "Stereo Error"),
    "render variations": ("icymoon.render_variations", "Vary This Scene"),
    "calibration": ("icymoon.read_calibration", "Stereo Camera"),
    "report": ("icymoon.open_report", "Stereo Error"),
    "own rock": ("icymoon.object_as_rock", "Rocks"),
    "own mesh": ("icymoon.object_as_ground", "Ground from a File"),
}


@pytest.mark.parametrize("typed", SOUGHT)
def test_typed_words_find_the_button_and_its_place(scene, typed):
    operator, place = SOUGHT[typed]
    record = draw(typed)
    drawn_at = [k for k, entry in enumerate(record) if entry[:2] == ("operator", operator)]
    assert drawn_at, texts(record)
    labels = [[entry[2]["text"] for entry in record[:k] if entry[0] == "label"][-1] for k in drawn_at]
    assert place in labels


def test_the_command_of_that_name_is_above_its_special_cases():
    assert sidebar_buttons.find_buttons("decide")[0].button.text == "Decide Where to Dig"
    assert sidebar_buttons.find_buttons("evaluate")[0].button.operator == "icymoon.evaluate"


def test_buttons_on_which_the_word_is_are_above_the_settings(scene):
    kinds = [entry[0] for entry in draw("trench") if entry[0] in ("operator", "prop")][1:]
    assert kinds.index("operator") < kinds.index("prop")
    # In their tooltip it is a word among many.
    kinds = [entry[0] for entry in draw("albedo") if entry[0] in ("operator", "prop")][1:]
    assert kinds.index("prop") < kinds.index("operator")


def test_a_found_button_is_grey_while_a_job_runs(scene, monkeypatch):
    monkeypatch.setattr(session, "job", SimpleNamespace())
    assert ("operator", "icymoon.wait", "Render Stereo Pair") in draw("render stereo")


def test_each_found_button_is_drawn_and_has_the_properties_that_it_sets(scene):
    for button in sidebar_buttons.BUTTONS:
        layout = Layout()  # refuses operators and properties that there are not
        sidebar_buttons.draw_button(layout, button)
        assert ("operator", button.operator, button.text) in layout.record
        assert sidebar_buttons.find_buttons(button.text)[0].button.text == button.text


#: Buttons of an entry of a list, of one preset, picture or matcher, and those that a job draws.
NOT_SOUGHT = {
    *(f"icymoon.{each}_{verb}" for each in ("lamp", "layer", "variation") for verb in ("add", "remove", "move")),
    "icymoon.toggle_matcher",
    "icymoon.load_preset",
    "icymoon.use_painted_mask",
    "icymoon.clear_mask",
    "icymoon.show_pair",
}


#: Buttons beside variations or ground from a file, which this scene has not, and of a menu.
ELSEWHERE = {
    ("icymoon.evaluate", "Vary This Scene"),
    ("icymoon.place_on_ground", "Ground from a File"),
    ("icymoon.load_preset", "Render ▸ Icy Moon ▸ Load and Save"),
}


def test_each_button_of_a_panel_is_found_with_the_name_of_the_panel(small, tmp_path):
    bpy.ops.icymoon.build_scene()
    evaluated(small, tmp_path)
    panels: list[Any] = [cls for cls in CLASSES if issubclass(cls, bpy.types.Panel)]
    drawn_in: dict[str, set[str]] = {}
    for cls in panels:
        for entry in drawn(cls):
            if entry[0] == "operator":
                drawn_in.setdefault(entry[1], set()).add(cls.bl_label)
    assert len(drawn_in) > 40
    assert {*drawn_in} - {button.operator for button in sidebar_buttons.BUTTONS} - NOT_SOUGHT == set()
    elsewhere = {
        (button.operator, button.place)
        for button in sidebar_buttons.BUTTONS
        if button.operator in drawn_in and button.place.rpartition(" ▸ ")[2] not in drawn_in[button.operator]
    }
    assert elsewhere == ELSEWHERE


def test_the_search_has_all_settings_and_shows_the_field_of_one(scene):
    find = find_setting.ICYMOON_OT_find_setting
    names = [item.identifier for item in bpy.ops.icymoon.find_setting.get_rna_type().properties["setting"].enum_items]
    assert names == [f"{topic}.{setting.key}" for topic, setting in list_all_settings()]
    assert len({text for _, text, _ in find_setting._ITEMS}) == len(names)
    assert bpy.ops.icymoon.find_setting(setting="rig.baseline_m") == {"FINISHED"}
    layout = Layout()
    find.draw(stand_in(layout=layout, setting="rig.baseline_m"), bpy.context)
    assert "Stereo Camera   rig.baseline_m" in texts(layout.record)
    assert [entry[1] for entry in layout.record if entry[0] == "prop"] == ["icymoon.rig.baseline_m"]


@pytest.mark.parametrize("given", [True, False])
def test_without_a_setting_it_is_searched_and_with_one_its_field_pops_up(given):
    popped = []
    manager = SimpleNamespace(
        invoke_search_popup=lambda operator: popped.append("search"),
        invoke_popup=lambda operator, width: popped.append("field") or {"RUNNING_MODAL"},
    )
    asked = stand_in(
        bl_property="setting", properties=SimpleNamespace(is_property_set=lambda name: given and name == "setting")
    )
    find_setting.ICYMOON_OT_find_setting.invoke(asked, SimpleNamespace(window_manager=manager), None)
    assert popped == ["field" if given else "search"]


def test_a_reason_names_what_decides(scene):
    explain = lambda topic, key: find_setting.explain_obstacle(  # noqa: E731
        topic, key, scene_properties.read_settings(scene.icymoon)
    )
    assert explain("rig", "baseline_m") == ""
    assert explain("source", "scale") == "Unused while Ground from a File ▸ Source is Procedural"
    scene.icymoon.source.kind = "MESH"
    assert explain("source", "scale") == ""


def test_settings_that_act_are_above_those_that_do_not(scene):
    """'roughness' showed eight grey fields above the roughness of the ground."""
    settings = scene_properties.read_settings(scene.icymoon)
    found = find_setting.sort_by_effect("roughness", settings)
    assert {*found} == {*find_settings("roughness")}
    assert ("terrain", "rms_slope_deg") in found[:3]
    near = find_near_settings("roughness")
    far = [name not in near for name in found]
    assert far == sorted(far)
    for part in (False, True):
        idle = [find_setting.explain_obstacle(*name, settings) != "" for name in found if (name in near) != part]
        assert idle == sorted(idle)
        assert {*idle} == {False, True}
    frost = find_setting.sort_by_effect("frost", settings)
    assert frost.index(("surface", "frost_from")) < frost.index(("sensor", "deposit_share")), "it only mentions frost"
    drawn_fields = [str(entry[1]) for entry in draw("roughness") if entry[0] == "prop"][1:]
    assert drawn_fields == [f"icymoon.{topic}.{key}" for topic, key in found[: len(drawn_fields)]]


def test_the_ice_of_rocks_is_idle_without_a_surface_of_their_own(scene):
    """A frost of rocks without their own surface changed nothing, and no text said so."""
    explain = lambda: find_setting.explain_obstacle(  # noqa: E731
        "rock_surface", "frost_share", scene_properties.read_settings(scene.icymoon)
    )
    assert explain() == "Unused while Rocks ▸ Own Surface is off"
    scene.icymoon.rocks.own_surface = True
    assert explain() == ""


def test_a_name_that_does_not_fit_is_left_out(scene, monkeypatch):
    monkeypatch.setattr(find_setting, "measure_line_length", lambda: 22)
    labels = {entry[2]["text"] for entry in draw("albedo") if entry[0] == "label"}
    assert {"Rock Ice", "Ice   surface.albedo"} <= labels


def test_each_grey_field_has_a_reason(scene):
    settings = scene_properties.read_settings(scene.icymoon)
    for topic, setting in list_all_settings():
        used = TOPICS[topic].is_shown(setting.key, settings) and TOPICS[topic].has_effect(setting.key, settings)
        reason = find_setting.explain_obstacle(topic, setting.key, settings)
        assert (reason == "") == used, f"{topic}.{setting.key}"
        named = reason != f"Unused by {TOPICS[topic].label}"
        assert named or setting.key in {"emitted_from", "emitted_below", "trough_width_m"}, f"{topic}.{setting.key}"


def test_drawing_is_fast_after_the_first_time(scene):
    draw("the")
    begin = time.process_time()
    for _ in range(20):
        draw("the")
    assert (time.process_time() - begin) / 20 < 0.02  # a frame at 50 Hz


def test_how_a_job_goes_stays_above_what_is_found(scene):
    """What is found may fill the sidebar."""
    for typed in ("", "albedo"):
        bpy.context.window_manager.icymoon_sought = typed
        record = drawn(bpy.types.ICYMOON_PT_main)
        places = [k for k, entry in enumerate(record) if entry[0] == "label" and "No job is running" in str(entry)]
        assert len(places) == 1
        found = [k for k, entry in enumerate(record) if entry[0] == "prop" and entry[1].endswith("surface.albedo")]
        assert bool(found) == bool(typed)
        assert all(places[0] < k for k in found)

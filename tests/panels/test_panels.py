"""Every panel and menu, drawn on a layout that writes down what is put on it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from evaluations import ROW, evaluated
from icymoon.commands.doctor import PLUGINS, Finding
from icymoon.operators import evaluate, evaluator_python, jobs, preferences, results, sidebar_text
from icymoon.operators.presets import list_preset_items
from icymoon.operators.session import session
from icymoon.operators.sidebar_text import LINE
from icymoon.panels import CLASSES, error_table, fields, menu, sidebar
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import find_preset, load, preset_names
from icymoon.settings.table import TOPICS, list_all_settings
from icymoon.settings.topics.declaration import ELSEWHERE
from icymoon.stereo.matchers import list_matcher_titles
from icymoon.stereo.report.table_columns import RANKING_METRIC
from panel_drawing import Layout, drawn, texts
from stand_ins import stand_in


def everything() -> list:
    """What all panels and menus draw now."""
    record = [entry for cls in CLASSES if issubclass(cls, bpy.types.Panel | bpy.types.Menu) for entry in drawn(cls)]
    top = SimpleNamespace(layout=Layout(record))
    menu._draw_menu(top, bpy.context)
    menu._draw_meshes(top, bpy.context)
    return record


def operators(record: list) -> set[str]:
    return {entry[1] for entry in record if entry[0] == "operator"} | {
        entry[1][0] for entry in record if entry[0] == "operator_menu_enum"
    }


def preferences_drawn() -> tuple[list, list[str]]:
    """What the preferences draw with one matcher of the person's own, and the properties among it."""
    written: list[str] = []

    class Preferences(Layout):
        def prop(self, data: object, key: str, **options: object) -> None:
            written.append(key)

        def __getattr__(self, name: str) -> Callable[..., Layout]:
            call = super().__getattr__(name)
            return lambda *arguments, **options: (call(*arguments, **options), Preferences(self.record))[1]

    layout = Preferences()
    preferences.ICYMOON_AP_preferences.draw(stand_in(layout=layout, matchers=[object()]), bpy.context)
    return layout.record, written


@pytest.fixture
def measured(scene, tmp_path):
    """The results of an evaluation, one metric of which is over no pixels."""
    evaluated(scene, tmp_path, ROW, {**ROW, "method": "sgbm"})


@pytest.fixture
def running(monkeypatch):
    """A job that is a third done after 30 s, whatever the clock shows."""
    monkeypatch.setattr(jobs, "time", SimpleNamespace(monotonic=lambda: 130.0))
    process = stand_in(running=True, cancelled=False, stop=lambda: None, cancel=lambda: None)
    job = jobs.Job("Render Stereo Pair", process, lambda message: None, lambda: None)
    job.fraction, job.text, job.started = 1 / 3, "Pair 1 of 3", 100.0
    session.job = job
    yield job
    session.job = None


def test_an_empty_file_offers_presets_and_the_three_steps(scene):
    record = drawn(sidebar.ICYMOON_PT_main)
    assert ("menu", "ICYMOON_MT_presets") in [entry[:2] for entry in record]
    assert "Choose a Preset" in texts(record)
    assert {"icymoon.build_scene", "icymoon.render_pair", "icymoon.evaluate"} <= operators(record)
    assert "icymoon.cancel" not in operators(record)
    assert drawn(sidebar.ICYMOON_PT_results) == []


def test_every_operator_is_on_a_button_or_in_a_menu(small, measured, running, monkeypatch):
    monkeypatch.setattr(preferences, "has_own_evaluator", lambda: True)  # which can be removed
    monkeypatch.setattr(preferences, "find_own_evaluator_python", lambda: Path("/extension/evaluator/bin/python"))
    bpy.ops.icymoon.build_scene()
    there = {f"icymoon.{name}" for name in dir(bpy.ops.icymoon)}
    assert there - operators([*everything(), *preferences_drawn()[0]]) == {"icymoon.dig_trench"}  # a click starts it


#: Choices that between them leave every setting a meaning.
CHOICES = (
    {},
    {"source.kind": "MESH", "source.detail": True},
    {"source.kind": "HEIGHT_MAP", "dataset.maps": True},
    {"source.kind": "HEIGHT_MAP", "source.site": "DEGREES", "light.directions_from": "DATE"},
    {"source.kind": "HEIGHT_MAP", "source.site": "MAP", "source.surroundings_m": 500.0},
    {"mesh.kind": "GRID"},
    {"surface.model": "LUNAR_LAMBERT", "rock_surface.model": "LUNAR_LAMBERT"},
    {"surface.model": "HAPKE"},
    {"surface.ice_colour": "SNOW", "rock_surface.ice_colour": "SNOW"},
    {"rocks.law": "TABLE"},
    {"rocks.family": "OWN"},
    {"sensor.colour": "BAYER"},
    {"textures.set": "OWN"},
    {"textures.set": "STAND_IN", "source.kind": "STAND_IN"},
    {"light.directions_from": "KERNELS"},
    {"dataset.plan": "//plan.toml"},
    {"quality.indirect": "BAKED"},
    {"lander.kind": "PARAMETRIC"},
    {"lander.kind": "OWN"},
    {"excavation.path": "ARC"},
    {"excavation.path": "RECORDED"},
    {"sensor.auto_exposure": False},
    {"rig.eyes": "CALIBRATED"},
    {"rig.height_from": "ZERO"},
    {"rig.eyes": "CALIBRATED", "left_eye.lens": "CAHVORE", "right_eye.lens": "CAHVORE"},
)


#: Fields that a panel shows at most.
MAX_FIELDS = 10


def set_choices(root: object, chosen: dict) -> None:
    for name, value in chosen.items():
        topic, key = name.split(".")
        setattr(getattr(root, topic), key, value)


def paths_drawn() -> list[str]:
    return [entry[1] for entry in everything() if entry[0] == "prop"]


def list_shown() -> list[Any]:
    """The panels whose conditions are met, by themselves."""
    return [
        cls
        for cls in CLASSES
        if issubclass(cls, bpy.types.Panel) and getattr(cls, "poll", lambda context: True)(bpy.context)
    ]


@pytest.mark.parametrize("chosen", [*CHOICES, {"source.kind": "MESH", "source.detail": False}], ids=str)
def test_a_panel_that_is_shown_lies_in_panels_that_are(scene, chosen):
    """Blender does not draw a panel whose parent is hidden."""
    set_choices(scene.icymoon, chosen)
    shown = {cls.bl_idname: getattr(cls, "bl_parent_id", "") for cls in list_shown()}
    assert {name: parent for name, parent in shown.items() if parent and parent not in shown} == {}


@pytest.mark.parametrize("chosen", CHOICES, ids=str)
def test_no_panel_that_is_shown_is_empty(scene, chosen):
    set_choices(scene.icymoon, chosen)
    shown = {cls: drawn(cls) for cls in list_shown()}
    assert len(shown) > 20
    assert [cls.bl_idname for cls, record in shown.items() if not record] == []
    counts = {cls.bl_idname: sum(entry[0] == "prop" for entry in record) for cls, record in shown.items()}
    switches = {cls.bl_idname: "draw_header" in vars(cls) for cls in shown}
    assert {name for name, count in counts.items() if count > MAX_FIELDS + switches[name]} == set()


def test_no_panel_has_more_than_ten_fields_with_any_preset():
    """Besides a tick in its header. What would be more lies in panels within it."""
    for name in preset_names():
        settings = merged(defaults(), load(find_preset(name)))
        counts = {
            (topic.key, section and section.key): sum(topic.is_shown(key, settings) for key in keys)
            for topic in TOPICS.values()
            for section in (None, *topic.sections)
            for keys in [topic.main_keys if section is None else topic.keys_in(section)]
        }
        assert {part: count for part, count in counts.items() if count > MAX_FIELDS} == {}, name


def test_every_setting_is_drawn_where_it_has_a_meaning(scene):
    paths = []
    for chosen in CHOICES:
        for topic, setting in list_all_settings():
            if setting.kind == "choice":
                getattr(scene.icymoon, topic).property_unset(setting.key)
        set_choices(scene.icymoon, chosen)
        paths += paths_drawn()
    assert {f"icymoon.{topic}.{s.key}" for topic, s in list_all_settings()} - set(paths) == set()


@pytest.mark.parametrize(
    ("chosen", "hidden", "there"),
    [
        (
            {},
            {"source.file", "light.date_utc", "textures.albedo_file", "hapke.w", "terrain.resolution"},
            {"mesh.error_px"},
        ),
        ({"source.kind": "MESH"}, {"mesh.kind", "terrain.hurst", "source.metres_per_pixel"}, {"source.scale"}),
        ({"surface.model": "HAPKE"}, {"surface.albedo", "surface.roughness"}, {"hapke.w", "surface.grain_size_m"}),
        ({"light.directions_from": "DATE"}, {"light.sun_elevation_deg", "light.kernels"}, {"light.latitude_deg"}),
        ({"dataset.plan": "datasets/guiss_smoke"}, {"dataset.plan"}, {"dataset.workers"}),
    ],
)
def test_what_a_choice_rules_out_is_not_shown(scene, chosen, hidden, there):
    set_choices(scene.icymoon, chosen)
    paths = set(paths_drawn())
    assert {f"icymoon.{name}" for name in hidden} & paths == set()
    assert {f"icymoon.{name}" for name in there} <= paths


def test_each_moon_has_a_button_and_that_of_the_scene_is_pressed(scene, monkeypatch):
    def pressed() -> dict[str, bool]:
        found = {}

        def operator(self: Layout, name: str, *, text: str, depress: bool = False) -> object:
            found[text] = depress
            return SimpleNamespace()

        monkeypatch.setattr(Layout, "operator", operator)
        drawn(bpy.types.ICYMOON_PT_light)
        return found

    assert pressed() == {"Enceladus": True, "Europa": False}
    bpy.ops.icymoon.load_preset(preset="bodies/europa")
    assert pressed() == {"Enceladus": False, "Europa": True}
    assert scene.icymoon.terrain.body_radius_m == pytest.approx(1.5608e6)


def test_a_panel_begins_with_what_turns_the_others_on():
    assert TOPICS["rocks"].main_keys[0] == "coverage"
    assert TOPICS["light"].main_keys[:3] == ("directions_from", "sun_elevation_deg", "sun_azimuth_deg")


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("light.kernels is empty; choose a path.", "Light ▸ Kernels is empty; choose a path."),
        ("truth: none, since quality.truth is DEPTH.", "Truth: none, since Quality and Speed ▸ Truth is Depth Only."),
        (
            "Set quality.denoiser NONE or textures.set = MESH.",
            "Set Quality and Speed ▸ Denoiser None or Textures ▸ Texture = From Mesh.",
        ),
        ("Lower quality.samples FIRST.", "Lower Quality and Speed ▸ Samples FIRST."),
        ("rock_surface: under quality.walk_px.", "Rock Ice: under Quality and Speed ▸ Subsurface Cutoff."),
        ("the file a.toml is not there.", "The file a.toml is not there."),
        ("Settings that rig.no_such is of stay.", "Settings that rig.no_such is of stay."),
    ],
)
def test_the_sidebar_names_settings_as_it_shows_them(sentence, said):
    assert sidebar_text.replace_keys_by_labels(sentence) == said


def test_what_is_left_out_is_said_where_it_is_chosen_and_only_then(scene):
    group = scene.icymoon
    assert drawn(sidebar.ICYMOON_PT_left_out) == []
    group.quality.truth, group.light.planet, group.light.planet_elevation_deg = "DEPTH", True, -40.0
    said = " ".join(entry[2]["text"] for entry in drawn(sidebar.ICYMOON_PT_left_out) if entry[0] == "label")
    assert "Light: no light from the planet, because the planet is below the horizon or unlit." in said
    assert "Truth: no normals and no labels, because Quality and Speed ▸ Truth is Depth Only." in said
    assert sidebar.ICYMOON_PT_left_out.bl_parent_id == "ICYMOON_PT_quality"
    group.light.directions_from = "KERNELS"  # of which none are given, so there is no sky to speak of
    said = texts(drawn(sidebar.ICYMOON_PT_left_out))
    assert "Truth" in said
    assert "planet" not in said


def test_the_matchers_of_plug_ins_have_a_tick_once_check_has_found_them(scene):
    group = scene.icymoon.dataset
    assert "census" not in texts(drawn(sidebar.ICYMOON_PT_evaluation))
    with pytest.raises(RuntimeError, match="There is no matcher census"):
        bpy.ops.icymoon.toggle_matcher(matcher="census")
    preferences.show_findings([Finding("Evaluator", "ok", "Python"), Finding(PLUGINS, "ok", "", names=("census",))])
    try:
        assert "census" in {
            entry[2]
            for entry in drawn(sidebar.ICYMOON_PT_evaluation)
            if entry[:2] == ("operator", "icymoon.toggle_matcher")
        }
        assert bpy.ops.icymoon.toggle_matcher(matcher="census") == {"FINISHED"}
        assert group.methods == "bm,sgbm,census"
    finally:
        preferences.show_findings([Finding("Evaluator", "ok", "Python")])
    assert preferences.list_plugin_matchers() == []


def test_the_matchers_there_are_stand_in_the_tooltip():
    told = TOPICS["dataset"]["methods"].description
    assert ", ".join(list_matcher_titles()) in told
    assert "own:NAME" in told  # by which a scene names one that is set up


def test_the_panels_follow_the_work_from_top_to_bottom():
    tops: list[Any] = [cls for cls in CLASSES if issubclass(cls, bpy.types.Panel) and not hasattr(cls, "bl_parent_id")]
    assert [cls.bl_label for cls in sorted(tops, key=lambda cls: getattr(cls, "bl_order", 0))] == [
        "Icy Moon",
        "Ground",
        "Ice",
        "Rocks",
        "Light",
        "Stereo Camera",
        "Lander",
        "Exposure and Sensor",
        "Active Sensors",
        "Quality and Speed",
        "Data Set",
        "Evaluation",
    ]


def test_a_panel_opens_with_few_settings():
    """Six at most, and what few scenes change comes last, under Advanced."""
    long = {
        key: main
        for key, topic in TOPICS.items()
        if not topic.parent and not topic.inside and len(main := topic.main_keys) > 6 and key != "light"
    }
    assert long == {}
    # Of these of Light, one, two or five are shown at once.
    dated = {"body", "date_utc", "latitude_deg", "longitude_deg", "kernels"}
    assert len(set(TOPICS["light"].main_keys) - dated) <= 4
    for topic in TOPICS:
        within: list[Any] = [cls for cls in CLASSES if getattr(cls, "bl_parent_id", "") == f"ICYMOON_PT_{topic}"]
        if not within:
            continue
        last = max(within, key=lambda cls: getattr(cls, "bl_order", 0)).bl_label
        assert last.startswith("Advanced") or not any(cls.bl_label.startswith("Advanced") for cls in within)
        assert "Advanced" not in [cls.bl_label for cls in within]  # but of what


def test_a_quality_is_a_button_and_a_message_has_the_labels_of_settings(scene, monkeypatch):
    buttons = {entry[1:] for entry in drawn(bpy.types.ICYMOON_PT_quality) if entry[0] == "operator"}
    assert {("icymoon.load_preset", title) for title in ("Draft", "Paper", "Standard", "Reference")} <= buttons
    sentence = "This Blender was built without OpenImageDenoise; set quality.denoiser to NONE."
    assert sidebar_text.format_for_window(sentence) == sentence
    monkeypatch.setattr(bpy, "app", SimpleNamespace(background=False))
    assert "Quality and Speed ▸ Denoiser to None." in sidebar_text.format_for_window(sentence)
    assert (
        sidebar_text.format_for_window("set quality.truth to DEPTH.") == "Set Quality and Speed ▸ Truth to Depth Only."
    )
    assert sidebar_text.format_for_window("change rig.width_px to Fit.").endswith(" to Fit.")  # no choice


def test_a_setting_has_one_place():
    for topic in TOPICS.values():
        parts = [
            topic.main_keys,
            topic.keys_in(ELSEWHERE),
            *((*topic.keys_in(s), *([s.switch] if s.switch else [])) for s in topic.sections),
        ]
        assert sorted(key for part in parts for key in part) == sorted(s.key for s in topic.settings)


def test_only_the_first_panel_is_open_when_the_tab_is(scene):
    tops: list[Any] = [cls for cls in CLASSES if issubclass(cls, bpy.types.Panel) and not hasattr(cls, "bl_parent_id")]
    assert [cls.bl_label for cls in tops if "DEFAULT_CLOSED" not in getattr(cls, "bl_options", ())] == ["Icy Moon"]


def test_no_name_is_cut_in_the_sidebar_as_blender_opens_it():
    every = [s for _, setting in list_all_settings() for s in (setting, *setting.entries)]
    # Half a line for a choice's name and half for what is chosen, as screenshots show them; ten for a number's value.
    assert [s.key for s in every if s.choices and max(map(len, (s.label, *(c[1] for c in s.choices)))) > LINE / 2] == []
    assert [s.key for s in every if len(s.label) > LINE - 10] == []
    # What is under a picture of a scene, in a popup of eight a row that fits a screen 1280 pixels wide.
    assert [
        title for name, title, _ in list_preset_items() if name.startswith("scenes/") and len(title) > LINE - 11
    ] == []


def test_every_setting_of_an_entry_in_a_list_is_drawn(scene):
    for topic, setting in list_all_settings():
        if setting.kind == "list":
            getattr(getattr(scene.icymoon, topic), setting.key).add()
            paths = [entry[1] for entry in everything() if entry[0] == "prop"]
            assert {f"icymoon.{topic}.{setting.key}[0].{s.key}" for s in setting.entries} - set(paths) == set()


@pytest.mark.long
def test_a_built_scene_draws_its_preset(small):
    bpy.ops.icymoon.load_preset(preset="scenes/europa_rough_ice")
    small.icymoon.terrain.resolution = 65
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert "Europa rough ice" in texts(everything())


def test_every_preset_is_in_the_menu(scene):
    from icymoon.settings.preset_files import preset_names, read_preset_header

    menus = [entry[1] for entry in drawn(menu.ICYMOON_MT_presets) if entry[0] == "menu"]
    assert len(menus) <= 12  # each fits a small screen
    shown = [entry[1:] for name in menus for entry in drawn(getattr(bpy.types, name))]
    assert max(len(drawn(getattr(bpy.types, name))) for name in menus) <= 26
    assert sorted(shown) == sorted(("icymoon.load_preset", read_preset_header(name)[0]) for name in preset_names())


def test_a_running_job_shows_how_far_it_is_and_can_be_cancelled(scene, running):
    record = everything()
    assert "icymoon.cancel" in operators(drawn(sidebar.ICYMOON_PT_main))
    assert "Pair 1 of 3  33 %" in texts(record)
    assert "1:00 left" in texts(record)
    status = SimpleNamespace(layout=Layout())
    menu._draw_status(status, bpy.context)
    assert "Render Stereo Pair  33 %  1:00 left" in texts(status.layout.record)
    assert operators(status.layout.record) == {"icymoon.cancel"}
    assert "icymoon.cancel" in operators(preferences_drawn()[0])  # from where the evaluator is installed
    running.process.cancelled = True
    assert "Stopping  33 %" in texts(drawn(sidebar.ICYMOON_PT_main))
    running.fraction = 0.0
    assert "left" not in texts(drawn(sidebar.ICYMOON_PT_main))
    assert "0 %" not in texts(drawn(sidebar.ICYMOON_PT_main))  # unknown until the job reports its progress


@pytest.mark.parametrize(
    ("fraction", "past_s", "said"),
    [
        (0.0, 0.0, "About 4 min left, by estimate"),
        (0.01, 60.0, "About 3 min left, by estimate"),
        (0.04, 200.0, "About 40 s left, by estimate"),
        (0.04, 241.0, "Estimate 4 min; may take 12 min"),
        (0.02, 721.0, "Longer than the estimate of 4 min"),
        (0.5, 60.0, "1:00 left"),  # measured
    ],
)
def test_an_estimate_is_told_until_the_progress_shows_the_time(scene, running, fraction, past_s, said):
    """For minutes the panel said only that the first pair was starting."""
    running.expected, running.started, running.fraction = jobs.Expectation(240.0, 3.0), 130.0 - past_s, fraction
    assert running.shown[1] == said
    assert len(said) <= LINE
    assert running.brief.endswith(said)
    running.process.cancelled = True
    assert "estimate" not in running.shown[1].lower()


def test_what_a_stopped_job_left_is_told_where_its_progress_was(scene, running, monkeypatch):
    running.process.cancelled, running.process.left = True, False
    running.if_stopped = "finished pairs are kept"
    session.job = None
    session.note_end(running)
    record = drawn(sidebar.ICYMOON_PT_main)
    labels = [entry[2].get("text") for entry in record if entry[0] == "label"]
    place = labels.index("Render Stereo Pair: stopped")
    assert labels[place + 1] == "Finished pairs are kept"
    running.process.left = True  # it goes on in the background
    session.note_end(running)
    assert "Finished pairs" not in texts(drawn(sidebar.ICYMOON_PT_main))
    session.ended = session.remains = ""


def test_a_job_takes_the_same_room_before_during_and_after(scene, running):
    def count_lines() -> int:
        layout = Layout()
        sidebar.draw_job(layout, scene)
        return sum(entry[0] in ("label", "progress") for entry in layout.record)

    during = count_lines()
    session.job = None
    for session.ended, session.remains in (
        ("", ""),
        ("Render Stereo Pair: done", ""),
        ("Render Stereo Pair: stopped", "Finished pairs are kept"),
    ):
        assert count_lines() == during
    session.ended = session.remains = ""


def test_a_build_is_shown_while_it_runs_in_the_same_room(scene, monkeypatch):
    """On a busy machine it takes some time, in which the sidebar named Build Scene as the next step."""
    monkeypatch.setattr(session, "building", SimpleNamespace(so_far=", 12 s so far"))
    layout = Layout()
    sidebar.draw_job(layout, scene)
    labels = [entry[2]["text"] for entry in layout.record if entry[0] == "label"]
    assert labels == ["Building the scene, 12 s so far", "Esc stops it"]


def test_text_has_room_for_a_longer_one(scene):
    longest = "Coarse ground; the fine one follows"
    for text in ("Fine", longest):
        layout = Layout()
        fields.draw_lines(layout, (text,), "INFO", room_for=longest)
        labels = [entry for entry in layout.record if entry[0] == "label"]
        assert len(labels) == len(sidebar_text.wrap_lines(longest, icon=True))


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (None, ""),
        (0.4, "Almost done"),
        (1.0, "0:01 left"),
        (65.0, "1:05 left"),
        (3599.9, "59:59 left"),
        (7400.0, "2:03:20 left"),
    ],
)
def test_the_time_that_is_left_is_told_in_hours_minutes_and_seconds(seconds, said):
    assert jobs.format_remaining(seconds) == said


@pytest.mark.parametrize(
    ("fraction", "past_s", "left_s"),
    [
        (0.02, 3600.0, None),
        (0.05, 60.0, None),
        (0.05, 599.0, None),
        (0.05, 600.0, 11400.0),
        (0.1, 60.0, 540.0),
        (0.5, 60.0, 60.0),
    ],
)
def test_no_time_is_left_while_the_start_of_the_process_decides_it(monkeypatch, fraction, past_s, left_s):
    process: Any = SimpleNamespace()
    job = jobs.Job("Render", process, lambda message: None, lambda: None, started=100.0, fraction=fraction)
    monkeypatch.setattr(jobs.time, "monotonic", lambda: 100.0 + past_s)
    assert job.remaining_s == (None if left_s is None else pytest.approx(left_s))


def test_nothing_runs_and_the_status_bar_is_left_alone(scene):
    status = SimpleNamespace(layout=Layout())
    menu._draw_status(status, bpy.context)
    assert status.layout.record == []


def test_results_are_shown_with_their_units_and_a_dash_for_none(scene, measured):
    record = drawn(sidebar.ICYMOON_PT_results)
    labels = [entry[2]["text"] for entry in record if entry[0] == "label"]
    assert {"StereoBM", "SGBM"} <= set(labels)
    values = {
        name: labels[labels.index(name) + 1]
        for name in ("Wrong", "Covered", "Mean L1 error", "Over 10 cm off", "Wrong order", "Shape error")
    }
    assert values == {
        "Wrong": "35.0 %",
        "Covered": "75.0 %",
        "Mean L1 error": "0.123 m",
        "Over 10 cm off": "50.0 %",
        "Wrong order": "25.0 %",
        "Shape error": "–",
    }
    assert {"icymoon.open_report", "icymoon.show_error", "icymoon.show_surface"} <= operators(record)


def labels_of_results(scene, tmp_path, *rows):
    evaluated(scene, tmp_path, *rows, scope="DATASET")
    return [
        (entry[2]["text"], entry[2].get("icon", "NONE"))
        for entry in drawn(sidebar.ICYMOON_PT_results)
        if entry[0] == "label"
    ]


def ranked(method, wrong, *rank):
    return {**ROW, "method": method, "total_bad_1": wrong, "n": 100, "ranks": {RANKING_METRIC: rank} if rank else {}}


def test_ranks_are_those_of_the_report_and_a_star_needs_a_worse_one(scene, tmp_path):
    labels = labels_of_results(
        scene, tmp_path, ranked("bm", 0.3, 3, 3), ranked("sgbm", 0.1, 1, 2), ranked("jplv", 0.2, 1, 2)
    )
    first = [label for label in labels if label[0] in ("StereoBM", "SGBM", "JPLV") or label[0].startswith("Rank ")]
    assert first == [
        ("SGBM", "NONE"),
        ("Rank 1–2", "SOLO_ON"),
        ("JPLV", "NONE"),
        ("Rank 1–2", "SOLO_ON"),
        ("StereoBM", "NONE"),
        ("Rank 3", "NONE"),
    ]
    undecided = labels_of_results(scene, tmp_path, ranked("bm", 0.3, 1, 2), ranked("sgbm", 0.1, 1, 2))
    assert ("Rank 1–2", "NONE") in undecided
    assert "SOLO_ON" not in {icon for _, icon in undecided}


def test_few_scenes_have_no_ranks_and_one_matcher_needs_none(scene, tmp_path):
    labels = labels_of_results(scene, tmp_path, ranked("bm", 0.3), ranked("sgbm", 0.1))
    assert "A ranking needs 6 scenes." in dict(labels)
    assert not any(text.startswith("Rank") for text, _ in labels)
    assert "A ranking needs 6 scenes." not in dict(labels_of_results(scene, tmp_path, ranked("bm", 0.3)))


def test_a_matcher_that_measured_nothing_has_no_result_and_comes_last(scene, tmp_path):
    nothing = {**ranked("igev", 1.0), "n": 0, "coverage": 0.0, "l1_m": None}
    labels = [text for text, _ in labels_of_results(scene, tmp_path, nothing, {**ranked("bm", 1.0), "l1_m": None})]
    assert labels[labels.index("IGEV-Stereo") + 1] == "no result"
    assert labels.count("100.0 %") == 1
    assert labels.index("StereoBM") < labels.index("IGEV-Stereo")
    assert "0.0 %" not in labels


def test_each_metric_of_a_matcher_has_its_own_line(scene, tmp_path):
    """Any number fits, as a column for each would not."""
    names = ["bm", "sgbm", "sgbm_wls", "jplv", "own:mine"]
    evaluated(scene, tmp_path, *({**ROW, "method": name, "l1_m": None} for name in names))
    record = drawn(sidebar.ICYMOON_PT_results)
    labels = [entry[2]["text"] for entry in record if entry[0] == "label"]
    shown = ["StereoBM", "SGBM", "SGBM with WLS", "JPLV", "own:mine"]
    assert [label for label in labels if label in shown] == shown
    assert [label for label in labels if label == "Mean L1 error"] == ["Mean L1 error"] * len(names)
    assert [entry[1] for entry in record if entry[0] == "operator"].count("icymoon.show_error") == len(names)


def test_a_metric_and_its_value_fit_a_line_of_the_narrowest_sidebar(scene, tmp_path):
    labels = [
        text
        for text, _ in labels_of_results(
            scene, tmp_path, {**ROW, "l1_m": 12.3456, "dod": 1.0, "si_rmse": 0.12345, "l1_rate_10": 1.0, "n": 5}
        )
    ]
    names = ("Wrong", "Covered", "Mean L1 error", "Over 10 cm off", "Wrong order", "Shape error")
    # 24 characters fit a sidebar of 200 pixels, as below; the two parts of the line have 0.62 and 0.38 of it.
    for name in names:
        assert len(name) <= 14  # as seen: 15 letters are cut
        assert len(labels[labels.index(name) + 1]) <= 0.38 * 24


#: Icons that Blender itself shows without words beside a list, a field or a number, or in a header.
WORDLESS = {"ADD", "REMOVE", "TRIA_UP", "TRIA_DOWN", "TRIA_LEFT", "TRIA_RIGHT", "FILEBROWSER", "X"}


def test_no_button_has_an_icon_without_words(small, measured, running, monkeypatch):
    found = set()
    operator = Layout.operator

    def noted(self, name, **options):
        if options.get("text") == "":
            found.add(options.get("icon", "NONE"))
        return operator(self, name, **options)

    monkeypatch.setattr(Layout, "operator", noted)
    everything()
    assert found <= WORDLESS


#: Operators whose button shows what it chooses or what was measured, not what it does.
OF_VALUES = {
    "icymoon.paint_mask",
    "icymoon.load_preset",
    "icymoon.choose_plan",
    "icymoon.show_pair",
    "icymoon.toggle_matcher",
    "icymoon.show_curve",
    "icymoon.show_roughness",
    "icymoon.wait",
}


@pytest.mark.usefixtures("measured")
def test_a_command_has_one_name(small):
    """In the sidebar, in the menus and in the preferences: that of its operator."""
    bpy.ops.icymoon.build_scene()
    for kind, operator, *text in [*everything(), *preferences_drawn()[0]]:
        if kind != "operator" or operator in OF_VALUES or not text[0]:
            continue
        category, _, verb = operator.partition(".")
        name = getattr(getattr(bpy.ops, category), verb).get_rna_type().name
        called, label = (set(re.findall(r"\w+", words.lower())) for words in (text[0], name))
        # Some of its words, as Ground for Paint Errors on Ground, or more: Evaluate Stereo Pair.
        assert called <= label or label <= called, f"{text[0]} is {name}"


def test_matchers_are_ticked_and_keep_their_options(scene):
    group = scene.icymoon.dataset
    group.methods = "bm, sgbm:window=7"
    ticked = {
        entry[2]
        for entry in drawn(sidebar.ICYMOON_PT_evaluation)
        if entry[:2] == ("operator", "icymoon.toggle_matcher")
    }
    assert ticked == set(list_matcher_titles().values())
    assert bpy.ops.icymoon.toggle_matcher(matcher="igev") == {"FINISHED"}
    assert group.methods == "bm,sgbm:window=7,igev"
    assert "PyTorch" in texts(drawn(sidebar.ICYMOON_PT_evaluation))
    tips = {
        name: evaluate.ICYMOON_OT_toggle_matcher.description(bpy.context, SimpleNamespace(matcher=name))
        for name in ("bm", "igev")
    }
    assert ["PyTorch" in tips[name] for name in tips] == [False, True]  # before it is ticked too
    assert bpy.ops.icymoon.toggle_matcher(matcher="sgbm") == {"FINISHED"}
    assert group.methods == "bm,igev"
    with pytest.raises(RuntimeError, match="There is no matcher nonsense"):
        bpy.ops.icymoon.toggle_matcher(matcher="nonsense")


def test_the_preferences_are_drawn(scene):
    preferences.show_findings([Finding("Graphics card", "limited", "none", "Set quality.device to CPU.")])
    record, written = preferences_drawn()
    preferences.show_findings([])
    assert written == ["evaluator", "kernels", "cache", "workers", "name", "method", "program", "options"]
    assert {"icymoon.check_evaluator", "icymoon.install_evaluator"} <= operators(record)
    assert "Graphics card: none" in texts(record)
    assert "Set quality.device to CPU." in texts(record)


def test_check_says_what_doctor_says_and_what_of_the_kernels(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(evaluator_python, "find_kernels", lambda: str(tmp_path / "none.tm"))
    with pytest.raises(RuntimeError, match=r"SPICE kernels: .*none\.tm is not there or empty.*Give a meta-kernel"):
        bpy.ops.icymoon.check_evaluator()
    monkeypatch.setattr(evaluator_python, "find_kernels", lambda: "")
    assert bpy.ops.icymoon.check_evaluator() == {"FINISHED"}
    assert {"Blender", "Evaluator", "Graphics card"} <= {finding.subject for finding in preferences.findings}
    card = next(finding for finding in preferences.findings if finding.subject == "Graphics card")
    assert card.fix in ("", "Set Quality and Speed ▸ Device to CPU.")
    preferences.show_findings([])


def test_a_scene_that_asks_for_kernels_gets_the_preferred_ones(scene, monkeypatch):
    monkeypatch.setattr(preferences, "find_kernels", lambda: "/kernels/cassini.tm")
    light = scene.icymoon.light
    light.directions_from = "DATE"
    assert light.kernels == ""
    light.directions_from = "KERNELS"
    assert light.kernels == "/kernels/cassini.tm"
    light.kernels = "/mine.tm"
    light.date_utc = "2030-01-01T00:00:00"
    assert light.kernels == "/mine.tm"


def test_the_chart_of_qualities_can_be_shown_once_it_is_there(scene, tmp_path):
    scene.icymoon.dataset.folder = str(tmp_path)
    assert not bpy.ops.icymoon.show_trade.poll()
    (tmp_path / "trade").mkdir()
    (tmp_path / "trade" / "trade.png").touch()
    assert bpy.ops.icymoon.show_trade.poll()
    assert "icymoon.show_trade" in operators(drawn(bpy.types.ICYMOON_PT_trade))


@pytest.mark.parametrize("width", [LINE, 24])
def test_no_line_is_cut_in_a_narrow_sidebar(scene, monkeypatch, width):
    """Of all lines over the whole width; those of a list are cut by Blender, and the selected one is shown below."""
    monkeypatch.setattr(sidebar_text, "measure_line_length", lambda: width)
    scene.icymoon.light.directions_from = "DATE"
    scene.icymoon.light.body = "ENCELADUS"
    bpy.ops.icymoon.vary(setting="rock_surface.lommel_seeliger_share")
    long = {entry[2]["text"] for entry in everything() if entry[0] == "label" and len(entry[2].get("text", "")) > width}
    assert {text for text in long if not text.startswith("Lommel-Seeliger Share:")} == set()


@pytest.mark.parametrize("model", ["LAMBERT", "HAPKE"])
def test_the_albedos_of_the_ground_stand_in_one_panel(scene, model):
    scene.icymoon.surface.model = model
    shown = {
        panel: texts(drawn(getattr(bpy.types, panel)))
        for panel in ("ICYMOON_PT_surface", "ICYMOON_PT_hapke")
        if getattr(bpy.types, panel).poll(bpy.context)
    }
    found = [panel for panel, text in shown.items() if "Bond albedo" in text]
    assert found == [{"LAMBERT": "ICYMOON_PT_surface", "HAPKE": "ICYMOON_PT_hapke"}[model]]


@pytest.mark.parametrize("width", [LINE, 24])
def test_each_button_that_places_by_click_names_what_it_places(scene, monkeypatch, width):
    monkeypatch.setattr(sidebar_text, "measure_line_length", lambda: width)
    scene.icymoon.source.kind = "MESH"  # which has a site
    scene.icymoon.excavation.path = "LINE"
    found = [entry[2] for entry in everything() if entry[:2] == ("operator", "icymoon.place_on_ground")]
    assert sorted(text.split()[1] for text in found) == ["Camera", "Site", "Trench", "Workspace"]
    assert all(text.startswith("Place ") for text in found)
    assert max(map(len, found)) <= width - 5  # room of an icon and the margins
    assert all(text.endswith(" by Click") for text in found) == (width == LINE)


def test_a_scanner_s_rows_and_columns_of_0_are_explained_beside_them(scene):
    group = scene.icymoon.lidar
    assert (group.rows, group.columns) == (0, 0)
    record = drawn(bpy.types.ICYMOON_PT_lidar)
    places = [k for k, entry in enumerate(record) if entry[1] in ("icymoon.lidar.rows", "icymoon.lidar.columns")]
    (told,) = (k for k, entry in enumerate(record) if "0: as many as the scanner has" in str(entry))
    assert 0 < told - max(places) <= 2  # a column, then its label


def test_the_built_in_lander_has_a_plain_name_and_its_old_identifier(scene):
    labels = {value: label for value, label, _ in TOPICS["lander"]["kind"].choices}
    assert labels["PARAMETRIC"] == "Built-in Lander"
    assert "Parametric" not in texts([*labels.values(), *(s.description for _, s in list_all_settings())])
    assert merged(defaults(), {"lander": {"kind": "PARAMETRIC"}}).lander.kind == "PARAMETRIC"  # of earlier files


def first_label(scene, tmp_path, *rows):
    return labels_of_results(scene, tmp_path, *rows)[0][0]


@pytest.mark.parametrize(
    ("doubt", "said"),
    [(0.018, "Too close to call: SGBM 44.2 %, StereoBM 45.9 % wrong"), (0.016, "Fewest wrong: SGBM, 44.2 %")],
)
def test_a_difference_that_noise_may_make_is_too_close_to_call(doubt, said):
    """The panel named a winner above the warning that noise decides."""
    rows = [ranked("sgbm", 0.442), ranked("bm", 0.459)]
    assert results.describe_verdict(rows, doubt) == said


@pytest.mark.parametrize(
    ("errors_m", "shares", "said"),
    [
        (
            (0.166, 0.070),
            (0.929, 0.747),
            "StereoBM has the smallest mean error; it measures 74.7 % of the pixels, SGBM 92.9 %",
        ),
        ((0.070, 0.166), (0.929, 0.747), ""),
        ((0.1, 0.1), (0.9, 0.7), ""),
        ((None, 0.1), (0.9, 0.7), ""),
        ((None, None), (None, None), ""),
    ],
)
def test_a_matcher_that_errs_less_on_fewer_pixels_is_named(errors_m, shares, said):
    """One with a quarter of the other's error lost by wrong pixels, without a word."""
    rows = [
        {"method": method, "n": 1, "l1_m": error_m, "coverage": share}
        for method, error_m, share in zip(("sgbm", "bm"), errors_m, shares, strict=True)
    ]
    assert results.describe_nearer(rows) == said


@pytest.mark.parametrize("shown", ["SGBM", "StereoBM", "another"])
def test_the_colours_are_explained_below_the_button_that_paints_them(scene, tmp_path, monkeypatch, shown):
    """The legend was below all matchers, out of sight of the button."""
    monkeypatch.setattr(error_table.painted_errors, "make_legend", lambda scene: (("Too far, red: 1 %", "NONE"),))
    monkeypatch.setattr(error_table.painted_errors, "find_title", lambda scene: shown)
    evaluated(scene, tmp_path, ranked("sgbm", 0.1), ranked("bm", 0.3))
    record = drawn(sidebar.ICYMOON_PT_results)
    painting = [k for k, entry in enumerate(record) if entry[:2] == ("operator", "icymoon.paint_errors")]
    (legend,) = (k for k, entry in enumerate(record) if "Too far, red" in str(entry))
    (slider,) = (k for k, entry in enumerate(record) if entry[:2] == ("prop", "icymoon.error_range_m"))
    assert painting[0] < painting[1]
    assert slider < legend
    assert (legend < painting[1]) == (shown == "SGBM")
    assert legend > painting[0]


def test_the_panel_says_above_the_table_what_is_wrong(scene, tmp_path):
    labels = [label for label, _ in labels_of_results(scene, tmp_path, ranked("bm", 0.3), ranked("sgbm", 0.1))]
    assert labels.index("Wrong: off by over 1 px, or missing") < labels.index("Wrong")


def test_the_verdict_is_the_first_line_of_the_results(scene, tmp_path):
    assert first_label(scene, tmp_path, ranked("bm", 0.35)) == "StereoBM: 35.0 % wrong"
    undecided = ranked("bm", 0.3, 1, 2), ranked("sgbm", 0.1, 1, 2)
    assert first_label(scene, tmp_path, *undecided) == "Too close to call: SGBM"
    assert first_label(scene, tmp_path, ranked("bm", 0.3), ranked("sgbm", 0.1)) == "Fewest wrong: SGBM, 10.0 %"
    assert first_label(scene, tmp_path, ranked("bm", 0.1), ranked("sgbm", 0.1)).startswith("Too close to call")
    decided = ranked("bm", 0.3, 3, 3), ranked("sgbm", 0.1, 1, 2), ranked("jplv", 0.2, 1, 2)
    assert first_label(scene, tmp_path, *decided) == "Best: SGBM, 10.0 % wrong"
    nothing = {**ranked("igev", 1.0), "n": 0}
    assert first_label(scene, tmp_path, nothing) == "No matcher has a result"
    assert first_label(scene, tmp_path, nothing, ranked("bm", 0.35)) == "StereoBM: 35.0 % wrong"

"""A button that starts a job is another button while a job runs, or Blender would keep it grey under the mouse."""

from __future__ import annotations

import re
from typing import Any

import bpy
import pytest
from icymoon import operators
from icymoon.operators import jobs, sidebar_text
from icymoon.operators.job_operators import JobOperator
from icymoon.operators.session import session
from icymoon.operators.sidebar_text import LINE
from icymoon.panels import fields, pair_views
from icymoon.settings.blender import scene_properties
from icymoon.settings.preset_files import PRESET_KINDS, WHOLE_SCENE_KINDS
from icymoon.settings.table import TOPICS, list_all_settings
from panel_drawing import Layout, drawn, texts
from stand_ins import stand_in

#: Operators that start a job from the sidebar, whatever was done before, but not while another job runs.
STARTING = {cls.bl_idname for cls in operators.CLASSES if issubclass(cls, JobOperator)} - {
    "icymoon.paint_errors",
    "icymoon.watch_dataset",
    "icymoon.install_evaluator",
    "icymoon.make_asset_library",
}
#: Their buttons that have other words than the operator.
OTHER_WORDS = {
    "icymoon.export_pairs",
    "icymoon.evaluate",
    "icymoon.evaluate_folder",
    "icymoon.decide_by_rules",
    "icymoon.decide_with_guarantee",
    "icymoon.trade",
    "icymoon.auto_quality",
    "icymoon.reproduce",
}


@pytest.fixture
def running(monkeypatch):
    process = stand_in(running=True, cancelled=False, stop=lambda: None, cancel=lambda: None)
    monkeypatch.setattr(session, "job", jobs.Job("Render Data Set", process))


def buttons() -> list[tuple[str, str]]:
    """(operator, text) of each button of the sidebar."""
    panels = (getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("ICYMOON_PT_"))
    return [entry[1:] for panel in panels for entry in drawn(panel) if entry[0] == "operator"]


@pytest.mark.usefixtures("scene")
def test_the_same_texts_are_there_while_a_job_runs_but_start_nothing(request):
    free = buttons()
    assert {name for name, _ in free} >= STARTING
    request.getfixturevalue("running")
    busy = buttons()
    assert not {name for name, _ in busy} & STARTING
    assert {text for name, text in busy if name == "icymoon.wait"} == {text for name, text in free if name in STARTING}
    assert not bpy.ops.icymoon.wait.poll()


@pytest.mark.usefixtures("scene")
def test_the_texts_are_the_operators_own_where_there_is_one_button():
    there = buttons()
    for name in STARTING - OTHER_WORDS:
        label = getattr(bpy.ops.icymoon, name.partition(".")[2]).get_rna_type().name
        assert (name, label) in there


def test_a_button_gets_its_properties():
    record: list = []
    fields.draw_start(Layout(record), "icymoon.evaluate", "Evaluate", scope="DATASET")
    assert record == [("operator", "icymoon.evaluate", "Evaluate")]
    with pytest.raises(KeyError):
        fields.draw_start(Layout([]), "icymoon.evaluate", "Evaluate", missing=1)


#: Zero that is simply none of the thing.
NONE_OF_IT = re.compile(r"\b0 (for|if|gives) (no\b|none|parallel|a single|an even|even|edges|unbroken|worn|the albedo)")


def test_what_0_stands_for_is_in_the_label_where_it_is_not_none_of_it():
    """The number 0 of threads, for example, is all of them."""
    told = {f"{topic}.{s.key}" for topic, s in list_all_settings() if s.zero}
    special = {
        f"{topic}.{s.key}"
        for topic, s in list_all_settings()
        if s.kind in ("int", "float")
        and s.subtype != "FACTOR"
        and not NONE_OF_IT.search(s.description)
        and re.search(r"\b0 (for|if|gives|uses) ", s.description)
    }
    assert special <= told | ALWAYS_ON
    for _, setting in list_all_settings():
        if setting.zero:
            number = {"DISTANCE": "0 m", "PIXEL": "0.000 px"}.get(setting.subtype, f"{0:.{setting.precision}f}")
            number = "0" if setting.kind == "int" else number
            assert len(fields.label_with_zero(setting)) + len(number) <= LINE - 1  # as screenshots show


#: Subtypes of which Blender shows the unit beside the number.
WITH_UNIT = {"DISTANCE", "DISTANCE_CAMERA", "PIXEL"}


def test_a_number_of_pixels_metres_degrees_or_per_cent_has_its_unit():
    bare = [
        f"{topic}.{each.key}"
        for topic, setting in list_all_settings()
        for each in (setting, *setting.entries)
        if each.unit in ("px", "m", "deg", "%", "s", "m/s²")
        and each.subtype not in WITH_UNIT
        and "(" not in each.label  # an angle, and what is counted in a unit of its own, have it there
        and " per " not in each.label
    ]
    assert bare == []


#: What 0 of these does follows from what they are: no limit.
ALWAYS_ON = {"light.planet_least"}


@pytest.mark.usefixtures("scene")
def test_the_label_of_a_number_changes_at_0(scene):
    def shown() -> list[str]:
        return [
            entry[2].get("text", "")
            for entry in drawn(bpy.types.ICYMOON_PT_quality_advanced)
            if entry[:2] == ("prop", "icymoon.quality.threads")
        ]

    assert shown() == ["Threads (0: all)"]
    scene.icymoon.quality.threads = 3
    assert shown() == ["Threads"]


def test_a_choice_is_explained_in_two_lines_and_wholly_in_its_tooltip():
    for topic, key in fields._EXPLAINED_CHOICES:
        for _, name, meaning in TOPICS[topic][key].choices:
            assert len(sidebar_text._wrap_held(meaning.partition(". ")[0], LINE, "")) <= 2, name


@pytest.mark.ci_takes(6)
@pytest.mark.parametrize("model", [choice[0] for choice in TOPICS["surface"]["model"].choices])
@pytest.mark.parametrize("positions", ["ANGLES", "DATE", "KERNELS"])
def test_no_two_rows_of_a_panel_have_the_same_words(scene, model, positions):
    scene.icymoon.surface.model, scene.icymoon.light.directions_from = model, positions
    for name in dir(bpy.types):
        if name.startswith("ICYMOON_PT_") and name != "ICYMOON_PT_results":
            rows = [entry[2]["text"] for entry in drawn(getattr(bpy.types, name)) if entry[0] == "label"]
            # What two qualities take may be the same; their names stand beside it.
            words = [text for text in rows if text and len(text) < LINE / 2 and not text[0].isdigit()]
            assert len(set(words)) == len(words), name


@pytest.mark.parametrize(("model", "there"), [("HAPKE", "icymoon.hapke.w"), ("LAMBERT", "icymoon.surface.albedo")])
def test_darker_ice_is_one_field_of_ice_whatever_its_law(scene, model, there):
    """Not at the end of another panel."""
    scene.icymoon.surface.model = model
    fields_of_ice = [entry[1] for entry in drawn(bpy.types.ICYMOON_PT_surface) if entry[0] == "prop"]
    assert there in fields_of_ice
    topic, key = there.split(".")[1:]
    assert "Brightness" in TOPICS[topic][key].label


@pytest.mark.parametrize("width", [25, LINE, 60])
def test_the_label_of_a_text_is_not_cut(scene, monkeypatch, width):
    """'Where Rocks Lie' and 'Own Node Group' were cut in a sidebar as Blender opens it."""
    monkeypatch.setattr(fields, "measure_line_length", lambda: width)
    beside = {
        setting.label
        for _, setting in list_all_settings()
        if setting.kind == "text" and not setting.choices and not fields.needs_label_line(setting, setting.label)
    }
    assert max(map(len, beside)) <= 0.38 * width
    assert ("Own Node Group" in beside) == (width == 60)


def test_the_maps_of_an_evaluation_have_one_reason(scene):
    """A second one was in the grey of the fields, where it cannot be read."""
    labels = texts(drawn(bpy.types.ICYMOON_PT_evaluation))
    assert "Maps need ground from a" in labels
    assert "Grey while" not in labels


def header_of(panel: Any, width: int, monkeypatch) -> list:
    monkeypatch.setattr(sidebar_text, "measure_line_length", lambda: width)
    layout = Layout()
    made = stand_in(
        layout=layout,
        **{
            name: getattr(panel, name)
            for name in ("bl_label", "page", "bl_parent_id", "preset_kind")
            if hasattr(panel, name)
        },
    )
    panel.draw_header_preset(made, bpy.context)
    return layout.record


def test_presets_of_a_part_are_in_the_header_of_its_panel(scene, monkeypatch):
    panels = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("ICYMOON_PT_")]
    menus = {entry[1] for panel in panels for entry in header_of(panel, LINE, monkeypatch) if entry[0] == "menu"}
    kinds = {*PRESET_KINDS} - {*WHOLE_SCENE_KINDS, "bodies"}  # moons have buttons in Light
    assert menus == {f"ICYMOON_MT_presets_{kind}" for kind in kinds}
    assert [entry[0] for entry in header_of(bpy.types.ICYMOON_PT_quality, 25, monkeypatch)] == []


def test_the_help_button_hides_no_title(scene, monkeypatch):
    """At the usual width each panel has it; a narrow sidebar shows the title first."""
    panels = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("ICYMOON_PT_")]
    assert all(header_of(panel, LINE, monkeypatch) for panel in panels)
    narrow = {panel.bl_label: bool(header_of(panel, 25, monkeypatch)) for panel in panels}
    # As seen in a sidebar of 200 pixels: 16 letters have room beside the button, within another panel 14.
    expected = {"Ice": True, "Landforms": True, "Exposure and Sensor": False, "Bubbles and Fractures": False}
    assert {title: narrow[title] for title in expected} == expected


@pytest.mark.usefixtures("scene")
def test_a_running_job_has_one_bar_in_the_sidebar(request):
    request.getfixturevalue("running")
    bars = [
        name
        for name in dir(bpy.types)
        if name.startswith("ICYMOON_PT_")
        for entry in drawn(getattr(bpy.types, name))
        if entry[0] == "progress"
    ]
    assert bars == ["ICYMOON_PT_main"]


def test_fields_are_found_once_for_the_same_settings_and_anew_after_a_change(scene):
    keys = ("model", "albedo", "roughness")
    found = fields.find_fields(scene.icymoon, "surface", keys)
    assert fields.find_fields(scene.icymoon, "surface", keys) is found
    for model in ("LAMBERT", "HAPKE", "PRINCIPLED"):
        scene.icymoon.surface.model = model
        shown = [each.setting.key for each in fields.find_fields(scene.icymoon, "surface", keys)]
        assert shown == [key for key in keys if TOPICS["surface"].is_shown(key, scene.icymoon)]


def icons_of_buttons(draw, monkeypatch, width: int) -> dict[str, str]:
    for module in (fields, sidebar_text):
        monkeypatch.setattr(module, "measure_line_length", lambda: width)
    found, operator = {}, Layout.operator

    def noted(self, name, **options):
        found[options.get("text", "")] = options.get("icon", "NONE")
        return operator(self, name, **options)

    monkeypatch.setattr(Layout, "operator", noted)
    draw()
    return found


def test_words_of_a_button_come_before_its_icon_in_a_narrow_sidebar(scene, monkeypatch):
    def draw() -> None:
        drawn(bpy.types.ICYMOON_PT_evaluation)

    # As seen in a sidebar of 200 pixels: 21 letters have room beside the icon.
    icons = icons_of_buttons(draw, monkeypatch, 25)
    assert icons["Evaluate Stereo Pair"] != "NONE"
    assert icons["Evaluate Whole Data Set"] == "NONE"
    assert icons_of_buttons(draw, monkeypatch, LINE)["Evaluate Whole Data Set"] != "NONE"


def test_a_narrow_sidebar_has_the_time_of_a_quality_below_its_button(scene, monkeypatch):
    kinds = {}
    for width in (25, LINE):
        monkeypatch.setattr(sidebar_text, "measure_line_length", lambda width=width: width)
        kinds[width] = [entry[0] for entry in drawn(bpy.types.ICYMOON_PT_quality)]
    assert kinds[25].count("label") >= 5
    assert "split" in kinds[LINE]
    assert kinds[25].count("split") < kinds[LINE].count("split") - 3


@pytest.mark.parametrize("width", [25, 30])
def test_a_narrow_sidebar_cuts_no_label(scene, monkeypatch, width):
    """A number has room for 15 characters of value and unit beside its label, or a line of its own; screenshots of a
    sidebar of 200 px, which is 25 characters wide, show that this is enough."""
    monkeypatch.setattr(fields, "measure_line_length", lambda: width)
    for topic, setting in list_all_settings():
        if setting.kind == "list":
            continue
        layout = Layout()
        fields.draw_field(layout, getattr(scene.icymoon, topic), setting)
        drawn_text = next(entry[2]["text"] for entry in layout.record if entry[0] == "prop")
        labels = [entry[2]["text"] for entry in layout.record if entry[0] == "label"]
        assert all(len(text) <= width for text in labels), setting.key
        if setting.kind in ("int", "float"):
            assert len(drawn_text) <= width - 15, setting.key
        assert (drawn_text or labels[0]).startswith(setting.label.removesuffix(")")), setting.key


def test_a_label_stays_where_it_is_while_its_number_changes(scene, monkeypatch):
    monkeypatch.setattr(fields, "measure_line_length", lambda: 25)
    group, setting = scene.icymoon.rig, TOPICS["rig"]["focus_distance_m"]
    places = []
    for group.focus_distance_m in (0.0, 1.5, 1000.0):
        layout = Layout()
        fields.draw_field(layout, group, setting)
        places.append([entry[0] for entry in layout.record])
    assert places[0] == places[1] == places[2]


class Noted(Layout):
    """Records with each field and text whether it is not grey."""

    acts = True

    def __setattr__(self, name: str, value: object) -> None:
        super().__setattr__(name, value)
        if name == "enabled":
            self.__dict__["acts"] = self.acts and bool(value)

    def __getattr__(self, name: str) -> Any:
        call = super().__getattr__(name)

        def noted(*arguments: object, **options: object) -> Noted:
            call(*arguments, **options)
            self.record[-1][2]["acts"] = self.acts
            inner = Noted(self.record)
            inner.__dict__["acts"] = self.acts
            return inner

        return noted

    def prop(self, data: Any, key: str, **options: object) -> None:
        super().prop(data, key, **options)
        self.record[-1][2]["acts"] = self.acts


def draw_topic(scene, topic: str, keys: tuple[str, ...]) -> tuple[dict[str, bool], list[str]]:
    """Whether each field can be changed, and the lines below the last of them."""
    layout = Noted()
    fields.draw_settings(layout, scene.icymoon, topic, keys)
    acts = {e[1].rpartition(".")[2]: e[2]["acts"] for e in layout.record if e[0] == "prop" and e[1].count(".") == 2}
    last = max((k for k, e in enumerate(layout.record) if e[0] == "prop"), default=-1)
    return acts, [e[2]["text"] for e in layout.record[last:] if e[0] == "label"]


def list_parts() -> list[tuple[str, tuple[str, ...]]]:
    return [
        (topic.key, topic.main_keys if section is None else topic.keys_in(section))
        for topic in TOPICS.values()
        for section in (None, *topic.sections)
    ]


@pytest.mark.parametrize("chosen", [{}, {"rocks.coverage": 0.1}, {"surface.model": "HAPKE"}], ids=str)
def test_a_field_at_0_can_be_changed_and_a_grey_field_has_its_reason_below(scene, chosen):
    """The light theme draws a slider at 0 without a colour, so only what is grey says that it is unused."""
    for name, value in chosen.items():
        setattr(getattr(scene.icymoon, name.partition(".")[0]), name.partition(".")[2], value)
    at_zero, grey = 0, 0
    for topic, keys in list_parts():
        acts, below = draw_topic(scene, topic, keys)
        settings = scene_properties.read_for_display(scene.icymoon)
        for key, can_change in acts.items():
            assert can_change == TOPICS[topic].has_effect(key, settings), f"{topic}.{key}"
            at_zero += can_change and settings[topic][key] == 0
        told = " ".join(below)
        assert ("Grey" in told) == (not all(acts.values())), f"{topic} {keys}"
        grey += not all(acts.values())
    assert at_zero > 20
    assert grey > 5


def test_the_reason_for_grey_fields_names_what_turns_them_on_and_goes_with_it(scene):
    keys = TOPICS["ridges"].main_keys
    assert draw_topic(scene, "ridges", keys)[1] == ["Grey while Height is 0"]
    scene.icymoon.ridges.height_m = 0.1
    assert draw_topic(scene, "ridges", keys)[1] == []
    planet = TOPICS["light"].keys_in(next(s for s in TOPICS["light"].sections if s.key == "planet"))
    assert draw_topic(scene, "light", planet)[1] == ["Grey while Planet is off"]
    motion = TOPICS["rig"].keys_in(next(s for s in TOPICS["rig"].sections if s.key == "motion"))
    assert " ".join(draw_topic(scene, "rig", motion)[1]) == "Grey while Speed Right is 0, Speed Down is 0 and 4 more"
    cover = TOPICS["surface"].keys_in(next(s for s in TOPICS["surface"].sections if s.key == "cover"))
    assert draw_topic(scene, "surface", cover)[1] == ["Grey while Frost is 0", "Grey while Crust is 0"]


def test_why_no_pair_is_shown_is_not_grey_though_its_buttons_are(scene, monkeypatch):
    """A grey text cannot be read in the light theme."""
    monkeypatch.setattr(pair_views, "find_collection", lambda scene: object())  # as of a built scene
    layout = Noted()
    pair_views.draw_pair(layout, scene)
    lines = {entry[2]["text"]: entry[2]["acts"] for entry in layout.record if entry[0] == "label"}
    assert [acts for text, acts in lines.items() if text.startswith("No pair is rendered")] == [True]
    assert "" not in lines  # the text fills the room of the lines about a pair
    rows = [entry[2]["acts"] for entry in layout.record if entry[0] == "row"]
    assert rows
    assert not any(rows)  # of the views and of the export

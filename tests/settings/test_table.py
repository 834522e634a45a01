"""What a person reads of a setting or a preset is there and makes sense: unit, slider, names, descriptions."""

from __future__ import annotations

import ast
import math
import re

import pytest
from icymoon.settings import preset_files, toml_text
from icymoon.settings.table import TOPICS, list_all_settings
from icymoon.settings.topics.declaration import Setting
from icymoon.support.version import ROOT

ALL = [(topic, s) for topic, setting in list_all_settings() for s in (setting, *setting.entries)]
NUMBERS = [(topic, s) for topic, s in ALL if s.kind in ("int", "float")]
#: Unit that the end of a name states; the longest end that fits decides.
ENDS = {
    "_m": "m",
    "_mm": "mm",
    "_px": "px",
    "_deg": "deg",
    "_s": "s",
    "_k": "K",
    "_nm": "nm",
    "_um": "µm",
    "_e": "e-",
    "_e_s": "e-/s",
    "_m_s": "m/s",
    "_deg_s": "deg/s",
    "_mag": "mag",
    "_wm2": "W/m²",
    "_cm2_s": "1/(cm² s)",
    "_e_per_um": "e-/µm",
}
SYMBOLS = {"h_s"}  # of a formula, not of a unit
#: Steps that a slider has at least between its ends, in the digits that it shows.
STEPS = 10


def named(pair: tuple[str, Setting]) -> str:
    return f"{pair[0]}.{pair[1].key}"


@pytest.mark.parametrize(("topic", "setting"), NUMBERS, ids=map(named, NUMBERS))
def test_a_number_has_a_unit_which_its_name_agrees_with(topic, setting):
    assert setting.unit, "a plain number has the unit 1"
    ends = [end for end in ENDS if setting.key.endswith(end)]
    if ends and setting.key not in SYMBOLS:
        assert setting.unit == ENDS[max(ends, key=len)]


@pytest.mark.parametrize(("topic", "setting"), NUMBERS, ids=map(named, NUMBERS))
def test_a_slider_can_be_used(topic, setting):
    low, high = setting.soft or (setting.minimum, setting.maximum)
    assert math.isfinite(low)
    assert math.isfinite(high)
    assert setting.minimum <= low <= setting.default <= high <= setting.maximum
    if setting.kind == "float":
        assert high - low >= STEPS * 10.0**-setting.precision
    # Without a slider of its own a range of millions is all or nothing under the mouse.
    assert setting.soft or high - low <= 1.0e5


@pytest.mark.parametrize(("topic", "setting"), ALL, ids=map(named, ALL))
def test_a_setting_says_what_it_is(topic, setting):
    assert setting.label.strip()
    assert len(setting.description) > 15
    assert not setting.description.endswith("."), "Blender adds the full stop itself"
    if setting.choices:
        names = [choice[0] for choice in setting.choices]
        assert len(set(names)) == len(names)
        assert setting.default in names
        for _, label, meaning in setting.choices:
            assert label.strip()
            assert len(meaning) > 5
            assert not meaning.endswith(".")


@pytest.mark.parametrize(("topic", "setting"), ALL, ids=map(named, ALL))
def test_a_tooltip_has_at_most_two_sentences(topic, setting):
    for text in (setting.description, *(meaning for _, _, meaning in setting.choices or ())):
        assert len(re.findall(r"[.!?] (?=[A-Z])", text)) <= 1, text


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_a_panel_says_what_it_is_and_names_nothing_twice(topic):
    assert topic.label.strip()
    assert len(topic.description) > 15
    for listed in (topic.settings, *(s.entries for s in topic.settings if s.entries)):
        labels = [s.label for s in listed]
        assert len(set(labels)) == len(labels)


@pytest.mark.parametrize("name", preset_files.preset_names())
def test_a_preset_says_what_it_is(name):
    header = toml_text.read_toml(preset_files.find_preset(name))["preset"]
    assert header["title"].strip()
    assert len(header["description"]) > 15
    same = [
        other
        for other in preset_files.preset_names(name.split("/")[0])
        if preset_files.read_preset_header(other)[0] == header["title"]
    ]
    assert same == [name], "two presets of one menu have one title"


@pytest.mark.parametrize("path", sorted((ROOT / "operators").glob("*.py")), ids=lambda p: p.stem)
def test_a_button_that_cannot_be_pressed_says_why(path):
    polls = [
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name == "poll" and node.args.args[0].arg == "cls"
    ]
    # There is one, which says why: that of ``ExplainedOperator``.
    assert len(polls) == (path.stem == "operator_type")
    assert all("poll_message_set" in ast.unparse(node) for node in polls)

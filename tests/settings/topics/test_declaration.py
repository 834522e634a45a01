"""How a setting is declared and when it is relevant, by declarations of a test's own."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import Any, Literal

import pytest
from icymoon.settings.topics.declaration import (
    ADVANCED,
    ELSEWHERE,
    TOP,
    Section,
    Setting,
    Table,
    Topic,
    choice,
    degrees,
    fraction,
    image_file,
    metres,
    number,
    signed,
    tables,
    text,
    tick,
    topic_key,
)
from icymoon.settings.topics.relevance import ALWAYS, Condition, chosen, nonzero, of_topic, positive, ticked

FIRST, SECOND = Section("first", "First", "", "on"), Section("second", "Second", "")


class Part(Table):
    size_m: float = metres("Size", 1.0, 0.0, 9.0, (0.0, 5.0), "", "geometry")


class PlainThingSettings(Table, label="Thing", parent="Parent"):
    """A thing."""

    count: int = number("Count", 2, 0, 9, None, "", "geometry")
    kind: Literal["A", "B"] = choice("Kind", "A", "", "material", ("A", "An A", ""), ("B", "A b", ""))
    rare: float = fraction("Rare", 0.5, "", "light", section=ADVANCED)
    late: bool = tick("Late", True, "", "run", section=SECOND, since="9.0", before=False)
    on: bool = tick("On", False, "", "run", section=FIRST)
    slope_deg: float = degrees("Slope", 5.0, -9.0, 9.0, "", "camera", section=FIRST, active=ticked("on"))
    main: float = signed("Main", "", "camera", section=TOP, shown=chosen("kind", "B"))
    hidden: float = signed("Hidden", "", "camera", section=ELSEWHERE)
    parts: list[Part] = tables("Parts", Part, "", "geometry")
    file: str = image_file("File", "An image")
    name: str = text("Name", "x", "", "run", "name")


class OtherThingSettings(
    PlainThingSettings, label="Other", turned_on_by="count", shown=chosen("plain_thing.kind", "A")
):
    """Another."""


THING, OTHER = PlainThingSettings.topic, OtherThingSettings.topic


def state(**values: Any) -> SimpleNamespace:
    """Settings of both topics, the defaults but for ``values`` of the thing and ``other_`` ones of the other."""
    defaults = {setting.key: setting.default for setting in THING.settings}
    return SimpleNamespace(
        **{
            name: SimpleNamespace(
                **defaults
                | {
                    key.removeprefix(prefix): value
                    for key, value in values.items()
                    if key.startswith("other_") == bool(prefix)
                }
            )
            for name, prefix in (("plain_thing", ""), ("other_thing", "other_"))
        }
    )


def test_a_class_declares_a_topic_in_the_order_of_its_fields():
    keys = ["count", "kind", "rare", "late", "on", "slope_deg", "main", "hidden", "parts", "file", "name"]
    assert [setting.key for setting in THING.settings] == keys
    assert PlainThingSettings.fields == THING.settings
    assert (THING.key, THING.label, THING.description, THING.parent) == ("plain_thing", "Thing", "A thing", "Parent")
    assert (OTHER.key, OTHER.label, OTHER.description, OTHER.parent) == ("other_thing", "Other", "Another", "")
    assert OTHER.settings == THING.settings
    assert not hasattr(Part, "topic")
    assert Table.fields == ()


@pytest.mark.parametrize(("name", "key"), [("RigSettings", "rig"), ("RockSurfaceSettings", "rock_surface"), ("A", "a")])
def test_the_key_of_a_topic_is_its_class_in_small_letters(name, key):
    assert topic_key(name) == key


def test_a_value_has_the_kind_of_its_default():
    kinds = {setting.key: setting.kind for setting in THING.settings}
    assert kinds == {
        "count": "int",
        "kind": "choice",
        "rare": "float",
        "late": "bool",
        "on": "bool",
        "slope_deg": "float",
        "main": "float",
        "hidden": "float",
        "parts": "list",
        "file": "text",
        "name": "text",
    }


def test_a_setting_is_found_by_its_key_and_a_wrong_key_is_named():
    assert THING["count"].label == "Count"
    with pytest.raises(KeyError, match=r"plain_thing\.cuont"):
        _ = THING["cuont"]
    assert [setting.key for setting in THING["parts"].entries] == ["size_m"]
    assert THING["count"].entries == ()


def test_the_old_value_is_the_default_unless_it_is_stated():
    assert (THING["late"].default, THING["late"].old_value) == (True, False)
    assert (THING["on"].default, THING["on"].old_value) == (False, False)


@pytest.mark.parametrize(
    ("key", "range_", "unit", "subtype"),
    [
        ("count", (0, 9), "1", "NONE"),
        ("rare", (0.0, 1.0), "1", "FACTOR"),
        ("slope_deg", (-9.0, 9.0), "deg", "NONE"),
        ("main", (-1.0, 1.0), "1", "NONE"),
        ("on", (-math.inf, math.inf), "", "NONE"),
        ("file", (-math.inf, math.inf), "", "FILE_PATH"),
    ],
)
def test_each_kind_of_declaration_has_its_range_and_unit(key, range_, unit, subtype):
    setting = THING[key]
    assert ((setting.minimum, setting.maximum), setting.unit, setting.subtype) == (range_, unit, subtype)


def test_declarations_keep_what_they_are_given():
    size, slope, file, main = Part.fields[0], THING["slope_deg"], THING["file"], THING["main"]
    assert (size.default, size.minimum, size.maximum, size.soft, size.unit) == (1.0, 0.0, 9.0, (0.0, 5.0), "m")
    assert (size.subtype, size.effect) == ("DISTANCE", "geometry")
    assert (slope.label, slope.default, slope.soft) == ("Slope (°)", 5.0, None)
    assert (file.default, file.trust, file.effect) == ("", "read", "material")
    assert (main.default, THING["parts"].default, THING["kind"].default) == (0.0, [], "A")
    assert [setting.label for setting in THING.settings if setting.since] == ["Late"]
    # Lengths show tenths of a millimetre, angles hundredths of a degree.
    assert (size.precision, slope.precision, main.precision) == (4, 2, 3)


def test_sub_panels_stand_in_the_order_of_their_making_with_that_for_few_scenes_last():
    assert THING.sections == (FIRST, SECOND, ADVANCED)
    assert THING.keys_in(FIRST) == ("slope_deg",)  # the tick is in its header
    assert THING.keys_in(SECOND) == ("late",)
    assert THING.main_keys == ("main", "count", "kind", "parts", "file", "name")


@pytest.mark.parametrize(
    ("kind", "other_kind", "thing", "other"),
    [("A", "A", False, False), ("B", "A", True, False), ("A", "B", False, True), ("B", "B", True, False)],
)
def test_a_setting_is_shown_if_it_and_its_topic_are(kind, other_kind, thing, other):
    of_scene = state(kind=kind, other_kind=other_kind)
    assert THING.is_shown("main", of_scene) == thing
    assert OTHER.is_shown("main", of_scene) == other
    assert THING.is_shown("count", of_scene)
    assert OTHER.is_shown("count", of_scene) == (kind == "A")


@pytest.mark.parametrize(("count", "on"), list(itertools.product((0, 1), (False, True))))
def test_a_setting_has_an_effect_if_its_condition_holds_and_its_topic_is_turned_on(count, on):
    of_scene = state(on=on, other_on=on, other_count=count)
    assert THING.has_effect("slope_deg", of_scene) == on
    assert OTHER.has_effect("slope_deg", of_scene) == (on and count > 0)
    assert OTHER.has_effect("kind", of_scene) == (count > 0)
    assert OTHER.has_effect("count", of_scene)  # or nobody could turn it on


@pytest.mark.parametrize(
    ("condition", "holds", "fails"),
    [
        (chosen("kind", "A"), {}, {"kind": "B"}),
        (chosen("kind", "B", "A"), {"kind": "B"}, {"kind": "C"}),
        (chosen("other_thing.kind", "B"), {"other_kind": "B"}, {"kind": "B"}),
        (ticked("on"), {"on": True}, {}),
        (positive("main"), {"main": 0.5}, {}),
        (positive("main"), {"main": 1e-9}, {"main": -1.0}),
        (nonzero("main"), {"main": -0.5}, {}),
        (nonzero("main", "hidden"), {"hidden": 0.5}, {}),
        (nonzero("main", "hidden"), {"main": 2.0}, {"on": True}),
    ],
)
def test_a_condition_holds_and_fails(condition, holds, fails):
    assert condition(state(**holds), "plain_thing")
    assert not condition(state(**fails), "plain_thing")


def test_conditions_join_as_propositions_do():
    yes, no = ALWAYS, ~ALWAYS
    for a, b in itertools.product((yes, no), repeat=2):
        assert (a & b)(None, "") == (a is yes and b is yes)
        assert (a | b)(None, "") == (a is yes or b is yes)
    assert yes(None, "")
    assert not no(None, "")


def test_the_second_of_two_conditions_is_asked_only_if_it_matters():
    asked = []
    watched = Condition(lambda of: bool(asked.append(of)))
    assert not (~ALWAYS & watched)(None, "")
    assert (ALWAYS | watched)(None, "")
    assert asked == []


def test_only_the_failing_part_of_a_condition_decides():
    """Else a reason would name a setting that need not be changed, such as 'Frost is 0.3'."""
    both = positive("count") & ticked("on")
    names = "plain_thing.count", "plain_thing.on"
    for count, on, deciding in ((1, False, names[1:]), (0, True, names[:1]), (0, False, names[:1]), (1, True, names)):
        assert both.list_deciding(state(count=count, on=on), "plain_thing") == deciding
        assert (~both).list_deciding(state(count=count, on=on), "plain_thing") == deciding
    either = positive("count") | ticked("on")
    for count, on, deciding in ((1, False, names[:1]), (0, True, names[1:]), (0, False, names)):
        assert either.list_deciding(state(count=count, on=on), "plain_thing") == deciding


def test_a_condition_tells_a_topic_from_another_with_the_same_settings():
    assert of_topic("plain_thing")(state(), "plain_thing")
    assert not of_topic("plain_thing")(state(), "other_thing")


def test_a_table_is_a_dictionary_with_attributes():
    table = PlainThingSettings.from_values({"count": 3})
    assert (table.count, table == {"count": 3}) == (3, True)
    table.on = True
    assert dict(table | {"count": 4}) == {"count": 4, "on": True}
    assert type(table | {"count": 4}) is type(table.copy()) is PlainThingSettings
    assert dict(table) == {"count": 3, "on": True}
    with pytest.raises(AttributeError, match="PlainThingSettings has no rare"):
        _ = table.rare


def test_a_topic_and_a_section_stand_by_themselves():
    assert Topic("bare", "Bare", "", ()).sections == ()
    assert (
        Topic("bare", "Bare", "", ()).main_keys,
        Setting(label="N", default=1, description="", effect="run").key,
    ) == ((), "")
    assert Section("a", "A", "").order < Section("b", "B", "").order

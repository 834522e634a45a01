"""Draw settings from their table, one field each, with room for the label."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import ClassVar, NamedTuple

import bpy

from ..operators.session import session
from ..operators.sidebar_text import LINE, describe_value, measure_line_length, replace_keys_by_labels, wrap_lines
from ..settings.blender import scene_properties
from ..settings.table import TOPICS
from ..settings.topics.declaration import Section, Setting
from ..settings.topics.scene import Settings

#: Settings whose present choice the panel explains by the first sentence of the choice's tooltip.
_EXPLAINED_CHOICES = {("surface", "model"), ("rock_surface", "model"), ("hapke", "accuracy")}


#: Characters, in a narrow sidebar, of a number with its unit beside its label, and of the margins of a choice.
_VALUE_CHARACTERS, _CHOICE_CHARACTERS = 15, 4
#: Share of a line that the label of a text takes.
_TEXT_LABEL_SHARE = 0.38
#: Characters that the icon of a button takes.
_ICON_CHARACTERS = 4
#: Maximum number of reasons below the fields of a panel, and of settings that a reason names.
_MAX_REASONS, _MAX_DECIDING = 3, 2


class _Field(NamedTuple):
    """A setting that the present choices use, and how to draw its field."""

    setting: Setting
    has_effect: bool
    meaning: str  # meaning of the present choice; empty if it is not explained


class _Found:
    """The cached fields of each section of the sidebar, and the settings for which they were found."""

    settings: Settings | None = None
    fields: ClassVar[dict[tuple[str, tuple[str, ...]], tuple[_Field, ...]]] = {}
    reasons: ClassVar[dict[tuple[str, tuple[str, ...]], tuple[str, ...]]] = {}


def find_fields(root: bpy.types.PropertyGroup, topic: str, keys: tuple[str, ...]) -> tuple[_Field, ...]:
    """Find the settings of a topic that the present choices use. ``root`` is ``Scene.icymoon``.

    The fields are found once for the same settings, since the window asks at every redraw.
    """
    settings = scene_properties.read_for_display(root)
    if _Found.settings is not settings:
        _Found.settings = settings
        _Found.fields.clear()
        _Found.reasons.clear()
    if (topic, keys) not in _Found.fields:
        _Found.fields[topic, keys] = tuple(
            _describe_field(topic, key, settings) for key in keys if TOPICS[topic].is_shown(key, settings)
        )
    return _Found.fields[topic, keys]


def explain_grey_fields(root: bpy.types.PropertyGroup, topic: str, keys: tuple[str, ...]) -> tuple[str, ...]:
    """Explain in sentences why some of the fields from ``find_fields`` are grey; empty if no field is grey."""
    fields = find_fields(root, topic, keys)
    if (topic, keys) not in _Found.reasons:
        settings = scene_properties.read_for_display(root)
        grey = [each.setting.key for each in fields if not each.has_effect]
        found = list(dict.fromkeys(TOPICS[topic].list_obstacles(key, settings) or () for key in grey))
        # A reason by one setting need not be repeated with a second setting.
        brief = [each for each in found if not any(set(other) < set(each) for other in found if other)]
        _Found.reasons[topic, keys] = tuple(_explain_grey(topic, each, settings) for each in brief[:_MAX_REASONS])
    return _Found.reasons[topic, keys]


def _explain_grey(topic: str, deciding: tuple[str, ...], settings: Settings) -> str:
    if not deciding:
        return f"Grey: unused by {TOPICS[topic].label}"
    values = [describe_value(name, settings, topic) for name in deciding[:_MAX_DECIDING]]
    more = len(deciding) - len(values)
    return f"Grey while {', '.join(values)} and {more} more" if more else f"Grey while {' and '.join(values)}"


def _describe_field(topic: str, key: str, settings: Settings) -> _Field:
    setting, value = TOPICS[topic][key], settings[topic][key]
    meanings = (each[2] for each in setting.choices if each[0] == value and (topic, key) in _EXPLAINED_CHOICES)
    return _Field(setting, TOPICS[topic].has_effect(key, settings), next(meanings, "").partition(". ")[0])


def draw_settings(layout: bpy.types.UILayout, root: bpy.types.PropertyGroup, topic: str, keys: tuple[str, ...]) -> None:
    """Draw the settings of a topic that the present choices use. ``root`` is ``Scene.icymoon``.

    The reasons for grey fields follow below the fields, because fields must not move while the user drags one.
    """
    draw_fields(layout, root, topic, keys)
    for reason in explain_grey_fields(root, topic, keys):
        draw_lines(layout, (reason,), "INFO")


def draw_fields(layout: bpy.types.UILayout, root: bpy.types.PropertyGroup, topic: str, keys: tuple[str, ...]) -> None:
    """Draw the settings as ``draw_settings`` does, but without the reasons for grey fields, for places where another
    text gives them."""
    group = getattr(root, topic)
    for setting, acts, meaning in find_fields(root, topic, keys):
        row = layout.row()
        row.enabled = acts
        if setting.kind == "list":
            _draw_list(row.column(), group, setting)
        else:
            draw_field(row, group, setting)
        if meaning:
            draw_sentence(layout, meaning)


def draw_start(layout: bpy.types.UILayout, operator: str, text: str, icon: str = "NONE", **properties: object) -> None:
    """Draw the button of an operator that starts a job, with its properties; while a job runs, a grey button.

    Blender keeps the button under the mouse as it was when the mouse came, so this button would stay grey after the job
    until the mouse leaves it. So the grey button has another operator.

    If the sidebar is too narrow for icon and words, the button has only the words.
    """
    icon = icon if len(text) <= measure_line_length() - _ICON_CHARACTERS else "NONE"
    if session.job is not None:
        layout.operator("icymoon.wait", text=text, icon=icon)
        return
    button = layout.operator(operator, text=text, icon=icon)
    for name, value in properties.items():
        setattr(button, name, value)


def draw_lines(
    layout: bpy.types.UILayout, lines: Iterable[str], icon: str = "NONE", hang: str = "", room_for: str = ""
) -> int:
    """Draw lines of text, with an icon before the first. A text too long for the sidebar continues in the next line,
    which begins with ``hang``. Returns the number of lines.

    The text takes at least as many lines as the text ``room_for``, so that fields below stay in place while the text
    changes.
    """
    has_icon = icon != "NONE"
    drawn = [part for each in lines for part in wrap_lines(each, hang, has_icon)]
    drawn += [""] * (len(wrap_lines(room_for, hang, has_icon)) - len(drawn) if room_for else 0)
    if not drawn:
        return 0  # an empty column would be a gap
    column = layout.column(align=True)
    for k, line in enumerate(drawn):
        column.label(text=line, icon="BLANK1" if k and has_icon else icon)
    return len(drawn)


def draw_sentence(layout: bpy.types.UILayout, sentence: str, icon: str = "NONE", hang: str = "") -> int:
    """Draw a sentence, with labels instead of keys. Returns its number of lines; see ``draw_lines``."""
    return draw_lines(layout, (replace_keys_by_labels(sentence),), icon, hang)


def fill_room(layout: bpy.types.UILayout, drawn: int, texts: Iterable[str]) -> None:
    """Draw empty lines below ``drawn`` lines, until there are as many lines as ``texts`` would take beside icons. So
    fields below stay in place while the lines change."""
    for _ in range(sum(len(wrap_lines(text, icon=True)) for text in texts) - drawn):
        layout.label(text="")


def draw_field(layout: bpy.types.UILayout, group: bpy.types.PropertyGroup, setting: Setting) -> None:
    """Draw a setting's field. It is split if Blender would leave too little room for the label. In a narrow sidebar, a
    label that would be cut gets a separate line."""
    label = find_shown_label(group, setting)
    if needs_label_line(setting, label):
        column = layout.column(align=True)
        column.label(text=label if len(label) <= measure_line_length() else setting.label)
        _draw_value(column, group, setting)
    elif setting.kind in ("choice", "text"):
        split = layout.split(factor=0.45 if setting.choices else _TEXT_LABEL_SHARE)
        split.label(text=setting.label)
        _draw_value(split, group, setting)
    else:
        layout.prop(group, setting.key, text=label)


def _draw_value(layout: bpy.types.UILayout, group: bpy.types.PropertyGroup, setting: Setting) -> None:
    """Draw the value of a setting without its label. The name of a node group is chosen from the node groups of the
    file."""
    if setting.key == "albedo_group":
        layout.prop_search(group, setting.key, bpy.data, "node_groups", text="")
    else:
        layout.prop(group, setting.key, text="")


def find_shown_label(group: bpy.types.PropertyGroup, setting: Setting) -> str:
    """Return the label of a setting, with the meaning of 0 if the value is 0."""
    if setting.zero and getattr(group, setting.key) == 0:
        return label_with_zero(setting)
    return setting.label


def needs_label_line(setting: Setting, label: str) -> bool:
    """Return whether a label needs a separate line. For a number this does not depend on the value, since fields must
    not move while the user drags it."""
    width = measure_line_length()
    if setting.kind == "text" and not setting.choices and len(label) > _TEXT_LABEL_SHARE * width:
        return True
    if width >= LINE or setting.kind == "bool":
        return False
    if setting.kind in ("choice", "text"):
        longest = max(map(len, (label, *(choice[1] for choice in setting.choices))))
        return longest > width / 2 - _CHOICE_CHARACTERS
    return max(len(label), len(label_with_zero(setting)) if setting.zero else 0) > width - _VALUE_CHARACTERS


def label_with_zero(setting: Setting) -> str:
    """Return the label of a number that is 0, with the meaning of 0: 'Threads (0: all)', 'Pixel Pitch (µm, 0: by
    …)'."""
    if setting.label.endswith(")"):
        return f"{setting.label[:-1]}, 0: {setting.zero})"
    return f"{setting.label} (0: {setting.zero})"


class RowsOfText:
    """Mix-in: a UIList each of whose rows is a sentence on an entry, with the icon named ``symbol``."""

    symbol: ClassVar[str]

    @staticmethod
    def describe(item: bpy.types.PropertyGroup) -> str:
        """Describe an entry in a sentence."""
        raise NotImplementedError

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: bpy.types.bpy_struct,
        item: bpy.types.PropertyGroup,
        icon: int,
        active_data: bpy.types.bpy_struct,
        active_property: str,
    ) -> None:
        layout.label(text=self.describe(item), icon=self.symbol)


def draw_list(
    layout: bpy.types.UILayout,
    kind: str,
    group: bpy.types.PropertyGroup,
    name: str,
    active: str,
    *,
    add: str,
    verb: str,
) -> None:
    """Draw a list of a group by a UIList. Its buttons run the operator ``add``, and operators that begin with ``verb``
    and remove or move an entry."""
    row = layout.row()
    row.template_list(kind, "", group, name, group, active, rows=3)
    buttons = row.column(align=True)
    buttons.operator_context = "INVOKE_DEFAULT"
    buttons.operator(add, text="", icon="ADD")
    buttons.operator(f"{verb}_remove", text="", icon="REMOVE")
    for direction in ("UP", "DOWN"):
        buttons.operator(f"{verb}_move", text="", icon=f"TRIA_{direction}").direction = direction


def _draw_list(layout: bpy.types.UILayout, group: bpy.types.PropertyGroup, setting: Setting) -> None:
    """Draw a list of tables with its buttons, and the settings of the selected table."""
    name, active, verb = setting.key, f"{setting.key}_active", f"icymoon.{setting.key.removesuffix('s')}"
    draw_list(layout, f"ICYMOON_UL_{name}", group, name, active, add=f"{verb}_add", verb=verb)
    entries, index = getattr(group, name), getattr(group, active)
    if index >= len(entries):
        return
    for each in list_entry_fields(setting, entries[index], None):
        draw_field(layout, entries[index], each)
    for section in dict.fromkeys(each.section for each in setting.entries if each.section):
        header, body = layout.panel(f"icymoon_{section.key}", default_closed=True)
        header.label(text=section.label)
        for each in list_entry_fields(setting, entries[index], section) if body else ():
            draw_field(body, entries[index], each)


def list_entry_fields(setting: Setting, entry: object, section: Section | None) -> list[Setting]:
    """List the settings of a list's ``entry`` that its present choices use, in a ``section`` or outside all
    sections."""
    scope = SimpleNamespace(entry=entry)
    return [each for each in setting.entries if each.section == section and each.shown(scope, "entry")]

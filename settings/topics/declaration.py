"""Declares each setting once, with everything that Blender, files, the manual, the sidebar and the type checker need.

A topic is a class, and a setting is a typed field of it::

    class RigSettings(Table, label="Stereo Camera"):
        "Two identical cameras."

        baseline_m: float = metres("Baseline", 0.25, 1.0e-4, 100.0, (0.02, 1.0), "Distance between …", "camera")

An instance is the table of a topic: a dictionary, complete or not, whose keys are attributes too. So JSON, TOML,
comparing, copying and ``settings[topic][key]`` work as for any dictionary, and the type checker knows the fields.
Units are part of the names (``_m``, ``_deg``, ``_px`` …). ``docs/extend.md`` lists the steps for a new setting.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Self,
    TypedDict,
    TypeVar,
    Unpack,
    dataclass_transform,
    get_args,
    get_type_hints,
)

from . import trust_boundary
from .relevance import ALWAYS, Condition, positive

Value = bool | int | float | str | list[dict[str, Any]]
#: Tables of settings by topic, complete or not, of the declared types or of plain dictionaries.
Parts = Mapping[str, Mapping[str, Any]]

#: What must be made again after a change of a setting, the most expensive first. After a change of
#: "response" only the images are developed again. A change of "run" changes no result.
EFFECTS = ("geometry", "material", "light", "lander", "camera", "sampling", "response", "run")
#: Parent panel of the topics that describe one landform each.
LANDFORMS = "Landforms"


@dataclass(frozen=True)
class Section:
    """A sub-panel of a topic's panel, closed at first. ``switch`` is the setting whose tick is in its header.

    ``shown`` is the condition of all settings in it that state none. Sub-panels are drawn in the order of their
    creation.
    """

    key: str
    label: str
    description: str
    switch: str = ""
    shown: Condition = field(default=ALWAYS, compare=False)
    order: int = field(default_factory=itertools.count().__next__, compare=False)


#: Settings that few scenes change, in the last sub-panel.
ADVANCED = Section("advanced", "Advanced", "Settings that few scenes change")
#: Settings that most scenes change, before the others of their panel.
TOP = Section("top", "", "")
#: Settings that another topic's panel draws, or that the panel's own code draws.
ELSEWHERE = Section("elsewhere", "", "")


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One setting. ``minimum`` and ``maximum`` bound its values, ``soft`` is the range of the slider.

    ``shown`` tells whether the present choices use the setting; otherwise the sidebar hides it. ``active`` tells if it
    has an effect with the present numbers and ticks; otherwise it is grey. ``since`` is the release that added it,
    empty for the first release. With the value ``before``, pairs look as in releases without the setting.
    """

    label: str
    default: Value
    description: str
    effect: str
    key: str = ""  # the name of the field
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    soft: tuple[float, float] | None = None
    choices: tuple[tuple[str, str, str], ...] = ()
    subtype: str = "NONE"
    precision: int = 3
    entry: type[Table] | None = None  # of a list of tables: the type of a table
    trust: str = ""  # for a text: one of ``trust_boundary.CLASSES``
    zero: str = ""  # for a number: what 0 stands for, where that is not simply none of it
    section: Section | None = None
    shown: Condition = ALWAYS
    active: Condition = ALWAYS
    since: str = ""
    before: Value | None = None  # None for the default

    def __post_init__(self) -> None:
        if (self.kind == "text") != (self.trust in trust_boundary.CLASSES):
            raise ValueError(f"{self.label}: a text must have a class of trust, and no other setting may have one.")

    def __set_name__(self, table: type[Table], name: str) -> None:
        object.__setattr__(self, "key", name)

    @cached_property  # asked for each field at every redraw
    def kind(self) -> str:
        """'choice', 'bool', 'int', 'float', 'text' or 'list'; ``entries`` are the settings of each table of a list."""
        if self.entry:
            return "list"
        if self.choices:
            return "choice"
        return {bool: "bool", int: "int", float: "float", str: "text"}[type(self.default)]

    @cached_property
    def choice_labels(self) -> dict[str, str]:
        """The label of each choice by its name; empty for a setting without choices."""
        return {name: label for name, label, _ in self.choices}

    def placed(self, since: str) -> Setting:
        """Return this setting, with its section's and topic's ``shown`` and ``since`` where it has none."""
        shown = self.section.shown if self.section and self.shown is ALWAYS else self.shown
        return replace(self, since=self.since or since, shown=shown)

    @property
    def entries(self) -> tuple[Setting, ...]:
        """The settings of each table of a list."""
        return self.entry.fields if self.entry else ()

    @property
    def old_value(self) -> Value:
        """The value with the effect of releases without this setting; the default if the first release had it."""
        return self.default if self.before is None else self.before


@dataclass(frozen=True)
class Topic:
    """A group of settings: one sub-panel and one TOML table."""

    key: str
    label: str
    description: str
    settings: tuple[Setting, ...]
    parent: str = ""  # label of the parent panel; empty if the panel is at the top of the sidebar
    inside: str = ""  # key of the topic whose panel contains the panel of this one
    brief: str = ""  # a shorter label, for narrow sidebars
    shown: Condition = ALWAYS
    #: The setting that must be above 0 or ticked for the others to have an effect; its key, or its name with a dot.
    turned_on_by: str = ""
    plugin: str = ""  # package and version of the plug-in that it is of

    @cached_property
    def _by_key(self) -> dict[str, Setting]:
        return {setting.key: setting for setting in self.settings}

    @cached_property
    def sections(self) -> tuple[Section, ...]:
        """The sub-panels of the topic's panel in their order, ADVANCED last."""
        found = {s.section for s in self.settings if s.section} - {TOP, ELSEWHERE}
        return tuple(sorted(found, key=lambda section: (section == ADVANCED, section.order)))

    def keys_in(self, section: Section | None) -> tuple[str, ...]:
        """The keys of a sub-panel's settings, without the tick in its header. For None, the keys outside sub-panels."""
        return tuple(s.key for s in self.settings if s.section == section and not (section and s.key == section.switch))

    @cached_property
    def main_keys(self) -> tuple[str, ...]:
        """The settings that the topic's own panel draws, in order."""
        return self.keys_in(TOP) + self.keys_in(None)

    def __getitem__(self, key: str) -> Setting:
        try:
            return self._by_key[key]
        except KeyError:
            raise KeyError(f"{self.key}.{key}") from None

    def is_shown(self, key: str, root: object) -> bool:
        """Whether the present choices use a setting. ``root`` contains all settings, such as ``Scene.icymoon``."""
        return self.shown(root, self.key) and self._by_key[key].shown(root, self.key)

    def has_effect(self, key: str, root: object) -> bool:
        """Whether a setting that is shown has an effect, given the present numbers and ticks."""
        on = key == self.turned_on_by or not self.turned_on_by or positive(self.turned_on_by)(root, self.key)
        return on and self._by_key[key].active(root, self.key)

    def list_obstacles(self, key: str, root: object) -> tuple[str, ...] | None:
        """The settings (``topic.key``) whose present values hide a setting or remove its effect; None if it acts."""
        on = positive(self.turned_on_by) if self.turned_on_by and key != self.turned_on_by else ALWAYS
        for condition in (self.shown, self._by_key[key].shown, on, self._by_key[key].active):
            if not condition(root, self.key):
                return condition.list_deciding(root, self.key)
        return None


class AttributeDict(dict[str, Any]):
    """A dictionary whose keys are also attributes. A subclass declares the possible keys."""

    __slots__ = ()

    if not TYPE_CHECKING:  # else any name would be an attribute to mypy

        def __getattr__(self, key: str) -> object:
            try:
                return self[key]
            except KeyError:
                raise AttributeError(f"{type(self).__name__} has no {key}") from None

        def __setattr__(self, key: str, value: object) -> None:
            self[key] = value

    def __or__(self, other: Mapping[str, Any]) -> Self:  # type: ignore[override]
        return type(self)({**self, **other})

    def copy(self) -> Self:
        return type(self)(self)

    @classmethod
    def from_values(cls, values: Mapping[str, Any] | Iterable[tuple[str, Any]]) -> Self:
        """A table with these values."""
        made = cls()
        made.update(values)
        return made


Stated = TypeVar("Stated", bound=float | str)
Entry = TypeVar("Entry", bound="Table")


class _CommonArguments(TypedDict, total=False):
    """Arguments that the declaration of any setting may have, see ``Setting``."""

    zero: str
    section: Section
    shown: Condition
    active: Condition
    since: str
    before: Value


class _DisplayArguments(_CommonArguments, total=False):
    subtype: str
    precision: int


def _field(setting: Setting) -> Any:
    """The declaration of a setting, typed as its value: the class replaces it by values once it is made."""
    return setting


def metres(label: str, default: float, low: float, high: float, soft: tuple[float, float], description: str,
           effect: str, **more: Unpack[_CommonArguments]) -> float:
    """A length in metres."""
    return _field(Setting(label=label, default=default, description=description, effect=effect, unit="m", minimum=low,
                          maximum=high, soft=soft, subtype="DISTANCE", precision=4, **more))


def degrees(label: str, default: float, low: float, high: float, description: str, effect: str,
            soft: tuple[float, float] | None = None, precision: int = 2, **more: Unpack[_CommonArguments]) -> float:
    """An angle in degrees; the label gets the unit."""
    return _field(Setting(label=f"{label} (°)", default=default, description=description, effect=effect, unit="deg",
                   minimum=low, maximum=high, soft=soft, precision=precision, **more))


def fraction(label: str, default: float, description: str, effect: str, low: float = 0.0, high: float = 1.0,
             **more: Unpack[_CommonArguments]) -> float:
    """A share between 0 and 1, with a slider."""
    return _field(Setting(label=label, default=default, description=description, effect=effect, unit="1", minimum=low,
                          maximum=high, subtype="FACTOR", **more))


def signed(label: str, description: str, effect: str, **more: Unpack[_CommonArguments]) -> float:
    """A number from -1 to 1."""
    # No FACTOR: Blender fills its slider from the minimum, so that 0 would look like a half.
    return _field(Setting(label=label, default=0.0, description=description, effect=effect, unit="1", minimum=-1.0,
                          maximum=1.0, **more))


def number(label: str, default: Stated, low: float, high: float, soft: tuple[float, float] | None, description: str,
           effect: str, unit: str = "1", **more: Unpack[_DisplayArguments]) -> Stated:
    """A number. It is whole if its default is an int."""
    return _field(Setting(label=label, default=default, description=description, effect=effect, unit=unit, minimum=low,
                          maximum=high, soft=soft, **more))


def tick(label: str, default: bool, description: str, effect: str, **more: Unpack[_CommonArguments]) -> bool:
    """A switch."""
    return _field(Setting(label=label, default=default, description=description, effect=effect, **more))


def choice(label: str, default: Stated, description: str, effect: str, *choices: tuple[str, str, str],
           **more: Unpack[_CommonArguments]) -> Stated:
    """One of several names, each (name, label, description)."""
    return _field(Setting(label=label, default=default, description=description, effect=effect, choices=choices,
                          **more))


def text(label: str, default: str, description: str, effect: str, trust: str, **more: Unpack[_DisplayArguments]) -> str:
    """A text; ``trust`` is one of ``trust_boundary.CLASSES``."""
    return _field(Setting(label=label, default=default, description=description, effect=effect, trust=trust, **more))


def image_file(label: str, description: str, **more: Unpack[_CommonArguments]) -> str:
    """The path of an image file of the material."""
    return text(label, "", f"{description}. // is the folder of the .blend file", "material", "read",
                subtype="FILE_PATH", **more)


def mask_file(what: str, effect: str, **more: Unpack[_CommonArguments]) -> str:
    """The path of a painted mask, which states where there is something: "rocks lie"."""
    description = (f"PNG or NPY image over the patch, north up: black has no {what.partition(' ')[0]}, white as much "
                   "as without the image. // is the folder of the .blend file")
    return text(f"Where {what.title()}", "", description, effect, "read", subtype="FILE_PATH", **more)


def tables(label: str, entry: type[Entry], description: str, effect: str,
           **more: Unpack[_CommonArguments]) -> list[Entry]:
    """A list of tables of one type."""
    return _field(Setting(label=label, default=[], description=description, effect=effect, entry=entry, **more))


@dataclass_transform(kw_only_default=True)
class Table(AttributeDict):
    """The table of a topic, or of an entry of a list. A subclass declares its settings.

    A topic's class takes the ``label`` and other fields of ``Topic``; its docstring is the description. ``since`` is
    the release that added the settings that state none. A subclass of a topic's class has the same settings under
    another name.
    """

    __slots__ = ()
    fields: ClassVar[tuple[Setting, ...]] = ()
    topic: ClassVar[Topic]

    def __init_subclass__(cls, label: str = "", since: str = "", **more: Any) -> None:
        super().__init_subclass__()
        own = tuple(value.placed(since) for value in vars(cls).values() if isinstance(value, Setting))
        for setting in own:
            delattr(cls, setting.key)  # so that the attribute is the value in the table
        _check_choices(cls, own)
        cls.fields = (*cls.fields, *own) if own else cls.fields
        if label:
            description = (cls.__doc__ or "").removesuffix(".")
            cls.topic = Topic(topic_key(cls.__name__), label, description, cls.fields, **more)


def topic_key(class_name: str) -> str:
    """The key of the topic of a class: ``rock_surface`` of ``RockSurfaceSettings``."""
    return re.sub(r"(?<=.)([A-Z])", r"_\1", class_name.removesuffix("Settings")).lower()


def _check_choices(table: type[Table], settings: tuple[Setting, ...]) -> None:
    """Raise ValueError unless the type of each choice names its choices in their order."""
    hints = get_type_hints(table) if any(setting.choices for setting in settings) else {}
    for setting in settings:
        if setting.choices and get_args(hints[setting.key]) != tuple(name for name, _, _ in setting.choices):
            raise ValueError(f"{table.__name__}.{setting.key}: its type and its choices differ.")

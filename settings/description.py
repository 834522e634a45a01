"""Descriptions: settings as plain data, ``{topic: {key: value}}``, checked and merged.

Blender silently clamps values that are out of range. Here an unknown key, a wrong type or a value out of range raises
:class:`~icymoon.support.errors.IcyMoonError`, which names the key, the value, the range and the unit. Float settings
are rounded to single precision, as Blender stores them. So a description has the same pair id whether it comes from the
window or from a file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from ..plugins.landforms import PREFIX, describe_missing_landform
from ..support.errors import IcyMoonError
from ..support.files import quote, shorten
from ..support.foreign_bytes import parse_toml
from ..support.suggestions import suggest_nearest
from ..support.version import is_newer, version
from . import pair_ids
from .landform_releases import check_release, fill_in_releases, keep_missing_table
from .table import TOPICS
from .topics import trust_boundary
from .topics.declaration import Parts, Setting, Value
from .topics.scene import Settings, copy_typed_table, typed

#: Minimum similarity at which an error suggests a known word for an unknown word, see ``suggestions.suggest_nearest``.
MIN_SIMILARITY = 0.4
#: Smallest magnitude that single precision rounds to infinity: its largest number plus half a step.
_ROUNDS_TO_INFINITY = 2.0**128 - 2.0**103
#: Maximum number of tables that are cached while many descriptions are read.
_MAX_CACHED_TABLES = 2000
#: Tables by topic, in which the settings of a description are collected.
Tables = dict[str, dict[str, Any]]
Made = TypeVar("Made")
#: By kind of setting: the name of its values in errors, and their types. Python's bool is also an int.
_TYPES_BY_KIND: dict[str, tuple[str, tuple[type, ...]]] = {
    "float": ("a number", (int, float)),
    "int": ("a whole number", (int,)),
    "bool": ("true or false", (bool,)),
    "text": ("a text in quotes", (str,)),
    "choice": ("a text in quotes", (str,)),
}


def defaults() -> Settings:
    """Return the complete description of a new scene."""
    return typed({topic.key: {s.key: to_canonical(s, s.default) for s in topic.settings} for topic in TOPICS.values()})


def _to_double(value: float) -> float:
    """Convert a number of any size to double precision; infinite if it is too large."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _to_single(value: float | str) -> float:
    """Round a number to single precision, then to its shortest decimal form; infinite if it is too large."""
    number = float(value)
    # A cache would confuse 0 and -0.
    return _to_single_cached(number) if number else number


@lru_cache(maxsize=4096)
def _to_single_cached(number: float) -> float:
    """Do ``_to_single`` for a number other than 0. The results are cached, because the window reads all settings at
    every redraw."""
    # numpy would warn of infinity, and np.errstate takes longer than everything else here.
    return math.copysign(math.inf, number) if abs(number) >= _ROUNDS_TO_INFINITY else float(str(np.float32(number)))


def to_canonical(setting: Setting, value: Value) -> Value:
    if isinstance(value, list):
        return [{s.key: to_canonical(s, entry[s.key]) for s in setting.entries} for entry in value]
    return _to_single(value) if setting.kind == "float" else value


def _check_list(setting: Setting, value: object, name: str, where: str, stored: bool) -> Value:
    """Check a list of tables, and complete each with the defaults, or with ``Setting.old_value`` if it was
    ``stored``."""
    if not isinstance(value, (list, tuple)) or not all(isinstance(entry, Mapping) for entry in value):
        raise IcyMoonError(f"{where}: {name} must be a list of tables, not {quote(value)}.")
    known = {s.key: s for s in setting.entries}
    missing = {key: s.old_value if stored else s.default for key, s in known.items()}
    tables = []
    for k, entry in enumerate(value):
        for key in entry:
            if key not in known:
                raise IcyMoonError(
                    f"{where}: unknown setting {name}[{k}].{shorten(key)}, "
                    f"{suggest_nearest(key, known, MIN_SIMILARITY)}"
                )
        tables.append(
            {
                key: _check_value(s, entry.get(key, missing[key]), f"{name}[{k}].{key}", where, stored)
                for key, s in known.items()
            }
        )
    return tables


def _check_value(setting: Setting, value: Any, name: str, where: str, stored: bool) -> Value:
    if setting.kind == "list":
        return _check_list(setting, value, name, where, stored)
    if setting.trust == "mark" and isinstance(value, (int, float)) and not isinstance(value, bool):
        value = repr(value)
    expected, types = _TYPES_BY_KIND[setting.kind]
    right_type = isinstance(value, types) and isinstance(value, bool) == (bool in types)
    if not right_type:
        raise IcyMoonError(f"{where}: {name} must be {expected}, not {quote(value)}.")
    if setting.kind == "choice":
        names = [choice[0] for choice in setting.choices]
        if value not in names:
            raise IcyMoonError(f"{where}: {name} is {quote(value)}, {suggest_nearest(value, names, MIN_SIMILARITY)}")
    if setting.kind == "text" and (fault := trust_boundary.find_text_fault(setting.trust, value)):
        raise IcyMoonError(f"{where}: {name} {fault}")
    if setting.kind in ("int", "float"):
        _check_range(setting, value, name, where, stored)
    return to_canonical(setting, value)


def _check_range(setting: Setting, value: float, name: str, where: str, stored: bool) -> None:
    """Raise IcyMoonError for a value out of range. A ``stored`` value must only be finite, because ranges may have
    changed since."""
    low, high, number = setting.minimum, setting.maximum, _to_double(value)
    # A limit that is rounded to single precision, as Blender stores it, is still within the range.
    inside = low <= number <= high or low <= _to_single(number) <= high
    if not inside and not (stored and math.isfinite(_to_single(number))):
        unit = f" {setting.unit}" if setting.unit not in ("", "1") else ""
        shown = f"{number:g}{unit}" if math.isfinite(number) else quote(value)
        raise IcyMoonError(f"{where}: {name} is {shown}, outside {low:g} to {high:g}{unit}.")


def check(data: Mapping[str, Any], where: str, stored: bool = False) -> Settings:
    """Check a partial description and return it in canonical form, with present names.

    Errors name ``where``: a file, ``--set``, … A description that some version has ``stored`` was valid for that
    version. So its values may be outside the present range, and invalid settings with the effect "run" are left out.
    Raises IcyMoonError for an unknown topic or key, a wrong type, a value out of range, or a text that only the user
    may set (see ``trust_boundary``).
    """
    return fill_in_releases(
        typed(_join_tables(_check_table(topic, values, where, stored) for topic, values in data.items()))
    )


def _join_tables(parts: Iterable[Tables]) -> Tables:
    """Join all tables into one description. If several contain a setting, the last value counts."""
    tables: Tables = {}
    for part in parts:
        for topic, values in part.items():
            tables.setdefault(topic, {}).update(values)
    return tables


def _check_table(topic: str, values: object, where: str, stored: bool) -> Tables:
    """Check the settings in one table of a description, and return them by their present topics; see ``check``."""
    if topic.startswith(PREFIX) and topic not in TOPICS:
        if not isinstance(values, Mapping) or not stored:
            raise IcyMoonError(f"{where}: {describe_missing_landform(topic, '')}")
        kept = keep_missing_table(topic, values, where)
        return {topic: kept} if kept else {}
    if topic not in TOPICS and not _was_renamed_topic(topic):
        raise IcyMoonError(f"{where}: unknown topic [{shorten(topic)}], {suggest_topic(topic, TOPICS, MIN_SIMILARITY)}")
    if not isinstance(values, Mapping):
        raise IcyMoonError(f"{where}: [{topic}] must be a table of settings, not {quote(values)}.")
    checked: Tables = {}
    for key, value in values.items():
        name = pair_ids.find_present_name(f"{topic}.{key}")
        setting = _find_setting(name, where)
        with suppress(IcyMoonError) if stored and setting.effect == "run" else nullcontext():
            checked.setdefault(name.partition(".")[0], {})[setting.key] = _check_value(
                setting, value, name, where, stored
            )
    if topic in TOPICS and TOPICS[topic].plugin and not stored:
        check_release(topic, values, where)
    return checked


def _was_renamed_topic(topic: str) -> bool:
    """Return whether any renamed setting belonged to this topic."""
    return any(name.startswith(f"{topic}.") for name in pair_ids.RENAMED_SETTINGS)


def suggest_topic(topic: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """Return the end of an error sentence about an unknown topic, as ``suggestions.suggest_nearest`` does.

    TOML reads a quoted name such as "terrain.size_m" as a single key, so it looks like an unknown topic.
    """
    if topic.partition(".")[0] in TOPICS:
        return f"because quotes make one name of it; write {topic} without quotes."
    return suggest_nearest(topic, known, cutoff)


def _find_setting(name: str, where: str) -> Setting:
    """Find the setting with a name. Raises IcyMoonError if no setting has it."""
    topic, _, key = name.partition(".")
    try:
        return TOPICS[topic][key]
    except KeyError:
        known = (s.key for s in TOPICS[topic].settings) if topic in TOPICS else TOPICS
        raise IcyMoonError(
            f"{where}: unknown setting {shorten(name)}, {suggest_nearest(key, known, MIN_SIMILARITY)}"
        ) from None


def restore_settings(data: Mapping[str, Any], where: str, written_by: str = "") -> Settings:
    """Restore the complete settings that some version has stored, such as in ``pair.json``; see ``check``.

    Newer settings get the values that have the effect of the version ``written_by``. Raises IcyMoonError as ``check``
    does; for a later version the error asks the user to update.
    """
    return Restorer()(data, where, written_by)


class Restorer:
    """Does ``restore_settings`` for many descriptions. Equal tables are checked once and shared by all results, so do
    not change them."""

    def __init__(self) -> None:
        self._before = _make_older_defaults()
        self._checked: dict[tuple[str, str], Tables] = {}
        self._whole: dict[tuple[str, str], Settings] = {}

    def __call__(self, data: Mapping[str, Any], where: str, written_by: str = "") -> Settings:
        """Restore the complete settings, see ``restore_settings``."""
        with ask_to_update(where, written_by):
            stated = _join_tables(self._check_once(topic, values, where) for topic, values in data.items())
        whole = Settings(self._before)
        for topic, values in stated.items():
            whole |= self._complete_once(topic, values)
        return whole

    def _check_once(self, topic: str, values: object, where: str) -> Tables:
        return _make_once(self._checked, topic, values, lambda: _check_table(topic, values, where, stored=True))

    def _complete_once(self, topic: str, values: Mapping[str, Any]) -> Settings:
        """Return a topic's table with its missing settings filled in from ``_make_older_defaults``. Equal tables get
        the same cached result."""
        return _make_once(
            self._whole, topic, values, lambda: merged({topic: self._before.get(topic, {})}, {topic: values})
        )


def _make_once(known: dict[tuple[str, str], Made], topic: str, values: object, make: Callable[[], Made]) -> Made:
    """Return the result of ``make`` for a table; equal tables get the same cached result."""
    content = repr(values)  # tells 1 from 1.0 and from true, and 0.0 from -0.0
    if (topic, content) not in known:
        if len(known) >= _MAX_CACHED_TABLES:
            known.clear()
        known[topic, content] = make()
    return known[topic, content]


def _make_older_defaults() -> Settings:
    """Make the complete description in which every newer setting has the effect of versions without it."""
    return typed(
        {topic.key: {s.key: to_canonical(s, s.old_value) for s in topic.settings} for topic in TOPICS.values()}
    )


@contextmanager
def ask_to_update(where: str, written_by: str) -> Iterator[None]:
    """Make errors in this context ask the user to update Icy Moon, if a later version wrote the file."""
    try:
        yield
    except IcyMoonError as error:
        if not is_newer(written_by):
            raise
        raise IcyMoonError(
            f"{where}: was saved by Icy Moon {written_by} and this is {version()}; update Icy Moon to "
            f"load it ({str(error).removeprefix(f'{where}: ').rstrip('.')})."
        ) from None


def merged(*parts: Parts) -> Settings:
    """Merge partial descriptions into one. Later descriptions override earlier ones."""
    result = Settings()
    for part in parts:
        for topic, values in part.items():
            result.setdefault(topic, copy_typed_table(topic, {})).update(copy_typed_table(topic, values))
    return fill_in_releases(result)


def overlay(base: Settings, part: Parts) -> Settings:
    """Override ``base`` by the partial description ``part``, like ``merged``. The result shares unchanged tables with
    ``base``.
    """
    return Settings({**base, **merged({topic: base.get(topic, {}) for topic in part}, part)})


def changed(settings: Mapping[str, Mapping[str, Value]], base: Mapping[str, Mapping[str, Value]]) -> Settings:
    """Return the settings that ``base`` lacks or has with another value."""
    found = Settings()
    for topic, values in settings.items():
        for key, value in values.items():
            if key not in base.get(topic, {}) or base[topic][key] != value:
                found.setdefault(topic, copy_typed_table(topic, {}))[key] = value
    return found


def override(text: str, where: str = "") -> Settings:
    """Parse ``topic.key=value`` as a partial description. The value is text for a text or choice, otherwise TOML.

    Raises IcyMoonError as ``check`` does; the sentence begins with ``where``, by default --set with the text.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    topic_key, dot, key = name.partition(".")
    if not (equals and dot):
        raise IcyMoonError(f"--set {shorten(text)}: write it as topic.key=value, as in terrain.size_m=20.")
    topic = TOPICS.get(topic_key)
    known = {s.key: s for s in topic.settings} if topic else {}
    parsed: object
    if key in known and known[key].kind in ("text", "choice"):
        parsed = value.strip("\"'")
    else:
        try:
            parsed = parse_toml(f"value = {value}")["value"]
        except ValueError:
            parsed = value
    return check({topic_key: {key: parsed}}, where or f"--set {shorten(text)}")

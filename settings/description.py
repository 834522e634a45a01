"""Scene descriptions as plain data: ``{topic: {key: value}}``, checked, combined and named by an id.

Blender clamps what is out of range without a word; nothing here does. An unknown key, a wrong type
or a value out of range is an :class:`~icymoon.errors.IcyMoonError` that names the key, the value,
the range and the unit. A float setting is a single-precision number, as Blender stores it, so that
a description has one spelling (and one pair id) whether it comes from the window or from a file.
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from typing import Any

import numpy as np

from ..errors import IcyMoonError
from ..suggestions import nearest
from ..typed_settings import Settings, typed, typed_table
from ..version import is_newer, version
from . import pair_ids, trust_boundary
from .table import TOPICS, Setting, Value

#: How like a known word an unknown one must be for the error to name it; see ``suggestions.nearest``.
LIKE = 0.4
#: From here on single precision rounds to infinity: its largest number and half a step.
_INFINITE = 2.0**128 - 2.0**103


def defaults() -> Settings:
    """The complete description that a new scene has."""
    return typed({topic.key: {s.key: canonical(s, s.default) for s in topic.settings} for topic in TOPICS.values()})


def _number(value: float) -> float:
    """A number of any size; infinite if no double holds it."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _single(value: Any) -> float:
    """The number that single precision makes of it, by its shortest spelling; infinite if it holds it not."""
    number = float(value)
    # numpy would warn of infinity, and leaving that out by np.errstate takes longer than all else here.
    return math.copysign(math.inf, number) if abs(number) >= _INFINITE else float(str(np.float32(number)))


def canonical(setting: Setting, value: Any) -> Value:
    if setting.kind == "float":
        return _single(value)
    if setting.kind == "list":
        return [{s.key: canonical(s, entry[s.key]) for s in setting.entries} for entry in value]
    return value


def _checked_list(setting: Setting, value: Any, name: str, where: str, stored: bool) -> Value:
    """A list of tables, each completed with the defaults of its entries, or what was done before they were there."""
    if not isinstance(value, (list, tuple)) or not all(isinstance(entry, Mapping) for entry in value):
        raise IcyMoonError(f"{where}: {name} must be a list of tables, not {value!r}.")
    known = {s.key: s for s in setting.entries}
    missing = {key: pair_ids.before(f"{name}.{key}", s) if stored else s.default for key, s in known.items()}
    tables = []
    for k, entry in enumerate(value):
        for key in entry:
            if key not in known:
                raise IcyMoonError(f"{where}: unknown setting {name}[{k}].{key}, {nearest(key, known, LIKE)}")
        tables.append({key: _checked(s, entry.get(key, missing[key]), f"{name}[{k}].{key}", where, stored)
                       for key, s in known.items()})
    return tables


def _checked(setting: Setting, value: Any, name: str, where: str, stored: bool) -> Value:
    if setting.kind == "list":
        return _checked_list(setting, value, name, where, stored)
    expected = {"float": "a number", "int": "a whole number", "bool": "true or false",
                "text": "a text in quotes", "choice": "a text in quotes"}[setting.kind]
    right_type = {"float": isinstance(value, (int, float)) and not isinstance(value, bool),
                  "int": isinstance(value, int) and not isinstance(value, bool),
                  "bool": isinstance(value, bool),
                  "text": isinstance(value, str), "choice": isinstance(value, str)}[setting.kind]
    if not right_type:
        raise IcyMoonError(f"{where}: {name} must be {expected}, not {value!r}.")
    if setting.kind == "choice":
        names = [choice[0] for choice in setting.choices]
        if value not in names:
            raise IcyMoonError(f"{where}: {name} is {value!r}, {nearest(value, names, LIKE)}")
    if setting.kind == "text" and (fault := trust_boundary.fault(setting.trust, value)):
        raise IcyMoonError(f"{where}: {name} {fault}")
    if setting.kind in ("int", "float"):
        _check_range(setting, value, name, where, stored)
    return canonical(setting, value)


def _check_range(setting: Setting, value: float, name: str, where: str, stored: bool) -> None:
    """What was stored may lie beyond what is accepted today; a number it must be."""
    low, high, number = setting.minimum, setting.maximum, _number(value)
    # The ends are single-precision numbers too: what is an end there is none too large here.
    inside = low <= number <= high or low <= _single(number) <= high
    if not inside and not (stored and math.isfinite(_single(number))):
        unit = f" {setting.unit}" if setting.unit not in ("", "1") else ""
        raise IcyMoonError(f"{where}: {name} is {number:g}{unit}, outside {low:g} to {high:g}{unit}.")


def check(data: Mapping[str, Any], where: str, stored: bool = False) -> Settings:
    """Check a partial description and return it in canonical form, by the names of today.

    ``where`` is what the error names as the place (a file, ``--set``, …). Of what a version has ``stored``, for which
    all was accepted then, a value may lie outside of today's range, settings of how to run that are of no use here are
    left out, and settings that there are no more stay.
    Raises IcyMoonError for an unknown topic or key, a wrong type, a value out of range, or a text that names what
    only the user may (see ``trust_boundary``).
    """
    checked: dict[str, dict[str, Any]] = {}
    for topic, key, value in _stated(data, where):
        name = pair_ids.present_name(f"{topic}.{key}")
        if name in pair_ids.SCHEMA["gone"]:
            if stored:
                checked.setdefault(topic, {})[key] = value
            elif value != pair_ids.SCHEMA["gone"][name]:
                raise IcyMoonError(f"{where}: {name} is {value!r}, and there is nothing but "
                                   f"{pair_ids.SCHEMA['gone'][name]!r} any more.")
            continue
        setting = _setting(name, where)
        with suppress(IcyMoonError) if stored and setting.effect == "run" else nullcontext():
            checked.setdefault(name.partition(".")[0], {})[setting.key] = _checked(setting, value, name, where, stored)
    return typed(checked)


def _stated(data: Mapping[str, Any], where: str) -> Iterator[tuple[str, str, Any]]:
    """(topic, key, value) of everything in a description."""
    once = {name.partition(".")[0] for name in (*pair_ids.SCHEMA["renamed"], *pair_ids.SCHEMA["gone"])}
    for topic, values in data.items():
        if topic not in TOPICS and topic not in once:
            raise IcyMoonError(f"{where}: unknown topic [{topic}], {nearest(topic, TOPICS, LIKE)}")
        if not isinstance(values, Mapping):
            raise IcyMoonError(f"{where}: [{topic}] must be a table of settings, not {values!r}.")
        yield from ((topic, key, value) for key, value in values.items())


def _setting(name: str, where: str) -> Setting:
    """The setting of a name. Raises IcyMoonError if there is none."""
    topic, _, key = name.partition(".")
    try:
        return TOPICS[topic][key]
    except KeyError:
        known = (s.key for s in TOPICS[topic].settings) if topic in TOPICS else TOPICS
        raise IcyMoonError(f"{where}: unknown setting {name}, {nearest(key, known, LIKE)}") from None


def restored(data: Mapping[str, Any], where: str, written_by: str = "") -> Settings:
    """The complete settings that some version has stored, such as in ``pair.json``; see ``check``.

    What was not there yet has the value that means what was done then. ``written_by`` is that version. Raises
    IcyMoonError as ``check``; if a later version wrote it, that states to update.
    """
    with told_to_update(where, written_by):
        return merged(_before(), check(data, where, stored=True))


def _before() -> Settings:
    """The complete description of what was done before anything was added."""
    return typed({topic.key: {s.key: canonical(s, pair_ids.before(f"{topic.key}.{s.key}", s)) for s in topic.settings}
                  for topic in TOPICS.values()})


@contextmanager
def told_to_update(where: str, written_by: str) -> Iterator[None]:
    """Say of what is refused inside that it is of a later version, if it is."""
    try:
        yield
    except IcyMoonError as error:
        if not is_newer(written_by):
            raise
        raise IcyMoonError(f"{where}: was saved by Icy Moon {written_by} and this is {version()}; update Icy Moon to "
                           f"load it ({str(error).removeprefix(f'{where}: ').rstrip('.')}).") from None


def merged(*parts: Mapping[str, Mapping[str, Value]]) -> Settings:
    """One description from several partial ones, the later ones winning."""
    result = Settings()
    for part in parts:
        for topic, values in part.items():
            result.setdefault(topic, typed_table(topic, {})).update(typed_table(topic, values))
    return result


def changed(settings: Mapping[str, Mapping[str, Value]], base: Mapping[str, Mapping[str, Value]]) -> Settings:
    """What has to be put over ``base`` to have these settings: those of other values, or not in it."""
    found = Settings()
    for topic, values in settings.items():
        for key, value in values.items():
            if key not in base.get(topic, {}) or base[topic][key] != value:
                found.setdefault(topic, typed_table(topic, {}))[key] = value
    return found


def override(text: str) -> Settings:
    """The partial description that ``topic.key=value`` states; the value is read as TOML,
    or as a text where the setting is one."""
    name, equals, value = (part.strip() for part in text.partition("="))
    topic_key, dot, key = name.partition(".")
    if not (equals and dot):
        raise IcyMoonError(f"--set {text}: write it as topic.key=value, as in terrain.size_m=20.")
    topic = TOPICS.get(topic_key)
    known = {s.key: s for s in topic.settings} if topic else {}
    parsed: Any
    if key in known and known[key].kind in ("text", "choice"):
        parsed = value.strip("\"'")
    else:
        try:
            parsed = tomllib.loads(f"value = {value}")["value"]
        except (ValueError, RecursionError):
            parsed = value
    return check({topic_key: {key: parsed}}, f"--set {text}")


def digest(settings: Mapping[str, Mapping[str, Value]], extra: str = "") -> str:
    """Twelve hexadecimal digits that name the pair which these settings produce.

    Settings that cannot change a rendered pixel (camera response, folders, threads) do not count,
    nor where a file lies, nor what a version added where it is as it was before (see ``schema``).
    ``extra`` stands for content that the settings do not describe (that of the ground's file, edited
    or added geometry).
    """
    first, *later = pair_ids.counted(settings)
    return hashlib.sha256(json.dumps([first, extra, *later]).encode()).hexdigest()[:12]

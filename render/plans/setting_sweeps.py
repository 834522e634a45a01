"""The ``[[sweep]]`` tables of a plan that vary settings, and their variations. Imports no Blender."""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...formats.toml_lines import Place
from ...physics.random_numbers import sampling
from ...physics.random_numbers.seeds import make_generator
from ...settings.description import check, merged, suggest_topic
from ...settings.preset_files import find_preset, load
from ...settings.table import TOPICS
from ...settings.topics.declaration import Parts, Setting
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import is_number
from ...support.files import parse_path, quote, shorten
from ...support.suggestions import suggest_nearest

#: Kinds of sweeps that vary settings; ``pose_sweeps.KINDS`` are the others.
KINDS = ("grid", "one_at_a_time", "cases", "random", "sobol", "latin_hypercube")
#: The kinds that draw values, with their generators.
DRAWN_KINDS = {
    "random": sampling.draw_independent,
    "sobol": sampling.draw_sobol,
    "latin_hypercube": sampling.draw_latin_hypercube,
}
_PRESET_KEY, _PRESETS_KEY = "preset", "presets"
#: Most pairs of a plan; more pairs are a mistake, or several data sets.
MAX_PAIRS = 100000
#: Largest number of pairs that a sentence states exactly, since the number may have a million digits.
_MAX_STATED = 10**12
#: Settings that a sweep may not vary, with the reason and the fix.
NOT_SWEPT = {
    "response": "is applied when images are evaluated and needs no new render; state it there with --set",
    "run": "changes no pair; state it once, outside the sweeps",
}


@dataclass(frozen=True)
class Sweep:
    """A ``[[sweep]]`` table: its kind, its name (given or automatic), its other keys and its position in the file."""

    kind: str
    name: str
    table: Mapping[str, Any]
    place: Place


@dataclass(frozen=True)
class Variation:
    """The settings of one variation of a sweep, and its position in the file."""

    settings: Parts
    place: Place


def check_keys(table: Mapping[str, Any], known: Sequence[str], place: Place, what: str) -> None:
    """Raise IcyMoonError if a table has an unknown key."""
    for key in table:
        if key not in known:
            raise IcyMoonError(f"{place.at(key)}: {what} has no {shorten(key)}, {suggest_nearest(key, known)}")


def check_settings(data: Mapping[str, Any], place: Place) -> Settings:
    """Check some settings that a plan states at ``place``, and return them.

    Raises IcyMoonError that names the line of the setting at fault.
    """
    parts = []
    for topic, values in data.items():
        if topic not in TOPICS or not isinstance(values, Mapping):
            check({topic: values}, str(place.at(topic)))
        for key, value in values.items():
            try:
                parts.append(check({topic: {key: value}}, "plan"))
            except IcyMoonError:
                # Checked again to name the line, which is slow to find.
                check({topic: {key: value}}, str(place.at(topic, key)))
    return merged(*parts)


def load_included(name: object, place: Place) -> Settings:
    """Load the settings of a shipped preset, or of a settings file beside the plan, if the name ends in .toml."""
    if not isinstance(name, str):
        raise IcyMoonError(f"{place}: a preset is named by a text in quotes, not {quote(name)}.")
    try:
        return load(place.file.parent / parse_path(name, "The preset") if name.endswith(".toml") else find_preset(name))
    except IcyMoonError as error:
        raise IcyMoonError(f"{place}: {error}") from None


def make_axis_generator(sweep: Sweep, axis: str, seed: int) -> np.random.Generator:
    """Make the random generator of one axis of a sweep. It depends on names, so other sweeps leave it unchanged."""
    return make_generator(seed, "plan", zlib.crc32(sweep.name.encode()), zlib.crc32(axis.encode()))


def read_count(sweep: Sweep) -> int:
    """Read the ``count`` that a sweep must state. Raises IcyMoonError if it is not a whole number from 1 up."""
    value = sweep.table.get("count")
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        problem = "is missing" if value is None else f"is {quote(value)}"
        raise IcyMoonError(f"{sweep.place.at('count')}: count {problem}, but must be a whole number from 1 up.")
    check_pair_count(value, sweep.place.at("count"))
    return value


def check_pair_count(pairs: int, place: Place) -> None:
    """Raise IcyMoonError if there are more pairs than a plan may have."""
    if pairs > MAX_PAIRS:
        count = f"{pairs} pairs, more than" if pairs < _MAX_STATED else "far more pairs than"
        raise IcyMoonError(
            f"{place}: the sweeps combine to {count} {MAX_PAIRS}; list fewer values, or "
            "draw fewer with a random, sobol or latin_hypercube sweep."
        )


def _find_setting(topic: str, key: str, place: Place) -> Setting:
    """Find the setting that a factor names. Raises IcyMoonError for an unknown setting, and for one that a sweep may
    not vary."""
    if topic not in TOPICS:
        raise IcyMoonError(f"{place}: unknown topic {shorten(topic)}, {suggest_topic(topic, TOPICS)}")
    known = {s.key: s for s in TOPICS[topic].settings}
    if key not in known:
        raise IcyMoonError(f"{place}: unknown setting {topic}.{shorten(key)}, {suggest_nearest(key, known)}")
    if known[key].effect in NOT_SWEPT:
        raise IcyMoonError(f"{place}: {topic}.{key} {NOT_SWEPT[known[key].effect]}.")
    return known[key]


def _read_factors(sweep: Sweep, also: Sequence[str]) -> list[tuple[str, Setting | None, Any, Place]]:
    """Read the factors that a sweep varies: for each, its name, its setting (None for presets), its stated value and
    its place."""
    found: list[tuple[str, Setting | None, Any, Place]] = []
    for topic, values in sweep.table.items():
        if topic in also:
            continue
        place = sweep.place.at(topic)
        if topic == _PRESET_KEY:
            found.append((_PRESET_KEY, None, values, place))
            continue
        if topic == _PRESETS_KEY and isinstance(values, Mapping):
            found += [(f"{_PRESETS_KEY}.{key}", None, stated, place.at(key)) for key, stated in values.items()]
            continue
        if topic not in (_PRESETS_KEY, *TOPICS):
            raise IcyMoonError(
                f"{place}: a {sweep.kind} sweep has no {shorten(topic)}, {suggest_topic(topic, [*also, *TOPICS])}"
            )
        if topic == _PRESETS_KEY:
            raise IcyMoonError(
                f"{place}: presets has lists under your names, such as presets.sensor; a single list is called preset."
            )
        if not isinstance(values, Mapping):
            raise IcyMoonError(
                f"{place}: {topic} is a topic; name a setting of it, such as {topic}.{TOPICS[topic].settings[0].key}."
            )
        found += [
            (f"{topic}.{key}", _find_setting(topic, key, place.at(key)), stated, place.at(key))
            for key, stated in values.items()
        ]
    if not found:
        raise IcyMoonError(
            f"{sweep.place}: this {sweep.kind} sweep varies nothing; name a setting, such as light.sun_elevation_deg."
        )
    return found


def _read_part(name: str, value: object, place: Place) -> Settings:
    """Read the settings that a factor's value sets."""
    if name.split(".")[0] in (_PRESET_KEY, _PRESETS_KEY):
        return load_included(value, place)
    topic, key = name.split(".")
    return check_settings({topic: {key: value}}, Place(place.file, place.text, place.key[:-2]))


def _read_listed(sweep: Sweep) -> list[list[Variation]]:
    """List the variations of each factor of a sweep that lists values."""
    factors = []
    for name, setting, values, place in _read_factors(sweep, ()):
        if not isinstance(values, list) or not values:
            raise IcyMoonError(
                f"{place}: {name} must list its values in turn, as in [{getattr(setting, 'default', 'a preset')!r}, "
                f"…], not {quote(values)}."
            )
        factors.append([Variation(_read_part(name, value, place), place) for value in values])
    return factors


def _join_variations(parts: Iterable[Variation], place: Place) -> Variation:
    return Variation(merged(*(part.settings for part in parts)), place)


def _make_grid(sweep: Sweep, base: Settings) -> list[Variation]:
    factors = _read_listed(sweep)
    check_pair_count(math.prod(map(len, factors)), sweep.place)
    return [_join_variations(chosen, sweep.place) for chosen in itertools.product(*factors)]


def _make_one_at_a_time(sweep: Sweep, base: Settings) -> list[Variation]:
    each = [v for factor in _read_listed(sweep) for v in factor]
    other = [v for v in each if any(base[t][k] != x for t, values in v.settings.items() for k, x in values.items())]
    return [Variation({}, sweep.place), *other]


def _make_cases(sweep: Sweep, base: Settings) -> list[Variation]:
    check_keys(sweep.table, ("case",), sweep.place, "a cases sweep")
    cases, place = sweep.table.get("case"), sweep.place.at("case")
    if not isinstance(cases, list) or not cases or not all(isinstance(case, Mapping) for case in cases):
        raise IcyMoonError(
            f"{place}: a cases sweep lists settings that change together: case = [{{ light.sun_elevation_deg = 30, "
            "light.sun_azimuth_deg = 90 }, …]."
        )
    made = []
    for k, case in enumerate(cases):
        if not case:
            raise IcyMoonError(f"{place.at(k)}: this case sets nothing; name a setting or a preset.")
        presets = case.get(_PRESET_KEY, [])
        presets = presets if isinstance(presets, list) else [presets]
        stated = {topic: values for topic, values in case.items() if topic != _PRESET_KEY}
        for topic, values in stated.items():
            for key in values if isinstance(values, Mapping) else ():
                _find_setting(topic, key, place.at(k))
        made.append(
            Variation(
                merged(
                    *(load_included(name, place.at(k, _PRESET_KEY)) for name in presets),
                    check_settings(stated, place.at(k)),
                ),
                place.at(k),
            )
        )
    return made


def _read_law(name: str, setting: Setting | None, law: object, place: Place, kind: str) -> Callable[[Array], list[Any]]:
    """Read a factor's distribution from the plan. Return a function that turns fractions from 0 to 1 into values of the
    factor."""
    stated = dict(law) if isinstance(law, Mapping) else {}
    within = stated.pop("within", None)
    if len(stated) != 1 or (within is not None and "normal" not in stated):
        raise IcyMoonError(
            f"{place}: {name} in a {kind} sweep is drawn from a distribution, one of "
            "{ uniform = [low, high] }, { log_uniform = [low, high] }, "
            "{ normal = [mean, deviation], within = [low, high] } or { choice = [values] }."
        )
    [(law_name, numbers)] = stated.items()
    if law_name == "choice":
        if not isinstance(numbers, list) or not numbers:
            raise IcyMoonError(f"{place}: choice of {name} must list values, not {quote(numbers)}.")
        return lambda fraction: [numbers[k] for k in sampling.to_whole_numbers(fraction, 0, len(numbers) - 1)]
    if law_name not in ("uniform", "log_uniform", "normal"):
        raise IcyMoonError(
            f"{place}: there is no distribution {shorten(law_name)}, "
            f"{suggest_nearest(law_name, ('uniform', 'log_uniform', 'normal', 'choice'))}"
        )
    if setting is None or setting.kind not in ("int", "float"):
        raise IcyMoonError(f"{place}: {name} is not a number; draw it with {{ choice = [values] }}.")
    first, second = _read_two_numbers(numbers, f"{law_name} of {name}", place)
    if law_name == "normal":
        limits = (
            (setting.minimum, setting.maximum)
            if within is None
            else _read_two_numbers(within, f"within of {name}", place)
        )
        return _read_normal(setting, name, (first, second), limits, place)
    _check_range(setting, name, first, second, place)
    if law_name == "log_uniform" and first <= 0:
        raise IcyMoonError(f"{place}: log_uniform of {name} begins at {first:g}, but must begin above 0.")
    if setting.kind == "int" and law_name == "uniform":
        return lambda fraction: [int(v) for v in sampling.to_whole_numbers(fraction, int(first), int(second))]
    draw = sampling.to_uniform if law_name == "uniform" else sampling.to_log_uniform
    return lambda fraction: _round_values(setting, draw(fraction, first, second))


def _read_normal(
    setting: Setting, name: str, law: tuple[float, float], limits: tuple[float, float], place: Place
) -> Callable[[Array], list[Any]]:
    _check_range(setting, name, *limits, place)
    if law[1] <= 0:
        raise IcyMoonError(f"{place}: the deviation of {name} is {law[1]:g}, but must be above 0.")
    try:
        sampling.to_normal(np.array([0.5]), *law, *limits)
    except ValueError:
        raise IcyMoonError(
            f"{place}: the normal distribution of {name} has almost no values within {limits[0]:g} to "
            f"{limits[1]:g}; widen within."
        ) from None
    return lambda fraction: _round_values(setting, sampling.to_normal(fraction, *law, *limits))


def _round_values(setting: Setting, values: Array) -> list[Any]:
    """Round values for the setting: whole numbers, or six digits, which keeps a file of settings legible."""
    if setting.kind == "int":
        return [round(v) for v in values.tolist()]
    return [float(f"{v:.6g}") for v in values.tolist()]


def _read_two_numbers(numbers: object, what: str, place: Place) -> tuple[float, float]:
    if not isinstance(numbers, list) or len(numbers) != 2 or not all(map(is_number, numbers)):
        raise IcyMoonError(f"{place}: {what} must be two numbers, not {quote(numbers)}.")
    return float(numbers[0]), float(numbers[1])


def _check_range(setting: Setting, name: str, low: float, high: float, place: Place) -> None:
    if not low < high:
        raise IcyMoonError(f"{place}: {name} goes from {low:g} to {high:g}; the first must be below the second.")
    for end in (low, high):
        if not setting.minimum <= end <= setting.maximum:
            unit = f" {setting.unit}" if setting.unit not in ("", "1") else ""
            raise IcyMoonError(
                f"{place}: {name} goes from {low:g} to {high:g}{unit}, outside {setting.minimum:g} to "
                f"{setting.maximum:g}{unit}."
            )


def _make_drawn(sweep: Sweep, base: Settings) -> list[Variation]:
    count = read_count(sweep)
    factors = _read_factors(sweep, ("count",))
    if sweep.kind == "sobol" and len(factors) > sampling.MAX_DIMENSIONS:
        raise IcyMoonError(
            f"{sweep.place}: a sobol sweep varies up to {sampling.MAX_DIMENSIONS} settings, not "
            f"{len(factors)}; use latin_hypercube."
        )
    seed = int(base.dataset.seed)
    fractions = DRAWN_KINDS[sweep.kind](count, [make_axis_generator(sweep, name, seed) for name, *_ in factors])
    columns = []
    for axis, (name, setting, law, place) in enumerate(factors):
        values = _read_law(name, setting, law, place, sweep.kind)(fractions[:, axis])
        columns.append([Variation(_read_part(name, value, place), place) for value in values])
    return [_join_variations(row, sweep.place) for row in zip(*columns, strict=True)]


_MAKER_BY_KIND: dict[str, Callable[[Sweep, Settings], list[Variation]]] = {
    "grid": _make_grid,
    "one_at_a_time": _make_one_at_a_time,
    "cases": _make_cases,
    **dict.fromkeys(DRAWN_KINDS, _make_drawn),
}


def make_setting_variations(sweep: Sweep, base: Settings) -> list[Variation]:
    """Make the variations of a sweep of one of ``KINDS``, over complete settings.

    Raises IcyMoonError that names the line at fault.
    """
    return _MAKER_BY_KIND[sweep.kind](sweep, base)

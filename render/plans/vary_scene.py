"""The plan that varies some settings of one scene: its TOML text and its number of pairs. Imports no Blender.

The scene is given by its complete settings, whatever its preset. The text states all of them, so the plan makes the
same pairs everywhere.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...formats.toml_lines import Place
from ...settings.description import check, merged
from ...settings.table import TOPICS, list_all_settings
from ...settings.toml_text import to_toml, to_toml_value
from ...settings.topics.declaration import Parts, Setting
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.files import shorten
from ...support.number_text import format_count
from ...support.suggestions import suggest_nearest
from ...support.version import version
from . import setting_sweeps
from .combine import list_seeds
from .planned_pair import expand_headings
from .setting_sweeps import MAX_PAIRS, NOT_SWEPT, Sweep

#: Ways to combine settings, and ways to space the values of a number.
COMBINATIONS = ("GRID", "ONE_AT_A_TIME", "SOBOL")
SPACINGS = ("EVEN", "RATIO", "RANDOM")
#: The place that errors name.
WHERE = "Vary This Scene"
#: A prime number as the step between the pairs of a sample, so that the sample has all values of each setting.
_SAMPLE_STRIDE = 7919
_SETTING_BY_NAME = {f"{topic}.{setting.key}": setting for topic, setting in list_all_settings()}
#: Settings of the data set that a plan states; the others are about the render and its folder.
_STATED_DATASET_KEYS = ("seed", "headings")


@dataclass(frozen=True)
class VariedSetting:
    """The values of one setting, ``topic.key``.

    A number has ``count`` values from ``first`` to ``last``, at even steps, at even ratios, or at random between them.
    A choice has the ``values``. A boolean has both values.
    """

    name: str
    first: float = 0.0
    last: float = 0.0
    count: int = 5
    spacing: str = SPACINGS[0]
    values: tuple[str, ...] = ()

    @property
    def setting(self) -> Setting:
        """Declaration of the setting. Raises IcyMoonError for an unknown name, and for a setting that cannot vary."""
        setting = _SETTING_BY_NAME.get(self.name)
        if setting is None:
            name = shorten(self.name)  # anybody's .blend file may state the name
            raise IcyMoonError(f"{WHERE}: unknown setting {name!r}, {suggest_nearest(name, _SETTING_BY_NAME)}")
        if why := why_fixed(*self.name.split(".")):
            raise IcyMoonError(f"{WHERE}: {self.name} {why}.")
        return setting


@dataclass(frozen=True)
class SceneVariations:
    """The varied settings of a scene, the way to combine them, the number of ``draws`` of a Sobol sequence, and the
    number of ``seeds``. The first seed is the scene's own."""

    varied: tuple[VariedSetting, ...]
    combine: str = COMBINATIONS[0]
    draws: int = 16
    seeds: int = 1


def why_fixed(topic: str, key: str) -> str:
    """Return the reason why a setting cannot vary, as the end of a sentence; empty if it can."""
    setting = TOPICS[topic][key]
    if (topic, key) == ("dataset", "seed"):
        return "varies by the number of seeds; raise Variations by Seed"
    if (topic, key) == ("dataset", "headings"):
        return "is a number of pairs by itself; set it in the panel Data Set"
    if setting.effect in NOT_SWEPT:
        return NOT_SWEPT[setting.effect]
    if setting.kind in ("text", "list"):
        return "is not a number, choice or tick, so no values lie between two others"
    return ""


def list_variable_settings() -> list[str]:
    """List the settings that can vary, as ``topic.key``, in the order of the sidebar."""
    return [name for name in _SETTING_BY_NAME if not why_fixed(*name.split("."))]


def make_default_variation(name: str, value: float | str) -> VariedSetting:
    """Make a setting vary about its present value. A number varies from half to twice its value, or over a quarter of
    its slider's range if it is 0; it stays within that range if its value does. A choice has all its values.

    Whole numbers have the default number of values, if the range contains that many.
    """
    setting = VariedSetting(name).setting
    if isinstance(value, str):
        return VariedSetting(name, values=tuple(choice[0] for choice in setting.choices))
    if setting.kind == "bool":
        return VariedSetting(name)
    low, high = setting.soft or (setting.minimum, setting.maximum)
    if not low <= value <= high:
        low, high = setting.minimum, setting.maximum
    ends = sorted((value / 2, value * 2)) if value else (0.0 if low >= 0 else low / 4, high / 4)
    first, last = (min(max(_round_value(setting, end, 3), low), high) for end in ends)
    if setting.kind == "int":
        last = min(max(last, first + VariedSetting.count - 1), high)
        first = max(min(first, last - VariedSetting.count + 1), low)
        return VariedSetting(name, int(first), int(last))
    if first == last:  # the value is at the end of its range
        first, last = max(first - 1, low), min(last + 1, high)
    return VariedSetting(name, first, last)


def _round_value(setting: Setting, value: float, digits: int = 6) -> float:
    return round(value) if setting.kind == "int" else float(f"{value:.{digits}g}")


def list_values(varied: VariedSetting) -> list[Any]:
    """List the values of a setting that does not vary at random, each once. Raises IcyMoonError as ``check_varied``
    does."""
    setting = check_varied(varied)
    if setting.kind == "choice":
        return list(varied.values)
    if setting.kind == "bool":
        return [False, True]
    first, last, steps = varied.first, varied.last, varied.count - 1
    if varied.spacing == "RATIO":
        between = [first * (last / first) ** (k / steps) for k in range(1, steps)]
    else:
        between = [first + (last - first) * k / steps for k in range(1, steps)]
    low, high = sorted((first, last))
    inside = [min(max(_round_value(setting, value), low), high) for value in between]
    return list(dict.fromkeys([first, *inside, last]))


def check_varied(varied: VariedSetting) -> Setting:
    """Check a varied setting, and return its declaration. Raises IcyMoonError that names it, the value and the
    range.
    """
    setting, name = varied.setting, varied.name
    topic, _, key = name.partition(".")
    if setting.kind == "choice":
        for value in varied.values:
            check({topic: {key: value}}, WHERE)
        if len(set(varied.values)) < 2:
            raise IcyMoonError(f"{WHERE}: {name} has {len(set(varied.values))} of its values; tick two or more.")
        return setting
    if setting.kind == "bool":
        return setting
    for end in (varied.first, varied.last):
        check({topic: {key: end}}, WHERE)
    if varied.first == varied.last:
        raise IcyMoonError(f"{WHERE}: {name} goes from {varied.first:g} to {varied.last:g}; give two different ends.")
    if not 2 <= varied.count <= MAX_PAIRS:
        raise IcyMoonError(f"{WHERE}: {name} has {format_count(varied.count, 'value')}; give 2 to {MAX_PAIRS}.")
    if varied.spacing == "RATIO" and min(varied.first, varied.last) <= 0:
        raise IcyMoonError(
            f"{WHERE}: {name} goes from {varied.first:g} to {varied.last:g}; even ratios need two ends above 0."
        )
    return setting


@dataclass(frozen=True)
class _Factor:
    """A sweep of the plan: its table, its number of variations, and a text that describes them."""

    table: dict[str, Any]
    size: int
    text: str


def _make_factors(settings: Settings, variations: SceneVariations) -> list[_Factor]:
    """Make the sweeps of the plan. Raises IcyMoonError for settings that cannot be combined."""
    varied = variations.varied
    names = [each.name for each in varied]
    for name in names:
        if names.count(name) > 1:
            raise IcyMoonError(f"{WHERE}: {name} is listed {names.count(name)} times; remove all but one.")
    if not varied:
        return []
    if variations.combine == "SOBOL":
        what = find_label(names[0]) if len(varied) == 1 else f"{len(varied)} settings"
        table = _make_sweep_table(
            "sobol", "draws", {each.name: _make_law(each) for each in varied}, count=variations.draws
        )
        return [_Factor(table, variations.draws, f"{format_count(variations.draws, 'draw')} of {what}")]
    if variations.combine == "ONE_AT_A_TIME":
        return [_make_one_at_a_time(settings, varied)]
    return [_make_grid_factor(each) for each in varied]


def _make_grid_factor(varied: VariedSetting) -> _Factor:
    if _is_drawn(varied):
        table = _make_sweep_table("random", varied.name, {varied.name: _make_law(varied)}, count=varied.count)
        return _Factor(
            table, varied.count, f"{format_count(varied.count, 'random value')} of {find_label(varied.name)}"
        )
    values = list_values(varied)
    return _Factor(
        _make_sweep_table("grid", varied.name, {varied.name: values}),
        len(values),
        f"{format_count(len(values), 'value')} of {find_label(varied.name)}",
    )


def _make_one_at_a_time(settings: Settings, varied: Sequence[VariedSetting]) -> _Factor:
    listed = {}
    for each in varied:
        if _is_drawn(each):
            raise IcyMoonError(
                f"{WHERE}: {each.name} is random, but One at a Time takes listed values; choose even steps or even "
                "ratios."
            )
        listed[each.name] = list_values(each)
    others = sum(
        value != settings[topic][key]
        for name, values in listed.items()
        for topic, _, key in [name.partition(".")]
        for value in values
    )
    return _Factor(
        _make_sweep_table("one_at_a_time", "one at a time", listed),
        1 + others,
        f"{format_count(1 + others, 'scene')}, one setting at a time",
    )


def _is_drawn(varied: VariedSetting) -> bool:
    return check_varied(varied).kind in ("int", "float") and varied.spacing == "RANDOM"


def _make_law(varied: VariedSetting) -> dict[str, list[Any]]:
    """Make the distribution from which a setting is drawn."""
    if check_varied(varied).kind in ("choice", "bool"):
        return {"choice": list_values(varied)}
    return {"log_uniform" if varied.spacing == "RATIO" else "uniform": sorted((varied.first, varied.last))}


def _make_sweep_table(kind: str, name: str, stated: Mapping[str, Any], **also: int) -> dict[str, Any]:
    table: dict[str, Any] = {"kind": kind, "name": name, **also}
    for setting, values in stated.items():
        topic, _, key = setting.partition(".")
        table.setdefault(topic, {})[key] = values
    return table


def _draw_seeds(settings: Settings, seeds: int) -> list[int]:
    """Draw seeds: first the scene's seed, then seeds drawn from it."""
    own = int(settings.dataset.seed)
    return [own, *list_seeds(seeds - 1, own)]


def make_plan_text(settings: Settings, variations: SceneVariations) -> str:
    """Make the TOML text of a plan: the variations, and all settings of the scene, whose files must have absolute
    paths.

    Raises IcyMoonError for values out of range, and for settings that cannot be combined.
    """
    count_pairs(settings, variations)
    header: dict[str, Any] = {
        "title": make_title(variations),
        "description": f"Made by {WHERE} of Icy Moon {version()}",
    }
    if variations.seeds > 1:
        header["seeds"] = _draw_seeds(settings, variations.seeds)
    lines = ["[plan]", *(f"{key} = {to_toml_value(value)}" for key, value in header.items()), ""]
    for factor in _make_factors(settings, variations):
        lines += ["[[sweep]]", *_make_sweep_lines(factor.table), ""]
    described = {
        topic: {key: value for key, value in values.items() if topic != "dataset" or key in _STATED_DATASET_KEYS}
        for topic, values in settings.items()
    }
    return "\n".join([*lines, "# All settings of the scene.", to_toml(described)])


def _make_sweep_lines(table: Mapping[str, Any]) -> list[str]:
    lines = []
    for key, value in table.items():
        if not isinstance(value, dict):
            lines.append(f"{key} = {to_toml_value(value)}")
            continue
        for name, stated in value.items():
            text = (
                f"{{ {', '.join(f'{law} = {to_toml_value(of)}' for law, of in stated.items())} }}"
                if isinstance(stated, dict)
                else to_toml_value(stated)
            )
            lines.append(f"{key}.{name} = {text}")
    return lines


def make_title(variations: SceneVariations) -> str:
    """Make the title of the plan from the varied settings."""
    names = [find_label(each.name) for each in variations.varied]
    names += [f"{variations.seeds} Seeds"] if variations.seeds > 1 else []
    return ", ".join(names) or "One Scene"


def find_label(name: str) -> str:
    """Return the label of a setting without its unit; the name itself if no setting has it."""
    return _SETTING_BY_NAME[name].label.partition(" (")[0] if name in _SETTING_BY_NAME else name


def count_pairs(settings: Settings, variations: SceneVariations) -> int:
    """Count the pairs of the plan; there are fewer where random values of whole numbers are the same.

    Raises IcyMoonError for settings that cannot be combined, and for more pairs than a plan may have.
    """
    for what, count in (("seeds", variations.seeds), ("draws", variations.draws)):
        if count < 1:
            raise IcyMoonError(f"{WHERE}: there are {count} {what}; give 1 or more.")
    pairs = (
        variations.seeds
        * int(settings.dataset.headings)
        * math.prod(factor.size for factor in _make_factors(settings, variations))
    )
    if pairs > MAX_PAIRS:
        raise IcyMoonError(
            f"{WHERE}: this makes {pairs} pairs, more than {MAX_PAIRS}; give fewer values, or combine them by "
            "Sobol draws."
        )
    return pairs


def describe_variations(settings: Settings, variations: SceneVariations) -> str:
    """Describe the number of pairs and its factors, such as '5 values of Sun Elevation x 3 seeds = 15 pairs'.

    Raises IcyMoonError as ``count_pairs`` does.
    """
    pairs, headings = count_pairs(settings, variations), int(settings.dataset.headings)
    parts = [factor.text for factor in _make_factors(settings, variations)]
    parts += [f"{variations.seeds} seeds"] if variations.seeds > 1 else []
    parts += [f"{headings} headings"] if headings > 1 else []
    total = format_count(pairs, "pair")
    return f"{' x '.join(parts)} = {total}" if parts else total


def sample_settings(settings: Settings, variations: SceneVariations, most: int) -> tuple[list[Settings], float]:
    """Sample the complete settings of up to ``most`` pairs at the first heading, evenly spread over all pairs. Return
    them, and the approximate number of grounds of all pairs. Raises IcyMoonError as ``count_pairs`` does."""
    count_pairs(settings, variations)
    grounds, choices = 1.0, []
    for factor in _make_factors(settings, variations):
        made = _make_parts(factor, settings, most)
        different = len({json.dumps(_select_geometry(part)) for part in made})
        grounds *= different * factor.size / len(made) if different > 1 else 1
        choices.append(made)
    if variations.seeds > 1:
        choices.append([{"dataset": {"seed": seed}} for seed in _draw_seeds(settings, min(variations.seeds, most))])
        grounds *= variations.seeds
    total, found = math.prod(map(len, choices)), []
    for k in range(min(most, total)):
        rest, parts = k * _SAMPLE_STRIDE % total, []
        for factor_choices in choices:
            rest, chosen = divmod(rest, len(factor_choices))
            parts.append(factor_choices[chosen])
        found.append(merged(settings, *parts))
    return found, grounds


def make_end_settings(settings: Settings, variations: SceneVariations) -> tuple[Settings, Settings]:
    """Make the complete settings of the first and the last pair of the plan. Raises IcyMoonError as ``count_pairs``
    does."""
    count_pairs(settings, variations)
    choices = [_make_parts(factor, settings) for factor in _make_factors(settings, variations)]
    choices.append([{"dataset": {"seed": seed}} for seed in _draw_seeds(settings, variations.seeds)])
    first, last = (
        expand_headings(merged(settings, *(parts[end] for parts in choices)))[end].settings for end in (0, -1)
    )
    return first, last


def _make_parts(factor: _Factor, settings: Settings, most: int = MAX_PAIRS) -> list[Parts]:
    """Make the settings of each variation of a sweep; of draws only the first ``most``."""
    table = dict(factor.table)
    if "count" in table:  # the first draws are the same for any number of draws
        table["count"] = min(table["count"], most)
    sweep = Sweep(table.pop("kind"), table.pop("name"), table, Place(Path("plan.toml"), ""))
    return [each.settings for each in setting_sweeps.make_setting_variations(sweep, settings)]


def _select_geometry(part: Parts) -> list[tuple[str, str, Any]]:
    """Select the settings of a part that change the shape of the ground."""
    return [
        (topic, key, value)
        for topic, values in part.items()
        for key, value in values.items()
        if TOPICS[topic][key].effect == "geometry"
    ]

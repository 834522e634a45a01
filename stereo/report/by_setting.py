"""The settings that vary over the pairs of an evaluation, and the mean error at each of their values."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...settings.table import TOPICS, list_all_settings
from ...settings.topics.declaration import Parts
from ...support.arrays import Array
from ..inference.scene_means import find_mean_intervals
from .summary import ResultTable, is_share

#: Settings, as topic.key, that determine the ground; pairs that share them share a scene, in any light and camera.
_GROUND_SETTINGS = {f"{topic}.{setting.key}" for topic, setting in list_all_settings() if setting.effect == "geometry"}
#: Settings that are never shown as varied: the machine and speed of a run, and the seed, whose value has no meaning.
_NEVER_SWEPT = {f"{topic}.{setting.key}" for topic, setting in list_all_settings() if setting.effect == "run"} | {
    "dataset.seed"
}
#: The name of the sweep over scenes, if the pairs are from presets.
SCENE_SWEEP = "scene"
#: The name of the sweep over the shipped terrains of the pairs.
TERRAIN_SWEEP = "terrain"
#: Settings of the cameras' poses, whose values are averaged, and their names for readers.
POSE_SETTINGS = {"rig.heading_deg": "heading", "rig.x_m": "place", "rig.y_m": "place"}
#: Most values that a curve shows separately; if there are more, they form this number of groups of equal size.
MAX_LEVELS = 10


def name_scene(facts: Mapping[str, Any]) -> str:
    """Make a name for the ground of a pair from its facts; pairs that see the same ground have the same name.

    A pair on unknown ground shares its name with no other pair.
    """
    ground = {
        f"{topic}.{key}": value
        for topic, values in facts["settings"].items()
        for key, value in values.items()
        if f"{topic}.{key}" in _GROUND_SETTINGS
    }
    return json.dumps(ground or facts["pair"], sort_keys=True)


@dataclass(frozen=True)
class VariedSetting:
    """A setting that differs between pairs. It may stand for the scenes or terrains of the pairs, see
    ``conditions.join_by_scene``.
    """

    name: str  # topic.key, SCENE_SWEEP or TERRAIN_SWEEP
    title: str
    values: Array  # per pair, numbers or text; NaN or "" for pairs without facts
    together: tuple[str, ...] = ()  # titles of other settings that divide the pairs in exactly the same way

    @property
    def numeric(self) -> bool:
        """Whether the values are numbers, which have an order and a distance."""
        return self.values.dtype.kind == "f"

    def levels(self) -> tuple[list[str], Array, Array]:
        """Return the name of each level, its place on an axis, and the level of each pair, or -1."""
        known = ~np.isnan(self.values) if self.numeric else self.values != ""
        distinct = np.unique(self.values[known])
        level = np.full(len(self.values), -1)
        if self.numeric and len(distinct) > MAX_LEVELS:
            bounds = np.quantile(self.values[known], np.linspace(0, 1, MAX_LEVELS + 1)[1:-1])
            level[known] = np.searchsorted(np.unique(bounds), self.values[known], side="right")
            used = np.unique(level[known])
            places = np.array([self.values[level == k].mean() for k in used])
            level[known] = np.searchsorted(used, level[known])
            return [f"{place:.3g}" for place in places], places, level
        level[known] = np.searchsorted(distinct, self.values[known])
        if self.numeric:
            return [f"{value:g}" for value in distinct], distinct, level
        return [str(value) for value in distinct], np.arange(len(distinct), dtype=float), level


def find_swept_settings(facts: Iterable[Mapping[str, Any]], places: Mapping[str, int]) -> list[VariedSetting]:
    """Find the settings that differ between pairs. Those with the fewest distinct values come first, because they are
    most often varied on purpose.

    A setting does not differ if it is the same in all pairs that have it; photographs, for example, lack settings.
    ``places`` gives the number of each pair by name. Reads ``facts`` twice, to keep only differing settings in memory.
    """
    first: dict[str, Any] = {}
    differing: set[str] = set()
    for pair in facts:
        flat = _flatten_settings(pair["settings"])
        first = first or flat
        differing |= {name for name in flat.keys() | first.keys() if flat.get(name) != first.get(name)}
    columns: dict[str, list[Any]] = {name: [None] * len(places) for name in differing}
    for pair in facts if differing else ():
        flat = _flatten_settings(pair["settings"])
        for name in differing:
            columns[name][places[pair["pair"]]] = flat.get(name)
    sweeps = [
        sweep
        for name, values in columns.items()
        if len((sweep := VariedSetting(name, _make_sweep_title(name), _to_value_array(values))).levels()[0]) > 1
    ]
    return _join_inseparable(sorted(sweeps, key=lambda sweep: (len(np.unique(sweep.values.astype(str))), sweep.name)))


def _join_inseparable(sweeps: list[VariedSetting]) -> list[VariedSetting]:
    """Join settings that always vary together, such as the settings of two presets, into one sweep."""
    groups: dict[tuple[int, ...], list[VariedSetting]] = {}
    for sweep in sweeps:
        seen: dict[str, int] = {}
        split = tuple(seen.setdefault(value, len(seen)) for value in sweep.values.astype(str).tolist())
        groups.setdefault(split, []).append(sweep)
    return [replace(first, together=tuple(sweep.title for sweep in others)) for first, *others in groups.values()]


def average_by_level(
    sweep: VariedSetting, table: ResultTable, method: int, metric: str, among: Array | None = None
) -> tuple[Array, Array]:
    """Average a metric over the pairs at each level of a setting, (levels,). Also return its 95 % bounds (levels, 2),
    NaN where there are too few scenes for them.

    ``among`` (pairs,) is true for the pairs that count, by default all.
    """
    names, _, level = sweep.levels()
    numbers = table.column(method, metric)
    known = ~np.isnan(numbers) & (True if among is None else among)
    means, bounds = np.full(len(names), np.nan), np.full((len(names), 2), np.nan)
    for k in range(len(names)):
        at = (level == k) & known
        if at.any():
            means[k] = numbers[at].mean()
            bounds[k] = find_mean_intervals(numbers[at, None], table.scenes[at], np.array([is_share(metric)]))[0]
    return means, bounds


def find_noisy_levels(sweep: VariedSetting, table: ResultTable) -> Array:
    """Find the levels, bool (levels,), at which noise of the render decides the results of at least half of the
    pairs.
    """
    names, _, level = sweep.levels()
    return np.array([bool(table.by_noise[level == k].mean() >= 0.5) for k in range(len(names))])


def _flatten_settings(settings: Parts) -> dict[str, Any]:
    return {
        f"{topic}.{key}": value
        for topic, values in settings.items()
        for key, value in values.items()
        if f"{topic}.{key}" not in _NEVER_SWEPT and isinstance(value, (bool, int, float, str))
    }


def _to_value_array(values: list[Any]) -> Array:
    known = [value for value in values if value is not None]
    if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in known):
        return np.array([np.nan if value is None else float(value) for value in values])
    return np.array(["" if value is None else str(value) for value in values])


def _make_sweep_title(name: str) -> str:
    topic, key = name.split(".")
    try:
        setting = TOPICS[topic][key]
    except KeyError:
        return name  # a setting of another version
    unit = "" if setting.unit in ("", "1") or "(" in setting.label else f" ({setting.unit})"
    return f"{TOPICS[topic].label}: {setting.label}{unit}"

"""The conditions of pairs in words: the values of the varied settings, or the presets that the pairs are from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ...settings.preset_files import KINDS, is_whole, load_preset, preset_header, preset_names
from ...settings.table import TOPICS
from ...settings.topics.declaration import Parts
from ...support.arrays import Array
from .by_setting import SCENE, Sweep

#: Maximum number of conditions with results.
MOST = 40
#: Effects of the settings that define a scene, apart from its light and camera.
_OF_SCENE = ("geometry", "material")
#: Most values in the title of a pair.
_MOST_IN_TITLE = 3


@dataclass(frozen=True)
class Condition:
    """The pairs at one value of a setting that varies, or from one preset."""

    name: str
    pairs: Array  # boolean, per pair of the evaluation


def name_levels(
    sweeps: Sequence[Sweep], facts: Iterable[Mapping[str, Any]], places: Mapping[str, int]
) -> list[list[str]]:
    """The name of each level of each sweep, such as "Sun Elevation 8°", or "Fresh snow" for a preset's settings, which
    vary together."""
    levels = [sweep.levels() for sweep in sweeps]
    # The first pair at each level of settings that vary together stands for the level.
    wanted: dict[int, list[tuple[int, int]]] = {}
    for k, (sweep, (names, _, level)) in enumerate(zip(sweeps, levels, strict=True)):
        for n in range(len(names) if sweep.together else 0):
            wanted.setdefault(int(np.flatnonzero(level == n)[0]), []).append((k, n))
    settings: dict[tuple[int, int], Parts] = {}
    for pair in facts if wanted else ():
        settings |= dict.fromkeys(wanted.get(places[pair["pair"]], ()), pair["settings"])
    found = []
    for k, (sweep, (names, _, _)) in enumerate(zip(sweeps, levels, strict=True)):
        presets = _name_presets([settings.get((k, n), {}) for n in range(len(names))]) if sweep.together else []
        found.append(presets or [_name_value(sweep.name, name) for name in names])
    return found


def join_by_scene(
    sweeps: Sequence[Sweep], facts: Iterable[Mapping[str, Any]], places: Mapping[str, int]
) -> list[Sweep]:
    """The sweeps, with the scene in place of the settings by which scenes differ, if all pairs are from shipped ones.

    A pair is from a scene whose ground and surfaces it has, in any light and seen by any camera. ``places`` gives the
    number of each pair by name. Settings that differ between pairs of a scene stay.
    """
    if not sweeps:
        return []
    titles = [""] * len(places)
    for pair in facts:
        titles[places[pair["pair"]]] = title = _scene_title(pair["settings"])
        if not title:
            return list(sweeps)
    scenes = np.array(titles)
    names = [name for name in np.unique(scenes) if name]
    if len(names) < 2:
        return list(sweeps)
    kept = [sweep for sweep in sweeps if any(len(np.unique(sweep.values[scenes == name])) > 1 for name in names)]
    return [Sweep(SCENE, "Scene", scenes), *kept]


def conditions_of(sweeps: Sequence[Sweep], names: Sequence[Sequence[str]]) -> list[Condition]:
    """The conditions of sweeps whose levels have these names, at most ``MOST``."""
    found = [
        Condition(name, level == n)
        for sweep, own in zip(sweeps, names, strict=True)
        for level in [sweep.levels()[2]]
        for n, name in enumerate(own)
    ]
    return found[:MOST]


def titles_of(sweeps: Sequence[Sweep], names: Sequence[Sequence[str]], count: int) -> list[str]:
    """A title for each of ``count`` pairs: its values of the settings that vary, those set on purpose first; empty if
    nothing varies."""
    titles: list[list[str]] = [[] for _ in range(count)]
    for sweep, own in zip(sweeps[:_MOST_IN_TITLE], names, strict=False):
        exact = sweep.numeric and not sweep.together  # a level may stand for a range of values
        _, _, level = sweep.levels()
        for pair, parts in enumerate(titles):
            if level[pair] >= 0:
                parts.append(_name_value(sweep.name, f"{sweep.values[pair]:.4g}") if exact else own[level[pair]])
    return [", ".join(parts) for parts in titles]


def _name_value(name: str, value: str) -> str:
    if name == SCENE:
        return value
    topic, key = name.split(".")
    try:
        setting = TOPICS[topic][key]
    except KeyError:
        return f"{name} {value}"  # of another version of the settings
    label = re.sub(r" \([^)]*\)$", "", setting.label)
    unit = {"deg": "°", "": "", "1": ""}.get(setting.unit, f" {setting.unit}")
    return f"{label} {value}{unit}"


def _name_presets(levels: Sequence[Parts]) -> list[str]:
    """The titles of presets of one kind, one for each level: each describes that level and no other. Empty if there are
    none."""
    for kind in KINDS:
        found = []
        for name, stated in _presets():
            if name.split("/")[0] == kind and [_has(level, stated) for level in levels].count(True) == 1:
                found.append((len(stated), name, next(k for k, level in enumerate(levels) if _has(level, stated))))
        best = {level: name for _, name, level in sorted(found)}
        if len(best) == len(levels):
            return [preset_header(best[k])[0] for k in range(len(levels))]
    return []


def preset_title(settings: Parts) -> str:
    """The title of the shipped scene that a pair was rendered from, unchanged; empty for any other scene."""
    matching = [(len(stated), name) for name, stated in _presets() if is_whole(name) and _has(settings, stated)]
    return preset_header(max(matching)[1])[0] if matching else ""


def _scene_title(settings: Parts) -> str:
    """The title of the shipped scene whose ground and surfaces these settings have; empty for any other scene."""
    found = []
    for name, stated in _presets():
        ground = {place: value for place, value in stated.items() if TOPICS[place[0]][place[1]].effect in _OF_SCENE}
        if is_whole(name) and _has(settings, ground):
            same = sum(settings.get(topic, {}).get(key) == value for (topic, key), value in stated.items())
            found.append((same - len(stated), len(stated), name))  # of two, the one that describes light and camera too
    return preset_header(max(found)[2])[0] if found else ""


@cache
def _presets() -> list[tuple[str, dict[tuple[str, str], Any]]]:
    """The settings of each shipped preset that concern the images, without the settings of rendering."""
    return [
        (
            name,
            {
                (topic, key): value
                for topic, values in load_preset(name).items()
                for key, value in values.items()
                if TOPICS[topic][key].effect not in ("run", "sampling")
            },
        )
        for name in preset_names()
    ]


def _has(settings: Parts, stated: Mapping[tuple[str, str], Any]) -> bool:
    return bool(stated) and all(settings.get(topic, {}).get(key) == value for (topic, key), value in stated.items())

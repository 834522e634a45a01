"""The conditions of pairs in words: the values of the varied settings, or the presets of the pairs."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ...settings.preset_files import PRESET_KINDS, is_whole_scene, load_preset, preset_names, read_preset_header
from ...settings.table import TOPICS, list_all_settings
from ...settings.topics.declaration import Parts
from ...support.arrays import Array
from .by_setting import SCENE_SWEEP, TERRAIN_SWEEP, VariedSetting

#: Most conditions with results.
MAX_CONDITIONS = 40
#: Effects of the settings that define a scene, apart from its light and camera.
_OF_SCENE = ("geometry", "material")
#: Values in the title of a pair, if these distinguish it from other pairs.
_IN_TITLE = 3
#: Labels that several topics have, so that they name a setting only together with its topic.
_SHARED_LABELS = {
    label for label, count in Counter(setting.label for _, setting in list_all_settings()).items() if count > 1
}


@dataclass(frozen=True)
class Condition:
    """The pairs at one value of a setting that varies, or from one preset."""

    name: str
    pairs: Array  # boolean, per pair of the evaluation


def name_levels(
    sweeps: Sequence[VariedSetting], facts: Iterable[Mapping[str, Any]], places: Mapping[str, int]
) -> list[list[str]]:
    """Name each level of each sweep, such as "Sun Elevation 8°", or "Fresh snow" for settings that vary together as a
    preset.
    """
    levels = [sweep.levels() for sweep in sweeps]
    joined = any(sweep.together for sweep in sweeps)
    # The presets of every pair, because a level is named after a preset only if all of its pairs are from it.
    of_pairs: list[frozenset[str]] = [frozenset()] * len(places)
    for pair in facts if joined else ():
        settings = pair["settings"]
        of_pairs[places[pair["pair"]]] = frozenset(
            name for name, stated in _read_image_presets() if _has_settings(settings, stated)
        )
    found = []
    for sweep, (names, _, level) in zip(sweeps, levels, strict=True):
        of_levels = [[of_pairs[n] for n in np.flatnonzero(level == k)] for k in range(len(names))]
        presets = _name_presets(of_levels) if sweep.together else []
        found.append(presets or [_name_value(sweep.name, name) for name in names])
    return found


def join_by_scene(
    sweeps: Sequence[VariedSetting], facts: Iterable[Mapping[str, Any]], places: Mapping[str, int]
) -> list[VariedSetting]:
    """Join the sweeps of settings by which scenes or terrains differ to one sweep.

    If all pairs are from shipped scenes, the scene replaces the settings by which they differ. Otherwise, if all
    procedural ground is from shipped terrains, the terrain replaces its settings.

    A pair is from a scene whose ground and surfaces it has, in any light and seen by any camera, and from a terrain
    whose ground it has. ``places`` gives the number of each pair by name. Settings that differ between pairs of a scene
    or of a terrain stay.
    """
    if not sweeps:
        return []
    for name, title, of_pair in (
        (SCENE_SWEEP, "Scene", _find_scene_title),
        (TERRAIN_SWEEP, "Terrain", _find_terrain_title),
    ):
        titles: list[str] = [""] * len(places)
        stated: set[str] = set()
        for pair in facts:
            found = of_pair(pair["settings"])
            if found is None:
                break
            titles[places[pair["pair"]]], settings = found
            stated |= settings
        else:
            known = np.array(titles)
            groups = [known == each for each in np.unique(known)]
            if len(np.unique(known[known != ""])) > 1:
                kept = [
                    sweep
                    for sweep in sweeps
                    if any(len(np.unique(sweep.values[own])) > 1 for own in groups)
                    # A setting that divides the pairs in the same way cannot be separated from the terrain.
                    or (sweep.name not in stated and len(np.unique(sweep.values)) < len(groups))
                ]
                return [VariedSetting(name, title, known), *kept]
    return list(sweeps)


def list_conditions(sweeps: Sequence[VariedSetting], names: Sequence[Sequence[str]]) -> list[Condition]:
    """List the conditions of sweeps whose levels have these names, at most ``MAX_CONDITIONS``."""
    found = [
        Condition(name, level == n)
        for sweep, own in zip(sweeps, names, strict=True)
        for level in [sweep.levels()[2]]
        for n, name in enumerate(own)
    ]
    return found[:MAX_CONDITIONS]


def make_pair_titles(sweeps: Sequence[VariedSetting], names: Sequence[Sequence[str]], count: int) -> list[str]:
    """Make a title for each of ``count`` pairs, all different; "" if nothing varies. A title states the pair's values
    of the varied settings, settings varied on purpose first, until it differs from the others.
    """
    texts = [_make_value_texts(sweep, own) for sweep, own in zip(sweeps, names, strict=True)]
    titles = [", ".join(filter(None, parts)) for parts in zip(*texts[:_IN_TITLE], strict=True)] or [""] * count
    for own in texts[_IN_TITLE:]:
        for pairs in _group_equal_titles(titles):
            if len({own[pair] for pair in pairs}) > 1:
                for pair in pairs:
                    titles[pair] = ", ".join(filter(None, (titles[pair], own[pair])))
    if sweeps:
        for pairs in _group_equal_titles(titles):  # these pairs differ in the seed of the ground, which no sweep shows
            for number, pair in enumerate(pairs[1:], 2):
                titles[pair] = f"{titles[pair]} ({number})".lstrip()
    return titles


def _make_value_texts(sweep: VariedSetting, names: Sequence[str]) -> list[str]:
    """Write the value of each pair in words; "" if unknown."""
    exact = sweep.numeric and not sweep.together  # a level may be a range of values
    _, _, level = sweep.levels()
    return [
        "" if k < 0 else _name_value(sweep.name, f"{value:.4g}") if exact else names[k]
        for k, value in zip(level.tolist(), sweep.values.tolist(), strict=True)
    ]


def _group_equal_titles(titles: Sequence[str]) -> list[list[int]]:
    """Group the pairs that share a title, for each title of several pairs."""
    found: defaultdict[str, list[int]] = defaultdict(list)
    for pair, title in enumerate(titles):
        found[title].append(pair)
    return [pairs for pairs in found.values() if len(pairs) > 1]


def _name_value(name: str, value: str) -> str:
    if name == SCENE_SWEEP:
        return value
    if name == TERRAIN_SWEEP:
        return f"Terrain: {value}"
    topic, key = name.split(".")
    try:
        setting = TOPICS[topic][key]
    except KeyError:
        return f"{name} {value}"  # a setting of another version
    label = re.sub(r" \([^)]*\)$", "", setting.label)
    if setting.label in _SHARED_LABELS:
        label = f"{TOPICS[topic].label}: {label}"
    unit = {"deg": "°", "": "", "1": ""}.get(setting.unit, f" {setting.unit}")
    return f"{label} {dict(choice[:2] for choice in setting.choices).get(value, value)}{unit}"


def _name_presets(levels: Sequence[Sequence[frozenset[str]]]) -> list[str]:
    """Name each level by a preset, all of one kind: a preset of all pairs of the level and of no other pair. Return the
    titles, [] if a level has none. ``levels`` are the presets of each pair of each level.
    """
    for kind in PRESET_KINDS:
        found = []
        for own in levels:
            others = frozenset().union(*(pair for other in levels if other is not own for pair in other))
            fitting = frozenset.intersection(*own) - others
            named = [
                (len(stated), name)
                for name, stated in _read_image_presets()
                if name in fitting and name.startswith(f"{kind}/")
            ]
            found.append(max(named)[1] if named else "")
        if all(found):
            return [read_preset_header(name)[0] for name in found]
    return []


def find_preset_title(settings: Parts) -> str:
    """Find the title of the shipped scene from which a pair was rendered, unchanged; "" for any other scene."""
    matching = [
        (len(stated), name)
        for name, stated in _read_image_presets()
        if is_whole_scene(name) and _has_settings(settings, stated)
    ]
    return read_preset_header(max(matching)[1])[0] if matching else ""


def _find_scene_title(settings: Parts) -> tuple[str, set[str]] | None:
    """Find the title of the shipped scene with the ground and surfaces of these settings; None for other scenes. Also
    return the names of all settings, because the scene may differ from others in any.
    """
    found = []
    for name, stated in _read_image_presets():
        ground = {place: value for place, value in stated.items() if TOPICS[place[0]][place[1]].effect in _OF_SCENE}
        if is_whole_scene(name) and _has_settings(settings, ground):
            same = sum(settings.get(topic, {}).get(key) == value for (topic, key), value in stated.items())
            # Of two such scenes, the one that describes light and camera too is best.
            found.append((same - len(stated), len(stated), name))
    every = {f"{topic}.{key}" for topic, values in settings.items() for key in values}
    return (read_preset_header(max(found)[2])[0], every) if found else None


def _find_terrain_title(settings: Parts) -> tuple[str, set[str]] | None:
    """Find the title of the shipped terrain with the ground of these settings, and the settings that it states. None
    for other procedural ground; the title is "" for ground from a file.
    """
    if settings.get("source", {}).get("kind") != "PROCEDURAL":
        return "", set()
    found = [
        (len(stated), name, stated)
        for name, stated in _read_image_presets()
        if name.startswith("terrains/") and _has_settings(settings, stated)
    ]
    if not found:
        return None
    _, name, stated = max(found, key=lambda each: each[:2])
    return read_preset_header(name)[0], {f"{topic}.{key}" for topic, key in stated}


@cache
def _read_image_presets() -> list[tuple[str, dict[tuple[str, str], Any]]]:
    """Read the settings of each shipped preset that concern the images, without the settings of rendering."""
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


def _has_settings(settings: Parts, stated: Mapping[tuple[str, str], Any]) -> bool:
    return bool(stated) and all(settings.get(topic, {}).get(key) == value for (topic, key), value in stated.items())

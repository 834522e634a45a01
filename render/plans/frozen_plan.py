"""A data set's plan, frozen into its folder, and its complete pairs. Imports no Blender.

``plan.jsonl`` is written once, before the first render: a header, then a line for each pair. The work depends on
nothing else, so any process on any machine can do any part of it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...settings.description import ask_to_update, changed, check, overlay, restore_settings
from ...settings.pair_ids import affects_pixels, find_value_in_id
from ...settings.table import list_all_settings
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import COUNT, TABLE, TEXT, Each, check_record
from ...support.files import quote, read_text, write_text
from ...support.foreign_bytes import describe_reason, parse_json
from ...support.number_text import format_count
from ...support.version import version
from ..pairs.dataset_file_names import check_id
from ..pairs.pair_folder import is_complete
from .planned_pair import PlannedPair

PLAN = "plan.jsonl"
FORMAT = "icymoon-dataset"
VERSION = 1
_PLAN_AGAIN = "delete it and run icymoon batch again, which keeps the rendered pairs"
#: The first line of a plan of any version, the first line of this version, and the other lines.
_ANY_HEADER_SHAPE = {"format": TEXT, "version": COUNT}
_HEADER_SHAPE = {**_ANY_HEADER_SHAPE, "settings": Each(TABLE, TEXT), "pairs": COUNT, "plan": TEXT, "icymoon": TEXT}
_PAIR_LINE_SHAPE = {"id": TEXT, "changes": Each(TABLE, TEXT)}
#: Most settings that are named as differences between two plans.
_MAX_NAMED_SETTINGS = 5


@dataclass(frozen=True)
class FrozenPlan:
    """The planned content of a data set: its pairs in render order, the plan's text, the version of Icy Moon that froze
    it, and a ``note`` for the user.
    """

    pairs: tuple[PlannedPair, ...]
    text: str
    version: str
    note: str = ""

    def find_missing(self, dataset: Path) -> list[PlannedPair]:
        """Find the pairs that are missing or incomplete."""
        return [pair for pair in self.pairs if not is_complete(pair.folder(dataset))]


def freeze_plan(dataset: Path, pairs: Sequence[PlannedPair], text: str) -> FrozenPlan:
    """Write the plan of a data set, or check it against the existing plan, and return it.

    A data set may be extended: a plan that has all pairs of the frozen plan replaces it. A plan that an earlier version
    froze from the same text stays the same, also if presets and defaults have changed. Raises IcyMoonError for a plan
    without pairs, and for a plan that lacks pairs of the frozen plan.
    """
    if not pairs:
        raise IcyMoonError("The plan has no pairs; give it values to vary, and no empty list.")
    path = dataset / PLAN
    if path.exists():
        known = read_frozen_plan(dataset)
        there = {pair.id for pair in pairs}
        lacking = [pair for pair in known.pairs if pair.id not in there]
        if lacking and known.text == text and known.version != version():
            return replace(
                known,
                note=f"{dataset} continues as Icy Moon {known.version} planned it. {version()} makes "
                f"other pairs of the same plan: {_describe_difference(known.pairs, pairs)}. "
                "To render those, choose another folder.",
            )
        if lacking:
            raise IcyMoonError(
                f"{dataset} contains another data set: {len(lacking)} of its "
                f"{format_count(len(known.pairs), 'pair')} {'is' if len(lacking) == 1 else 'are'} not in "
                f"this plan, since {_describe_difference(known.pairs, pairs)}. To continue that data "
                "set, use icymoon work. For this plan choose another folder, or add those pairs to "
                "it."
            )
        if [p.id for p in known.pairs] == [p.id for p in pairs] and known.text == text:
            return known
    base = pairs[0].settings
    header = {
        "format": FORMAT,
        "version": VERSION,
        "icymoon": version(),
        "pairs": len(pairs),
        "seeds": sorted({int(pair.settings.dataset.seed) for pair in pairs}),
        "settings": base,
        "plan": text,
    }
    lines = [header, *({"id": pair.id, "changes": changed(pair.settings, base)} for pair in pairs)]
    write_text(path, "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines))
    return read_frozen_plan(dataset)


def _describe_difference(known: Sequence[PlannedPair], pairs: Sequence[PlannedPair]) -> str:
    """Describe in words the settings in which the missing ``known`` pairs differ from the ``pairs``."""
    names = [(topic, s.key) for topic, s in list_all_settings() if affects_pixels(s)]
    before, now = (
        {name: {_value_in_id(name, pair): pair.settings[name[0]][name[1]] for pair in plan} for name in names}
        for plan in (known, pairs)
    )
    texts = [
        _describe_change(".".join(name), before[name], now[name])
        for name in names
        if before[name].keys() - now[name].keys()
    ]
    if texts:
        return _join_texts(texts)
    # Each value occurs, but not together with the others.
    varied = [name for name in names if len(before[name]) > 1]
    there = {tuple(_value_in_id(name, pair) for name in varied) for pair in pairs}
    lost = next((pair for pair in known if tuple(_value_in_id(name, pair) for name in varied) not in there), None)
    if lost is None:
        return "a file of yours has changed"
    return f"no pair has together {_join_texts([f'{a}.{b} {quote(lost.settings[a][b])}' for a, b in varied])}"


def _value_in_id(name: tuple[str, str], pair: PlannedPair) -> str:
    """Return the value of a setting as the id of a pair contains it, for comparison."""
    return repr(find_value_in_id(".".join(name), pair.settings))


def _describe_change(name: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Describe in words the values of a setting before and now. Both are given by their form in ids."""
    lost, new = ([each[key] for key in each if key not in other] for each, other in ((before, now), (now, before)))
    if len(before) == 1 == len(now):
        return f"{name} was {quote(lost[0])} and is {quote(new[0])}"
    return f"{name} no longer takes {_list_values(lost)}" + (f", but {_list_values(new)}" if new else "")


def _list_values(values: Sequence[Any]) -> str:
    more = len(values) - 1
    return quote(values[0]) + (f" and {format_count(more, 'more value')}" if more else "")


def _join_texts(texts: Sequence[str]) -> str:
    more = len(texts) - _MAX_NAMED_SETTINGS
    return ", ".join([*texts[:_MAX_NAMED_SETTINGS], *([format_count(more, "more setting")] if more > 0 else [])])


def read_frozen_plan(dataset: Path) -> FrozenPlan:
    """Read the frozen plan of a data set. Raises IcyMoonError if it is missing or cannot be read."""
    path = dataset / PLAN
    if not os.path.lexists(path):
        raise IcyMoonError(f"{dataset} has no {PLAN}; make the data set with icymoon batch.")
    try:
        header, *lines = [parse_json(line) for line in read_text(path).split("\n") if line]
    except (OSError, ValueError) as error:
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {_PLAN_AGAIN}.") from None
    check_record(header, _ANY_HEADER_SHAPE, path, _PLAN_AGAIN)
    if header["format"] != FORMAT or header["version"] != VERSION:
        raise IcyMoonError(
            f"{path} has version {header['version']} of {header['format']}, this Icy Moon reads "
            f"{VERSION} of {FORMAT}; use the version that wrote it."
        )
    check_record(header, _HEADER_SHAPE, path, _PLAN_AGAIN)
    base = restore_settings(header["settings"], str(path), header["icymoon"])
    with ask_to_update(str(path), header["icymoon"]):
        pairs = tuple(_parse_pair(line, base, path) for line in lines)
    if (there := len({pair.id for pair in pairs})) != header["pairs"]:
        raise IcyMoonError(f"{path} contains {there} of {format_count(header['pairs'], 'pair')}; {_PLAN_AGAIN}.")
    return FrozenPlan(pairs, header["plan"], header["icymoon"])


def _parse_pair(line: Mapping[str, Any], base: Settings, path: Path) -> PlannedPair:
    check_record(line, _PAIR_LINE_SHAPE, path, _PLAN_AGAIN)
    settings = overlay(base, check(line["changes"], str(path), stored=True))
    return PlannedPair(check_id(line["id"], path), settings, 0.0)

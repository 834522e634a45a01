"""Describe the averages behind a point in a chart: over scenes, headings, places and other varied settings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...support.arrays import Array
from ...support.number_text import format_count
from .by_setting import POSE_SETTINGS, SCENE_SWEEP, VariedSetting
from .summary import ResultTable

#: Most settings that are named.
_MAX_NAMED = 6


def describe_averaging(
    point: Array, used: Sequence[VariedSetting], sweeps: Sequence[VariedSetting], table: ResultTable
) -> str:
    """Describe the means of a chart in a sentence. ``point`` (pairs,) is the point to which each pair belongs, or -1.

    Of ``sweeps``, those in ``used`` are the same in all pairs of a point; the others are named if they differ there.
    """
    counted = point >= 0
    groups = [np.flatnonzero(point == each) for each in np.unique(point[counted])]
    most = max(map(len, groups), default=0)
    if most <= 1:
        return "Each point is one pair."
    found = [_format_count_range(_find_range_of_distinct(table.scenes, groups), "scene")]
    poses: dict[str, int] = {}
    named = []
    for sweep in sweeps:
        number = _find_range_of_distinct(sweep.values, groups) if all(sweep is not each for each in used) else (1, 1)
        if number[1] < 2 or sweep.name == SCENE_SWEEP:
            continue
        if sweep.name in POSE_SETTINGS:
            poses[POSE_SETTINGS[sweep.name]] = max(number[1], poses.get(POSE_SETTINGS[sweep.name], 0))
        else:
            named.append(sweep.title)
    found += [format_count(number, what) for what, number in poses.items()]
    if len(named) > _MAX_NAMED:
        named = [*named[:_MAX_NAMED], format_count(len(named) - _MAX_NAMED, "more setting")]
    found = [*filter(None, found), *named]
    if not found:
        return f"Each point is the mean over {_format_count_range(_find_range_of_sizes(groups), 'pair')}."
    return f"Each point is the mean over {' and '.join([', '.join(found[:-1]), found[-1]] if found[1:] else found)}."


def _find_range_of_distinct(values: Array, groups: Sequence[Array]) -> tuple[int, int]:
    """Find the least and the most distinct values in a group."""
    found = [len(np.unique(values[group])) for group in groups]
    return min(found), max(found)


def _find_range_of_sizes(groups: Sequence[Array]) -> tuple[int, int]:
    return min(map(len, groups)), max(map(len, groups))


def _format_count_range(numbers: tuple[int, int], what: str) -> str:
    """Write the number of averaged items per point in words; "" if each point has one item."""
    least, most = numbers
    if most < 2:
        return ""
    return format_count(most, what) if least == most else f"{least} to {format_count(most, what)}"

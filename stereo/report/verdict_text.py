"""Sentences on the differences that an evaluation of this number of scenes can show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..inference.typical_scene import count_scenes_for_methods
from ..matchers.methods import describe_method
from .rare_failures import describe_rare_failures
from .summary import ResultTable
from .table_columns import RANKING_METRIC

#: Metrics whose detectable difference is stated, with their names in a sentence.
_STATED_METRICS = (("common_epe_px", "EPE"), ("total_bad_1", "pixels off by more than 1 px or missing"))


def describe_verdicts(comparisons: Sequence[Mapping[str, Any]], table: ResultTable) -> str:
    """Describe the verdicts on the methods of a table: whether the comparisons have verdicts, the smallest difference
    that they could detect, and the methods whose rare but heavy failures make a verdict depend on chance.
    """
    scenes = table.scene_count()
    if not comparisons or not scenes:
        return ""
    methods = len({entry[side] for entry in comparisons for side in "ab"})
    tested = [entry for entry in comparisons if entry["p"] is not None]
    if not tested:
        few = "One scene: no intervals and no verdicts." if scenes == 1 else f"{scenes} scenes: no verdicts."
        return (
            f"{few} A verdict on {methods} methods takes {max(count_scenes_for_methods(methods), scenes + 1)} scenes."
        )
    count = methods * (methods - 1) // 2
    together = f", over all {count} comparisons by a metric" if count > 1 else ""
    sizes = {
        name: np.median([entry["detectable"] for entry in tested if entry["metric"] == metric] or [np.nan])
        for metric, name in _STATED_METRICS
    }
    told = [_describe_size(name, float(size)) for name, size in sizes.items() if np.isfinite(size)]
    power = f" 8 of 10 such data sets would show {' or '.join(told)}." if told else ""
    rare = "".join(f" {sentence}" for sentence in (*describe_rare_failures(table), _describe_unseen(scenes)))
    return (
        f"{scenes} scenes, {methods} methods: a verdict is on the typical scene, not on the mean. About 5 % of "
        f"data sets without a difference show one{together}.{power}{rare}"
    )


def describe_typical(comparisons: Sequence[Mapping[str, Any]]) -> list[str]:
    """Write a sentence for each two methods on their typical difference by ``RANKING_METRIC``, with the interval.

    Methods that differ come first. [] if there are too few scenes for an interval.
    """
    entries = [
        entry
        for entry in comparisons
        if entry["metric"] == RANKING_METRIC
        and entry["p"] is not None
        and entry["typical_low"] is not None
        and entry["typical_high"] is not None
    ]
    return [_describe_difference(entry) for entry in sorted(entries, key=lambda entry: entry["p"])]


def _describe_difference(entry: Mapping[str, Any]) -> str:
    middle, low, high = (100 * entry[key] for key in ("typical", "typical_low", "typical_high"))
    one, other = (describe_method(entry[side]) for side in "ab")
    if middle < 0:
        one, other, middle, low, high = other, one, -middle, -high, -low
    unsure = "" if entry["better"] else ", so either may be better"
    return (
        f"In the typical scene {one} has {middle:.1f} points more wrong or missing pixels than {other} "
        f"({low:.1f} to {high:.1f}{unsure})."
    )


def _describe_unseen(scenes: int) -> str:
    """Describe a limit of every test on these scenes: failures that occur in no scene.

    If a share q of all scenes had one, ``scenes`` scenes would contain none with a probability of (1 - q)^scenes.
    """
    return (
        f"A failure that none of the {scenes} scenes contains may still occur in up to "
        f"{100 * (1 - 0.05 ** (1 / scenes)):.0f} % of scenes (95 % bound), and no verdict knows of it."
    )


def _describe_size(name: str, size: float) -> str:
    if name != "EPE":
        return f"{100 * size:.1f} points more {name}"
    return f"an EPE {100 * (size - 1):.0f} % larger" if size < 10 else f"an EPE {size:.0f} times as large"

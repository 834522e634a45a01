"""Find the settings that were varied on purpose against each other, and the lines of charts that follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .by_setting import POSE_SETTINGS, VariedSetting

#: Most values of a setting with a line each, and the number of groups for settings with more values.
MAX_LINES, _GROUP_COUNT = 6, 4
#: Settings count as varied on purpose if at least this share of the combinations of two of them occurs, with at least
#: this number of pairs for each value of a setting. Values drawn at random are all different.
_MIN_CROSSED_SHARE, _MIN_REPEATS = 0.9, 2


@dataclass(frozen=True)
class FactorLines:
    """The lines in the charts of a setting, one for each value of another setting, ``factor``."""

    factor: VariedSetting
    names: list[str]
    of: Array  # (pairs,) the line that each pair is part of, or -1
    grouped: bool  # whether a line covers several values


def choose_lines(sweep: VariedSetting, sweeps: Sequence[VariedSetting]) -> FactorLines | None:
    """Choose the lines of the charts of ``sweep``: the values of the first other setting that was varied on purpose
    with it.

    None without such a setting. The poses of a camera and names beyond ``MAX_LINES`` make no lines.
    """
    if sweep.name in POSE_SETTINGS or not _is_repeated(sweep):
        return None
    for other in sweeps:
        if other is sweep or other.name in POSE_SETTINGS or not _is_repeated(other) or not _are_crossed(sweep, other):
            continue
        if lines := _make_lines(other):
            return lines
    return None


def _find_known(sweep: VariedSetting) -> Array:
    return np.asarray(~np.isnan(sweep.values) if sweep.numeric else sweep.values != "")


def _is_repeated(sweep: VariedSetting) -> bool:
    known = _find_known(sweep)
    return int(known.sum()) >= _MIN_REPEATS * len(np.unique(sweep.values[known]))


def _are_crossed(one: VariedSetting, other: VariedSetting) -> bool:
    """Return whether nearly every value of one setting occurs with nearly every value of another."""
    known = _find_known(one) & _find_known(other)
    first, second = (np.unique(sweep.values[known], return_inverse=True)[1] for sweep in (one, other))
    if not known.any() or min(first.max(), second.max()) < 1:
        return False
    combinations = len(set(zip(first.tolist(), second.tolist(), strict=True)))
    return combinations >= _MIN_CROSSED_SHARE * (first.max() + 1) * (second.max() + 1)


def _make_lines(factor: VariedSetting) -> FactorLines | None:
    known = _find_known(factor)
    values, level = np.unique(factor.values[known], return_inverse=True)
    of = np.full(len(factor.values), -1)
    if len(values) <= MAX_LINES:
        of[known] = level
        return FactorLines(
            factor, [f"{value:g}" if factor.numeric else str(value) for value in values], of, grouped=False
        )
    if not factor.numeric:
        return None
    groups = np.array_split(np.arange(len(values)), _GROUP_COUNT)
    of[known] = np.repeat(np.arange(_GROUP_COUNT), [len(group) for group in groups])[level]
    return FactorLines(factor, [f"{values[group[0]]:g} to {values[group[-1]]:g}" for group in groups], of, grouped=True)

"""Methods that fail heavily in few pairs; chance decides the number of these failures in a data set.

These failures decide whether such a method is better on average. The typical scene has none, so a verdict on it does
not count them. The criterion: in at most a tenth of the pairs, a method's excess over the other methods' median is at
least a third of its error in all pairs, and at least half of its error in these pairs. If all pairs were alike, a tenth
of the pairs would have a tenth of the error. With lognormal errors it has a third only if the errors vary by a factor
of 2.3 from pair to pair; errors of ordinary methods vary by 1.6. Pairs that are hard for all methods do not count,
because they cancel in the differences.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..matchers.methods import describe_method
from .summary import ResultTable
from .table_columns import RANKING_METRIC

#: A rare failure has at least ERROR_SHARE of the error in at most PAIR_SHARE of the pairs.
ERROR_SHARE, PAIR_SHARE = 1 / 3, 1 / 10
#: Least excess of a method over the others in these pairs, as a share of its error there.
_MIN_EXCESS_SHARE = 1 / 2


@dataclass(frozen=True)
class RareFailure:
    """A method with the ``share`` of its error in ``failing`` of ``pairs``."""

    method: str
    failing: int
    pairs: int
    share: float


def find_rare_failures(table: ResultTable) -> list[RareFailure]:
    """Find the methods that fail heavily in few pairs, by pixels that are wrong or missing."""
    measured = [k for k in range(len(table.methods)) if np.nansum(table.column(k, "n")) > 0]
    if len(measured) < 2:
        return []
    errors = np.stack([table.column(k, RANKING_METRIC) for k in measured])
    found = []
    for place, k in enumerate(measured):
        others = np.delete(errors, place, axis=0)
        known = ~np.isnan(errors[place]) & ~np.isnan(others).all(axis=0)
        own, excess = errors[place, known], errors[place, known] - np.nanmedian(others[:, known], axis=0)
        order = np.argsort(-excess, kind="stable")[: math.ceil(PAIR_SHARE * len(excess))]
        beyond = np.cumsum(excess[order])
        enough = np.flatnonzero(beyond >= ERROR_SHARE * own.sum())
        if enough.size and own.any() and beyond[enough[0]] >= _MIN_EXCESS_SHARE * own[order[: enough[0] + 1]].sum():
            failing = int(enough[0]) + 1
            found.append(
                RareFailure(table.methods[k], failing, len(own), float(own[order[:failing]].sum() / own.sum()))
            )
    return found


def describe_rare_failures(table: ResultTable) -> list[str]:
    """Write a sentence for each method that fails heavily in few pairs."""
    return [
        f"{describe_method(each.method)} fails rarely but heavily: {each.failing} of {each.pairs} pairs contain "
        f"{100 * each.share:.0f} % of its wrong or missing pixels, and other methods have far fewer there. The "
        "typical scene has no such pair, so verdicts do not count them; compare the means too, and evaluate more "
        "scenes."
        for each in find_rare_failures(table)
    ]

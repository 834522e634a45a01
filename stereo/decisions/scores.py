"""Compares a map of decisions with the truth's: right and dangerous decisions, and their cost.

Cells of one map are not independent, so intervals are over scenes, see ``inference.scene_means``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...support.arrays import Array
from .safe_sites import RULE_NAMES, Sites, choose_site

#: False-positive rates at which a ROC curve is sampled: shares of the unsafe cells that are taken for safe.
ROC_FALSE_SAFE_SHARES = tuple(float(each) for each in np.linspace(0, 1, 51))
#: Margins from which on the taken cells are counted, the strictest first. They are fixed before any ground is seen.
THRESHOLDS = tuple(round(1 - k / 100, 2) for k in range(101))
#: Rounding of a margin that does not make a site dangerous.
_ROUNDING = 1e-12


def score_sites(
    found: Sites, truth: Sites, among: Array, tolerance: float = 0.0, offered: Array | None = None
) -> dict[str, Any]:
    """Score a suitability map against the true one over the cells ``among``; None where a number is undefined.

    A site is chosen from the cells ``offered``, by default ``among``. They should not depend on the truth, which no
    lander knows. So a site that is out of reach in truth, or of unknown truth, is unsafe, but may be chosen.

    * ``base_rate``: share of safe cells, which is the average precision of a random guess.
    * ``taken``: share of cells taken for safe. Of the taken cells, ``precision`` is the share of safe ones and
      ``false_safe`` the rest. Of the safe cells, ``recall`` is the share of taken ones and ``safe_lost`` the rest.
    * ``dangerous``: of the taken cells, the share that misses a limit by more than the share ``tolerance`` of it. Other
      unsafe cells are marginal.
    * ``refused_by``: of all cells, the shares that are not taken, by the first rule that fails; ``lost_by``: the same
      of the safe cells.
    * ``average_precision`` and ``roc_area``, of the margin as a score; ``roc``: the share of safe cells taken at the
      shares ``ROC_FALSE_SAFE_SHARES`` of unsafe ones.
    * ``regret``: true margin of the best site minus true margin of the chosen site; 1 if the chosen site is unsafe.
    * ``unsafe_choice``: 1 if the chosen site is unsafe, else 0; ``no_site``: 1 if no site is chosen although the truth
      has a safe one, else 0. ``dangerous_choice``: 1 if the chosen site is dangerous, else 0.
    * ``chosen``: row and column of the chosen site, with its margin, ``chosen_margin``, and its true margin,
      ``chosen_true_margin``; ``best``: the safe site with the largest true margin.
    * ``taken_from`` and ``unsafe_from``: by margin of ``THRESHOLDS``, the number of offered and taken cells with at
      least this margin, and the number of unsafe ones among them; ``offered``: number of offered cells.
    * ``cells``: numbers of all cells, of the safe, of the taken, and of the safe and taken ones.
    """
    safe, taken, margin = truth.safe[among], found.safe[among], found.margin[among]
    both = int((safe & taken).sum())
    result: dict[str, Any] = {
        "base_rate": _divide_or_none(safe.sum(), safe.size),
        "taken": _divide_or_none(taken.sum(), safe.size),
        "precision": _divide_or_none(both, taken.sum()),
        "recall": _divide_or_none(both, safe.sum()),
        "false_safe": _divide_or_none(taken.sum() - both, taken.sum()),
        "safe_lost": _divide_or_none(safe.sum() - both, safe.sum()),
        "dangerous": _divide_or_none((taken & ~is_within_tolerance(truth.margin[among], tolerance)).sum(), taken.sum()),
        "refused_by": _divide_by_rule(found.failed[among], int(safe.size)),
        "lost_by": _divide_by_rule(found.failed[among][safe & ~taken], int(safe.sum())),
    }
    result |= rank_scores(margin, safe) | _score_choice(found, truth, among, tolerance, offered)
    result |= _count_by_margin(found, truth, among if offered is None else offered)
    return result | {"cells": [int(safe.size), int(safe.sum()), int(taken.sum()), both]}


def rank_scores(score: Array, positive: Array) -> dict[str, Any]:
    """Return the average precision, the ROC area and the ROC curve of scores (n,) against the truth ``positive`` (n,).

    The curve is sampled at ``ROC_FALSE_SAFE_SHARES``. Equal scores are one step of the curves. Values are None if all
    or none are positive.
    """
    total = int(positive.sum())
    if total in (0, positive.size):
        return {"average_precision": None, "roc_area": None, "roc": None}
    order = np.argsort(-score, kind="stable")
    ends = np.flatnonzero(np.append(score[order][1:] != score[order][:-1], True))
    hits = np.cumsum(positive[order])[ends]
    recall, false = hits / total, (ends + 1 - hits) / (positive.size - total)
    precision = hits / (ends + 1)
    area = float((np.diff(false, prepend=0.0) * (recall + np.append(0.0, recall[:-1])) / 2).sum())
    curve = np.interp(ROC_FALSE_SAFE_SHARES, np.append(0.0, false), np.append(0.0, recall))
    return {
        "average_precision": float((np.diff(recall, prepend=0.0) * precision).sum()),
        "roc_area": area,
        "roc": [round(float(each), 4) for each in curve],
    }


def is_within_tolerance(margin: Array, tolerance: float) -> Array:
    """Return whether margins are at least minus the tolerance, apart from rounding."""
    return np.asarray(margin >= -tolerance - _ROUNDING)


def _divide_by_rule(failed: Array, whole: int) -> dict[str, float]:
    """The shares of a ``whole`` number of cells that have the codes ``failed`` (n,), by the name of the first rule that
    fails. Cells that fail none do not count."""
    counts = np.bincount(failed.astype(np.intp), minlength=len(RULE_NAMES) + 1)[1:]
    return {name: float(count) / whole for name, count in zip(RULE_NAMES, counts, strict=True) if count and whole}


def _score_choice(found: Sites, truth: Sites, among: Array, tolerance: float, offered: Array | None) -> dict[str, Any]:
    place, best = choose_site(found, among if offered is None else offered), choose_site(truth, among)
    scored: dict[str, Any] = {
        "regret": None,
        "unsafe_choice": None,
        "dangerous_choice": None,
        "no_site": None if best is None else float(place is None),
        "chosen": None if place is None else list(place),
        "chosen_margin": None,
        "chosen_true_margin": None,
        "best": None if best is None else list(best),
    }
    if place is None:
        return scored
    unsafe, margin = not truth.safe[place], float(truth.margin[place])
    if best is not None:
        scored["regret"] = 1.0 if unsafe else float(truth.margin[best] - margin)
    return scored | {
        "unsafe_choice": float(unsafe),
        "dangerous_choice": float(unsafe and not is_within_tolerance(truth.margin[place], tolerance)),
        "chosen_margin": float(found.margin[place]),
        "chosen_true_margin": margin if np.isfinite(margin) else None,
    }


def _count_by_margin(found: Sites, truth: Sites, offered: Array) -> dict[str, Any]:
    taken = offered & found.safe
    return {
        "taken_from": _count_margins(found.margin[taken]),
        "unsafe_from": _count_margins(found.margin[taken & ~truth.safe]),
        "offered": int(offered.sum()),
    }


def _count_margins(margin: Array) -> list[int]:
    """Count the margins (n,) that are at least each of ``THRESHOLDS``."""
    below = np.searchsorted(np.sort(margin), THRESHOLDS, side="left")
    return [int(margin.size - count) for count in below]


def _divide_or_none(part: float, whole: float) -> float | None:
    return float(part) / float(whole) if whole else None

"""Calibrates decisions: finds from the losses on grounds the margin from which on a chosen site is guaranteed.

A ground has one loss, the worst of its pairs. The loss of the *choice* is 1 if the chosen site has the margin and is
unsafe, else 0: an abstention has no loss. The loss of the *map* is the unsafe share of the cells with the margin, the
largest at this margin or a larger one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import quote
from ...support.number_text import format_count
from ..inference.risk_control import (
    count_fewest_grounds,
    count_fewest_on_average,
    find_average_threshold,
    find_confident_threshold,
    make_monotone,
)
from ..matchers.methods import describe_method
from .calibration_pairs import StatedPair
from .height_errors import fit_scales
from .scores import THRESHOLDS
from .stored_maps import TRUE_DEPTH
from .workspace import FEATURES

#: Procedures that choose a threshold. The second holds on average over calibrations only.
LEARN_THEN_TEST, CONFORMAL = "learn-then-test", "conformal"
PROCEDURES = {LEARN_THEN_TEST: "Learn-then-Test", CONFORMAL: "conformal risk control"}
#: The p-value up to which a ground counts as unlike the calibration grounds.
MAX_UNLIKE_P = 0.05
#: Limits of alpha and delta. Smaller values would need more grounds than anyone renders.
MIN_RISK, MAX_RISK = 0.001, 0.5
#: The risks that a calibration limits.
CHOICE, MAP = "choice", "map"
_Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Goal:
    """The goal of a calibration: risks of at most ``alpha``, with the confidence 1 - ``delta`` by Learn-then-Test.

    Grounds are grouped by the values of the settings ``group_by``; a threshold is the strictest of all groups.
    """

    alpha: float = 0.05
    delta: float = 0.05
    procedure: str = LEARN_THEN_TEST
    group_by: tuple[str, ...] = ()

    def check(self) -> None:
        """Raise IcyMoonError if a risk or doubt is out of range, or the procedure is unknown."""
        if self.procedure not in PROCEDURES:
            known = " or ".join(PROCEDURES)
            raise IcyMoonError(f"--procedure is {quote(self.procedure)}; give {known}.")
        for option, value in (("--alpha", self.alpha), ("--delta", self.delta)):
            if not MIN_RISK <= value <= MAX_RISK:
                raise IcyMoonError(f"{option} is {value:g}; give a number from {MIN_RISK:g} to {MAX_RISK:g}.")

    @property
    def fewest_grounds(self) -> int:
        """The fewest grounds of a group that are enough for a threshold and for the test of likeness."""
        fewest = (
            count_fewest_grounds(self.alpha, self.delta)
            if self.procedure == LEARN_THEN_TEST
            else count_fewest_on_average(self.alpha)
        )
        return max(fewest, count_fewest_on_average(MAX_UNLIKE_P))

    def find_threshold(self, losses: Array, shares: bool = False) -> int | None:
        """Return the index of the most permissive accepted threshold for losses (grounds, thresholds); None if none is
        accepted.

        Losses are 0 or 1, or with ``shares`` numbers from 0 to 1.
        """
        if self.procedure == LEARN_THEN_TEST:
            return find_confident_threshold(losses, self.alpha, self.delta, shares)
        return find_average_threshold(losses, self.alpha)

    def describe(self) -> str:
        """Describe the guarantee in words, as the beginning of a sentence."""
        risk = f"at most {100 * self.alpha:g} % of grounds of this kind get an unsafe site"
        if self.procedure == LEARN_THEN_TEST:
            return f"with {100 * (1 - self.delta):g} % confidence, {risk}"
        return f"on average over calibrations, and not for this one alone, {risk}"


@dataclass(frozen=True)
class GroundLosses:
    """Decisions of a matcher on the n grounds of a group, at the T thresholds."""

    grounds: list[str]
    choice: Array  # (n, T), 0 or 1
    cells: Array  # (n, T), from 0 to 1: of the map
    acted: Array  # (n, T) bool: a site is chosen
    features: Array  # (n, K)


def count_fewest_pairs(stated: Sequence[StatedPair]) -> int:
    """Return the smallest number of pairs of a ground in a group."""
    return min(Counter((pair.ground, pair.group) for pair in stated).values())


def check_ground_counts(stated: Sequence[StatedPair], goal: Goal) -> None:
    """Raise IcyMoonError unless each group has enough grounds for a guarantee."""
    groups: dict[str, set[str]] = {}
    for pair in stated:
        groups.setdefault(pair.group, set()).add(pair.ground)
    for group in sorted(groups) or [""]:
        _refuse_few_grounds(len(groups.get(group, ())), group, goal)


def _refuse_few_grounds(grounds: int, group: str, goal: Goal, why: str = "") -> None:
    if grounds < goal.fewest_grounds:
        of = f" with {group}" if group else ""
        confidence = (
            f" with {100 * (1 - goal.delta):g} % confidence" if goal.procedure == LEARN_THEN_TEST else " on average"
        )
        raise IcyMoonError(
            f"{format_count(grounds, 'ground')}{of}{why} cannot guarantee a risk of at most {100 * goal.alpha:g} %"
            f"{confidence}: it takes {goal.fewest_grounds} grounds, where all pairs of a seed, or of a place in a "
            "file, count as one; render more seeds."
        )


def calibrate_matchers(
    rows: _Rows, stated: Mapping[str, StatedPair], inputs: Mapping[str, str], goal: Goal
) -> dict[str, dict[str, Any]]:
    """Return the entries of the calibration file by label.

    ``rows`` come from ``decide``, ``stated`` are the statements of pairs by name, ``inputs`` digests of the matchers by
    label. Raises IcyMoonError if a group has too few grounds on which a matcher could be judged, or if no site of any
    ground has a margin.
    """
    entries = {label: _calibrate_matcher(label, rows, stated, goal) | {"inputs": inputs[label]} for label in inputs}
    if not any(entry[CHOICE]["could_act"] for entry in entries.values()):
        raise IcyMoonError(
            "On no ground a site meets the rules by any matcher, so there is nothing to calibrate; give rules that "
            "these grounds can meet."
        )
    return entries


def _calibrate_matcher(label: str, rows: _Rows, stated: Mapping[str, StatedPair], goal: Goal) -> dict[str, Any]:
    own = [row for row in rows if row["method"] == label and row["pair"] in stated]
    groups = {}
    for group in sorted({stated[row["pair"]].group for row in own}):
        groups[group] = collect_losses([row for row in own if stated[row["pair"]].group == group], stated)
        why = f" that {name_matcher(label)} could be judged on"
        _refuse_few_grounds(len(groups[group].grounds), group, goal, why)
    by_ground: dict[str, list[Any]] = {}
    for row in own:
        if row["status"] == "ok":
            by_ground.setdefault(stated[row["pair"]].ground, []).append(row["numbers"])
    return {
        "scales": fit_scales(list(by_ground.values())),
        "left_out": len({(stated[row["pair"]].group, stated[row["pair"]].ground) for row in own})
        - sum(len(losses.grounds) for losses in groups.values()),
        "groups": [
            {"group": group, "grounds": len(losses.grounds), "features": losses.features.tolist()}
            for group, losses in groups.items()
        ],
        CHOICE: _calibrate_risk([each.choice for each in groups.values()], list(groups.values()), goal, shares=False),
        MAP: _calibrate_risk([each.cells for each in groups.values()], list(groups.values()), goal, shares=True),
    }


def _calibrate_risk(
    losses: Sequence[Array], groups: Sequence[GroundLosses], goal: Goal, shares: bool
) -> dict[str, Any]:
    """Return the entry of a risk for the groups' losses (grounds, thresholds).

    ``threshold`` is the strictest threshold that a group needs, None if a group has none. ``acted`` and ``loss`` are
    the number of grounds that act at this threshold, and their sum of losses.
    """
    found = [goal.find_threshold(each, shares) for each in losses]
    accepted = [at for at in found if at is not None]
    at = min(accepted) if accepted and len(accepted) == len(found) else None
    return {
        "threshold": None if at is None else THRESHOLDS[at],
        "by_group": [None if each is None else THRESHOLDS[each] for each in found],
        "loss": 0.0 if at is None else float(sum(each[:, at].sum() for each in losses)),
        "acted": 0 if at is None else int(sum(each.acted[:, at].sum() for each in groups)),
        "could_act": int(sum(each.acted.any(axis=1).sum() for each in groups)),
    }


def collect_losses(rows: _Rows, stated: Mapping[str, StatedPair]) -> GroundLosses:
    """Return the losses of a matcher's rows on the pairs of a group.

    A ground is left out if one of its pairs failed or contradicts itself.
    """
    by_ground: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        by_ground.setdefault(stated[row["pair"]].ground, []).append(row)
    usable = {ground: own for ground, own in sorted(by_ground.items()) if all(row["status"] == "ok" for row in own)}
    curves = [np.stack([np.stack(_find_curves(row)) for row in own]).max(axis=0) for own in usable.values()]
    stacked = np.array(curves).reshape(-1, 3, len(THRESHOLDS))
    features = [average_features(own) for own in usable.values()]
    return GroundLosses(
        list(usable),
        stacked[:, 0],
        make_monotone(stacked[:, 1]),
        stacked[:, 2] > 0,
        np.array(features).reshape(-1, len(FEATURES)),
    )


def _find_curves(row: Mapping[str, Any]) -> tuple[Array, Array, Array]:
    """Return the losses of choice and map, and whether a site is chosen, at all thresholds for a row of ``decide``."""
    sites = row["numbers"]["sites"]
    margin = sites["chosen_margin"]
    acted = np.array(THRESHOLDS) <= (-np.inf if margin is None else margin)
    taken, unsafe = (np.array(sites[key], float) for key in ("taken_from", "unsafe_from"))
    return (
        (acted & (sites["unsafe_choice"] == 1)).astype(float),
        np.divide(unsafe, taken, out=np.zeros(len(THRESHOLDS)), where=taken > 0),
        acted.astype(float),
    )


def has_margin(sites: Mapping[str, Any], threshold: float | None) -> bool:
    """Return whether a site is chosen and has at least this margin; False without a threshold."""
    return threshold is not None and sites["chosen_margin"] is not None and sites["chosen_margin"] >= threshold


def average_features(rows: _Rows) -> list[float]:
    """Average ``workspace.FEATURES`` over the rows of a ground."""
    return np.mean([[row["numbers"]["features"][name] for name in FEATURES] for row in rows], axis=0).tolist()


def make_sentences(entries: Mapping[str, Mapping[str, Any]], goal: Goal) -> list[str]:
    """Describe the calibration in words: a sentence for each matcher, and one on the groups."""
    found = []
    for label, entry in entries.items():
        name, choice = name_matcher(label), entry[CHOICE]
        grounds = sum(each["grounds"] for each in entry["groups"])
        counts = f"{PROCEDURES[goal.procedure]}, {format_count(grounds, 'ground')}"
        left = f"{entry['left_out']} left out because a pair could not be judged, " if entry["left_out"] else ""
        if choice["threshold"] is None or not choice["acted"]:
            found.append(f"With {name}, no margin that a site has gives a guarantee, so it always abstains ({counts}).")
            continue
        found.append(
            f"With {name}, sites from a margin of {choice['threshold']:.2f} on are guaranteed: {goal.describe()} "
            f"({counts}, {left}{choice['loss']:.0f} of them unsafe; it acts on {choice['acted']} and abstains on "
            f"{grounds - choice['acted']})."
        )
    if goal.group_by:
        found.append(
            "A margin is the strictest of all groups, and the guarantee holds for each group by itself, not for all at "
            "once."
        )
    return found


def name_matcher(label: str) -> str:
    """Return the name of a matcher or of the true depth in a sentence."""
    return "the true depth" if label == TRUE_DEPTH else describe_method(label)

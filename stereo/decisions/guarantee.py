"""Uses a calibration: finds the guaranteed sites, the grounds on which a lander abstains, and the share of unsafe
sites.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...support.number_text import format_count
from ..inference.risk_control import bound_risk, compare_with_grounds
from .calibration import (
    CHOICE,
    LEARN_THEN_TEST,
    MAP,
    MAX_UNLIKE_P,
    PROCEDURES,
    average_features,
    has_margin,
    name_matcher,
)
from .calibration_file import Calibration
from .calibration_pairs import StatedPair
from .height_errors import QUANTITIES, check_scale, make_check_sentence
from .scores import THRESHOLDS
from .stored_maps import ABSTAINS, GUARANTEED, UNLIKE
from .workspace import FEATURES

#: Reasons beside ``FEATURES`` for which a ground is unlike: its group, or a pair that failed or contradicts itself.
_OTHER_GROUP, _FAILED_PAIR = "group", "failed pair"
_Row = Mapping[str, Any]


def apply_calibration(
    calibration: Calibration, rows: Sequence[_Row], stated: Mapping[str, StatedPair]
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the rows with the entry ``guarantee``, and the entry ``guarantee`` of ``decisions.json``.

    In a row's entry, ``verdict`` is GUARANTEED, ABSTAINS or UNLIKE, ``p`` the p-value of its ground and ``feature`` the
    number that differs most. The entry is None if the pair failed or contradicts itself; then the other pairs of its
    ground are UNLIKE.
    """
    found = {}
    for label, entry in calibration.entries.items():
        by_ground: dict[tuple[str, str], list[_Row]] = {}
        for row in (row for row in rows if row["method"] == label and row["pair"] in stated):
            by_ground.setdefault((stated[row["pair"]].ground, stated[row["pair"]].group), []).append(row)
        for (_, group), own in by_ground.items():
            pairs = [row for row in own if row["status"] == "ok"]
            # A calibration leaves grounds with failed pairs out, so it guarantees nothing on them.
            likeness = (
                _compare_ground(entry, group, pairs) if len(pairs) == len(own) else {"p": 0.0, "feature": _FAILED_PAIR}
            )
            for row in pairs:
                found[row["pair"], label] = likeness | {"verdict": _judge_row(entry, row, likeness)}
    marked = [dict(row) | {"guarantee": found.get((row["pair"], row["method"]))} for row in rows]
    goal = calibration.goal
    return marked, {
        "file": str(calibration.path),
        "alpha": goal.alpha,
        "delta": goal.delta if goal.procedure == LEARN_THEN_TEST else None,
        "procedure": goal.procedure,
        "groups": list(goal.group_by),
        "grounds": len(calibration.grounds) - max(entry["left_out"] for entry in calibration.entries.values()),
        "methods": [_summarise_method(label, calibration, marked, stated) for label in _list_labels(rows)],
    }


def _list_labels(rows: Sequence[_Row]) -> list[str]:
    return list(dict.fromkeys(row["method"] for row in rows))


def _compare_ground(entry: Mapping[str, Any], group: str, rows: Sequence[_Row]) -> dict[str, Any]:
    """Compare a ground, from its rows in a group, with the calibration grounds of this group."""
    own = next((each for each in entry["groups"] if each["group"] == group), None)
    if own is None:
        return {"p": 0.0, "feature": _OTHER_GROUP}
    likeness = compare_with_grounds(np.array(own["features"], float), np.array(average_features(rows)))
    return {"p": likeness.p, "feature": FEATURES[likeness.feature]}


def _judge_row(entry: Mapping[str, Any], row: _Row, likeness: Mapping[str, Any]) -> str:
    if likeness["p"] <= MAX_UNLIKE_P:
        return UNLIKE
    return GUARANTEED if has_margin(row["numbers"]["sites"], entry[CHOICE]["threshold"]) else ABSTAINS


def _summarise_method(
    label: str, calibration: Calibration, rows: Sequence[_Row], stated: Mapping[str, StatedPair]
) -> dict[str, Any]:
    """Count the grounds of a matcher by verdict, each ground once, with bounds at the calibration's delta."""
    by_ground: dict[str, list[_Row]] = {}
    for row in rows:
        if row["method"] == label and row["guarantee"]:
            by_ground.setdefault(stated[row["pair"]].ground, []).append(row)
    acting = [[row for row in own if row["guarantee"]["verdict"] == GUARANTEED] for own in by_ground.values()]
    alike = [any(row["guarantee"]["verdict"] != UNLIKE for row in own) for own in by_ground.values()]
    grounds, acted = len(by_ground), sum(map(bool, acting))
    unsafe = sum(any(row["numbers"]["sites"]["unsafe_choice"] == 1 for row in own) for own in acting)
    entry, delta = calibration.entries[label], calibration.goal.delta
    return {
        "method": label,
        "threshold": entry[CHOICE]["threshold"],
        "map_threshold": entry[MAP]["threshold"],
        "map_taken": _average_taken(entry[MAP]["threshold"], by_ground),
        "grounds": grounds,
        "acted": acted,
        "acted_bounds": bound_share(acted, grounds, delta),
        "unlike": alike.count(False),
        "abstained": grounds - acted - alike.count(False),
        "unsafe": unsafe,
        "unsafe_bound": bound_risk(unsafe, grounds, delta),
        "confidence": 1 - delta,
        "errors": _check_scales(entry["scales"], list(by_ground.values())),
    }


def _check_scales(scales: Mapping[str, float | None], grounds: Sequence[Sequence[_Row]]) -> dict[str, Any]:
    """Check the calibrated errors of maps by quantity, see ``height_errors.check_scale``."""
    numbers = [[row["numbers"] for row in own] for own in grounds]
    return {
        name: None if scale is None else {"scale": scale, "check": check_scale(numbers, name, scale)}
        for name, scale in ((name, scales[name]) for name in QUANTITIES)
    }


def _average_taken(threshold: float | None, by_ground: Mapping[str, Sequence[_Row]]) -> float | None:
    """Average over grounds the share of cells with the margin of the map; None without a margin.

    A ground without a guarantee counts as 0.
    """
    if threshold is None or not by_ground:
        return None
    at = THRESHOLDS.index(threshold)

    def find_share(row: _Row) -> float:
        sites = row["numbers"]["sites"]
        unlike = row["guarantee"]["verdict"] == UNLIKE
        return 0.0 if unlike else float(sites["taken_from"][at]) / max(1, sites["offered"])

    return float(np.mean([np.mean([find_share(row) for row in own]) for own in by_ground.values()]))


def bound_share(count: int, grounds: int, doubt: float) -> list[float]:
    """Return the interval of a share with confidence 1 - ``doubt`` by Clopper and Pearson (1934)."""
    return [1 - bound_risk(grounds - count, grounds, doubt / 2), bound_risk(count, grounds, doubt / 2)]


def make_guarantee_sentences(guarantee: Mapping[str, Any]) -> list[str]:
    """Describe the guarantee and its result: one sentence on the calibration, and one for each matcher."""
    risk = f"a chosen site is unsafe on at most {100 * guarantee['alpha']:g} % of grounds like the calibration grounds"
    confidence = (
        f"with {100 * (1 - guarantee['delta']):g} % confidence"
        if guarantee["delta"] is not None
        else "on average over calibrations, and not for this one alone"
    )
    head = (
        f"Guarantee for each matcher by itself, from {format_count(guarantee['grounds'], 'calibration ground')} by "
        f"{PROCEDURES[guarantee['procedure']]}: {confidence}, {risk}{' of each group' if guarantee['groups'] else ''}."
    )
    return [head, *map(_make_sentence, guarantee["methods"]), *_make_error_sentences(guarantee["methods"])]


def _make_error_sentences(methods: Sequence[Mapping[str, Any]]) -> list[str]:
    """Describe the checks of the heights' standard deviations.

    ``decisions.json`` has the checks of slope and roughness, too.
    """
    found = []
    for entry in methods:
        stated = entry["errors"]["height"]
        if stated is not None and stated["check"] is not None:
            found.append(make_check_sentence("height", name_matcher(entry["method"]), stated["check"]))
    return found


def _make_sentence(entry: Mapping[str, Any]) -> str:
    low, high = entry["acted_bounds"]
    grounds = format_count(entry["grounds"], "ground")
    unlike = (
        f", and on {entry['unlike']}, which {'is' if entry['unlike'] == 1 else 'are'} unlike the calibration grounds, "
        "it has no guarantee"
        if entry["unlike"]
        else ""
    )
    bound = f"{100 * entry['unsafe_bound']:.1f} % with {100 * entry['confidence']:g} % confidence"
    return (
        f"With {name_matcher(entry['method'])}, the lander takes a guaranteed site on {entry['acted']} of {grounds} "
        f"({100 * low:.0f} to {100 * high:.0f} %) and abstains on {entry['abstained']}{unlike}; {entry['unsafe']} of "
        f"{grounds} get an unsafe site, a share of at most {bound}."
    )

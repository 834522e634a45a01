"""Measures which faults of joints a matcher's pose of the scoop shows, on pairs with a joint off by a known angle.

The score of a pair is the distance of the found scoop from its mean place in the pairs without a fault that have the
same commanded angles. The mean removes the constant error of a matcher. A score above the limit means a fault; 5 of 100
pairs without a fault exceed the limit. Each pair without a fault is scored against the mean of the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.number_text import format_count
from ..matchers.methods import describe_method

#: Fewest pairs without a fault for a limit.
FEWEST_FAULTLESS_PAIRS = 6
#: The 95 % quantile of Student's t by degrees of freedom; between two entries, the one with fewer degrees counts.
_STUDENT_T_95 = {5: 2.015, 6: 1.943, 7: 1.895, 8: 1.860, 9: 1.833, 10: 1.812, 15: 1.753, 20: 1.725, 30: 1.697}
#: Angles that differ by less than this are equal, degrees.
_ANGLE_TOLERANCE_DEG = 1e-4
_Entry = Mapping[str, Any]


def find_joint_faults(rows: Sequence[_Entry], facts: Sequence[_Entry], labels: Sequence[str]) -> list[dict[str, Any]]:
    """Return an entry for each method and each joint that is off in some pair; empty if no pair has exactly one faulty
    joint.

    ``angles`` have by angle (degrees, either way) the number of ``pairs``, the share ``noticed``, and the ``roc_area``
    against the pairs without a fault. ``noticed_from_deg`` is the smallest angle from which on every pair is noticed,
    or None. ``limit_mm`` is the limit, ``sound`` the number of pairs without a fault, and ``false_alarms`` the share of
    them above the limit. ``note`` is the reason for a missing number, or empty. A pair in which no pose is found is not
    noticed.
    """
    joints: dict[str, dict[str, Any]] = {fact["pair"]: fact["joints"] for fact in facts if fact.get("joints")}
    off = {pair: _read_faults(stated) for pair, stated in joints.items()}
    names = list(dict.fromkeys(joint for faults in off.values() if len(faults) == 1 for joint in faults))
    found = []
    for label in labels if names else ():
        own = {
            row["pair"]: row["numbers"].get("scoop", {}).get("found_mm")
            for row in rows
            if row["method"] == label and row["status"] == "ok" and row["pair"] in joints
        }
        found += _find_by_method(label, names, own, joints, off)
    return found


def _find_by_method(
    label: str,
    names: Sequence[str],
    own: Mapping[str, Any],
    joints: Mapping[str, Any],
    off: Mapping[str, Mapping[str, float]],
) -> list[dict[str, Any]]:
    sound: dict[str, list[Array]] = {}
    for pair, place in own.items():
        if not off[pair] and place is not None:
            sound.setdefault(_make_commanded_key(joints[pair]), []).append(np.array(place))
    scores = np.array([score for places in sound.values() for score in _score_leaving_one_out(places)])
    limit = _find_fault_limit(scores)
    found = []
    for joint in names:
        angles: dict[float, list[float]] = {}
        for pair, place in own.items():
            if list(off[pair]) == [joint] and _make_commanded_key(joints[pair]) in sound:
                middle = np.mean(sound[_make_commanded_key(joints[pair])], axis=0)
                score = -math.inf if place is None else float(np.linalg.norm(np.array(place) - middle))
                angles.setdefault(abs(off[pair][joint]), []).append(score)
        found.append(
            {
                "method": label,
                "joint": joint,
                **_measure_rates(angles, scores, limit),
                "limit_mm": limit,
                "sound": len(scores),
                "false_alarms": float((scores > limit).mean()) if limit is not None else None,
                "note": ""
                if limit is not None
                else f"By {describe_method(label)} it cannot be given which fault is noticed: "
                f"{format_count(len(scores), 'pair')} without a fault, at "
                f"the commanded angles of those with one, show the scoop, and it takes {FEWEST_FAULTLESS_PAIRS}; add "
                "some with other noise, as datasets/arm_faults has.",
            }
        )
    return found


def _measure_rates(angles: Mapping[float, Sequence[float]], sound: Array, limit: float | None) -> dict[str, Any]:
    rates = [
        {
            "deg": angle,
            "pairs": len(scores),
            "roc_area": compute_roc_area(np.array(scores), sound),
            "noticed": None if limit is None else float((np.array(scores) > limit).mean()),
        }
        for angle, scores in sorted(angles.items())
    ]
    surely: float | None = None
    for rate in reversed(rates):
        if rate["noticed"] != 1.0:
            break
        surely = rate["deg"]
    every = np.array([score for scores in angles.values() for score in scores])
    return {"angles": rates, "noticed_from_deg": surely, "roc_area": compute_roc_area(every, sound)}


def compute_roc_area(scores: Array, sound: Array) -> float | None:
    """Return the area under the ROC curve; None without scores of either kind.

    It is the probability that a pair with a fault (n,) scores more than a pair without (m,); equal scores count half
    (Mann and Whitney).
    """
    if not (len(scores) and len(sound)):
        return None
    above = scores[:, None] > sound
    return float(above.mean() + (scores[:, None] == sound).mean() / 2)


def _score_leaving_one_out(places: Sequence[Array]) -> list[float]:
    """Return the distance, m, of each place (3,) from the mean of the other places; empty for a single place."""
    total, count = np.sum(places, axis=0), len(places)
    return [float(np.linalg.norm(place - (total - place) / (count - 1))) for place in places] if count > 1 else []


def _find_fault_limit(scores: Array) -> float | None:
    """Return the limit that a fault-free score exceeds in 5 of 100 cases; None below ``FEWEST_FAULTLESS_PAIRS`` scores.

    It is computed from the scores' mean and standard deviation by Student's t.
    """
    if len(scores) < FEWEST_FAULTLESS_PAIRS:
        return None
    free = len(scores) - 1
    factor = _STUDENT_T_95[max(key for key in _STUDENT_T_95 if key <= free)]
    return float(scores.mean() + factor * scores.std(ddof=1) * math.sqrt(1 + 1 / len(scores)))


def _read_faults(stated: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    return {joint: angle for joint, angle in stated["fault"].items() if abs(angle) > _ANGLE_TOLERANCE_DEG}


def _make_commanded_key(stated: Mapping[str, Mapping[str, float]]) -> str:
    return repr(sorted(stated["commanded"].items()))

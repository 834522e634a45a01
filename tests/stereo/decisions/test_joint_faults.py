"""Faults of joints that a pose of the scoop shows: laws of limits and of ROC curves, on places that were put in."""

from __future__ import annotations

import numpy as np
from icymoon.stereo.decisions.joint_faults import (
    FEWEST_FAULTLESS_PAIRS,
    _find_fault_limit,
    _score_leaving_one_out,
    compute_roc_area,
    find_joint_faults,
)


def find(places, faults):
    """What pairs tell whose scoop is found at these places (mm, or None) with these faults of joints."""
    rows = [
        {
            "pair": str(k),
            "method": "bm",
            "status": "ok",
            "numbers": {"scoop": {"found_mm": None if place is None else list(place)}},
        }
        for k, place in enumerate(places)
    ]
    told, sound = {"yaw": 1.0, "elbow": 2.0}, {"yaw": 0.0, "elbow": 0.0}
    facts = [{"pair": str(k), "joints": {"commanded": told, "fault": sound | fault}} for k, fault in enumerate(faults)]
    return find_joint_faults(rows, facts, ["bm"])


def test_a_fault_is_noticed_from_the_angle_on_whose_shift_is_beyond_the_limit():
    random = np.random.default_rng(1)
    # Without a fault the scoop is found 20 mm off, always the same way: no fault.
    sound = random.normal((20, 0, 0), 0.5, (8, 3))
    angles = (0.02, 1.0, 2.0, -4.0)
    places = [*sound, *((20 + 10 * angle, 0, 0) for angle in angles)]
    (found,) = find(places, [{}] * 8 + [{"yaw": angle} for angle in angles])
    assert [(each["deg"], each["noticed"]) for each in found["angles"]] == [(0.02, 0), (1, 1), (2, 1), (4, 1)]
    assert found["noticed_from_deg"] == 1.0
    assert found["sound"] == 8
    assert 0.5 < found["limit_mm"] < 5
    assert [each["roc_area"] for each in found["angles"]][1:] == [1, 1, 1]
    assert found["note"] == ""


def test_with_too_few_sound_pairs_no_number_is_given_but_a_sentence():
    places = [(0, 0, 0)] * (FEWEST_FAULTLESS_PAIRS - 1) + [(9, 0, 0)]
    (found,) = find(places, [{}] * (FEWEST_FAULTLESS_PAIRS - 1) + [{"elbow": 1.0}])
    assert found["limit_mm"] is found["noticed_from_deg"] is found["angles"][0]["noticed"] is None
    assert f"takes {FEWEST_FAULTLESS_PAIRS}" in found["note"]


def test_pairs_without_a_pose_are_not_noticed_and_two_faults_at_once_count_nowhere():
    places = [(k % 2, 0, 0) for k in range(8)] + [None, (50, 0, 0)]
    (found,) = find(places, [{}] * 8 + [{"yaw": 4.0}, {"yaw": 4.0, "elbow": 1.0}])
    assert found["angles"] == [{"deg": 4.0, "pairs": 1, "roc_area": 0.0, "noticed": 0.0}]
    assert find(places[:8], [{}] * 8) == []
    assert find_joint_faults([], [], ["bm"]) == []


def test_one_more_sound_pair_is_beyond_the_limit_in_five_of_a_hundred():
    random = np.random.default_rng(2)
    false = []
    for _ in range(1500):
        places = random.normal(0, 1, (9, 3))
        limit = _find_fault_limit(np.array(_score_leaving_one_out(list(places[:8]))))
        false.append(np.linalg.norm(places[8] - places[:8].mean(axis=0)) > limit)
    # Scores are lengths, not normal, and share their mean: a per cent or two more than five.
    assert 0.03 < np.mean(false) < 0.09


def test_the_area_is_the_chance_that_a_fault_scores_more():
    assert compute_roc_area(np.array([2.0, 3.0]), np.array([1.0])) == 1.0
    assert compute_roc_area(np.array([1.0]), np.array([1.0, 2.0])) == 0.25
    assert compute_roc_area(np.array([]), np.array([1.0])) is None

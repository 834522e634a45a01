"""What losses and costs show: energies and losses by hand, a known front, and Kendall's tau by an independent count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from icymoon.stereo.design.compare_suites import (
    BEATEN,
    ENERGY,
    FAILS,
    FRONT,
    HOLDS,
    OPEN,
    RISK,
    TIME,
    Measured,
    collect_numbers,
    compare,
    compare_rankings,
    compute_energy,
    compute_loss,
    find_front,
    summarise,
)
from icymoon.stereo.design.read_design import find_design, read_design

GROUNDS = 60
DESIGN = read_design(find_design("suites"))


def make_numbers(unsafe=0.0, no_site=0.0, cpu_s=0.1, frames=1, points=0):
    """The numbers of a row; ``unsafe`` is None without a choice."""
    return {
        "unsafe_choice": unsafe,
        "dangerous_choice": unsafe,
        "no_site": no_site,
        "fails": "slope" if unsafe else None,
        "cells": [100, 40, 20, 10],
        "cpu_s": cpu_s,
        "exposure_s": 0.5,
        "frames": frames,
        "points": points,
    }


def make_measured(loss, energy, seconds):
    """Numbers (grounds, suites) with constant costs and losses of the first grounds of each suite, by their number."""
    table = np.where(np.arange(GROUNDS)[:, None] < np.array(loss), 1.0, 0.0)
    zero, ones = np.zeros(table.shape), np.ones(table.shape)
    costs = {"camera": ones * energy, "processor": zero, "lidar": zero, "lamp": zero}
    names = tuple(map(str, range(GROUNDS)))
    return Measured(names, table, costs, ones * seconds, ones, table, zero, zero, 0)


def test_a_loss_is_that_of_the_worst_outcome():
    assert compute_loss(make_numbers(unsafe=1.0), 0.2) == 1
    assert compute_loss(make_numbers(unsafe=0.0), 0.2) == 0
    assert compute_loss(make_numbers(unsafe=None, no_site=1.0), 0.2) == 0.2
    assert compute_loss(make_numbers(unsafe=None, no_site=None), 0.2) == 0  # there was no safe site


def test_energy_is_power_times_time_of_each_part():
    suite = DESIGN.suites[0]
    costs = replace(
        DESIGN.costs,
        camera_w=3.0,
        readout_px_s=320 * 240 / 2,
        processor_w=10.0,
        processor_slowdown=100.0,
        lidar_w=20.0,
        lidar_points_s=50.0,
        lidar_ready_s=7.0,
    )
    # Two cameras of 3 W for three exposures of 0.5 s in all and three reads of 2 s.
    found = compute_energy(make_numbers(cpu_s=0.2, frames=3, points=100), suite, costs)
    assert found == pytest.approx({"camera": 2 * 3 * 6.5, "processor": 200.0, "lidar": 20 * 9.0, "lamp": 0.0})
    assert compute_energy(make_numbers(), suite, costs)["lidar"] == 0  # it is off
    (lit,) = (suite for suite in DESIGN.suites if suite.lamp)  # a lamp of 20 W
    assert compute_energy(make_numbers() | {"lamp_s": 0.3}, lit, costs)["lamp"] == pytest.approx(6.0)


def test_a_constructed_table_has_the_known_front():
    """Suite 1 has less risk than 0 at no more cost; 2 has least energy; 3 and 4 are alike but for a rare loss."""
    measured = make_measured([40, 4, 50, 0, 1], [5.0, 5.0, 1.0, 9.0, 9.0], [2.0, 1.0, 2.0, 2.0, 2.0])
    found = find_front(compare(measured))
    assert [each["place"] for each in found] == [BEATEN, FRONT, FRONT, OPEN, OPEN]
    assert found[0] == {"place": BEATEN, "by": [1], "against": []}
    assert (found[3]["against"], found[4]["against"]) == ([1, 4], [1, 3])


def test_suites_with_equal_numbers_are_open_and_never_beat_each_other():
    found = find_front(compare(make_measured([7, 7], [5.0, 5.0], [1.0, 1.0])))
    assert [each["place"] for each in found] == [OPEN, OPEN]
    alone = find_front(compare(make_measured([7], [5.0], [1.0])))
    assert alone == [{"place": FRONT, "by": [], "against": []}]


def test_few_grounds_decide_nothing_about_cost():
    measured = make_measured([0, 60], [1.0, 5.0], [1.0, 2.0])
    few = replace(
        measured,
        loss=measured.loss[:19],
        parts_j={part: each[:19] for part, each in measured.parts_j.items()},
        cpu_s=measured.cpu_s[:19],
    )
    bounds = compare(few)
    assert np.isnan(bounds[ENERGY][0, 1]).all()
    assert np.isnan(bounds[TIME][0, 1]).all()
    assert bounds[RISK][0, 1, 1] < 0
    assert find_front(bounds)[1]["place"] != BEATEN


@pytest.mark.left_to_ci
def test_rankings_of_the_same_grounds_agree_exactly():
    loss = make_measured([1, 20, 40, 60], [1.0] * 4, [1.0] * 4).loss
    found = compare_rankings(loss, loss, 0)
    assert found == {"tau": 1.0, "interval": [1.0, 1.0], "halves": 1.0, "verdict": HOLDS}
    turned = compare_rankings(loss, loss[:, ::-1], 0)
    assert turned == {"tau": -1.0, "interval": [-1.0, -1.0], "halves": 1.0, "verdict": FAILS}
    level = np.zeros((GROUNDS, 4))
    unknown = compare_rankings(level, loss, 0)
    assert unknown == {"tau": None, "interval": [-1.0, 1.0], "halves": None, "verdict": OPEN}


@pytest.mark.left_to_ci
def test_noise_alone_is_no_instability():
    """Suites of one true risk are ranked by chance. Their rankings agree badly, and so do those of halves."""
    random = np.random.default_rng(1)
    own, other = (np.where(random.random((GROUNDS, 8)) < 0.1, 1.0, 0.0) for _ in range(2))
    found = compare_rankings(own, other, 0)
    assert found["interval"][1] < 0.8
    assert found["halves"] < 0.5
    assert found["verdict"] == OPEN


@pytest.mark.left_to_ci
def test_tau_of_a_known_table_is_a_count_by_hand():
    """Of the six pairs of 4 suites, one is in another order, and one is tied in the second ranking."""
    own = make_measured([0, 10, 20, 30], [1.0] * 4, [1.0] * 4).loss
    other = make_measured([10, 0, 20, 20], [1.0] * 4, [1.0] * 4).loss
    found = compare_rankings(own, other, 0)
    assert found["tau"] == pytest.approx((4 - 1) / np.sqrt(6 * 5))
    low, high = found["interval"]
    assert low <= found["tau"] <= high


def test_a_summary_counts_and_grounds_with_a_failed_suite_are_left_out():
    names = [suite.name for suite in DESIGN.suites]
    outcomes = [(1.0, 0.0), (0.0, 0.0), (None, 1.0), (None, None)]
    rows = {
        f"ground-0-{k}": {
            name: {
                "status": "ok",
                "numbers": make_numbers(*outcomes[k % 4], points=100 * (name == "lidar_100")) | {"lamp_s": 0.1},
            }
            for name in names
        }
        for k in range(40)
    }
    rows["ground-0-40"] = {name: {"status": "failed" if name == "bm" else "ok", "numbers": None} for name in names}
    measured = collect_numbers(DESIGN, rows)
    assert (len(measured.grounds), measured.left_out) == (40, 1)
    for entry in summarise(DESIGN, measured):
        assert (entry["grounds"], entry["acted"], entry["unsafe"], entry["dangerous"]) == (40, 20, 10, 10)
        assert entry["risk"]["mean"] == pytest.approx((1 + 0.2) / 4)
        assert entry["lost"]["mean"] == pytest.approx(0.75)
        low, high = entry["risk"]["interval"]
        assert low < entry["risk"]["mean"] < high
        assert entry["energy_j"]["mean"] == pytest.approx(sum(entry["energy_parts_j"].values()))
        assert (entry["energy_parts_j"]["lidar"] > 0) == (entry["suite"] == "lidar_100")
        assert entry["unsafe_bound"] == pytest.approx(0.38706, abs=1e-5)  # 95 % of a beta distribution of 11 and 30

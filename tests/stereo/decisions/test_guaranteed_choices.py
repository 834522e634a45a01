"""The risk of guaranteed sites on simulated grounds, by the simulation of the manual, in short."""

from __future__ import annotations

import argparse
import math

import numpy as np
import pytest
from icymoon.benchmarks.stereo import guaranteed_choices as simulation
from icymoon.stereo.decisions.calibration import CONFORMAL, LEARN_THEN_TEST, Goal

pytestmark = [pytest.mark.long, pytest.mark.timeout(900), pytest.mark.filterwarnings("error")]
CALIBRATIONS, GROUNDS = 600, 120


@pytest.fixture(scope="module")
def populations():
    """Choices of two stand-ins on two populations of grounds, by score."""
    random = np.random.default_rng(1)
    return {
        name: [
            simulation.decide(simulation.STAND_INS[name], GROUNDS, rough, random)
            for rough in (1.0, simulation.OTHER_ROUGHNESS)
        ]
        for name in ("BM-like", "SGBM-like")
    }


def summarise(population, score, procedure=LEARN_THEN_TEST):
    options = argparse.Namespace(seed=0, calibrations=CALIBRATIONS)
    own, other = (simulation.collect(each[score]) for each in population)
    return simulation.summarise(own, other, 60, Goal(procedure=procedure), options)


@pytest.mark.parametrize("score", list(simulation.SCORES))
@pytest.mark.parametrize("name", ["BM-like", "SGBM-like"])
def test_the_risk_is_at_most_alpha_with_the_stated_confidence(populations, name, score):
    found = summarise(populations[name], score)
    assert found["exceeds"] <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / CALIBRATIONS)
    average = summarise(populations[name], score, CONFORMAL)
    assert average["risk"] <= 0.05 + 3 * 0.05 / math.sqrt(CALIBRATIONS)  # a risk's deviation is below its mean here
    assert average["acted"] >= found["acted"]


def test_margins_of_shares_with_room_let_a_lander_act(populations):
    """With margins in units of the limit, the choices of all well known sites are ties, and a threshold keeps few."""
    today, before = (summarise(populations["SGBM-like"], score)["acted"] for score in ("today", "before 0.4"))
    assert before + 0.2 < today

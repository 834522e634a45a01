"""The environment of a landed day: its steps, what it refuses, and that equal steps give equal bits."""

from __future__ import annotations

import re
from dataclasses import fields

import numpy as np
import pytest
from icymoon.settings.description import merged
from icymoon.stereo.design import made_workspaces
from icymoon.stereo.design.default_lander import GENTLE_TERRAINS
from icymoon.stereo.design.made_workspaces import draw_recipes
from icymoon.stereo.landed_day import day as days
from icymoon.stereo.landed_day.day import LandedDay
from icymoon.stereo.landed_day.episodes import DAY_LANDER, draw_start
from icymoon.stereo.learning.grounds import Variety
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError

(RECIPE,) = draw_recipes(0, "ground", 1, Variety(GENTLE_TERRAINS))
MORNING = draw_start(DAY_LANDER, RECIPE)
(BM,) = parse_methods("bm")


@pytest.fixture
def day():
    made = LandedDay(RECIPE, MORNING, BM)
    yield made
    made.close()


@pytest.fixture
def true_disparities(monkeypatch):
    """A matcher that is never wrong."""
    monkeypatch.setattr(
        days, "match_disparity", lambda prepared, method: (prepared.pair.camera.disparity(prepared.truth), 0.0)
    )


def list_bits(seen):
    """All entries of an observation, arrays as bytes."""
    values = (getattr(seen, field.name) for field in fields(seen))
    return [value.tobytes() if isinstance(value, np.ndarray) else repr(value) for value in values]


def test_equal_steps_give_equal_bits():
    def live():
        made = LandedDay(RECIPE, MORNING, BM)
        try:
            return [list_bits(made.step(action)) for action in ("look", "look", "choose", "dig", "verify")]
        finally:
            made.close()

    assert live() == live()


def test_each_look_has_noise_and_a_sun_of_its_own(day):
    first = day.step("look")
    day.step("wait", hours=3.0)
    second = day.step("look")
    assert second.sun_elevation_deg > first.sun_elevation_deg + 10
    assert (first.left != second.left).mean() > 0.5
    assert (first.looks, second.looks) == (1, 2)


@pytest.mark.usefixtures("true_disparities")
def test_a_day_without_errors_of_matching_takes_a_sample(day):
    for action in ("look", "choose", "dig", "verify", "dig", "dig"):
        seen = day.step(action)
    assert (seen.bites, seen.verified, seen.removed_m3) == (3, False, None)
    assert day.step("stop").done
    found = day.find_outcome()
    scoop = MORNING.excavation
    prism = 3 * scoop.bite_m * scoop.length_m * scoop.width_m
    assert (found["end"], found["dangerous"]) == (days.SAMPLED, False)
    assert prism <= found["true_removed_m3"] < 1.1 * prism


@pytest.mark.usefixtures("true_disparities")
def test_the_verified_volume_agrees_with_the_truth(day):
    """The lander sees one bite of 2 cm but for a strip at the near rim, which cells of 2 cm cut off with the rest."""
    for action in ("look", "choose", "dig"):
        day.step(action)
    seen = day.step("verify")
    assert seen.removed_m3 == pytest.approx(day.find_outcome()["true_removed_m3"], rel=0.15)


@pytest.mark.usefixtures("true_disparities")
def test_an_unsafe_site_is_unsafe_and_nothing_dug_is_abstaining(day):
    day.step("look")
    unsafe = np.argwhere(~day._workspace.truth.sites.safe & day._workspace.inside)[0]
    day.step("choose", site=tuple(int(each) for each in unsafe))
    assert day.find_outcome()["end"] == days.ABSTAINED
    day.step("dig")
    assert day.find_outcome()["end"] == days.UNSAFE


def test_a_step_beyond_the_energy_is_not_done_and_ends_the_day():
    made = LandedDay(RECIPE, MORNING, BM, most_energy_wh=15.0)
    try:
        first = made.step("look")
        assert first.energy_wh == days.ENERGY_WH["look"] + days.IDLE_W * days.HOURS["look"]
        last = made.step("wait", hours=1.0)
        assert (last.done, last.out_of_energy) == (True, True)
        assert (last.energy_wh, last.hours) == (first.energy_wh, first.hours)
        with pytest.raises(IcyMoonError, match="The day is over"):
            made.step("look")
    finally:
        made.close()


@pytest.mark.parametrize(
    ("before", "action", "more", "why"),
    [
        ((), "jump", {}, "choose one of look, wait, choose, dig, verify, stop"),
        ((), "wait", {}, "give hours above 0"),
        ((), "wait", {"hours": float("nan")}, "give hours above 0"),
        ((), "choose", {}, "look first"),
        ((), "dig", {}, "choose one first"),
        (("look", "choose"), "verify", {}, "dig first"),
        (("look",), "choose", {"site": (60, 0)}, "outside the map of 60 x 60 cells"),
        (("look",), "choose", {"site": (1.5, 2)}, "is no cell"),
        (("look",), "choose", {"site": (1, 2, 3)}, "is no cell"),
        (("look",), "choose", {"site": "1,2"}, "is no cell"),
        (("look",), "choose", {"site": 1}, "is no cell"),
        ((), "wait", {"hours": "3"}, "are no number"),
        ((), "look", {"hours": 3.0}, "Only 'wait' takes hours"),
        ((), "look", {"site": (1, 2)}, "Only 'choose' takes a site"),
        (("look", "choose", "dig"), "look", {}, "verify, dig or stop"),
        (("look", "choose", "dig"), "choose", {}, "verify, dig or stop"),
        (("look", "choose", "dig", "dig", "dig"), "dig", {}, "All 3 bites"),
    ],
)
@pytest.mark.usefixtures("true_disparities")
def test_a_step_that_cannot_be_done_changes_nothing(day, before, action, more, why):
    for each in before:
        day.step(each)
    seen = day.observation
    with pytest.raises(IcyMoonError, match=re.escape(why)):
        day.step(action, **more)
    assert day.observation is seen


def test_a_look_by_night_states_how_long_to_wait(day):
    day.step("wait", hours=14.0)
    with pytest.raises(IcyMoonError, match=r"wait [0-9.]+ h\.$") as refused:
        day.step("look")
    day.step("wait", hours=float(re.search(r"wait ([0-9.]+) h", str(refused.value)).group(1)))
    assert day.step("look").sun_elevation_deg >= days.MIN_SUN_DEG


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"light": {"directions_from": "ANGLES"}}, "set light.directions_from to DATE"),
        ({"workspace": {"cell_m": 0.0}}, "workspace.cell_m is 0"),
        ({"excavation": {"path": "ARC"}}, "a lander digs lines"),
        ({"excavation": {"states": 1}}, "nothing is dug"),
        ({"excavation": {"bite_m": 0.0}}, "nothing is dug"),
        ({"excavation": {"width_m": 0.002}}, "lower excavation.cell_m"),
    ],
)
def test_a_lander_without_a_day_is_refused(changes, why):
    with pytest.raises(IcyMoonError, match=re.escape(why)):
        LandedDay(RECIPE, merged(MORNING, changes), BM)


@pytest.mark.parametrize("energy", [0.0, -1.0, float("nan"), float("inf")])
def test_energy_that_is_none_is_refused(energy):
    with pytest.raises(IcyMoonError, match="give watt-hours above 0"):
        LandedDay(RECIPE, MORNING, BM, most_energy_wh=energy)


def test_a_method_that_needs_the_truth_is_refused():
    with pytest.raises(IcyMoonError, match="which a lander does not know"):
        LandedDay(RECIPE, MORNING, parse_methods("bm:disparities=truth")[0])


def test_no_observation_depends_on_the_truth(monkeypatch):
    """With a true depth twice as far and true heights of garbage, all that the lander knows stays."""

    def live():
        made = LandedDay(RECIPE, MORNING, BM)
        try:
            return [list_bits(made.step(action)) for action in ("look", "choose", "dig", "verify")]
        finally:
            made.close()

    honest = live()
    trace, heights = made_workspaces.trace_truth, made_workspaces.find_top_heights
    monkeypatch.setattr(made_workspaces, "trace_truth", lambda *rest: (2 * trace(*rest)[0], trace(*rest)[1]))
    monkeypatch.setattr(made_workspaces, "find_top_heights", lambda *rest: 3 * np.sin(100 * heights(*rest)))
    assert live() == honest

"""Days by a policy: its steps, the summary by hand, and a run that is killed and goes on."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from icymoon import open_landed_day
from icymoon.settings.description import merged
from icymoon.stereo.cli import main
from icymoon.stereo.decisions.guarantee import bound_share
from icymoon.stereo.design.default_lander import GENTLE_TERRAINS
from icymoon.stereo.design.made_workspaces import draw_recipes
from icymoon.stereo.landed_day import episodes
from icymoon.stereo.landed_day.day import LandedDay, Observation
from icymoon.stereo.landed_day.episodes import DAY_LANDER, Step, draw_start, live_day, make_policy, summarise_days
from icymoon.stereo.learning.grounds import Variety
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError

SCOOP_M3 = 3 * 0.02 * 0.2 * 0.08
POLICY = make_policy(DAY_LANDER, least_margin=0.3)


def see(**known):
    return Observation(**{"step": 1, "hours": 10.0, "energy_wh": 0.0, "sun_elevation_deg": 30.0, **known})


@pytest.mark.parametrize(
    ("known", "step"),
    [
        ({}, Step("look")),
        ({"sun_elevation_deg": 5.0}, Step("wait", 1.0)),
        ({"looks": 1, "last_look_h": 9.0, "best_margin": 0.9}, Step("wait", 2.0)),
        ({"looks": 1, "last_look_h": 7.0, "best_margin": 0.9}, Step("look")),
        ({"looks": 2, "last_look_h": 10.0, "best_margin": 0.3}, Step("choose")),
        ({"looks": 2, "last_look_h": 7.0, "best_margin": 0.29}, Step("look")),
        ({"looks": 4, "last_look_h": 7.0, "best_margin": 0.29}, Step("stop")),
        ({"looks": 4, "last_look_h": 7.0, "best_margin": None}, Step("stop")),
        ({"chosen": (1, 1)}, Step("dig")),
        ({"chosen": (1, 1), "bites": 1}, Step("verify")),
        ({"chosen": (1, 1), "bites": 1, "sun_elevation_deg": 5.0}, Step("wait", 1.0)),
        ({"chosen": (1, 1), "bites": 1, "verified": True, "removed_m3": 0.49 * SCOOP_M3}, Step("dig")),
        ({"chosen": (1, 1), "bites": 1, "verified": True, "removed_m3": None}, Step("dig")),
        ({"chosen": (1, 1), "bites": 1, "verified": True, "removed_m3": 0.51 * SCOOP_M3}, Step("stop")),
        ({"chosen": (1, 1), "bites": 3, "verified": True, "removed_m3": 0.0}, Step("stop")),
    ],
)
def test_the_policy_looks_chooses_digs_and_verifies(known, step):
    assert POLICY(see(**known)) == step


def test_more_looks_than_usual_are_made():
    policy = make_policy(DAY_LANDER, looks=9)
    assert policy(see(looks=8, last_look_h=7.0, best_margin=0.9)) == Step("look")
    assert policy(see(looks=9, last_look_h=7.0, best_margin=0.9)) == Step("choose")


def stop_at_once(seen):
    return Step("stop")


def test_a_policy_is_known_in_every_process():
    """The representation of a function has an address."""
    known = episodes._describe_policy(stop_at_once)
    assert known[0].endswith("test_episodes.stop_at_once")
    assert "0x" not in "".join(known)
    assert 'Step("stop")' in known[2]
    assert episodes._describe_policy(POLICY) != episodes._describe_policy(make_policy(DAY_LANDER))


def test_a_lander_has_no_terrain():
    with pytest.raises(IcyMoonError, match="settings of terrain, which do not act on it"):
        episodes.change_lander(merged({"terrain": {"rms_slope_deg": 3.0}}))


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"number": -1}, "give a whole number from 0 to 99999"),
        ({"number": 10**7}, "give a whole number from 0 to 99999"),
        ({"number": "a"}, "give a whole number"),
        ({"seed": 1.5}, "give a whole number"),
        ({"method": "bm,sgbm"}, "a lander has one matcher"),
        ({"lander": {"hills": {"rms_slope_deg": 3.0}}}, "settings of hills"),
        ({"lander": {"rig": {"baseline_m": -1.0}}}, "baseline_m"),
        ({"most_energy_wh": 0.0}, "give watt-hours above 0"),
        ({"ground": "terrains/nowhere"}, "nowhere"),
    ],
)
def test_bad_arguments_of_a_day_are_refused(arguments, why):
    with pytest.raises(IcyMoonError, match=re.escape(why)):
        open_landed_day(**arguments)


def make_day(end, removed=None):
    numbers = {"hours": 10.0, "energy_wh": 400.0, "looks": 2, "removed_m3": removed, "true_removed_m3": 5e-4}
    return {"day": {"end": end, "dangerous": end == "unsafe", **numbers}}


def test_the_summary_counts_days_by_hand():
    rows = [make_day("sampled", 4e-4), make_day("sampled", 7e-4), make_day("unsafe"), make_day("abstained")]
    found = summarise_days([*rows, {"day": None}])
    assert (found["days"], found["failed"], found["dangerous"], found["verified"]) == (4, 1, 1, 2)
    assert {end: each["days"] for end, each in found["ends"].items()} == {
        "sampled": 2,
        "unsafe": 1,
        "abstained": 1,
        "missed": 0,
    }
    assert found["ends"]["sampled"]["share"] == bound_share(2, 4, 0.05)
    assert found["unsafe_bound"] == pytest.approx(0.7514, abs=1e-4)  # Clopper and Pearson: 1 of 4, one-sided 95 %
    assert found["volume_bias_m3"] == pytest.approx(0.5e-4)
    assert found["volume_rms_m3"] == pytest.approx((2.5e-8) ** 0.5)


def test_without_a_day_there_is_no_share():
    found = summarise_days([{"day": None}])
    assert (found["days"], found["failed"], found["ends"]) == (0, 1, {})
    assert (found["unsafe_bound"], found["hours"]) == (None, None)


def test_days_begin_in_the_morning_and_differ():
    starts = [draw_start(DAY_LANDER, each) for each in draw_recipes(0, "ground", 3, Variety(GENTLE_TERRAINS))]
    assert len({each.light.date_utc for each in starts}) == 3
    for each in starts:
        elevation = episodes.compute_sky(each.light).sun_elevation_deg
        assert 16 <= elevation < 16 + 0.5 * 360 / 32.9  # half an hour of Enceladus' day after 16 degrees
    polar = merged(DAY_LANDER, {"light": {"latitude_deg": 89.0}})
    with pytest.raises(IcyMoonError, match="nearer to the equator"):
        draw_start(polar, draw_recipes(0, "ground", 1)[0])


def test_a_policy_without_end_is_stopped():
    (recipe,) = draw_recipes(0, "ground", 1, Variety(GENTLE_TERRAINS))
    day = LandedDay(recipe, DAY_LANDER, parse_methods("bm")[0], most_energy_wh=1e6)
    try:
        with pytest.raises(IcyMoonError, match="did not stop within 200 steps"):
            live_day(day, lambda seen: Step("wait", 0.1))
    finally:
        day.close()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--days", "0"], "--days"),
        (["--looks", "0"], "--looks"),
        (["--seed", "-1"], "--seed"),
        (["--energy-wh", "nan"], "--energy-wh is nan; give watt-hours above 0."),
        (["--least-margin", "1.5"], "--least-margin is 1.5; give a margin from 0 to 1."),
        (["--method", "bm,sgbm"], "a lander has one matcher"),
        (["--method", "nobody"], "nobody"),
        (["--ground", "terrains/nowhere"], "nowhere"),
    ],
)
def test_bad_words_get_one_sentence_and_write_nothing(tmp_path, capsys, words, why):
    assert main(["days", "--out", str(tmp_path / "out"), *words]) != 0
    error = capsys.readouterr().err
    assert why in error
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["days.jsonl", "days.json"])
def test_files_of_another_program_stay(tmp_path, capsys, name):
    (tmp_path / name).write_text("my diary", encoding="utf-8")
    assert main(["days", "--out", str(tmp_path), "--days", "1", "--method", "bm"]) != 0
    assert "is not overwritten" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text(encoding="utf-8") == "my diary"


@pytest.mark.timeout(400)
def test_a_killed_run_goes_on_to_the_same_bytes(tmp_path):
    def start(out):
        words = [sys.executable, "-m", "icymoon.stereo", "days", "--out", str(out), "--days", "3", "--method", "bm"]
        return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    whole, killed = tmp_path / "whole", tmp_path / "killed"
    first = start(killed)
    log = killed / "days.jsonl"
    deadline = time.monotonic() + 300
    while not (log.is_file() and log.read_bytes().count(b"\n") >= 1) and time.monotonic() < deadline:
        assert first.poll() is None, first.stderr.read()
        time.sleep(0.02)
    os.kill(first.pid, signal.SIGKILL)
    first.communicate()
    lived = log.read_bytes().count(b"\n")
    for out in (killed, whole):
        run = start(out)
        assert run.wait() == 0, run.stderr.read()
        run.stderr.close()
    assert 1 <= lived < 3
    for name in ("days.jsonl", "days.json"):
        assert (killed / name).read_bytes() == (whole / name).read_bytes()
    assert json.loads((whole / "days.json").read_text())["days"] == 3

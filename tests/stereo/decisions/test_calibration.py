"""Calibrations of decisions: one loss per ground, thresholds by independent counts, files, refusals, and their use."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.stereo.decisions import calibration_file
from icymoon.stereo.decisions.calibrated_run import CalibratedRun, CalibrationOrder, prepare_calibrated_run
from icymoon.stereo.decisions.calibration import (
    CHOICE,
    CONFORMAL,
    MAP,
    Goal,
    calibrate_matchers,
    check_ground_counts,
    collect_losses,
    make_sentences,
)
from icymoon.stereo.decisions.calibration_file import (
    Conditions,
    check_target,
    check_use,
    read_calibration,
    write_calibration,
)
from icymoon.stereo.decisions.calibration_pairs import (
    StatedPair,
    check_group_settings,
    join_statements,
    name_group,
)
from icymoon.stereo.decisions.guarantee import (
    apply_calibration,
    bound_share,
    make_guarantee_sentences,
)
from icymoon.stereo.decisions.height_errors import QUANTITIES, count_errors
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.scores import THRESHOLDS
from icymoon.stereo.decisions.stored_maps import ABSTAINS, GUARANTEED, UNLIKE
from icymoon.stereo.decisions.workspace import FEATURES
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import make_json_digest

DEVICES = {"rig": "r", "camera response": "c", "render quality": "q", "size of cells": "0.02 m"}
CONDITIONS = Conditions(6, read_rules(), 0.0, 0.0)
INPUTS = {"bm": "digest"}
#: Normal errors of half of the stated size.
ERRORS = dict.fromkeys(
    QUANTITIES, count_errors(np.random.default_rng(0).normal(0, 0.5, 10_000), np.ones(10_000), np.ones(10_000, bool))
)


def make_row(pair, margin, unsafe=0.0, cells=(100, 100), unsafe_cells=0, features=0.5):
    """A row of ``bm`` that chooses a site of this margin. All taken cells have it too, and some of them are unsafe."""
    chosen = margin is not None
    reached = [chosen and margin >= threshold for threshold in THRESHOLDS]
    sites = {
        "chosen_margin": margin,
        "unsafe_choice": unsafe if chosen else None,
        "taken_from": [cells[1] if each else 0 for each in reached],
        "unsafe_from": [unsafe_cells if each else 0 for each in reached],
        "offered": cells[0],
    }
    numbers = {"sites": sites, "features": dict.fromkeys(FEATURES, features), "errors": ERRORS}
    return {"pair": pair, "method": "bm", "status": "ok", "numbers": numbers}


def draw_grounds(count, seed=0, first=0):
    """Rows of grounds with a pair each, whose unsafe choices have margins below 0.4, and their statements."""
    random = np.random.default_rng(seed)
    margins = random.uniform(0.1, 0.9, count)
    rows = [
        make_row(f"p{first + k}", round(float(margin), 3), float(margin < 0.4), features=float(feature))
        for k, (margin, feature) in enumerate(zip(margins, random.normal(0, 1, count), strict=True))
    ]
    return rows, {row["pair"]: StatedPair(f"g{first + k}", "", DEVICES) for k, row in enumerate(rows)}


def calibrated(path, count=60, goal=None):
    """A calibration from ``draw_grounds``, written and read."""
    goal = goal or Goal()
    rows, stated = draw_grounds(count)
    entries = calibrate_matchers(rows, stated, INPUTS, goal)
    write_calibration(path, goal, CONDITIONS, list(stated.values()), entries)
    return read_calibration(path)


def test_a_ground_counts_once_with_its_worst_pair():
    rows = [make_row("a", 0.9), make_row("b", 0.5, 1.0), make_row("c", None), make_row("d", 0.7, 1.0)]
    stated = {name: StatedPair(ground, "", DEVICES) for name, ground in zip("abcd", "xxyz", strict=True)}
    losses = collect_losses(rows, stated)
    assert losses.grounds == ["x", "y", "z"]
    places = [THRESHOLDS.index(each) for each in (0.9, 0.6, 0.5, 0.0)]
    np.testing.assert_array_equal(losses.choice[:, places], [[0, 0, 1, 1], [0, 0, 0, 0], [0, 1, 1, 1]])
    np.testing.assert_array_equal(losses.acted[:, places], [[1, 1, 1, 1], [0, 0, 0, 0], [0, 1, 1, 1]])


def test_a_ground_with_a_pair_that_cannot_be_judged_is_left_out():
    rows = [make_row("a", 0.9), make_row("b", 0.5) | {"status": "suspect"}, make_row("c", 0.5)]
    stated = {name: StatedPair(ground, "", DEVICES) for name, ground in zip("abc", "xxy", strict=True)}
    assert collect_losses(rows, stated).grounds == ["y"]
    rows, stated = draw_grounds(59)
    rows[0] |= {"status": "failed"}
    with pytest.raises(IcyMoonError, match="58 grounds that StereoBM could be judged on cannot guarantee"):
        calibrate_matchers(rows, stated, INPUTS, Goal())


def test_the_threshold_is_the_lowest_that_the_counts_accept():
    rows, stated = draw_grounds(100)
    choice = calibrate_matchers(rows, stated, INPUTS, Goal())["bm"][CHOICE]
    unsafe = sorted(
        row["numbers"]["sites"]["chosen_margin"] for row in rows if row["numbers"]["sites"]["unsafe_choice"]
    )

    def is_accepted(threshold):
        failing = sum(margin >= threshold for margin in unsafe)
        return sum(math.comb(100, k) * 0.05**k * 0.95 ** (100 - k) for k in range(failing + 1)) <= 0.05

    assert is_accepted(choice["threshold"])
    assert not is_accepted(choice["threshold"] - 0.01)
    assert choice["loss"] == 1  # of 100; it takes 93 for one, 124 for two
    average = calibrate_matchers(rows, stated, INPUTS, Goal(procedure=CONFORMAL))["bm"][CHOICE]
    assert average["threshold"] < choice["threshold"]
    assert average["loss"] == 4  # (4 + 1) / 101


def test_the_loss_of_the_map_never_falls_with_the_threshold():
    row = make_row("a", 0.5, cells=(200, 100), unsafe_cells=40)
    sites = row["numbers"]["sites"]
    sites["taken_from"] = [1000 if t <= 0.2 else n for t, n in zip(THRESHOLDS, sites["taken_from"], strict=True)]
    cells = collect_losses([row], {"a": StatedPair("x", "", DEVICES)}).cells[0]
    assert [cells[THRESHOLDS.index(t)] for t in (0.6, 0.5, 0.2, 0.0)] == [0.0, 0.4, 0.4, 0.4]


def test_the_strictest_threshold_of_groups_is_taken():
    rows, stated = draw_grounds(180)
    stated = {name: replace(pair, group="ab"[k % 2]) for k, (name, pair) in enumerate(stated.items())}
    goal = Goal(group_by=("terrain.rms_slope_deg",))
    both = calibrate_matchers(rows, stated, INPUTS, goal)["bm"]
    single = [
        calibrate_matchers([r for r in rows if stated[r["pair"]].group == g], stated, INPUTS, goal)["bm"] for g in "ab"
    ]
    for risk in (CHOICE, MAP):
        assert both[risk]["by_group"] == [each[risk]["threshold"] for each in single]
        assert both[risk]["threshold"] == max(both[risk]["by_group"])
    assert "for each group by itself" in make_sentences({"bm": both}, goal)[-1]
    with pytest.raises(IcyMoonError, match="90 grounds with a cannot"):
        check_ground_counts(list(stated.values()), replace(goal, alpha=0.03))


@pytest.mark.parametrize(
    ("goal", "fewest"), [(Goal(), 59), (Goal(0.1), 29), (Goal(procedure=CONFORMAL), 19), (Goal(0.3, 0.3), 19)]
)
def test_below_the_fewest_grounds_nothing_is_guaranteed(goal, fewest):
    _, stated = draw_grounds(fewest)
    grounds = list(stated.values())
    check_ground_counts(grounds, goal)
    for too_few in (grounds[1:], [*grounds[1:], grounds[1]], []):  # a second pair of a ground is no further ground
        with pytest.raises(IcyMoonError, match=f"it takes {fewest} grounds"):
            check_ground_counts(too_few, goal)


@pytest.mark.parametrize("goal", [Goal(alpha=0.0), Goal(delta=0.9), Goal(alpha=math.nan), Goal(alpha=1e-9)])
def test_risks_out_of_range_are_refused(goal):
    with pytest.raises(IcyMoonError, match="give a number from"):
        goal.check()


def test_an_unknown_procedure_is_refused():
    with pytest.raises(IcyMoonError, match="--procedure is 'ltt'; give learn-then-test or conformal"):
        Goal(procedure="ltt").check()


def test_the_map_has_the_test_of_shares_even_where_all_shares_are_0_or_1():
    rows, stated = draw_grounds(93)
    rows = [make_row(row["pair"], 1.0, unsafe_cells=100 * (k == 0)) for k, row in enumerate(rows)]
    assert calibrate_matchers(rows, stated, INPUTS, Goal())["bm"][MAP]["threshold"] is None


def test_rules_that_no_site_meets_give_no_calibration():
    rows, stated = draw_grounds(60)
    rows = [make_row(row["pair"], None) for row in rows]
    with pytest.raises(IcyMoonError, match="On no ground a site meets the rules"):
        calibrate_matchers(rows, stated, INPUTS, Goal())


def test_groups_are_named_by_settings():
    settings: dict[str, dict[str, object]] = {"light": {"sun_elevation_deg": 30.0}, "source": {"kind": "MESH"}}
    names = ("light.sun_elevation_deg", "source.kind")
    check_group_settings(names)
    assert name_group(settings, names) == "light.sun_elevation_deg=30, source.kind=MESH"
    with pytest.raises(IcyMoonError, match=r"did you mean 'light\.sun_elevation_deg'"):
        check_group_settings(["light.sun_elevation"])
    with pytest.raises(IcyMoonError, match="twice"):
        check_group_settings(names[:1] * 2)


def test_a_file_is_read_as_it_was_written(tmp_path):
    found = calibrated(tmp_path / "new" / "c.json", goal=Goal(0.07, 0.04))
    rows, stated = draw_grounds(60)
    assert found.goal == Goal(0.07, 0.04)
    assert found.entries == calibrate_matchers(rows, stated, INPUTS, found.goal)
    assert found.grounds == {f"g{k}" for k in range(60)}
    check_target(found.path)  # a calibration may be written again


def sign(content):
    return content | {"digest": make_json_digest({k: v for k, v in content.items() if k != "digest"})}


def change_group(content, key, value):
    content["matchers"]["bm"]["groups"][0][key] = value
    return sign(content)


def change_scale(content, value):
    content["matchers"]["bm"]["scales"]["height"] = value
    return sign(content)


def change_choice(content, **changes):
    content["matchers"]["bm"][CHOICE] |= changes
    return sign(content)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda c: [], "is not a calibration"),
        (lambda c: sign(c | {"format": "icymoon-decisions"}), "is not a calibration"),
        (lambda c: sign(c | {"version": 1}), "has format version 1"),
        (lambda c: c | {"decisions": 5}, "was changed after it was written"),
        (lambda c: sign(c | {"grounds": 3}), "grounds is 3, not a list"),
        (lambda c: sign(c | {"features": ["other"]}), "by other numbers"),
        (lambda c: sign(c | {"goal": c["goal"] | {"alpha": 0}}), "goal.alpha is 0"),
        (lambda c: sign(c | {"goal": c["goal"] | {"alpha": 0.001}}), "other numbers of grounds"),
        (lambda c: change_group(c, "grounds", 10**9), "other numbers of grounds"),
        (lambda c: change_group(c, "features", [[1.0]]), r"features\[0\] is"),
        (lambda c: change_choice(c, threshold=0.0), "does not follow from its losses"),
        (lambda c: change_choice(c, threshold=0.0, by_group=[0.0], loss=9), "does not follow from its losses"),
        (lambda c: change_choice(c, by_group=[]), "does not follow from its losses"),
        (lambda c: change_scale(c, 0.0), "height is 0.0, not a number above 0"),
        (lambda c: change_scale(c, -1), "height is -1, not a number above 0"),
        (lambda c: change_scale(c, "1"), "not a number above 0"),
        (lambda c: sign(c | {"matchers": {"bm": c["matchers"]["bm"] | {"groups": []}}}), "without grounds"),
    ],
)
def test_files_that_were_changed_are_refused(tmp_path, change, reason):
    path = calibrated(tmp_path / "c.json").path
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(IcyMoonError, match=reason) as refused:
        read_calibration(path)
    assert str(refused.value).count(". ") == 0
    with pytest.raises(IcyMoonError, match="give another path"):
        check_target(path)


def test_damaged_and_huge_files_are_refused(tmp_path, monkeypatch):
    path = calibrated(tmp_path / "c.json").path
    content = path.read_bytes()
    for bad in (content[:-100], b"", b"\0" * 100, b"[" * 10**5, b'{"format": NaN}', content.replace(b"0.05", b"1e999")):
        path.write_bytes(bad)
        with pytest.raises(IcyMoonError, match=r"c\.json"):
            read_calibration(path)
    path.write_bytes(content)
    monkeypatch.setattr(calibration_file, "_MAX_BYTES", 1000)
    with pytest.raises(IcyMoonError, match="are the most that can be read"):
        read_calibration(path)
    for other in (tmp_path, tmp_path / "none.json"):
        with pytest.raises(IcyMoonError):
            read_calibration(other)
    with pytest.raises(IcyMoonError, match="is a folder"):
        check_target(tmp_path)


OTHER_RULES = replace(CONDITIONS.rules, site=replace(CONDITIONS.rules.site, slope_deg=10.0))


@pytest.mark.parametrize(
    ("conditions", "pair", "inputs", "reason"),
    [
        (CONDITIONS, {"ground": "g3"}, INPUTS, "with the ground of new; give pairs of other seeds"),
        (CONDITIONS, {}, {"bm": "other"}, "other options, files or packages of StereoBM"),
        (CONDITIONS, {}, {"sgbm": "digest"}, "without SGBM"),
        (replace(CONDITIONS, rules=OTHER_RULES), {}, INPUTS, "other rules"),
        (replace(CONDITIONS, decisions=7), {}, INPUTS, "other version of the decisions"),
        (replace(CONDITIONS, pose_error_mm=1.0), {}, INPUTS, "other errors of poses"),
        (replace(CONDITIONS, min_confidence=0.5), {}, INPUTS, "other least confidence"),
        *(
            (CONDITIONS, {"devices": DEVICES | {name: "other"}}, INPUTS, f"another {name} than new has")
            for name in DEVICES
        ),
    ],
)
def test_a_calibration_of_something_else_is_refused(tmp_path, conditions, pair, inputs, reason):
    found = calibrated(tmp_path / "c.json")
    new = StatedPair("g1000", "", DEVICES)
    check_use(found, CONDITIONS, {"new": new}, INPUTS)
    with pytest.raises(IcyMoonError, match=f"gives no guarantee here: it was made .*{reason}"):
        check_use(found, conditions, {"new": replace(new, **pair)}, inputs)


def test_sites_are_guaranteed_or_the_lander_abstains(tmp_path):
    found = calibrated(tmp_path / "c.json")
    threshold = found.entries["bm"][CHOICE]["threshold"]
    rows = [
        make_row("good", threshold, features=0.0),
        make_row("bad", threshold, 1.0, features=0.0),
        make_row("below", round(threshold - 0.001, 3), 1.0, features=0.0),
        make_row("nothing", None, features=0.0),
        make_row("strange", 0.9, features=9.0),
        make_row("good_again", 0.2, 1.0, features=0.0),
        make_row("failed", 0.9) | {"status": "failed", "numbers": None},
    ]
    stated = {row["pair"]: StatedPair(row["pair"].partition("_")[0], "", DEVICES) for row in rows}
    marked, guarantee = apply_calibration(found, rows, stated)
    verdicts = [row["guarantee"] and row["guarantee"]["verdict"] for row in marked]
    assert verdicts == [GUARANTEED, GUARANTEED, ABSTAINS, ABSTAINS, UNLIKE, ABSTAINS, None]
    (entry,) = guarantee["methods"]
    assert [entry[key] for key in ("grounds", "acted", "abstained", "unlike", "unsafe")] == [5, 2, 2, 1, 1]
    assert entry["acted_bounds"] == pytest.approx([0.0527, 0.8534], abs=1e-4)  # tables of Clopper and Pearson
    assert entry["unsafe_bound"] == pytest.approx(0.6574, abs=1e-4)
    head, sentence, _ = make_guarantee_sentences(guarantee)
    assert "with 95 % confidence, a chosen site is unsafe on at most 5 % of grounds" in head
    assert "60 calibration grounds by Learn-then-Test" in head
    assert "a guaranteed site on 2 of 5 grounds (5 to 85 %)" in sentence
    assert "on 1, which is unlike the calibration grounds, it has no guarantee" in sentence


def test_errors_of_maps_get_a_scale_that_is_checked_on_other_grounds(tmp_path):
    found = calibrated(tmp_path / "c.json")
    assert found.entries["bm"]["scales"] == pytest.approx(dict.fromkeys(QUANTITIES, 0.5), rel=0.03)
    rows, stated = draw_grounds(3, seed=9, first=100)
    guarantee = apply_calibration(found, rows, stated)[1]
    for name in QUANTITIES:
        check = guarantee["methods"][0]["errors"][name]["check"]
        assert check["within"] == pytest.approx([0.683, 0.954], abs=0.01)
        assert check["grounds"] == 3
    assert "errs by less than one stated standard deviation in 68 %" in make_guarantee_sentences(guarantee)[-1]


def test_grounds_with_more_pairs_than_calibrated_are_refused(tmp_path):
    """The loss of a ground is the worst of its pairs, so more pairs have more risk."""
    found = calibrated(tmp_path / "c.json")
    pairs = {f"sun{k}": StatedPair("new", "", DEVICES) for k in range(3)}
    with pytest.raises(IcyMoonError, match="with 1 pair of a ground, and sun0 is one of 3; give at most 1 of a ground"):
        check_use(found, CONDITIONS, pairs, INPUTS)
    two = [StatedPair(f"g{k}", "", DEVICES) for k in range(60) for _ in range(3 if k else 2)]
    write_calibration(found.path, found.goal, CONDITIONS, two, found.entries)
    again = read_calibration(found.path)
    assert again.pairs_of_a_ground == 2
    check_use(again, CONDITIONS, dict(list(pairs.items())[:2]), INPUTS)
    with pytest.raises(IcyMoonError, match="with 2 pairs of a ground"):
        check_use(again, CONDITIONS, pairs, INPUTS)


def test_a_ground_with_a_failed_pair_has_no_guarantee(tmp_path):
    """A calibration leaves such grounds out, and states how many, so it tells nothing about them."""
    rows, stated = draw_grounds(60, first=100)
    rows[0] |= {"status": "failed", "numbers": None}
    found = calibrated(tmp_path / "c.json")
    entries = calibrate_matchers(rows, stated, INPUTS, Goal(alpha=0.1))
    assert entries["bm"]["left_out"] == 1
    assert "59 grounds, 1 left out because a pair could not be judged," in make_sentences(entries, Goal(alpha=0.1))[0]
    rows = [make_row("good", 0.9, features=0.0), make_row("bad", 0.9) | {"status": "failed", "numbers": None}]
    marked, guarantee = apply_calibration(found, rows, dict.fromkeys(("good", "bad"), StatedPair("new", "", DEVICES)))
    assert [row["guarantee"] and row["guarantee"]["verdict"] for row in marked] == [UNLIKE, None]
    assert [guarantee["methods"][0][key] for key in ("grounds", "acted", "unlike")] == [1, 0, 1]


def test_a_guarantee_of_groups_says_so(tmp_path):
    found = calibrated(tmp_path / "c.json")
    rows, stated = draw_grounds(3, seed=9, first=100)
    for group_by, says in (((), False), (("light.sun_elevation_deg",), True)):
        grouped = replace(found, goal=replace(found.goal, group_by=group_by))
        head = make_guarantee_sentences(apply_calibration(grouped, rows, stated)[1])[0]
        assert head.endswith("like the calibration grounds of each group.") is says


def test_a_group_with_one_ground_is_refused():
    rows, stated = draw_grounds(60)
    stated["p7"] = replace(stated["p7"], group="light.sun_elevation_deg=5")
    for check in (
        lambda: check_ground_counts(list(stated.values()), Goal()),
        lambda: calibrate_matchers(rows, stated, INPUTS, Goal()),
    ):
        with pytest.raises(IcyMoonError, match=r"^1 ground with light\.sun_elevation_deg=5"):
            check()


def test_a_group_that_was_not_calibrated_is_unlike(tmp_path):
    found = calibrated(tmp_path / "c.json")
    rows = [make_row("new", 0.9, features=0.0)]
    marked, _ = apply_calibration(found, rows, {"new": StatedPair("new", "light.sun_elevation_deg=5", DEVICES)})
    assert marked[0]["guarantee"] == {"p": 0.0, "feature": "group", "verdict": UNLIKE}


def test_the_weaker_procedure_is_stated(tmp_path):
    found = calibrated(tmp_path / "c.json", goal=Goal(procedure=CONFORMAL))
    rows, stated = draw_grounds(3, seed=9, first=100)
    guarantee = apply_calibration(found, rows, stated)[1]
    assert guarantee["delta"] is None
    for sentence in (make_guarantee_sentences(guarantee)[0], make_sentences(found.entries, found.goal)[0]):
        assert "on average over calibrations, and not for this one alone" in sentence
        assert "confidence" not in sentence


def test_bounds_of_shares_are_clopper_and_pearsons():
    assert bound_share(0, 59, 0.05) == pytest.approx([0.0, 1 - 0.025 ** (1 / 59)])
    assert bound_share(7, 7, 0.05) == pytest.approx([0.025 ** (1 / 7), 1.0])


def test_a_matcher_that_no_margin_makes_safe_abstains():
    rows, stated = draw_grounds(60)
    rows = [make_row(row["pair"], 0.8, 1.0) for row in rows]
    entries = calibrate_matchers(rows, stated, INPUTS, Goal())
    assert entries["bm"][CHOICE]["acted"] == 0
    assert "so it always abstains" in make_sentences(entries, Goal())[0]


def test_a_calibration_of_another_number_of_suns_is_refused(tmp_path):
    rows, stated = draw_grounds(60)
    entries = calibrate_matchers(rows, stated, INPUTS, Goal())
    new = {"n": StatedPair("new", "", DEVICES)}
    for suns, other in ((1, 4), (4, 1), (4, 3)):
        path = tmp_path / f"{suns}_{other}.json"
        write_calibration(path, Goal(), replace(CONDITIONS, suns=suns), list(stated.values()), entries)
        calibration = read_calibration(path)
        check_use(calibration, replace(CONDITIONS, suns=suns), new, INPUTS)
        with pytest.raises(
            IcyMoonError, match=r"fused Suns for each decision.*; decide on as many, or calibrate again"
        ):
            check_use(calibration, replace(CONDITIONS, suns=other), new, INPUTS)


def test_a_calibration_of_one_sun_is_written_as_before():
    assert "suns" not in CONDITIONS.to_json()
    assert replace(CONDITIONS, suns=2).to_json() == CONDITIONS.to_json() | {"suns": 2}


def test_a_site_has_the_devices_of_all_its_pairs():
    one, other = StatedPair("g", "x", {"rig": "r", "sensor": "a"}), StatedPair("g", "y", {"rig": "r", "sensor": "b"})
    assert join_statements([one]) == one
    joined = join_statements([one, other])
    assert (joined.ground, joined.group, joined.devices["rig"]) == ("g", "y", "r")
    assert joined.devices["sensor"] not in ("a", "b")
    assert joined.devices == join_statements([other, one]).devices


def test_a_run_makes_or_uses_a_calibration_and_not_both(tmp_path):
    run = CalibratedRun({}, CONDITIONS, INPUTS, CalibrationOrder(tmp_path / "c.json"))
    with pytest.raises(IcyMoonError, match="exclude each other"):
        prepare_calibrated_run({}, {}, 0.02, run, tmp_path / "other.json")
    with pytest.raises(IcyMoonError, match="0 grounds cannot"):
        prepare_calibrated_run({}, {}, 0.02, run, None)
    rows, stated = draw_grounds(60)
    run = replace(run, stated=stated)
    plain, verdicts = run.judge([make_row(row["pair"], None) for row in rows])
    with pytest.raises(IcyMoonError, match="On no ground"):
        run.write(verdicts)
    assert not (tmp_path / "c.json").exists()
    run.write(run.judge(rows)[1])
    assert read_calibration(tmp_path / "c.json").grounds
    assert "guarantee" not in plain[0]

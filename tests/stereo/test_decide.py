"""Decisions of pairs on the disk: what is written, what is kept, what is refused."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pairs
import pytest
import workspaces
from icymoon.formats import geotiff
from icymoon.stereo import decide
from icymoon.stereo.cli import main
from icymoon.stereo.decide import TRUE_DEPTH, PoseError, decide_pairs
from icymoon.stereo.decisions import calibration, workspace
from icymoon.stereo.decisions.calibrated_run import CalibrationOrder
from icymoon.stereo.decisions.height_errors import QUANTITIES
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.workspace import disturb_pose
from icymoon.stereo.fusion import fuse
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import hash_file
from workspaces import CELL_M, DOWN

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture
def dataset(tmp_path):
    for name in ("a", "b"):
        workspaces.write(tmp_path / "set" / "pairs" / name)
    return tmp_path / "set"


def write_state(folder, state, lowered_m, seed=None):
    """A state of an excavation that has lowered level ground by so much, in a region of 0.64 m²; rendered with this
    seed."""
    workspaces.write(folder, pairs.Scene(distance_m=2.0 + lowered_m, slope_x=0.0, slope_y=0.0, rock=False))
    data = json.loads((folder / "pair.json").read_text())
    heights = np.full((2, 30, 30), -lowered_m, np.float32)
    np.save(folder / "workspace.npy", heights)
    data["files"]["workspace.npy"]["sha256"] = hash_file(folder / "workspace.npy")
    # What was dug is more than what the region lost, as spoil slid in.
    data["excavation"] = {
        "state": state,
        "states": 3,
        "taken_m3": 0.9 * lowered_m,
        "change_in_region_by_state_m3": [0.0] * state + [-0.64 * lowered_m],
        "region_m": [-0.4, -0.4, 0.4, 0.4],
    }
    data["seeds"] = {"render": state if seed is None else seed}
    (folder / "pair.json").write_text(json.dumps(data))


def run(paths, out, methods="bm", **options):
    return decide_pairs(paths, parse_methods(methods), out, read_rules(), **options)


def test_measurements_below_the_limit_of_confidence_are_not_used(monkeypatch):
    camera, confidence = pairs.camera(4, 2), np.array([[0.0, 0.4, 0.5, 1.0]] * 2)
    one = np.ones((2, 4))
    prepared = SimpleNamespace(visible=one > 0, truth=one, pair=SimpleNamespace(camera=camera), depth_camera=camera)
    stub: Any = prepared
    (method,) = parse_methods("jplv")

    def find_depth(limit, stated):
        info = {"confidence": stated, "seconds": 1.0}
        monkeypatch.setattr(decide, "match_prepared", lambda *_: (8 * one, info))
        return decide._match_pair(stub, method, limit)[0]

    np.testing.assert_array_equal(np.isfinite(find_depth(0.5, confidence)), confidence >= 0.5)
    assert np.isfinite(find_depth(0.0, None)).all()
    with pytest.raises(IcyMoonError, match=r"JPLV states no confidence, but at least 0\.5 is required; leave out"):
        find_depth(0.5, None)


def test_the_true_depth_finds_the_true_heights_and_takes_nothing_unsafe(dataset, tmp_path):
    report = run([dataset], tmp_path / "out")
    entry, matcher = report["summary"]
    assert entry["method"] == TRUE_DEPTH
    assert entry["pairs"] == 2
    assert matcher["pairs"] == 2
    # Cells at the rock's sides contain points of both heights; all others are exact to single precision.
    row = next(row for row in report["rows"] if row["method"] == TRUE_DEPTH)
    found = np.load(tmp_path / "out" / row["images"]["dem"])
    error = np.abs(found - np.load(tmp_path / "out" / "pairs" / "a" / "truth_dem.npy"))
    assert np.nanmedian(error) < 1e-5
    assert (error > 0.01).sum() < 60
    assert row["numbers"]["sites"]["false_safe"] == 0.0
    assert row["numbers"]["sites"]["chosen"] is not None
    assert row["numbers"]["sites"]["unsafe_choice"] == 0.0
    assert 0 < entry["cpu_s.decide"] < 2
    assert matcher["dem.nmad_m"] > entry["dem.nmad_m"]


def test_files_are_as_they_are_named(dataset, tmp_path):
    report = run([dataset], tmp_path / "out")
    for row in report["rows"]:
        tif = geotiff.read(tmp_path / "out" / row["images"]["tif"])
        assert tif.pixel_m == pytest.approx((CELL_M, CELL_M))
        assert tif.corner_m == pytest.approx((-0.58, -0.58))
        np.testing.assert_array_equal(tif.heights_m, np.load(tmp_path / "out" / row["images"]["dem"]).astype(float))
    stored = json.loads((tmp_path / "out" / "decisions.json").read_text())
    assert stored["format"] == "icymoon-decisions"
    assert stored["summary"] == report["summary"]
    with (tmp_path / "out" / "decisions.csv").open(encoding="utf-8", newline="") as stream:
        lines = list(csv.DictReader(stream))
    assert [(line["pair"], line["method"]) for line in lines] == [
        (pair, method) for pair in "ab" for method in (TRUE_DEPTH, "bm")
    ]
    page = (tmp_path / "out" / "decisions.html").read_text(encoding="utf-8")
    assert report["head"][1] in page
    assert "://" not in page.replace("http://www.w3.org", "")


def test_only_what_is_missing_is_made(dataset, tmp_path, monkeypatch):
    calls = []
    real = fuse.match_checked
    monkeypatch.setattr(fuse, "match_checked", lambda name, *rest: calls.append(name) or real(name, *rest))
    first = run([dataset], tmp_path / "out")
    again = run([dataset], tmp_path / "out")
    assert calls == ["bm"] * 2
    assert again["rows"] == first["rows"]
    run([dataset], tmp_path / "out", "bm,sgbm")
    assert calls == ["bm"] * 2 + ["sgbm"] * 2
    (tmp_path / "out" / "pairs" / "a" / "bm_dem.tif").unlink()
    run([dataset], tmp_path / "out")
    assert calls[4:] == ["bm"]
    run([dataset], tmp_path / "out", pose=PoseError(5.0, 0.1))
    assert calls[5:] == ["bm"] * 2


def test_other_methods_do_not_change_where_the_scoop_is_found(dataset, tmp_path, monkeypatch):
    """A run that was stopped between two methods goes on to the numbers of a whole one."""

    def locate(scoop, depth_m, pair, pose, random):
        found = {"apart_mm": 0.0, "pixels": 1, "known": 1.0, "error_deg": 0.0, "found_mm": None}
        return found | {"error_mm": random.random()}

    monkeypatch.setattr(decide, "find_scoop", lambda pair, pose, random: random.random(5))
    monkeypatch.setattr(decide, "locate_scoop", locate)

    def read(report):
        return {(row["pair"], row["method"]): row["numbers"]["scoop"]["error_mm"] for row in report["rows"]}

    whole = read(run([dataset], tmp_path / "whole", "bm,sgbm"))
    assert len(set(whole.values())) == 6
    run([dataset], tmp_path / "parts", "sgbm")
    assert read(run([dataset], tmp_path / "parts", "bm,sgbm")) == whole
    assert read(run([dataset], tmp_path / "other", "bm,sgbm", seed=1)).items().isdisjoint(whole.items())


def test_without_true_heights_the_depth_of_both_eyes_is_the_truth(tmp_path):
    workspaces.write(tmp_path / "pair", exact=False)
    report = run([tmp_path / "pair"], tmp_path / "out", cell_m=0.05)
    assert any("workspace.cell_m is 0" in note for note in report["notes"])
    assert report["summary"][0]["dem.rmse_m"] < 0.2
    assert report["rows"][0]["status"] == "ok"


def test_a_wrong_height_of_the_camera_is_a_bias(dataset, tmp_path):
    pose = disturb_pose(DOWN, 10.0, 0.0, np.random.default_rng(1))
    shift = pose[:3, 3] - DOWN[:3, 3]
    assert (pose[:3, :3] == DOWN[:3, :3]).all()
    assert np.abs(shift).max() < 0.05
    report = run([dataset], tmp_path / "out", pose=PoseError(10.0))
    biases = [row["numbers"]["dem"]["bias_m"] for row in report["rows"] if row["method"] == TRUE_DEPTH]
    assert len(set(biases)) == 2
    assert max(map(abs, biases)) > 1e-3


def test_a_turn_about_the_eye_is_a_rotation():
    pose = disturb_pose(DOWN, 0.0, 2.0, np.random.default_rng(3))
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert (pose[:3, 3] == DOWN[:3, 3]).all()
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_a_pair_that_cannot_be_used_stops_no_other(dataset, tmp_path):
    path = dataset / "pairs" / "a" / "pair.json"
    data = json.loads(path.read_text())
    del data["light"]
    path.write_text(json.dumps(data))
    errors = []
    report = run(
        [dataset], tmp_path / "out", on_event=lambda event: errors.append(event) if event["type"] == "error" else None
    )
    assert {entry["pair"] for entry in report["failed"]} == {"a"}
    assert "direction of the Sun" in errors[0]["message"]
    assert report["summary"][1]["pairs"] == 1


@pytest.mark.parametrize("name", ["decisions.csv", "decisions.html", "decisions.jsonl"])
def test_files_of_others_are_not_overwritten(dataset, tmp_path, name):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("mine", encoding="utf-8")
    with pytest.raises(IcyMoonError, match=name):
        run([dataset], tmp_path / "out")
    assert (tmp_path / "out" / name).read_text(encoding="utf-8") == "mine"


def test_results_do_not_mix_with_pairs(dataset):
    with pytest.raises(IcyMoonError, match="is a data set"):
        run([dataset], dataset)


def test_json_lines_end_with_the_result(dataset, tmp_path, capsys):
    assert main(["decide", str(dataset), "--methods", "bm", "--out", str(tmp_path / "out"), "--json-lines"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["type"] for line in lines] == ["progress"] * 4 + ["result"]
    assert lines[-1]["rows"][1]["method"] == "bm"
    assert lines[3]["fraction"] == 1.0


@pytest.mark.parametrize(
    "wrong",
    [
        ["--cell-m", "0"],
        ["--pose-error-mm", "-1"],
        ["--rules", "nowhere.toml"],
        ["--methods", "nothing"],
        ["--seed", "-1"],
    ],
)
def test_wrong_options_are_sentences_and_write_nothing(dataset, tmp_path, capsys, wrong):
    assert main(["decide", str(dataset), "--out", str(tmp_path / "out"), *wrong]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_wrong_options_of_calibrations_are_sentences_and_write_nothing(tmp_path, capsys):
    pair = str(workspaces.write(tmp_path / "pair"))
    for wrong, reason in (
        (["--calibrate", "c.json"], "1 ground cannot guarantee a risk of at most 5 % with 95 % confidence"),
        (["--calibrate", "c.json", "--alpha", "0"], "--alpha is 0; give a number from 0.001 to 0.5"),
        (["--calibrate", "c.json", "--groups", "nothing"], "--groups: nothing is not a setting"),
        (["--calibrate", "c.json", "--calibration", "c.json"], "exclude each other"),
        (["--calibration", "nowhere.json"], "nowhere.json cannot be read"),
        (["--delta", "0.1"], "--delta is an option of a calibration; add --calibrate FILE"),
    ):
        assert main(["decide", pair, "--out", str(tmp_path / "out"), *wrong]) == 1
        said = capsys.readouterr().err
        assert reason in said
        assert said.count("\n") == 1
        assert not (tmp_path / "out").exists()


def test_a_calibration_guarantees_sites_of_other_grounds(dataset, tmp_path, monkeypatch):
    """By the true depth, whose choices are safe, on two grounds: the fewest for half of the risk on average."""
    monkeypatch.setattr(calibration, "MAX_UNLIKE_P", 0.4)
    # The true depth errs by nothing or, at the rock, beyond all ratios, so that no scale follows from these grounds.
    monkeypatch.setattr(calibration, "fit_scales", lambda grounds: dict.fromkeys(QUANTITIES, 2.0))
    for k, folder in enumerate((dataset / "pairs" / "a", dataset / "pairs" / "b", workspaces.write(tmp_path / "new"))):
        data = json.loads((folder / "pair.json").read_text())
        data["settings"]["dataset"]["seed"] = k + 1
        (folder / "pair.json").write_text(json.dumps(data))
    file, rules = tmp_path / "calibration.json", read_rules()
    goal = calibration.Goal(alpha=0.4, procedure=calibration.CONFORMAL)
    order = CalibrationOrder(file, replace(goal, alpha=0.3))
    with pytest.raises(IcyMoonError, match="2 grounds cannot guarantee"):
        decide_pairs([dataset], [], tmp_path / "out", rules, calibrate=order)
    assert not (tmp_path / "out").exists()
    assert not file.exists()
    report = decide_pairs([dataset], [], tmp_path / "out", rules, calibrate=replace(order, goal=goal))
    assert report["head"][1].startswith("With the true depth, sites from a margin of 0.00 on are guaranteed")
    assert report["guarantee"] is None
    found = decide_pairs([tmp_path / "new"], [], tmp_path / "used", rules, calibration=file)
    assert [found["guarantee"]["methods"][0][key] for key in ("grounds", "acted", "unsafe")] == [1, 1, 0]
    assert found["rows"][0]["guarantee"]["verdict"] == "guaranteed"
    scale = json.loads(file.read_text())["matchers"][TRUE_DEPTH]["scales"]["height"]
    images = found["rows"][0]["images"]
    sigma, height = (np.load(tmp_path / "used" / images[kind]) for kind in ("height_sigma", "dem"))
    np.testing.assert_array_equal(np.isfinite(sigma), np.isfinite(height))
    assert np.nanmin(sigma) >= scale * 0.99e-6
    assert {"slope_sigma", "roughness_sigma"} <= images.keys()
    assert "height_sigma" not in report["rows"][0]["images"]
    assert any("of the cells and by less than two in" in said for said in found["head"])
    assert "Guaranteed sites" in (tmp_path / "used" / "decisions.html").read_text(encoding="utf-8")
    with (tmp_path / "used" / "decisions.csv").open(encoding="utf-8", newline="") as stream:
        (line,) = csv.DictReader(stream)
    assert line["guarantee"] == "guaranteed"
    assert float(line["chosen_margin"]) == pytest.approx(found["rows"][0]["numbers"]["sites"]["chosen_margin"], 1e-5)
    with pytest.raises(IcyMoonError, match="with the ground of a; give pairs of other seeds"):
        decide_pairs([dataset], [], tmp_path / "refused", rules, calibration=file)
    assert not (tmp_path / "refused").exists()


def test_a_series_has_its_volumes_and_none_is_noticed_without_pairs_in_which_nothing_was_dug(tmp_path):
    for state, lowered_m in enumerate((0.0, 0.05, 0.1)):
        write_state(tmp_path / "set" / "pairs" / "abc"[state], state, lowered_m)
    report = run([tmp_path / "set"], tmp_path / "out")
    true, matcher = report["progress"]
    assert [step["state"] for step in true["steps"]] == [1, 2]
    for step in true["steps"]:
        assert step["found_m3"] == pytest.approx(step["true_m3"], rel=1e-4)  # single precision of depth
        assert step["known"] == 1.0
        assert step["noticed"] == 1.0
    assert true["smallest_m3"] is matcher["smallest_m3"] is None
    (sentence,) = matcher["notes"]
    assert "cannot be given: 1 pair of this site shows it with nothing dug" in sentence
    assert sentence in report["notes"]
    page = (tmp_path / "out" / "decisions.html").read_text(encoding="utf-8")
    assert "cannot be given" in page
    assert all((tmp_path / "out" / step["map"]).is_file() for step in matcher["steps"])
    # The disparity of StereoBM is off by a part of a sixteenth of a pixel, the same for level ground: 3 mm here.
    assert all(abs(step["error_m3"]) < 0.64 * 0.006 for step in matcher["steps"])
    assert "Excavation" in page


def test_pairs_in_which_nothing_was_dug_tell_the_smallest_volume_if_their_noise_is_their_own(tmp_path):
    for k in range(7):
        write_state(tmp_path / "set" / "pairs" / f"null{k}", k, 0.0, seed=k)
    write_state(tmp_path / "set" / "pairs" / "same", 9, 0.0, seed=0)  # the noise of another pair: no further one
    write_state(tmp_path / "set" / "pairs" / "dug", 8, 0.1, seed=8)
    _, matcher = run([tmp_path / "set"], tmp_path / "out")["progress"]
    assert matcher["null_pairs"] == 6
    assert [step["state"] for step in matcher["steps"]] == [8]  # untouched pairs are no steps
    assert matcher["smallest_m3"] == pytest.approx(3.29 * matcher["sigma_m3"])
    assert matcher["bounds_m3"][0] < matcher["smallest_m3"] < matcher["bounds_m3"][1]
    assert not matcher["notes"]


def test_a_volume_that_is_missing_has_a_sentence(tmp_path):
    for state, lowered_m in enumerate((0.0, 0.1)):
        write_state(tmp_path / "set" / "pairs" / "ab"[state], state, lowered_m)
    path = tmp_path / "set" / "pairs" / "b" / "pair.json"
    data = json.loads(path.read_text())
    data["excavation"]["region_m"] = [5.0, 5.0, 6.0, 6.0]  # outside the map
    path.write_text(json.dumps(data))
    true, _ = run([tmp_path / "set"], tmp_path / "out")["progress"]
    assert true["steps"][0]["found_m3"] is None
    assert "no volume of state 1: only 0 %" in true["notes"][0]


def test_states_without_true_heights_have_the_same_cells_although_the_camera_moves(tmp_path):
    for state, lowered_m in enumerate((0.0, 0.1)):
        folder = tmp_path / "set" / "pairs" / "ab"[state]
        write_state(folder, state, lowered_m)
        data = json.loads((folder / "pair.json").read_text())
        del data["workspace"]
        for pose in data["poses_camera_to_world"].values():
            pose[0][3] += 0.003 * state
        data["settings"]["rig"]["x_m"] = 0.003 * state
        (folder / "pair.json").write_text(json.dumps(data))
    true = run([tmp_path / "set"], tmp_path / "out", cell_m=0.04)["progress"][0]
    # Cells of 4 cm cover the region of 80 cm exactly.
    assert true["steps"][0]["found_m3"] == pytest.approx(true["steps"][0]["true_m3"], rel=1e-4)


def test_too_small_cells_are_noted(tmp_path):
    workspaces.write(tmp_path / "pair", exact=False)
    notes = run([tmp_path / "pair"], tmp_path / "out", cell_m=0.004)["notes"]
    assert any("too few pixels" in note for note in notes)
    assert not any("too few pixels" in note for note in run([tmp_path / "pair"], tmp_path / "b", cell_m=0.05)["notes"])


def test_a_depth_of_nothing_takes_no_site_and_is_told_in_words(dataset, tmp_path, monkeypatch):
    real = fuse.match_checked
    monkeypatch.setattr(
        fuse, "match_checked", lambda *given: (np.full_like(real(*given)[0], np.nan), *real(*given)[1:])
    )
    report = run([dataset], tmp_path / "out")
    assert not report["failed"]
    entry = report["summary"][1]
    assert entry["sites.taken"] == entry["dem.completeness"] == 0.0
    assert entry["dem.rmse_m"] is entry["sites.false_safe"] is None
    assert "no site looks safe" in report["head"][1]


def test_ground_that_the_arm_does_not_reach_counts_nowhere(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(workspace, "find_joint_margins_deg", lambda *given: np.full(given[-1].shape, np.nan))
    report = run([dataset], tmp_path / "out")
    assert not report["failed"]
    assert report["summary"][1]["base_rate"] is None
    assert any("no cell of the workspace is in reach" in note for note in report["notes"])


def test_one_scene_tells_no_interval_and_that_is_told(tmp_path):
    workspaces.write(tmp_path / "pair")
    report = run([tmp_path / "pair"], tmp_path / "out")
    assert report["summary"][1]["intervals"]["sites.taken"] == [None, None]
    assert any(note.startswith("One scene gives no interval") for note in report["notes"])


def test_pairs_without_their_true_heights_fail_in_a_sentence_and_stop_no_other(dataset, tmp_path):
    (dataset / "pairs" / "a" / "workspace.npy").unlink()
    report = run([dataset], tmp_path / "out")
    assert {entry["pair"] for entry in report["failed"]} == {"a"}
    assert "render the pair again" in report["failed"][0]["message"]
    assert report["summary"][1]["pairs"] == 1


WORTH = "[site]\nleast_albedo = 0.3\nmost_albedo = 0.9\n"


def with_materials(folder, albedo):
    """A pair of level ground of this albedo, without rock and salt, in its maps and in the light of its image."""
    workspaces.write(folder, pairs.Scene(slope_x=0.0, slope_y=0.0, rock=False))
    data = json.loads((folder / "pair.json").read_text())
    albedos = np.full((4, 30, 30), albedo, np.float32)
    albedos[3] = 0.0
    for name, maps in (("workspace.npy", np.zeros((2, 30, 30), np.float32)), ("workspace_materials.npy", albedos)):
        np.save(folder / name, maps)
        data["files"][name] = {"bytes": (folder / name).stat().st_size, "sha256": hash_file(folder / name)}
    data["workspace"]["materials"] = "workspace_materials.npy"
    data["settings"]["workspace"]["materials"] = True
    # Ground of the radiance 3 W/(m² sr), which faces the Sun: L = albedo E / π.
    irradiance = round(3.0 * np.pi / albedo, 4)
    data["settings"]["light"]["sun_irradiance_wm2"] = data["light"]["sun"]["irradiance_wm2"] = irradiance
    (folder / "pair.json").write_text(json.dumps(data))


def test_rules_of_albedo_judge_what_the_image_shows_of_it(tmp_path):
    (tmp_path / "mine.toml").write_text(WORTH)
    for name, albedo in (("fits", 0.6), ("dark", 0.2)):
        with_materials(tmp_path / "set" / "pairs" / name, albedo)
    report = decide_pairs([tmp_path / "set"], [], tmp_path / "out", read_rules(tmp_path / "mine.toml"))
    fits, dark = (next(row for row in report["rows"] if row["pair"] == name)["numbers"] for name in ("fits", "dark"))
    # A footprint has some 400 pixels of a texture of 0.8, and the few that are as dark as a shadow do not count.
    assert abs(fits["materials"]["albedo_bias"]) < 0.03 * 0.6
    assert abs(dark["materials"]["albedo_bias"]) < 0.03 * 0.2
    assert fits["materials"]["salt_rmse"] is None  # of a monochrome camera
    assert fits["sites"]["base_rate"] > 0.1
    assert fits["sites"]["taken"] > 0.1
    assert dark["sites"]["base_rate"] == dark["sites"]["taken"] == 0.0
    page = (tmp_path / "out" / "decisions.html").read_text(encoding="utf-8")
    assert "Albedo: RMSE" in page
    assert "site.least_albedo" in page


def test_pairs_without_maps_of_what_the_rules_ask_for_fail_in_a_sentence(dataset, tmp_path):
    (tmp_path / "mine.toml").write_text(WORTH)
    report = decide_pairs([dataset], [], tmp_path / "out", read_rules(tmp_path / "mine.toml"))
    assert len(report["failed"]) == 2
    assert "workspace.materials" in report["failed"][0]["message"]
    assert "Albedo: RMSE" not in (tmp_path / "out" / "decisions.html").read_text(encoding="utf-8")

"""Disparities computed elsewhere, evaluated as methods of their own."""

import csv
import json
import subprocess
import sys

import foreign
import numpy as np
import OpenEXR
import pairs
import pytest
from icymoon.stereo.datasets import predictions
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.export_for_prediction import export_for_prediction
from icymoon.stereo.images.disparity_files import read_confidence
from icymoon.stereo.images.image_files import read_png
from icymoon.stereo.matchers.methods import Method, parse_methods
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.support.errors import IcyMoonError

pytestmark = [pytest.mark.filterwarnings("error"), pytest.mark.usefixtures("undrawn")]

RIG = pairs.camera(96, 64)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("set")
    for name in ("one", "two"):
        pairs.write_pair(root / "pairs" / name, pairs.Scene(sky_rows=8), RIG)
    return root


@pytest.fixture(scope="module")
def truth():
    """The true disparity of both pairs, NaN for sky."""
    return RIG.disparity(pairs.view(pairs.Scene(sky_rows=8), RIG, "left")[0])


def write_exr(path, values):
    OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage},
        {"Y": np.ascontiguousarray(values, np.float32)},
    ).write(str(path))


@pytest.mark.parametrize(
    ("ending", "write", "rounding"),
    [
        (".pfm", foreign.write_pfm, 1e-5),
        (".npy", np.save, 1e-12),
        (".exr", write_exr, 1e-5),
        (".png", lambda path, values: foreign.write_image(path, foreign.steps(values)), 0.5 / 256),
    ],
)
def test_an_error_that_was_put_in_comes_out(dataset, truth, tmp_path, ending, write, rounding):
    for name in ("one", "two"):
        (tmp_path / "p").mkdir(exist_ok=True)
        write(tmp_path / "p" / f"{name}{ending}", truth + 0.75)
    report = evaluate([dataset], [], tmp_path / "out", predictions=[f"mynet={tmp_path / 'p'}"])
    rows = list(report["rows"])
    assert [(row["pair"], row["method"], row["status"]) for row in rows] == [
        ("one", "mynet", "ok"),
        ("two", "mynet", "ok"),
    ]
    for row in rows:
        assert row["epe_px"] == pytest.approx(0.75, abs=rounding + 1e-6)
        assert row["coverage"] == 1.0
        assert (row["bad_0_5"], row["bad_1"]) == (1.0, 0.0)
        assert row["seconds"] is None  # nobody knows
    assert report["summary"][0]["seconds"] is None
    assert report["provenance"]["methods"][0]["options"] == {"folder": str(tmp_path / "p")}


def test_predictions_stand_beside_matchers_and_are_read_again_when_they_change(dataset, truth, tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    for name in ("one", "two"):
        np.save(folder / f"{name}.npy", truth)
    told = []

    def run(*predictions):
        told.clear()
        report = evaluate(
            [dataset], parse_methods("bm"), tmp_path / "out", on_event=told.append, predictions=predictions
        )
        return {(row["pair"], row["method"]): row for row in report["rows"]}

    first = run(f"net={folder}")
    assert first["one", "net"]["epe_px"] == pytest.approx(0, abs=1e-6)
    np.save(folder / "two.npy", truth + 2)
    second = run(f"net={folder}")
    assert second["one", "net"] == first["one", "net"]
    assert second["one", "bm"] == first["one", "bm"]
    assert second["two", "net"]["epe_px"] == pytest.approx(2, abs=1e-6)
    (folder / "one.npy").unlink()
    third = run(f"net={folder}")
    assert third["one", "net"]["status"] == "failed"
    assert "has no disparity of the pair one; add one.pfm" in third["one", "net"]["error"]
    assert third["two", "net"]["status"] == "ok"
    assert len([event for event in told if event["type"] == "error"]) == 1


def test_a_confidence_beside_a_prediction_is_measured_and_read_again_when_it_changes(dataset, truth, tmp_path):
    """The left half is wrong by 3 px, and known to be. A matcher beside it is run again for a confidence."""
    folder = tmp_path / "p"
    folder.mkdir()
    half = np.arange(truth.shape[1]) < truth.shape[1] // 2
    for name in ("one", "two"):
        np.save(folder / f"{name}.npy", truth + 3 * half)

    def run():
        report = evaluate(
            [dataset],
            parse_methods("bm"),
            tmp_path / "out",
            predictions=[f"net={folder}"],
            confidence=("own", "left_right"),
        )
        return {(row["pair"], row["method"]): row for row in report["rows"]}, report["summary"]

    np.save(folder / "one_confidence.npy", np.where(half, 0.0, np.ones_like(truth)))
    rows, (beside, summary) = run()
    assert "confidence" not in rows["two", "net"]
    assert list(rows["two", "bm"]["confidence"]) == list(beside["confidence"]) == ["left_right"]
    found, means = rows["one", "net"]["confidence"]["own"], summary["confidence"]
    assert found["ause"] == pytest.approx(0, abs=1e-6)  # of disparities in single precision
    assert found["ece"] == 0.0
    assert found["coverage_at_bad_2"] == pytest.approx(1 - (half & np.isfinite(truth)).sum() / np.isfinite(truth).sum())
    assert means["own"]["ause"]["pairs"] == 1
    assert sum(means["own"]["calibration"]["n"]) == np.isfinite(truth).sum()
    other, one, _, two = csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines())
    assert (other["own_ece"], float(one["own_ece"]), two["own_ece"]) == ("", 0.0, "")
    assert float(other["left_right_ece"]) == rows["one", "bm"]["confidence"]["left_right"]["ece"]
    stored = read_confidence(tmp_path / "out" / rows["one", "net"]["images"]["disparity"], truth.shape)
    np.testing.assert_array_equal(stored, ~half & np.isfinite(truth))
    picture = read_png(tmp_path / "out" / rows["one", "net"]["images"]["confidence"])[: len(truth)]
    sure, unsure = picture[-1, -1].astype(int), picture[-1, 0].astype(int)
    assert unsure.sum() > sure.sum() + 300  # bright is unsure
    assert "confidence" not in rows["two", "net"]["images"]
    (folder / "one_confidence.npy").unlink()
    np.save(folder / "one_error_px.npy", np.where(half, 3.0, np.zeros_like(truth)))
    again, _ = run()
    assert (again["two", "net"], again["one", "bm"]) == (rows["two", "net"], rows["one", "bm"])
    stated = again["one", "net"]["confidence"]["own"]
    assert stated["ece"] == pytest.approx(np.exp(-3) * (1 - found["coverage_at_bad_2"]), rel=1e-5)
    np.save(folder / "one_confidence.npy", truth)
    with pytest.raises(IcyMoonError, match=r"one_confidence\.npy and one_error_px\.npy of the pair one; keep one"):
        predictions.find_confidence(Method("net", predictions.PREDICTION, {"folder": str(folder)}), "one")


def test_png_files_of_a_confidence_have_their_largest_number_for_1(tmp_path):
    measured = np.ones((2, 3), bool)
    for dtype in (np.uint8, np.uint16):
        most = np.iinfo(dtype).max
        path = tmp_path / f"{most}.png"
        foreign.write_image(path, np.array([[0, most, most // 5]] * 2, dtype))
        assert predictions._read_confidence(path, "confidence", measured)[0].tolist() == pytest.approx([0, 1, 0.2])


def test_methods_are_compared_with_the_principal_points_of_the_data(tmp_path):
    """Middlebury's depth is not f·B over disparity; what the right eye sees is not known there."""
    root = foreign.middlebury(tmp_path / "m", doffs=20)
    for name, error in (("a", 0.5), ("b", 1.0)):
        foreign.write_pfm(tmp_path / name / "Adirondack.pfm", foreign.constant(foreign.SHIFT_PX + error))
    evaluate([root], [], tmp_path / "out", predictions=[f"a={tmp_path / 'a'}", f"b={tmp_path / 'b'}"])
    rows = {
        row["method"]: row
        for row in map(json.loads, (tmp_path / "out" / "results.jsonl").read_text(encoding="utf-8").splitlines())
    }
    for name, other, error in (("a", "b", 0.5), ("b", "a", 1.0)):
        common = rows[name]["common"][other]
        wanted = 20 / 27 - 20 / (27 + error)
        assert rows[name]["l1_m"] == pytest.approx(wanted, rel=1e-5)
        assert common["l1_m"] == pytest.approx(wanted, rel=1e-5)
        assert common["epe_px"] == pytest.approx(error, rel=1e-5)
        assert (common["visible_n"], common["visible_l1_m"], rows[name]["visible_l1_m"]) == (0, None, None)


def test_a_damaged_prediction_fails_alone(dataset, truth, tmp_path):
    for name in ("one", "two"):
        foreign.write_pfm(tmp_path / "p" / f"{name}.pfm", truth)
    path = tmp_path / "p" / "two.pfm"
    path.write_bytes(path.read_bytes()[:-100])
    rows = list(evaluate([dataset], [], tmp_path / "out", predictions=[f"n={tmp_path / 'p'}"])["rows"])
    assert [row["status"] for row in rows] == ["ok", "failed"]
    assert rows[1]["error"].startswith(f"{path}: is not a whole map that can be read (")


def test_two_predictions_of_one_pair_are_no_prediction(dataset, truth, tmp_path):
    for name in ("one", "two"):
        foreign.write_pfm(tmp_path / "p" / f"{name}.pfm", truth)
    np.save(tmp_path / "p" / "two.npy", truth + 3)
    rows = list(evaluate([dataset], [], tmp_path / "out", predictions=[f"n={tmp_path / 'p'}"])["rows"])
    assert [row["status"] for row in rows] == ["ok", "failed"]
    assert rows[1]["error"] == f"{tmp_path / 'p'} has two.pfm and two.npy of the pair two; keep one of them."


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("net", "write it as NAME=FOLDER"),
        ("=folder", "write it as NAME=FOLDER"),
        ("-net=x", "begins with a letter"),
        ("bm={folder}", "there is already a method bm"),
        ("net={folder}/none", "has no disparity of any pair"),
        ("net={folder}/none", "name the files after the pairs, such as one.pfm, one.png, one.npy"),
    ],
)
def test_a_mistake_in_the_option_is_told_before_anything_runs(dataset, tmp_path, text, words):
    (tmp_path / "p").mkdir()
    with pytest.raises(IcyMoonError) as caught:
        evaluate(
            [dataset],
            parse_methods("bm"),
            tmp_path / "out",
            predictions=[text.replace("{folder}", str(tmp_path / "p"))],
        )
    assert words in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_wrong_names_in_a_folder_cost_its_own_method(dataset, truth, tmp_path):
    (tmp_path / "good").mkdir()
    (tmp_path / "wrong").mkdir()
    for name in ("one", "two"):
        np.save(tmp_path / "good" / f"{name}.npy", truth)
    np.save(tmp_path / "wrong" / "one_left.npy", truth)
    wrong = f"wrong={tmp_path / 'wrong'}"
    for others, methods in (([f"good={tmp_path / 'good'}"], []), ([], parse_methods("bm"))):
        rows = list(evaluate([dataset], methods, tmp_path / f"out{len(others)}", predictions=[wrong, *others])["rows"])
        assert {row["status"] for row in rows if row["method"] != "wrong"} == {"ok"}
        assert [row["error"] for row in rows if row["method"] == "wrong"] == [
            f"{tmp_path / 'wrong'} has no disparity of the pair one; rename one_left.npy to one.npy.",
            f"{tmp_path / 'wrong'} has no disparity of the pair two; add two.pfm, or .png, .npy or .exr.",
        ]
    with pytest.raises(IcyMoonError, match="has no disparity of any pair; name the files after the pairs"):
        evaluate([dataset], [], tmp_path / "out", predictions=[wrong])  # nothing would be left
    assert not (tmp_path / "out").exists()


def test_without_any_method_there_is_nothing_to_evaluate(dataset, tmp_path):
    with pytest.raises(IcyMoonError, match="no method to evaluate"):
        evaluate([dataset], [], tmp_path / "out")


def test_what_is_written_for_prediction_is_what_matchers_get(dataset, tmp_path):
    assert export_for_prediction([dataset], tmp_path, {}) == []
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")) == [
        "README.txt",
        *(f"{name}/{file}" for name in ("one", "two") for file in ("calib.txt", "im0.png", "im1.png")),
    ]
    prepared = prepare_pair(dataset / "pairs" / "one", {})
    np.testing.assert_array_equal(read_png(tmp_path / "one" / "im0.png"), prepared.left)
    np.testing.assert_array_equal(read_png(tmp_path / "one" / "im1.png"), prepared.right)
    assert "one.npy" in (tmp_path / "README.txt").read_text(encoding="utf-8")
    # With a truth beside them the images are a data set of Middlebury's layout.
    foreign.write_pfm(tmp_path / "one" / "disp0.pfm", RIG.disparity(prepared.truth))
    foreign.write_pfm(tmp_path / "two" / "disp0.pfm", RIG.disparity(prepared.truth))
    rows = [
        list(evaluate([path], parse_methods("bm"), tmp_path / f"out{k}")["rows"])
        for k, path in enumerate((dataset, tmp_path))
    ]
    assert rows[0][0]["epe_px"] == pytest.approx(rows[1][0]["epe_px"], abs=1e-6)


def test_foreign_pairs_are_written_for_prediction_too(tmp_path):
    foreign.kitti_2015(tmp_path / "k", frames=2)
    assert export_for_prediction([tmp_path / "k"], tmp_path / "out", {}) == []
    np.testing.assert_array_equal(
        read_png(tmp_path / "out" / "000001_10" / "im0.png"), foreign.eyes(colour=True, seed=1)[0]
    )
    with pytest.raises(IcyMoonError, match=r"was not rendered here.*leave out --set"):
        export_for_prediction([tmp_path / "k"], tmp_path / "out", {"sensor": {"bits": 12}})


@pytest.mark.long
@pytest.mark.slow
def test_the_command_line_evaluates_predictions_alone(dataset, truth, tmp_path):
    for name in ("one", "two"):
        foreign.write_pfm(tmp_path / "p" / f"{name}.pfm", truth)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "icymoon",
            "evaluate",
            str(dataset),
            "--predictions",
            f"net={tmp_path / 'p'}",
            "--out",
            str(tmp_path / "out"),
            "--jobs",
            "1",
            "--json-lines",
        ],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert [row["method"] for row in result["rows"]] == ["net"]

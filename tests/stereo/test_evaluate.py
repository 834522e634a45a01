"""A data set from pair folders to the report."""

import base64
import csv
import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from html.parser import HTMLParser
from typing import get_origin, get_type_hints

import cv2
import numpy as np
import pairs
import pytest
from icymoon.physics.camera import nearest_ground
from icymoon.settings.description import defaults, merged
from icymoon.settings.shared_settings import add_shared
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.images.colours import INVALID_GREY, SKY_GREY, add_colour_bar, draw_error, make_depth_scale
from icymoon.stereo.matchers import check_options
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.metrics import COSTS
from icymoon.stereo.report import schema
from icymoon.stereo.report.row_log import RowLog
from icymoon.support.errors import IcyMoonError
from icymoon.support.file_schemas import find_fault

pytestmark = pytest.mark.filterwarnings("error")

SCENES = {"aaa": pairs.Scene(), "bbb": pairs.Scene(sky_rows=24, distance_m=3.0), "ccc": pairs.Scene(rock=False)}
METHODS = parse_methods("bm,sgbm,bm:window=21")


def strict_json(path):
    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("data") / "set <em>"
    for (name, scene), layout in zip(SCENES.items(), ("4.x", "4.x view", "5.x"), strict=True):
        pairs.write_pair(root / "pairs" / name, scene, layout=layout)
    return root


@pytest.fixture(scope="module")
def result(dataset, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    events = []
    report = evaluate([dataset], METHODS, out, on_event=events.append)
    return report, out, events


def test_everything_is_evaluated_and_written(result):
    report, out, events = result
    assert [(row["pair"], row["method"]) for row in report["rows"]] == [
        (pair, method) for pair in SCENES for method in ("bm", "sgbm", "bm:window=21")
    ]
    lists = {"rows": list(report["rows"]), "pairs": list(report["pairs"])}
    written = strict_json(out / "report.json")
    shared = written.pop("shared_settings")
    assert not any(
        key in shared.get(topic, {})
        for pair in written["pairs"]
        for topic, table in pair["settings"].items()
        for key in table
    )
    for pair in written["pairs"]:
        pair["settings"] = add_shared(pair["settings"], shared)
    assert written == json.loads(json.dumps(report | lists))
    lines = [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]
    assert [row.items() <= line.items() for row, line in zip(report["rows"], lines, strict=True)] == [True] * 9
    assert [(e["type"], e["done"], e["total"]) for e in events] == [("progress", k, 9) for k in range(1, 10)]
    assert not report["failed"]
    with (out / "results.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [float(line["l1_m"]) for line in table] == [row["l1_m"] for row in report["rows"]]
    with (out / "comparisons.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [line["typical"] for line in table] == [
        "" if entry["typical"] is None else str(entry["typical"]) for entry in report["comparisons"]
    ]
    assert {line["scenes_needed"] for line in table} == {"8"}  # of three methods
    for entry in (*report["rows"], *report["pairs"]):
        assert all((out / path).stat().st_size > 0 for path in entry["images"].values())
    assert not list(out.rglob("*.part"))


def test_a_written_report_is_of_its_type(result):
    _, out, _ = result
    written = strict_json(out / "report.json")
    assert list(written) == [*schema.Report.__annotations__, "shared_settings"]
    kinds = {name: get_origin(hint) or hint for name, hint in get_type_hints(schema.Report).items()}
    for name, kind in kinds.items():
        assert isinstance(written[name], {Sequence: list, Mapping: dict}.get(kind, kind)), name
    hints = get_type_hints(schema.Comparison)
    for entry in written["comparisons"]:
        assert entry.keys() == hints.keys()
        assert all(isinstance(entry[name], hint) for name, hint in hints.items()), entry
    row = {key: shape for key, shape in schema.ROW.items() if key not in schema.LONG}
    for kept, shape in (("rows", row), ("pairs", schema.FACTS)):
        assert [find_fault(each, shape) for each in written[kept]] == [""] * len(written[kept])
    summary = strict_json(out / "summary.json")
    assert summary.keys() == written.keys() - {"rows", "pairs", "shared_settings"} | {"shown"}


def test_rows_hold_what_follows_from_disparity_and_analytic_truth(result):
    report, out, _ = result
    for row in report["rows"]:
        truth = pairs.view(SCENES[row["pair"]], pairs.camera(), "left")[0]
        with np.load(out / row["images"]["disparity"]) as stored:
            disparity = stored["disparity"].astype(np.float64)
            assert stored["disparity"].dtype == np.float32
            assert stored["focal_baseline_px_m"] == pytest.approx(256 * 32 / 60 * 0.25)
        depth = 256 * 32 / 60 * 0.25 / disparity
        both = np.isfinite(truth) & np.isfinite(depth)
        assert row["n"] == both.sum() > 1000
        assert row["true_pixels"] == np.isfinite(truth).sum()
        assert row["coverage"] == pytest.approx(both.sum() / np.isfinite(truth).sum())
        assert row["l1_m"] == pytest.approx(np.abs(depth - truth)[both].mean(), rel=1e-5)
        assert row["error_curve"][-1] == pytest.approx(row["coverage"], abs=0.01)


def test_sgbm_is_accurate_and_hidden_pixels_are_the_worse_ones(result):
    rows = [row for row in result[0]["rows"] if row["method"] == "sgbm"]
    for row in rows:
        assert row["coverage"] > 0.85
        assert row["epe_px"] < 0.2
        assert row["visible_coverage"] > row["coverage"]
        assert row["visible_n"] < row["n"]
        assert row["visible_bad_1"] <= row["bad_1"]


def test_common_pixels_are_those_of_two_methods(result):
    _, out, _ = result
    log = RowLog(out / "results.jsonl")
    for pair in SCENES:
        rows = {method.label: log.read(pair, method.label) for method in METHODS}
        truth = pairs.view(SCENES[pair], pairs.camera(), "left")[0]
        disparity = {
            label: np.load(out / row["images"]["disparity"])["disparity"].astype(float) for label, row in rows.items()
        }
        for label, row in rows.items():
            assert row["common"].keys() == rows.keys() - {label}
            for other, numbers in row["common"].items():
                common = np.isfinite(truth) & np.isfinite(disparity[label]) & np.isfinite(disparity[other])
                assert numbers["n"] == rows[other]["common"][label]["n"] == common.sum() > 1000
                assert numbers["key"] == rows[other]["key"]
                error = np.abs(pairs.camera().focal_baseline_px_m / disparity[label] - truth)[common]
                assert numbers["l1_m"] == pytest.approx(error.mean(), rel=1e-5)


def test_summary_averages_pairs_and_pools_pixels(result):
    report, _, _ = result
    for entry in report["summary"]:
        rows = [row for row in report["rows"] if row["method"] == entry["method"]]
        assert (entry["pairs"], entry["failed"]) == (3, 0)
        assert entry["l1_m"] == pytest.approx(np.mean([row["l1_m"] for row in rows]))
        assert entry["dod"] == pytest.approx(np.mean([row["dod"] for row in rows]))
        assert entry["n"] == sum(row["n"] for row in rows)
        assert entry["pooled_l1_m"] == pytest.approx(
            np.average([row["l1_m"] for row in rows], weights=[row["n"] for row in rows])
        )
        assert entry["pooled_coverage"] == pytest.approx(entry["n"] / sum(row["true_pixels"] for row in rows))


class _Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.images, self.links, self.tags, self.text = [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name in ("src", "href", "srcset", "action")]
        self.images += [value for name, value in attributes if tag == "img" and name == "src"]

    def handle_data(self, data):
        self.text += data


def test_the_report_is_one_file_with_every_picture(result):
    report, out, _ = result
    page = _Page((out / "report.html").read_text(encoding="utf-8"))
    # Of three pairs, of three methods on each, and on a typical pair.
    assert len(page.images) == 3 * (2 + 2 * 3) + 1 + 3
    assert all(link.startswith("data:image/") for link in page.links)
    assert not {"link", "iframe", "object", "form"} & set(page.tags)
    assert page.tags.count("script") == 2  # data and our own program, neither with a source elsewhere
    for image in page.images:
        content = base64.b64decode(image.partition(",")[2])
        assert cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR).shape == (144, 256, 3)
    assert "set <em>" in page.text  # names are text, never markup
    assert "em" not in page.tags
    sgbm = next(entry for entry in report["summary"] if entry["method"] == "sgbm")
    assert f"{sgbm['l1_m']:.3f}" in page.text
    assert (out / "report.html").stat().st_size < 300_000 * 3 + 300_000


@pytest.mark.long
def test_running_again_gives_the_same(result, dataset):
    report, out, _ = result
    before = sorted(path.relative_to(out) for path in out.rglob("*"))
    again = evaluate([dataset], METHODS, out)
    assert sorted(path.relative_to(out) for path in out.rglob("*")) == before

    assert list(again["rows"]) == list(report["rows"])  # to the processor time, since nothing was done again
    assert list(again["pairs"]) == list(report["pairs"])
    assert (again["summary"], again["comparisons"]) == (report["summary"], report["comparisons"])


@pytest.mark.usefixtures("undrawn")
def test_the_layout_of_the_files_does_not_matter(tmp_path):
    rows = []
    for layout in ("4.x", "4.x view", "5.x"):
        folder = pairs.write_pair(tmp_path / layout / "pair", pairs.Scene(), layout=layout)
        row = evaluate([folder], parse_methods("sgbm"), tmp_path / "out" / layout)["rows"][0]
        rows.append({**row, **dict.fromkeys(COSTS), "key": None})
    assert rows[0] == rows[1] == rows[2]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("path", ["", "pairs", "pairs/aaa"])
def test_a_data_set_its_pairs_folder_or_one_pair(dataset, tmp_path, path):
    report = evaluate([dataset / path], parse_methods("bm"), tmp_path)
    assert len(report["rows"]) == (1 if path.endswith("aaa") else 3)


@pytest.mark.usefixtures("undrawn")
def test_a_new_camera_response_needs_no_new_render(dataset, tmp_path):
    flooded = evaluate(
        [dataset / "pairs" / "aaa"],
        parse_methods("bm,sgbm"),
        tmp_path,
        {"sensor": {"auto_exposure": False, "exposure_s": 0.1, "read_noise_e": 0.0}},
    )
    assert flooded["pairs"][0]["saturated"] == 1
    assert flooded["pairs"][0]["settings"]["sensor"]["exposure_s"] == 0.1
    for row in flooded["rows"]:
        assert (row["n"], row["coverage"], row["l1_m"], row["dod"]) == (0, 0, None, None)
    assert flooded["summary"][0]["l1_m"] is None
    assert "–" in (tmp_path / "report.html").read_text(encoding="utf-8")


def _flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)


def _edit(path, **changes):
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.ci_takes(4)
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (lambda folder: _flip(folder / "left.exr"), r"left\.exr is not the file that was rendered"),
        (lambda folder: (folder / "right.exr").unlink(), r"right\.exr is missing"),
        (lambda folder: (folder / "pair.json").write_text("{"), "cannot be read"),
        (lambda folder: (folder / "pair.json").write_text("[]"), "not an Icy Moon pair"),
        (lambda folder: _edit(folder / "pair.json", version=99), "format version 99"),
        (
            lambda folder: _edit(folder / "pair.json", camera=pairs.camera(128, 72).to_json()),
            r"camera\.width_px is 128, and its settings give 256",
        ),
        (lambda folder: _edit(folder / "pair.json", settings=[]), r"settings is \[\], not a table"),
        (
            lambda folder: _edit(folder / "pair.json", settings={"sensor": {"read_noise_e": "abc"}}),
            r"sensor\.read_noise_e must be a number, not 'abc'",
        ),
        (lambda folder: _edit(folder / "pair.json", camera=7), "camera is 7, not a table"),
        (lambda folder: _edit(folder / "pair.json", files={}), r"files\.left\.exr is missing"),
        (lambda folder: (folder / "pair.json").write_text("[" * 100_000), "cannot be read"),
    ],
)
def test_a_broken_pair_is_named_and_the_others_are_done(tmp_path, harm, reason):
    root = tmp_path / "set" / "pairs"
    pairs.write_pair(root / "bad")
    pairs.write_pair(root / "good")
    harm(root / "bad")
    events = []
    report = evaluate([tmp_path / "set"], parse_methods("bm"), tmp_path / "out", on_event=events.append)
    bad, good = report["rows"]
    assert (bad["status"], good["status"]) == ("failed", "ok")
    assert [failure["pair"] for failure in report["failed"]] == ["bad"]
    for message in (bad["error"], report["failed"][0]["message"], events[0]["message"]):
        with pytest.raises(IcyMoonError, match=reason):
            raise IcyMoonError(message)
    assert (report["summary"][0]["pairs"], report["summary"][0]["failed"]) == (1, 1)
    assert "1 failed" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_one_method_that_cannot_run_does_not_stop_the_other(tmp_path):
    pairs.write_pair(tmp_path / "pair", rig=pairs.camera(96, 72))
    report = evaluate([tmp_path / "pair"], parse_methods("bm,sgbm", ["bm.window=75"]), tmp_path / "out")
    assert [row["status"] for row in report["rows"]] == ["failed", "ok"]
    assert "too small for StereoBM" in report["rows"][0]["error"]
    assert report["failed"][0]["method"] == "bm"


@pytest.mark.usefixtures("undrawn")
def test_incomplete_pairs_are_passed_over(tmp_path):
    pairs.write_pair(tmp_path / "pairs" / "whole")
    shutil.copytree(tmp_path / "pairs" / "whole", tmp_path / "pairs" / "other.part")
    (tmp_path / "pairs" / "begun").mkdir()
    assert [row["pair"] for row in evaluate([tmp_path], parse_methods("bm"), tmp_path / "out")["rows"]] == ["whole"]


def test_nothing_to_evaluate_is_an_error_that_writes_nothing(tmp_path):
    with pytest.raises(IcyMoonError, match="no complete stereo pair"):
        evaluate([tmp_path], METHODS, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_pairs_without_truth_or_light(tmp_path):
    """Night, and a camera that looks at the sky."""
    pairs.write_pair(tmp_path / "pairs" / "night", pairs.Scene(radiance=0.0))
    pairs.write_pair(tmp_path / "pairs" / "sky", pairs.Scene(sky_rows=144))
    report = evaluate([tmp_path], parse_methods("bm,sgbm"), tmp_path / "out", {"sensor": {"read_noise_e": 0.0}})
    assert {row["status"] for row in report["rows"]} == {"ok"}
    night, sky = report["rows"][0], report["rows"][2]
    assert (night["coverage"], night["n"]) == (0, 0)
    assert (sky["coverage"], sky["n"], sky["true_pixels"]) == (None, 0, 0)
    strict_json(tmp_path / "out" / "report.json")


def test_pictures_tell_missing_measurements_from_sky():
    truth = np.array([[1.0, 1.0, np.nan, 2.0]])
    picture = draw_error(np.array([[1.0, np.nan, 3.0, 4.0]]), truth)[0].tolist()
    assert picture[1] == [INVALID_GREY] * 3
    assert picture[2] == [SKY_GREY] * 3
    assert max(picture[0]) < 10  # no error is black, one metre and more is the brightest
    assert min(picture[3]) > 180
    for width in (4, 20, 640):
        truth = np.full((5, width), 3.0)
        assert add_colour_bar(np.zeros((5, width, 3), np.uint8), make_depth_scale(truth)).shape[1:] == (width, 3)


@pytest.mark.parametrize(
    ("text", "options", "reason"),
    [
        ("", [], "is empty"),
        ("bm,sgmb", [], "did you mean 'sgbm'"),
        ("bm,bm", [], "names bm twice"),
        ("bm:window", [], "write it as key=value"),
        ("bm:windo=9", [], "did you mean 'window'"),
        ("bm", ["window=9"], "name the matcher too"),
        ("bm", ["sgbm.window=9"], "no method uses"),
        ("bm", ["bmm.window=9"], "did you mean 'bm'"),
        ("bm", ["bm.window"], "key=value"),
    ],
)
def test_wrong_methods_are_refused_before_anything_runs(text, options, reason):
    with pytest.raises(IcyMoonError, match=reason):
        parse_methods(text, options)


def test_methods_with_options():
    plain, own = parse_methods(" bm , bm:window=21:disparities=128", ["bm.window=9", "bm.uniqueness=5"])
    assert plain.options == check_options("bm", {"window": 9, "uniqueness": 5})
    assert own.options == check_options("bm", {"window": 21, "uniqueness": 5, "disparities": 128})
    assert own.file_name == "bm_window_21_disparities_128"


def test_a_row_that_the_disk_refuses_leaves_whole_rows(tmp_path, monkeypatch):
    log = RowLog(tmp_path / "rows.jsonl")
    log.append({"pair": "a", "method": "bm", "key": "1"})

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(IcyMoonError, match="disk is full"):
        log.append({"pair": "b", "method": "bm", "key": "2"})
    assert (tmp_path / "rows.jsonl").read_text() == '{"pair": "a", "method": "bm", "key": "1"}\n'
    assert log.find("b", "bm", "2") is None


@pytest.mark.usefixtures("undrawn")
def test_other_arrays_and_facts_of_a_method_are_kept(tmp_path):
    """Arrays in the npz, counts in the row, and the camera for a program that asks for it."""
    rig = pairs.camera(160, 90)
    pairs.write_pair(tmp_path / "pair", rig=rig)
    (tmp_path / "program.py").write_text(
        "import sys, numpy as np\nout, focal = sys.argv[3], float(sys.argv[4])\n"
        "np.save(out, np.full((90, 160), focal / 2))"
    )
    command = f"{sys.executable} {tmp_path / 'program.py'} {{left}} {{right}} {{out}} {{focal_px}}"
    report = evaluate(
        [tmp_path / "pair"],
        parse_methods("jplv,external", ["jplv.blob_size=20", f"external.command={command}"]),
        tmp_path / "out",
    )
    jplv, external = report["rows"]
    with np.load(tmp_path / "out" / jplv["images"]["disparity"]) as stored:
        assert {"disparity", "confidence", "jpl_disparity", "flags", "focal_baseline_px_m"} == set(stored.files)
        assert (stored["flags"] == 0).sum() == jplv["counts"]["ACCEPT"] == jplv["n"]
    assert sum(jplv["counts"].values()) == 160 * 90
    assert external["counts"] == {}
    # The program wrote f / 2 px, so the depth is 2 B everywhere.
    expected = np.abs(2 * rig.baseline_m - pairs.view(pairs.Scene(), rig, "left")[0]).mean()
    assert external["l1_m"] == pytest.approx(expected, rel=1e-3)


def count_grounds(monkeypatch):
    """The seeds of the grounds that are made for search ranges from now on. Choose seeds that no other test has: the
    last ground is kept."""
    made, make = [], nearest_ground.make_rocky_ground
    monkeypatch.setattr(
        nearest_ground, "make_rocky_ground", lambda settings: (made.append(settings.dataset.seed), make(settings))[1]
    )
    return made


@pytest.mark.usefixtures("undrawn")
def test_ground_that_pairs_share_is_made_once_whatever_their_names_are(tmp_path, monkeypatch):
    for name, seed in zip("abcd", (70017, 70019, 70017, 70019), strict=True):
        pairs.write_pair(
            tmp_path / "set" / "pairs" / name,
            rig=pairs.camera(64, 48),
            settings=merged(defaults(), {"dataset": {"seed": seed}}),
        )
    made = count_grounds(monkeypatch)
    report = evaluate([tmp_path / "set"], parse_methods("bm,sgbm"), tmp_path / "out", jobs=1)
    assert sorted(made) == [70017, 70019]
    assert [row["pair"] for row in report["rows"]] == [*"aabbccdd"]
    assert {row["search"]["source"] for row in report["rows"]} == {"settings"}


@pytest.mark.usefixtures("undrawn")
def test_no_ground_is_made_for_predictions_which_search_no_range(tmp_path, monkeypatch):
    pairs.write_pair(
        tmp_path / "set" / "pairs" / "a",
        rig=pairs.camera(64, 48),
        settings=merged(defaults(), {"dataset": {"seed": 70021}}),
    )
    (tmp_path / "mine").mkdir()
    np.save(tmp_path / "mine" / "a.npy", np.full((48, 64), 5.0, np.float32))
    made = count_grounds(monkeypatch)
    report = evaluate([tmp_path / "set"], [], tmp_path / "out", predictions=[f"mine={tmp_path / 'mine'}"], jobs=1)
    assert [row["status"] for row in report["rows"]] == ["ok"]
    assert not made

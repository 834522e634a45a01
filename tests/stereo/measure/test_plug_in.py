"""Metrics of plug-ins, in rows, tables, the report and the spreadsheet."""

import csv
import json

import numpy as np
import pytest
from icymoon.stereo.cli import main
from pairs import write_pair
from plugin_packages import add_package

METRIC = '''\
"""Mean of the absolute disparity error."""
import numpy as np
ICYMOON_API = 1
TITLE = "Own EPE"
UNIT = "px"

def measure(found):
    found.true_depth_m[:] = 0  # reaches nothing of ours
    return np.nanmean(abs(found.disparity_px - found.true_disparity_px))
'''


def returning(value: str) -> str:
    return f"import numpy as np\nICYMOON_API = 1\nUNIT = ''\ndef measure(found):\n    return {value}\n"


@pytest.fixture
def evaluate(tmp_path, monkeypatch, capsys):
    write_pair(tmp_path / "data" / "pairs" / "0123456789ab")
    write_pair(tmp_path / "data" / "pairs" / "0123456789cd")

    def run(*sources, name="own_epe"):
        for k, source in enumerate(sources):
            add_package(tmp_path / "site", monkeypatch, "metric", name, source, package=f"package-{k}")
        status = main(
            ["evaluate", str(tmp_path / "data"), "--methods", "bm", "--out", str(tmp_path / "out"), "--jobs", "1"]
        )
        said = capsys.readouterr()
        assert "Traceback" not in said.err
        return status, said, json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))

    return run


def test_its_numbers_are_everywhere(evaluate, tmp_path):
    status, said, report = evaluate(METRIC)
    assert status == 0
    (entry,) = report["summary"]
    # The same number as ours: an independent way through the same data.
    assert entry["plug_ins"]["own_epe"]["mean"] == pytest.approx(entry["epe_px"], rel=1e-6)
    assert entry["plug_ins"]["own_epe"]["pairs"] == 2
    assert [row["plug_ins"]["own_epe"] for row in report["rows"]] == pytest.approx(
        [row["epe_px"] for row in report["rows"]], rel=1e-6
    )
    assert report["plug_ins"] == [
        {
            "name": "own_epe",
            "heading": "Own EPE",
            "unit": "px",
            "decimals": 3,
            "plug_in": "package-0 1.0",
            "doc": "Mean of the absolute disparity error.",
        }
    ]
    assert "Own EPE (px)" in said.out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Metrics of plug-ins" in page
    assert "Own EPE (px)" in page
    with (tmp_path / "out" / "results.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[0]["own_epe"]) == pytest.approx(float(rows[0]["epe_px"]), rel=1e-6)


@pytest.mark.long
def test_without_one_nothing_changes(evaluate, tmp_path):
    _, said, report = evaluate()
    assert report["plug_ins"] == []
    assert "plug_ins" not in report["rows"][0]
    assert "plug-in" not in said.out
    assert "Metrics of plug-ins" not in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.long
def test_rows_of_an_earlier_run_are_measured_again_with_it(evaluate):
    evaluate()
    _, _, report = evaluate(METRIC)
    assert all(row["plug_ins"]["own_epe"] > 0 for row in report["rows"])


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("'much'", "returned str; return a number"),
        ("np.ones(3)", "returned ndarray"),
        ("True", "returned bool"),
        ("1j", "returned complex"),
        ("1 / 0", "failed (ZeroDivisionError"),
        ("None", "returned NoneType"),
    ],
)
def test_one_that_fails_is_told_and_stops_nothing(evaluate, value, said):
    status, told, report = evaluate(returning(value))
    assert status == 0
    (note,) = (note for note in report["notes"] if "The metric own_epe failed 2 times" in note)
    assert said in note
    assert note in " ".join(told.out.split())
    assert report["summary"][0]["plug_ins"]["own_epe"]["mean"] is None
    assert report["summary"][0]["l1_m"] > 0


@pytest.mark.long
@pytest.mark.parametrize("value", ["float('nan')", "np.float32('inf')"])
def test_an_undefined_number_is_null(evaluate, value):
    _, _, report = evaluate(returning(value))
    assert report["rows"][0]["plug_ins"] == {"own_epe": None}
    assert not any("own_epe" in note for note in report["notes"])


@pytest.mark.long
@pytest.mark.parametrize(
    ("sources", "said"),
    [
        (["raise ValueError('no')"], "cannot be loaded (ValueError: no"),
        ([METRIC.replace('"px"', '"furlong"')], "states UNIT = 'furlong'"),
        ([METRIC, METRIC], "package-0 1.0 and package-1 1.0 both add it"),
    ],
)
def test_one_that_cannot_be_used_is_left_out_aloud(evaluate, sources, said):
    status, told, report = evaluate(*sources)
    assert status == 0
    assert any(said in note for note in report["notes"])
    assert said in " ".join(told.out.split())
    assert report["plug_ins"] == []


@pytest.mark.long
@pytest.mark.parametrize("name", ["l1_m", "status"])
def test_one_with_the_name_of_ours_is_refused(evaluate, name):
    _, _, report = evaluate(METRIC, name=name)
    assert any("Icy Moon has a metric of this name" in note for note in report["notes"])
    assert np.isfinite(report["summary"][0]["l1_m"])

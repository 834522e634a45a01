"""The experiment on errors of the calibration: laws that its numbers follow, its tolerance, its files and its words."""

import csv
import math

import numpy as np
import pairs
import pytest
from icymoon.commands.cli import main
from icymoon.settings.description import defaults, merged
from icymoon.stereo.calibration_curves import (
    MAGNITUDES,
    average_pairs,
    find_tolerance,
    measure_calibration,
    parse_errors,
    tabulate,
)
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.support.errors import IcyMoonError


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return pairs.write_pair(
        tmp_path_factory.mktemp("pairs") / "aaa",
        pairs.Scene(rock=False),
        settings=merged(defaults(), {"calibration_error": {"k1": 0.1}}),
    )


def test_depth_errors_are_those_of_the_law(folder):
    """A column of the principal point adds to every disparity d, so that depth is off by 1 / (1 + error / d) - 1; a
    baseline scales it. SGBM alone is off by less than 0.3 % here. The error that the pair was rendered with is left
    out."""
    disparity = pairs.camera().disparity(prepare_pair(folder, {}).truth)
    errors = {"right_column_px": (0.0, 4.0), "baseline_percent": (0.0, 5.0)}
    rows = measure_calibration([folder], parse_methods("sgbm"), errors)
    found = {(row.setting, row.error): row.median_relative_error for row in rows}
    assert found["right_column_px", 0.0] == found["baseline_percent", 0.0] < 0.003
    assert found["right_column_px", 4.0] == pytest.approx(np.median(4 / (disparity + 4)), rel=0.05)
    assert found["baseline_percent", 5.0] == pytest.approx(0.05, abs=0.003)
    assert all(0.5 < row.coverage <= 1 for row in rows)


def test_the_tolerance_is_where_the_number_changes_by_its_factor_on_the_nearer_side():
    assert find_tolerance([-2.0, 0.0, 1.0], [3.0, 1.0, 1.5], 2.0) == pytest.approx(1.0)
    assert find_tolerance([-2.0, 0.0, 1.0, 3.0], [1.2, 1.0, 1.5, 2.5], 2.0) == pytest.approx(2.0)
    assert find_tolerance([-2.0, 0.0, 1.0], [1.9, 1.0, 2.0], 2.0) is None
    assert find_tolerance([-1.0, 0.0, 1.0], [1.0, 0.8, 0.56], 0.9) == pytest.approx(1 / 3)
    assert find_tolerance([-1.0, 0.0, 1.0], [5.0, 0.8, 0.73], 0.9) is None


def test_means_leave_out_pairs_without_a_number(folder):
    rows = measure_calibration([folder], parse_methods("bm"), {"right_column_px": (0.0, 1.0)})
    rig = rows[0].rig
    lost = [row.__class__(**(vars(row) | {"pair": "b", "median_relative_error": math.nan})) for row in rows]
    both = average_pairs(rows + lost, rig, "bm", "right_column_px", "median_relative_error")
    np.testing.assert_array_equal(both, average_pairs(rows, rig, "bm", "right_column_px", "median_relative_error"))
    assert np.isnan(average_pairs(lost, rig, "bm", "right_column_px", "median_relative_error")[1]).all()
    (entry,) = tabulate(rows)
    assert entry["largest"] == 1.0


def test_errors_are_stated_or_of_the_list():
    assert parse_errors([]).keys() == MAGNITUDES.keys()
    assert parse_errors([])["k1"] == (-0.1, -0.05, -0.03, -0.01, -0.005, 0.0, 0.005, 0.01, 0.03, 0.05, 0.1)
    assert parse_errors(["right_yaw_deg=0.5,-1"]) == {"right_yaw_deg": (-1.0, 0.0, 0.5)}
    for wrong, said in (
        ("right_yaw_deg=80", "outside -10 to 10 deg"),
        ("yaw=1", "unknown setting"),
        ("k1=x", "number"),
        ("k1=nan", "--errors k1=nan"),
        ("k1", "--errors k1: "),
    ):
        with pytest.raises(IcyMoonError, match=said):
            parse_errors([wrong])


def test_the_command_writes_a_table_and_a_picture(folder, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["calibration", str(folder), "--methods", "bm", "--errors", "right_row_px=-2,2", "--out", str(out)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "right_row_px" in said
    assert "256 x 144 px" in said
    with (out / "calibration.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["error"]) for row in rows] == [-2.0, 0.0, 2.0]
    assert (out / "curves_1.png").stat().st_size > 1000

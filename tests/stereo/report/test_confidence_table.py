"""Means, curves and calibration of confidences over pairs."""

import numpy as np
import pytest
from icymoon.stereo.measure.confidence_metrics import (
    CALIBRATION_CLASSES,
    list_confidence_columns,
    make_confidence_entries,
)
from icymoon.stereo.measure.metrics import KEPT_SHARES
from icymoon.stereo.report import charts
from icymoon.stereo.report.confidence_table import CONFIDENCE_COLUMNS, ConfidenceTable, list_confidence_rows

RANDOM = np.random.default_rng(1)


def make_row(error_px, confidence):
    return make_confidence_entries(10 + error_px, np.full(error_px.shape, 10.0), {"own": confidence})


def test_pairs_count_alike_in_means_and_pixels_in_the_calibration():
    table = ConfidenceTable(2, 3)
    errors = [RANDOM.exponential(1.0, size) for size in (400, 100)]
    rows = [make_row(error, np.exp(-error) * RANDOM.random(error.size)) for error in errors]
    for pair, row in enumerate(rows):
        table.add(1, pair, row)
    table.add(1, 2, {})  # a row of an older version
    assert table.summarise(0, np.ones(3, bool), np.arange(3)) == {}
    (found,) = table.summarise(1, np.ones(3, bool), np.arange(3)).values()
    assert found["ause"]["mean"] == pytest.approx(np.mean([row["confidence"]["own"]["ause"] for row in rows]))
    assert found["ause"]["pairs"] == 2
    assert found["ause"]["interval"] is None  # there are too few scenes for a mean that is no share
    assert found["ece"]["interval"][0] < found["ece"]["mean"] < found["ece"]["interval"][1]
    curves = [row["confidence_curves"]["own"] for row in rows]
    np.testing.assert_allclose(found["curve"], np.mean([each["curve"] for each in curves], axis=0))
    assert found["curve"][-1] == pytest.approx(found["best"][-1])
    assert len(found["best"]) == len(KEPT_SHARES)
    assert sum(found["calibration"]["n"]) == 500
    assert len(found["calibration"]["n"]) == CALIBRATION_CLASSES


def test_a_pair_without_a_measurement_is_in_no_mean_and_no_curve():
    table = ConfidenceTable(1, 1)
    table.add(0, 0, make_row(np.zeros(0), np.zeros(0)))
    found = table.summarise(0, np.ones(1, bool), np.zeros(1, int))["own"]
    assert (found["ause"]["mean"], found["ause"]["pairs"], found["curve"]) == (None, 0, [])


def test_columns_are_those_of_the_measures_in_the_order_of_the_table():
    assert make_confidence_entries(np.ones(3), np.ones(3), {}) == {}
    assert list_confidence_columns({"sweep", "own"})[::4] == ["own_ause", "sweep_ause"]
    assert {f"own_{column.key}" for column in CONFIDENCE_COLUMNS} == set(list_confidence_columns({"own"}))


def test_each_measure_has_a_line_of_its_own_in_both_charts():
    table = ConfidenceTable(1, 1)
    error = RANDOM.exponential(1.0, 9000)
    table.add(
        0, 0, make_confidence_entries(10 + error, np.full(9000, 10.0), {"own": np.exp(-error), "sweep": error < 1})
    )
    summary = [{"method": "bm", "confidence": table.summarise(0, np.ones(1, bool), np.zeros(1, int))}]
    assert [name for _, name, _ in list_confidence_rows(summary)] == ["own", "plane sweep"]
    drawn = charts._draw_confidence(summary)
    assert ["Calibration" in svg for svg in drawn] == [False, True]
    assert all("stroke-dasharray" in svg for svg in drawn)
    assert charts._draw_confidence([{"method": "bm", "confidence": {}}]) == []

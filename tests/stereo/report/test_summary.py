"""Comparisons of methods from the numbers of their rows: pixels, scenes, ranks and what they allow to be said."""

import re

import numpy as np
import pytest
from icymoon.stereo.measure import common_pixels
from icymoon.stereo.measure.row_metrics import NUMBERS
from icymoon.stereo.report.schema import Comparison
from icymoon.stereo.report.summary import ResultTable, compare_methods, summarise_method
from icymoon.stereo.report.verdict_text import describe_typical, describe_verdicts

pytestmark = pytest.mark.filterwarnings("error")


def table_of(scenes, factors, coverage=None, pairs=2):
    """Methods whose errors on common pixels are ``factors`` times those of the scene, with a little noise."""
    random = np.random.default_rng(0)
    hard = np.exp(random.normal(0, 1.0, scenes)).repeat(pairs)
    labels = [f"m{k}" for k in range(len(factors))]
    table = ResultTable(labels, [f"p{k}" for k in range(scenes * pairs)])
    table.scenes[:] = np.arange(scenes).repeat(pairs)
    table.counts[:] = True
    table.values[:, :, NUMBERS.index("n")] = 100
    table.values[:, :, NUMBERS.index("seconds")] = 1.0
    for k, factor in enumerate(factors):
        own = factor * hard * np.exp(random.normal(0, 0.05, len(hard)))
        table.common[k, :, :, common_pixels.NUMBERS.index("epe_px")] = own
        table.values[k, :, NUMBERS.index("coverage")] = 0.9 if coverage is None else coverage[k]
        table.values[k, :, NUMBERS.index("total_bad_1")] = np.clip(0.02 * own, 0, 1)
    return table


def by_metric(found, metric):
    return {(entry["a"], entry["b"]): entry for entry in found if entry["metric"] == metric}


def test_errors_are_compared_by_their_ratio_and_rates_by_their_difference():
    found, ranks = compare_methods(table_of(8, [1.0, 1.5]), 0)
    epe, wrong = by_metric(found, "common_epe_px")["m0", "m1"], by_metric(found, "total_bad_1")["m0", "m1"]
    assert epe["typical"] == pytest.approx(1 / 1.5, rel=0.1)
    assert epe["typical_low"] < epe["typical"] < epe["typical_high"] < 1
    assert epe["value"] == pytest.approx(1 / 1.5, rel=0.1)
    assert (epe["low"], epe["high"], epe["scenes_needed"]) == (None, None, 6)  # of the mean, which needs more scenes
    assert (epe["kind"], epe["better"], epe["scenes"], epe["pairs"]) == ("ratio", "m0", 8, 16)
    assert wrong["kind"] == "difference"
    assert wrong["typical"] < 0
    assert ranks[0]["common_epe_px"] == (1, 1)
    assert ranks[1]["common_epe_px"] == (2, 2)


def test_more_coverage_is_better_and_equal_times_are_not_different():
    found, ranks = compare_methods(table_of(8, [1.0, 1.0], coverage=[0.4, 0.9]), 0)
    assert by_metric(found, "coverage")["m0", "m1"]["better"] == "m1"
    assert by_metric(found, "seconds")["m0", "m1"]["better"] is None
    assert ranks[1]["coverage"] == (1, 1)
    assert ranks[0]["seconds"] == (1, 2)


def test_a_method_without_a_result_stays_outside():
    table = table_of(8, [1.0, 1.5, 2.0])
    found, ranks = compare_methods(table, 0)
    table.values[1, :, NUMBERS.index("n")] = 0
    table.common[1], table.common[:, 1] = np.nan, np.nan
    without, fewer = compare_methods(table, 0)
    assert {(entry["a"], entry["b"]) for entry in without} == {("m0", "m2")}
    assert fewer[1] == {}
    assert fewer[2]["common_epe_px"] == (2, 2)
    assert ranks[2]["common_epe_px"] == (3, 3)
    assert by_metric(without, "common_epe_px")["m0", "m2"]["typical"] == pytest.approx(
        by_metric(found, "common_epe_px")["m0", "m2"]["typical"]
    )


def test_an_error_of_zero_is_no_failure():
    table = table_of(7, [0.0, 1.0])
    entry = by_metric(compare_methods(table, 0)[0], "common_epe_px")["m0", "m1"]
    assert 0 < entry["typical"] < 1e-4
    assert entry["better"] == "m0"


@pytest.mark.parametrize(
    ("scenes", "words"),
    [
        (1, "One scene: no intervals and no verdicts. A verdict on 3 methods takes 8 scenes."),
        (7, "7 scenes: no verdicts. A verdict on 3 methods takes 8 scenes."),
        (8, "About 5 %"),
    ],
)
def test_what_scenes_allow_is_said(scenes, words):
    table = table_of(scenes, [1.0, 1.3, 1.6])
    found, ranks = compare_methods(table, 0)
    text = describe_verdicts(found, table)
    assert words in text
    assert ("EPE" in text) == (scenes == 8)
    assert ("total_bad_1" in ranks[0]) == (scenes == 8)
    entry = by_metric(found, "common_epe_px")["m0", "m2"]
    assert (entry["typical_low"] is None) == (scenes < 8)
    assert (entry["better"] is None) == (scenes < 8)
    assert entry["scenes_needed"] == 8


def test_methods_that_differ_by_rounding_have_no_verdict():
    table = table_of(12, [1.0, 1.0])
    place = common_pixels.NUMBERS.index("epe_px")
    table.common[1, :, :, place] = table.common[0, :, :, place] * (1 + 1e-14)
    table.values[1] = table.values[0] * (1 + 1e-14)
    found, _ = compare_methods(table, 0)
    assert not [entry for entry in found if entry["better"]]
    assert by_metric(found, "common_epe_px")["m0", "m1"]["typical"] == 1.0


def test_means_have_intervals_where_scenes_are_many():
    entry = by_metric(compare_methods(table_of(24, [1.0, 1.5]), 0, with_means=True)[0], "total_bad_1")["m0", "m1"]
    assert entry["low"] < entry["value"] < entry["high"] < 0
    assert set(entry) == set(Comparison.__annotations__)


def test_the_typical_difference_is_said_from_the_worse_method():
    found, _ = compare_methods(table_of(8, [1.0, 1.5]), 0)
    (sentence,) = describe_typical(found)
    assert re.fullmatch(
        r"In the typical scene m1 has \d\.\d points more wrong or missing pixels than m0 "
        r"\(0\.\d to \d\.\d\)\.",
        sentence,
    )
    assert describe_typical(compare_methods(table_of(5, [1.0, 1.5]), 0)[0]) == []
    (equal,) = describe_typical(compare_methods(table_of(8, [1.0, 1.0]), 0)[0])
    assert "so either may be better" in equal


def test_one_method_is_compared_with_none():
    table = table_of(8, [1.0])
    assert compare_methods(table, 0) == ([], [{}])
    assert describe_verdicts([], table) == ""


def test_the_interval_of_a_share_stays_within_none_and_all():
    table = table_of(3, [1.0], coverage=[0.9])
    table.values[0, :, NUMBERS.index("coverage")] = np.repeat([0.99, 0.6, 0.99], 2)
    table.values[0, :, NUMBERS.index("total_bad_1")] = np.repeat([0.01, 0.4, 0.01], 2)
    found = summarise_method(table, 0)["intervals"]
    assert 0.1 < found["coverage"][0] < 0.86 < found["coverage"][1] <= 1
    assert 0 <= found["total_bad_1"][0] < 0.14 < found["total_bad_1"][1] < 0.9
    assert "epe_px" not in found  # a mean that is no share, of three scenes

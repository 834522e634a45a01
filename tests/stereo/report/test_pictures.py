"""Which pairs the matrix of pictures shows, how many, and what stands where a method failed."""

import json

import manyrows
import numpy as np
import pairs
import pytest
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.row_metrics import NUMBERS
from icymoon.stereo.report.conditions import Condition
from icymoon.stereo.report.pictures import (
    MAX_IN_MATRIX,
    choose_typical_pairs,
    embed_picture,
    find_typical_pair,
    make_picture_matrix,
)
from icymoon.stereo.report.summary import ResultTable

pytestmark = pytest.mark.filterwarnings("error")


def table_of(errors):
    table = ResultTable([f"m{k}" for k in range(len(errors))], [f"p{k}" for k in range(len(errors[0]))])
    table.values[:, :, NUMBERS.index("total_bad_1")] = errors
    table.scenes[:] = 0
    return table


def test_the_typical_pair_has_the_median_of_the_mean_over_methods():
    random = np.random.default_rng(0)
    for count in (1, 2, 5, 12, 33):
        errors = random.uniform(0, 1, (3, count))
        among = random.uniform(size=count) < 0.7
        among[0] = True
        found = find_typical_pair(table_of(errors), among)
        means = errors.mean(axis=0)
        assert among[found]
        below, above = (among & (means < means[found])).sum(), (among & (means > means[found])).sum()
        assert 0 <= above - below <= 1


def test_pairs_on_which_a_method_failed_are_the_last_choice():
    nan = np.nan
    everywhere = np.ones(4, bool)
    assert find_typical_pair(table_of([[0.1, 0.2, 0.3, 0.4], [nan, nan, nan, 0.9]]), everywhere) == 3
    assert find_typical_pair(table_of([[0.1, 0.2, 0.3, nan], [nan, nan, nan, nan]]), everywhere) == 1
    assert find_typical_pair(table_of([[nan] * 4] * 2), everywhere) is None
    assert find_typical_pair(table_of([[0.1, 0.2, 0.3, 0.4]]), ~everywhere) is None


@pytest.mark.parametrize(("methods", "rows"), [(2, 32), (5, 16), (95, 1), (200, 1)])
def test_the_matrix_is_bounded(methods, rows):
    table = table_of(np.tile(np.linspace(0, 1, 50), (methods, 1)))
    conditions = [Condition(str(k), np.arange(50) == k) for k in range(40)]
    found = choose_typical_pairs(table, conditions)
    assert [(condition.name, pair) for condition, pair in found] == [(str(k), k) for k in range(rows)]
    assert rows == 1 or rows * (1 + methods) <= MAX_IN_MATRIX


def test_all_pairs_are_the_condition_if_nothing_varies_and_one_pair_needs_no_matrix():
    table = table_of([[0.1, 0.5, 0.2]])
    ((condition, pair),) = choose_typical_pairs(table, [])
    assert (condition.name, pair) == ("All pairs", 2)
    table.scenes[2] = -1  # whose facts cannot be read
    assert choose_typical_pairs(table, [])[0][1] == 0
    assert choose_typical_pairs(table_of([[0.1]]), []) == []


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    root = tmp_path_factory.mktemp("matrix")
    manyrows.multiply(
        pairs.write_pair(root / "real", rig=pairs.camera(96, 64)),
        parse_methods("bm,sgbm"),
        4,
        root / "out",
        report=False,
    )
    rows = [json.loads(line) for line in (root / "out" / "results.jsonl").read_text().splitlines()]
    facts = {
        f"pair0000{k}": json.loads((root / "out" / "pairs" / f"pair0000{k}" / "facts.json").read_text())
        for k in range(4)
    }
    return root / "out", rows, facts


@pytest.mark.long
def test_the_pictures_are_those_of_the_pair_and_a_failure_has_none(evaluation):
    out, rows, facts = evaluation
    table = ResultTable(["bm", "sgbm"], list(facts))
    failed = [
        row | {"status": "failed", "images": {}} if row["pair"] == "pair00002" and row["method"] == "bm" else row
        for row in rows
    ]
    (found,) = make_picture_matrix([(Condition("dark", np.ones(4, bool)), 2)], table, facts, failed, out)
    assert (found["name"], found["pair"]) == ("dark", "pair00002")
    assert [(each["row"]["pair"], each["row"]["method"]) for each in found["methods"]] == [
        ("pair00002", "bm"),
        ("pair00002", "sgbm"),
    ]
    assert found["methods"][0]["error"] == ""
    assert found["methods"][1]["error"] == embed_picture(out / rows[5]["images"]["error"], 64)

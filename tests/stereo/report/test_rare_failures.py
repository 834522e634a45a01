"""The sign of methods that fail rarely but heavily: shown where the data contain such failures, and not otherwise."""

import re

import numpy as np
import pytest
from icymoon.stereo.measure.row_metrics import NUMBERS
from icymoon.stereo.report.rare_failures import find_rare_failures
from icymoon.stereo.report.summary import ResultTable, compare_methods
from icymoon.stereo.report.verdict_text import describe_verdicts

pytestmark = pytest.mark.filterwarnings("error")

SCENES, PAIRS = 10, 4


def table_of(errors):
    """A table of rates of wrong or missing pixels (methods, pairs)."""
    table = ResultTable([f"m{k}" for k in range(len(errors))], [str(k) for k in range(errors.shape[1])])
    table.counts[:] = ~np.isnan(errors)
    table.scenes[:] = np.arange(errors.shape[1]) // PAIRS
    table.values[:, :, NUMBERS.index("total_bad_1")] = np.clip(errors, 0, 1)
    table.values[:, :, NUMBERS.index("n")] = np.where(np.isnan(errors), np.nan, 100)
    return table


def ordinary(random, methods):
    """Lognormal errors: of a scene, which methods share, of a method on a scene, and of a pair."""
    shape = methods, SCENES * PAIRS
    return 0.05 * np.exp(
        random.normal(0, 0.5, SCENES).repeat(PAIRS)
        + random.normal(0, 0.4, shape)
        + random.normal(0, 0.3, (methods, SCENES)).repeat(PAIRS, axis=1)
    )


def with_failures(random, failing):
    """Two methods; the second one is better but for these pairs."""
    errors = ordinary(random, 2)
    errors[1] = np.where(failing, 0.9, 0.5 * errors[1])
    return errors


@pytest.mark.parametrize("methods", [2, 4])
def test_ordinary_data_have_no_sign(methods):
    random = np.random.default_rng(methods)
    assert sum(bool(find_rare_failures(table_of(ordinary(random, methods)))) for _ in range(100)) <= 4


def test_one_failure_in_twenty_pairs_is_found_if_the_data_contain_it():
    random = np.random.default_rng(1)
    for _ in range(50):
        failing = np.zeros(SCENES * PAIRS, bool)
        failing[random.choice(len(failing), 2, replace=False)] = True
        errors = with_failures(random, failing)
        (found,) = find_rare_failures(table_of(errors))
        assert (found.method, found.pairs) == ("m1", 40)
        assert found.failing <= 2
        worst = np.sort(np.clip(errors[1], 0, 1))[::-1]
        assert found.share == pytest.approx(worst[: found.failing].sum() / worst.sum())
    assert not find_rare_failures(table_of(with_failures(random, np.zeros(SCENES * PAIRS, bool))))


def test_what_is_hard_for_all_or_fails_often_is_no_rare_failure():
    random = np.random.default_rng(2)
    hard = ordinary(random, 3)
    hard[:, :2] = 0.9  # for all methods
    assert not find_rare_failures(table_of(hard))
    assert not find_rare_failures(table_of(with_failures(random, np.arange(SCENES * PAIRS) % 2 == 0)))
    assert not find_rare_failures(table_of(np.zeros((2, 40))))


def test_a_method_without_a_result_hides_and_shows_nothing():
    errors = with_failures(np.random.default_rng(3), np.arange(SCENES * PAIRS) < 2)
    table = table_of(np.vstack([errors, np.ones((1, SCENES * PAIRS))]))
    table.values[2, :, NUMBERS.index("n")] = 0
    assert [found.method for found in find_rare_failures(table)] == ["m1"]
    alone = table_of(errors[1:])
    assert not find_rare_failures(alone)
    gone = errors.copy()
    gone[0, :2] = np.nan  # the other method has no number where this one fails
    assert not find_rare_failures(table_of(gone))


@pytest.mark.parametrize(("scenes", "said"), [(10, True), (5, False)])
def test_it_is_said_beside_the_verdicts(scenes, said):
    """Where there is no verdict, nothing depends on the failures."""
    errors = with_failures(np.random.default_rng(4), np.arange(SCENES * PAIRS) < 2)
    table = table_of(errors[:, : scenes * PAIRS])
    text = describe_verdicts(compare_methods(table, 0)[0], table)
    assert ("m1 fails rarely but heavily: " in text) == said
    assert "m0 fails" not in text


def test_the_bound_on_failures_that_no_scene_contains_is_said():
    """It is the share of scenes with a failure at which a draw of so many scenes contains none in 5 % of draws."""
    errors = with_failures(np.random.default_rng(4), np.zeros(SCENES * PAIRS, bool))
    table = table_of(errors[:, : 10 * PAIRS])
    text = describe_verdicts(compare_methods(table, 0)[0], table)
    bound = int(re.search("none of the 10 scenes contains may still occur in up to (\\d+) % of scenes", text)[1]) / 100
    without = (np.random.default_rng(5).random((100_000, 10)) >= bound).all(axis=1).mean()
    assert without == pytest.approx(0.05, abs=0.01)

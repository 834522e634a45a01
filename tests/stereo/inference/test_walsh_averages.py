"""Walsh averages: every one of them, in order, with ties and without listing them."""

import numpy as np
import pytest
from icymoon.stereo.inference import walsh_averages
from icymoon.stereo.inference.walsh_averages import WalshSums, round_to_grid

pytestmark = pytest.mark.filterwarnings("error")


def listed(values):
    return sorted(int(values[i] + values[j]) for i in range(len(values)) for j in range(i, len(values)))


@pytest.mark.parametrize("most_listed", [0, 200])
@pytest.mark.parametrize("values", [[5], [-3, 7], [0, 0, 0], [-4, -4, 1, 1, 1, 9], list(range(-40, 90, 7))])
def test_sums_are_counted_and_found_whether_they_are_listed_or_not(values, most_listed, monkeypatch):
    monkeypatch.setattr(walsh_averages, "_MAX_LISTED_VALUES", most_listed)
    monkeypatch.setattr(walsh_averages, "_MAX_LISTED_SUMS", 2)
    sums, wanted = WalshSums(np.array(values)), listed(values)
    assert sums.count == len(wanted)
    assert [sums.at(place) for place in range(len(wanted))] == wanted
    for limit in range(wanted[0] - 1, wanted[-1] + 2):
        assert sums.count_up_to(limit) == sum(each <= limit for each in wanted)
    assert sums.find_twice_median() == round(2 * float(np.median(wanted)))


def test_many_values_are_found_as_few_are():
    values = np.sort(np.random.default_rng(0).integers(-(10**9), 10**9, 700))
    sums, wanted = WalshSums(values), listed(values.tolist())
    for place in (0, 1, 12_345, len(wanted) // 2, len(wanted) - 1):
        assert sums.at(place) == wanted[place]


@pytest.mark.parametrize("scale", [1.0, 3e-7, 1e300, 1e-310])
def test_equal_values_that_differ_by_rounding_are_equal_on_the_grid(scale):
    whole, unit = round_to_grid(scale * np.array([0.3 - 0.2, 0.1, -0.7, 0.1 + 1e-17, 0.0]))
    assert whole[1] == 0
    assert scale < 1e-300 or len(set(whole[2:].tolist())) == 1
    np.testing.assert_allclose(whole * unit, scale * np.array([-0.7, 0, 0.1, 0.1, 0.1]), rtol=1e-9)


def test_nothing_has_a_grid():
    assert round_to_grid(np.zeros(3))[0].tolist() == [0, 0, 0]
    assert len(round_to_grid(np.zeros(0))[0]) == 0

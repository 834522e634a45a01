"""The weights that come with Icy Moon: they run without setup in either library, and beat SGBM on made ground."""

from itertools import islice

import numpy as np
import pytest
from icymoon.stereo.learning.made_pairs import MadePairs
from icymoon.stereo.matchers import match, match_checked
from icymoon.stereo.matchers.icynet import SHIPPED
from icymoon.stereo.matchers.methods import list_default_methods, parse_methods
from icymoon.stereo.measure.metrics import find_wrong_share
from icymoon.support.errors import IcyMoonError

pytest.importorskip("torch")
#: Most bytes of both files together, as the package may carry.
MAX_BYTES = 4e6


@pytest.fixture(scope="module")
def samples():
    """Four pairs of a landform that training never shows: left, right, disparity, valid."""
    made = islice(MadePairs("landform", seed=31).list_ground(0), 4)
    return [(*(np.rint(255 * each[eye][0]).astype(np.uint8) for eye in ("left", "right")), each) for each in made]


def measure_wrong_share(method, left, right, sample, **options):
    """The share of the pixels with a truth that are missing or wrong by more than 1 px."""
    truth, known = sample["disparity_px"], sample["valid"]
    reach = 16 * int(np.ceil((truth[known].max() + 1) / 16))
    found, _, _ = match(method, left, right, {**options, "disparities": reach, "min_disparity": 0})
    return find_wrong_share(found, truth, known)


@pytest.mark.ci_takes(10)
def test_icynet_beats_sgbm_on_a_landform_that_it_never_saw(samples):
    wrong = {method: np.mean([measure_wrong_share(method, *each) for each in samples]) for method in ("sgbm", "icynet")}
    assert wrong["icynet"] < wrong["sgbm"]


def test_both_files_are_of_the_same_training(samples):
    pytest.importorskip("onnxruntime")
    left, right, _ = samples[0]
    found = [
        match("icynet", left, right, {"checkpoint": str(file), "disparities": 64, "min_disparity": 0})
        for file in SHIPPED.values()
    ]
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-3)
    np.testing.assert_allclose(found[0][2]["confidence"], found[1][2]["confidence"], atol=1e-4)
    assert sum(file.stat().st_size for file in SHIPPED.values()) < MAX_BYTES


def test_the_same_pair_gives_the_same_bits(samples):
    left, right, _ = samples[0]
    (method,) = parse_methods("icynet")
    one, two = (match_checked(method.name, left, right, {**method.options, "disparities": 64}) for _ in range(2))
    np.testing.assert_array_equal(one[0], two[0])


def test_it_stands_beside_the_default_methods_where_a_library_runs_it(monkeypatch):
    assert list_default_methods() == "bm,sgbm,icynet"
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert list_default_methods() == "bm,sgbm"
    with pytest.raises(IcyMoonError, match=r"icynet needs ONNX Runtime.*pip install"):
        parse_methods("icynet")

"""Numbers of two methods on the pixels that both measured: those of the metrics on these pixels alone."""

import numpy as np
import pairs
import pytest
from icymoon.stereo.measure.common_pixels import METRICS, NUMBERS, measure_common_pixels
from icymoon.stereo.measure.metrics import compute_depth_metrics, compute_disparity_metrics
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.stereo.measure.row_metrics import disparity_to_depth

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    return prepare_pair(pairs.write_pair(tmp_path_factory.mktemp("p") / "pair", rig=pairs.camera(192, 96)), {})


def noisy(prepared, seed, missing):
    random = np.random.default_rng(seed)
    disparity = prepared.pair.camera.disparity(prepared.truth) + random.normal(0, 1.5, prepared.truth.shape)
    return np.where(random.random(disparity.shape) < missing, np.nan, disparity).astype(np.float32)


def test_they_are_the_metrics_on_these_pixels(prepared):
    one, other = noisy(prepared, 0, 0.3), noisy(prepared, 1, 0.5)
    found = measure_common_pixels(prepared, {"one": one, "other": other})
    for label, disparity in (("one", one), ("other", other)):
        (numbers,) = found[label].values()
        assert set(numbers) == set(NUMBERS)
        for prefix, pixels in (("", True), ("visible_", prepared.visible)):
            truth = np.where((one > 0) & (other > 0) & pixels, prepared.truth, np.nan)
            wanted = compute_depth_metrics(disparity_to_depth(prepared, disparity), truth) | compute_disparity_metrics(
                disparity, prepared.pair.camera.disparity(truth)
            )
            assert numbers[f"{prefix}n"] == wanted["n"] > 1000
            for key in METRICS:
                assert numbers[prefix + key] == pytest.approx(wanted[key], rel=1e-9)


def test_a_method_that_measures_nothing_takes_no_pixels_from_others(prepared):
    one, other = noisy(prepared, 0, 0.3), noisy(prepared, 1, 0.5)
    two = measure_common_pixels(prepared, {"one": one, "other": other})
    three = measure_common_pixels(prepared, {"one": one, "none": np.full_like(one, np.nan), "other": other})
    assert three["one"]["other"] == two["one"]["other"]
    assert three["other"]["one"] == two["other"]["one"]
    assert three["one"]["none"]["n"] == 0
    assert three["none"]["one"]["epe_px"] is None

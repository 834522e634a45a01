"""Disparities, images and scenes at the extremes, through the whole evaluation."""

import hashlib
import json

import numpy as np
import pairs
import pytest
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.common_pixels import measure_common_pixels
from icymoon.stereo.measure.metrics import COSTS
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.stereo.measure.row_metrics import NUMBERS, measure_row_numbers

pytestmark = pytest.mark.filterwarnings("error")

RIG = pairs.camera(192, 96)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    return prepare_pair(pairs.write_pair(tmp_path_factory.mktemp("p") / "pair", rig=RIG), {})


def numbers(prepared, disparity):
    row = measure_row_numbers(prepared, disparity) | {
        "common": measure_common_pixels(prepared, {"a": disparity, "b": disparity})["a"]
    }
    json.dumps(row, allow_nan=False)
    assert set(NUMBERS) - {*COSTS} <= set(row)
    return row


@pytest.mark.parametrize("mark", [0.0, -0.0, -3.0, np.nan, np.inf, -np.inf, -1e38])
def test_whatever_is_no_disparity_is_missing(prepared, mark):
    """Every number is that of a map with NaN there."""
    random = np.random.default_rng(0)
    disparity = prepared.pair.camera.disparity(prepared.truth) + random.normal(0, 0.5, prepared.truth.shape)
    holes = random.random(disparity.shape) < 0.3
    assert numbers(prepared, np.where(holes, mark, disparity)) == numbers(prepared, np.where(holes, np.nan, disparity))


@pytest.mark.parametrize("value", [1e-30, 1e-3, 1e10, 1e30])
def test_absurd_disparities_are_measured_without_a_warning(prepared, value):
    row = numbers(prepared, np.full(prepared.truth.shape, value, np.float32))
    assert row["coverage"] == 1
    assert row["total_bad_1"] == row["bad_3"] == 1
    assert row["si_rmse"] < 1  # a flat map is a scaled one


def test_nothing_measured(prepared):
    row = numbers(prepared, np.full(prepared.truth.shape, np.nan))
    assert (row["n"], row["coverage"], row["total_bad_1"], row["common"]["b"]["n"]) == (0, 0, 1, 0)
    assert row["l1_m"] is row["epe_px"] is row["guiss_l1_m"] is row["total_a50_px"] is row["visible_dod"] is None


@pytest.mark.parametrize("pixels", [1, 2])
def test_hardly_any_pixel_measured(prepared, pixels):
    disparity = np.full(prepared.truth.shape, np.nan)
    disparity.flat[5000 : 5000 + pixels] = prepared.pair.camera.disparity(prepared.truth).flat[5000 : 5000 + pixels]
    row = numbers(prepared, disparity)
    assert (row["n"], row["l1_m"]) == (pixels, pytest.approx(0, abs=1e-12))
    assert row["dod"] == (None if pixels == 1 else 0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "sensor"),
    [
        (pairs.Scene(distance_m=1e-3), {}),
        (pairs.Scene(distance_m=1e9, rock=False), {}),
        (pairs.Scene(contrast=0.0), {"shot_noise": False, "read_noise_e": 0.0}),
        (pairs.Scene(radiance=0.0), {"read_noise_e": 0.0}),
        (pairs.Scene(radiance=1e30), {}),
        (pairs.Scene(radiance=1e-30), {}),
        (pairs.Scene(), {"auto_exposure": False, "exposure_s": 100.0}),
    ],
    ids=["1 mm away", "1e9 m away", "constant", "black", "blinding", "faint", "saturated"],
)
def test_absurd_scenes(tmp_path, scene, sensor):
    pairs.write_pair(tmp_path / "pair", scene, RIG)
    report = evaluate([tmp_path / "pair"], parse_methods("bm,sgbm"), tmp_path / "out", {"sensor": sensor}, guiss=True)
    assert [row["status"] for row in report["rows"]] == ["ok", "ok"]
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 50), (300, 1)])
def test_slivers_of_images(tmp_path, size):
    pairs.write_pair(tmp_path / "pair", pairs.Scene(rock=False), pairs.camera(*size))
    report = evaluate([tmp_path / "pair"], parse_methods("bm,sgbm"), tmp_path / "out")
    assert all(row["status"] == "ok" or "too small" in row["error"] for row in report["rows"])
    prepared = prepare_pair(tmp_path / "pair", {})
    row = numbers(prepared, prepared.pair.camera.disparity(prepared.truth))
    assert row["coverage"] == 1


def test_eyes_of_different_size(tmp_path):
    for name, rig in (("a", RIG), ("b", pairs.camera(160, 96))):
        pairs.write_pair(tmp_path / name, rig=rig)
    (tmp_path / "a" / "right.exr").write_bytes((tmp_path / "b" / "right.exr").read_bytes())
    path = tmp_path / "a" / "pair.json"
    data = json.loads(path.read_text())
    right = (tmp_path / "a" / "right.exr").read_bytes()
    data["files"]["right.exr"] = {"bytes": len(right), "sha256": hashlib.sha256(right).hexdigest()}
    path.write_text(json.dumps(data))
    report = evaluate([tmp_path / "a"], parse_methods("bm"), tmp_path / "out")
    assert "160 x 96 px" in report["failed"][0]["message"]

"""What a variant is said to be off by, on pairs whose error is known because it was put in."""

import json

import numpy as np
import pairs
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.errors import IcyMoonError
from icymoon.render.variants import GROUPS
from icymoon.stereo.methods import parse_methods
from icymoon.stereo.trade import front, measure, number, read_reference
from icymoon.stereo.trade_report import advice, write_trade

METHODS = parse_methods("sgbm,bm")
SCENE = pairs.Scene(contrast=0.4)
RIG = pairs.camera(256, 144)


def folders(root, name, count=2, noise=0.0, scene=SCENE, rig=RIG):
    made = [pairs.write_pair(root / f"{name}{k}", scene, rig, noise=noise) for k in range(count)]
    for k, folder in enumerate(made):
        data = json.loads((folder / "pair.json").read_text())
        data |= {"cpu_seconds": {"before": 1.0, "pair": 2.0 + k}, "seconds": {"build": 0.5, "render": 1.0},
                 "peak_memory_mib": 300.0 + k}
        (folder / "pair.json").write_text(json.dumps(data))
    return made


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    return read_reference(folders(tmp_path_factory.mktemp("truth"), "truth"), METHODS, {})


def test_the_same_images_lose_nothing(truth, tmp_path):
    found = measure(folders(tmp_path, "same", 1), truth, METHODS)
    assert found["bias"] == found["rmse"] == found["depth_px"] == found["depth_m"] == 0
    assert found["noise"] is None
    for method in METHODS:
        assert found["stereo"][method.label]["coverage"] > 0.5
        # Exposed alike, but the camera's noise is another one in every pair.
        assert abs(found["loss"][method.label]["epe_px"]) < 0.03


def test_noise_is_told_from_bias(truth, tmp_path):
    # Radiance times 1 + s N(0, 1) has the noise s rms(L) / mean(L); the standard deviation of an estimate from n
    # pixels and two renders is 1 / sqrt(2 n) of it, for n = 36864 under half a per cent: 3 % is six of them.
    light = truth.light["left"].radiance[..., 0]
    expected = 0.1 * float(np.sqrt(np.mean(light ** 2)) / np.mean(light))
    brighter = pairs.Scene(contrast=0.4, radiance=1.05 * SCENE.radiance)
    found = measure(folders(tmp_path, "noisy", 2, 0.1, brighter), truth, METHODS)
    assert found["noise"] == pytest.approx(1.05 * expected, rel=0.03)
    assert found["bias"] == pytest.approx(0.05, abs=5 * 1.05 * expected / np.sqrt(2 * light.size))
    assert found["structure"] == pytest.approx(0.05 * expected / 0.1, rel=0.1)
    assert found["rmse"] == pytest.approx(np.hypot(found["noise"], found["structure"]), rel=1e-6)
    assert found["loss"]["sgbm"]["epe_px"] > 0.02


def test_the_references_own_noise_is_taken_off(tmp_path):
    noisy = read_reference(folders(tmp_path / "a", "r", 2, 0.1), METHODS, {})
    clean = read_reference(folders(tmp_path / "b", "r", 2), METHODS, {})
    same = folders(tmp_path / "c", "v", 2, 0.1)
    assert noisy.noise == pytest.approx(measure(same, clean, [])["noise"] / np.sqrt(2), rel=0.03)
    assert measure(same, noisy, [])["rmse"] == pytest.approx(measure(same, clean, [])["rmse"], rel=0.03)


def test_another_shape_is_a_depth_error(truth, tmp_path):
    farther = pairs.Scene(contrast=0.4, distance_m=SCENE.distance_m * 1.01)
    found = measure(folders(tmp_path, "far", 1, scene=farther), truth, METHODS)
    disparity = RIG.disparity(truth.depth)
    # Disparity goes with 1 / Z, so all are 1 / 1.01 of what they were, but at the block, which is moved too.
    assert found["depth_px"] == pytest.approx(float(np.nanquantile(disparity, 0.95)) * (1 - 1 / 1.01), rel=0.1)


def test_cost_is_of_the_process(truth, tmp_path):
    found = measure(folders(tmp_path, "cost"), truth, [])
    assert (found["cpu_s"], found["wall_s"], found["memory_mib"]) == (3.5, 1.5, 301.0)
    assert truth.cpu_s == 7.0


def test_what_cannot_be_compared_is_refused(truth, tmp_path):
    with pytest.raises(IcyMoonError, match="another camera"):
        measure(folders(tmp_path, "small", 1, rig=pairs.camera(128, 96)), truth, METHODS)
    with pytest.raises(IcyMoonError, match=r"black.*Sun"):
        read_reference(folders(tmp_path, "black", 1, scene=pairs.Scene(radiance=0.0)), METHODS, {})


@given(st.lists(st.tuples(st.one_of(st.none(), st.floats(0, 10)), st.one_of(st.none(), st.floats(-1, 1))), max_size=20))
def test_a_front_is_what_nothing_beats(points):
    rows = [{"cpu_s": cost, "loss": {"sgbm": {"epe_px": error}}} for cost, error in points]
    path = ("loss", "sgbm", "epe_px")
    found = front(rows, "cpu_s", path)
    known = [k for k, point in enumerate(points) if None not in point]
    for k in known:
        beaten = any(points[j][0] <= points[k][0] and points[j][1] <= points[k][1]
                     and (points[j] != points[k] or j < k) for j in known)
        assert (k in found) != beaten
    costs = [number(rows[k], "cpu_s") for k in found]
    assert costs == sorted(costs)


def row(group, name, cost, loss, bias=0.0):
    stereo = {"coverage": 0.9, "epe_px": 0.2 + loss, "bad_1": 0.01, "wrong_or_missing": 0.11}
    return {"group": group, "name": name, "key": f"{group}: {name}", "cpu_s": cost, "wall_s": cost, "memory_mib": None,
            "bias": bias, "rmse": abs(bias), "noise": None, "structure": None, "depth_px": 0.0, "depth_m": 0.0,
            "changed": {}, "stereo": {"sgbm": stereo}, "loss": {"sgbm": stereo | {"epe_px": loss}}}


ROWS = [row("scene", "as described", 10.0, 0.015), row("samples", "8 samples", 2.0, 0.08),
        row("samples", "16 samples", 4.0, 0.018), row("samples", "256 samples", 80.0, 0.001),
        row("bounces", "0 bounces", 1.0, 0.0, bias=-0.2), row("bounces", "2 bounces", 8.0, 0.015, bias=-0.001)]


def test_advice_names_the_cheapest_that_shows_the_scene():
    words = " ".join(advice(ROWS, ["sgbm"]))
    assert "0.01 px of the reference with “256 samples”" in words
    assert "0.02 px of the reference with “16 samples”, 4.0 CPU seconds a pair (2.5 times less" in words
    assert "0.1 px of the reference with “8 samples”" in words
    assert "0 bounces" not in words  # cheap and good for matchers, but a fifth of the light is missing
    assert "“2 bounces” changes the light by -0.10 % and saves 20 %" in words


def test_the_report_holds_everything(tmp_path):
    reference = {"name": "64 samples", "noise": 0.01, "cpu_s": None, "stereo": {}}
    report = write_trade(ROWS, ["sgbm"], [reference], GROUPS, {"created": "2030-01-01T00:00:00+00:00"}, tmp_path)
    assert report["fronts"]["sgbm"] == ["0 bounces"]
    lines = (tmp_path / "trade.csv").read_text().splitlines()
    assert len(lines) == len(ROWS) + 1
    assert {len(line.split(",")) for line in lines} == {len(lines[0].split(","))}
    assert json.loads((tmp_path / "trade.json").read_text()) == report
    page = (tmp_path / "trade.html").read_text()
    assert all(each["name"] in page for each in ROWS)
    assert "https:" not in page

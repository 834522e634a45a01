"""The losses of variants, on pairs with an error that was put in and so is known."""

import csv
import json
from typing import Any

import numpy as np
import pairs
import pytest
import workspaces
from hypothesis import given
from hypothesis import strategies as st
from icymoon.render.cost.error_tolerance import make_tolerance, parse_fraction
from icymoon.render.cost.quality_variants import GROUPS, list_variants
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.jackknife import jackknife, sum_over_tiles
from icymoon.stereo.trade import measure_variants
from icymoon.stereo.trade.advice import (
    find_distinct_steps,
    find_pareto_fronts,
    make_decision_advice,
    make_fusion_advice,
    make_variant_advice,
)
from icymoon.stereo.trade.quality_losses import find_number, find_pareto_front, measure_variant, read_reference
from icymoon.stereo.trade.report import write_trade
from icymoon.support.errors import IcyMoonError

METHODS = parse_methods("sgbm,bm")
SCENE = pairs.Scene(contrast=0.4)
RIG = pairs.camera(256, 144)
SCENE_OF_DECISIONS = pairs.Scene(contrast=0.4, slope_x=0.0, slope_y=0.0)


def folders(root, name, count=2, noise=0.0, scene=SCENE, rig=RIG):
    made = [pairs.write_pair(root / f"{name}{k}", scene, rig, noise=noise) for k in range(count)]
    for k, folder in enumerate(made):
        data = json.loads((folder / "pair.json").read_text())
        data |= {
            "cpu_seconds": {"before": 1.0, "pair": 2.0 + k},
            "seconds": {"build": 0.5, "render": 1.0},
            "peak_memory_mib": 300.0 + k,
        }
        (folder / "pair.json").write_text(json.dumps(data))
    return made


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    return read_reference(folders(tmp_path_factory.mktemp("truth"), "truth"), METHODS, {})


def test_the_same_images_lose_nothing(truth, tmp_path):
    found = measure_variant(folders(tmp_path, "same", 1), truth, METHODS)
    assert found["bias"] == found["rmse"] == found["depth_px"] == found["depth_m"] == 0
    assert found["noise"] is None
    for method in METHODS:
        assert found["stereo"][method.label]["coverage"] > 0.5
        # Exposed alike, with the same noise of the camera.
        assert found["loss"][method.label]["epe_px"] == found["loss_doubt"][method.label]["epe_px"] == 0


@pytest.mark.parametrize(("area", "images", "bake_s"), [("GROUND", 1, 12.0), ("GROUND", 4, 3.0), ("VIEW", 4, 12.0)])
def test_a_bake_is_shared_by_the_images_of_its_ground_but_not_of_its_view(truth, tmp_path, area, images, bake_s):
    (folder,) = folders(tmp_path, "baked", 1)
    data = json.loads((folder / "pair.json").read_text())
    data["indirect"] = {
        "method": "BAKED",
        "share": 0.2,
        "noise": 0.0,
        "lights": {"Sun": {"cpu_seconds_of_bake": 10.0}, "Planet": {"cpu_seconds_of_bake": 2.0}},
    }
    data["settings"].setdefault("quality", {}).update(indirect="BAKED", bake_area=area)
    (folder / "pair.json").write_text(json.dumps(data))
    assert measure_variant([folder], truth, METHODS, images)["cpu_s"] == pytest.approx(3.0 + bake_s)


def test_a_matcher_with_range_points_is_held_against_the_matcher_alone_without_noise(tmp_path):
    methods, rig = parse_methods("bm,bm+lidar:points=30:rule=fill,lidar:points=30"), pairs.camera(128, 72)
    truth = read_reference(folders(tmp_path / "truth", "truth", 1, rig=rig), methods, {})
    bm, fused, _ = (method.label for method in methods)
    found = measure_variant(folders(tmp_path, "noisy", 1, 0.3, rig=rig), truth, methods)
    assert list(found["fused"]) == [fused]  # points alone replace no matcher
    (own,) = found["fused"].values()
    assert own["plain"] == bm
    for key, worse in (("wrong_or_missing", 1), ("coverage", -1)):
        change = found["stereo"][fused][key] - truth.stereo[bm][key]
        assert own["loss"][key] == pytest.approx(worse * change)
    assert own["loss"]["wrong_or_missing"] < found["loss"][bm]["wrong_or_missing"] - 0.05
    assert 0 < own["doubt"]["wrong_or_missing"] < 0.2


def test_noise_is_separated_from_bias(truth, tmp_path):
    # Radiance times 1 + s N(0, 1) has the noise s rms(L) / mean(L); the standard deviation of an estimate from n
    # pixels and two renders is 1 / sqrt(2 n) of it, for n = 36864 under half a per cent: 3 % is six of them.
    light = truth.light["left"].radiance[..., 0]
    expected = 0.1 * float(np.sqrt(np.mean(light**2)) / np.mean(light))
    brighter = pairs.Scene(contrast=0.4, radiance=1.05 * SCENE.radiance)
    found = measure_variant(folders(tmp_path, "noisy", 2, 0.1, brighter), truth, METHODS)
    assert found["noise"] == pytest.approx(1.05 * expected, rel=0.03)
    assert found["bias"] == pytest.approx(0.05, abs=5 * 1.05 * expected / np.sqrt(2 * light.size))
    assert found["structure"] == pytest.approx(0.05 * expected / 0.1, rel=0.1)
    assert found["rmse"] == pytest.approx(np.hypot(found["noise"], found["structure"]), rel=1e-6)
    assert found["loss"]["sgbm"]["epe_px"] > 0.02


def test_the_noise_of_the_reference_is_subtracted(tmp_path):
    noisy = read_reference(folders(tmp_path / "a", "r", 2, 0.1), METHODS, {})
    clean = read_reference(folders(tmp_path / "b", "r", 2), METHODS, {})
    same = folders(tmp_path / "c", "v", 2, 0.1)
    assert noisy.noise == pytest.approx(measure_variant(same, clean, [])["noise"] / np.sqrt(2), rel=0.03)
    assert measure_variant(same, noisy, [])["rmse"] == pytest.approx(measure_variant(same, clean, [])["rmse"], rel=0.03)


def test_another_shape_is_a_depth_error(truth, tmp_path):
    farther = pairs.Scene(contrast=0.4, distance_m=SCENE.distance_m * 1.01)
    found = measure_variant(folders(tmp_path, "far", 1, scene=farther), truth, METHODS)
    disparity = RIG.disparity(truth.depth)
    # Disparity goes with 1 / Z, so all are 1 / 1.01 of what they were, except at the rock, which is moved too.
    assert found["depth_px"] == pytest.approx(float(np.nanquantile(disparity, 0.95)) * (1 - 1 / 1.01), rel=0.1)


def test_cost_is_of_the_process(truth, tmp_path):
    found = measure_variant(folders(tmp_path, "cost"), truth, [])
    assert (found["cpu_s"], found["wall_s"], found["memory_mib"]) == (3.5, 1.5, 301.0)
    sizes = [file.stat().st_size for file in tmp_path.rglob("*.exr")]
    assert found["megabytes"] == pytest.approx(sum(sizes) / 2e6)
    assert truth.cpu_s == 7.0


def test_full_and_compact_files_of_one_render_have_folders_of_their_own(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(measure_variants, "render_job", lambda job, blender, hear: asked.append(job) or [job.dataset])
    bench = measure_variants.TradeBench(description.defaults(), tmp_path, "", "", 2, 1)
    counter = measure_variants.RenderCounter(bench.on_event, 1)
    compact, full = list_variants(bench.settings, ["files"])
    for variant in (compact, full):
        measure_variants.render_once(variant, 0, bench, counter)
    assert [job.dataset.name for job in asked] == ["data", "data_full"]
    for job in asked:
        job.discard()
    first, second = (expand_headings(variant.settings)[0].id for variant in (compact, full))
    assert first == second


def test_renders_that_cannot_be_compared_are_refused(truth, tmp_path):
    with pytest.raises(IcyMoonError, match="have different cameras"):
        measure_variant(folders(tmp_path, "small", 1, rig=pairs.camera(128, 96)), truth, METHODS)
    with pytest.raises(IcyMoonError, match=r"black.*Sun"):
        read_reference(folders(tmp_path, "black", 1, scene=pairs.Scene(radiance=0.0)), METHODS, {})


@given(st.lists(st.tuples(st.one_of(st.none(), st.floats(0, 10)), st.one_of(st.none(), st.floats(-1, 1))), max_size=20))
def test_a_front_is_what_nothing_beats(points):
    rows = [{"cpu_s": cost, "loss": {"sgbm": {"epe_px": error}}} for cost, error in points]
    path = ("loss", "sgbm", "epe_px")
    found = find_pareto_front(rows, path)
    known = [k for k, point in enumerate(points) if None not in point]
    for k in known:
        beaten = any(
            points[j][0] <= points[k][0] and points[j][1] <= points[k][1] and (points[j] != points[k] or j < k)
            for j in known
        )
        assert (k in found) != beaten
    costs = [find_number(rows[k], "cpu_s") for k in found]
    assert costs == sorted(costs)


def row(group, name, cost, loss, bias=0.0, doubt=0.004):
    stereo = {"coverage": 0.9, "epe_px": 0.2 + loss, "bad_1": 0.01, "wrong_or_missing": 0.11}
    return {
        "group": group,
        "name": name,
        "key": f"{group}: {name}",
        "cpu_s": cost,
        "cpu_range": [cost, 1.01 * cost],
        "wall_s": cost,
        "memory_mib": None,
        "megabytes": 8.0,
        "bias": bias,
        "bias_doubt": 0.0005,
        "rmse": abs(bias),
        "noise": None,
        "structure": None,
        "depth_px": 0.0,
        "depth_m": 0.0,
        "changed": {},
        "stereo": {"sgbm": stereo},
        "loss": {"sgbm": stereo | {"epe_px": loss, "coverage": 0.0}},
        "loss_doubt": {"sgbm": dict.fromkeys(stereo, doubt)},
        "decisions": {},
    }


ROWS = [
    row("scene", "as described", 10.0, 0.015),
    row("samples", "8 samples", 2.0, 0.08),
    row("samples", "16 samples", 4.0, 0.014),
    row("samples", "14 samples", 3.0, 0.018),
    row("samples", "256 samples", 80.0, 0.001),
    row("bounces", "0 bounces", 1.0, 0.0, bias=-0.2),
    row("bounces", "2 bounces", 8.0, 0.015, bias=-0.001),
    row("mesh", "16 px", 1.0, -0.1),
]


def test_advice_names_the_cheapest_that_shows_the_scene():
    words = " ".join(make_variant_advice(ROWS, ["sgbm"]))
    assert "within 0.01 px: “256 samples”" in words
    assert "within 0.02 px: “16 samples”, 4.0 CPU seconds a pair (2.5 times less than as described)" in words
    assert "+0.014 ± 0.004 px; perhaps “14 samples”, 3.0 s, +0.018 ± 0.004 px" in words
    assert "within 0.1 px: “8 samples”" in words
    assert "0 bounces" not in words  # cheap and good for matchers, but a fifth of the light is missing
    assert "“16 px”" not in words.partition("mesh:")[0]  # of another shape
    assert (
        "“2 bounces” changes the light by -0.10 ± 0.05 %, adds no measurable disparity error, and saves 20 %" in words
    )


def fuse(each, loss, doubt=0.01):
    """The row with SGBM and range points, whose share of wrong or missing pixels differs from SGBM's by ``loss``."""
    numbers = {"loss": {"wrong_or_missing": loss}, "doubt": {"wrong_or_missing": doubt}}
    return each | {"fused": {"sgbm+lidar:points=300": {"plain": "sgbm", **numbers}}}


@pytest.mark.parametrize(
    ("losses", "parts"),
    [
        (  # The one without bounces has other light, the mesh another shape.
            (-0.1, -0.002, -0.06, -0.03, -0.2, -0.3, -0.1, -0.3),
            (
                "at most 0 % more pixels wrong or missing: “14 samples”, 3.0 CPU seconds a pair (3.3 times less than "
                "as described), adds -3.0 ± 1.0 %; without the points +11.0 ± 0.4 %.",
                "at most 1 % more pixels wrong or missing: “8 samples”, 2.0 CPU seconds a pair (5.0 times less than "
                "as described), adds -0.2 ± 1.0 %; without the points +11.0 ± 0.4 %.",
            ),
        ),
        (
            (0.005, 0.1, 0.1, 0.1, 0.1, -0.1, 0.1, -0.1),
            (
                "at most 2 % more pixels wrong or missing: “as described”, 10.0 CPU seconds a pair, adds +0.5 ± 1.0 %",
                "noise hides which variants are within 0 % or 0.5 % or 1 %; give a larger scale",
            ),
        ),
        ((0.1, 0.1, 0.1, 0.1, 0.1, -0.1, 0.1, -0.1), ("no variant is within 2 %; give more points or samples.",)),
    ],
)
def test_advice_names_the_cheapest_that_points_make_as_good_as_the_matcher(losses, parts):
    rows = [fuse(each, loss) for each, loss in zip(ROWS, losses, strict=True)]
    lines = make_fusion_advice(rows, ["sgbm", "sgbm+lidar:points=300"])
    assert len(lines) == len(parts)
    for line, part in zip(lines, parts, strict=True):
        assert line.startswith("SGBM + LiDAR points=300 in place of SGBM")
        assert part in line
    assert not make_fusion_advice(ROWS, ["sgbm", "lidar:points=300"])
    assert not make_fusion_advice(ROWS, ["sgbm:window=7", "sgbm+lidar:points=300"])


def test_advice_claims_nothing_within_noise():
    rows = [
        row("scene", "as described", 10.0, 0.015, doubt=0.03),
        row("samples", "8 samples", 9.8, 0.01, doubt=0.03),
        row("bounces", "8 bounces", 9.9, 0.015, doubt=0.03),
        row("samples", "4 samples", 5.0, 0.08, doubt=0.03),
    ]
    words = make_variant_advice(rows, ["sgbm"])
    assert not any("within 0.01 px:" in line or "within 0.02 px:" in line for line in words)
    assert "noise hides here which variants are within 0.01 px or 0.02 px" in " ".join(words)
    # A fiftieth less time is none: the scene as it is described does as well.
    assert words[0].startswith("SGBM, within 0.05 px: “as described”")
    assert words[-1] == "bounces: no variant is cheaper without changing the images; leave it as it is."


def test_advice_for_all_matchers_comes_first():
    rows = [row("scene", "as described", 10.0, 0.004, doubt=0.001), row("samples", "8 samples", 2.0, 0.03)]
    for each, loss in zip(rows, (0.005, 0.07), strict=True):
        for key in ("stereo", "loss", "loss_doubt"):
            each[key]["bm"] = dict(each[key]["sgbm"])
        each["loss"]["bm"]["epe_px"] = loss
    words = make_variant_advice(rows, ["sgbm", "bm"])
    assert words[0].startswith("all matchers, within 0.01 px: “as described”, 10.0 CPU seconds a pair, adds at most")
    assert words[0].endswith("+0.005 ± 0.001 px, of StereoBM.")
    assert "all matchers, within 0.1 px: “8 samples”" in words[1]
    assert "SGBM, within 0.05 px: “8 samples”" in " ".join(words)


def test_advice_reports_fewer_measured_pixels():
    rows = [row("scene", "as described", 10.0, 0.015), row("samples", "2 samples", 1.0, 0.0)]
    for each, fewer in zip(rows, (0.002, 0.4), strict=True):
        each["loss"]["sgbm"]["coverage"] = fewer
    words = " ".join(make_variant_advice(rows, ["sgbm"]))
    assert (
        "“2 samples”, 1.0 CPU seconds a pair (10.0 times less than as described), adds +0.000 ± 0.004 px with "
        "40 % fewer pixels measured" in words
    )
    rows[1]["loss_doubt"]["sgbm"]["coverage"] = 0.5
    assert "fewer" not in " ".join(make_variant_advice(rows, ["sgbm"]))


def test_times_that_vary_separate_fewer_variants():
    steady = [row("scene", "as described", 10.0, 0.0), row("shortcuts", "depth only", 8.0, 0.0)]
    shaky = [each | {"cpu_range": [each["cpu_s"], 1.3 * each["cpu_s"]]} for each in steady]
    words = "depth only” changes the light by +0.00 ± 0.07 % and saves 20 %"
    assert words in " ".join(make_variant_advice(steady, ["sgbm"]))
    assert "takes as long, within 37 %" in " ".join(make_variant_advice(shaky, ["sgbm"]))  # 2 ln 1.3 / √2


def test_the_steps_of_a_front_are_not_noise():
    found = find_pareto_fronts(ROWS, ["sgbm"])["sgbm"]
    assert [each["name"] for each in found] == ["8 samples", "14 samples", "16 samples", "256 samples"]
    assert [each["name"] for each in find_distinct_steps(found, "sgbm")] == ["8 samples", "14 samples", "256 samples"]


@pytest.mark.long
def test_the_report_holds_everything(tmp_path):
    reference: dict[str, Any] = {
        "name": "64 samples",
        "noise": 0.01,
        "cpu_s": None,
        "stereo": {},
        "own": {"sgbm": {"epe_px": 0.02}},
        "undecided": "Nothing is decided.",
        "own_decisions": {},
    }
    report = write_trade(ROWS, ["sgbm"], [reference], GROUPS, {"created": "2030-01-01T00:00:00+00:00"}, tmp_path)
    assert report["fronts"]["sgbm"][-1] == "256 samples"
    lines = (tmp_path / "trade.csv").read_text().splitlines()
    assert len(lines) == len(ROWS) + 1
    assert {len(line.split(",")) for line in lines} == {len(lines[0].split(","))}
    assert json.loads((tmp_path / "trade.json").read_text()) == report
    assert (tmp_path / "trade.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "trade.html").read_text()
    assert all(each["name"] in page for each in ROWS)
    assert "0.018 ± 0.004" in page
    assert "Nothing is decided." in page
    reference |= {"undecided": "", "own_decisions": decided("", 1.0, True)["decisions"]}
    rows = [each | {"decisions": {"sgbm": decided("", 1.0, None)["decisions"]["bm"]}} for each in ROWS]
    fused = "sgbm+lidar:points=300"
    numbers = ("stereo", "loss", "loss_doubt", "decisions")
    rows = [fuse(each, -0.25) | {key: each[key] | {fused: each[key]["sgbm"]} for key in numbers} for each in rows]
    write_trade(rows, ["sgbm", fused], [reference], GROUPS, {"created": "2030-01-01T00:00:00+00:00"}, tmp_path)
    table = list(csv.DictReader((tmp_path / "trade.csv").read_text().splitlines()))
    assert {each[f"{fused} in place of the matcher alone"] for each in table} == {"-0.25"}
    page = (tmp_path / "trade.html").read_text()
    assert "Range points in place of samples" in page
    assert "noise leaves open" in page
    assert "± 1.0" in page
    assert "https:" not in page


@pytest.mark.long
@pytest.mark.parametrize("noise", [0.04, 0.08])
def test_the_noise_of_the_reference_is_subtracted_from_losses(noise, tmp_path):
    """Against a reference as noisy as itself a variant seems to lose nothing; against a clean one it does."""
    noisy = read_reference(folders(tmp_path / "a", "r", 2, noise), METHODS[:1], {})
    clean = read_reference(folders(tmp_path / "b", "r", 2), METHODS[:1], {})
    variant = folders(tmp_path / "c", "v", 1, noise / np.sqrt(2))
    seen, true = (measure_variant(variant, best, METHODS[:1])["loss"]["sgbm"]["epe_px"] for best in (noisy, clean))
    doubt = measure_variant(variant, noisy, METHODS[:1])["loss_doubt"]["sgbm"]["epe_px"]
    assert clean.own["sgbm"]["epe_px"] == 0
    naive = seen - noisy.own["sgbm"]["epe_px"]
    assert abs(seen - true) < abs(naive - true)
    assert abs(seen - true) < doubt


@pytest.mark.long
def test_the_stated_doubt_is_the_spread_that_noise_causes(truth, tmp_path):
    """The doubt of a single render against how renders of other noise differ."""
    found = [measure_variant([folder], truth, METHODS[:1]) for folder in folders(tmp_path, "n", 12, 0.1)]
    losses = [each["loss"]["sgbm"]["epe_px"] for each in found]
    doubt = float(np.mean([each["loss_doubt"]["sgbm"]["epe_px"] for each in found]))
    # A standard deviation of 12 is within 0.63 and 1.5 of the true one in 19 of 20 cases (chi-square); the doubt is of
    # two, and holds what tiles differ by too.
    assert doubt > 2 * float(np.std(losses, ddof=1)) / 1.5
    assert doubt < 4 * 2 * float(np.std(losses, ddof=1)) / 0.63
    biases = [each["bias"] for each in found]
    assert float(np.mean([each["bias_doubt"] for each in found])) == pytest.approx(2 * np.std(biases, ddof=1), rel=0.7)


def test_numbers_are_those_of_the_metrics(truth):
    from icymoon.stereo.measure.metrics import compute_disparity_metrics
    from icymoon.stereo.trade.quality_losses import compute_stereo_numbers, tally_errors

    random = np.random.default_rng(1)
    true = np.where(random.random((37, 53)) < 0.2, np.nan, 20.0)
    disparity = np.where(random.random(true.shape) < 0.3, np.nan, 20.0 + random.normal(0, 1, true.shape))
    coverage, epe, bad, wrong = compute_stereo_numbers(tally_errors(disparity, true).sum(axis=0))
    expected = compute_disparity_metrics(disparity, true)
    assert (epe, bad) == pytest.approx((expected["epe_px"], expected["bad_1"]))
    assert coverage == pytest.approx(np.mean(np.isfinite(disparity[np.isfinite(true)])))
    assert wrong == pytest.approx(1 - coverage * (1 - bad))


def test_a_jackknife_of_a_mean_is_its_standard_error():
    """Of tiles of one size, the standard error of the mean of their means (Efron and Tibshirani 1993, eq. 11.5)."""
    image = np.random.default_rng(2).normal(3.0, 1.0, (60, 80))
    mean, error = jackknife(lambda sums: sums[..., :1] / sums[..., 1:], sum_over_tiles(image, np.ones_like(image)))
    tiles = image.reshape(6, 10, 8, 10).mean(axis=(1, 3)).ravel()
    assert mean[0] == pytest.approx(image.mean())
    assert error[0] == pytest.approx(tiles.std(ddof=1) / np.sqrt(tiles.size))


@pytest.mark.parametrize(
    ("loss", "doubt", "verdict"),
    [
        (0.01, 0.005, True),
        (0.015, 0.01, None),
        (0.025, 0.01, None),
        (0.04, 0.01, False),
        (-0.1, 0.05, True),
        (None, None, False),
        (0.01, None, None),
    ],
)
def test_a_tolerance_is_kept_only_if_noise_cannot_have_done_it(loss, doubt, verdict):
    numbers = {"epe_px": loss, "wrong_or_missing": 0.0}
    assert make_tolerance(0.02, None).allows(numbers, {"epe_px": doubt, "wrong_or_missing": 0.0}) is verdict
    assert make_tolerance(None, 0.01).allows(numbers, {"epe_px": doubt, "wrong_or_missing": 0.001}) is True


@pytest.mark.parametrize("given_px", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_an_impossible_tolerance_is_refused(given_px):
    with pytest.raises(IcyMoonError, match=r"give 0.0001 to 10 px"):
        make_tolerance(given_px, None)
    with pytest.raises(IcyMoonError, match=r"give 0.001 % to 50 %"):
        make_tolerance(None, given_px)


def test_a_share_is_given_as_one_or_in_per_cent():
    assert parse_fraction("0.5%") == parse_fraction("0.005") == make_tolerance(None, 0.005).wrong_or_missing
    assert make_tolerance(None, None).limits == {"epe_px": 0.02}
    assert str(make_tolerance(0.02, 0.005)) == "0.02 px and 0.5 % bad-1"


def test_the_same_images_decide_the_same_and_noise_does_not(tmp_path):
    made = [workspaces.write(tmp_path / name, SCENE_OF_DECISIONS) for name in ("a", "b", "c")]
    reference = read_reference(made[:2], METHODS, {}, read_rules())
    same = measure_variant(made[2:], reference, METHODS)["decisions"]["bm"]
    assert same["otherwise"] == same["unsafe"] == same["shift_m"] == same["otherwise_doubt"] == 0
    assert same["same"] is True
    assert 0 < same["taken"] <= 1
    assert reference.own_decisions["bm"]["same"] is True
    noisy = workspaces.write(tmp_path / "noisy", SCENE_OF_DECISIONS, noise=0.5)
    other = measure_variant([noisy], reference, METHODS)["decisions"]["bm"]
    assert other["otherwise"] > 0
    assert other["same"] is not True


def test_where_nothing_can_be_decided_there_is_a_sentence(tmp_path):
    reference = read_reference(folders(tmp_path, "r"), METHODS, {}, read_rules())
    assert "place of its camera" in str(reference.deciding)
    found = measure_variant(folders(tmp_path, "v"), reference, METHODS)
    row = {"group": "scene", "name": "as described", "key": "scene", **found}
    assert row["decisions"] == {}
    stated = {"undecided": reference.deciding, "own_decisions": {}}
    assert make_decision_advice([row], ["bm"], [stated]) == [reference.deciding]


def decided(name: str, cpu_s: float, same: bool | None, taken: float = 0.1) -> dict[str, Any]:
    return {
        "group": "samples",
        "name": name,
        "key": name,
        "cpu_s": cpu_s,
        "cpu_range": [cpu_s, cpu_s],
        "decisions": {
            "bm": {
                "same": same,
                "otherwise": 0.01,
                "otherwise_doubt": 0.01,
                "unsafe": 0.0,
                "unsafe_doubt": 0.0,
                "shift_m": 0.1,
                "regret": 0.0,
                "taken": taken,
            }
        },
    }


def test_the_advice_is_the_cheapest_variant_with_the_same_decisions():
    rows = [
        {**decided("as described", 9.0, True), "group": "scene"},
        decided("few", 1.0, False),
        decided("some", 3.0, True),
        decided("many", 5.0, True),
    ]
    reference: dict[str, Any] = {"undecided": "", "own_decisions": {"bm": {"same": True}}}
    (line,) = make_decision_advice(rows, ["bm"], [reference])
    assert "“some”, 3.0 CPU seconds a pair (3.0 times less" in line
    assert "1.0 ± 1.0 % of the cells otherwise" in line
    assert "tells little" not in line
    (line,) = make_decision_advice([{**decided("as described", 9.0, True, 0.0), "group": "scene"}], ["bm"], [reference])
    assert "but StereoBM found no safe site on the reference" in line
    alone = [rows[1], {**rows[1], "group": "scene"}]
    assert "no variant" in make_decision_advice(alone, ["bm"], [reference])[0]
    reference["own_decisions"]["bm"]["same"] = False
    assert "noise leaves open" in make_decision_advice(alone, ["bm"], [reference])[0]

"""Methods with range points: their spelling, their results in an evaluation, and their mistakes in one sentence."""

from types import SimpleNamespace

import numpy as np
import pairs
import pytest
from icymoon.settings.topics.trust_boundary import find_text_fault, list_own_names, split_lidar
from icymoon.stereo.fusion.fuse import list_lidar_inputs, match_method
from icymoon.stereo.fusion_curves import PointSweep, encode_curves, find_crossover, list_curves
from icymoon.stereo.matchers.methods import describe_method, parse_methods
from icymoon.support.errors import IcyMoonError

CAMERA = pairs.camera(96, 64)
PAIR = SimpleNamespace(name="one", camera=CAMERA, rectified_pose=lambda eye: None)


@pytest.fixture(scope="module")
def scene():
    """Both images, uint8, and the true depth of the left one."""
    views = {eye: pairs.view(pairs.Scene(), CAMERA, eye) for eye in ("left", "right")}
    left, right = (np.clip(40 * views[eye][1], 0, 255).astype(np.uint8) for eye in ("left", "right"))
    return left, right, views["left"][0]


def run(text, scene, own=()):
    (method,) = parse_methods(text, own=own)
    left, right, truth = scene
    return match_method(method, left, right, CAMERA, {}, PAIR, truth)


def count_wrong(disparity, truth):
    return float(np.mean(~(np.abs(disparity - CAMERA.disparity(truth)) <= 1)))


@pytest.mark.parametrize(
    ("label", "parts", "title"),
    [
        ("sgbm:window=7", ("sgbm:window=7", None), "SGBM window=7"),
        ("lidar", ("", ""), "LiDAR"),
        ("lidar:points=9", ("", "points=9"), "LiDAR points=9"),
        ("sgbm+lidar", ("sgbm", ""), "SGBM + LiDAR"),
        ("sgbm:window=7+lidar:points=9", ("sgbm:window=7", "points=9"), "SGBM window=7 + LiDAR points=9"),
        ("lidar:returns=out/a/b/:points=9", ("", "returns=out/a/b/:points=9"), "LiDAR scan=b points=9"),
        ("lidar:returns=D:\\a\\b", ("", "returns=D:\\a\\b"), "LiDAR scan=b"),
        ("own:lidars", ("own:lidars", None), "own:lidars"),
        ("lidar2", ("lidar2", None), "lidar2"),
    ],
)
def test_a_method_is_split_once_for_all_readers(label, parts, title):
    assert split_lidar(label) == parts
    assert describe_method(label) == title


def test_a_method_has_typed_options_and_its_matchers_ones():
    plain, fused, net = parse_methods(
        "lidar,sgbm:window=7+lidar:points=50:rule=fill,net+lidar:points=60",
        named=("net=bm:window=21",),
    )[:3]
    assert (plain.name, plain.options, plain.lidar["points"], "rule" in plain.lidar) == ("lidar", {}, 1000, False)
    assert (fused.name, fused.options["window"], fused.lidar["points"]) == ("sgbm", 7, 50)
    assert (fused.lidar["rule"], fused.lidar["guide"], fused.lidar["noise_cm"]) == ("fill", "none", 2.0)
    assert (net.name, net.options["window"], net.lidar["points"]) == ("bm", 21, 60)
    assert list_lidar_inputs(fused, "one") == [fused.lidar]
    assert list_lidar_inputs(parse_methods("bm")[0], "one") == []


def test_an_own_matcher_takes_points_and_a_scene_names_no_folder():
    (method,) = parse_methods("own:mine+lidar:points=50", own=("mine:bm:window=21",))
    assert (method.label, method.name, method.options["window"]) == ("own:mine+lidar:points=50", "bm", 21)
    assert list_own_names("own:mine+lidar:points=50,bm") == ["mine"]
    assert "names a returns, which only you may" in find_text_fault("matchers", "sgbm+lidar:returns=/tmp")
    assert not find_text_fault("matchers", "sgbm+lidar:points=100")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("lidar:points=2", "lidar.points is '2', outside 3 to 1000000|lidar.points is 2, outside 3 to 1000000"),
        ("lidar:points=many", "lidar.points must be a whole number, not"),
        ("lidar:rule=fill", r"Unknown option lidar\.rule"),
        ("sgbm+lidar:noise_cm=-1", "lidar.noise_cm is .*, outside 0.0 to 1000.0"),
        ("sgbm+lidar:rule=best", "lidar.rule is"),
        ("sgbn+lidar", "Unknown matcher 'sgbn'"),
        ("lidar,lidar", "names lidar twice"),
    ],
)
def test_a_mistake_is_one_sentence(text, why):
    with pytest.raises(IcyMoonError, match=why):
        parse_methods(text)


def test_the_interpolation_alone_is_dense_and_exact_on_a_plane(scene):
    left, right, _ = scene
    x, y = (np.arange(96) + 0.5 - CAMERA.cx_px)[None, :], (np.arange(64) + 0.5 - CAMERA.cy_px)[:, None]
    truth = 3 / (1 + (0.2 * x + 0.5 * y) / CAMERA.focal_px)
    found, info = run("lidar:points=10:noise_cm=0", (left, right, truth))
    np.testing.assert_allclose(found, CAMERA.disparity(truth), atol=1e-4)  # single precision
    assert info["facts"] == {"range_points": 10}
    assert info["options"]["lidar.points"] == 10
    assert info["seconds"] >= 0


@pytest.mark.parametrize("guide", ["none", "paint", "search"])
@pytest.mark.parametrize("rule", ["fill", "pick"])
def test_points_leave_no_hole_and_no_more_errors_than_stereo(scene, guide, rule):
    truth = scene[2]
    stereo = run("sgbm:disparities=48", scene)[0]
    found, info = run(f"sgbm:disparities=48+lidar:points=60:rule={rule}:guide={guide}", scene)
    assert np.isfinite(found).all()
    assert count_wrong(found, truth) <= count_wrong(stereo, truth)
    assert found.dtype == np.float32
    assert info["method"] == "sgbm"


def test_the_matcher_alone_is_unchanged_and_a_seed_is_a_result(scene):
    stereo, _ = run("sgbm:disparities=48", scene)
    same, _ = run("sgbm:disparities=48+lidar:points=60:rule=stereo", scene)
    np.testing.assert_array_equal(stereo, same)
    once, again, other = (run(f"bm+lidar:points=60:guide=paint:seed={seed}", scene)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once, other)


def test_a_search_near_points_replaces_a_stated_range(scene):
    # Matches lie about the margin of 16 px, which 16 disparities from 0 on do not contain.
    found, _ = run("sgbm:disparities=16+lidar:points=200:guide=search:rule=stereo", scene)
    assert np.isfinite(found).mean() > 0.5
    assert count_wrong(found, scene[2]) < 0.5


def test_a_matcher_without_a_range_cannot_search_near_points(scene):
    with pytest.raises(IcyMoonError, match="has no search range that points could limit"):
        run("own:mine+lidar:guide=search", scene, own=("mine:external:command=true {left} {right} {out}",))


def test_a_sweep_has_each_combination_once():
    sgbm = parse_methods("sgbm:window=7")
    sweep = PointSweep([100, 1000], [2.0, 5.0], [0.0], [("pick", "none"), ("fill", "paint")], {"seed": "0"})
    labels = [method.label for method in sweep.list_methods(sgbm)]
    assert labels[:4] == [
        "sgbm:window=7",
        "lidar:points=100",
        "sgbm:window=7+lidar:points=100",
        "sgbm:window=7+lidar:points=100:rule=fill:guide=paint",
    ]
    assert labels[4] == "lidar:points=100:noise_cm=5"
    assert len(set(labels)) == len(labels) == 13
    assert [method.label for method in parse_methods(",".join(labels))] == labels
    with pytest.raises(IcyMoonError, match="is stated twice"):
        PointSweep([100, 100], [2.0], [0.0], [("pick", "none")], {}).list_methods(sgbm)


def test_the_crossover_is_from_where_on_the_interpolation_stays_better():
    methods = PointSweep([10, 30, 100, 300], [2.0], [0.0], [("pick", "none")], {}).list_methods(parse_methods("sgbm"))
    shares = {"sgbm": 0.2, "lidar:points=10": 0.1, "lidar:points=30": 0.3, "lidar:points=100": 0.15}
    rows = [
        {
            "pair": "one",
            "method": method.label,
            "status": "ok",
            "total_bad_1": shares.get(method.label, 0.05),
            "total_l1_rate_10": 0.5 if method.name == "lidar" else 0.4,
            "seconds": 0.1,
        }
        for method in methods
    ]
    curves = list_curves([*rows, {"pair": "two", "method": "sgbm", "status": "failed"}], methods)
    assert find_crossover(curves, "one", "sgbm", "bad_1") == 100
    assert find_crossover(curves, "one", "sgbm", "over_10_cm") is None
    assert encode_curves(curves).splitlines()[1] == "one,sgbm,0,0.0,0.0,sgbm,0.2,0.4,0.1"

"""The measured surface in world axes, and the PLY file that brings it into Blender."""

import json
from contextlib import suppress

import numpy as np
import pairs
import pytest
from icymoon.formats import ply
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.export.points import MAX_POINTS, make_measured_points, write_points
from icymoon.stereo.images.colours import colour_signed_errors
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

#: Looking along world +y from (1, 2, 3), x to the right, down is -z.
POSE = [[1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 2.0], [0.0, -1.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0]]


def with_pose(folder, pose=None):
    """A pair whose left eye has this pose, or a right one, with the right eye beside it."""
    path = folder / "pair.json"
    data = json.loads(path.read_text())
    right = np.array(POSE)
    right[:3, 3] += right[:3, 0] * data["camera"]["baseline_m"]
    poses = {"left": POSE if pose is None else pose, "right": right.tolist()}
    path.write_text(json.dumps(data | {"poses_camera_to_world": poses, "edited_by_hand": True}))
    return folder


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    return prepare_pair(with_pose(pairs.write_pair(tmp_path_factory.mktemp("p") / "pair", pairs.Scene(rock=False))), {})


def test_true_disparities_lie_on_the_true_plane(prepared):
    points = make_measured_points(prepared, prepared.pair.camera.disparity(prepared.truth))
    scene = pairs.Scene()
    x, y, z = (points[axis].astype(float) for axis in "xyz")
    right, down, ahead = x - 1, 3 - z, y - 2  # the camera's axes
    np.testing.assert_allclose(ahead + scene.slope_x * right + scene.slope_y * down, scene.distance_m, atol=1e-5)
    assert abs(points["error_m"]).max() < 1e-9
    assert (points["red"] == 0xF4).all()
    toward = np.stack([points["nx"], points["ny"], points["nz"]], axis=1)
    np.testing.assert_allclose(np.linalg.norm(toward, axis=1), 1, atol=1e-6)
    ray = np.stack([x - 1, y - 2, z - 3], axis=1)
    np.testing.assert_allclose(np.sum(toward * ray, axis=1), -np.linalg.norm(ray, axis=1), rtol=1e-5)
    np.testing.assert_allclose(points["size_m"], ahead / prepared.pair.camera.focal_px, rtol=1e-6)


def test_a_surface_too_far_is_red_and_its_error_positive(prepared):
    true = prepared.pair.camera.disparity(prepared.truth)
    far, near = make_measured_points(prepared, true * 0.8), make_measured_points(prepared, true * 1.2)
    assert (far["error_m"] > 0).all()
    assert (far["red"] > far["blue"]).all()
    assert (near["error_m"] < 0).all()
    assert (near["blue"] > near["red"]).all()


def test_colours_of_errors():
    colours = colour_signed_errors(np.array([0.0, 0.005, -0.005, 0.1, -0.1, 1.0, -50.0, np.nan])).tolist()
    assert colours[0] == colours[1] == colours[2] == [0xF4] * 3
    assert colours[5] == [0xC4, 0x2B, 0x2B]
    assert colours[6] == [0x2B, 0x5F, 0xC4]
    assert colours[7] == [0x96] * 3
    assert colours[3][1] > colours[5][1]  # 10 cm is paler than 1 m


def test_missing_measurements_are_no_points_and_points_without_truth_are_grey(prepared):
    disparity = np.full(prepared.truth.shape, np.nan)
    assert len(make_measured_points(prepared, disparity)) == 0
    disparity[3, 5] = 20.0
    prepared.truth[3, 5], kept = np.nan, prepared.truth[3, 5]
    (point,) = make_measured_points(prepared, disparity)
    prepared.truth[3, 5] = kept
    assert np.isnan(point["error_m"])
    assert point["red"] == point["green"] == 0x96


def test_the_file_holds_the_points(prepared, tmp_path):
    disparity = prepared.pair.camera.disparity(prepared.truth) * 1.1
    write_points(tmp_path / "p.ply", prepared, disparity)
    points = make_measured_points(prepared, disparity)
    for names in (("x", "y", "z"), ("error_m", "size_m"), ("red", "green", "blue")):
        np.testing.assert_array_equal(
            ply.read_properties(tmp_path / "p.ply", *names),
            np.stack([points[name] for name in names], axis=1).astype(float),
        )
    assert ply.read_properties(tmp_path / "p.ply", "opacity") is None
    content = (tmp_path / "p.ply").read_bytes()
    for cut in (0, 10, 100, len(content) - 1):
        (tmp_path / "cut.ply").write_bytes(content[:cut])
        with suppress(IcyMoonError):  # without the end of its header it is no PLY file
            assert ply.read_properties(tmp_path / "cut.ply", "x") is None


@pytest.mark.parametrize("size", [(256, 144), (640, 480)])
def test_the_file_contains_the_number_of_missing_points(tmp_path, size):
    """Measured and missing are together all that have a true depth, also where only every second pixel is taken."""
    own = prepare_pair(
        with_pose(pairs.write_pair(tmp_path / "pair", pairs.Scene(sky_rows=size[1] // 4), rig=pairs.camera(*size))), {}
    )
    disparity = own.pair.camera.disparity(own.truth)
    whole = len(make_measured_points(own, disparity))
    disparity[:, : size[0] // 2] = np.nan
    write_points(tmp_path / "p.ply", own, disparity)
    missing = ply.read_comment_number(tmp_path / "p.ply", "missing")
    assert missing == pytest.approx(whole / 2, rel=0.01)
    assert missing + len(make_measured_points(own, disparity)) == whole
    assert ply.read_comment_number(tmp_path / "p.ply", "lost") is None


def test_large_images_are_thinned_out(tmp_path):
    large = prepare_pair(with_pose(pairs.write_pair(tmp_path / "pair", rig=pairs.camera(640, 480))), {})
    points = make_measured_points(large, large.pair.camera.disparity(large.truth))
    assert MAX_POINTS / 4 < len(points) <= MAX_POINTS


@pytest.mark.usefixtures("undrawn")
def test_points_that_are_asked_for_later_need_no_matching(tmp_path, monkeypatch):
    folder = with_pose(pairs.write_pair(tmp_path / "pair", rig=pairs.camera(192, 96)))
    methods = parse_methods("bm,sgbm")
    before = list(evaluate([folder], methods, tmp_path / "out")["rows"])
    assert all("points" not in row["images"] for row in before)
    monkeypatch.setattr("icymoon.stereo.fusion.fuse.match_checked", None)
    after = evaluate([folder], methods, tmp_path / "out", points=True)
    assert all((tmp_path / "out" / row["images"]["points"]).is_file() for row in after["rows"])
    assert [row["l1_m"] for row in after["rows"]] == [row["l1_m"] for row in before]
    shown = json.loads((tmp_path / "out" / "summary.json").read_text())["shown"]
    assert [row["images"] for row in shown] == [row["images"] for row in after["rows"]]


@pytest.mark.parametrize("pose", [7, [], [[1.0]], "north", [[float("nan")] * 4] * 4])
def test_a_pair_with_a_wrong_pose_is_refused(tmp_path, pose):
    folder = with_pose(pairs.write_pair(tmp_path / "pair", rig=pairs.camera(192, 96)), pose)
    with pytest.raises(IcyMoonError, match=r"poses_camera_to_world\.left|NaN"):
        read_pair(folder)


@pytest.mark.usefixtures("undrawn")
def test_a_pair_without_a_pose_is_still_measured(tmp_path):
    folder = pairs.write_pair(tmp_path / "pair", rig=pairs.camera(192, 96))
    assert "poses_camera_to_world" not in json.loads((folder / "pair.json").read_text())
    events = []
    report = evaluate([folder], parse_methods("sgbm"), tmp_path / "out", on_event=events.append, points=True)
    assert report["rows"][0]["status"] == "ok"
    assert any("position of the camera" in event["message"] for event in events if event["type"] == "warning")


def test_the_cloud_states_its_place_on_a_map(tmp_path):
    place = {
        "crs": "EPSG:32633",
        "unit_m": 1.0,
        "origin": [500000.0625, 4649990.123456789],
        "scale": [1.0, 1.0],
        "height_zero_m": 1234.5,
    }
    folder = with_pose(pairs.write_pair(tmp_path / "pair", pairs.Scene(rock=False)))
    file = folder / "pair.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"ground": {"map": place}}), encoding="utf-8")
    mapped = prepare_pair(folder, {})
    write_points(tmp_path / "p.ply", mapped, mapped.pair.camera.disparity(mapped.truth))
    (line,) = [line for line in (tmp_path / "p.ply").read_bytes().split(b"\n") if line.startswith(b"comment map ")]
    stated = json.loads(line.removeprefix(b"comment map "))
    assert {key: stated[key] for key in place} == place
    assert "origin[0] + x / scale[0]" in stated["formula"]

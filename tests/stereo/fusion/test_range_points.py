"""Range points of a pair: samples of its depth and scans, with noise and a shift."""

from types import SimpleNamespace

import numpy as np
import pairs
import pytest
from icymoon.stereo.fusion.range_points import (
    PointErrors,
    choose_points,
    make_point_generator,
    project_points,
    read_scan,
    sample_depth,
)
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import write_json

CAMERA = pairs.camera(96, 64)
NO_ERRORS = PointErrors(0.0, 0.0)
POSE = np.array([[0.0, 0.0, 1.0, 5.0], [-1.0, 0.0, 0.0, 2.0], [0.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
PAIR = SimpleNamespace(name="one", camera=CAMERA, rectified_pose=lambda eye: POSE)


@pytest.fixture
def truth():
    depth, _, _ = pairs.view(pairs.Scene(), CAMERA, "left")
    return depth


def points_of(truth, count, errors=NO_ERRORS, seed=0):
    random = make_point_generator(seed, "one")
    return project_points(sample_depth(truth, CAMERA, count, random), CAMERA, truth.shape, errors, random)


def test_without_errors_a_point_has_the_disparity_of_its_pixel(truth):
    points = points_of(truth, 200)
    row, column = np.rint(points.row).astype(int), np.rint(points.column).astype(int)
    np.testing.assert_allclose([points.row, points.column], [row, column], atol=1e-9)
    np.testing.assert_allclose(points.disparity, CAMERA.disparity(truth)[row, column])
    assert len({*zip(row.tolist(), column.tolist(), strict=True)}) == 200


def test_more_points_keep_the_fewer_ones_and_their_noise(truth):
    few, many = (points_of(truth, count, PointErrors(0.02, 0.5)) for count in (40, 400))
    places = {*zip(many.column.tolist(), many.row.tolist(), many.disparity.tolist(), strict=True)}
    assert places.issuperset(zip(few.column.tolist(), few.row.tolist(), few.disparity.tolist(), strict=True))
    assert points_of(truth, 40, seed=1).column.tolist() != points_of(truth, 40).column.tolist()


def test_noise_has_the_stated_size_along_the_ray(truth):
    points = points_of(truth, 2000, PointErrors(0.02, 0.0))
    exact = points_of(truth, 2000)
    off = (points.disparity - exact.disparity) / points.noise_px
    # The mean square of 2000 normal numbers is 1 within 5 standard errors of sqrt(2 / 2000).
    assert np.mean(off**2) == pytest.approx(1, abs=0.16)


def test_a_shift_moves_all_points_alike(truth):
    exact, moved = (points_of(truth, 100, PointErrors(0.0, shift)) for shift in (0.0, 0.5))
    column, row = np.median(moved.column) - np.median(exact.column), np.median(moved.row) - np.median(exact.row)
    assert np.hypot(column, row) == pytest.approx(0.5, abs=0.1)


def test_of_points_at_one_place_the_nearest_stays():
    places = np.array([[0, 0, 4.0], [0, 0, 2.0], [0.1, 0, 2.0], [0, 0.1, 2.0]])
    found = project_points(places, CAMERA, (64, 96), NO_ERRORS, np.random.default_rng(0))
    assert len(found.column) == 3
    assert found.disparity.min() == pytest.approx(CAMERA.disparity(np.float64(2.0)))


def test_too_few_points_are_one_sentence(truth):
    with pytest.raises(IcyMoonError, match=r"6145 range points were asked for, and only \d+ pixels"):
        sample_depth(truth, CAMERA, 6145, np.random.default_rng(0))
    behind = np.array([[0, 0, -1.0], [0, 0, 1.0], [9, 9, 1.0]])
    with pytest.raises(IcyMoonError, match="Only 1 of 3 range points lie in the left image, and 3 are needed"):
        project_points(behind, CAMERA, truth.shape, NO_ERRORS, np.random.default_rng(0))


def write_scan(folder, points, off_m=0.0, lost=None, alarm=None):
    """A scan with measured points (n, 3) at ranges that are ``off_m`` too long, lost returns, and a false alarm."""
    scan = folder / "one"
    scan.mkdir(exist_ok=True)
    count, position = len(points), POSE[:3, 3]
    range_m = np.linalg.norm(points - position, axis=1)
    zero = np.zeros(count, np.int64)
    names = ("beam", "order", "of", "energy_j", "label", "number", "row", "time_s")
    measured = np.where(zero.astype(bool) if lost is None else lost, np.nan, range_m)
    arrays = {"range_m": range_m, "true_range_m": range_m - off_m, "measured_range_m": measured, "point_m": points}
    false = np.zeros((0, 3)) if alarm is None else alarm[None]
    np.savez(
        scan / "lidar.npz", **arrays, **dict.fromkeys(names, zero), measured_electrons=range_m, false_point_m=false,
        false_beam=np.zeros(len(false), np.int64), false_range_m=np.linalg.norm(false - position, axis=1)
    )  # fmt: skip
    facts = {"title": "Test", "pattern": "RASTER", "rows": 1, "columns": count, "period_s": 0.1, "wavelength_nm": 532.0}
    facts |= {"position_m": position.tolist(), "sensor_to_world": np.eye(4).tolist(), "returns": count, "beams": count}
    write_json(scan / "lidar.json", facts | {"beams_without_return": 0})


def test_a_scan_is_placed_by_the_pose_of_the_left_eye(truth, tmp_path):
    places = sample_depth(truth, CAMERA, 50, np.random.default_rng(0))
    write_scan(tmp_path, np.vstack([places, [[0, 0, -3.0]]]) @ POSE[:3, :3].T + POSE[:3, 3])
    np.testing.assert_allclose(read_scan(tmp_path, PAIR, truth), places, atol=1e-9)
    assert len(choose_points(places, 7, np.random.default_rng(0))) == 7
    assert len(choose_points(places, 99, np.random.default_rng(0))) == 50


def test_lost_returns_have_no_point_and_false_alarms_have_one(truth, tmp_path):
    """A scan is taken as its instrument reports it: with its errors, and with points where there is no ground."""
    places = sample_depth(truth, CAMERA, 50, np.random.default_rng(0))
    alarm = np.array([[0.0, 0.0, 0.3]])
    lost = np.arange(50) % 2 == 0
    inside = places @ POSE[:3, :3].T + POSE[:3, 3]
    write_scan(tmp_path, inside, 0.01, lost, (alarm @ POSE[:3, :3].T + POSE[:3, 3])[0])
    np.testing.assert_allclose(read_scan(tmp_path, PAIR, truth), np.vstack([places[~lost], alarm]), atol=1e-9)


def test_a_scan_that_does_not_fit_is_one_sentence(truth, tmp_path):
    with pytest.raises(IcyMoonError, match="has no scan of the pair one"):
        read_scan(tmp_path, PAIR, truth)
    places = sample_depth(truth, CAMERA, 50, np.random.default_rng(0))
    write_scan(tmp_path, places)  # in the axes of the eye, not of the site
    with pytest.raises(IcyMoonError, match=r"none of 50 points lies in the left image|another ground"):
        read_scan(tmp_path, PAIR, truth)
    write_scan(tmp_path, 1.2 * places @ POSE[:3, :3].T + POSE[:3, 3])
    with pytest.raises(IcyMoonError, match="another ground than the pair one"):
        read_scan(tmp_path, PAIR, truth)
    write_scan(tmp_path, np.full((3, 3), np.nan))
    with pytest.raises(IcyMoonError, match="has no points"):
        read_scan(tmp_path, PAIR, truth)
    lost = SimpleNamespace(name="one", camera=CAMERA, rectified_pose=lambda eye: None)
    write_scan(tmp_path, places)
    with pytest.raises(IcyMoonError, match="states no pose of its camera"):
        read_scan(tmp_path, lost, truth)

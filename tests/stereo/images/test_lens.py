"""Lens distortion against OpenCV, and images and truth that stay together through it."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pairs
import pytest
from icymoon.physics.camera.lens_distortion import distort_points, find_overscan, refuse_folds, undistort_points
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.cli import main
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.images.lens import make_lens
from icymoon.stereo.matchers import match
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

BARREL = (-0.12, 0.02, 0.001, -0.0005, 0.003)
GRID = np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 37), np.linspace(-0.7, 0.7, 29)), axis=-1)
QUIET = {"shot_noise": False, "read_noise_e": 0.0, "dark_current_e_s": 0.0}


def lens_settings(k=BARREL):
    return {f"distortion_{name}": value for name, value in zip(("k1", "k2", "p1", "p2", "k3"), k, strict=True)}


def test_the_model_is_opencvs():
    points = np.concatenate([GRID.reshape(-1, 2), np.ones((GRID.size // 2, 1))], axis=1)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), np.array(BARREL))
    np.testing.assert_allclose(distort_points(GRID, BARREL).reshape(-1, 2), expected[:, 0], atol=1e-12)


@pytest.mark.parametrize("k", [BARREL, (0.3, 0.1, 0.0, 0.0, 0.0), (0.0, 0.0, 0.01, 0.01, 0.0), (0.0,) * 5])
def test_taking_distortion_away_is_its_inverse(k):
    np.testing.assert_allclose(undistort_points(distort_points(GRID, k), k), GRID, atol=1e-9)


def test_beyond_the_fold_there_is_nothing_and_a_folded_image_is_refused():
    strong = (-0.5, 0.0, 0.0, 0.0, 0.0)  # r (1 - r²/2) turns back at r = 0.816, where it is 0.544
    assert np.isnan(undistort_points(np.array([[0.6, 0.0]]), strong)).all()
    np.testing.assert_allclose(undistort_points(np.array([[0.5, 0.0]]), strong), [[0.618, 0.0]], atol=1e-3)
    refuse_folds(GRID * 0.5, strong)
    with pytest.raises(IcyMoonError, match=r"rig\.distortion_k1"):
        refuse_folds(GRID, strong)


def develop_with(folder, k, **sensor):
    pair = read_pair(folder)
    left, right = (read_view(pair.image(eye)) for eye in ("left", "right"))
    settings = merged(pair.settings, {"rig": lens_settings(k), "sensor": QUIET | {"bits": 12} | sensor})
    return pair, left, develop(pair, left, right, settings)


def test_a_place_is_folded_where_the_determinant_of_the_map_is_not_positive():
    """By differences of the map itself, of strong lenses, at one point each. Many of them fold there."""
    random = np.random.default_rng(6)
    folded = 0
    for point, k in zip(random.uniform(-1.0, 1.0, (400, 2)), random.normal(0.0, 0.6, (400, 5)), strict=True):
        step = 1e-6 * np.eye(2)
        slope = (distort_points(point + step, tuple(k)) - distort_points(point - step, tuple(k))) / 2e-6
        if np.linalg.det(slope) > 0:
            refuse_folds(point, tuple(k))
            continue
        folded += 1
        with pytest.raises(IcyMoonError, match="fold the image"):
            refuse_folds(point, tuple(k))
    assert 40 < folded < 360


def test_distortion_is_taken_away_up_to_a_tenth_before_the_fold():
    """Of a fold at r² = -1 / (3 k1), in all directions: the steps there are exact, or they would not arrive."""
    k, angle = (-0.3, 0.0, 0.0, 0.0, 0.0), np.radians(np.arange(0, 360, 15))
    points = 0.9 * np.sqrt(-1 / (3 * k[0])) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    np.testing.assert_allclose(
        undistort_points(distort_points(points, k), k), points, atol=1e-9 / 0.19
    )  # the slope there


@pytest.mark.parametrize("k1", [-0.5, -0.2])
def test_the_far_side_of_a_fold_is_no_answer(k1):
    """x (1 + k1 x²) turns back at x² = -1 / (3 k1), where it is greatest. A greater value has one root, across the
    axis; the solver may find it, and no lens shows it."""
    turn = np.sqrt(-1 / (3 * k1))
    seen = np.linspace(-4.0, 4.0, 800)  # no zero
    found = undistort_points(np.stack([seen, np.zeros_like(seen)], axis=-1), (k1, 0.0, 0.0, 0.0, 0.0))[:, 0]
    np.testing.assert_array_equal(np.isfinite(found), np.abs(seen) < turn * 2 / 3)
    near = np.isfinite(found)
    assert (np.abs(found[near]) < turn).all()
    assert (np.sign(found[near]) == np.sign(seen[near])).all()


def test_rectified_images_lie_on_the_truth_and_distorted_ones_do_not(tmp_path):
    folder = pairs.write_pair(tmp_path / "pair", pairs.Scene(rock=False))
    pair, _, plain = develop_with(folder, (0.0,) * 5)
    assert plain.detected_left is plain.left
    _, left, images = develop_with(folder, BARREL)
    inner = (slice(20, -20), slice(70, -20))
    scale = float(plain.left[inner].mean())
    off = np.abs(images.left[inner].astype(float) * plain.exposure_s / images.exposure_s - plain.left[inner])
    assert np.median(off) < 0.02 * scale  # twice interpolated, and no more
    bent = np.abs(images.detected_left[inner].astype(float) * plain.exposure_s / images.exposure_s - plain.left[inner])
    assert np.median(bent) > 5 * np.median(off)
    disparity, _, _ = match("sgbm", *images.for_matchers())
    error = disparity - pair.camera.disparity(left.depth)
    assert np.abs(np.nanmedian(error[inner])) < 0.05


def test_opencv_rectifies_the_detected_image_with_the_calibration(tmp_path):
    folder = pairs.write_pair(tmp_path / "set" / "pairs" / "aaa")
    arguments = [f"--set=rig.{key}={value}" for key, value in lens_settings().items()]
    assert main(["develop", str(folder), "--out", str(tmp_path / "out"), *arguments]) == 0
    out = tmp_path / "out" / "aaa"
    said = json.loads((out / "images.json").read_text())
    matrix = np.array(said["camera"]["K"])
    matrix[:2, 2] -= 0.5  # OpenCV counts from pixel centres
    bent, flat = (cv2.imread(str(out / name), cv2.IMREAD_UNCHANGED) for name in ("left_distorted.png", "left.png"))
    k = np.array([said["distortion"][name] for name in ("k1", "k2", "p1", "p2", "k3")])
    assert np.abs(cv2.undistort(bent, matrix, k)[5:-5, 5:-5].astype(int) - flat[5:-5, 5:-5]).max() <= 3
    # The depth beside it is that of the ray that each of its pixels is.
    depth = np.load(out / "left_distorted_depth.npy")
    scene = pairs.Scene()
    points = np.array([[[100.0, 40.0]], [[200.0, 120.0]]])  # of the plane
    for (u, v), (x, y) in zip(points[:, 0].astype(int), cv2.undistortPoints(points, matrix, k)[:, 0], strict=True):
        assert depth[v, u] == pytest.approx(scene.distance_m / (1 + scene.slope_x * x + scene.slope_y * y), rel=1e-5)
    assert main(["develop", str(folder), "--out", str(tmp_path / "out")]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["images.json", "left.png", "right.png"]


def test_where_the_render_does_not_reach_is_dark_and_without_truth(tmp_path):
    pair = read_pair(pairs.write_pair(tmp_path / "pair"))
    lens = make_lens(pair.camera, defaults().rig | lens_settings(), "left")
    truth = lens.depth_of_sensor(np.ones((144, 256)))
    assert np.isnan(truth[0, 0])
    assert truth[72, 128] == 1.0
    assert lens.distort(np.ones((144, 256)))[0, 0] == 0.0
    assert make_lens(pair.camera, defaults().rig, "left") is None


def sensor_rays(camera, k):
    """Normalised x and y (H, W) of the sensor's pixels, by OpenCV."""
    v, u = np.indices((camera.height_px, camera.width_px)) + 0.5
    matrix = np.array(camera.matrix)
    ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    # In OpenCV 5 the other function takes the criteria.
    undistort = vars(cv2).get("undistortPointsIter", vars(cv2)["undistortPoints"])
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    found = undistort(pixels, matrix, np.array(k), R=None, P=None, criteria=ends)
    return found.reshape(camera.height_px, camera.width_px, 2).transpose(2, 0, 1)


def inverse_depth(plane, x, y):
    """1 / depth of a plane (distance, slopes) along the rays (x, y, 1), NaN where it is not seen."""
    found = (1 + plane[1] * x + plane[2] * y) / plane[0]
    return np.where(found > 0, found, np.nan)


def rendered_rays(camera):
    columns, rows = camera.rendered_px
    v, u = np.indices((rows, columns)) + 0.5
    return (
        (u - camera.margin_x_px - camera.cx_px) / camera.focal_px,
        (v - camera.margin_y_px - camera.cy_px) / camera.focal_px,
    )


@pytest.mark.ci_takes(4)
@pytest.mark.parametrize("plane", [(2.0, 0.1, 0.6), (1.0, 0.0, 1.9), (0.5, -0.9, 0.3), (3.0, 0.0, 0.0)])
@pytest.mark.parametrize("size", [(640, 480), (160, 120)])
@pytest.mark.parametrize("toe_in", [0.0, 4.0])
def test_depth_of_the_sensor_is_exact_on_a_plane(plane, size, toe_in):
    """A rendered pixel's depth was taken for that of half a pixel beside it. Coordinates in float32 have an error of
    3e-5 px, which the steepest plane turns into 1e-5 of the depth; a horizon is left out as far as 1 / depth is not ten
    times that of a step."""
    camera = replace(pairs.camera(*size), toe_in_deg=toe_in, margin_x_px=size[0] // 5, margin_y_px=size[1] // 5)
    rig = defaults().rig | lens_settings()
    depth = 1 / inverse_depth(plane, *rendered_rays(camera))
    for eye in ("left", "right"):
        found = make_lens(camera, rig, eye).depth_of_sensor(depth.astype(np.float32))
        expected = inverse_depth(plane, *sensor_rays(camera, BARREL))
        far = expected < 10 * np.hypot(plane[1], plane[2]) / plane[0] / camera.focal_px
        assert (far | ~np.isfinite(expected)).mean() < 0.5
        sure = np.isfinite(expected) & ~far
        np.testing.assert_allclose(found[sure] * expected[sure], 1.0, atol=1e-4)


def test_depth_of_the_sensor_is_of_one_surface_at_an_edge():
    """A block before a plane, a pole of one pixel, and sky: nothing is between two surfaces."""
    camera = replace(pairs.camera(), margin_x_px=50, margin_y_px=40)
    x, y = rendered_rays(camera)
    near, ground, pole = (1.0, 0.2, 0.1), (2.0, 0.1, 0.6), (0.7, 0.0, 0.0)
    which = np.select([y < -0.25, np.indices(x.shape)[1] == 100, (x > 0.05) & (x < 0.4) & (y < 0.2)], [3, 2, 1], 0)
    layers = [1 / inverse_depth(plane, x, y) for plane in (ground, near, pole)]
    depth = np.choose(which, [*layers, np.full_like(x, np.nan)])
    lens = make_lens(camera, defaults().rig | lens_settings(), "left")
    found = lens.depth_of_sensor(depth)
    rays = sensor_rays(camera, BARREL)
    nearest = cv2.remap(which.astype(np.float32), np.rint(lens.sensor_in_rendered), None, cv2.INTER_NEAREST).astype(int)
    assert set(np.unique(nearest)) == {0, 1, 2, 3}
    np.testing.assert_array_equal(np.isnan(found), nearest == 3)
    wrong = [np.abs(found * inverse_depth(plane, *rays) - 1) for plane in (ground, near, pole)]
    own = np.choose(np.minimum(nearest, 2), wrong)[nearest < 3]
    assert own.max() < 0.01  # that of a pixel at most half a pixel away
    assert np.mean(own > 1e-4) < 0.1  # along the edges


@pytest.mark.parametrize("k", [BARREL, (-0.2, 0.05, 0.0, 0.0, 0.0), (0.0, 0.0, 0.02, -0.03, 0.0)])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.0, 9.5), (0.0, -9.5), (9.5, 0.0), (-9.5, 0.0)])
def test_the_overscan_that_is_needed_lights_every_pixel_and_less_does_not(k, shift):
    rig = (
        defaults().rig
        | lens_settings(k)
        | {"width_px": 200, "height_px": 160, "principal_x_px": shift[0], "principal_y_px": shift[1]}
    )
    needed = find_overscan(rig)
    assert 0 < needed < 0.5

    def darkest(overscan):
        camera = StereoCamera.from_settings(rig | {"overscan": overscan})
        return make_lens(camera, rig, "left").distort(np.ones(camera.rendered_px[::-1])).min()

    assert darkest(needed) == pytest.approx(1.0, abs=1e-5)
    assert darkest(max(0.0, needed - 1.01 / 160)) == 0.0


def test_a_lens_that_sees_less_needs_no_overscan_and_beyond_a_fold_none_helps():
    assert find_overscan(defaults().rig) == 0.0
    assert find_overscan(defaults().rig | lens_settings((0.1, 0.0, 0.0, 0.0, 0.0))) == 0.0
    assert find_overscan(defaults().rig | lens_settings((-0.3, 0.0, 0.0, 0.0, 0.0))) is None


@pytest.mark.parametrize("toe_in", [0.0, 5.0, 45.0])
def test_rectification_of_turned_eyes_is_the_homography_of_the_turn(toe_in):
    camera = replace(pairs.camera(), toe_in_deg=toe_in)
    assert (make_lens(camera, defaults().rig, "left") is None) == (toe_in == 0)
    for eye in ("left", "right") if toe_in else ():
        lens = make_lens(camera, defaults().rig, eye)
        matrix = np.array(camera.matrix)
        matrix[:2, 2] -= 0.5
        turn = matrix @ camera.eye_rotation(eye) @ np.linalg.inv(matrix)
        v, u = np.indices((144, 256)).astype(float)
        expected = np.stack([u, v, np.ones_like(u)], axis=-1) @ turn.T
        ahead = expected[..., 2] > 1e-3
        np.testing.assert_allclose(
            lens.rectified_in_sensor[ahead], (expected[..., :2] / expected[..., 2:])[ahead], rtol=1e-4, atol=1e-3
        )
        assert np.isnan(lens.rectified_in_sensor[expected[..., 2] < -1e-3]).all()
        assert lens.sees.mean() == pytest.approx(1.0, abs=1.2 * np.tan(np.radians(toe_in)) + 0.05)
        assert lens.sees.any()


@pytest.mark.parametrize("k", [(-0.5, 0.1, 0.0, 0.0, 0.0), (-0.5, 0.1, 1e-3, -1e-3, 0.0), (-0.4, 0.0, 0.0, 0.0, 0.05)])
def test_a_point_beyond_the_fold_has_no_answer_where_the_polynomial_rises_again(k):
    """A lens shows what is within the fold: radii up to the first that no larger one is seen nearer than."""
    radii = np.linspace(0.0, 4.0, 40001)
    seen = distort_points(np.stack([radii, np.zeros_like(radii)], axis=-1), k)[:, 0]
    fold = int(np.argmax(np.diff(seen) <= 0))
    assert seen.max() > seen[fold]  # it rises again, beyond
    asked = np.linspace(0.0, 1.5 * seen[fold], 601)
    found = undistort_points(np.stack([asked, np.zeros_like(asked)], axis=-1), k)[:, 0]
    inside = asked < seen[fold] * (1 - 1e-4)
    assert np.isfinite(found[inside]).all()
    assert (np.abs(found[inside]) <= radii[fold + 1]).all()
    assert np.isnan(found[asked > seen[fold] * (1 + 1e-4)]).all()

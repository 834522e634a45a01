"""Errors on the vertices of the ground: a plane and a rock of which depth, error and what hides what are known."""

from __future__ import annotations

import json
import sys

import numpy as np
import pairs
import pytest
from icymoon.stereo import ground_errors
from icymoon.stereo.ground_errors import COARSE, MEASURED, MISSING, UNSEEN, DepthErrors, sample_vertex_errors
from icymoon.stereo.images.colours import colour_signed_errors
from icymoon.stereo.images.image_files import write_disparity
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

RIG, PLANE = pairs.camera(), pairs.Scene(slope_x=0.0, slope_y=0.6, rock=False)
NO_EDGES = np.empty((0, 2), np.int32)
RED, BLUE, WHITE, GREY, DARK = ([0xC4, 0x2B, 0x2B], [0x2B, 0x5F, 0xC4], [0xF4] * 3, [150] * 3, [60] * 3)


def pose() -> Array:
    """A camera anywhere, turned by 40, 110 and 25 degrees."""
    found = np.eye(4)
    for axis, angle in enumerate(np.radians([40.0, 110.0, 25.0])):
        turn = np.eye(4)
        i, j = [k for k in range(3) if k != axis]
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        found = found @ turn
    found[:3, 3] = 5.0, -3.0, 12.0
    return found


def errors(error_m: Array | float, scene: pairs.Scene = PLANE) -> DepthErrors:
    truth = pairs.view(scene, RIG, "left")[0]
    return DepthErrors(RIG, pose(), truth, np.where(np.isnan(truth), np.nan, np.broadcast_to(error_m, truth.shape)))


def on_plane(x: Array, y: Array) -> Array:
    """Points of the plane in the world, by their x and y in the camera's axes."""
    local = np.stack([x, y, PLANE.distance_m - PLANE.slope_y * y], axis=-1).reshape(-1, 3)
    return np.asarray(local @ pose()[:3, :3].T + pose()[:3, 3])


def grid() -> tuple[Array, Array, Array]:
    """x and y of points within the image and to both sides of it, and the points."""
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(-2.2, 2.2, 250), np.linspace(-0.6, 0.6, 90)))
    return x, y, on_plane(x, y)


def test_a_vertex_shows_the_error_of_its_pixel_with_its_sign():
    x, y, points = grid()
    columns = np.arange(RIG.width_px)[None, :] + 0.5
    found = sample_vertex_errors(errors(np.where(columns < RIG.cx_px, 0.25, -0.1)), points, NO_EDGES)
    seen = np.abs(RIG.focal_px * x / (PLANE.distance_m - PLANE.slope_y * y)) < RIG.cx_px - 1
    away = np.abs(x) > 0.03  # more than a pixel from the step between the two errors
    assert 0.6 * len(x) < seen.sum() < 0.9 * len(x)
    assert (found.kind[seen] == MEASURED).all()
    np.testing.assert_allclose(found.error_m[seen & away], np.where(x < 0, 0.25, -0.1)[seen & away], rtol=1e-6)
    assert found.depth_m[seen] == pytest.approx((PLANE.distance_m - PLANE.slope_y * y)[seen])


def test_what_a_rock_hides_and_what_is_behind_the_camera_is_unseen():
    x, y, points = grid()
    found = sample_vertex_errors(errors(0.3, pairs.Scene(slope_x=0.0, slope_y=0.6, rock=True)), points, NO_EDGES)
    depth = PLANE.distance_m - PLANE.slope_y * y
    near = 0.75 * PLANE.distance_m
    across, pixel = np.maximum(np.abs(x), np.abs(y)) / depth * near, near / RIG.focal_px
    hidden = (across < 0.25 - 2 * pixel) & (depth > near + 0.1)
    beside = (across > 0.25 + 2 * pixel) & (found.kind != UNSEEN)
    assert hidden.sum() > 200
    assert (found.kind[hidden] == UNSEEN).all()
    assert np.isnan(found.error_m[hidden]).all()
    assert np.isinf(found.depth_m[hidden]).all()
    assert (found.kind[beside] == MEASURED).all()
    behind = 2 * pose()[:3, 3] - points  # mirrored at the camera
    assert (sample_vertex_errors(errors(0.3), behind, NO_EDGES).kind == UNSEEN).all()


def test_what_floats_above_or_lies_below_the_surface_is_not_taken_for_it():
    x, y, _ = grid()
    below = on_plane(x, y) + pose()[:3, 2] * 0.3  # along the optical axis
    assert (sample_vertex_errors(errors(0.0), below, NO_EDGES).kind == UNSEEN).all()
    above = on_plane(x, y) - pose()[:3, 2] * 0.3
    assert (sample_vertex_errors(errors(0.0), above, NO_EDGES).kind == UNSEEN).all()


def test_what_was_not_measured_is_no_error():
    _, _, points = grid()
    found = sample_vertex_errors(errors(np.nan), points, NO_EDGES)
    assert set(found.kind) == {MISSING, UNSEEN}
    assert np.isnan(found.error_m).all()
    sky = sample_vertex_errors(errors(0.1, pairs.Scene(slope_x=0.0, sky_rows=144)), points, NO_EDGES)
    assert set(sky.kind) == {UNSEEN}


def test_wide_triangles_are_named_and_not_painted():
    points = on_plane(np.array([0.0, 0.02, 0.5, 0.52]), np.zeros(4))
    close = sample_vertex_errors(errors(0.1), points, np.array([[0, 1], [2, 3]]))
    assert (close.kind == MEASURED).all()
    wide = sample_vertex_errors(errors(0.1), points, np.array([[0, 1], [1, 2]]))  # 33 px
    assert wide.kind.tolist() == [MEASURED, COARSE, COARSE, MEASURED]
    assert np.isnan(wide.error_m[1:3]).all()


def test_pixels_are_counted_by_their_error_and_by_what_is_painted_there():
    sides = np.repeat([0.5, -0.5, 0.001, np.nan], RIG.width_px // 4)
    of_pair = errors(sides[None, :], pairs.Scene(slope_x=0.0, rock=False))
    quarter = of_pair.truth.size // 4
    everywhere = np.stack(np.meshgrid(np.arange(256.0), np.arange(144.0)), axis=-1).reshape(-1, 2)
    counted = ground_errors.count_pixels(of_pair, everywhere)
    assert counted == {"far": quarter, "near": quarter, "right": quarter, "missing": quarter, "coarse": 0}
    left = everywhere[everywhere[:, 0] < 16 * 8]
    assert ground_errors.count_pixels(of_pair, left)["coarse"] == 144 * (256 - 128)
    assert ground_errors.count_pixels(of_pair, np.empty((0, 2)))["coarse"] == 4 * quarter


def test_of_two_pairs_the_nearest_measurement_is_shown():
    def seen(error: float, kind: int, depth: float) -> ground_errors.VertexErrors:
        return ground_errors.VertexErrors(np.array([error], np.float32), np.array([kind], np.uint8), np.array([depth]))

    near, far, none = seen(0.25, MEASURED, 2.0), seen(0.5, MEASURED, 9.0), seen(np.nan, MISSING, 1.0)
    for one, other in ((near, far), (far, near), (near, none), (none, near)):
        assert ground_errors.choose_better_result(one, other).error_m == 0.25


@pytest.mark.parametrize("full_m", [0.05, 1.0, 7.0])
def test_the_range_moves_the_full_colour_and_nothing_else(full_m):
    error = np.array([full_m, -full_m, 3 * full_m, 0.009, -0.009, np.nan, np.nan, 1.0, 0.02])
    kind = np.array([MEASURED] * 5 + [MISSING, UNSEEN, COARSE, MEASURED])
    shown = ground_errors.colour_errors(error, kind, full_m).tolist()
    assert shown[:8] == [RED, BLUE, RED, WHITE, WHITE, GREY, DARK, DARK]
    assert shown[8] not in (RED, WHITE)
    halfway = colour_signed_errors(np.array([np.sqrt(0.01 * full_m)]), full_m)[0]  # the scale is logarithmic
    np.testing.assert_allclose(halfway, (np.array(RED) + WHITE) / 2, atol=1)


def test_the_files_of_an_evaluation_are_read_without_opencv_and_openexr(tmp_path, monkeypatch):
    scene = pairs.Scene(sky_rows=20)
    folder = pairs.write_pair(tmp_path / "pair", scene)
    truth = pairs.view(scene, RIG, "left")[0]
    measured = np.where(np.arange(144)[:, None] < 100, truth + 0.2, np.nan)
    write_disparity(tmp_path / "sgbm.npz", RIG.disparity(measured))

    record = json.loads((folder / "pair.json").read_text())
    beside = pose()
    beside[:3, 3] += beside[:3, 0] * RIG.baseline_m
    (folder / "pair.json").write_text(
        json.dumps(
            {
                **record,
                "poses_camera_to_world": {"left": pose().tolist(), "right": beside.tolist()},
                "edited_by_hand": True,
            }
        )
    )
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    monkeypatch.setitem(sys.modules, "cv2", None)
    found = ground_errors.read_depth_errors(folder, tmp_path / "sgbm.npz")
    np.testing.assert_allclose(found.pose, pose())
    np.testing.assert_allclose(found.error_m[20:100], 0.2, atol=1e-5)
    assert np.isnan(found.error_m[:20]).all()
    assert np.isnan(found.error_m[100:]).all()
    assert np.isfinite(found.truth[100:]).all()
    # The file states f·B of the calibration that was assumed.
    stated = 1.1 * RIG.focal_baseline_px_m
    write_disparity(tmp_path / "off.npz", RIG.disparity(measured), focal_baseline_px_m=stated)
    found = ground_errors.read_depth_errors(folder, tmp_path / "off.npz")
    np.testing.assert_allclose(found.error_m[20:100], (1.1 * measured - truth)[20:100], atol=1e-5)
    (tmp_path / "sgbm.npz").write_bytes(b"no zip")
    with pytest.raises(IcyMoonError, match="missing or damaged"):
        ground_errors.read_depth_errors(folder, tmp_path / "sgbm.npz")

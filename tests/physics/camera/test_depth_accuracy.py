"""What the camera resolves on level ground, against rays."""

import math

import numpy as np
import pytest
from icymoon.physics.camera.depth_accuracy import depth_error_m, measure_ground_row, shared_width_px
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.physics.rig.focal_length import focal_px
from icymoon.settings.description import defaults

RIG = defaults().rig


def hit(rig, row, column=320.0):
    """(along, across, planar depth) of the point of level ground that a pixel's ray meets."""
    f, pitch = focal_px(rig), math.radians(rig["pitch_deg"])
    v, u = (row - rig["height_px"] / 2) / f, (column - rig["width_px"] / 2) / f
    depth = rig["height_m"] / (math.sin(pitch) + v * math.cos(pitch))
    return depth * (math.cos(pitch) - v * math.sin(pitch)), depth * u, depth


@pytest.mark.parametrize("row", [0.0, 100.0, 240.0, 480.0])
def test_a_row_of_the_image_on_the_ground(row):
    found = measure_ground_row(RIG, row)
    along, _, depth = hit(RIG, row)
    assert found.depth_m == pytest.approx(depth)
    assert found.distance_m == pytest.approx(along)
    assert found.width_m == pytest.approx(hit(RIG, row, 640.0)[1] - hit(RIG, row, 0.0)[1])
    assert found.across_m == pytest.approx(hit(RIG, row, 321.0)[1])
    step = 1e-3
    assert found.along_m == pytest.approx((hit(RIG, row - step)[0] - hit(RIG, row + step)[0]) / (2 * step), rel=1e-4)


def test_depth_error_is_what_a_disparity_error_makes():
    fb = focal_px(RIG) * RIG.baseline_m
    assert fb == pytest.approx(85.333, abs=1e-3)
    for depth in (1.0, 5.0, 20.0):
        disparity = fb / depth
        made = abs(fb / (disparity + 1e-4) - fb / (disparity - 1e-4)) / 2e-4
        assert depth_error_m(depth, RIG, 1.0) == pytest.approx(made, rel=1e-4)
    assert depth_error_m(10.0, RIG, 1.0) == pytest.approx(1.17, abs=0.01)


def test_above_the_horizon_and_out_of_the_other_eye():
    assert np.isinf(measure_ground_row(RIG | {"pitch_deg": 0.0}, 100.0).depth_m)
    assert shared_width_px(RIG, 1.0) == pytest.approx(640 - 85.333, abs=1e-3)
    assert shared_width_px(RIG, 0.05) == 0


@pytest.mark.parametrize("toe_in", [0.0, 3.0, 12.0, 45.0])
@pytest.mark.parametrize("depth", [0.4, 1.0, 3.0, 100.0])
def test_what_both_eyes_see_is_counted_ray_by_ray(toe_in, depth):
    rig = RIG | {"toe_in_deg": toe_in, "principal_x_px": 20.0}
    camera = StereoCamera.from_settings(rig)
    columns = (np.arange(6400) + 0.5) / 10  # tenths of a column
    points = np.stack([(columns - camera.cx_px) / camera.focal_px, 0 * columns, 0 * columns + 1]) * depth
    both = columns - camera.disparity(depth) >= 0  # in the rectified right image too
    for eye, at in (("left", 0.0), ("right", camera.baseline_m)):
        x, _, z = camera.eye_rotation(eye) @ (points - np.array([[at], [0], [0]]))
        seen = camera.focal_px * x / np.where(z > 0, z, np.nan) + camera.cx_px
        both &= (seen >= 0) & (seen <= 640)
    assert shared_width_px(rig, depth) == pytest.approx(both.sum() / 10, abs=0.3)

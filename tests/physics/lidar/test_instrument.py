"""What an instrument and a pose state and refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from icymoon.physics.camera.rotations import from_vector, quaternion
from icymoon.physics.lidar.instrument import Instrument, SensorPose, make_pose, mount_on_rig
from icymoon.physics.lidar.scan_patterns import ScanPattern
from icymoon.support.errors import IcyMoonError

ONE = ScanPattern("RASTER", 1, 1, 0, 0)
GIVEN: dict[str, Any] = {"pattern": ONE, "pulse_j": 1e-6, "half_angle_rad": (0, 0), "aperture_radius_m": 0.01}


def test_energy_is_that_of_the_equation():
    instrument = Instrument(ONE, 2e-6, (1e-3, 1e-3), 0.03, efficiency=0.4)
    assert instrument.collect(np.array([10.0]))[0] == pytest.approx(2e-6 * 0.4 * np.pi * 0.03**2 / 100, rel=1e-14)


def test_photons_of_green_light():
    # E λ / (h c): 1 fJ of 532 nm is 2678 photons.
    instrument = Instrument(ONE, 1e-6, (0, 0), 0.01, wavelength_m=532e-9)
    assert instrument.count_photons(np.array([1e-15]))[0] == pytest.approx(2678.1, abs=0.1)


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"pulse_j": -1e-6}, "pulse has -1e-06 J"),
        ({"pulse_j": float("nan")}, "pulse has nan J"),
        ({"wavelength_m": 0}, "wavelength"),
        ({"aperture_radius_m": -0.1}, "aperture"),
        ({"half_angle_rad": (1e-3, 1.0)}, "half-angles"),
        ({"aperture_radius_m": 0.0}, "aperture is 0"),
        ({"efficiency": 0.0}, "share above 0"),
        ({"efficiency": 1.1}, "share above 0 and at most 1"),
        ({"sub_rays": 0}, "0 rays"),
        ({"sub_rays": 21}, "even number"),
        ({"nearest_m": 5.0, "farthest_m": 5.0}, "make the first smaller"),
        ({"gate_m": -0.1}, "range gate"),
    ],
)
def test_an_impossible_instrument_is_one_sentence(values, part):
    with pytest.raises(IcyMoonError, match=part) as found:
        Instrument(**{**GIVEN, **values})
    assert str(found.value).count(". ") == 0


def test_points_go_to_the_world_and_back():
    rotation = from_vector(np.array([0.3, -0.9, 0.5]))
    pose = make_pose((10, -20, 3), (2 * quaternion(rotation)).tolist())
    points = np.random.default_rng(1).normal(size=(9, 3))
    assert pose.rotation == pytest.approx(rotation, abs=1e-14)
    assert pose.to_world(points)[3] == pytest.approx(rotation @ points[3] + [10, -20, 3])
    assert pose.to_sensor(pose.to_world(points)) == pytest.approx(points, abs=1e-13)
    assert (pose.matrix @ [*points[3], 1])[:3] == pytest.approx(pose.to_world(points)[3])


@pytest.mark.parametrize(
    "wxyz", [(0, 0, 0, 0), (), (1, 0, 0), (1, 0, 0, float("nan"))], ids=["zero", "none", "three", "nan"]
)
def test_a_pose_without_rotation_is_one_sentence(wxyz):
    with pytest.raises(IcyMoonError, match="pose has no rotation") as found:
        make_pose((0, 0, 0), wxyz)
    assert str(found.value).count(". ") == 0


def test_a_pose_without_place_or_with_a_mirror_is_refused():
    with pytest.raises(IcyMoonError, match="no place"):
        make_pose((0, float("inf"), 0), (1, 0, 0, 0))
    with pytest.raises(IcyMoonError, match="no rotation"):
        SensorPose(np.zeros(3), np.diag([1.0, 1, -1]))
    with pytest.raises(IcyMoonError, match="no rotation"):
        SensorPose(np.zeros(3), 1.01 * np.eye(3))


def test_a_sensor_at_the_left_eye_looks_along_the_camera_or_level():
    """A camera that looks east and 30 degrees down."""
    down = np.radians(30)
    left = np.eye(4)
    left[:3, :3] = np.array(
        [[0, -np.sin(down), np.cos(down)], [-1, 0, 0], [0, -np.cos(down), -np.sin(down)]]
    )  # right, down and ahead as columns
    left[:3, 3] = [3, 4, 5]
    along, level = mount_on_rig(left, "CAMERA"), mount_on_rig(left, "LEVEL")
    assert along.position_m.tolist() == level.position_m.tolist() == [3, 4, 5]
    assert along.rotation[:, 0] == pytest.approx([np.cos(down), 0, -np.sin(down)])
    assert along.rotation[:, 1] == pytest.approx([0, 1, 0])
    assert level.rotation == pytest.approx(np.eye(3), abs=1e-15)

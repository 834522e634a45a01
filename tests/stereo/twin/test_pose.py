"""The pose over a plane is found from its disparities, with rocks on it, rolled, and in noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.stereo.twin.pose import fit_pose
from icymoon.support.errors import IcyMoonError

RIG = StereoCamera(160, 120, 150.0, 83.0, 57.0, 0.2)


def plane(height_m, pitch_deg, roll_deg=0.0):
    """Disparities of a level plane below the camera; rays at and above the horizon see nothing."""
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    down = np.array([math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll), math.sin(pitch)])
    column, row = np.meshgrid(np.arange(RIG.width_px) + 0.5, np.arange(RIG.height_px) + 0.5)
    rays = np.stack(
        [(column - RIG.cx_px) / RIG.focal_px, (row - RIG.cy_px) / RIG.focal_px, np.ones(row.shape)], axis=-1
    )
    sinks = rays @ down
    return RIG.disparity(np.where(sinks > 0.05, height_m / np.where(sinks > 0.05, sinks, 1.0), np.nan))


@pytest.mark.parametrize(
    ("height_m", "pitch_deg", "roll_deg"),
    [(1.6, 45.0, 0.0), (0.4, 20.0, 5.0), (30.0, 90.0, 0.0), (1.0, 5.0, -12.0), (2.0, 60.0, 30.0)],
)
def test_an_exact_plane_is_found(height_m, pitch_deg, roll_deg):
    found = fit_pose(plane(height_m, pitch_deg, roll_deg), RIG)
    assert found.height_m == pytest.approx(height_m, rel=1e-6)
    # At 90 degrees the cosine loses half of the digits.
    assert found.pitch_deg == pytest.approx(pitch_deg, abs=1e-4)
    assert found.roll_deg == pytest.approx(roll_deg, abs=1e-6)
    assert found.relief_m == pytest.approx(0, abs=1e-6 * height_m)


def test_rocks_and_unknown_pixels_do_not_tilt_it():
    disparity = plane(1.6, 40.0)
    disparity[60:90, 20:60] *= 1.3  # a rock on 6 % of the image
    disparity[::3, ::2] = np.nan
    found = fit_pose(disparity, RIG)
    assert found.height_m == pytest.approx(1.6, rel=1e-3)
    assert found.pitch_deg == pytest.approx(40, abs=0.05)
    assert found.relief_m > 0.02


def test_too_few_points_tell_no_plane():
    disparity = np.full((120, 160), np.nan)
    disparity[0, :99] = 20.0
    with pytest.raises(IcyMoonError, match="has 99 points, and a plane needs 100"):
        fit_pose(disparity, RIG)

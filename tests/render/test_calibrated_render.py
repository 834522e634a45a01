"""Two calibrated eyes rendered by Blender: each sensor's truth is where OpenCV sees it from the other one."""

from __future__ import annotations

import cv2
import numpy as np
from heads import HEADS, head_settings
from icymoon.physics.camera.eyes import make_camera_with_eyes
from icymoon.physics.camera.lens_models import Brown
from icymoon.render.pairs.pair_folder import EYES, read_pair
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from
from icymoon.settings.description import merged
from icymoon.settings.pair_ids import make_pair_id
from icymoon.stereo.images.views import read_sensor_depth

FLAT: dict[str, dict[str, object]] = {
    "terrain": {"size_m": 10.0, "resolution": 17, "rms_slope_deg": 0.0},
    "mesh": {"kind": "GRID"},
    "quality": {"samples": 1, "threads": 2},
    "surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0},
}


def test_each_sensor_of_a_rendered_pair_has_the_depth_of_the_plane_that_opencv_sees(tmp_path):
    """The ground is a plane, so a pixel's depth follows from its ray alone."""
    settings = merged(head_settings("nearly alike", pitch_deg=50.0, height_m=1.5), FLAT)
    planned = PlannedPair(make_pair_id(settings), settings, 0.0)
    with ScenesFromSettings(lambda warning: None) as source:
        render_from(source, [planned], tmp_path, lambda kind, **facts: None)
    pair = read_pair(planned.folder(tmp_path))
    rig = HEADS["nearly alike"].cameras
    down = np.radians(50.0)
    up_in_rig = np.array([0.0, -np.cos(down), -np.sin(down)])
    for eye, own, placed in zip(EYES, rig, make_camera_with_eyes(settings).eyes or (), strict=True):
        assert isinstance(own.lens, Brown)
        depth = read_sensor_depth(pair, eye, pair.settings.rig)
        assert depth.shape == (own.height_px, own.width_px)
        grid = np.stack(np.meshgrid(np.arange(own.width_px), np.arange(own.height_px)), -1).reshape(-1, 1, 2)
        points = cv2.undistortPoints(grid.astype(np.float64), own.matrix, np.array(own.lens.coefficients))[:, 0]
        rays = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ placed.rotation
        expected = (-1.5 / (rays @ up_in_rig)).reshape(depth.shape)
        # Settings have seven digits, and undistortPoints ends within 1e-3 px, which is 1e-5 of a focal length here.
        np.testing.assert_allclose(depth, expected, rtol=1e-4)

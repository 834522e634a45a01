"""Depth of described ground by rays, without a mesh or a renderer: the first place where a ray is below the heights."""

from __future__ import annotations

from typing import Any

import numpy as np
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.physics.light.directions import camera_axes
from icymoon.support.arrays import Array

#: Distances along a ray, in heights of the camera, at which it is compared with the ground; then bisected.
_STEPS = np.geomspace(0.05, 60.0, 350)
_BISECTIONS = 12


def disparities(ground: Any, rig: Any, columns: int = 40, rows: int = 30) -> Array:
    """True disparity (rows, columns), px of the full image, of ``ground`` (with ``heights``) on a grid over the image.

    NaN where a ray hits no ground, or where the point is outside the image of the right eye.
    """
    camera = StereoCamera.from_settings(rig)
    u, v = np.meshgrid(
        (np.arange(columns) + 0.5) / columns * camera.width_px, (np.arange(rows) + 0.5) / rows * camera.height_px
    )
    rays = np.stack([(u - camera.cx_px) / camera.focal_px, (v - camera.cy_px) / camera.focal_px, np.ones_like(u)], -1)
    toward = rays.reshape(-1, 3) @ camera_axes(rig.heading_deg, rig.pitch_deg).T
    eye = np.array([rig.x_m, rig.y_m, float(ground.heights(rig.x_m, rig.y_m)) + rig.height_m])

    def above(depth: Array) -> Array:
        x, y, z = np.moveaxis(eye + depth[..., None] * (toward if depth.ndim == 1 else toward[:, None]), -1, 0)
        return np.asarray(z - ground.heights(x, y))

    steps = np.broadcast_to(_STEPS * rig.height_m, (len(toward), len(_STEPS)))
    below = above(steps) < 0
    first = below.argmax(axis=1)
    hit = below.any(axis=1) & (first > 0)
    near, far = steps[0][np.maximum(first - 1, 0)], steps[0][first]
    for _ in range(_BISECTIONS):
        middle = (near + far) / 2
        under = above(middle) < 0
        near, far = np.where(under, near, middle), np.where(under, middle, far)
    found = np.where(hit, camera.focal_baseline_px_m / far, np.nan).reshape(u.shape)
    return np.where(found <= u, found, np.nan)

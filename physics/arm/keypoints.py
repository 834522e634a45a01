"""Pixels and visibility of the lander's points in the images of both eyes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from .lander_arm import list_keypoints


def describe_keypoints(
    settings: Settings,
    pads_m: list[float],
    links: Mapping[str, Array],
    eyes: Mapping[str, Array],
    matrix: Array,
    depths: Mapping[str, Array],
) -> list[dict[str, Any]]:
    """Describe the keypoints for ``pair.json``.

    ``links`` are the poses (4, 4) of the links in the world, and ``eyes`` the camera-to-world matrices in OpenCV axes.
    ``matrix`` (3, 3) is the matrix K of both cameras with pixel centres at halves. ``depths`` are the true depths (H,
    W) in metres, NaN for sky. A point in the image is visible unless its pixel shows something that is nearer by more
    than the point's radius.
    """
    found = []
    for name, link, place, radius in list_keypoints(settings, pads_m):
        world = links[link][:3, :3] @ place + links[link][:3, 3]
        entry: dict[str, Any] = {"name": name, "link": link, "position_m": world.tolist()}
        for eye, pose in eyes.items():
            pixel, depth = _project(world, pose, matrix)
            entry[f"{eye}_px"] = pixel
            entry[f"visible_{eye}"] = _is_seen(pixel, depth, radius, depths[eye])
        found.append(entry)
    return found


def _project(world: Array, pose: Array, matrix: Array) -> tuple[list[float] | None, float]:
    """Return the pixel (x, y) of a world point (3,), None behind the eye, and its planar depth in metres."""
    x, y, z = pose[:3, :3].T @ (world - pose[:3, 3])
    if z <= 0:
        return None, float(z)
    u, v, w = matrix @ (x, y, z)
    return [float(u / w), float(v / w)], float(z)


def _is_seen(pixel: list[float] | None, depth: float, radius: float, depths: Array) -> bool:
    """Return whether a point, at most ``radius`` metres behind the surface, is visible at its pixel; ``depth`` is in
    metres.
    """
    if pixel is None:
        return False
    column, row = int(np.floor(pixel[0])), int(np.floor(pixel[1]))
    if not (0 <= row < depths.shape[0] and 0 <= column < depths.shape[1]):
        return False
    there = float(depths[row, column])
    return bool(np.isnan(there) or there >= depth - radius)

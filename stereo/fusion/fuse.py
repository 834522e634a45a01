"""Runs a method on two images: a matcher, range points, or both."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..matchers import get_matcher_title, load_matcher, match_checked
from ..matchers.lidar_options import FILL, LIDAR, PAINT, PICK, SEARCH
from ..matchers.methods import Method
from ..matchers.search_range import AUTO, STATED, STEP_PX, SearchRange
from ..measure.metrics import COSTS
from .choose import choose_disparity
from .guided_search import move_right, restore_disparity
from .interpolate import Interpolation, interpolate
from .paint import paint_points
from .range_points import RangePoints, SeenPair, make_point_generator, make_range_points

#: Options of matchers that state a search range; AUTO takes the range that is given.
_RANGE_OPTIONS = ("disparities", "max_disparity", "min_disparity")


def match_method(
    method: Method,
    left: Array,
    right: Array,
    camera: StereoCamera,
    ranges: Mapping[str, SearchRange],
    pair: SeenPair,
    truth: Array,
) -> tuple[Array, dict[str, Any]]:
    """Return a method's disparity, float32 (H, W) px, NaN where invalid, and the ``info`` of ``match_checked``.

    Range points are samples of the ``truth`` (H, W), planar metres, of a ``pair``, or its scan. ``camera`` converts
    disparities to depths. Raises IcyMoonError as ``match_checked`` and ``range_points`` do.
    """
    info: dict[str, Any]
    if method.lidar is None:
        disparity, _, info = match_checked(method.name, left, right, method.options, camera, ranges)
        return disparity, info
    options = method.lidar
    random = make_point_generator(options["seed"], pair.name)
    points = make_range_points(options, pair, truth, camera, random)
    start, wall = time.process_time(), time.perf_counter()
    interpolation = interpolate(points.column, points.row, points.disparity)
    expected = interpolation.fill(left.shape)
    spent = {"seconds": time.process_time() - start, "wall_seconds": time.perf_counter() - wall}
    facts = {"range_points": len(points.column)}
    if method.name == LIDAR:
        info = {"arrays": {}, "counts": {}, "search": None, "confidence": None, **dict.fromkeys(COSTS), **spent}
        found = expected
    else:
        stereo, info = _match_guided(method, left, right, camera, ranges, points, expected, random)
        start, wall = time.process_time(), time.perf_counter()
        found = _join(options["rule"], stereo, interpolation, expected, points)
        spent["seconds"] += time.process_time() - start
        spent["wall_seconds"] += time.perf_counter() - wall
        info |= {cost: info[cost] + more for cost, more in spent.items() if info.get(cost) is not None}
    stated = {f"lidar.{key}": value for key, value in options.items()}
    info |= {"method": method.name, "options": dict(method.options) | stated, "facts": info.get("facts", {}) | facts}
    info["confidence"] = None  # the matcher's confidence does not describe the joined map
    return np.where(found > 0, found, np.nan).astype(np.float32), info


def _match_guided(
    method: Method,
    left: Array,
    right: Array,
    camera: StereoCamera,
    ranges: Mapping[str, SearchRange],
    points: RangePoints,
    expected: Array,
    random: np.random.Generator,
) -> tuple[Array, dict[str, Any]]:
    """Run the matcher, guided by range points as the option ``guide`` states; return disparity and ``info``."""
    assert method.lidar is not None
    guide, options = method.lidar["guide"], dict(method.options)
    if guide == PAINT:
        left, right = paint_points(left, right, points, method.lidar["patch"], random)
    if guide != SEARCH:
        disparity, _, info = match_checked(method.name, left, right, options, camera, ranges)
        return disparity, info
    if not hasattr(load_matcher(method.name), "settle"):
        raise IcyMoonError(
            f"{get_matcher_title(method.name)} has no search range that points could limit; "
            "give lidar:guide=paint, or leave guide out."
        )
    margin = method.lidar["margin"]
    span = SearchRange(0, STEP_PX * -(-(2 * margin + 1) // STEP_PX) - 1, STATED)
    options |= {key: AUTO for key in _RANGE_OPTIONS if key in options}
    moved = move_right(right, expected, margin)
    # A disparity of 0 is a match here, at the edge of the range, but ``match_checked`` counts it as invalid.
    disparity, _, info = match_checked(method.name, left, moved, options, camera, {AUTO: span})
    return restore_disparity(disparity, expected, margin), info | {"search": None}


def _join(rule: str, stereo: Array, interpolation: Interpolation, expected: Array, points: RangePoints) -> Array:
    if rule == PICK:
        return choose_disparity(stereo, interpolation, expected, points)
    return np.where(np.isfinite(stereo), stereo, expected) if rule == FILL else stereo


def list_lidar_inputs(method: Method, pair: str) -> list[Any]:
    """List the inputs of a pair's range points besides the pair itself: their options, and the size and time of its
    scan.
    """
    if method.lidar is None:
        return []
    scan = Path(method.lidar["returns"]) / pair / "lidar.npz"
    state = scan.stat() if method.lidar["returns"] and scan.is_file() else None
    return [dict(method.lidar), *([state.st_size, state.st_mtime_ns] if state else [])]

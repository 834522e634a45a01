"""The time and memory of a matcher, for the matching alone: without reading the images and loading a network."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from typing import Any

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ..measure.metrics import COSTS
from .result import Result

#: Matches two images of one size with complete options and the camera, if it is known.
Compute = Callable[[Array, Array, Mapping[str, Any], StereoCamera | None], Result]


def match_timed(
    compute: Compute, left: Array, right: Array, options: Mapping[str, Any], camera: StereoCamera | None
) -> tuple[Result, dict[str, float | None]]:
    """Run a matcher's ``compute``; return its result and its ``COSTS``.

    ``seconds`` of CPU time include programs that the matcher started and waited for (except on Windows), and
    ``wall_seconds`` are measured too. Costs that the matcher states itself replace them, such as those from a resident
    program. A cost is None where it is unknown.
    """
    cpu, wall = _read_cpu_seconds(), time.perf_counter()
    result = compute(left, right, options, camera)
    costs = {"seconds": _read_cpu_seconds() - cpu, "wall_seconds": time.perf_counter() - wall}
    return result, {**dict.fromkeys(COSTS), **costs, **result.costs}


def _read_cpu_seconds() -> float:
    """Read the CPU seconds of this process and of the programs that it has waited for (Windows does not count
    these).
    """
    children = os.times()
    return time.process_time() + children.children_user + children.children_system

"""The time that a matcher takes."""

from __future__ import annotations

import time

import numpy as np
from icymoon.stereo.matchers.result import Result
from icymoon.stereo.matchers.timed_match import match_timed
from icymoon.stereo.measure.metrics import COSTS


def _match(compute):
    image = np.zeros((2, 3), np.uint8)
    return match_timed(compute, image, image, {}, None)


def test_sleep_takes_time_but_no_processor():
    def compute(left, right, options, camera):
        time.sleep(0.1)
        return Result(np.ones(left.shape))

    result, costs = _match(compute)
    assert tuple(costs) == COSTS
    assert (result.disparity == 1).all()
    assert costs["wall_seconds"] >= 0.1 > costs["seconds"] >= 0
    assert costs["gpu_seconds"] is costs["gpu_mb"] is costs["memory_mb"] is None


def test_a_matcher_states_the_costs_of_another_process():
    _, costs = _match(lambda left, *rest: Result(left, costs={"seconds": 7.5, "gpu_mb": 12.0}))
    assert (costs["seconds"], costs["gpu_mb"]) == (7.5, 12.0)
    assert 0 <= costs["wall_seconds"] < 5

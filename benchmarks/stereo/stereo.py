"""The cost of an evaluation: CPU seconds for matching, for the exact DOD, and for a whole pair.

    python benchmarks stereo

One synthetic 640 x 480 pair, one thread, the lowest of three runs.
"""

from __future__ import annotations

import argparse
from functools import partial

import numpy as np
import pairs
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.processor import measure_least_seconds
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.depth_order import measure_depth_order_disagreement
from icymoon.stereo.measure.prepare_pair import prepare_pair


def main(options: argparse.Namespace) -> None:
    """Measure and print a table."""
    with scratch() as folder:
        pair = pairs.write_pair(folder / "pair", pairs.Scene(distance_m=3.0), pairs.camera(640, 480), noise=0.02)
        print(f"{'check, read, develop, truth':<40}{measure_least_seconds(lambda: prepare_pair(pair, {})):8.3f} s")
        prepared = prepare_pair(pair, {})
        for method in ("bm", "sgbm"):
            seconds = measure_least_seconds(partial(match, method, prepared.left, prepared.right))
            print(f"{'match ' + method:<40}{seconds:8.3f} s")
        truth = prepared.truth.ravel()
        for name, prediction in (
            ("continuous depths", truth * np.random.default_rng(0).normal(1, 0.02, truth.size)),
            ("1/16 px disparities", 1 / (np.rint(16 * 85.333 / truth) / 16)),
        ):
            seconds = measure_least_seconds(partial(measure_depth_order_disagreement, prediction, truth))
            print(f"{f'exact DOD, {truth.size} px, {name}':<40}{seconds:8.3f} s")
        seconds = measure_least_seconds(lambda: evaluate([pair], parse_methods("bm,sgbm"), folder / "out"))
        print(f"{'evaluate, bm and sgbm, with report':<40}{seconds:8.3f} s")

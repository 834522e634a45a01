"""The cost of an evaluation: CPU seconds for matching, for the exact DOD, and for a whole pair.

    python benchmarks/stereo.py

One synthetic 640 x 480 pair, one thread, the lowest of three runs. Needs ``tests/support/pairs.py``.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
import pairs
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.depth_order import depth_order_disagreement
from icymoon.stereo.measure.prepare import prepare


def cost(work: Callable[[], object]) -> float:
    """CPU seconds of the fastest of three runs."""
    seconds = []
    for _ in range(3):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return min(seconds)


def main() -> None:
    """Measure and print a table."""
    with tempfile.TemporaryDirectory() as folder:
        pair = pairs.write_pair(Path(folder) / "pair", pairs.Scene(distance_m=3.0), pairs.camera(640, 480), noise=0.02)
        print(f"{'check, read, develop, truth':<40}{cost(lambda: prepare(pair, {})):8.3f} s")
        prepared = prepare(pair, {})
        for method in ("bm", "sgbm"):
            print(f"{'match ' + method:<40}{cost(partial(match, method, prepared.left, prepared.right)):8.3f} s")
        truth = prepared.truth.ravel()
        for name, prediction in (
            ("continuous depths", truth * np.random.default_rng(0).normal(1, 0.02, truth.size)),
            ("1/16 px disparities", 1 / (np.rint(16 * 85.333 / truth) / 16)),
        ):
            seconds = cost(partial(depth_order_disagreement, prediction, truth))
            print(f"{f'exact DOD, {truth.size} px, {name}':<40}{seconds:8.3f} s")
        seconds = cost(lambda: evaluate([pair], parse_methods("bm,sgbm"), Path(folder) / "out"))
        print(f"{'evaluate, bm and sgbm, with report':<40}{seconds:8.3f} s")


if __name__ == "__main__":
    main()

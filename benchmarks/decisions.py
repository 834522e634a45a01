"""The cost of decisions on a workspace: CPU seconds for the truth's maps, and for each matcher's.

    python benchmarks/decisions.py

One synthetic 640 x 480 pair, cells of 10 mm on 2.56 m, one thread, the lowest of three runs. The allowance is 2 CPU
seconds a matcher. Needs ``tests/support/pairs.py``.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import timeit
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from icymoon.support.arrays import Array

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
import pairs
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.workspace import Workspace, compare, decide, open_workspace
from icymoon.stereo.matchers import match
from icymoon.stereo.measure.prepare import prepare
from icymoon.stereo.measure.result_row import depth_of

CELLS, CELL_M = 256, 0.01


def write_workspace(folder: Path) -> Path:
    """A pair that looks straight down on a plane, with the true heights of its workspace."""
    rig = pairs.camera(640, 480)
    pairs.write_pair(folder, pairs.Scene(distance_m=2.0, slope_x=0.0, slope_y=0.1), rig, noise=0.02)
    left = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
    right = left.copy()
    right[0, 3] = rig.baseline_m
    half = CELLS * CELL_M / 2
    np.save(folder / "workspace.npy", np.zeros((2, CELLS, CELLS), np.float32))
    data = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    data |= {
        "poses_camera_to_world": {"left": left.tolist(), "right": right.tolist()},
        "light": {"sun": {"direction_to_world": [0.8, 0.0, 0.6]}},
        "workspace": {"file": "workspace.npy", "cell_m": CELL_M, "origin_m": [-half, half], "shape": [CELLS, CELLS]},
    }
    (folder / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    return folder


def cost(work: Callable[[], object]) -> float:
    """CPU seconds of the fastest of three runs."""
    return min(timeit.repeat(work, timer=time.process_time, number=1, repeat=3))


def decide_on(workspace: Workspace, depth: Array) -> None:
    """What a depth decides, beside the truth."""
    compare(workspace, decide(workspace, depth))


def main() -> None:
    """Measure and print a table."""
    rules = read_rules()
    with tempfile.TemporaryDirectory() as folder:
        prepared = prepare(write_workspace(Path(folder) / "pair"), {})
        workspace = open_workspace(prepared, rules)
        print(f"{'maps of the truth':<40}{cost(lambda: open_workspace(prepared, rules)):8.3f} s")
        for method in ("bm", "sgbm", "sgbm_wls", "jplv"):
            run = partial(match, method, prepared.left, prepared.right, {}, prepared.pair.camera)
            depth = depth_of(prepared, run()[0])
            print(f"{'match ' + method:<40}{cost(run):8.3f} s")
            print(f"{'decide and compare, ' + method:<40}{cost(partial(decide_on, workspace, depth)):8.3f} s")


if __name__ == "__main__":
    main()

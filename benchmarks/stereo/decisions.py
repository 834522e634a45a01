"""The cost of decisions on a workspace: CPU seconds for the truth's maps, and for each matcher's.

    python benchmarks decisions

One synthetic 640 x 480 pair, cells of 10 mm on 2.56 m, one thread, the lowest of three runs. The allowance is 2 CPU
seconds a matcher.
"""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np
import pairs
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.processor import measure_least_seconds
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.settings.description import defaults, merged
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.workspace import Workspace, compare_with_truth, decide_from_depth, open_workspace
from icymoon.stereo.matchers import match
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.stereo.measure.row_metrics import disparity_to_depth
from icymoon.support.arrays import Array
from icymoon.support.files import hash_file

CELLS, CELL_M = 256, 0.01


def write_workspace(folder: Path) -> Path:
    """A pair that looks straight down on a plane, with the true heights of its workspace."""
    rig, half = pairs.camera(640, 480), CELLS * CELL_M / 2
    settings = merged(
        defaults(),
        {
            "rig": {"heading_deg": 0.0, "pitch_deg": 90.0},
            "light": {"directions_from": "ANGLES", "sun_elevation_deg": 37.0, "sun_azimuth_deg": 90.0},
            "workspace": {"cell_m": CELL_M, "east_m": 0.0, "north_m": 0.0, "size_m": 2 * half},
        },
    )
    scene = pairs.Scene(distance_m=2.0, slope_x=0.0, slope_y=0.1)
    pairs.write_pair(folder, scene, rig, noise=0.02, settings=settings)
    left = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
    right = left.copy()
    right[0, 3] = rig.baseline_m
    heights = folder / "workspace.npy"
    np.save(heights, np.zeros((2, CELLS, CELLS), np.float32))
    data = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    data["files"][heights.name] = {"bytes": heights.stat().st_size, "sha256": hash_file(heights)}
    data |= {
        "poses_camera_to_world": {"left": left.tolist(), "right": right.tolist()},
        "light": describe_sky(compute_sky(settings.light)),
        "workspace": {"file": heights.name, "cell_m": CELL_M, "origin_m": [-half, half], "shape": [CELLS, CELLS]},
    }
    (folder / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    return folder


def decide_on(workspace: Workspace, depth: Array) -> None:
    """The decisions by a depth, compared with the truth's."""
    compare_with_truth(workspace, decide_from_depth(workspace, depth))


def main(options: argparse.Namespace) -> None:
    """Measure and print a table."""
    rules = read_rules()
    with scratch() as folder:
        prepared = prepare_pair(write_workspace(folder / "pair"), {})
        workspace = open_workspace(prepared, rules)
        print(f"{'maps of the truth':<40}{measure_least_seconds(lambda: open_workspace(prepared, rules)):8.3f} s")
        for method in ("bm", "sgbm", "sgbm_wls", "jplv"):
            run = partial(match, method, prepared.left, prepared.right, {}, prepared.pair.camera)
            depth = disparity_to_depth(prepared, run()[0])
            print(f"{'match ' + method:<40}{measure_least_seconds(run):8.3f} s")
            seconds = measure_least_seconds(partial(decide_on, workspace, depth))
            print(f"{'decide and compare, ' + method:<40}{seconds:8.3f} s")

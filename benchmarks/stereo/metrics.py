"""The cost of metrics compared with matching: every metric at 640 x 480, as a ratio to StereoBM in the same run.

    python benchmarks metrics

CPU seconds are the lowest of three runs in one thread. Memory is the peak that NumPy and Python allocate. Uses one
synthetic pair.
"""

from __future__ import annotations

import argparse
import tracemalloc
from collections.abc import Callable

import numpy as np
import pairs
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.processor import measure_least_seconds
from icymoon.render.pairs.pair_folder import Pair
from icymoon.stereo.export.points import make_measured_points
from icymoon.stereo.images.disparity_and_occlusion import find_visible_in_right
from icymoon.stereo.inference.typical_scene import compare_in_typical_scene
from icymoon.stereo.matchers import match
from icymoon.stereo.measure.by_pixel_class import measure_texture, sum_by_class
from icymoon.stereo.measure.common_pixels import measure_common_pixels
from icymoon.stereo.measure.depth_order import measure_depth_order_disagreement, sample_disagreement
from icymoon.stereo.measure.guiss_reference_code import compute_reference_metrics
from icymoon.stereo.measure.metrics import (
    compute_depth_metrics,
    compute_disparity_metrics,
    compute_error_curve,
    compute_sparsification,
    compute_total_metrics,
    sort_by_confidence,
)
from icymoon.stereo.measure.prepare_pair import load_pair, prepare_pair
from icymoon.stereo.measure.row_metrics import disparity_to_depth, measure_row_numbers


def cost(work: Callable[[], object]) -> tuple[float, float]:
    """(CPU seconds of the fastest of three runs, MiB at the peak of a fourth)."""
    seconds = measure_least_seconds(work)
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return seconds, peak / 2**20


def main(options: argparse.Namespace) -> None:
    """Measure and print a table."""
    with scratch() as folder:
        pair = pairs.write_pair(folder / "pair", pairs.Scene(distance_m=3.0), pairs.camera(640, 480), noise=0.02)
        prepared = prepare_pair(pair, {})
        loaded = load_pair(pair, {})
        assert isinstance(prepared.pair, Pair)
        prepared.pair.data["poses_camera_to_world"] = {"left": np.eye(4).tolist()}
        disparity, _, _ = match("sgbm", prepared.left, prepared.right)
        depth, truth, camera = disparity_to_depth(prepared, disparity), prepared.truth, prepared.pair.camera
        true = camera.disparity(truth)
        both = np.isfinite(depth) & np.isfinite(truth)
        flat, flat_truth = depth[both], truth[both]
        noisy = flat_truth * np.random.default_rng(0).normal(1, 0.02, flat_truth.size)
        error = np.abs(disparity - true)
        differences = np.random.default_rng(0).normal(0, 1, (500, 15))
        works: dict[str, Callable[[], object]] = {
            "StereoBM": lambda: match("bm", prepared.left, prepared.right),
            "SGBM, 8 directions": lambda: match("sgbm", prepared.left, prepared.right),
            "exact DOD, measured disparities": lambda: measure_depth_order_disagreement(flat, flat_truth),
            "exact DOD, continuous depths": lambda: measure_depth_order_disagreement(noisy, flat_truth),
            "DOD, 300 000 pairs": lambda: sample_disagreement(flat, flat_truth, 300_000, np.random.default_rng(0)),
            "depth metrics with exact DOD": lambda: compute_depth_metrics(depth, truth),
            "disparity metrics": lambda: compute_disparity_metrics(disparity, true),
            "missing counted as wrong": lambda: compute_total_metrics(depth, truth, disparity, true, 0.0),
            "reference code's metrics": lambda: compute_reference_metrics(disparity, truth, 4),
            "cumulative error": lambda: compute_error_curve(depth, truth),
            "sparsification": lambda: compute_sparsification(error.ravel()[sort_by_confidence(prepared.gradient)]),
            "errors by stratum": lambda: sum_by_class(
                prepared.cells,
                depth[prepared.known],
                truth[prepared.known],
                disparity[prepared.known],
                true[prepared.known],
            ),
            "texture": lambda: measure_texture(prepared.left),
            "occlusion of one eye": lambda: find_visible_in_right(loaded.depth["left"], loaded.depth["right"], camera),
            "points": lambda: make_measured_points(prepared, disparity),
            "a row, its own numbers": lambda: measure_row_numbers(prepared, disparity),
            "numbers of two methods in common": lambda: measure_common_pixels(
                prepared, {"a": disparity, "b": disparity}
            ),
            "a pair: check, read, develop, classify": lambda: prepare_pair(pair, {}),
            "15 comparisons over 500 scenes": lambda: compare_in_typical_scene(differences, 0),
        }
        print(f"{'':<50}{'CPU s':>9}{'x BM':>8}{'MiB':>8}{'x BM':>8}")
        base: tuple[float, float] | None = None
        for name, work in works.items():
            seconds, memory = cost(work)
            base = base or (seconds, memory)
            print(
                f"{name:<50}{seconds:>9.4f}{seconds / base[0]:>8.1f}{memory:>8.1f}{memory / base[1]:>8.1f}", flush=True
            )

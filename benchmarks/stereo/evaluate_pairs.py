"""Processor seconds of an evaluation, per pair and method, matcher included, and their breakdown.

    python benchmarks evaluate_pairs [--pairs 4] [--methods bm,sgbm] [--profile]

On a 2-core x86 machine under a load of 15 to 25, pairs of 640 x 480 px, bm and sgbm, three runs: 0.50 to 0.58 s, of
which the matchers take 0.10 to 0.14 s; earlier versions took 0.8 to 1.0 s (load of 3) and 2.8 s (6 to 9). Of a pair,
loading and self-check are 0.34 s, and of a method on a pair the metrics 0.23 s and the pictures 0.04 s. The report
takes 2 s once, and 8 s more in a process that has drawn no chart before.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time
from typing import Any

import pairs
from icymoon.benchmarks.common.arguments import scratch
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import parse_methods

#: Functions whose cumulative time is printed: part of the module's path, name.
PARTS = (
    ("measure/prepare_pair.py", "prepare_pair"),
    ("measure/prepare_pair.py", "load_pair"),
    ("matchers/__init__.py", "match_checked"),
    ("measure/row_metrics.py", "measure_row_numbers"),
    ("measure/common_pixels.py", "measure_common_pixels"),
    ("stereo/evaluation_files.py", "write_method_pictures"),
    ("stereo/evaluation_files.py", "write_pair_pictures"),
    ("report/row_log.py", "append"),
    ("report/write_results.py", "write_results"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--pairs", type=int, default=4)
    parser.add_argument("--methods", default="bm,sgbm")
    parser.add_argument("--profile", action="store_true")


def main(options: argparse.Namespace) -> None:
    """Measure and print."""
    methods = parse_methods(options.methods)
    with scratch() as root:
        for k in range(options.pairs + 1):
            pairs.write_pair(
                root / ("first" if k == 0 else "set") / "pairs" / f"p{k}",
                pairs.Scene(distance_m=3.0),
                pairs.camera(640, 480),
                noise=0.02,
            )
        evaluate([root / "first"], methods, root / "warm", jobs=1)  # imports and charts
        profile = cProfile.Profile(time.process_time)
        start = time.process_time()
        if options.profile:
            profile.enable()
        written = []
        evaluate(
            [root / "set"], methods, root / "out", jobs=1, on_event=lambda event: written.append(time.process_time())
        )
        profile.disable()
        measured = written[-1] - start
        whole = time.process_time() - start
    rows = options.pairs * len(methods)
    print(f"measuring  {measured / rows:.3f} CPU-s per pair and method")
    print(f"report     {(whole - measured):.3f} CPU-s once")
    if options.profile:
        stats: Any = pstats.Stats(profile)
        for (file, _, name), (_, _, _, cumulative, _) in stats.stats.items():
            if any(file.endswith(path) and name == wanted for path, wanted in PARTS):
                print(f"  {name:24}{cumulative / rows:8.3f}")

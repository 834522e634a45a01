"""Safe sites that the true depth loses on each pair, by the cells of versions before 0.4 and by today's.

    python benchmarks lost_sites DATASET

With these losses a matcher cannot be blamed. Both columns have the same rules of sites, and differ in [cells] alone.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from icymoon.stereo.decisions.rules import FIRST_CELLS, Rules, read_rules
from icymoon.stereo.decisions.workspace import compare_with_truth, decide_from_depth, open_workspace
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.measure.prepare_pair import PreparedPair


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path, help="data set of pairs with a workspace")


def measure_loss(prepared: PreparedPair, rules: Rules) -> float:
    """The share of the safe sites of a pair that its true depth loses, NaN without a safe site."""
    workspace = open_workspace(prepared, rules)
    lost = compare_with_truth(workspace, decide_from_depth(workspace, prepared.truth))["sites"]["safe_lost"]
    return float("nan") if lost is None else float(lost)


def main(options: argparse.Namespace) -> None:
    """Measure and print a table."""
    today = read_rules()
    both = replace(today, cells=FIRST_CELLS), today
    print(f"{'pair':<20}{'before 0.4':>12}{'today':>12}")
    losses = []
    for source in find_sources([options.dataset]):
        prepared = source.prepare({})
        losses.append([measure_loss(prepared, rules) for rules in both])
        print(f"{source.name:<20}{losses[-1][0]:12.3f}{losses[-1][1]:12.3f}")
    for name, combine in (("mean", np.nanmean), ("largest", np.nanmax)):
        print(f"{name:<20}" + "".join(f"{each:12.3f}" for each in combine(losses, axis=0)))

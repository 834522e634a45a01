"""The cost of a data set besides sampling: memory over many scenes, other processor time, processes.

    python benchmarks besides_sampling           all three
    python benchmarks besides_sampling memory    resident memory over 50 scenes with different ground and rocks
    python benchmarks besides_sampling overhead  processor time of a 64-sample pair of the paper's camera, by stage
    python benchmarks besides_sampling fresh     a data set in one worker, compared with a new Blender for each pair

Prints processor seconds of one run, on one thread. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.own_process import call, work
from icymoon.benchmarks.common.processor import resident_mib
from icymoon.benchmarks.common.renders import render_planned, start_blender
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.plans.render_order import order_pairs
from icymoon.settings import description
from icymoon.settings.pair_ids import make_pair_id

SCENES, WARM_UP = 50, 5
SAMPLES = 64
FRESH_SCENES, FRESH_HEADINGS, FRESH_SAMPLES = 2, 4, 16


def planned(*parts: dict[str, Any]) -> PlannedPair:
    """A pair with changes, on one thread."""
    settings = description.merged(
        description.defaults(), {"quality": {"threads": 1}}, *(description.check(part, "benchmark") for part in parts)
    )
    return PlannedPair(make_pair_id(settings), settings, 0.0)


def rendered(pairs: list[PlannedPair], folder: Path, after: Callable[[], object] = lambda: None) -> list[float]:
    """Render pairs in this process as a worker does, calling ``after`` after each; processor seconds of each."""
    taken = [time.process_time()]

    def say(kind: str, **facts: object) -> None:
        if kind == "pair":
            taken.append(time.process_time())
            after()

    render_planned(pairs, folder, say)
    return np.diff(taken).tolist()


def memory(folder: Path) -> list[str]:
    """Slope of the resident memory over scenes, with one pair each."""
    small = {
        "rig": {"width_px": 64, "height_px": 48},
        "quality": {"samples": 1},
        "rocks": {"coverage": 0.05},
        "mesh": {"kind": "GRID"},
        "terrain": {"resolution": 257},
    }
    laws: tuple[dict[str, Any], ...] = ({}, {"surface": {"model": "HAPKE"}}, {"textures": {"set": "FROST"}})
    pairs = [planned(small, laws[k % len(laws)], {"dataset": {"seed": k}}) for k in range(SCENES)]
    resident: list[float] = []
    rendered(pairs, folder, lambda: resident.append(resident_mib()))
    slope = np.polyfit(np.arange(WARM_UP, SCENES), resident[WARM_UP:], 1)[0]
    return [
        f"memory   {SCENES} scenes: {resident[WARM_UP]:.0f} MiB after {WARM_UP}, {resident[-1]:.0f} MiB at the end, "
        f"{slope:+.2f} MiB per scene"
    ]


class Ledger:
    """Processor seconds by the last activity that Cycles reported, since the last call of ``taken``."""

    #: Activities, and patterns of the status lines that begin them; all work after the saving is this extension's own.
    LINES = (
        ("sampling", r"Sample \d+/(?!1\b)"),
        ("truth's sample", "Sample"),
        ("writing files", "Finished"),
        ("own code", "Saving"),
    )

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._now, self._since = "own code", time.process_time()

    def hear(self, status: str) -> None:
        """Read a status line of Cycles."""
        now = time.process_time()
        self._seconds[self._now] = self._seconds.get(self._now, 0.0) + now - self._since
        self._now = next((name for name, line in self.LINES if re.search(line, status)), "preparing Cycles")
        self._since = now

    def taken(self) -> dict[str, float]:
        """The seconds by activity; starts a new count."""
        self.hear("Saving")
        seconds, self._seconds = self._seconds, {}
        return seconds


def overhead(folder: Path) -> list[str]:
    """Share of the processor time of pairs outside the sampling of light: of a scene's first pair, and of the next."""
    ledger, spent = Ledger(), []
    # Persistent, since every scene is built in a new file.
    bpy.app.handlers.render_stats.append(bpy.app.handlers.persistent(lambda *a: ledger.hear(str(a[0]))))
    pairs = [planned({"quality": {"samples": SAMPLES}, "rig": {"heading_deg": h}}) for h in (0.0, 90.0)]
    rendered(pairs, folder, lambda: spent.append(ledger.taken()))
    lines = []
    for name, seconds in zip(("first", "next"), spent, strict=True):
        total = sum(seconds.values())
        lines.append(
            f"overhead {name:5} pair of a scene, {SAMPLES} samples: {total:.1f} CPU s, of which "
            f"{100 * (1 - seconds['sampling'] / total):.1f} % are not sampling: "
            + ", ".join(f"{part} {seconds[part]:.2f} s" for part in sorted(seconds) if part != "sampling")
        )
    return lines


def fresh(folder: Path) -> list[str]:
    """A data set in one worker, compared with a fresh Blender for each of its pairs, alternating scene by scene."""
    costs = {"one worker": 0.0, "fresh Blenders": 0.0}
    for seed in range(FRESH_SCENES):
        pairs = [
            planned(
                {
                    "quality": {"samples": FRESH_SAMPLES},
                    "dataset": {"seed": seed},
                    "rig": {"heading_deg": 30.0 * k, "width_px": 160, "height_px": 120},
                }
            )
            for k in range(FRESH_HEADINGS)
        ]
        for name, sets in (("one worker", [pairs]), ("fresh Blenders", [[pair] for pair in pairs])):
            for k, some in enumerate(sets):
                dataset = folder / name.split()[0] / f"{seed}_{k}"
                datasets.freeze_plan(dataset, order_pairs(some), "benchmark")
                seconds, status = work(dataset, "--threads-per-worker", "1")
                if status:
                    raise RuntimeError(f"the work on {dataset} ended with status {status}")
                costs[name] += seconds
    return [
        *(
            f"fresh    {FRESH_SCENES} scenes of {FRESH_HEADINGS} pairs, 160 x 120, {FRESH_SAMPLES} samples, {name}: "
            f"{seconds:.1f} CPU s"
            for name, seconds in costs.items()
        ),
        f"fresh    ratio {costs['fresh Blenders'] / costs['one worker']:.2f}",
    ]


PARTS = {"memory": memory, "overhead": overhead, "fresh": fresh}


def lines_of(part: str) -> list[str]:
    """Measure a part in this process; its lines."""
    start_blender()
    with scratch() as folder:
        return PARTS[part](folder)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("part", nargs="?", choices=tuple(PARTS), help="all by default")


def main(options: argparse.Namespace) -> None:
    """Measure each part in a separate process."""
    for part in [options.part] if options.part else PARTS:
        print("\n".join(call(lines_of, part)), flush=True)

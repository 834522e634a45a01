"""Whether runners and workers of a data set with baked light can be killed at any time without loss.

    python benchmarks kill_rounds OUT [--rounds 45] [--seed 1]

Each round starts one or two runners. After a random time one of them, its workers or all get SIGKILL, SIGINT, SIGTERM
or SIGSTOP; a stopped process continues after a while, sometimes after others have taken over its claims, or is killed.
A complete data set loses some pairs, and sometimes its light. At the end one run completes it. The images and the light
must equal the files of a run without interruption, byte for byte, ``verify`` must find nothing, and nothing may be left
over. Prints what was done, and ends with status 1 if something is wrong. Needs Linux and Blender as a module.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from icymoon.benchmarks.common.own_process import list_processes, send_signal
from icymoon.render.plans import frozen_plan
from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.render.plans.render_order import order_pairs
from icymoon.render.workers.pair_claims import CLAIMS_FOLDER, STALE_S
from icymoon.render.workers.verify_dataset import verify_data_set
from icymoon.settings import description

#: Rough Lambert ground in small images, baked with few samples.
BASE: dict[str, Any] = {
    "surface": {"model": "LAMBERT", "albedo": 0.8},
    "dataset": {"headings": 2},
    "terrain": {"size_m": 20.0, "rms_slope_deg": 30.0, "resolution": 65},
    "mesh": {"kind": "GRID"},
    "rig": {"width_px": 96, "height_px": 72},
    "quality": {
        "samples": 4,
        "threads": 1,
        "indirect": "BAKED",
        "bake_samples": 16,
        "bake_noise": 0.0,
        "direct_samples": 2,
    },
}
#: Two pairs share a light, by Sun and ground; those of VIEW have one each. The last is too noisy, so it is traced.
CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"light": {"sun_elevation_deg": 35.0}},
    {"dataset": {"seed": 7}},
    {"quality": {"bake_area": "VIEW"}},
    {"light": {"sun_elevation_deg": 12.0}, "quality": {"bake_noise": 1e-4}},
)
_END_S = 120.0
#: In which share of the stops claims become stale before the process goes on.
_LONG_STOPS = 0.4


def pairs() -> list[PlannedPair]:
    """The planned pairs."""
    return [
        pair
        for change in CHANGES
        for pair in expand_headings(
            description.merged(
                description.defaults(), *(description.check(part, "benchmark") for part in (BASE, change))
            )
        )
    ]


def start(dataset: Path, workers: int) -> subprocess.Popen[bytes]:
    """Start a runner."""
    words = [sys.executable, "-m", "icymoon", "work", str(dataset), "--json", "--workers", str(workers)]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def content(dataset: Path, *patterns: str) -> dict[str, bytes]:
    """The content of the files that match some patterns."""
    return {
        path.relative_to(dataset).as_posix(): path.read_bytes()
        for pattern in patterns
        for path in sorted(dataset.glob(pattern))
    }


def complete(dataset: Path) -> set[str]:
    """The complete pairs."""
    return {path.parent.name for path in dataset.glob("pairs/*/pair.json") if len(path.parent.name) == 12}


def play_round(dataset: Path, choose: random.Random) -> list[str]:
    """Play one round; return its actions in words."""
    count = choose.choice([1, 2])
    runners = [start(dataset, choose.choice([1, 2])) for _ in range(count)]
    time.sleep(choose.uniform(0.2, 9.0))
    hit = runners[0]
    pids = list_processes(hit.pid)
    whom = choose.choice(["all", "runner", "workers"])
    number = choose.choice([signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGSTOP])
    done = [f"{count} runners", whom, number.name]
    targets = {"all": pids, "runner": pids[:1], "workers": pids[1:]}[whom]
    send_signal(targets, number)
    if number == signal.SIGSTOP:
        long = choose.random() < _LONG_STOPS
        time.sleep(STALE_S + 8.0 if long else choose.uniform(0.1, 2.0))
        goes_on = choose.random() < 0.5
        send_signal(targets, signal.SIGCONT if goes_on else signal.SIGKILL)
        done += ["stopped for long"] * long + ["goes on" if goes_on else "killed while stopped"]
    time.sleep(choose.uniform(0.0, 3.0))
    for runner in runners:
        send_signal(list_processes(runner.pid), choose.choice([signal.SIGKILL, signal.SIGINT, signal.SIGTERM]))
    for runner in runners:
        left = list_processes(runner.pid)
        with contextlib.suppress(subprocess.TimeoutExpired):
            runner.wait(10)
        send_signal([*left, *list_processes(runner.pid)], signal.SIGKILL)
        runner.wait(_END_S)
    return done


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path)
    parser.add_argument("--rounds", type=int, default=45)
    parser.add_argument("--seed", type=int, default=1)


def main(options: argparse.Namespace) -> int:
    """Play the rounds and print the faults; status 1 after a fault."""
    choose, planned = random.Random(options.seed), order_pairs(pairs())
    reference, dataset = options.out / "reference", options.out / "killed"
    for folder in (reference, dataset):
        frozen_plan.freeze_plan(folder, planned, "kill rounds")
    if start(reference, 1).wait():
        print("The run without interruption failed.")
        return 1
    faults, counts, lost, removed = [], Counter[str](), 0, 0
    before: set[str] = set()
    for number in range(options.rounds):
        counts.update(play_round(dataset, choose))
        there = complete(dataset)
        lost += len(before - there)
        print(f"round {number + 1}: {len(there)} of {len(planned)} pairs", flush=True)
        if len(there) == len(planned):
            kept = choose.choice([0, 0, 1, 2])
            for name in choose.sample(sorted(there), len(planned) - kept):
                shutil.rmtree(dataset / "pairs" / name)
                removed += 1
            if not kept and choose.random() < 0.5 and (dataset / "light").exists():
                shutil.rmtree(dataset / "light")
        before = complete(dataset)
    if start(dataset, 2).wait():
        faults.append("the last run failed")
    found = verify_data_set(dataset)
    faults += [problem.text for problem in found.problems]
    if lost:
        faults.append(f"{lost} complete pairs were lost")
    if content(dataset, "pairs/*/*.exr") != content(reference, "pairs/*/*.exr"):
        faults.append("images differ from those of the run without interruption")
    if content(dataset, "light/*") != content(reference, "light/*"):
        faults.append("light differs from that of the run without interruption")
    leftovers = [*dataset.rglob("*.part"), *dataset.glob(CLAIMS_FOLDER)]
    faults += [f"{path} is left over" for path in leftovers]
    print(f"{options.rounds} rounds: {', '.join(f'{count} x {what}' for what, count in sorted(counts.items()))}")
    print(
        f"{found.complete} of {found.pairs} pairs whole, {len(content(dataset, 'light/*'))} lights, {removed} pairs "
        f"removed in between and made again, {lost} lost, {len(leftovers)} leftovers, {len(found.problems)} problems"
    )
    for fault in faults:
        print(f"WRONG: {fault}")
    return 1 if faults else 0

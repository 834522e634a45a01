"""The growth of costs with the pairs of a data set: processor seconds and bytes, relative to ten pairs.

    python benchmarks growth [--pairs 10 100 1000] [--evaluate]

Each data set has as many tiny pairs of a plan as ``--pairs`` states. Their images are copies of one, and their
``pair.json`` has the entries of a rendered pair. Columns are: a start of the command line for its help, ``verify``,
``batch`` on the complete data set, one ``work`` shard of it, the job file that has all its pairs (written, read by a
worker, and its bytes), and with ``--evaluate`` ``evaluate --methods bm`` with the bytes of its ``report.json``. Needs
no Blender. Times of commands are of their processes and all that they start.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.processor import measure_all_seconds
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.physics.excavation.camera_jitter import jitter_rig
from icymoon.physics.light.directions import camera_axes
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.render.plans.frozen_plan import freeze_plan
from icymoon.render.plans.plan_file import read_plan
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.plans.render_order import order_pairs
from icymoon.render.workers.job_commands import Job, read_job, read_planned_pairs
from icymoon.support.files import to_json_text
from pairs import Scene, write_pair

#: Pairs of one ground under one Sun.
_HEADINGS = 20


PLAN_TEXT = """dataset.headings = {headings}
[plan]
title = "Growth"
seeds = {seeds}
[terrain]
resolution = 33
[mesh]
kind = "GRID"
[rig]
width_px = 64
height_px = 48
[quality]
samples = 2
"""


def make_eye_poses(pair: PlannedPair) -> dict[str, Any]:
    """The poses of a pair's eyes on ground of height 0."""
    rig, found = jitter_rig(pair.settings), {}
    for eye, along in (("left", 0.0), ("right", rig.baseline_m)):
        axes = camera_axes(rig.heading_deg, rig.pitch_deg)
        place = [rig.x_m, rig.y_m, rig.height_m] + along * axes[:, 0]
        found[eye] = [[*axes[row].tolist(), float(place[row])] for row in range(3)] + [[0.0, 0.0, 0.0, 1.0]]
    return found


def write_dataset(folder: Path, count: int) -> tuple[Path, list[PlannedPair]]:
    """Write a complete data set of this many pairs: its pairs, and its plan beside it."""
    plan = folder.with_suffix(".toml")
    headings = min(count, _HEADINGS)
    plan.write_text(PLAN_TEXT.format(seeds=count // headings, headings=headings), encoding="utf-8")
    read = read_plan(plan)
    pairs = order_pairs(read.pairs())
    freeze_plan(folder, pairs, read.text)
    rig = StereoCamera.from_settings(pairs[0].settings.rig)
    made = write_pair(folder / "one", Scene(), rig, settings=pairs[0].settings)
    record = json.loads((made / "pair.json").read_text(encoding="utf-8"))
    for pair in pairs:
        copy = pair.folder(folder)
        copy.mkdir(parents=True)
        for name in record["files"]:
            shutil.copy(made / name, copy / name)
        poses = make_eye_poses(pair)
        (copy / "pair.json").write_text(
            to_json_text(
                record
                | {
                    "id": pair.id,
                    "settings": pair.settings,
                    "edited_by_hand": False,
                    "own_files_sha256": "",
                    "poses_camera_to_world": poses,
                    "poses_rectified_to_world": poses,
                    "eyes": rig.eyes_json(),
                    "light": describe_sky(compute_sky(pair.settings.light)),
                    "device": pair.settings.quality.device,
                    "seeds": {"dataset": pair.settings.dataset.seed, "render": pair.render_seed},
                }
            ),
            encoding="utf-8",
        )
    shutil.rmtree(made)
    return plan, pairs


def run(*words: object) -> None:
    """Run a command of Icy Moon."""
    subprocess.run(
        [sys.executable, "-m", "icymoon", *map(str, words)],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def measure(folder: Path, count: int, evaluates: bool) -> dict[str, float]:
    """The costs of this many pairs by name, in processor seconds and megabytes."""
    dataset = folder / f"set{count}"
    plan, pairs = write_dataset(dataset, count)
    found = {
        "help": measure_all_seconds(lambda: run("--help")),
        "verify": measure_all_seconds(lambda: run("verify", dataset)),
        "resume": measure_all_seconds(lambda: run("batch", plan, "--out", dataset, "--json")),
        "work": measure_all_seconds(lambda: run("work", dataset, "--json")),
    }
    jobs: list[Job] = []
    found["job out"] = measure_all_seconds(lambda: jobs.append(Job(dataset, pairs=pairs)))
    found["job in"] = measure_all_seconds(lambda: read_planned_pairs(read_job(jobs[0].file)))
    found["job MB"] = jobs[0].file.stat().st_size / 1e6
    jobs[0].discard()
    if evaluates:
        out = folder / f"report{count}"
        found["evaluate"] = measure_all_seconds(
            lambda: run("evaluate", dataset, "--methods", "bm", "--jobs", 1, "--out", out)
        )
        found["report MB"] = (out / "report.json").stat().st_size / 1e6
    shutil.rmtree(dataset)
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--pairs", type=int, nargs="+", default=(10, 100, 1000))
    parser.add_argument("--evaluate", action="store_true")


def main(options: argparse.Namespace) -> None:
    """Print a row for each number of pairs."""
    with scratch() as folder:
        for k, count in enumerate(options.pairs):
            found = measure(folder, count, options.evaluate)
            if k == 0:
                print(f"{'pairs':>6}" + "".join(f"{name:>11}" for name in found))
            print(f"{count:6}" + "".join(f"{value:11.3f}" for value in found.values()), flush=True)

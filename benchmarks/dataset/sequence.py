"""What a sequence costs over a height map of one's own: processor seconds, memory and disk, frame by frame.

    python benchmarks sequence [--frames 100] [--out FOLDER]

A height map of 40 x 40 m, a trajectory of TUM's format across it, and a plan that follows it are written and rendered
at 160 x 120 px with the quality draft, by one worker that is stopped half way and started again. Then the frames are
exported. Columns are: processor seconds of both renders with their starts and builds, of a frame, and of the exports;
the largest memory of the worker at its first and last frame; megabytes; and the largest distance between a pose of the
file and of the export. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
from icymoon.benchmarks.common.arguments import add_out, out_folder
from icymoon.benchmarks.common.processor import seconds_of_all
from icymoon.formats.trajectories import read_trajectory
from icymoon.physics.camera.rotations import quaternion
from icymoon.physics.light.directions import camera_axes

PLAN = """[plan]
title = "A sequence over one height map"
include = ["qualities/draft"]

[source]
kind = "HEIGHT_MAP"
file = "dem.npy"
metres_per_pixel = 0.1
centre = false
origin_x_m = 20.0
origin_y_m = 20.0

[terrain]
size_m = 40.0
resolution = 401

[rig]
width_px = 160
height_px = 120
motion_exposure_s = 0.005

[[sweep]]
kind = "trajectory"
file = "poses.txt"
"""


def write_files(folder: Path, frames: int) -> Path:
    """Write the height map, the trajectory and the plan; the path of the plan."""
    x = np.arange(401) / 10.0
    hills = 0.4 * np.sin(x[None, :] / 2.5) * np.cos(x[:, None] / 3.5) + 0.05 * np.sin(3 * x[None, :] + x[:, None])
    np.save(folder / "dem.npy", hills.astype(np.float32))
    lines = ["# timestamp tx ty tz qx qy qz qw\n"]
    for k in range(frames):
        s = k / 10
        w, *xyz = quaternion(camera_axes(30 * math.sin(s / 3), 45 + 3 * math.cos(s), 2 * math.sin(2 * s)))
        place = (-8 + 0.5 * s, -8 + 1.2 * s, 2.2 + 0.05 * math.sin(s))
        lines.append(" ".join(f"{value:.9f}" for value in (1000 + s, *place, *xyz, w)) + "\n")
    (folder / "poses.txt").write_text("".join(lines), encoding="utf-8")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    return folder / "plan.toml"


def _render(plan: Path, out: Path, stop_at: int) -> None:
    """Render, and interrupt after so many frames."""
    command = [sys.executable, "-m", "icymoon", "batch", str(plan), "--out", str(out), "--workers", "1", "--json"]
    done = 0
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as worker:
        assert worker.stdout is not None
        for line in worker.stdout:
            done += '"type": "pair"' in line
            if done == stop_at:
                worker.terminate()
                break
        worker.stdout.read()


def _export(out: Path, kind: str) -> Path:
    target = out.with_name(f"{out.name}_{kind}")
    shutil.rmtree(target, ignore_errors=True)
    command = [sys.executable, "-m", "icymoon.stereo", "export", str(out), "--format", kind, "--out", str(target)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return target


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--frames", type=int, default=100, help="frames of the sequence (%(default)s)")
    add_out(parser)


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    with out_folder(options.out) as folder:
        plan, out = write_files(folder, options.frames), folder / "sequence"
        rendered = [seconds_of_all(lambda: _render(plan, out, options.frames // 2))]
        rendered.append(seconds_of_all(lambda: _render(plan, out, -1)))
        found = [json.loads(path.read_text(encoding="utf-8")) for path in out.glob("pairs/*/pair.json")]
        found.sort(key=lambda data: data["settings"]["rig"]["frame"])
        prepared = [data["seconds"]["build"] for data in found]
        built = f"{max(prepared):.2f} s to build the scene, {np.median(prepared):.2f} s for another frame of it"
        print(f"{len(found)} frames; {built}")
        print(f"{' + '.join(f'{value:.0f}' for value in rendered)} CPU s with two starts")
        print(f"{np.median([data['cpu_seconds']['pair'] for data in found]):.2f} CPU s a frame (median)")
        peaks = [data["peak_memory_mib"] for data in found]
        print(f"{peaks[0]:.0f} MiB at the first frame, {peaks[-1]:.0f} MiB at the last, {max(peaks):.0f} MiB at most")
        print(f"{sum(path.stat().st_size for path in out.rglob('*') if path.is_file()) / 1e6:.1f} MB")
        for kind in ("tum", "flow"):
            print(f"{seconds_of_all(partial(_export, out, kind)):.1f} CPU s for the export {kind}")
        read, written = (
            read_trajectory(path).poses
            for path in (folder / "poses.txt", out.with_name("sequence_tum") / "0000" / "groundtruth.txt")
        )
        off = np.linalg.norm(read.position_m - written.position_m, axis=1).max()
        turned = np.abs(read.rotation - written.rotation).max()
        print(f"poses within {off:.1e} m, axes within {turned:.1e}, stamps {read.stamp == written.stamp}")

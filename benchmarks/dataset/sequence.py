"""The cost of a sequence over a DEM: processor seconds, memory and disk, with a kill in its middle.

    python benchmarks sequence [--frames 100] [--width 240] [--samples 8] [--out FOLDER]

A GeoTIFF of 100 x 100 m of Europa, a trajectory of TUM's format across it at the height of the paper's camera, and a
plan that follows it with the paper's rig are written. ``icymoon batch`` renders the plan with one worker. Both get
SIGKILL within a frame near the middle and are started again. The ten frames around it are rendered once more without
interruption; their images must be the same, byte for byte. Then the frames are matched and exported, and the exports
are compared with the trajectory and with each other. Prints processor seconds, the workers' resident memory after
frames, megabytes, and differences. Needs Linux, Blender as a module, and the packages rasterio and OpenCV.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import add_out, open_out_folder
from icymoon.benchmarks.common.own_process import list_processes, send_signal
from icymoon.benchmarks.common.processor import measure_all_seconds, resident_mib
from icymoon.formats.trajectories import read_trajectory
from icymoon.physics.camera.rotations import quaternion
from icymoon.physics.light.directions import camera_axes
from icymoon.support.arrays import Array

PLAN = """[plan]
title = "A sequence over one DEM"
include = ["scenes/europa_rough_ice", "rigs/guiss", "qualities/draft"]

[surface]
model = "LAMBERT"

[source]
kind = "HEIGHT_MAP"
file = "dem.tif"
site = "DEGREES"
site_longitude_deg = "30.0"
site_latitude_deg = "-60.0"

[terrain]
size_m = 60.0
resolution = 481

[rocks]
coverage = 0.0

[rig]
width_px = {width}
height_px = {height}
motion_exposure_s = 0.005

[quality]
samples = {samples}
denoiser = "NONE"

[[sweep]]
kind = "trajectory"
file = "poses.txt"
"""
#: Pixels of the DEM and their size, and the standard deviation of its relief.
_DEM_PIXELS, _CELL_M, _RELIEF_M = 401, 0.25, 0.6
#: Height of the camera above the ground along its path, as the paper's is above the mean of its ground.
_HEIGHT_M = 1.6
#: Seconds after which a killed run is started again.
_PAUSE_S = 1.0
_EXPORTS = ("tum", "kitti-odometry", "flow", "ros2")


def make_relief() -> Array:
    """Heights (rows, columns), metres, row 0 in the north, with a median of zero."""
    random = np.random.default_rng(1)
    size = _DEM_PIXELS
    waves = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    waves[0, 0] = 1.0
    field = np.fft.irfft2(np.fft.rfft2(random.standard_normal((size, size))) * waves**-1.8, (size, size))
    return np.asarray(_RELIEF_M * (field - np.median(field)) / field.std())


def write_dem(path: Path, relief_m: Array) -> None:
    """Write a GeoTIFF about 30 degrees east and 60 degrees south on Europa, in a polar stereographic system."""
    import rasterio
    from rasterio.transform import from_origin
    from rasterio.warp import transform

    moon = "+R=1560800 +no_defs"
    system = f"+proj=stere +lat_0=-90 +units=m {moon}"
    (x,), (y,) = transform(f"+proj=longlat {moon}", system, [30.0], [-60.0])
    half = _DEM_PIXELS * _CELL_M / 2
    place = from_origin(x - half, y + half, _CELL_M, _CELL_M)
    size = {"width": _DEM_PIXELS, "height": _DEM_PIXELS, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", driver="GTiff", crs=system, transform=place, **size) as file:
        file.write((relief_m + 1234.0).astype(np.float32), 1)


def make_poses(relief_m: Array, frames: int) -> Iterator[tuple[float, Array, Array]]:
    """Stamp in seconds, position (3,) in metres and axes (3, 3) of each frame: 10 frames per second, over smoothed
    ground."""
    seconds = np.arange(frames) / 10
    x, y = -8 + 0.5 * seconds, -8 + 1.2 * seconds
    row, column = (np.rint(_DEM_PIXELS // 2 + sign * at / _CELL_M).astype(int) for sign, at in ((-1, y), (1, x)))
    ground = np.pad(relief_m[row, column], 15, mode="edge")
    ground = np.convolve(ground, np.full(31, 1 / 31), mode="valid")
    for s, *place in zip(seconds, x, y, ground + _HEIGHT_M, strict=True):
        axes = camera_axes(30 * math.sin(s / 3), 45 + 3 * math.cos(s), 2 * math.sin(2 * s))
        yield 1000 + s, np.array(place), axes


def write_files(folder: Path, options: argparse.Namespace) -> Path:
    """Write the DEM, the trajectory and the plan; return the path of the plan."""
    relief = make_relief()
    write_dem(folder / "dem.tif", relief)
    lines = ["# timestamp tx ty tz qx qy qz qw\n"]
    for stamp, place, axes in make_poses(relief, options.frames):
        w, *xyz = quaternion(axes)
        lines.append(" ".join(f"{value:.9f}" for value in (stamp, *place, *xyz, w)) + "\n")
    (folder / "poses.txt").write_text("".join(lines), encoding="utf-8")
    plan = PLAN.format(width=options.width, height=options.width * 3 // 4, samples=options.samples)
    (folder / "plan.toml").write_text(plan, encoding="utf-8")
    return folder / "plan.toml"


def _render(plan: Path, out: Path, kill_after: int = 0) -> list[tuple[int, float]]:
    """Render; return the worker's process and its resident memory in MiB after each frame. Stop by SIGKILL within the
    frame after the stated number."""
    command = [sys.executable, "-m", "icymoon", "batch", str(plan), "--out", str(out), "--workers", "1", "--json"]
    found: list[tuple[int, float]] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as runner:
        assert runner.stdout is not None
        for line in runner.stdout:
            if '"type": "pair"' not in line:
                continue
            found.append(_find_largest(list_processes(runner.pid)[1:]))
            if len(found) == kill_after:
                time.sleep(_PAUSE_S)
                send_signal(list_processes(runner.pid), signal.SIGKILL)
                break
    return found


def _find_largest(pids: list[int]) -> tuple[int, float]:
    """The process with the largest resident memory, and this memory, MiB."""
    found = [(0, 0.0)]
    for pid in pids:
        with suppress(OSError, StopIteration):  # of one that has ended
            found.append((pid, resident_mib(pid=pid)))
    return max(found, key=lambda each: each[1])


def _print_memory(found: list[tuple[int, float]]) -> None:
    """Print the memory of each worker at its beginning and its end; a worker ends after a part of the frames."""
    for pid in dict.fromkeys(pid for pid, _ in found):
        part = [memory for each, memory in found if each == pid]
        few = min(10, len(part) // 2)
        means = f"{np.mean(part[:few]):.0f} MiB after its first {few}, {np.mean(part[-few:]):.0f} after its last {few}"
        print(f"a worker of {len(part)} frames has {means} (means), {max(part):.0f} at most")


def _render_again(out: Path, again: Path, shard: str) -> tuple[int, int]:
    """Render a shard of a data set again into another folder, without interruption: the number of images, and how many
    of them differ."""
    again.mkdir()
    for name in ("manifest.json", "plan.jsonl"):
        shutil.copy(out / name, again)
    words = [sys.executable, "-m", "icymoon", "work", str(again), "--shard", shard, "--workers", "1", "--json"]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    files = sorted(again.glob("pairs/*/*.exr"))
    return len(files), sum((out / path.relative_to(again)).read_bytes() != path.read_bytes() for path in files)


def _call_stereo(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "icymoon.stereo", *words], check=True, stdout=subprocess.DEVNULL)


def _export(out: Path, kind: str) -> None:
    target = out.with_name(f"{out.name}_{kind}")
    shutil.rmtree(target, ignore_errors=True)
    _call_stereo("export", str(out), "--format", kind, "--out", str(target))


def _measure_mb(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def _print_pairs(out: Path) -> None:
    found: list[dict[str, Any]] = [
        json.loads(path.read_text(encoding="utf-8")) for path in out.glob("pairs/*/pair.json")
    ]
    found.sort(key=lambda data: data["settings"]["rig"]["frame"])
    prepared = [data["seconds"]["build"] for data in found]
    print(
        f"{len(found)} frames; {max(prepared):.2f} s to build the scene, {np.median(prepared):.2f} s for another frame"
    )
    spent = [data["cpu_seconds"]["pair"] for data in found]
    print(f"{sum(spent):.0f} CPU s in frames, {np.median(spent):.2f} a frame (median)")
    peaks = [data["peak_memory_mib"] for data in found]
    print(f"{max(peaks):.0f} MiB at most, within frames; {_measure_mb(out):.1f} MB on disk")


def _print_agreement(folder: Path, out: Path) -> None:
    """Print the agreement of an export's poses and stamps with the file, and of images with the flow between them."""
    read, written = (
        read_trajectory(path).poses
        for path in (folder / "poses.txt", out.with_name(f"{out.name}_tum") / "0000" / "groundtruth.txt")
    )
    off = np.linalg.norm(read.position_m - written.position_m, axis=1).max()
    turned = np.abs(read.rotation - written.rotation).max()
    print(f"poses within {off:.1e} m, axes within {turned:.1e}, stamps {read.stamp == written.stamp}")
    still, warped, seen = compare_with_flow(
        out.with_name(f"{out.name}_tum") / "0000", out.with_name(f"{out.name}_flow") / "0000"
    )
    print(
        f"next frame: off by {still:.1f} grey levels, {warped:.1f} where flow leads (median); {seen:.0%} of pixels seen"
    )


def compare_with_flow(tum: Path, flow: Path) -> tuple[float, float, float]:
    """Median difference in grey levels between a frame and the next one, at the same pixel and where the flow leads;
    and the share of pixels that the next frame shows."""
    import cv2

    images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(float) for path in sorted((tum / "rgb").iterdir())]
    still, warped, seen = [], [], []
    for now, after, path in zip(images, images[1:], sorted(flow.glob("forward_noc/*.png")), strict=False):
        valid, down, right = np.moveaxis(cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32), -1, 0)
        there, moved = valid > 0, (np.stack([right, down], axis=-1) - 2**15) / 64
        rows, columns = np.mgrid[: now.shape[0], : now.shape[1]].astype(np.float32)
        shown = cv2.remap(after, columns + moved[..., 0], rows + moved[..., 1], cv2.INTER_LINEAR)
        still.append(np.median(np.abs(after - now)[there]))
        warped.append(np.median(np.abs(shown - now)[there]))
        seen.append(there.mean())
    return float(np.median(still)), float(np.median(warped)), float(np.mean(seen))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--frames", type=int, default=100, help="frames of the sequence (%(default)s)")
    parser.add_argument("--width", type=int, default=240, help="width of the images in px (%(default)s)")
    parser.add_argument("--samples", type=int, default=8, help="samples of a pixel (%(default)s)")
    add_out(parser)


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    with open_out_folder(options.out) as folder:
        plan, out = write_files(folder, options), folder / "sequence"
        found = _render(plan, out, kill_after=options.frames * 9 // 20)
        print(f"killed after {len(found)} frames")
        found += _render(plan, out)
        _print_pairs(out)
        _print_memory(found)
        count, differ = _render_again(out, folder / "again", "5/10")
        print(f"{differ} of {count} images around the kill differ from those of a run without interruption")
        evaluate = partial(_call_stereo, "evaluate", str(out), "--methods", "sgbm", "--out", str(folder / "results"))
        print(f"{measure_all_seconds(evaluate):.0f} CPU s for SGBM")
        for kind in _EXPORTS:
            spent = measure_all_seconds(partial(_export, out, kind))
            print(f"{spent:.1f} CPU s for the export {kind}, {_measure_mb(out.with_name(f'{out.name}_{kind}')):.1f} MB")
        _print_agreement(folder, out)

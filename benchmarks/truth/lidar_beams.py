"""Rays per second and memory of a LiDAR scan among 16,381 rocks, and the returns that beams of few rays miss.

    python benchmarks lidar_beams [--rays 10000000]

The first part counts all work of a scan in processor seconds: directions, tracing, energies and returns. The second
compares beams of few rays with beams of 2401 rays, among 1500 rocks from a mast of 2 m, with a half-angle of 5 mrad:
the RMS error of a beam's energy, the share of beams with two surfaces of 5 % of the pulse or more that have several
returns, and the share of beams that have several where 2401 rays have one.
"""

from __future__ import annotations

import argparse

from icymoon.benchmarks.common.processor import Stopwatch, peak_mib
from icymoon.physics.lidar.instrument import Instrument, make_pose
from icymoon.physics.lidar.scan_patterns import ScanPattern
from icymoon.rays.engine import open_tracer
from icymoon.rays.lidar import scan
from lidar_beams import HALF_ANGLE_RAD, LAMBERT, MAST_M, compare_with_many_rays
from ray_worlds import block_field

_ROCKS, _HALF_WIDTH_M = 16_381, 40.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rays", type=float, default=1e7, help="rays of a scan (%(default)g)")


def main(options: argparse.Namespace) -> None:
    """Print both tables."""
    world = block_field(_ROCKS, _HALF_WIDTH_M)
    watch = Stopwatch()
    tracer = open_tracer(world)
    print(f"tree of {_ROCKS} rocks: {watch.lap():.2f} CPU s, {peak_mib():.0f} MiB")
    for count in (1, 20, 60):
        each = 1 if count == 1 else count + 1
        side = int((options.rays / each) ** 0.5)
        pattern = ScanPattern("RASTER", side, side, 90, 40, -25)
        instrument = Instrument(pattern, 1e-6, (HALF_ANGLE_RAD / 10,) * 2, 0.02, sub_rays=count)
        watch.lap()
        found = sum(
            len(part) for part in scan(world, tracer, instrument, make_pose((0, 0, MAST_M), (1, 0, 0, 0)), LAMBERT)
        )
        spent, rays = watch.lap(), pattern.count * each
        print(
            f"{count:3} rays a beam: {rays / 1e6:.2f} M rays in {spent:.2f} CPU s, {rays / spent / 1e6:.2f} M a CPU s, "
            f"{found} returns, at most {peak_mib():.0f} MiB",
            flush=True,
        )
    tracer.close()
    pattern = ScanPattern("RASTER", 50, 80, 90, 30, -25)
    for count in (1, 20, 60):
        made = compare_with_many_rays(count, pattern)
        print(
            f"{count:3} rays a beam: energy {made.energy_rms:.1%} RMS, {made.found_share:.0%} of {made.clear} beams "
            f"with two surfaces found, {made.false_share:.2%} false",
            flush=True,
        )

"""Beams of few rays held against beams of 2401 rays, on ground with blocks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from icymoon.physics.lidar.backscatter import tabulate_backscatter
from icymoon.physics.lidar.beam import SubRays, make_sub_rays
from icymoon.physics.lidar.instrument import Instrument, make_pose
from icymoon.physics.lidar.returns import Returns, find_returns, join_returns
from icymoon.physics.lidar.scan_patterns import ScanPattern
from icymoon.physics.surfaces.photometry import lunar_lambert
from icymoon.rays.engine import open_tracer
from icymoon.rays.lidar import trace_beams
from icymoon.support.arrays import Array
from ray_worlds import block_field

LAMBERT = {label: tabulate_backscatter(lunar_lambert(0.7, 0.0)) for label in (1, 2)}
#: Height in metres of the sensor, and the half-angle of its beams at 1/e².
MAST_M, HALF_ANGLE_RAD = 2.0, 5e-3
#: Share of a pulse from which a surface counts that 2401 rays find: the share of one ray of 20.
_CLEAR_SHARE = 0.05


@dataclass(frozen=True)
class Comparison:
    """Of beams of few rays: the RMS of the relative error of a beam's energy; the share of beams with two ``clear``
    surfaces that have several returns; the share of all beams that have several where many rays have one."""

    energy_rms: float
    found_share: float
    false_share: float
    clear: int


def make_many_rays() -> SubRays:
    """2401 rays of equal energy, on a grid of a Gaussian's quantiles."""
    at = np.array([NormalDist().inv_cdf((k + 0.5) / 49) / 2 for k in range(49)])
    grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    grid = grid[np.argsort(np.hypot(*grid.T), kind="stable")]
    return SubRays(np.concatenate([[[0.0, 0.0]], grid]), np.concatenate([[0.0], np.full(len(grid), 1 / len(grid))]))


def _measure(pattern: ScanPattern, rays: SubRays) -> Returns:
    """The returns of all beams from a mast among 1500 blocks."""
    world = block_field(1500, 15)
    instrument = Instrument(pattern, 1e-6, (HALF_ANGLE_RAD, HALF_ANGLE_RAD), 0.02)
    tracer, pose = open_tracer(world), make_pose((0, 0, MAST_M), (1, 0, 0, 0))
    parts = []
    for first in range(0, pattern.count, 100):
        axis = pattern.make_beams(first, first + 100).direction
        echoes = trace_beams(world, tracer, instrument, pose, LAMBERT, axis, rays)
        parts.append(find_returns(echoes, rays, instrument.gate_m, first))
    tracer.close()
    return join_returns(parts)


@lru_cache(1)
def _measure_many(pattern: ScanPattern) -> Returns:
    return _measure(pattern, make_many_rays())


def compare_with_many_rays(count: int, pattern: ScanPattern) -> Comparison:
    """Beams of ``count`` rays against beams of 2401 rays."""
    few, many = _measure(pattern, make_sub_rays(count)), _measure_many(pattern)

    def count_returns(returns: Returns, least_share: float = 0.0) -> Array:
        return np.bincount(returns.beam[returns.share >= least_share], minlength=pattern.count)

    energy = [np.bincount(each.beam, each.energy_j, pattern.count) for each in (few, many)]
    several, clear = count_returns(few) > 1, count_returns(many, _CLEAR_SHARE) > 1
    return Comparison(
        float(np.sqrt(np.mean((energy[0] / energy[1] - 1) ** 2))),
        float((several & clear).sum() / clear.sum()),
        float((several & ~(count_returns(many) > 1)).mean()),
        int(clear.sum()),
    )

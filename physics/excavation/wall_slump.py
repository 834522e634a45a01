"""Parts of standing walls that fail, because the ground is weaker there.

Cohesion varies from place to place. Where a wall is higher than its cohesion holds it (Culmann's critical height, see
``standing_slopes.critical_height_m``), the ground above this height breaks off on Culmann's plane, whose dip is 45
degrees plus half the angle of friction. It becomes spoil, which slides to the angle of friction. The pattern of weak
places is a guess.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ...support.arrays import Array
from ..terrain.noise.lattice_noise import gradient_noise
from .dig_grid import ExcavationGrid
from .scoop_cut import Pull

#: Wavelengths of cohesion over the depth of the trench: of its coarse and its fine part.
_WAVELENGTHS = (2.0, 0.7)
#: Factors on the noise with these wavelengths.
_STRENGTHS = (1.2, 0.4)


def find_retreat_m(depth_m: float, friction_deg: float) -> float:
    """Compute the farthest distance in metres that the upper edge of a wall of this height retreats."""
    return depth_m * math.tan(math.radians(45.0 - friction_deg / 2.0))


def make_strength(grid: ExcavationGrid, depth_m: float, weakening: float, key: int) -> Array:
    """Make a map (rows, columns) of the cohesion over the cohesion of strong ground, from 1 - ``weakening`` to 1."""
    noise = np.zeros((grid.rows, grid.columns))
    for octave, (wave, share) in enumerate(zip(_WAVELENGTHS, _STRENGTHS, strict=True)):
        length = wave * max(depth_m, grid.cell_m)
        east, north = np.broadcast_arrays(grid.east_m[None, :] / length, grid.north_m[:, None] / length)
        noise += share * gradient_noise(east, north, key + octave)
    return np.asarray(1.0 - weakening * np.clip(0.5 + noise, 0.0, 1.0))


def find_failed_m(
    grid: ExcavationGrid,
    before_m: Array,
    ground_m: Array,
    pulls: Iterable[Pull],
    stands_m: Array,
    friction_deg: float,
) -> Array:
    """Find the thickness (rows, columns) in metres of the ground that breaks off the walls of pulls. ``stands_m``
    (rows, columns) is the height up to which a wall stands at each place.
    """
    slope = math.tan(math.radians(45.0 + friction_deg / 2.0))
    failed = np.zeros_like(before_m)
    for pull in pulls:
        window = grid.window(*pull.bounds_m(find_retreat_m(max(float(pull.depth_m.max()), 0.0), friction_deg)))
        out, depth = pull.beside(*grid.points(window))
        left = before_m[window] - depth + stands_m[window] + slope * out
        broken = np.where(out > 0.0, np.maximum(ground_m[window] - left, 0.0), 0.0)
        failed[window] = np.maximum(failed[window], broken)
    return failed

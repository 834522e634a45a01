"""The apron of dust around a heap: fines of the falling spoil that rebound where it lands.

Without air each grain flies on a parabola, however fine it is. Spoil that falls from a height h lands at the speed √(2
g h). A grain rebounds on average with the share e of this speed, in directions as Lambert's law spreads light, and lies
where it lands again on level ground. Its jump is v² sin 2θ / g long, where gravity cancels. The squared speeds are
exponentially distributed about their mean e² · 2 g h, so the longest jump R of a speed has the mean R₀ = 2 e² h. The
density of Lambert's directions is sin 2θ dθ, so grains of one speed land with 1 / (2 π R √(R² - r²)) on a unit of area
at the distance r. The mean of this density over R uses the function of Bickley and Naylor Ki₁:

    Ki₁(r / R₀) / (2 π R₀ r),    Ki₁(x) = ∫₀^(π/2) exp(-x / sin t) dt

(Abramowitz and Stegun 1964, 11.2; the law of landing is derived here.) Its integral over the plane is Ki₂(0) = 1.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ...support.arrays import Array
from .dig_grid import ExcavationGrid

#: Root mean square of the speed of a rebound over the speed of the fall. A guess: loose grains bounce little.
_REBOUND = 0.5
#: Distance at which an apron ends, in mean jumps. Of all grains 2.8 % would land beyond it: Ki₂(3).
_REACH_IN_JUMPS = 3.0
#: Mean of 1 / r over a square around its middle, times its side: 4 ln(1 + √2).
_MEAN_INVERSE_DISTANCE = 4.0 * math.log(1.0 + math.sqrt(2.0))
#: Number of nodes of the quadrature of Ki₁, which is exact to 1e-9 above 0.01.
_NODES = 200


def find_mean_jump_m(drop_m: float) -> float:
    """Compute R₀ in metres of spoil that falls from ``drop_m`` metres."""
    return 2.0 * _REBOUND**2 * drop_m


def find_reach_m(drop_m: float) -> float:
    """Compute the distance in metres from the place of landing at which the apron ends."""
    return _REACH_IN_JUMPS * find_mean_jump_m(drop_m)


def compute_landing_density(distance_m: Array, mean_jump_m: float) -> Array:
    """Compute the share of the grains that land on a square metre, in 1/m², at distances above 0 of any shape."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    angle = 0.25 * math.pi * (nodes + 1.0)
    jumps = np.asarray(distance_m, np.float64) / mean_jump_m
    bickley = np.zeros_like(jumps)
    for sine, weight in zip(np.sin(angle), 0.25 * math.pi * weights, strict=True):
        bickley += weight * np.exp(-jumps / sine)
    return np.asarray(bickley / (2.0 * math.pi * mean_jump_m**2 * jumps))


def spread_dust(grid: ExcavationGrid, landed_m: Array, drop_m: float) -> Array:
    """Compute the thickness (rows, columns) in metres of the dust that rebounds from places where ``landed_m`` (rows,
    columns) landed after a fall of ``drop_m``. Its sum is the sum of ``landed_m``.
    """
    total = float(landed_m.sum())
    if total <= 0.0 or drop_m <= 0.0:
        return landed_m.copy()
    spread = _convolve(landed_m, _make_kernel(grid.cell_m, drop_m, max(landed_m.shape)))
    return np.asarray(spread * (total / float(spread.sum())))


@lru_cache(maxsize=2)  # each state of a series needs the same kernel
def _make_kernel(cell_m: float, drop_m: float, most_cells: int) -> Array:
    """Make the weights (2 n + 1, 2 n + 1) of the cells around a place of landing; they fall continuously to 0 at the
    reach.
    """
    jump, reach = find_mean_jump_m(drop_m), find_reach_m(drop_m)
    n = min(math.ceil(reach / cell_m), most_cells)
    steps = cell_m * np.arange(n + 1)
    away = np.hypot(steps[:, None], steps[None, :])
    away[0, 0] = cell_m / _MEAN_INVERSE_DISTANCE
    quarter = np.maximum(compute_landing_density(away, jump) - compute_landing_density(np.array(reach), jump), 0.0)
    half = np.concatenate([quarter[:0:-1], quarter])
    kernel = np.concatenate([half[:, :0:-1], half], axis=1)
    kernel.flags.writeable = False
    return kernel


def _convolve(values: Array, kernel: Array) -> Array:
    """Convolve two arrays without negative numbers; cut the result to the shape of the first."""
    shape = tuple(a + b - 1 for a, b in zip(values.shape, kernel.shape, strict=True))
    product = np.fft.rfft2(values, shape) * np.fft.rfft2(kernel, shape)
    whole = np.fft.irfft2(product, shape)
    row, column = (side // 2 for side in kernel.shape)
    part = whole[row : row + values.shape[0], column : column + values.shape[1]]
    # Rounding of the transform leaves tiny numbers, of either sign, where no grain lands.
    return np.asarray(np.where(part > 1.0e-12 * float(part.max()), part, 0.0))

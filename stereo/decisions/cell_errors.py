"""Errors of the heights of cells, as a lander can state them.

Heights fill small gaps, a cell with few pixels has an error, and both bias the roughness and the slope of a footprint.
With heights ``z`` of the n cells under a footprint, r̂² their mean square distance from their least-squares plane, and
errors of the variance σ² that are independent from cell to cell,

    E[r̂²] = r² + σ² (1 - 3/n)        a plane has three parameters, which take their share of the errors
    E[ŝ²] = s² + 2 σ² / (n q)         slope s, as rise per metre; q = mean square of a coordinate under the disc

so both are debiased by subtraction. Errors that m neighbouring cells share count as n/m independent ones. A filled cell
lies on a plane through its neighbours and is smoother than the ground. The loss by this smoothing is measured on the
known cells, which the same planes smooth too, and is added to r².
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...support.arrays import Array
from .dem import Dem, Grid
from .footprints import Planes, fit_planes, make_disc, make_ring, sum_under_footprint

#: Diameter of the ring of neighbours that predicts a gap, as a multiple of the gap.
_RING_FACTOR = 3.0
#: Least effective number of cells for which a bias is subtracted in full; three of them determine a plane.
_FEWEST_EFFECTIVE = 4.0


@dataclass(frozen=True)
class CellErrors:
    """Stated errors of the heights of an elevation model, arrays (rows, columns)."""

    variance_m2: Array  # of the measured heights; NaN in cells without a measured height
    shared_cells: Array  # number of neighbouring cells with the same error, 1 or more
    filled: Array  # bool: the cells whose heights are filled
    filled_variance_m2: Array  # of filled heights; NaN elsewhere
    filled_loss_m2: Array  # mean square distance from the footprint's plane that is lost by filling; NaN elsewhere


def state_errors(dem: Dem, variance_m2: Array, shared_cells: Array | None = None) -> CellErrors:
    """Return the errors of an elevation model without filled cells."""
    shape = dem.height_m.shape
    shared = np.ones(shape) if shared_cells is None else np.maximum(shared_cells, 1.0)
    nothing = np.full(shape, np.nan)
    return CellErrors(np.where(dem.known, variance_m2, np.nan), shared, np.zeros(shape, bool), nothing, nothing)


def fill_gaps(dem: Dem, errors: CellErrors, gap_m: float, disc_m: float, most_error_m: float) -> tuple[Dem, CellErrors]:
    """Fill gaps that are at most ``gap_m`` wide between known cells; return the model and its errors.

    A filled height is the value of a plane that is fitted to a ring of known cells, without cells nearer than half the
    gap. Its variance is the larger of two: the mean square error of such planes at the known cells of the footprint
    ``disc_m``, and the mean square residual of the ring, which is larger beside a step. The plane's rise across the gap
    adds to the variance, because a step may lie anywhere in the gap. A gap stays where the standard deviation is above
    ``most_error_m``. Nothing is filled if ``gap_m`` is less than a cell.
    """
    cell = dem.grid.cell_m
    if gap_m < cell * (1 - 1e-9):
        return dem, errors
    reach = int(np.ceil(gap_m / cell / 2 - 1e-9))
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    padded = np.pad(dem.known.astype(np.uint8), 2 * reach)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, square)[2 * reach : -2 * reach, 2 * reach : -2 * reach] > 0
    ring = fit_planes(dem.height_m, cell, shape=make_ring(_RING_FACTOR * gap_m, gap_m, cell))
    predicted = ring.middle_m
    residual = dem.height_m - predicted
    tested = np.isfinite(residual)
    rise = np.hypot(ring.east_slope, ring.north_slope) * gap_m
    variance = np.maximum(_average_values(residual**2, tested, cell, disc_m), ring.roughness_m**2) + rise**2 / 12
    filled = closed & ~dem.known & (variance <= most_error_m**2)
    level = fit_planes(dem.height_m, cell, disc_m).middle_m
    lost = (dem.height_m - level) ** 2 - (predicted - level) ** 2 - np.nan_to_num(errors.variance_m2)
    loss = np.maximum(_average_values(lost, np.isfinite(lost), cell, disc_m), 0.0)
    return (
        replace(dem, height_m=np.where(filled, predicted, dem.height_m)),
        replace(
            errors,
            filled=filled,
            filled_variance_m2=np.where(filled, variance, np.nan),
            filled_loss_m2=np.where(filled, loss, np.nan),
        ),
    )


def measure_sampling_variance(position_m: Array, grid: Grid, disc_m: float) -> Array:
    """Return the variance (rows, columns), m², of a cell's height due to its number of points; NaN without points.

    Points of a view are regular. If a row with k points per cell crosses a slope at any phase, the mean of a cell's
    points has the variance w²/(2k²), on average over k, where w² is the variance of the heights in the cell: a cell
    with fewer points has them nearer to its middle. So with n = k² points per cell, as a mean over the footprint, the
    variance is w²/(2n), and at most w². The variance w² is pooled over the cells of the footprint with two points or
    more.
    """
    shape = grid.rows, grid.columns
    cell = grid.find_cells(position_m)
    inside = cell >= 0
    cell, height = cell[inside], position_m[inside, 2]
    points = np.bincount(cell, minlength=grid.rows * grid.columns).reshape(shape)
    mean = np.bincount(cell, height, points.size) / np.maximum(points.ravel(), 1)
    squares = np.bincount(cell, (height - mean[cell]) ** 2, points.size).reshape(shape)
    disc = make_disc(disc_m, grid.cell_m)
    freedom = np.rint(sum_under_footprint(np.maximum(points - 1, 0).astype(np.float64), disc))
    within = np.maximum(sum_under_footprint(squares, disc), 0.0) / np.maximum(freedom, 1.0)
    density = _average_values(points, np.ones(shape, bool), grid.cell_m, disc_m)
    return np.where(points > 0, within * np.minimum(1.0, 0.5 / np.maximum(density, 0.5)), np.nan)


def debias_planes(planes: Planes, dem: Dem, errors: CellErrors, disc_m: float, share: float = 1.0) -> Planes:
    """Remove the share ``share`` of the bias that errors of the heights give to the roughness and slope of planes.

    The roughness is 0 where the errors alone explain it.
    """
    noise, effective, smoothed = pool_errors(dem, errors, disc_m)
    roughness2 = planes.roughness_m**2 + share * (smoothed - noise * (1 - 3 / effective))
    spread = average_square_coordinate(disc_m, dem.grid.cell_m)
    slope = np.tan(np.radians(planes.slope_deg))
    slope2 = slope**2 - share * 2 * noise / (effective * spread)
    return replace(
        planes,
        slope_deg=np.degrees(np.arctan(np.sqrt(np.maximum(slope2, 0.0)))),
        roughness_m=np.sqrt(np.maximum(roughness2, 0.0)),
    )


def pool_errors(dem: Dem, errors: CellErrors, disc_m: float) -> tuple[Array, Array, Array]:
    """Pool the errors under each footprint. Return three arrays (rows, columns).

    They are the mean variance of the measured heights over all known cells, m²; the effective number of independent
    cells; and the mean square that is lost by filling, m².
    """
    cell, known = dem.grid.cell_m, dem.known
    measured = known & ~errors.filled & np.isfinite(errors.variance_m2)
    count = np.rint(sum_under_footprint(known.astype(np.float64), make_disc(disc_m, cell)))
    shared = _average_values(errors.shared_cells, measured, cell, disc_m)
    effective = np.maximum(count / np.where(np.isfinite(shared), shared, 1.0), _FEWEST_EFFECTIVE)
    noise = _average_values(np.where(measured, errors.variance_m2, 0.0), known, cell, disc_m)
    smoothed = _average_values(np.where(errors.filled, errors.filled_loss_m2, 0.0), known, cell, disc_m)
    return noise, effective, smoothed


def average_square_coordinate(disc_m: float, cell_m: float) -> float:
    """Return the mean square of the east coordinate, m², of the cells of a disc."""
    disc = make_disc(disc_m, cell_m)
    reach = disc.shape[0] // 2
    east = np.arange(-reach, reach + 1) * cell_m
    return float((disc * east**2).sum() / disc.sum())


def _average_values(values: Array, among: Array, cell_m: float, disc_m: float) -> Array:
    """Average values of any size over the cells ``among`` under each footprint; NaN without such cells."""
    disc = make_disc(disc_m, cell_m)
    count = np.rint(sum_under_footprint(among.astype(np.float64), disc))
    total = sum_under_footprint(np.where(among, values, 0.0), disc)
    return np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)

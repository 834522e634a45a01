"""Slope, roughness and shares of the ground under a round footprint around each cell of an elevation model.

Planes are fitted by least squares to the known cells of the footprint, from sums that are filters of the heights. The
sums use coordinates centred on the footprint, so nothing cancels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...support.arrays import Array

#: Fewest known cells of a footprint for a plane.
_FEWEST_PLANE_CELLS = 4
#: Least ratio of the determinant of the cells' spread to its squared trace. Cells along a line determine no plane.
_MIN_SPREAD = 1e-6


@dataclass(frozen=True)
class Planes:
    """Least-squares planes under the footprints: arrays (rows, columns), NaN without a plane."""

    slope_deg: Array
    roughness_m: Array  # root mean square distance of the heights from the plane, along z
    middle_m: Array  # height of the plane at the middle of the footprint
    east_slope: Array  # rise of the plane per metre to the east
    north_slope: Array  # rise of the plane per metre to the north


def make_disc(diameter_m: float, cell_m: float) -> Array:
    """Make a disc as cells with 1.0 inside and 0.0 outside, on a square of an odd number of cells; its centre is
    inside.
    """
    reach = max(0, int(np.floor(diameter_m / 2 / cell_m + 1e-9)))
    north, east = np.mgrid[-reach : reach + 1, -reach : reach + 1] * cell_m
    return np.asarray((east**2 + north**2 <= (diameter_m / 2) ** 2 * (1 + 1e-9)), np.float64)


def make_ring(diameter_m: float, hole_m: float, cell_m: float) -> Array:
    """Make a disc as ``make_disc``, without the smaller disc of diameter ``hole_m`` in its middle."""
    ring, hole = make_disc(diameter_m, cell_m), make_disc(hole_m, cell_m)
    border = (ring.shape[0] - hole.shape[0]) // 2
    ring[border : border + hole.shape[0], border : border + hole.shape[1]] -= hole
    return np.asarray(ring)


def sum_under_footprint(values: Array, weights: Array) -> Array:
    """Sum the values (rows, columns) under the footprint ``weights`` around each cell. Cells beyond the border count as
    0.
    """
    return np.asarray(cv2.filter2D(values.astype(np.float64), cv2.CV_64F, weights, borderType=cv2.BORDER_CONSTANT))


def fit_planes(height_m: Array, cell_m: float, diameter_m: float = 0.0, shape: Array | None = None) -> Planes:
    """Fit a plane by least squares to the known heights in a disc around each cell; NaN with too few heights.

    ``shape``, a square of an odd number of cells with 1.0 inside, replaces the disc.
    """
    shape = make_disc(diameter_m, cell_m) if shape is None else shape
    reach = shape.shape[0] // 2
    v, u = (
        np.mgrid[-reach : reach + 1, -reach : reach + 1] * cell_m
    )  # row 0 is north, so v points south, which leaves slopes the same
    known = np.isfinite(height_m)
    middle = float(np.mean(height_m[known])) if known.any() else 0.0
    mask, z = known.astype(np.float64), np.where(known, height_m - middle, 0.0)
    n, su, sv, suu, suv, svv = (sum_under_footprint(mask, shape * each) for each in (1.0, u, v, u * u, u * v, v * v))
    sz, suz, svz, szz = (
        *(sum_under_footprint(z, shape * each) for each in (1.0, u, v)),
        sum_under_footprint(z * z, shape),
    )
    count = np.maximum(n, 1.0)
    cuu, cuv, cvv = suu - su * su / count, suv - su * sv / count, svv - sv * sv / count
    cuz, cvz, czz = suz - su * sz / count, svz - sv * sz / count, szz - sz * sz / count
    determinant = cuu * cvv - cuv * cuv
    fits = (np.rint(n) >= _FEWEST_PLANE_CELLS) & (determinant > _MIN_SPREAD * (cuu + cvv) ** 2)
    safe = np.where(fits, determinant, 1.0)
    a, b = (cuz * cvv - cvz * cuv) / safe, (cvz * cuu - cuz * cuv) / safe
    residual = np.maximum(czz - a * cuz - b * cvz, 0.0)
    at_centre = (sz - a * su - b * sv) / count + middle
    return Planes(
        *(
            np.where(fits, each, np.nan)
            for each in (np.degrees(np.arctan(np.hypot(a, b))), np.sqrt(residual / count), at_centre, a, -b)
        )
    )


def average_under_footprint(mask: Array, cell_m: float, diameter_m: float, among: Array | None = None) -> Array:
    """Average ``mask`` under each footprint: for a boolean mask, the share of its cells that are true.

    With ``among``, only those cells count, and footprints without such cells are NaN. Cells beyond the border count as
    false.
    """
    shape = make_disc(diameter_m, cell_m)
    if among is None:
        return np.clip(sum_under_footprint(mask.astype(np.float64), shape) / shape.sum(), 0.0, 1.0)
    count = np.rint(sum_under_footprint(among.astype(np.float64), shape))
    total = sum_under_footprint(np.where(among, mask, 0.0), shape)
    return np.clip(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0), 0.0, 1.0)


def measure_distance_to_nearest_m(mask: Array, cell_m: float) -> Array:
    """Measure the distance, m, of each cell's centre to the nearest cell where ``mask`` is true; infinite without such
    cells.
    """
    if not mask.any():
        return np.full(mask.shape, np.inf)
    free = (~mask).astype(np.uint8)
    return np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), np.float64) * cell_m

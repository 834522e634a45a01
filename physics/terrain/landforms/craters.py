"""Small craters: parabolic bowls with raised rims, their sizes a truncated power law.

Most small craters on Europa are secondaries with a steep size law (Bierhaus et al. 2005, Nature 437,
1125). Fresh simple craters are about 0.2 times as deep as wide, from rim to floor, with rims of about 0.04 of
the width (Pike 1977, for the Moon; a hypothesis for metres on ice). Age makes them shallower.
"""

from __future__ import annotations

import math

import numpy as np

from ....settings.topics.landforms import CratersSettings
from ....support.arrays import Array, Numbers
from ....support.errors import IcyMoonError
from ...rocks.size_laws import PowerLaw
from ..roughness.roughness import resolved_share
from .landform import Landform, smooth_step

#: Distance in crater radii at which the ejecta end.
_EJECTA_RADII = 3.0
#: Wavelength that a crater needs of a mesh, over its diameter.
_WAVELENGTH_SHARE = 0.5
#: Distance in crater radii within which older relief is gone; at 1.5 radii it is complete again.
_WIPED_RADII = 0.8


def draw_craters(settings: CratersSettings, random: np.random.Generator, size_m: float) -> Array:
    """Draw centres x, y, diameters and freshness (4, n) of the craters, largest first. They cover the stated share of
    the patch and of a border as wide as the largest crater's ejecta. Raises IcyMoonError for more than ``most``
    craters, or if the smallest diameter is above the largest.
    """
    smallest, largest, index = (float(settings[k]) for k in ("smallest_m", "largest_m", "power_index"))
    if smallest > largest:
        raise IcyMoonError(
            f"craters.smallest_m ({smallest:g} m) is larger than craters.largest_m ({largest:g} m); "
            "lower the first or raise the second."
        )
    side = size_m + _EJECTA_RADII * largest
    sizes = PowerLaw(float(settings.coverage), smallest, largest, index)
    count = sizes.total_per_m2 * side**2
    if count > settings.most:
        raise IcyMoonError(
            f"The craters settings ask for {count:.0f} craters, more than craters.most "
            f"({settings.most}); raise craters.smallest_m or lower craters.coverage or "
            "craters.largest_m."
        )
    n = round(count)
    size = np.sort(sizes.diameter_m(random.random(n) * sizes.total_per_m2))[::-1]
    x, y = random.uniform(-side / 2, side / 2, (2, n))
    return np.stack([x, y, size, random.uniform(settings.freshness, 1.0, n)])


def crater_profile(r: Array, depth: float, rim: float) -> Array:
    """Compute the height at distances ``r`` from the centre in radii; ``depth`` is from rim to floor."""
    beyond = 1.0 / np.maximum(r, 1.0) ** 3
    end = 1.0 / _EJECTA_RADII**3
    outside = rim * np.maximum(beyond - end, 0.0) / (1.0 - end)
    return np.where(r < 1.0, rim - depth * (1.0 - r * r), outside)


def make(settings: CratersSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make craters on the patch; smaller craters lie on larger ones and wipe out their relief. None without
    coverage.
    """
    if settings.coverage == 0.0:
        return None
    x, y, size, fresh = draw_craters(settings, random, size_m)
    bowls = np.stack([size, *(settings[k] * size * fresh for k in ("depth_ratio", "rim_ratio"))], axis=1)
    reach = _EJECTA_RADII * size / 2
    # Beyond the patch its craters come again; the border is so wide that none reaches round onto the patch.
    period = size_m + _EJECTA_RADII * float(settings.largest_m)

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        x_m, y_m, shortest_m = np.broadcast_arrays(x_m, y_m, shortest_m)
        if max(np.abs(x_m).max(), np.abs(y_m).max()) > size_m / 2:
            return beyond(x_m.ravel(), y_m.ravel(), shortest_m.ravel()).reshape(x_m.shape)
        total = np.zeros(x_m.shape)
        near = _reached(x, reach, x_m) & _reached(y, reach, y_m) & (_WAVELENGTH_SHARE * size > shortest_m.min())
        for k in np.flatnonzero(near):
            window = _find_window(x_m, y_m, x[k], y[k], reach[k])
            dx, dy = x_m[window] - x[k], y_m[window] - y[k]
            total[window] += _height_change_m(bowls[k], dx, dy, total[window], shortest_m[window])
        return total

    def beyond(x_m: Array, y_m: Array, shortest_m: Array) -> Array:
        u, v = (np.where(np.abs(a) > size_m / 2, (a + period / 2) % period - period / 2, a) for a in (x_m, y_m))
        order = np.argsort(u, kind="stable")
        u, v, shortest = u[order], v[order], shortest_m[order]
        total = np.zeros(len(u))
        for k in np.flatnonzero(_WAVELENGTH_SHARE * size > shortest.min()):
            for shift in (-period, 0.0, period):
                first, last = np.searchsorted(u, x[k] + shift + np.array([-reach[k], reach[k]]))
                if first < last:
                    dy = v[first:last] - y[k]
                    dy = np.where(np.abs(dy) > period / 2, dy - np.copysign(period, dy), dy)
                    near = np.flatnonzero(np.abs(dy) < reach[k]) + first
                    dx = u[near] - (x[k] + shift)
                    total[near] += _height_change_m(bowls[k], dx, dy[near - first], total[near], shortest[near])
        return total[np.argsort(order)]

    return Landform(math.inf, heights)


def _height_change_m(bowl: Array, dx: Array, dy: Array, before: Array, shortest_m: Array) -> Array:
    """Compute the change in metres, by a crater, of the heights ``before``. ``bowl`` has its diameter, its depth and
    the height of its rim.
    """
    size, depth, rim = bowl
    r = np.sqrt(dx * dx + dy * dy) * (2.0 / size)
    made = crater_profile(r, depth, rim) - before * (1.0 - smooth_step((r - _WIPED_RADII) / (1.5 - _WIPED_RADII)))
    return made * resolved_share(_WAVELENGTH_SHARE * size, shortest_m)


def _reached(centre: Array, reach: Array, points: Array) -> Array:
    """Return whether craters reach the range of the points along one axis."""
    return (centre + reach > points.min()) & (centre - reach < points.max())


def _find_window(x_m: Array, y_m: Array, x: float, y: float, reach: float) -> tuple[slice, slice] | Array:
    """Find the index of the points within a square about a centre; slices if the strides show a grid."""
    if x_m.ndim == 2 and x_m.strides[0] == 0 and y_m.strides[1] == 0:
        return _find_span(y_m[:, 0], y - reach, y + reach), _find_span(x_m[0], x - reach, x + reach)
    return (np.abs(x_m - x) < reach) & (np.abs(y_m - y) < reach)


def _find_span(axis: Array, low: float, high: float) -> slice:
    """Find the slice that contains all values of ``axis`` between two bounds, in any order."""
    inside = np.flatnonzero((axis > low) & (axis < high))
    return slice(inside[0], inside[-1] + 1) if inside.size else slice(0)

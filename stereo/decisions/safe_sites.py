"""Finds the cells where it is safe to sample, by stated rules, from the heights of a workspace.

The truth's map and a matcher's map come from the same function and rules, and differ only in the known heights. Unknown
ground counts as unsafe.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .cell_errors import CellErrors, debias_planes
from .dem import Dem
from .footprints import (
    average_under_footprint,
    fit_planes,
    make_disc,
    measure_distance_to_nearest_m,
    sum_under_footprint,
)
from .materials import Materials
from .rules import SiteRules

#: The code of a cell that fails no rule. Other codes are 1 + the index in ``judge_sites`` of the first failed rule.
SAFE = 0
#: The rules in the order of ``judge_sites``, as keys of tables.
RULE_NAMES = (
    "known",
    "slope",
    "roughness",
    "rocks",
    "reach",
    "light",
    "least_albedo",
    "most_albedo",
    "salts",
)
#: Diameter of the ground around a rock from which its height is measured, as a multiple of the footprint.
_SURROUNDINGS_FACTOR = 2.0
#: Number of fits of the surrounding ground, each without the rocks of the fit before.
_PLANE_FITS = 3


@dataclass(frozen=True)
class SiteLayers:
    """The quantities that the rules limit, arrays (rows, columns), NaN where unknown."""

    known_share: Array
    slope_deg: Array
    roughness_m: Array
    rock_distance_m: Array
    joint_margin_deg: Array
    lit_share: Array
    albedo: Array | None = None  # both None unless a rule needs them
    salt_share: Array | None = None


@dataclass(frozen=True)
class Sites:
    """A suitability map.

    ``margin`` is the smallest distance of a value from its limit over all rules: safe from 0 on, at most 1, minus
    infinity where a value is unknown. Its unit is the limit; for a share above its limit, the unit is the distance of
    the limit from 1. ``failed`` is SAFE or the code of the first rule that fails.
    """

    margin: Array
    failed: Array
    layers: SiteLayers

    @property
    def safe(self) -> Array:
        """The safe cells (rows, columns), bool."""
        return np.asarray(self.failed == SAFE)


def find_rocks(height_m: Array, cell_m: float, rules: SiteRules) -> Array:
    """Find the cells (rows, columns), bool, that rise more than ``rock_height_m`` above the plane of the surrounding
    ground.

    The plane is fitted again without the rocks, so that a rock does not raise its own ground.
    """
    ground = height_m.copy()
    rocks = np.zeros(height_m.shape, bool)
    for _ in range(_PLANE_FITS):
        above = height_m - fit_planes(ground, cell_m, _SURROUNDINGS_FACTOR * rules.disc_m).middle_m
        rocks = above > rules.rock_height_m
        ground = np.where(rocks, np.nan, height_m)
    return rocks


def measure_layers(
    dem: Dem,
    joint_margin_deg: Array,
    lit: Array,
    rules: SiteRules,
    rocks: Array | None = None,
    materials: Materials | None = None,
    errors: CellErrors | None = None,
    debias: float = 0.0,
) -> SiteLayers:
    """Measure the layers of an elevation model that the rules judge.

    ``lit`` (rows, columns) is the share of each cell that is in light, NaN where unknown. ``joint_margin_deg`` is the
    joint margin of the arm with its scoop at the cell, NaN out of reach. ``rocks`` is true in cells with a rock; if it
    is None, rocks are found in the heights. ``materials`` are needed if a rule limits them. With ``errors`` of the
    heights, the share ``debias`` of their effect on roughness and slope is removed.
    """
    cell = dem.grid.cell_m
    planes = fit_planes(dem.height_m, cell, rules.disc_m)
    if errors is not None and debias > 0:
        planes = debias_planes(planes, dem, errors, rules.disc_m, debias)
    rocks = find_rocks(dem.height_m, cell, rules) if rocks is None else rocks
    return SiteLayers(
        average_under_footprint(dem.known, cell, rules.disc_m),
        planes.slope_deg,
        planes.roughness_m,
        measure_distance_to_nearest_m(rocks, cell),
        joint_margin_deg,
        average_under_footprint(lit, cell, rules.disc_m, np.isfinite(lit)),
        *(
            average_under_footprint(values, cell, rules.disc_m, np.isfinite(values))
            for values in ((materials.albedo, materials.salt) if materials is not None else ())
        ),
    )


def judge_sites(layers: SiteLayers, rules: SiteRules) -> Sites:
    """Return the suitability map of layers by rules."""
    margins = [
        _measure_margin_of_share(layers.known_share, rules.known_share),
        _measure_margin_below(layers.slope_deg, rules.slope_deg),
        _measure_margin_below(layers.roughness_m, rules.roughness_m),
        _measure_margin_above(layers.rock_distance_m, rules.rock_distance_m),
        _measure_margin_above(layers.joint_margin_deg, rules.joint_margin_deg),
        _measure_optional_margin(_measure_margin_of_share, layers.lit_share, rules.lit_share or None),
        _measure_optional_margin(_measure_margin_of_share, layers.albedo, rules.least_albedo),
        _measure_optional_margin(_measure_margin_below, layers.albedo, rules.most_albedo),
        _measure_optional_margin(_measure_margin_of_share, layers.salt_share, rules.salt_share),
    ]
    margins = list(np.broadcast_arrays(*margins))
    stack = np.stack([np.where(np.isnan(each), -np.inf, each) for each in margins])
    fails = stack < 0
    return Sites(
        np.minimum(stack.min(axis=0), 1.0),
        np.where(fails.any(axis=0), 1 + fails.argmax(axis=0), SAFE).astype(np.uint8),
        layers,
    )


def _measure_optional_margin(
    margin: Callable[[Array, float], Array], value: Array | None, limit: float | None
) -> Array:
    """Return the margin of a value to a limit: infinite without a limit, NaN without a value."""
    if limit is None:
        return np.array(np.inf)
    return np.array(np.nan) if value is None else margin(value, limit)


def _measure_margin_below(value: Array, limit: float) -> Array:
    return (limit - value) / limit


def _measure_margin_above(value: Array, limit: float) -> Array:
    return (value - limit) / limit


def _measure_margin_of_share(value: Array, limit: float) -> Array:
    """Return the margin of a share: 0 at its ``limit``, 1 at a share of 1.

    In units of the limit, completely known ground would have a margin of 0.11 at a limit of 0.9. This would be the
    smallest margin of all good sites, so it would not rank them.
    """
    room = 1.0 - limit
    return np.where(value < limit, (value - limit) / limit, (value - limit) / room if room > 0 else 1.0 + 0.0 * value)


def choose_site(sites: Sites, among: Array) -> tuple[int, int] | None:
    """Return the row and column of the chosen site: the safe cell ``among`` these with the largest margin.

    Among equal cells, the nearest to the middle of the map is chosen, then the first by row and column. None without a
    safe cell.
    """
    margin = np.where(among & sites.safe, sites.margin, -np.inf)
    if not np.isfinite(margin).any():
        return None
    rows, columns = margin.shape
    row, column = np.nonzero(margin == margin.max())
    far = (row - (rows - 1) / 2) ** 2 + (column - (columns - 1) / 2) ** 2
    k = int(np.argmin(far))
    return int(row[k]), int(column[k])


def find_lit_cells(height_m: Array, cell_m: float, toward_sun: Array) -> Array:
    """Find the cells (rows, columns) from which the middle of the Sun, in this direction of the site, is visible.

    A cell is 1.0 if it is lit, 0.0 if higher ground hides the Sun, NaN if its height is unknown. Heights are linear
    between the middles of neighbouring cells, and a ray is compared with them at each crossing of a row or a column of
    middles. Unknown cells and cells beyond the border cast no shadow.
    """
    east, north, up = (float(each) for each in toward_sun)
    level = float(np.hypot(east, north))
    known = np.isfinite(height_m)
    if up <= 0 or not known.any():
        return np.where(known, 0.0 if up <= 0 else 1.0, np.nan)
    lit = np.ones(height_m.shape, bool)
    if level > 1e-9:
        heights = np.where(known, height_m, -np.inf)
        climb = up / level * cell_m
        reach = float(np.nanmax(height_m) - np.nanmin(height_m)) / climb
        for way, rows, columns in _find_crossings(height_m.shape, (-north / level, east / level), reach):
            lit &= _interpolate_heights(heights, rows, columns) <= heights + climb * way
    return np.where(known, lit.astype(np.float64), np.nan)


def _find_crossings(
    shape: tuple[int, ...], toward: tuple[float, float], reach: float
) -> Iterator[tuple[float, float, float]]:
    """Yield the crossings of a level ray from a cell with rows and columns of the cells' middles.

    A crossing is its distance, row and column from the cell, all in cells. Crossings end at the border of a map of this
    shape or at the distance ``reach``.
    """
    for axis, rate in enumerate(map(abs, toward)):
        if rate > 1e-9:
            for step in range(1, min(shape[axis], int(np.ceil(reach * rate)) + 1)):
                place = [each * step / rate for each in toward]
                place[axis] = round(place[axis])
                yield step / rate, place[0], place[1]


def _interpolate_heights(heights: Array, rows: float, columns: float) -> Array:
    """Interpolate for each cell the height ``rows`` and ``columns`` away, where at least one of the two is a whole
    number.

    The height is linear between two cells, minus infinity if one of them is unknown or beyond the border.
    """
    below = [int(np.floor(each + 1e-9)) for each in (rows, columns)]
    share = max(rows - below[0], columns - below[1])
    first = _shift_cells(heights, *below)
    if share < 1e-9:
        return first
    second = _shift_cells(heights, below[0] + (rows - below[0] >= 1e-9), below[1] + (columns - below[1] >= 1e-9))
    return np.asarray((1 - share) * first + share * second)


def _shift_cells(values: Array, rows: int, columns: int) -> Array:
    """Return for each cell the value of the cell ``rows`` and ``columns`` away; minus infinity beyond the border."""
    result = np.full(values.shape, -np.inf)
    height, width = values.shape
    if abs(rows) < height and abs(columns) < width:
        result[max(0, -rows) : height - max(0, rows), max(0, -columns) : width - max(0, columns)] = values[
            max(0, rows) : height - max(0, -rows), max(0, columns) : width - max(0, -columns)
        ]
    return result


def judge_pads(dem: Dem, diameter_m: float, slope_deg: float, rock_height_m: float, known_share: float) -> Array:
    """Judge a landing pad centred on each cell: 0 fits, 1 unknown, 2 too steep, 3 a rock under it.

    The codes are uint8 (rows, columns). A rock is a part higher than ``rock_height_m`` above the plane under the pad.
    """
    cell = dem.grid.cell_m
    planes = fit_planes(dem.height_m, cell, diameter_m)
    known = average_under_footprint(dem.known, cell, diameter_m) >= known_share
    rocks = dem.height_m - planes.middle_m > rock_height_m
    under = np.rint(sum_under_footprint(rocks.astype(np.float64), make_disc(diameter_m, cell))) > 0
    steep = planes.slope_deg > slope_deg
    return np.where(~known | np.isnan(planes.slope_deg), 1, np.where(steep, 2, np.where(under, 3, 0))).astype(np.uint8)

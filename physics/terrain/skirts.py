"""Skirts: loose material, such as fines or fall-out of a plume, that rests against the feet of rocks.

A skirt is a cone around the outline of its rock. It falls at the angle of repose and is rounded at its foot, so it
joins the ground without a crease. Inside the outline it levels out at once: where a rock leans inward, a cone that went
on would bury its face. A drift is a skirt that slides along the ground behind its rock while its height falls to 0; the
envelope of its positions has a closed form, and is nowhere steeper than the cone.

Where the two highest skirts are nearly equally high, they merge smoothly; a third has no effect. Merged skirts are up
to 1 + ``_MERGED`` / 4 times as steep as one skirt. A single skirt is therefore less steep than repose by that factor,
and no skirts are steeper than repose.

The outline counts as a capsule, a segment with a radius, because its distance is exact. Skirts are added to the ground
and do not follow its small relief. Rocks lie on the ground without skirts, so none climbs on its own skirt.

Angles of repose: about 40 degrees for angular and 25 for rounded grains, the same at 0.1, 0.38 and 1 g; the angle at
which a slope fails is 5 degrees higher at 0.1 g (Kleinhans et al. 2011, J. Geophys. Res. 116, E11004). In snow,
sintering raises it with the temperature, from -40 to -2 °C (Willibald et al. 2020, J. Glaciol. 66). At less than 0.1 g
it is a guess, as are the heights of skirts: no image shows either moon at metres.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...settings.topics.rocks import RocksSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..rocks.beyond_patch import ViewBeyond, make_view_beyond
from ..rocks.own_rock import OWN, find_rock_shapes
from ..rocks.place_rocks import Footprints, draw_footprints, has_file
from .roughness.roughness import resolved_share

#: Height above which a skirt is a cone, over its height at the outline, and how much higher its top is. The foot is
#: concave, as that of an apron; both are guesses.
_FOOT, _TOP = 0.5, 0.25
#: Difference of the heights of two skirts, over their mean, below which they merge.
_MERGED = 0.2


@dataclass(frozen=True)
class _Cells:
    """Skirts (entries,) by square cells ``side_m`` wide, none smaller than a skirt. Cells are numbered modulo
    ``across`` along both axes, so the table is as small as the number of skirts, wherever they lie. The skirts of cell
    k are ``skirts[first[k] : first[k + 1]]``. ``widest_m`` is the largest width of a skirt.
    """

    side_m: float
    across: int
    first: Array
    skirts: Array
    widest_m: float

    def list_pairs(self, x: Array, y: Array, shortest: Array) -> Iterator[tuple[Array, Array]]:
        """Yield indices of points (n,) and of skirts that may reach them, in parts with each point at most once."""
        cell = _number_cells(x, y, self.side_m, self.across)
        start = self.first[cell]
        count = np.where(2.0 * self.widest_m > shortest, self.first[cell + 1] - start, 0)
        points = np.flatnonzero(count)
        for k in range(int(count.max(initial=0))):
            points = points[count[points] > k]
            yield points, self.skirts[start[points] + k]


def _number_cells(x: Array, y: Array, side_m: float, across: int) -> Array:
    column, row = (np.floor(each / side_m).astype(np.int64) & (across - 1) for each in (x, y))
    return row * across + column


@dataclass(frozen=True)
class Skirts:
    """The skirts of ``n`` rocks. All lengths in metres; build them with :func:`make_skirts`.

    ``places_m`` (n, 2) are the centres of capsules, ``along`` (n, 2) the unit vectors of their segments, ``half_m``
    (n,) half the lengths of the segments and ``radius_m`` (n,) their radii; ``height_m`` (n,) are the heights at the
    outlines. ``slope`` is the tangent of a single skirt's slope. ``drift`` is the length of a drift over the width of
    its skirt, and ``lee`` (2,) the unit vector toward which drifts point. A skirt ends within ``reach_m`` (n,) of
    ``middle_m`` (n, 2).
    """

    places_m: Array
    along: Array
    half_m: Array
    radius_m: Array
    height_m: Array
    slope: float
    drift: float
    lee: tuple[float, float]
    middle_m: Array
    reach_m: Array
    cells: tuple[_Cells, ...]

    def heights(self, x_m: Numbers, y_m: Numbers, shortest_m: Numbers = 0.0) -> Array:
        """Compute heights in metres of the skirts above the ground, at east and north coordinates (arrays that
        broadcast).

        A skirt that is too narrow for a mesh with the shortest wavelength ``shortest_m`` (a number, or one per point)
        is lower, or left out, as small landforms are.
        """
        shape = np.broadcast_shapes(np.shape(x_m), np.shape(y_m), np.shape(shortest_m))
        x, y, shortest = (
            np.broadcast_to(np.asarray(each, np.float64), shape).reshape(-1) for each in (x_m, y_m, shortest_m)
        )
        highest, second = np.zeros(x.size), np.zeros(x.size)
        for cells in self.cells:
            for points, skirts in cells.list_pairs(x, y, shortest):
                near = self._is_near(skirts, x[points], y[points])
                points, skirts = points[near], skirts[near]
                rise = self._measure_rise(skirts, x[points], y[points])
                rise *= resolved_share(2.0 * self.height_m[skirts] / self.slope, shortest[points])
                top = highest[points]
                second[points] = np.maximum(second[points], np.minimum(top, rise))
                highest[points] = np.maximum(top, rise)
        return _merge(highest, second).reshape(shape)

    def _is_near(self, skirts: Array, x: Array, y: Array) -> Array:
        """Return whether each point (n,) is in the circle around a skirt, which most points of its cells are not."""
        east, north = x - self.middle_m[skirts, 0], y - self.middle_m[skirts, 1]
        return np.asarray(east * east + north * north < self.reach_m[skirts] ** 2)

    def _measure_rise(self, skirts: Array, x: Array, y: Array) -> Array:
        """Compute the height (n,) of one skirt at each point."""
        height, radius = self.height_m[skirts], self.radius_m[skirts]
        east, north = x - self.places_m[skirts, 0], y - self.places_m[skirts, 1]
        across = self.along[skirts, 0] * north - self.along[skirts, 1] * east
        beyond = np.abs(self.along[skirts, 0] * east + self.along[skirts, 1] * north) - self.half_m[skirts]
        cone = height - self.slope * (np.hypot(np.maximum(beyond, 0.0), across) - radius)
        if self.drift > 1.0:
            behind, beside = self.lee[0] * east + self.lee[1] * north, self.lee[0] * north - self.lee[1] * east
            cone = np.maximum(cone, self._measure_drift(behind, np.abs(beside), radius, height))
        top = (1.0 + _TOP) * height
        return _round_foot(top - _round_foot(top - cone, _TOP * height), _FOOT * height)

    def _measure_drift(self, behind: Array, beside: Array, radius: Array, height: Array) -> Array:
        """Compute the height (n,) of drifts before their feet are rounded: the greatest height of cones around discs of
        this ``radius`` that move up to ``length`` behind the rock, while their height falls to 0.
        """
        length = self.drift * height / self.slope
        cosine = 1.0 / self.drift  # of the angle between the drift and the way to the nearest point of the best disc
        sine = math.sqrt(1.0 - cosine**2)
        rim = np.where(
            beside < radius * sine,
            np.sqrt(np.maximum(radius**2 - beside**2, 0.0)),
            beside * (cosine / sine),
        )
        moved = np.clip((behind - rim) / length, 0.0, 1.0)
        outside = np.maximum(np.hypot(behind - moved * length, beside) - radius, 0.0)
        return np.asarray(height * (1.0 - moved) - self.slope * outside)


def _round_foot(rise: Array, rounded: Array) -> Array:
    """Return the larger of a height and 0, with a parabola in place of the crease where the height is within
    ``rounded``.
    """
    low = np.maximum(rise + rounded, 0.0)
    return np.where(rise >= rounded, rise, low * low / (4.0 * rounded))


def _merge(highest: Array, second: Array) -> Array:
    """Return the larger of two heights, raised smoothly where they are nearly equal; ``highest`` where ``second``
    is 0.
    """
    near = _MERGED / 2.0 * (highest + second)
    over = np.maximum(near - (highest - second), 0.0)
    return np.asarray(highest + over * over / (4.0 * np.where(near > 0.0, near, 1.0)))


def make_skirts(
    rocks: RocksSettings,
    size_m: float,
    seed: int,
    clear_m: tuple[float, float, float],
    beyond: ViewBeyond | None = None,
    most_seen: int | None = None,
) -> Skirts | None:
    """Make the skirts of the rocks that ``scatter_rocks`` places for the same arguments; None if the settings ask for
    none.

    Raises IcyMoonError if a file of the rocks cannot be read.
    """
    if rocks.skirt == 0.0 or rocks.coverage == 0.0:
        return None
    make = _make_skirts if has_file(rocks) or rocks.family == OWN else _make_once
    return make(tuple(rocks.items()), size_m, seed, clear_m, beyond, most_seen)


def make_skirts_of_scene(settings: Settings, seed: int) -> Skirts | None:
    """Make the skirts on the procedural ground of complete settings; None on ground from a file."""
    if settings.source.kind != "PROCEDURAL":
        return None
    rocks, rig = settings.rocks, settings.rig
    clear = float(rig.x_m), float(rig.y_m), float(rocks.clear_radius_m)
    return make_skirts(rocks, float(settings.terrain.size_m), seed, clear, make_view_beyond(settings))


def advise_on_skirts(settings: Settings) -> list[str]:
    """Return a sentence, in a list, if the settings ask for skirts on ground from a file, which has none; else an empty
    list.
    """
    rocks = settings.rocks
    if settings.source.kind == "PROCEDURAL" or rocks.coverage == 0.0 or rocks.skirt == 0.0:
        return []
    return [
        f"rocks.skirt is {rocks.skirt:g}, but ground from a file keeps its heights, so its rocks have no skirts; set "
        "rocks.skirt to 0."
    ]


def _make_skirts(
    values: tuple[tuple[str, Any], ...],
    size_m: float,
    seed: int,
    clear_m: tuple[float, float, float],
    beyond: ViewBeyond | None,
    most_seen: int | None,
) -> Skirts | None:
    rocks = RocksSettings.from_values(values)
    shapes = find_rock_shapes(rocks, seed)
    return build_skirts(draw_footprints(rocks, size_m, seed, shapes, clear_m, beyond, most_seen), rocks)


#: Draws the rocks once for the grounds of one scene, such as those of a check, of a build and of a slider.
_make_once = functools.lru_cache(maxsize=4)(_make_skirts)


def build_skirts(of: Footprints, rocks: RocksSettings) -> Skirts | None:
    """Build the skirts of rocks with these outlines; None without rocks."""
    slope = math.tan(math.radians(rocks.skirt_repose_deg)) / (1.0 + _MERGED / 4.0)
    # Sines and roots differ between machines in the last bit of a double; rounded values do not.
    long, short, height, east, north = (
        each.astype(np.float32).astype(np.float64)
        for each in (*of.half_m.T, rocks.skirt * of.above_m, np.cos(of.turn_rad), np.sin(of.turn_rad))
    )
    if not len(height):
        return None
    toward = math.radians(rocks.skirt_azimuth_deg + 180.0)
    lee = math.sin(toward), math.cos(toward)
    reach = long + (1.0 + _FOOT) * height / slope
    drift = (rocks.skirt_drift - 1.0) * (height / slope)[:, None] * lee
    low, high = (
        of.places_m + sign * reach[:, None] + far(drift, 0.0) for sign, far in ((-1.0, np.minimum), (1.0, np.maximum))
    )
    return Skirts(
        of.places_m,
        np.stack([east, north], axis=1),
        long - short,
        short,
        height,
        slope,
        float(rocks.skirt_drift),
        lee,
        of.places_m + drift / 2.0,
        reach + np.hypot(*drift.T) / 2.0,
        _sort_into_cells(low, high, height / slope),
    )


def _sort_into_cells(low: Array, high: Array, width: Array) -> tuple[_Cells, ...]:
    """Sort skirts within boxes from ``low`` (n, 2) to ``high`` (n, 2) into cells. Each size of boxes, by factors of
    two, has cells that are as large, so that a box meets at most four of them.
    """
    size = np.ceil(np.log2((high - low).max(axis=1))).astype(np.int64)
    found = []
    for exponent in np.unique(size):
        these, side = np.flatnonzero(size == exponent), 2.0 ** float(exponent)
        across = 2 ** math.ceil(math.log2(len(these)) / 2 + 1)
        corners = [(x[these, 0], y[these, 1]) for x in (low, high) for y in (low, high)]
        cell = np.concatenate([_number_cells(*corner, side, across) for corner in corners])
        met, skirt = np.divmod(np.unique(cell * len(size) + np.tile(these, 4)), len(size))
        first = np.searchsorted(met, np.arange(across**2 + 1))
        found.append(_Cells(side, across, first, skirt, float(width[these].max())))
    return tuple(found)

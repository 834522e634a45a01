"""Rocks at rest: they have rolled down slopes that do not hold them, and touch the ground at three points.

A rock rolls along the slope under its footprint, in steps of a quarter of its diameter, until the slope is gentle or
the ground stops falling. The model has no momentum. Rocks that fell down a talus stop within a shadow from which the
line of sight to its head dips at 22 to 30 degrees (from memory: Evans and Hungr 1993, Can. Geotech. J. 30, 620). Both
the driving force and friction are proportional to gravity, so the angle and the places do not depend on it.

Then each large rock sinks and tilts, as quasi-static contact demands. It sinks by the plane that is highest at its
centre, of all planes under the gaps between its points and the ground. This plane passes through three points around
the centre (the facet of the lower convex hull over it), so a rock that can sink no more rests on them.

Last, rocks move apart on the map until their outlines are disjoint, the smaller one away from the larger. Outlines are
convex and bounded in 32 directions, so disjoint ones prove that rocks do not reach into each other.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ...support.arrays import Array

#: Height of the ground in metres at arrays of east and north coordinates; NaN where there is no ground.
HeightAt = Callable[[Array, Array], Array]

#: Points along a side of the grid on which rocks roll.
_GRID_SIDE = 385
#: Step of a rolling rock, over its diameter, and maximum number of steps.
_STEP, _MAX_STEPS = 0.25, 200
#: Radius of the ring on which a rock feels the slope, over its diameter, and number of its points.
_RING_RADIUS, _RING_POINTS = 0.45, 8
#: Largest turn of a rock in one step of its settling, rad, and number of steps.
_LARGEST_TURN_RAD, _SETTLING_STEPS = math.radians(12.0), 12
#: Maximum number of edges over which the search for three points goes.
_MAX_EDGES = 24
#: Number of directions in which outlines are measured.
N_DIRECTIONS = 32
#: Number of points of a rock that may touch the ground.
_TOUCHING_POINTS = 128
#: Number of vertices of a rock from which they are chosen, if it has more.
_VERTICES = 600
#: A rock rests if it could sink or turn no more than this, over its diameter and in rad.
_RESTS_SINK, _RESTS_TURN_RAD = 1.0e-3, math.radians(0.5)
#: Gap between two outlines that were moved apart, over the diameter of the smaller rock, and maximum number of moves.
_GAP, _MAX_MOVES = 0.01, 12


@dataclass(frozen=True)
class _Slopes:
    """Heights (n, n) in metres of the ground on a grid over the patch, from -half to half."""

    height_m: Array
    half_m: float

    def heights(self, x_m: Array, y_m: Array) -> Array:
        """Interpolate the heights at places, linearly between the points of the grid and level beyond it."""
        last = len(self.height_m) - 1
        column, row = (np.clip((a + self.half_m) * (last / (2.0 * self.half_m)), 0.0, last) for a in (x_m, y_m))
        i, j = (np.minimum(a.astype(np.int64), last - 1) for a in (row, column))
        north, east, z = row - i, column - j, self.height_m
        south = z[i, j] + east * (z[i, j + 1] - z[i, j])
        return np.asarray(south + north * (z[i + 1, j] + east * (z[i + 1, j + 1] - z[i + 1, j]) - south))

    def measure(self, places_m: Array, radius_m: Array) -> tuple[Array, Array]:
        """Measure the mean heights (n,) and downward gradients (n, 2) of the ground on rings around places (n, 2)."""
        turn = 2.0 * np.pi / _RING_POINTS * np.arange(_RING_POINTS)
        dx, dy = np.cos(turn) * radius_m[:, None], np.sin(turn) * radius_m[:, None]
        z = self.heights(places_m[:, :1] + dx, places_m[:, 1:] + dy)
        # Least squares on a ring is a projection.
        scale = 2.0 / (_RING_POINTS * radius_m**2)
        return z.mean(axis=1), -np.stack([scale * (z * dx).sum(axis=1), scale * (z * dy).sum(axis=1)], axis=1)


def roll_down(places_m: Array, diameter_m: Array, surface: HeightAt, size_m: float, rolling_deg: float) -> Array:
    """Find the places (n, 2) where rocks of these diameters come to rest that started at ``places_m`` on a patch of
    side ``size_m``. A rock beyond the patch or without ground stays.
    """
    half = size_m / 2
    axis = np.linspace(-half, half, _GRID_SIDE)
    z = surface(*np.broadcast_arrays(axis[None, :], axis[:, None]))
    ground = _Slopes(np.where(np.isnan(z), np.nanmax(z, initial=0.0), z), half)
    places, steepest = places_m.copy(), math.tan(math.radians(rolling_deg))
    rolls = np.flatnonzero(np.abs(places).max(axis=1) < half)
    height, fall = ground.measure(places[rolls], _RING_RADIUS * diameter_m[rolls])
    for _ in range(_MAX_STEPS):
        slope = np.hypot(*fall.T)
        going = slope > steepest
        rolls, height, fall, slope = rolls[going], height[going], fall[going], slope[going]
        if not len(rolls):
            break
        following = places[rolls] + _STEP * diameter_m[rolls, None] * fall / slope[:, None]
        lower, fall = ground.measure(following, _RING_RADIUS * diameter_m[rolls])
        # The edge of the patch stops a rock, as it stops its outline when it is drawn.
        going = (lower < height) & (np.abs(following).max(axis=1) < half - 0.5 * diameter_m[rolls])
        rolls, height, fall = rolls[going], lower[going], fall[going]
        places[rolls] = following[going]
    return places


def settle_poses(points: Array, centre_m: Array, surface: HeightAt) -> tuple[Array, Array]:
    """Find the turns (n, 3, 3) and centres (n, 3) with which rocks rest on the ground, from their ``points`` (n, k, 3)
    relative to the centres (n, 3), all in metres. Rocks turn about their centres and move along the vertical. Where a
    point has no ground it may sink freely.
    """
    turn = np.broadcast_to(np.eye(3), (len(points), 3, 3)).copy()
    centre, size_m = centre_m.copy(), np.abs(points).max(axis=(1, 2))
    going = np.arange(len(points))
    for _ in range(_SETTLING_STEPS):
        plane = find_resting_planes(
            *_measure_gaps(points[going] @ np.swapaxes(turn[going], 1, 2), centre[going], surface)
        )
        steep = np.hypot(plane[:, 1], plane[:, 2])
        angle = np.minimum(np.arctan(steep), _LARGEST_TURN_RAD)
        # Sinking by a + b x + c y is a turn about (-c, b, 0).
        about = np.stack([-plane[:, 2], plane[:, 1]], axis=1) / np.maximum(steep, 1e-12)[:, None]
        turn[going] = _turn_about(about, angle) @ turn[going]
        centre[going, 2] -= plane[:, 0]
        going = going[(np.abs(plane[:, 0]) > _RESTS_SINK * size_m[going]) | (angle > _RESTS_TURN_RAD)]
        if not len(going):
            break
    gap = _measure_gaps(points @ np.swapaxes(turn, 1, 2), centre, surface)[2].min(axis=1)
    centre[:, 2] -= np.where(np.isfinite(gap), gap, 0.0)
    return turn, centre


def _measure_gaps(points: Array, centre: Array, surface: HeightAt) -> tuple[Array, Array, Array]:
    """Measure the heights (n, k) of points above the ground. Return them after the points' east and north (n, k),
    relative to the centres.
    """
    ground = surface(centre[:, :1] + points[..., 0], centre[:, 1:2] + points[..., 1])
    gap = centre[:, 2:] + points[..., 2] - np.where(np.isnan(ground), -np.inf, ground)
    return points[..., 0], points[..., 1], gap


def _turn_about(axis: Array, angle: Array) -> Array:
    """Make rotation matrices (n, 3, 3) about level unit vectors (n, 2), by Rodrigues' formula."""
    x, y, zero = axis[:, 0], axis[:, 1], np.zeros(len(axis))
    rows = [[zero, zero, y], [zero, zero, -x], [-y, x, zero]]
    cross = np.stack([np.stack(row, axis=1) for row in rows], axis=1)
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def find_resting_planes(x_m: Array, y_m: Array, gap_m: Array) -> Array:
    """Find the planes a + b x + c y (n, 3) at or under gaps (n, k) at places (n, k) that are highest at the origin.

    The search starts at the lowest gap and tilts the plane toward the origin until it touches a second and a third
    point. While the origin is outside the triangle of the three points, the plane tilts on about the edge before the
    origin. A rock whose points are all on one side of its centre keeps its last plane.
    """
    points = np.stack([x_m, y_m], axis=2)
    first = gap_m.argmin(axis=1)
    rock = np.arange(len(gap_m))
    plane = np.stack([gap_m[rock, first], np.zeros(len(rock)), np.zeros(len(rock))], axis=1)
    second, plane, going = _tilt(points, gap_m, plane, first, -points[rock, first])
    for _ in range(_MAX_EDGES):
        live = np.flatnonzero(going)
        if not len(live):
            break
        there, one, two = points[live], first[live], second[live]
        start = there[np.arange(len(live)), one]
        edge = there[np.arange(len(live)), two] - start
        across = np.stack([-edge[:, 1], edge[:, 0]], axis=1)
        across *= np.sign(-(across * start).sum(axis=1))[:, None]
        third, tilted, more = _tilt(there, gap_m[live], plane[live], one, across)
        plane[live[more]] = tilted[more]
        first[live], second[live], going[live] = _find_open_edge(there, one, two, np.where(more, third, one), more)
    return plane


def _tilt(points: Array, gap_m: Array, plane: Array, hinge: Array, toward: Array) -> tuple[Array, Array, Array]:
    """Tilt a plane (n, 3) about its point ``hinge``, rising ``toward`` (n, 2). Return the point (n,) that it touches
    next, the tilted plane, and whether there is such a point.
    """
    rock = np.arange(len(gap_m))
    rise = ((points - points[rock, hinge][:, None]) * toward[:, None]).sum(axis=2)
    room = gap_m - (plane[:, :1] + (plane[:, None, 1:] * points).sum(axis=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        tilt = np.where(rise > 1e-9 * np.abs(rise).max(axis=1, keepdims=True), np.maximum(room, 0.0) / rise, np.inf)
    met = tilt.argmin(axis=1)
    amount = tilt[rock, met]
    found = np.isfinite(amount)
    slope = plane[:, 1:] + np.where(found, amount, 0.0)[:, None] * toward
    height = plane[:, 0] + (plane[:, 1:] * points[rock, hinge]).sum(axis=1) - (slope * points[rock, hinge]).sum(axis=1)
    return met, np.column_stack([height, slope]), found


def _find_open_edge(
    points: Array, first: Array, second: Array, third: Array, going: Array
) -> tuple[Array, Array, Array]:
    """Find, for each triangle (n,), the new edge that has the origin on its outer side. Return its two ends, and
    whether there is such an edge.
    """
    rock = np.arange(len(first))
    a, b, c = (points[rock, each] for each in (first, second, third))

    def is_outside(p: Array, q: Array, inner: Array) -> Array:
        cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        side = (q[:, 0] - p[:, 0]) * (inner[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (inner[:, 0] - p[:, 0])
        return np.asarray(cross * side < 0.0)

    beyond_second, beyond_first = is_outside(b, c, a), is_outside(a, c, b)
    goes = going & (beyond_second | beyond_first)
    return np.where(beyond_second, second, first), np.where(goes, third, second), goes


def pick_lowest(points: Array) -> Array:
    """Pick the points (n, 128, 3) of rocks (n, k, 3) that are farthest in directions spread evenly below the horizon,
    which may touch the ground; some may be equal.
    """
    k = np.arange(_TOUCHING_POINTS) + 0.5
    down, turn = k / _TOUCHING_POINTS, np.pi * (1.0 + math.sqrt(5.0)) * k
    level = np.sqrt(1.0 - down * down)
    directions = np.stack([level * np.cos(turn), level * np.sin(turn), -down])
    few = points[:, :: max(1, points.shape[1] // _VERTICES)]
    # Along the last axis, which is many times faster.
    farthest = (np.ascontiguousarray(directions.T) @ np.swapaxes(few, 1, 2)).argmax(axis=2)
    return np.take_along_axis(few, farthest[..., None], axis=1)


def measure_outlines(points: Array) -> Array:
    """Measure the reach (n, 32), m, of the outlines on the map of points (n, k, 3) in 32 directions."""
    turn = 2.0 * np.pi / N_DIRECTIONS * np.arange(N_DIRECTIONS)
    directions = np.stack([np.cos(turn), np.sin(turn)])
    return np.asarray((points[..., :2] @ directions).max(axis=1))


@dataclass
class OutlinesAtRest:
    """Outlines of rocks on the map that do not overlap, found by the square cells into which they reach."""

    side_m: float
    places: list[Array] = field(default_factory=list)
    reach: list[Array] = field(default_factory=list)
    cells: dict[tuple[int, int], list[int]] = field(default_factory=lambda: defaultdict(list))

    def _list_cells(self, place: Array, reach: Array) -> Iterator[tuple[int, int]]:
        quarter = N_DIRECTIONS // 4
        west, south = (math.floor((place[k] - reach[(2 + k) * quarter]) / self.side_m) for k in (0, 1))
        east, north = (math.floor((place[k] + reach[k * quarter]) / self.side_m) for k in (0, 1))
        return ((i, j) for i in range(west, east + 1) for j in range(south, north + 1))

    def add(self, place: Array, reach: Array) -> None:
        """Add an outline."""
        for cell in self._list_cells(place, reach):
            self.cells[cell].append(len(self.places))
        self.places.append(place)
        self.reach.append(reach)

    def find_deepest(self, place: Array, reach: Array) -> Array | None:
        """Find the outline that this outline overlaps most, and return the shortest move (2,) in metres out of it; None
        if it overlaps none.
        """
        near = sorted({k for cell in self._list_cells(place, reach) for k in self.cells.get(cell, ())})
        if not near:
            return None
        turn = 2.0 * np.pi / N_DIRECTIONS * np.arange(N_DIRECTIONS)
        directions = np.stack([np.cos(turn), np.sin(turn)])
        others = np.stack([self.places[k] for k in near])
        apart = (place - others) @ directions - np.stack([self.reach[k] for k in near])
        apart -= np.roll(reach, N_DIRECTIONS // 2)
        best = apart.max(axis=1)
        worst = int(best.argmin())
        if best[worst] >= 0.0:
            return None
        return np.asarray(-best[worst] * directions[:, int(apart[worst].argmax())])


def move_apart(
    places_m: Array, diameter_m: Array, reach_m: Array, outlines: OutlinesAtRest, half_m: float
) -> tuple[Array, Array]:
    """Find places (n, 2) at which outlines with these reaches (n, 32), largest first, overlap neither each other nor
    the ``outlines``, to which they are added. Also return whether each has such a place (n,). Outlines on the square of
    half side ``half_m`` about the origin stay on it.
    """
    places, kept = places_m.copy(), np.zeros(len(places_m), bool)
    for k in range(len(places)):
        at = places[k]
        for _ in range(_MAX_MOVES):
            move = outlines.find_deepest(at, reach_m[k])
            if move is None:
                kept[k] = np.abs(at).max() <= half_m or np.abs(places_m[k]).max() > half_m
                break
            at = at + move * (1.0 + _GAP * diameter_m[k] / max(float(np.hypot(*move)), 1e-9))
        if kept[k]:
            places[k] = at
            outlines.add(at, reach_m[k])
    return places, kept


def find_clear_of(outlines: OutlinesAtRest, places_m: Array, radius_m: Array) -> Array:
    """Return whether each disc (n,) at places (n, 2) is outside all outlines."""
    clear = np.ones(len(places_m), bool)
    order = np.argsort(places_m[:, 0], kind="stable")
    east, widest = places_m[order, 0], float(radius_m.max(initial=0.0))
    turn = 2.0 * np.pi / N_DIRECTIONS * np.arange(N_DIRECTIONS)
    directions = np.stack([np.cos(turn), np.sin(turn)])
    for place, reach in zip(outlines.places, outlines.reach, strict=True):
        far = float(reach.max()) + widest
        near = order[np.searchsorted(east, place[0] - far) : np.searchsorted(east, place[0] + far)]
        near = near[np.abs(places_m[near, 1] - place[1]) < far]
        clear[near] &= ((places_m[near] - place) @ directions - reach).max(axis=1) >= radius_m[near]
    return clear

"""Positions, sizes and poses of rocks that rest on the ground.

Sizes, places and poses come from separate random streams, so that a change in how rocks are buried moves no rock. The
code does not use Blender: the ground is a function of position.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from ...settings.topics.rocks import RocksSettings
from ...support.arrays import Array
from ...support.files import absolute_path
from ..random_numbers.seeds import make_generator
from .beyond_patch import ViewBeyond, draw_beyond
from .debris import Outlines, shed_debris
from .painted_mask import PaintedMask, read_mask
from .rest import (
    N_DIRECTIONS,
    OutlinesAtRest,
    find_clear_of,
    measure_outlines,
    move_apart,
    pick_lowest,
    roll_down,
    settle_poses,
)
from .rock_shapes import RockShape
from .rock_table import TABLE, read_rock_table
from .size_laws import draw_diameters, make_size_law

#: Height of the ground in metres at arrays of east and north coordinates; NaN where there is no ground.
HeightAt = Callable[[Array, Array], Array]

#: Ranks in size at which the level of detail changes: rocks before the first have the finest level.
LEVEL_RANKS = (500, 5000)
_SIZES, _PLACES, _POSES, _BEYOND, _MASK, _DEBRIS = 1, 2, 3, 4, 5, 6  # children of the "rocks" stream; 0 is the shapes'
_PART_STREAMS = ((), (_BEYOND,))  # of the rocks on the patch and beyond it
_VARIATION = 0.15  # standard deviation of ln(elongation) and ln(height), between rocks
_BURIAL_VARIATION = 0.1
_VERTICES_AT_ONCE = 1 << 20
#: Width of the room of a rock at rest, over its outline.
_ROOM = 1.04
#: Number of directions in which the surroundings of a rock are probed for low ground.
_LOW_DIRECTIONS = 8
#: Side of squares whose places share one plane through their surroundings, over the radius.
_LOW_SQUARE = 0.125
#: Least depth of low ground below its surroundings, over their radius.
_LEAST_LOW = 1e-6
#: Number of squares whose surroundings are probed at a time.
_SQUARES_AT_ONCE = 1 << 16
#: A clear circle that removes no rock.
_NO_CIRCLE = 0.0, 0.0, -math.inf


@dataclass(frozen=True)
class Rocks:
    """``n`` rocks: the rocks on the patch, largest first, then the rocks beyond it, largest first, then their debris in
    the same order, from index ``debris_start``. ``position_m`` (n, 3) are the centres, ``rotation`` (n, 3) Euler angles
    XYZ in radians, ``scale_m`` (n, 3) the scale of a shape of unit size; ``level`` and ``shape`` (n,) select the shape.
    ``diameter_m`` (n,) is the diameter of a circle with the covered area, ``reach_m`` (n,) the largest horizontal
    distance from the centre. ``smallest_m`` is the smallest diameter that could be drawn, and ``debris_smallest_m`` of
    debris, 0 without debris; a limit on the number raises it above the setting. ``beyond_rad`` is the least apparent
    width of rocks beyond the patch, 0 without such rocks. ``crowded_out`` rocks found no room at rest.
    """

    position_m: Array
    rotation: Array
    scale_m: Array
    level: Array
    shape: Array
    diameter_m: Array
    reach_m: Array
    smallest_m: float = 0.0
    beyond_rad: float = 0.0
    debris_smallest_m: float = 0.0
    debris_start: int = 0
    crowded_out: int = 0


@dataclass(frozen=True)
class Footprints:
    """The outlines on the map of ``n`` rocks before they lie on a ground, as ellipses. ``places_m`` (n, 2) are their
    centres, ``half_m`` (n, 2) the longer and the shorter half axis, ``turn_rad`` (n,) the direction of the longer axis
    from east over north, and ``above_m`` (n,) the height of each rock above level ground.
    """

    places_m: Array
    half_m: Array
    turn_rad: Array
    above_m: Array


@dataclass(frozen=True)
class _LooseRocks:
    """``n`` rocks before they lie on a ground: ``places_m`` (n, 2), ``burial`` (n,), the buried share of the thickness,
    ``rotation`` (n, 3, 3) on level ground, and the arrays of ``Rocks``."""

    places_m: Array
    diameter_m: Array
    level: Array
    shape: Array
    scale_m: Array
    burial: Array
    rotation: Array


@dataclass(frozen=True)
class _Drawn:
    """The rocks on the patch and those beyond it, if there are any, in one part or two, their debris in the same parts
    or none, the places (n, 2) of the rocks that shed each fragment, and the numbers of ``Rocks``."""

    parts: tuple[_LooseRocks, ...]
    debris: tuple[_LooseRocks, ...]
    shed_at_m: tuple[Array, ...]
    smallest_m: float
    beyond_rad: float
    debris_smallest_m: float


#: Rocks before or after they lie on a ground.
_Some = TypeVar("_Some", Rocks, _LooseRocks)


def draw_places(rocks: RocksSettings, n: int, size_m: float, random: np.random.Generator) -> Array:
    """Draw positions (n, 2) in metres on a square patch centred on the origin.

    A share ``clustering`` of the rocks belongs to a Thomas process: clusters are at random places, and each rock is at
    a normally distributed distance from a random cluster (Thomas 1949, Biometrika 36). Positions beyond one side of the
    patch enter at the opposite side, so the density is even.
    """
    where = random.uniform(-size_m / 2, size_m / 2, (n, 2))
    clusters = max(1, round(n * rocks.clustering / rocks.cluster_blocks))
    centres = random.uniform(-size_m / 2, size_m / 2, (clusters, 2))
    member = random.random(n) < rocks.clustering
    of = centres[random.integers(0, clusters, n)] + random.normal(0.0, rocks.cluster_radius_m, (n, 2))
    return np.mod(np.where(member[:, None], of, where) + size_m / 2, size_m) - size_m / 2


def _rotation_about(axis: int, angle: Array) -> Array:
    """Make rotation matrices (n, 3, 3) about a coordinate axis."""
    turned = np.zeros((len(angle), 3, 3))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turned[:, axis, axis] = 1.0
    turned[:, a, a] = turned[:, b, b] = np.cos(angle)
    turned[:, b, a] = np.sin(angle)
    turned[:, a, b] = -turned[:, b, a]
    return turned


def _rotation_from_vertical(normal: Array) -> Array:
    """Make the smallest rotations (n, 3, 3) from the vertical to unit vectors (n, 3) above the horizon."""
    nx, ny, nz = normal.T
    k = 1.0 / (1.0 + nz)
    rows = [[1.0 - k * nx * nx, -k * nx * ny, nx], [-k * nx * ny, 1.0 - k * ny * ny, ny], [-nx, -ny, nz]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def euler_xyz(rotation: Array) -> Array:
    """Compute the angles (n, 3) in radians of rotation matrices (n, 3, 3) that turn about x, then y, then z."""
    # Copies: of a strided view numpy takes now one, now another routine, as the result happens to lie in memory,
    # and they differ in the last bit.
    r = np.ascontiguousarray(np.moveaxis(rotation, 0, -1))
    return np.stack(
        [np.arctan2(r[2, 1], r[2, 2]), np.arcsin(np.clip(-r[2, 0], -1.0, 1.0)), np.arctan2(r[1, 0], r[0, 0])], axis=1
    )


def euler_matrices(angles: Array) -> Array:
    """Make rotation matrices (n, 3, 3) that turn by angles (n, 3) in radians about x, then y, then z."""
    return _rotation_about(2, angles[:, 2]) @ _rotation_about(1, angles[:, 1]) @ _rotation_about(0, angles[:, 0])


def make_instance_matrices(position: Array, rotation: Array, scale: Array) -> Array:
    """Make the matrices (n, 4, 4) of instances from positions, Euler angles in radians and scales, all (n, 3)."""
    matrices = np.tile(np.eye(4), (len(position), 1, 1))
    matrices[:, :3, :3] = euler_matrices(rotation) * scale[:, None, :]
    matrices[:, :3, 3] = position
    return matrices


def _measure_footprint_ground(xy: Array, radius: Array, surface: HeightAt) -> tuple[Array, Array]:
    """Measure the ground under footprints. Return its unit normals (n, 3), and the height (n,) at their centres of
    planes with these normals through the deepest sampled point; NaN if the centre is off the ground.
    """
    ring = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    dx, dy = (np.append(f(ring), 0.0) * radius[:, None] for f in (np.cos, np.sin))
    z = surface(xy[:, :1] + dx, xy[:, 1:] + dy)
    z = np.where(np.isnan(z), z[:, -1:], z)  # beyond the edge of the ground: level
    # Least squares on a ring is a projection: sum(cos²) over its eight points is 4.
    east, north = ((z * d).sum(axis=1) / (4 * radius**2) for d in (dx, dy))
    normal = np.stack([-east, -north, np.ones_like(east)], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[np.isnan(normal[:, 2])] = [0.0, 0.0, 1.0]
    return normal, (z - east[:, None] * dx - north[:, None] * dy).min(axis=1)


def _group_by_shape(
    level: Array, shape: Array, shapes: Sequence[Sequence[RockShape]]
) -> Iterator[tuple[RockShape, Array]]:
    """Yield each shape with the indices of rocks that have it, some at a time, because the vertices of all would not
    fit into memory.
    """
    for kind in np.unique(np.stack([level, shape], 1), axis=0):
        these, found = np.flatnonzero((level == kind[0]) & (shape == kind[1])), shapes[kind[0]][kind[1]]
        step = max(1, _VERTICES_AT_ONCE // len(found.vertices))
        for start in range(0, len(these), step):
            yield found, these[start : start + step]


def _measure_extent(
    rotation: Array,
    scale: Array,
    level: Array,
    shape: Array,
    normal: Array,
    shapes: Sequence[Sequence[RockShape]],
) -> tuple[Array, Array, Array]:
    """Measure rotated rocks, all in metres: the vertex (n, 3) deepest along the ground's normal, relative to the
    centre; the thickness (n,) along the normal; and the horizontal reach (n,).
    """
    deepest, thickness, reach = np.empty((len(shape), 3)), np.empty(len(shape)), np.empty(len(shape))
    for kind, these in _group_by_shape(level, shape, shapes):
        points = (rotation[these] * scale[these, None, :]) @ kind.vertices.T
        along = np.einsum("nk,nkv->nv", normal[these], points)
        lowest = along.argmin(axis=1)
        deepest[these] = points[np.arange(len(these)), :, lowest]
        thickness[these] = along.max(axis=1) - along.min(axis=1)
        reach[these] = np.sqrt((points[:, :2] ** 2).sum(axis=1).max(axis=1))
    return deepest, thickness, reach


def scatter_rocks(
    rocks: RocksSettings,
    size_m: float,
    seed: int,
    surface: HeightAt,
    shapes: Sequence[Sequence[RockShape]],
    clear_m: tuple[float, float, float],
    beyond: ViewBeyond | None = None,
    most_seen: int | None = None,
    skirted: HeightAt | None = None,
) -> Rocks:
    """Scatter the rocks that ``rocks`` settings describe on a square patch of side ``size_m`` about the origin.

    ``shapes[level][shape]`` are the available shapes; no rock reaches into the circle ``clear_m`` (east, north,
    radius). A rock lies along the slope under it. Its deepest vertex is at or under the deepest ground of its
    footprint, and at or under the ground beneath that vertex, so no rock floats. With a view ``beyond``, rocks also lie
    outside the patch, listed after the rocks on it. With the law TABLE, places and diameters come from the file
    ``rocks.file``, whose path is absolute, and no rocks lie outside. A painted mask, ``rocks.mask_file``, keeps each
    rock with a probability equal to the mask at its place, and moves no rock. With ``most_seen`` only that many rocks
    are returned, the largest as seen from the centre of the circle, unchanged by the limit; debris only fills it up.
    Debris lies on the ground ``skirted``, which has the skirts of the rocks if there are any. Raises IcyMoonError if
    the settings contradict each other or the mask cannot be read.

    With ``low_ground_m`` only rocks on low ground are left, and on slopes that hold them (``rolling_deg``), which moves
    no rock. Rocks that are ``at_rest`` have rolled down and do not reach into each other, see ``rest``. Rocks in the
    circle are left out last, so the circle moves no other rock.
    """
    drawn = _draw(rocks, size_m, seed, shapes, clear_m, beyond, most_seen)
    if rocks.low_ground_m:
        drawn = _choose_all_low(drawn, surface, skirted or surface, float(rocks.low_ground_m))
    crowded = 0
    if rocks.at_rest:
        laid, debris, crowded = _lay_at_rest(rocks, drawn, size_m, surface, shapes)
        laid, debris = ([_clear_circle(part, clear_m) for part in parts] for parts in (laid, debris))
    else:
        steepest = float(rocks.rolling_deg) if rocks.low_ground_m else 90.0
        laid = [_lay_rocks(part, surface, shapes, clear_m, steepest) for part in drawn.parts]
        debris = [_lay_rocks(part, skirted or surface, shapes, clear_m, steepest) for part in drawn.debris]
    numbers = ("smallest_m", "beyond_rad", "debris_smallest_m")
    arrays = {
        f.name: np.concatenate([getattr(each, f.name) for each in (*laid, *debris)])
        for f in fields(Rocks)
        if f.name not in (*numbers, "debris_start", "crowded_out")
    }
    start = sum(len(each.diameter_m) for each in laid)
    return Rocks(**arrays, **{name: getattr(drawn, name) for name in numbers}, debris_start=start, crowded_out=crowded)


def _lay_at_rest(
    rocks: RocksSettings, drawn: _Drawn, size_m: float, surface: HeightAt, shapes: Sequence[Sequence[RockShape]]
) -> tuple[list[Rocks], list[Rocks], int]:
    """Lay drawn rocks to rest. Return the parts of rocks, the parts of debris where it does not reach into a rock, and
    the number of rocks without room.
    """
    laid, debris, crowded, there = list[Rocks](), list[Rocks](), 0, OutlinesAtRest(_find_cell_side(drawn))
    for part in drawn.parts:
        rolled = replace(part, places_m=_roll(rocks, part, size_m, surface))
        settled, outline = _settle(rolled, surface, shapes)
        # A little wider, because a rock that was moved settles in another pose.
        places, kept = move_apart(
            rolled.places_m, rolled.diameter_m, _ROOM * outline, OutlinesAtRest(there.side_m), size_m / 2
        )
        moved = np.flatnonzero(kept & (places != rolled.places_m).any(axis=1))
        again, wider = _settle(_choose(replace(rolled, places_m=places), moved), surface, shapes)
        settled = _replace_some(settled, moved, again)
        outline[moved] = wider
        for k in np.flatnonzero(kept):
            kept[k] = there.find_deepest(settled.position_m[k, :2], outline[k]) is None
            if kept[k]:
                there.add(settled.position_m[k, :2], outline[k])
        grounded = np.isfinite(settled.position_m[:, 2])
        crowded += int((grounded & ~kept).sum())
        laid.append(_choose(settled, grounded & kept))
    for part in drawn.debris:
        rolled = replace(part, places_m=_roll(rocks, part, size_m, surface))
        fragments = _lay_rocks(rolled, surface, shapes, _NO_CIRCLE)
        debris.append(_choose(fragments, find_clear_of(there, fragments.position_m[:, :2], fragments.reach_m)))
    return laid, debris, crowded


def _choose_all_low(drawn: _Drawn, surface: HeightAt, skirted: HeightAt, radius_m: float) -> _Drawn:
    """Choose the drawn rocks on low ground, and their debris on low ground. Rocks that are left out shed nothing."""
    debris = list[_LooseRocks]()
    for part, shed_at_m in zip(drawn.debris, drawn.shed_at_m, strict=True):
        parents, parent = np.unique(shed_at_m, axis=0, return_inverse=True)
        shed = _choose(part, _is_low(parents, surface, radius_m)[parent.ravel()])
        debris.append(_choose(shed, _is_low(shed.places_m, skirted, radius_m)))
    parts = tuple(_choose(part, _is_low(part.places_m, surface, radius_m)) for part in drawn.parts)
    return replace(drawn, parts=parts, debris=tuple(debris))


def _is_low(places_m: Array, surface: HeightAt, radius_m: float) -> Array:
    """Return whether the ground at places (n, 2) is lower than its surroundings by more than rounding, which differs
    between machines."""
    return np.asarray(surface(*places_m.T) < _level_around(places_m, surface, radius_m) - _LEAST_LOW * radius_m)


def _level_around(places_m: Array, surface: HeightAt, radius_m: float) -> Array:
    """Compute the heights (n,) in metres at places (n, 2) of planes through the surroundings: the mean of points in
    ``_LOW_DIRECTIONS`` at half of a radius and at all of it, as far as there is ground. Planes, level or tilted, are
    thus nowhere low. All places in a square of ``_LOW_SQUARE`` radii share one plane, because fragments are many and
    squares few.
    """
    squares, of = np.unique(np.floor(places_m / (_LOW_SQUARE * radius_m)), axis=0, return_inverse=True)
    middle = _LOW_SQUARE * radius_m * (squares + 0.5)
    turn = 2 * np.pi * (np.arange(2 * _LOW_DIRECTIONS) + 0.5) / _LOW_DIRECTIONS
    dx, dy = radius_m * np.repeat([0.5, 1.0], _LOW_DIRECTIONS) * np.stack([np.cos(turn), np.sin(turn)])
    planes = np.empty((len(middle), 3))
    for start in range(0, len(middle), _SQUARES_AT_ONCE):
        x, y = middle[start : start + _SQUARES_AT_ONCE].T
        around = surface(x[:, None] + dx, y[:, None] + dy)
        known = np.isfinite(around)
        mean = np.where(known, around, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        off = np.where(known, around - mean[:, None], 0.0)
        slopes = [(off * d).sum(axis=1) / (d * d).sum() for d in (dx, dy)]
        planes[start : start + _SQUARES_AT_ONCE] = np.stack([mean, *slopes], axis=1)
    mean, east, north = planes[of.ravel()].T
    away = places_m - middle[of.ravel()]
    return np.asarray(mean + east * away[:, 0] + north * away[:, 1])


def _find_cell_side(drawn: _Drawn) -> float:
    """Choose the side in metres of cells so that an outline meets few of them."""
    return max((float(np.median(part.diameter_m)) for part in drawn.parts if len(part.diameter_m)), default=1.0) * 2.0


def _roll(rocks: RocksSettings, part: _LooseRocks, size_m: float, surface: HeightAt) -> Array:
    return roll_down(part.places_m, part.diameter_m, surface, size_m, float(rocks.rolling_deg))


def _settle(loose: _LooseRocks, surface: HeightAt, shapes: Sequence[Sequence[RockShape]]) -> tuple[Rocks, Array]:
    """Settle rocks in poses in which they touch the ground. Return them, with heights that are not finite without
    ground, and their outlines (n, 32). The largest lie on three points; then each is lowered by its buried share.
    """
    laid, thickness, _ = _lay_all(loose, surface, shapes)
    rotation, position, scale = euler_matrices(laid.rotation), laid.position_m.copy(), loose.scale_m
    some = np.flatnonzero(np.isfinite(position[:, 2]) & (np.arange(len(position)) < LEVEL_RANKS[0]))
    if len(some):
        parts = [
            (these, pick_lowest(kind.vertices @ np.swapaxes(rotation[some[these]] * scale[some[these], None, :], 1, 2)))
            for kind, these in _group_by_shape(loose.level[some], loose.shape[some], shapes)
        ]
        order = np.argsort(np.concatenate([these for these, _ in parts]))
        points = np.concatenate([each for _, each in parts])[order]
        turn, centre = settle_poses(points, position[some], surface)
        rotation[some], position[some] = turn @ rotation[some], centre
        position[some, 2] -= loose.burial[some] * thickness[some]
    outline, reach = np.empty((len(position), N_DIRECTIONS)), np.empty(len(position))
    for kind, these in _group_by_shape(loose.level, loose.shape, shapes):
        whole = kind.vertices @ np.swapaxes(rotation[these] * loose.scale_m[these, None, :], 1, 2)
        outline[these] = measure_outlines(whole)
        reach[these] = np.sqrt((whole[..., :2] ** 2).sum(axis=2).max(axis=1))
    return replace(laid, rotation=euler_xyz(rotation), position_m=position, reach_m=reach), outline


def _choose(of: _Some, which: Array) -> _Some:
    """Choose some of the rocks, by a mask or by indices."""
    values = {f.name: getattr(of, f.name) for f in fields(of)}
    made: dict[str, Any] = {name: each[which] for name, each in values.items() if isinstance(each, np.ndarray)}
    return replace(of, **made)


def _replace_some(rocks: Rocks, which: Array, by: Rocks) -> Rocks:
    """Replace the rocks with the indices ``which`` by other rocks."""
    made: dict[str, Any] = {}
    for f in fields(Rocks):
        values = getattr(rocks, f.name)
        if isinstance(values, np.ndarray):
            made[f.name] = values.copy()
            made[f.name][which] = getattr(by, f.name)
    return replace(rocks, **made)


def _clear_circle(rocks: Rocks, clear_m: tuple[float, float, float]) -> Rocks:
    """Choose the rocks that do not reach into a circle (east, north, radius)."""
    away = np.hypot(rocks.position_m[:, 0] - clear_m[0], rocks.position_m[:, 1] - clear_m[1])
    return _choose(rocks, away > clear_m[2] + rocks.reach_m)


def draw_footprints(
    rocks: RocksSettings,
    size_m: float,
    seed: int,
    shapes: Sequence[Sequence[RockShape]],
    clear_m: tuple[float, float, float],
    beyond: ViewBeyond | None = None,
    most_seen: int | None = None,
) -> Footprints:
    """Draw the outlines of the rocks of ``scatter_rocks`` without debris, before a ground is known. A rock that the
    circle ``clear_m`` might remove, however the ground tilts it, is left out.

    A rock counts as an ellipsoid with its length, width and height.
    """
    drawn = _draw(rocks, size_m, seed, shapes, clear_m, beyond, most_seen)
    loose = _join(list(drawn.parts))
    stays = _list_staying(loose, shapes, clear_m)
    outlines, thickness = _find_outlines(loose, stays)
    return Footprints(outlines.places_m, outlines.half_m, outlines.turn_rad, thickness * (1.0 - loose.burial[stays]))


def _find_outlines(loose: _LooseRocks, which: Array | slice) -> tuple[Outlines, Array]:
    """Find the outlines of some rocks as ellipsoids on level ground, and their thickness (n,) in metres."""
    half = loose.rotation[which] * (loose.scale_m[which, None, :] / 2)
    square = half @ np.swapaxes(half, 1, 2)
    # The outline of an ellipsoid is the ellipse of the upper left part of its matrix. A copy, as in ``euler_xyz``.
    mean, apart = (square[:, 0, 0] + square[:, 1, 1]) / 2, (square[:, 0, 0] - square[:, 1, 1]) / 2
    mixed = np.ascontiguousarray(square[:, 0, 1])
    turned = np.hypot(apart, mixed)
    axes = np.sqrt(np.stack([mean + turned, np.maximum(mean - turned, 0.0)], axis=1))
    return Outlines(loose.places_m[which], axes, np.arctan2(mixed, apart) / 2), 2.0 * np.sqrt(square[:, 2, 2])


def _list_staying(
    loose: _LooseRocks, shapes: Sequence[Sequence[RockShape]], clear_m: tuple[float, float, float]
) -> Array:
    """Return whether each rock (n,) stays outside the circle ``clear_m`` in any pose."""
    room = np.hypot(*(loose.places_m - clear_m[:2]).T) - clear_m[2]
    radii = np.array([[np.linalg.norm(shape.vertices, axis=1).max() for shape in row] for row in shapes])
    reach = radii[loose.level, loose.shape] * loose.scale_m.max(axis=1)
    for k in np.flatnonzero((room > 0.0) & (room <= reach)):
        points = shapes[loose.level[k]][loose.shape[k]].vertices * loose.scale_m[k]
        reach[k] = np.linalg.norm(points, axis=1).max()
    return np.asarray(room > reach)


def _draw(
    rocks: RocksSettings,
    size_m: float,
    seed: int,
    shapes: Sequence[Sequence[RockShape]],
    clear_m: tuple[float, float, float],
    beyond: ViewBeyond | None,
    most_seen: int | None,
) -> _Drawn:
    """Draw the rocks of ``scatter_rocks`` before they lie on a ground."""
    draw = _draw_rocks if most_seen is None or has_file(rocks) else _draw_few
    return draw(
        tuple(rocks.items()), size_m, seed, tuple(shape.height for shape in shapes[0]), clear_m, beyond, most_seen
    )


def _draw_rocks(
    values: tuple[tuple[str, Any], ...],
    size_m: float,
    seed: int,
    heights: tuple[float, ...],
    clear_m: tuple[float, float, float],
    beyond: ViewBeyond | None,
    most_seen: int | None,
) -> _Drawn:
    """Draw the rocks of ``scatter_rocks``, from the ``values`` of the settings and the ``heights`` of the shapes,
    before they lie on a ground.
    """
    rocks = RocksSettings.from_values(values)
    xy, diameter, smallest = _read_places(rocks) if rocks.law == TABLE else _draw_places(rocks, size_m, seed)
    far = None
    if beyond is not None and rocks.law != TABLE:
        far = draw_beyond(rocks, size_m, beyond, make_generator(seed, "rocks", _BEYOND))
    parts = [(xy, diameter)] + ([(far.places_m, far.diameter_m)] if far else [])
    kept = _list_kept(rocks, size_m, seed, [xy for xy, _ in parts])
    ranks = [np.arange(len(diameter))] + ([np.argsort(np.argsort(-far.angle_rad, kind="stable"))] if far else [])
    chosen = _choose_seen(parts, kept, clear_m, most_seen)
    loose = [
        _pose_rocks(rocks, *part, rank, make_generator(seed, "rocks", *stream, _POSES), heights, seen)
        for part, rank, stream, seen in zip(parts, ranks, _PART_STREAMS, chosen, strict=False)
    ]
    debris, shed_at_m, debris_smallest = list[_LooseRocks](), list[Array](), 0.0
    if rocks.debris > 0:
        seen_m = [np.zeros(len(diameter))] + ([far.smallest_rad * far.diameter_m / far.angle_rad] if far else [])
        room = None if most_seen is None else most_seen - sum(len(each.diameter_m) for each in loose)
        debris, shed_at_m, debris_smallest = _draw_debris(rocks, seed, heights, clear_m, parts, kept, seen_m, room)
    # For few rocks, finding the ground takes the same time for any number, so the ground is found once for all.
    laid, shed = (tuple(each if most_seen is None or not each else [_join(each)]) for each in (loose, debris))
    if most_seen is not None and shed_at_m:
        shed_at_m = [np.concatenate(shed_at_m)]
    return _Drawn(laid, shed, tuple(shed_at_m), smallest, far.smallest_rad if far else 0.0, debris_smallest)


def _draw_debris(
    rocks: RocksSettings,
    seed: int,
    heights: tuple[float, ...],
    clear_m: tuple[float, float, float],
    parts: list[tuple[Array, Array]],
    kept: list[Array],
    seen_m: list[Array],
    most_seen: int | None,
) -> tuple[list[_LooseRocks], list[Array], float]:
    """The debris of the rocks of all ``parts``, before it lies on a ground, the places (n, 2) of the rocks that shed
    it, and the smallest diameter within the limit on its number. Fragments of rocks that are not ``kept`` are left out,
    and those below ``seen_m`` (n,) of each rock."""
    shed = []
    for (xy, diameter), stream, least in zip(parts, _PART_STREAMS, seen_m, strict=False):
        posed = _pose_rocks(
            rocks, xy, diameter, np.zeros(len(xy)), make_generator(seed, "rocks", *stream, _POSES), heights, slice(None)
        )
        random = make_generator(seed, "rocks", *stream, _DEBRIS, _PLACES)
        shed.append(shed_debris(rocks, diameter, _find_outlines(posed, slice(None))[0], least, random))
    there = [keep[each.parent] for each, keep in zip(shed, kept, strict=True)]
    found = [(each.places_m, each.diameter_m) for each in shed]
    # Beyond the patch every fragment looks small.
    ranks = [np.arange(len(each.parent)) + LEVEL_RANKS[-1] * (k > 0) for k, each in enumerate(shed)]
    ranks[0] += np.searchsorted(-parts[0][1], -shed[0].diameter_m)
    seen = _choose_seen(found, there, clear_m, most_seen)
    posed_debris = [
        _pose_rocks(rocks, *part, rank, make_generator(seed, "rocks", *stream, _DEBRIS, _POSES), heights, some)
        for part, rank, stream, some in zip(found, ranks, _PART_STREAMS, seen, strict=False)
    ]
    shed_at_m = [xy[each.parent[some]] for (xy, _), each, some in zip(parts, shed, seen, strict=False)]
    return posed_debris, shed_at_m, max(each.smallest_m for each in shed)


def _join(parts: list[_LooseRocks]) -> _LooseRocks:
    return _LooseRocks(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(_LooseRocks)))


#: Draws the few rocks of a preview once for all the grounds that they lie on while a slider moves.
_draw_few = functools.lru_cache(maxsize=1)(_draw_rocks)


def is_masked(rocks: RocksSettings) -> bool:
    """Return whether a painted mask thins the rocks. Rocks of a table have stated places."""
    return bool(rocks.mask_file and rocks.law != TABLE)


def has_file(rocks: RocksSettings) -> bool:
    """Return whether a file, which may change, states places of rocks."""
    return rocks.law == TABLE or is_masked(rocks)


def _list_kept(rocks: RocksSettings, size_m: float, seed: int, parts: list[Array]) -> list[Array]:
    """Return whether the painted mask leaves each rock of the patch (n,), and each beyond it, at places (n, 2) in
    metres. Each rock has its own random number, which does not depend on the mask.
    """
    if not is_masked(rocks):
        return [np.ones(len(xy), bool) for xy in parts]
    mask = PaintedMask(read_mask(absolute_path(rocks.mask_file, "rocks.mask_file")), size_m)
    chances = (make_generator(seed, "rocks", *part, _MASK) for part in _PART_STREAMS)
    return [
        np.asarray(chance.random(len(xy)) < mask.shares(xy[:, 0], xy[:, 1]))
        for xy, chance in zip(parts, chances, strict=False)
    ]


def _choose_seen(
    parts: list[tuple[Array, Array]], kept: list[Array], site_m: tuple[float, float, float], most: int | None
) -> tuple[Array, Array]:
    """Choose the rocks on the patch and beyond it that look largest from a site, at most ``most`` rocks in total.
    Return their masks (n,). ``parts`` are the places (n, 2) and diameters (n,) in metres of each part; ``kept`` (n,) is
    true for rocks that are there.
    """
    looks = [
        np.where(there, d / np.hypot(xy[:, 0] - site_m[0], xy[:, 1] - site_m[1]), -1.0)
        for (xy, d), there in zip(parts, kept, strict=True)
    ]
    every = np.concatenate(looks)
    if most is None or len(every) <= most:
        least = 0.0
    else:
        least = max(float(np.partition(every, -most)[-most]), 0.0) if most else math.inf
    masks = [look >= least for look in looks]
    return masks[0], masks[-1]


def _draw_places(rocks: RocksSettings, size_m: float, seed: int) -> tuple[Array, Array, float]:
    """Draw positions (n, 2) and diameters (n,) that follow the law of sizes, largest first. Return them and the
    smallest diameter, in metres.
    """
    diameter, smallest = draw_diameters(
        make_size_law(rocks), size_m**2, int(rocks.most), make_generator(seed, "rocks", _SIZES)
    )
    # Rocks stay on the patch: places are drawn on all of it, then scaled inward by half a diameter.
    xy = draw_places(rocks, len(diameter), size_m, make_generator(seed, "rocks", _PLACES))
    xy *= np.maximum(1.0 - diameter / size_m, 0.0)[:, None]
    return xy, diameter, smallest


def _read_places(rocks: RocksSettings) -> tuple[Array, Array, float]:
    """Read the positions, diameters and smallest diameter of the user's table, as ``_draw_places`` returns them; the
    smallest diameter is 0 unless some rocks are left out.
    """
    table = read_rock_table(absolute_path(rocks.file, "rocks.file"))
    kept = table[: int(rocks.most)]
    return kept[:, :2].copy(), kept[:, 2].copy(), float(kept[-1, 2]) if 0 < len(kept) < len(table) else 0.0


def _pose_rocks(
    rocks: RocksSettings,
    xy: Array,
    diameter: Array,
    rank: Array,
    random: np.random.Generator,
    heights: tuple[float, ...],
    chosen: Array | slice,
) -> _LooseRocks:
    """Pose the ``chosen`` (n,) rocks of given positions (n, 2), diameters and ranks in size. A rock's pose does not
    depend on which others are chosen.
    """
    n = len(diameter)
    shape = random.integers(0, len(heights), n)
    elongation = np.maximum(1.0, rocks.elongation * np.exp(random.normal(0, _VARIATION, n)))
    height = np.array(heights)[shape]
    height *= rocks.height_ratio * np.exp(random.normal(0, _VARIATION, n))
    scale = diameter[:, None] * np.stack([np.sqrt(elongation), 1.0 / np.sqrt(elongation), height], axis=1)
    tilts = random.normal(0, 1, n), random.normal(0, 1, n)
    turn = random.uniform(0, 2 * np.pi, n)
    burial = np.clip(rocks.burial + random.normal(0, _BURIAL_VARIATION, n) * (rocks.burial > 0), 0.0, 0.95)
    tilt = math.radians(rocks.tilt_deg)
    rotation = _rotation_about(0, tilts[0][chosen] * tilt) @ _rotation_about(1, tilts[1][chosen] * tilt)
    rotation = rotation @ _rotation_about(2, turn[chosen])
    level = np.searchsorted(LEVEL_RANKS, rank, side="right")
    arrays = [*(a[chosen] for a in (xy, diameter, level, shape, scale, burial)), rotation]
    return _LooseRocks(*arrays)


def _lay_rocks(
    loose: _LooseRocks,
    surface: HeightAt,
    shapes: Sequence[Sequence[RockShape]],
    clear_m: tuple[float, float, float],
    steepest_deg: float = 90.0,
) -> Rocks:
    """Lay rocks on the ground, on slopes up to ``steepest_deg``. Rocks that reach into a circle are left out."""
    laid, _, normal = _lay_all(loose, surface, shapes)
    held = np.isfinite(laid.position_m[:, 2]) & (normal[:, 2] >= math.cos(math.radians(steepest_deg)))
    return _clear_circle(_choose(laid, held), clear_m)


def _lay_all(
    loose: _LooseRocks, surface: HeightAt, shapes: Sequence[Sequence[RockShape]]
) -> tuple[Rocks, Array, Array]:
    """Lay all rocks on the ground, with heights that are not finite without ground. Return them, their thicknesses (n,)
    along the normal of the ground, in metres, and these unit normals (n, 3).
    """
    xy, scale, level, shape = loose.places_m, loose.scale_m, loose.level, loose.shape
    normal, ground = _measure_footprint_ground(xy, 0.45 * loose.diameter_m, surface)
    rotation = _rotation_from_vertical(normal) @ loose.rotation
    deepest, thickness, reach = _measure_extent(rotation, scale, level, shape, normal, shapes)
    # Depth below the ground is measured along its normal, and the rock moves along the vertical.
    sunk = np.einsum("nk,nk->n", normal, deepest) + loose.burial * thickness
    z = ground - sunk / normal[:, 2]
    beneath = surface(xy[:, 0] + deepest[:, 0], xy[:, 1] + deepest[:, 1])
    z -= np.maximum(np.nan_to_num(z + deepest[:, 2] - beneath, nan=0.0), 0.0)
    position = np.column_stack([xy, z])
    return Rocks(position, euler_xyz(rotation), scale, level, shape, loose.diameter_m, reach), thickness, normal


def move_rocks(
    rocks: Rocks,
    which: Array,
    xy: Array,
    surface: HeightAt,
    before: HeightAt,
    shapes: Sequence[Sequence[RockShape]],
) -> tuple[Array, Array]:
    """Lay the rocks ``which`` (m,) loosely on other places (m, 2). Return their positions (m, 3) and Euler angles (m,
    3). A rock turns from the slope of its footprint on the ground ``before`` to the slope on ``surface``, and is
    lowered until it touches the ground.
    """
    size = 0.45 * rocks.diameter_m[which]
    old, _ = _measure_footprint_ground(rocks.position_m[which, :2], size, before)
    new, _ = _measure_footprint_ground(xy, size, surface)
    turn = _rotation_from_vertical(new) @ np.swapaxes(_rotation_from_vertical(old), 1, 2)
    rotation = turn @ euler_matrices(rocks.rotation[which])
    z = np.empty(len(which))
    for k, rock in enumerate(which):
        shape = shapes[rocks.level[rock]][rocks.shape[rock]]
        points = (shape.vertices * rocks.scale_m[rock]) @ rotation[k].T
        gap = surface(xy[k, 0] + points[:, 0], xy[k, 1] + points[:, 1]) - points[:, 2]
        z[k] = np.nanmax(gap) if np.isfinite(gap).any() else rocks.position_m[rock, 2]
    return np.column_stack([xy, z]), euler_xyz(rotation)

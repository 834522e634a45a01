"""Clods of many sizes on a heap of spoil: a few large and many small, as falling spoil breaks up.

Each clod slides over the bare heap from the place where it fell, until friction stops it. Friction is lower for clods
that are large among their neighbours. A large clod rolls over small ones as over a smooth floor, so large clods lie at
the foot of a heap (size segregation in grain flows; Drahun and Bridgwater 1983, Powder Technology 36, 39, from memory).
The distance does not depend on gravity, because both the driving force and friction are proportional to it. Sizes and
shapes are guesses.

Sorted clods drop more often where spoil is thick, and roll one at a time, as stones do on a scree. Their friction falls
with their width D over the width d of the grains on which they roll, tan φ = tan φ0 + k d / D (Statham 1976, Earth
Surface Processes 1, 43; the law is from memory, its numbers here are guesses). So fine spoil is left at the crest, and
large clods lie at the foot, as in heaps of mixed grains (Makse et al. 1997, Nature 386, 379).
"""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array
from .dig_grid import ExcavationGrid

#: Exponent of the power law of the number of clods above a width; fragments of brittle bodies have 2 to 3.
_SIZE_EXPONENT = 2.5
#: Width of the smallest clod in cells.
_SMALLEST_CELLS = 3.0
#: Largest ratio of the widest to the smallest clod.
_WIDTH_RATIO = 16.0
#: Maximum number of clods.
_MAX_CLODS = 20_000
#: Area of all clods relative to the area of the heap.
_COVERED_SHARE = 1.6
#: Side of the square that has the area of a clod, over the clod's width.
_SQUARE_SIDE = 0.8
#: Largest width of a clod over the greatest thickness of the spoil.
_WIDTH_OVER_THICKNESS = 0.5
#: Largest share of the spoil in clods.
_MAX_CLOD_SHARE = 0.5
#: Range of the friction of the largest clods, relative to spoil.
_LARGE_FRICTION = (0.35, 1.0)
#: Friction of the smallest clods, which interlock, relative to spoil.
_SMALL_FRICTION = 1.2
#: Friction, relative to spoil, of very large sorted clods, and the addition for clods as wide as the grains under them.
_ROLLING_FRICTION = (0.35, 0.9)
#: Range of the factor on this friction, by the shapes of clods.
_FRICTION_SCATTER = (0.85, 1.15)
#: Height from which sorted clods drop on the crest, over the height of the heap.
_DROP_HEIGHT = 0.05
#: Sorted clods drop on a cell with a chance of its thickness of spoil to this power, so few drop at the foot.
_CREST_POWER = 0.5
#: Area of all sorted clods relative to the area of the heap: spoil without clods is fine.
_SORTED_SHARE = 1.4
#: Factor on the friction of sorted clods on bare ground, which brakes them.
_GROUND_FRICTION = 4.0
#: Share of sorted clods that roll on without this factor.
_OUTLIERS = 0.15
#: Maximum number of steps of a slide. A step is at most one cell.
_MAX_SLIDE_STEPS = 600
#: Number of side planes of a clod.
_CLOD_SIDES = 6
#: Range of their slopes in degrees.
_SIDE_DEG = (50.0, 78.0)
#: Range of their distances from the axis, over half the width.
_SIDE_DISTANCE = (0.7, 1.0)
#: Number of top planes of a clod.
_CLOD_TOPS = 3
#: Standard tilt of these planes, as a slope.
_TOP_TILT = 0.45
#: Range of their heights over the width.
_TOP_HEIGHT = (0.45, 0.85)
#: Share of a clod's height that is buried.
_BURIED_SHARE = 0.3


def add_clods(
    grid: ExcavationGrid,
    ground_m: Array,
    spoil_m: Array,
    largest_m: float,
    repose_deg: float,
    random: np.random.Generator,
    sorting: float = 0.0,
    thinnest_m: float = 0.0,
) -> Array:
    """Add clods of up to ``largest_m`` to spoil. Return its thickness (rows, columns) in metres, with the sum of
    ``spoil_m``.

    One factor lowers all bare spoil to make up for the clods. ``sorting`` from 0 to 1 is the share of the clods that
    rolled down the heap. No clod drops on spoil up to ``thinnest_m`` thick, which is dust.
    """
    total = float(spoil_m.sum())
    if largest_m <= 0.0 or float(spoil_m.max()) <= thinnest_m:
        return spoil_m
    place, width = place_clods(grid, ground_m, spoil_m, largest_m, repose_deg, random, sorting, thinnest_m)
    top = ground_m + spoil_m
    raised: Array = _raise_clods(top, place, width, grid.cell_m, random) - top
    held = float(raised.sum())
    raised *= min(1.0, _MAX_CLOD_SHARE * total / held) if held > 0.0 else 0.0
    return np.asarray(spoil_m * (1.0 - float(raised.sum()) / total) + raised)


def place_clods(
    grid: ExcavationGrid,
    ground_m: Array,
    spoil_m: Array,
    largest_m: float,
    repose_deg: float,
    random: np.random.Generator,
    sorting: float = 0.0,
    thinnest_m: float = 0.0,
) -> tuple[Array, Array]:
    """Drop clods on spoil thicker than ``thinnest_m``. Return the rows and columns (n, 2) where they come to rest, and
    their widths (n,) in metres, smallest first.
    """
    on = np.flatnonzero(spoil_m > thinnest_m)
    most = min(largest_m, _WIDTH_OVER_THICKNESS * float(spoil_m.max()))
    covered = _COVERED_SHARE + sorting * (_SORTED_SHARE - _COVERED_SHARE)
    width = _draw_widths(grid.cell_m, len(on), most, random, covered)
    start, top = on[random.integers(0, len(on), len(width))], (ground_m + spoil_m) / grid.cell_m
    friction = _draw_friction(width, random)
    tangent = math.tan(math.radians(repose_deg))
    if sorting == 0.0:
        return _slide_clods(top, _find_cells(start, grid), tangent * friction), width
    rolls = random.uniform(0.0, 1.0, len(width)) < sorting
    chance = np.cumsum(spoil_m.flat[on] ** _CREST_POWER)
    start[rolls] = on[np.searchsorted(chance, random.uniform(0.0, chance[-1], int(rolls.sum())))]
    friction[rolls] = _draw_rolling_friction(width, random)[rolls]
    on_ground = friction.copy()
    on_ground[rolls & (random.uniform(0.0, 1.0, len(width)) > _OUTLIERS)] *= _GROUND_FRICTION
    pace = np.where(rolls, math.sqrt(2.0 * _DROP_HEIGHT * float(spoil_m.max()) / grid.cell_m), 0.0)
    turn = random.uniform(0.0, 2.0 * math.pi, len(width))
    speed = pace[:, None] * np.stack([np.sin(turn), np.cos(turn)], axis=1)
    bare = spoil_m <= thinnest_m
    return _slide_clods(top, _find_cells(start, grid), tangent * friction, speed, (bare, tangent * on_ground)), width


def _find_cells(numbers: Array, grid: ExcavationGrid) -> Array:
    """Find the rows and columns (n, 2) of cells from their flat indices (n,)."""
    return np.stack(np.divmod(numbers, grid.columns), axis=1).astype(np.float64)


def find_least_width_m(cell_m: float, largest_m: float) -> float:
    """Return the width in metres of the smallest clod, if the largest is ``largest_m`` wide."""
    return max(_SMALLEST_CELLS * cell_m, largest_m / _WIDTH_RATIO)


def _draw_widths(
    cell_m: float, cells: int, largest_m: float, random: np.random.Generator, covered: float = _COVERED_SHARE
) -> Array:
    """Draw the widths (n,) in metres, smallest first, of the clods on ``cells`` cells of spoil. The clods' area is
    ``covered`` times the area of these cells.
    """
    least = find_least_width_m(cell_m, largest_m)
    most = max(largest_m, least)
    ends = least**-_SIZE_EXPONENT, most**-_SIZE_EXPONENT
    mean_square = float(np.mean(_compute_clod_widths(np.linspace(0.0, 1.0, 1001), ends) ** 2))
    count = min(math.ceil(covered * cells * cell_m**2 / (_SQUARE_SIDE**2 * mean_square)), _MAX_CLODS)
    return np.sort(_compute_clod_widths(random.uniform(0.0, 1.0, count), ends))


def _compute_clod_widths(share: Array, ends: tuple[float, float]) -> Array:
    return (ends[0] + share * (ends[1] - ends[0])) ** (-1.0 / _SIZE_EXPONENT)


def _draw_friction(width: Array, random: np.random.Generator) -> Array:
    """Draw the friction (n,) of clods relative to spoil."""
    span = math.log(float(width[-1] / width[0])) or 1.0
    return _SMALL_FRICTION - np.log(width / width[0]) / span * (
        _SMALL_FRICTION - random.uniform(*_LARGE_FRICTION, len(width))
    )


def _draw_rolling_friction(width: Array, random: np.random.Generator) -> Array:
    """Draw the friction (n,), relative to spoil, of clods that roll over clods of the median width."""
    least, more = _ROLLING_FRICTION
    return np.asarray((least + more * float(np.median(width)) / width) * random.uniform(*_FRICTION_SCATTER, len(width)))


def _slide_clods(
    top: Array,
    place: Array,
    friction: Array,
    speed: Array | None = None,
    elsewhere: tuple[Array, Array] | None = None,
) -> Array:
    """Find the rows and columns (n, 2) at which clods that start at ``place`` come to rest.

    ``top`` is heights in cells. A clod is a point mass that its slope accelerates and friction slows; it stops at the
    rim of the grid. ``speed`` (n, 2) is its first speed; half of its square is a height in cells. ``elsewhere`` is a
    boolean mask of cells with another friction, and this friction (n,).
    """
    slopes = np.stack(np.gradient(top), axis=2)
    last = np.array(top.shape) - 1.0
    place, speed = place.copy(), np.zeros_like(place) if speed is None else speed.copy()
    for _ in range(_MAX_SLIDE_STEPS):
        at = np.rint(place).astype(int)
        fastest = max(float(np.hypot(*speed.T).max()), 1.0)
        step = 1.0 / fastest
        speed -= step * slopes[at[:, 0], at[:, 1]]
        pace = np.hypot(*speed.T)
        drag = friction if elsewhere is None else np.where(elsewhere[0][at[:, 0], at[:, 1]], elsewhere[1], friction)
        speed *= np.maximum(1.0 - step * drag / np.maximum(pace, 1e-12), 0.0)[:, None]
        if not speed.any():
            break
        place = np.clip(place + step * np.clip(speed, -fastest, fastest), 0.0, last)
    return place


def _raise_clods(top: Array, place: Array, width: Array, cell_m: float, random: np.random.Generator) -> Array:
    """Return the heights (rows, columns) of ground with clods on it. Each clod is a convex body with plane faces,
    partly buried.
    """
    count, sides = len(width), (len(width), _CLOD_SIDES)
    turn = (
        2.0
        * math.pi
        * (
            (np.arange(_CLOD_SIDES) + random.uniform(-0.35, 0.35, sides)) / _CLOD_SIDES
            + random.uniform(0.0, 1.0, (count, 1))
        )
    )
    slope = np.tan(np.radians(random.uniform(*_SIDE_DEG, sides)))
    out = random.uniform(*_SIDE_DISTANCE, sides) * 0.5 * width[:, None]
    high = random.uniform(*_TOP_HEIGHT, (count, _CLOD_TOPS)) * width[:, None]
    tilt = random.uniform(-_TOP_TILT, _TOP_TILT, (2, count, _CLOD_TOPS))
    # Height of each plane above the middle, and its slopes to the north and to the east.
    middle = np.concatenate([out * slope, high], axis=1) - _BURIED_SHARE * high.mean(axis=1, keepdims=True)
    north = np.concatenate([-slope * np.sin(turn), tilt[0]], axis=1)
    east = np.concatenate([-slope * np.cos(turn), tilt[1]], axis=1)
    raised = top.copy()
    at = np.rint(place).astype(int)
    # On a slope a clod reaches down on its lower side.
    reach = np.ceil(width / cell_m).astype(int)
    for k in range(count):
        (row, column), n = at[k], int(reach[k])
        if min(row, column, top.shape[0] - 1 - row, top.shape[1] - 1 - column) <= n:
            continue  # the rim of the patch stays as the ground around it
        part = slice(row - n, row + n + 1), slice(column - n, column + n + 1)
        off = cell_m * np.arange(-n, n + 1)
        planes = (
            middle[k, :, None, None]
            + north[k, :, None, None] * (off - cell_m * (place[k, 0] - row))[:, None]
            + east[k, :, None, None] * (off - cell_m * (place[k, 1] - column))
        )
        np.maximum(raised[part], top[row, column] + planes.min(axis=0), out=raised[part])
    return raised

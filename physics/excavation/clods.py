"""Clods of many sizes on a heap of spoil, as what a scoop drops breaks up: few large ones, many small ones.

Each lies where it came to rest. It slides from where it fell over the bare heap, against a friction that is the lower
the larger the clod is among its neighbours: large clods roll over small ones as over a smooth floor, which is why they
lie at the foot of a heap (size segregation in grain flows; Drahun and Bridgwater 1983, Powder Technology 36, 39, from
memory). How far one goes does not depend on gravity, which drives it and holds it alike. Sizes and shapes are guesses.
"""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array
from .dig_grid import ExcavationGrid

#: Index of the power law of the number of clods that are wider than a width: fragments of brittle bodies have 2 to 3.
_INDEX = 2.5
#: Width of the smallest clod in cells, greatest ratio of the widest to the smallest clod, maximum number of clods.
_SMALLEST_CELLS, _RANGE, _MOST = 3.0, 16.0, 20_000
#: Area of all clods relative to the heap's; a clod counts as a square with 0.8 times its width.
_COVER, _SQUARE = 1.6, 0.8
#: At most: width of the largest clod over the greatest thickness of the spoil, and share of the spoil in clods.
_OF_THICKNESS, _MOST_SHARE = 0.5, 0.5
#: Friction relative to spoil: range for the largest clods, and value for the smallest, which interlock.
_ROLLING, _HELD = (0.35, 1.0), 1.2
#: Maximum number of steps of the slide. A step is one cell or less.
_STEPS = 600
#: A clod: sides, their slopes in degrees and distances over half the width, tops with their tilts and heights over the
#: width, and the share of the height that is buried.
_SIDES, _SIDE_DEG, _SIDE_OUT = 6, (50.0, 78.0), (0.7, 1.0)
_TOPS, _TOP_TILT, _TOP_HIGH, _BURIED = 3, 0.45, (0.45, 0.85), 0.3


def add_clods(
    grid: ExcavationGrid,
    ground_m: Array,
    spoil_m: Array,
    largest_m: float,
    repose_deg: float,
    random: np.random.Generator,
) -> Array:
    """Thickness (rows, columns) of spoil with clods of up to ``largest_m``; its sum is the sum of ``spoil_m``.

    The bare spoil is lowered everywhere by the same share, to make up for the clods.
    """
    total = float(spoil_m.sum())
    on = np.flatnonzero(spoil_m > 0.0)
    if largest_m <= 0.0 or total <= 0.0:
        return spoil_m
    top = ground_m + spoil_m
    width = _draw_widths(grid.cell_m, len(on), min(largest_m, _OF_THICKNESS * float(spoil_m.max())), random)
    row, column = np.divmod(on[random.integers(0, len(on), len(width))], grid.columns)
    place = _slide_clods(
        top / grid.cell_m,
        np.stack([row, column], axis=1).astype(np.float64),
        math.tan(math.radians(repose_deg)) * _draw_friction(width, random),
    )
    raised: Array = _raise_clods(top, place, width, grid.cell_m, random) - top
    held = float(raised.sum())
    raised *= min(1.0, _MOST_SHARE * total / held) if held > 0.0 else 0.0
    return np.asarray(spoil_m * (1.0 - float(raised.sum()) / total) + raised)


def _draw_widths(cell_m: float, cells: int, largest_m: float, random: np.random.Generator) -> Array:
    """Widths (n,) in metres of the clods on a number of ``cells`` of spoil, the smallest first."""
    least = max(_SMALLEST_CELLS * cell_m, largest_m / _RANGE)
    most = max(largest_m, least)
    ends = least**-_INDEX, most**-_INDEX
    mean_square = float(np.mean(_clod_width(np.linspace(0.0, 1.0, 1001), ends) ** 2))
    count = min(math.ceil(_COVER * cells * cell_m**2 / (_SQUARE**2 * mean_square)), _MOST)
    return np.sort(_clod_width(random.uniform(0.0, 1.0, count), ends))


def _clod_width(share: Array, ends: tuple[float, float]) -> Array:
    return (ends[0] + share * (ends[1] - ends[0])) ** (-1.0 / _INDEX)


def _draw_friction(width: Array, random: np.random.Generator) -> Array:
    """Friction (n,) of clods relative to spoil."""
    span = math.log(float(width[-1] / width[0])) or 1.0
    return _HELD - np.log(width / width[0]) / span * (_HELD - random.uniform(*_ROLLING, len(width)))


def _slide_clods(top: Array, place: Array, friction: Array) -> Array:
    """Where (n, 2) clods come to rest that slide from ``place``: rows and columns, and heights in cells.

    A clod is a point that its slope accelerates and friction slows. At the rim of the grid it stops.
    """
    slopes = np.stack(np.gradient(top), axis=2)
    last = np.array(top.shape) - 1.0
    place, speed = place.copy(), np.zeros_like(place)
    for _ in range(_STEPS):
        at = np.rint(place).astype(int)
        fastest = max(float(np.hypot(*speed.T).max()), 1.0)
        step = 1.0 / fastest
        speed -= step * slopes[at[:, 0], at[:, 1]]
        pace = np.hypot(*speed.T)
        speed *= np.maximum(1.0 - step * friction / np.maximum(pace, 1e-12), 0.0)[:, None]
        if not speed.any():
            break
        place = np.clip(place + step * np.clip(speed, -fastest, fastest), 0.0, last)
    return place


def _raise_clods(top: Array, place: Array, width: Array, cell_m: float, random: np.random.Generator) -> Array:
    """Heights (rows, columns) of ground with clods on it, each a convex body of plane faces that is sunk into it."""
    count, sides = len(width), (len(width), _SIDES)
    turn = (
        2.0
        * math.pi
        * ((np.arange(_SIDES) + random.uniform(-0.35, 0.35, sides)) / _SIDES + random.uniform(0.0, 1.0, (count, 1)))
    )
    slope = np.tan(np.radians(random.uniform(*_SIDE_DEG, sides)))
    out = random.uniform(*_SIDE_OUT, sides) * 0.5 * width[:, None]
    high = random.uniform(*_TOP_HIGH, (count, _TOPS)) * width[:, None]
    tilt = random.uniform(-_TOP_TILT, _TOP_TILT, (2, count, _TOPS))
    # Height of each plane over the middle, and its rise to the north and to the east.
    middle = np.concatenate([out * slope, high], axis=1) - _BURIED * high.mean(axis=1, keepdims=True)
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

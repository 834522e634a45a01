"""The lamp of the photographs: its position, fitted to the shadows in the left eyes and compared with the survey.

Here a rock casts the shadow of its convex hull; in the renders it casts the shadow of the scan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ...stereo.images.masks import compute_intersection_over_union, fill_hulls, fill_polygons
from ...support.arrays import Array
from .camera import Calibration
from .data_set import HEIGHT_PX, ROCK, SHADOW, SURVEYED_LAMPS, WIDTH_PX, Terrain, View
from .sand import Sand
from .skirts import BOUND_M

_MASK_SCALE = 0.25
_MASK_SHAPE = (int(HEIGHT_PX * _MASK_SCALE), int(WIDTH_PX * _MASK_SCALE))
_LAMP_STEPS_M = (0.2, 0.1, 0.05, 0.025, 0.0125)
#: Expected distance in metres of a lamp from its survey. To the sides it is the distance of the fitted cameras on
#: terrain 04 from their surveys about the mean (0.2 m over three positions and both axes), in height half as much.
_SURVEY_ERROR_M = np.array([0.2, 0.2, 0.1])
#: Cost, as agreement of shadows, of a lamp that is one such distance from its survey. It is the difference between the
#: agreements of both eyes with the same shadows.
_SURVEY_COST = 0.01
_NODE_STEPS_M = (0.01, 0.005)
#: Distance in metres from a node within which a shadow must end or run for the node to be fitted.
_NODE_REACH_M = 0.2
#: Largest height in metres by which the sand at a node may exceed the surface through the rocks.
_MAX_RAISED_M = 0.02
#: Cost of this height.
_RAISED_COST = 5.0
#: Number of directions in which points of an outline are sought.
_OUTLINE_DIRECTIONS = 96
#: Spacing of the table of heights.
_TABLE_SPACING_M = 0.02


class HeightTable:
    """A table of the sand's heights on a ``grid`` (n, 2), which is much faster than ``Sand.heights``."""

    def __init__(self, sand: Sand) -> None:
        self.low = sand.nodes.min(axis=0) - 0.5
        self.count = np.ceil((sand.nodes.max(axis=0) + 0.5 - self.low) / _TABLE_SPACING_M).astype(int) + 1
        x, y = (self.low[k] + _TABLE_SPACING_M * np.arange(self.count[k]) for k in (0, 1))
        self.grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self.heights = sand.heights(self.grid).reshape(len(y), len(x))

    def __call__(self, xy: Array) -> Array:
        """Return the heights (n,), m, at points (n, 2), linear between the points of the grid."""
        at = np.clip((xy - self.low) / _TABLE_SPACING_M, 0, self.count - 1.001)
        k = at.astype(int)
        u, v = (at - k).T
        table, x, y = self.heights, k[:, 0], k[:, 1]
        return np.asarray(
            (table[y, x] * (1 - u) + table[y, x + 1] * u) * (1 - v)
            + (table[y + 1, x] * (1 - u) + table[y + 1, x + 1] * u) * v
        )


def trace_lamp_to_sand(points: Array, lamp: Array, heights: Callable[[Array], Array]) -> Array:
    """Trace the rays from a lamp through points (n, 3) to the points (n, 3) on the sand, by iteration."""
    way = points - lamp
    fall = np.maximum(lamp[2] - points[:, 2], 1e-3)
    times = np.full(len(points), 1.05)
    for _ in range(15):
        level = heights((lamp + way * times[:, None])[:, :2])
        times = np.clip((times + (lamp[2] - level) / fall) / 2, 1.0, 2.5)
    return np.asarray(lamp + way * times[:, None])


def _descend_along_axes(x: Array, cost: Callable[[Array], float], steps: tuple[float, ...], scale: Array) -> Array:
    """Find the parameters of least cost by steps along each axis, which become smaller and smaller."""
    best, least = x, cost(x)
    for step in steps:
        for _ in range(6):
            better = False
            for move in (sign * step * axis for axis in np.diag(scale) for sign in (1, -1)):
                found = cost(best + move)
                if found < least:
                    best, least, better = best + move, found, True
            if not better:
                break
    return best


def locate_surveyed_lamp(azimuth: int, sand: Sand) -> Array:
    """Return the position (3,), m, of the lamp from the survey, whose heights count from the median height of the
    sand."""
    return np.add(SURVEYED_LAMPS[azimuth], (0.0, 0.0, sand.level_m))


def _select_outline_points(points: Array, lamp: Array, level_m: float) -> Array:
    """Select the points, of (n, 3), that cast the outline of the shadow on level sand."""
    cast = trace_lamp_to_sand(points, lamp, lambda xy: np.full(len(xy), level_m))
    angle = 2 * np.pi * np.arange(_OUTLINE_DIRECTIONS) / _OUTLINE_DIRECTIONS
    toward = np.stack([np.cos(angle), np.sin(angle)])
    # Shadows are long and thin: equal steps of direction would miss the corners of their tips.
    away = cast[:, :2].mean(axis=0) - lamp[:2]
    away /= np.linalg.norm(away)
    turn = np.stack([away, [-away[1], away[0]]])
    flat = (cast[:, :2] - lamp[:2]) @ turn.T / np.maximum(np.ptp((cast[:, :2] - lamp[:2]) @ turn.T, axis=0), 1e-9)
    return np.asarray(points[np.unique((flat @ toward).argmax(axis=0))])


class Shadows:
    """The shadows in the photographs of the left eyes, to be compared with the shadows of the visible parts of rocks.

    By azimuth, ``points`` (n, 3) are the points of rocks that can cast the outline of a shadow, and ``ends`` are the
    indices where the points of each rock end.
    """

    def __init__(self, terrain: Terrain, camera: Calibration, sand: Sand) -> None:
        self.camera, self.terrain = camera, terrain
        outlines: dict[int, list[Array]] = {azimuth: [] for azimuth in terrain.azimuths}
        levels = sand.heights(sand.middles)
        for rock, level in zip(terrain.rocks, levels, strict=True):
            points, faces = sand.visible(rock)
            for azimuth, found in outlines.items() if len(faces) else ():
                found.append(
                    _select_outline_points(points[np.unique(faces)], locate_surveyed_lamp(azimuth, sand), float(level))
                )
        self.points = {azimuth: np.concatenate(found) for azimuth, found in outlines.items() if found}
        self.ends = {azimuth: np.cumsum([len(each) for each in found])[:-1] for azimuth, found in outlines.items()}
        self.seen: dict[tuple[View, int], tuple[Array, Array]] = {}
        for view, azimuth in terrain.photographs:
            if view.eye == "L":
                rocks, shadow = (
                    fill_polygons(_MASK_SHAPE, [each * _MASK_SCALE for each in terrain.polygons(view, azimuth, kind)])
                    for kind in (ROCK, SHADOW)
                )
                self.seen[view, azimuth] = rocks, shadow & ~rocks

    def measure_agreement(self, azimuth: int, lamp: Array, heights: Callable[[Array], Array]) -> float:
        """Measure the mean intersection over union of a lamp's shadows, over the positions."""
        cast = trace_lamp_to_sand(self.points[azimuth], lamp, heights)
        found = []
        for (view, at), (rock, shadow) in self.seen.items():
            if at == azimuth:
                hulls = np.split(self.camera.eyes[view].project(cast) * _MASK_SCALE, self.ends[azimuth])
                found.append(compute_intersection_over_union(fill_hulls(_MASK_SHAPE, hulls) & ~rock, shadow))
        return float(np.mean(found))


def fit_lamps(terrain: Terrain, camera: Calibration, sand: Sand) -> tuple[dict[int, Array], Sand]:
    """Fit the position (3,), m, of the lamp at each azimuth, and the height of the sand at the ends of shadows. Returns
    both.

    A centimetre of sand moves the tip of a shadow by five, so lamps and sand are fitted one after the other.
    """
    shadows, table = Shadows(terrain, camera, sand), HeightTable(sand)
    flat = np.array([1.0, 1.0, 0.5])
    lamps = {azimuth: locate_surveyed_lamp(azimuth, sand) for azimuth in terrain.azimuths}
    for steps in (_LAMP_STEPS_M, _LAMP_STEPS_M[1:]):
        lamps = {
            azimuth: _descend_along_axes(
                lamp, partial(_disagreement, shadows, azimuth, table, locate_surveyed_lamp(azimuth, sand)), steps, flat
            )
            for azimuth, lamp in lamps.items()
        }
        sand = _raise_nodes(shadows, sand, table, lamps)
    return lamps, sand


def _disagreement(shadows: Shadows, azimuth: int, table: HeightTable, surveyed: Array, lamp: Array) -> float:
    prior = _SURVEY_COST * float((((lamp - surveyed) / _SURVEY_ERROR_M) ** 2).sum())
    return prior - shadows.measure_agreement(azimuth, lamp, table)


def _node_offset_m(table: HeightTable, sand: Sand, k: int) -> float:
    """Return the height of the surface above the plane at a node."""
    node = sand.nodes[k][None]
    return float((table(node) - sand.on_plane(node))[0])


def _raise_nodes(shadows: Shadows, sand: Sand, table: HeightTable, lamps: dict[int, Array]) -> Sand:
    """Raise or lower the sand at nodes at the ends of shadows, as long as this improves the agreement of the
    shadows."""
    raised = sand.raised.copy()
    reached = {
        azimuth: trace_lamp_to_sand(shadows.points[azimuth], lamp, table)[:, :2] for azimuth, lamp in lamps.items()
    }
    used = {
        k: [azimuth for azimuth, points in reached.items() if (np.hypot(*(points - node).T) < _NODE_REACH_M).any()]
        for k, node in enumerate(sand.nodes)
    }
    now = {azimuth: shadows.measure_agreement(azimuth, lamp, table) for azimuth, lamp in lamps.items()}
    for step in _NODE_STEPS_M:
        for k, azimuths in used.items():
            bump = sand.bump(k, table.grid).reshape(table.heights.shape) if azimuths else np.zeros(1)
            for move in (step, -step) if azimuths else ():
                if abs(raised[k] + move) > _MAX_RAISED_M or abs(_node_offset_m(table, sand, k) + move) > BOUND_M:
                    continue
                table.heights += move * bump
                found = {azimuth: shadows.measure_agreement(azimuth, lamps[azimuth], table) for azimuth in azimuths}
                cost = _RAISED_COST * ((raised[k] + move) ** 2 - raised[k] ** 2)
                if sum(found.values()) - sum(now[azimuth] for azimuth in azimuths) > cost:
                    now |= found
                    raised[k] += move
                    break
                table.heights -= move * bump
    return replace(sand, raised=raised)

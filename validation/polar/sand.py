"""The sand, whose scan is not public: a plane through the lower edges of the scanned rocks, and what it is off it.

Each scan has some sand around its rock, so its lower rim is a measurement of the sand's height. One plane goes through
all rims. At each rock the sand may be higher or lower, fitted to the outlines of the left eyes, in which it hides the
foot of the rock. Between the rocks these heights are interpolated as a Gaussian process, which returns to the plane.

The sand is **bounded**: ``BOUND_M`` is three times the standard deviation of 1.4 cm by which the rims of terrain 04 are
off their plane. It is **smooth**: it changes over ``LENGTH_M`` only. The lamps are 0.77 to 0.81 m above sand that is up
to 5.5 m away, so light falls with a slope of at least 0.14, and a Gaussian hill of 4 cm and this width has slopes up to
0.08. So no sand of one hill casts a shadow of its own; the comparison measures this in its renders.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...stereo.images.masks import distance_inside_hull_px, fill_polygons, fill_triangles, intersection_over_union
from ...support.arrays import Array, Numbers
from .camera import Calibration, find_extreme_points
from .data_set import ROCK, Rock, Terrain, View

#: Largest height of the sand off its plane, the length over which it changes, and the prior standard deviation of its
#: height at a rock; how well a height is known there; all in metres. They were chosen on terrain 04.
BOUND_M, LENGTH_M = 0.04, 0.3
_SPREAD_M, _KNOWN_M = 0.014, 0.004
#: Agreement of outlines that a height pays for being off the plane by one standard deviation.
_OFF_COST = 0.005
_OFF_STEPS_M = (0.01, 0.005, 0.0025)
#: Number of azimuths whose outlines are used; rocks do not move between them.
_AZIMUTHS = 2
#: Scale of the masks in which rocks are compared with their outlines.
_SCALE = 0.5
_MARGIN_PX = 15.0
#: Spacing in metres of the nodes at which the sand between the rocks may be raised; each is ``LENGTH_M`` wide.
NODE_M = 0.25


def find_rim(rock: Rock) -> Array:
    """Vertices (n, 3) on the open edges of a scan; all vertices if it is closed."""
    edges = np.sort(np.concatenate([rock.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    open_ends = np.unique(unique[count == 1])
    return np.asarray(rock.vertices[open_ends] if len(open_ends) else rock.vertices)


def _fit_rim_height(rock: Rock, middle: Array) -> float:
    """Height at the middle of a plane that most of the rim is on and little is under."""
    points = find_rim(rock)
    basis = np.column_stack([np.ones(len(points)), points[:, :2] - middle])
    heights = points[:, 2]
    weight = (heights <= np.quantile(heights, 0.6)).astype(np.float64)
    plane = np.zeros(3)
    for _ in range(30):
        plane = np.linalg.solve(
            (basis.T * weight) @ basis + 1e-5 * len(points) * np.diag([0.0, 1.0, 1.0]), (basis.T * weight) @ heights
        )
        above = np.maximum(heights - basis @ plane, 0.0)
        weight = 1 / (1 + (above / 0.004) ** 2) ** 2
    return float(plane[0])


@dataclass(frozen=True)
class Sand:
    """A plane (3,), height at the origin and slopes; at ``middles`` (n, 2) of scans the sand is ``offs`` (n,) metres
    above it.

    ``nodes`` (k, 2) have ``raised`` (k,) metres, by which the surface between the rocks is higher.
    """

    plane: Array
    middles: Array
    offs: Array
    nodes: Array
    raised: Array

    @property
    def level_m(self) -> float:
        """Median height at the rocks."""
        return float(np.median(self.on_plane(self.middles) + self.offs))

    def on_plane(self, xy: Array) -> Array:
        """Heights (n,) in metres of the plane at points (n, 2)."""
        return np.asarray(self.plane[0] + xy @ self.plane[1:])

    def heights(self, xy: Array) -> Array:
        """Heights (n,) in metres of the surface at points (n, 2), at most ``BOUND_M`` off the plane."""
        known = _gaussian_bumps(self.middles, self.middles) + (_KNOWN_M / _SPREAD_M) ** 2 * np.eye(len(self.middles))
        off = _gaussian_bumps(xy, self.middles) @ np.linalg.solve(known, self.offs)
        used = np.nonzero(self.raised)[0]
        off += _gaussian_bumps(xy, self.nodes[used]) @ self.raised[used]
        return np.asarray(self.on_plane(xy) + np.clip(off, -BOUND_M, BOUND_M))

    def bump(self, k: int, xy: Array) -> Array:
        """What node ``k`` adds to the surface at points (n, 2) for each metre that it is raised."""
        return _gaussian_bumps(xy, self.nodes[k][None])[:, 0]

    def visible(self, rock: Rock) -> tuple[Array, Array]:
        """Vertices and triangles of the part of a rock above the sand; vertices below are moved up to it."""
        return _cut_above(rock, self.heights(rock.vertices[:, :2]))


def _gaussian_bumps(xy: Array, middles: Array) -> Array:
    """Gaussians (n, k) about middles (k, 2) at points (n, 2)."""
    apart = ((xy[:, None] - middles[None]) ** 2).sum(axis=2)
    return np.asarray(np.exp(-apart / (2 * LENGTH_M**2)))


def _cut_above(rock: Rock, level: Array) -> tuple[Array, Array]:
    """Vertices and triangles of the part of a rock above ``level`` (n,) at its vertices, which are moved up to it."""
    up = rock.vertices[:, 2] > level
    raised = rock.vertices.copy()
    raised[:, 2] = np.maximum(raised[:, 2], level)
    return raised, rock.faces[up[rock.faces].any(axis=1)]


def _fit_plane(middles: Array, heights: Array) -> Array:
    """The plane (3,) that most of the heights (n,) at middles (n, 2) are on: those within some spreads of it count."""
    basis = np.column_stack([np.ones(len(middles)), middles])
    weight: Numbers = np.ones(len(middles))
    for _ in range(50):
        plane = np.linalg.solve((basis.T * weight) @ basis, (basis.T * weight) @ heights)
        weight = 1 / (1 + ((heights - basis @ plane) / _SPREAD_M) ** 2)
    return np.asarray(plane)


def fit_sand(terrain: Terrain, camera: Calibration) -> Sand:
    """The sand whose heights at the rocks agree best with the outlines in the photographs of the left eyes."""
    middles = np.array([(rock.vertices.min(axis=0) + rock.vertices.max(axis=0))[:2] / 2 for rock in terrain.rocks])
    rims = np.array([_fit_rim_height(rock, middle) for rock, middle in zip(terrain.rocks, middles, strict=True)])
    low, high = middles.min(axis=0) - 0.8, middles.max(axis=0) + 0.8
    axes = [np.arange(a, b + NODE_M, NODE_M) for a, b in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    sand = Sand(_fit_plane(middles, rims), middles, np.zeros(len(middles)), nodes, np.zeros(len(nodes)))
    views = [view for view in terrain.views if view.eye == "L"]
    own = {
        (view, azimuth): assign_outlines(terrain, camera, sand, view, azimuth)
        for view in views
        for azimuth in terrain.azimuths[:_AZIMUTHS]
    }
    heights = rims.copy()
    for k, rock in enumerate(terrain.rocks):
        on_plane = sand.on_plane(middles[k][None])[0]
        targets = _collect_targets(terrain, camera, own, views, k, rock)
        start = float(np.clip(rims[k] - on_plane, -BOUND_M, BOUND_M))
        heights[k] = on_plane + (_fit_offset(rock, sand, start, camera, targets) if targets else start)
    # The rims are the lower edges of the scans, and the sand is a little higher than most of them.
    plane = _fit_plane(middles, heights)
    offs = heights - plane[0] - middles @ plane[1:]
    return replace(sand, plane=plane, offs=np.clip(offs, -BOUND_M, BOUND_M))


_Target = tuple[View, Array, Array]


def _collect_targets(
    terrain: Terrain,
    camera: Calibration,
    own: dict[tuple[View, int], list[list[Array]]],
    views: list[View],
    k: int,
    rock: Rock,
) -> list[_Target]:
    """For each photograph with outlines of a rock: the view, the corner of a window around it, and their mask."""
    found = []
    for view in views:
        seen = camera.eyes[view].project(rock.vertices)
        corner = seen.min(axis=0) - _MARGIN_PX
        columns, rows = ((seen.max(axis=0) + _MARGIN_PX - corner) * _SCALE).astype(int) + 1
        for azimuth in terrain.azimuths[:_AZIMUTHS]:
            if outlines := own[view, azimuth][k]:
                found.append(
                    (
                        view,
                        corner,
                        fill_polygons((int(rows), int(columns)), [(each - corner) * _SCALE for each in outlines]),
                    )
                )
    return found


def _fit_offset(rock: Rock, sand: Sand, start: float, camera: Calibration, targets: list[_Target]) -> float:
    """How far the sand at a rock is above the plane, from a start."""

    def agreement(off: float) -> float:
        points, faces = _cut_above(rock, sand.on_plane(rock.vertices[:, :2]) + off)
        masks: dict[View, Array] = {}
        for view, corner, mask in targets:
            if view not in masks:
                masks[view] = fill_triangles(
                    (mask.shape[0], mask.shape[1]), (camera.eyes[view].project(points) - corner) * _SCALE, faces
                )
        found = np.mean([intersection_over_union(masks[view], mask) for view, _, mask in targets])
        return float(found - _OFF_COST * (off / _SPREAD_M) ** 2)

    best, score = start, agreement(start)
    for step in _OFF_STEPS_M:
        for move in (step, -step):
            while abs(best + move) <= BOUND_M and (found := agreement(best + move)) > score + 1e-4:
                best, score = best + move, found
    return best


def assign_outlines(terrain: Terrain, camera: Calibration, sand: Sand, view: View, azimuth: int) -> list[list[Array]]:
    """The outlines of each rock in a photograph: those whose middle is in the picture of the rock, or 10 px off it."""
    parts = []
    for rock in terrain.rocks:
        points, faces = sand.visible(rock)
        used = points[np.unique(faces)] if len(faces) else rock.vertices
        parts.append(camera.eyes[view].project(find_extreme_points(used)))
    found: list[list[Array]] = [[] for _ in terrain.rocks]
    for outline in terrain.polygons(view, azimuth, ROCK):
        middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
        inside = [distance_inside_hull_px(middle, part) for part in parts]
        if max(inside) > -10.0:
            found[int(np.argmax(inside))].append(outline)
    return found

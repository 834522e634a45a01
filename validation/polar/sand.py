"""The sand, whose scan is not public: a smooth surface through the lower edges of the scanned rocks.

Each scan has some sand around its rock. A plane through its lower rim is where the fit of that rock's sand starts; its
height and tilt are then fitted to the outlines of the left eyes, in which the sand hides the foot of the rock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...stereo.images.masks import fill_polygons, fill_triangles, inside_px, overlap
from ...support.arrays import Array
from .camera import Calibration, extreme_points
from .data_set import ROCK, Rock, Terrain, View

#: How far the plane of a rock's sand reaches beyond its scan, in metres, and the weight of the surface beyond.
_REACH_M, _BEYOND = 0.15, 0.1
_TILT_STEPS = ((0.01, 0.1), (0.005, 0.05), (0.0025, 0.025))
_MOST_TILT, _TILT_COST = 0.3, 0.5
#: Number of azimuths whose outlines are used; rocks do not move between them.
_AZIMUTHS = 2
#: Scale of the masks in which rocks are compared with their outlines.
_SCALE = 0.5
_MARGIN_PX = 15.0
#: Nodes of a correction of the surface: their spacing, and the width of each in metres.
NODE_M = 0.25
_NODE_WIDTH_M = 0.15


def rim(rock: Rock) -> Array:
    """Vertices (n, 3) on the open edges of a scan; all vertices if it is closed."""
    edges = np.sort(np.concatenate([rock.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    open_ends = np.unique(unique[count == 1])
    return np.asarray(rock.vertices[open_ends] if len(open_ends) else rock.vertices)


def _lower_plane(rock: Rock, middle: Array) -> Array:
    """Height at the middle, and slopes, of a plane that most of the rim is on and little is under."""
    points = rim(rock)
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
    return np.array([plane[0], *np.clip(plane[1:], -0.1, 0.1)])


@dataclass(frozen=True)
class Sand:
    """Planes (n, 3) of height and slopes at the rocks, about the middles (n, 2) of scans of half sizes (n, 2).

    ``nodes`` (k, 2) have ``raised`` (k,) metres, by which the surface between the rocks is higher.
    """

    middles: Array
    halves: Array
    planes: Array
    nodes: Array
    raised: Array

    def height_at_rock(self, k: int, xy: Array) -> Array:
        """Heights (n,) in metres of the plane of rock ``k`` at points (n, 2)."""
        return np.asarray(self.planes[k, 0] + (xy - self.middles[k]) @ self.planes[k, 1:])

    def heights(self, xy: Array) -> Array:
        """Heights (n,) in metres of the surface at points (n, 2)."""
        far = _quadratic(np.clip(xy, self.middles.min(axis=0) - 0.3, self.middles.max(axis=0) + 0.3))
        trend = (
            far @ np.linalg.lstsq(_quadratic(self.middles), self.planes[:, 0], rcond=None)[0]
            if len(self.middles) >= 12
            else np.full(len(xy), np.median(self.planes[:, 0]))
        )
        above, weights = _BEYOND * trend, np.full(len(xy), _BEYOND)
        for k, (middle, half) in enumerate(zip(self.middles, self.halves, strict=True)):
            beside = np.maximum(np.abs(xy - middle) - half, 0.0)
            weight = np.exp(-(beside**2).sum(axis=1) / (2 * _REACH_M**2))
            tilted = weight * np.clip((xy - middle) @ self.planes[k, 1:], -0.03, 0.03)  # level away from the rock
            above, weights = above + weight * (self.planes[k, 0] + tilted), weights + weight
        found = above / weights
        for k in np.nonzero(self.raised)[0]:
            found = found + self.raised[k] * self.bump(k, xy)
        return np.asarray(found)

    def bump(self, k: int, xy: Array) -> Array:
        """What node ``k`` adds to the surface at points (n, 2) for each metre that it is raised."""
        return np.asarray(np.exp(-((xy - self.nodes[k]) ** 2).sum(axis=1) / (2 * _NODE_WIDTH_M**2)))

    def visible(self, k: int, rock: Rock) -> tuple[Array, Array]:
        """Vertices and triangles of the part of a rock above its sand; vertices below are moved up to it."""
        level = self.height_at_rock(k, rock.vertices[:, :2])
        up = rock.vertices[:, 2] > level
        raised = rock.vertices.copy()
        raised[:, 2] = np.maximum(raised[:, 2], level)
        return raised, rock.faces[up[rock.faces].any(axis=1)]


def _quadratic(xy: Array) -> Array:
    x, y = xy[:, 0], xy[:, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def fit_sand(terrain: Terrain, camera: Calibration) -> Sand:
    """The sand whose planes at the rocks agree best with the outlines in the photographs of the left eyes."""
    boxes = [(rock.vertices[:, :2].min(axis=0), rock.vertices[:, :2].max(axis=0)) for rock in terrain.rocks]
    middles = np.array([(low + high) / 2 for low, high in boxes])
    low, high = middles.min(axis=0) - 0.8, middles.max(axis=0) + 0.8
    axes = [np.arange(a, b + NODE_M, NODE_M) for a, b in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    sand = Sand(
        middles,
        np.array([(high - low) / 2 for low, high in boxes]),
        np.array([_lower_plane(rock, middle) for rock, middle in zip(terrain.rocks, middles, strict=True)]),
        nodes,
        np.zeros(len(nodes)),
    )
    views = [view for view in terrain.views if view.eye == "L"]
    own = {
        (view, azimuth): assign_outlines(terrain, camera, sand, view, azimuth)
        for view in views
        for azimuth in terrain.azimuths[:_AZIMUTHS]
    }
    planes = sand.planes.copy()
    for k, rock in enumerate(terrain.rocks):
        targets = _targets(terrain, camera, own, views, k, rock)
        if targets:
            planes[k] = _fit_plane(rock, sand, k, camera, targets)
    return replace(sand, planes=planes)


_Target = tuple[View, Array, Array]


def _targets(
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


def _fit_plane(rock: Rock, sand: Sand, k: int, camera: Calibration, targets: list[_Target]) -> Array:
    def agreement(plane: Array) -> float:
        planes = sand.planes.copy()
        planes[k] = plane
        points, faces = replace(sand, planes=planes).visible(k, rock)
        masks: dict[View, Array] = {}
        for view, corner, mask in targets:
            if view not in masks:
                masks[view] = fill_triangles(
                    (mask.shape[0], mask.shape[1]), (camera.eyes[view].project(points) - corner) * _SCALE, faces
                )
        return float(
            np.mean([overlap(masks[view], mask) for view, _, mask in targets]) - _TILT_COST * (plane[1:] ** 2).sum()
        )

    best = sand.planes[k]
    # Of heights that agree alike, the one nearest to the rim is kept: it comes first.
    lifted = [best + np.array([lift, 0.0, 0.0]) for lift in (0.0, -0.01, 0.01, 0.02, 0.03, 0.04)]
    score, best = max(((agreement(plane), plane) for plane in lifted), key=lambda found: found[0])
    for steps in _TILT_STEPS:
        tried = [np.array(step) for step in np.diag([steps[0], steps[1], steps[1]])]
        moves = [sign * step for step in tried for sign in (1, -1)]
        for _ in range(3):
            better = False
            for move in moves:
                plane = best + move
                if np.abs(plane[1:]).max() > _MOST_TILT:
                    continue
                found = agreement(plane)
                if found > score + 1e-4:
                    score, best, better = found, plane, True
            if not better:
                break
    return best


def assign_outlines(terrain: Terrain, camera: Calibration, sand: Sand, view: View, azimuth: int) -> list[list[Array]]:
    """The outlines of each rock in a photograph: those whose middle is in the picture of the rock, or 10 px off it."""
    parts = []
    for k, rock in enumerate(terrain.rocks):
        points, faces = sand.visible(k, rock)
        used = points[np.unique(faces)] if len(faces) else rock.vertices
        parts.append(camera.eyes[view].project(extreme_points(used)))
    found: list[list[Array]] = [[] for _ in terrain.rocks]
    for outline in terrain.polygons(view, azimuth, ROCK):
        middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
        inside = [inside_px(middle, part) for part in parts]
        if max(inside) > -10.0:
            found[int(np.argmax(inside))].append(outline)
    return found

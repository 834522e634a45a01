"""The height of the sand, whose scan is not public: a plane through the skirts of the scans, and deviations from it.

Each scan has some sand around its rock, its skirt, which is a measurement of the sand. One plane goes through all
skirts. At each rock the sand is higher or lower, by the median of its skirt; no outline is used. Between the rocks
these heights are interpolated as a Gaussian process, which returns to the plane.

The sand is **bounded**: it is at most ``BOUND_M`` off its plane. It is **smooth**: its height changes over
``SMOOTHING_LENGTH_M``. The lamps are 0.77 to 0.81 m above sand that is up to 5.5 m away, so light falls with a slope of
at least 0.14, and a Gaussian hill of 4 cm and this width has slopes up to 0.08. So no single hill of sand casts a
shadow; the comparison measures this in its renders.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...stereo.images.masks import measure_distance_inside_hull_px
from ...support.arrays import Array, Numbers
from .camera import Calibration, find_extreme_points
from .data_set import ROCK, Rock, Terrain, View
from .skirts import BOUND_M, fit_rim_plane

#: Length in metres over which smooth sand changes, chosen on terrain 04.
SMOOTHING_LENGTH_M = 0.3
#: Prior standard deviation in metres of the height at a rock, chosen on terrain 04.
_PRIOR_SPREAD_M = 0.014
#: Standard error in metres of a height at a rock, chosen on terrain 04.
_HEIGHT_ERROR_M = 0.004
#: Spacing in metres of the nodes at which the sand between the rocks may be raised; each is ``SMOOTHING_LENGTH_M``
#: wide.
NODE_SPACING_M = 0.25


@dataclass(frozen=True)
class Sand:
    """The surface of the sand. ``plane`` (3,) is its height at the origin and its slopes. At the ``middles`` (n, 2) of
    scans the sand is ``offs`` (n,) metres above the plane. At the ``nodes`` (k, 2) between the rocks, it is raised by
    ``raised`` (k,) metres."""

    plane: Array
    middles: Array
    offs: Array
    nodes: Array
    raised: Array

    @property
    def level_m(self) -> float:
        """Median height of the sand at the rocks."""
        return float(np.median(self.on_plane(self.middles) + self.offs))

    def on_plane(self, xy: Array) -> Array:
        """Return the heights (n,), m, of the plane at points (n, 2)."""
        return np.asarray(self.plane[0] + xy @ self.plane[1:])

    def heights(self, xy: Array) -> Array:
        """Return the heights (n,), m, of the surface at points (n, 2), at most ``BOUND_M`` off the plane."""
        known = _evaluate_gaussians(self.middles, self.middles) + (_HEIGHT_ERROR_M / _PRIOR_SPREAD_M) ** 2 * np.eye(
            len(self.middles)
        )
        off = _evaluate_gaussians(xy, self.middles) @ np.linalg.solve(known, self.offs)
        used = np.nonzero(self.raised)[0]
        off += _evaluate_gaussians(xy, self.nodes[used]) @ self.raised[used]
        return np.asarray(self.on_plane(xy) + np.clip(off, -BOUND_M, BOUND_M))

    def bump(self, k: int, xy: Array) -> Array:
        """Return the height (n,) that node ``k`` adds to the surface at points (n, 2), per metre that the node is
        raised."""
        return _evaluate_gaussians(xy, self.nodes[k][None])[:, 0]

    def visible(self, rock: Rock) -> tuple[Array, Array]:
        """Return the vertices and triangles of the part of a rock above the sand. Vertices below the sand are moved up
        to it."""
        level = self.heights(rock.vertices[:, :2])
        up = rock.vertices[:, 2] > level
        raised = rock.vertices.copy()
        raised[:, 2] = np.maximum(raised[:, 2], level)
        return raised, rock.faces[up[rock.faces].any(axis=1) & ~rock.skirt]


def _evaluate_gaussians(xy: Array, middles: Array) -> Array:
    """Evaluate Gaussians about middles (k, 2) at points (n, 2); returns (n, k)."""
    apart = ((xy[:, None] - middles[None]) ** 2).sum(axis=2)
    return np.asarray(np.exp(-apart / (2 * SMOOTHING_LENGTH_M**2)))


def _fit_plane(middles: Array, heights: Array) -> Array:
    """Fit a plane (3,) to most of the heights (n,) at middles (n, 2): a height far from it has little weight."""
    basis = np.column_stack([np.ones(len(middles)), middles])
    weight: Numbers = np.ones(len(middles))
    for _ in range(50):
        plane = np.linalg.solve((basis.T * weight) @ basis, (basis.T * weight) @ heights)
        weight = 1 / (1 + ((heights - basis @ plane) / _PRIOR_SPREAD_M) ** 2)
    return np.asarray(plane)


def measure_sand(terrain: Terrain) -> Sand:
    """Fit the sand to the skirts of the scans, without photographs."""
    middles = np.array([(rock.vertices.min(axis=0) + rock.vertices.max(axis=0))[:2] / 2 for rock in terrain.rocks])
    rims = np.array([fit_rim_plane(rock.rim, middle)[0] for rock, middle in zip(terrain.rocks, middles, strict=True)])
    low, high = middles.min(axis=0) - 0.8, middles.max(axis=0) + 0.8
    axes = [np.arange(a, b + NODE_SPACING_M, NODE_SPACING_M) for a, b in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    sand = Sand(_fit_plane(middles, rims), middles, np.zeros(len(middles)), nodes, np.zeros(len(nodes)))
    above = rims - sand.on_plane(middles)
    for k, rock in enumerate(terrain.rocks):
        if len(points := rock.vertices[rock.faces[rock.skirt]].mean(axis=1)):
            above[k] = np.median(points[:, 2] - sand.on_plane(points[:, :2]))
    # The rims are the lower edges of the scans, and the sand is a little higher than most of them.
    heights = sand.on_plane(middles) + above
    plane = _fit_plane(middles, heights)
    offs = np.clip(heights - plane[0] - middles @ plane[1:], -BOUND_M, BOUND_M)
    return replace(sand, plane=plane, offs=offs)


def assign_outlines(terrain: Terrain, camera: Calibration, sand: Sand, view: View, azimuth: int) -> list[list[Array]]:
    """Assign the outlines of a photograph to rocks. The middle of an outline must be inside the projected rock, or
    within 10 px of it."""
    parts = []
    for rock in terrain.rocks:
        points, faces = sand.visible(rock)
        used = points[np.unique(faces)] if len(faces) else rock.vertices
        parts.append(camera.eyes[view].project(find_extreme_points(used)))
    found: list[list[Array]] = [[] for _ in terrain.rocks]
    for outline in terrain.polygons(view, azimuth, ROCK):
        middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
        inside = [measure_distance_inside_hull_px(middle, part) for part in parts]
        if max(inside) > -10.0:
            found[int(np.argmax(inside))].append(outline)
    return found

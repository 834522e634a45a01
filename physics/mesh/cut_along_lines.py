"""Cuts triangles along lines, so that an edge of the ground is an edge of its mesh.

Without cuts a crest looks like a saw: a vertex beside it is lower by its distance times the slope of the walls, and a
crest that runs obliquely to the mesh passes vertices at periodic distances. Vertices near the line are moved onto it,
and the triangles that it still crosses are cut, so that no sliver remains.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .split_triangles import split_at_sides

#: The signed distance, in metres, of places (x_m, y_m) from the nearest line. It may jump where another line becomes
#: the nearest.
Line = Callable[[Array, Array], Array]
#: Vertices nearer to the line than this share of their spacing are moved onto it. Below a half, no triangle folds.
_SNAP_SHARE = 0.42
#: Number of Newton's steps onto the line.
_NEWTON_STEPS = 3
#: Number of bisections of an edge, after which a double is exact.
_BISECTIONS = 40
#: Spacing of the coarsest triangles that are cut, over the distance between lines.
_COARSEST_CUT = 0.15
#: Largest change of the signed distance along an edge that is no jump, over the distance between lines.
_LARGEST_CHANGE = 0.4
#: Twice the area, in squared spacings, below which a triangle counts as folded.
_MIN_DOUBLE_AREA = 0.05


@dataclass(frozen=True)
class CutMesh:
    """Positions (n, 2) and triangles (m, 3) of a mesh; ``on_line`` (n,) is true for positions on a line."""

    places: Array
    faces: Array
    on_line: Array

    def find_sharp_edges(self) -> Array:
        """Find the edges (k, 2) of the triangles that lie on a line."""
        faces = self.faces[self.on_line[self.faces].sum(axis=1) > 1]  # a hundredth of all
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        return np.unique(edges[self.on_line[edges].all(axis=1)], axis=0)


def cut_along_lines(places: Array, faces: Array, step_m: Array, line: Line, apart_m: float) -> CutMesh:
    """Cut triangles along lines that are about ``apart_m`` apart. ``step_m`` (n,) is the length of the edges at each
    place. Triangles too coarse for the lines stay whole, and so do edges along which ``line`` jumps from the
    surroundings of one line to another's.
    """
    fine = np.flatnonzero((step_m[faces] < _COARSEST_CUT * apart_m).sum(axis=1) > 1)
    if not fine.size:
        return CutMesh(places, faces, np.zeros(len(places), bool))
    few, local = np.unique(faces[fine], return_inverse=True)
    cut = _cut_fine(places[few], local.reshape(-1, 3), step_m[few], line, apart_m, few == 0)
    # The new places follow the old ones.
    number = np.concatenate([few, len(places) + np.arange(len(cut.places) - len(few))])
    moved = np.concatenate([places, cut.places[len(few) :]])
    moved[few] = cut.places[: len(few)]
    on_line = np.zeros(len(moved), bool)
    on_line[number] = cut.on_line
    return CutMesh(
        moved, np.concatenate([np.delete(faces, fine, axis=0), number[cut.faces].astype(faces.dtype)]), on_line
    )


def _cut_fine(places: Array, faces: Array, step_m: Array, line: Line, apart_m: float, fixed: Array) -> CutMesh:
    """Cut triangles with at least two corners that are fine enough; see ``cut_along_lines``."""
    places, widest_m = np.array(places, np.float64), _LARGEST_CHANGE * apart_m
    value = line(places[:, 0], places[:, 1])
    value[step_m >= _COARSEST_CUT * apart_m] = np.nan  # no edge to such a corner is cut, in either of its triangles
    near = np.unique(faces[_find_crossed(value, faces, widest_m)])
    near = near[(np.abs(value[near]) < 2 * _SNAP_SHARE * step_m[near]) & ~fixed[near]]
    moved, reached = _move_onto_line(places[near], line, _SNAP_SHARE * step_m[near])
    near, moved = near[reached], moved[reached]
    on_line = _move_without_folding(places, faces, near, moved, step_m)
    value[on_line] = 0.0
    return _split_crossed(places, faces, value, on_line, _find_crossed(value, faces, widest_m), line, widest_m)


def _move_without_folding(places: Array, faces: Array, which: Array, moved: Array, step_m: Array) -> Array:
    """Move places, in place, except where a triangle would lose nearly all of its area. Return which places moved, bool
    (n,).
    """
    start, on_line = places[which].copy(), np.zeros(len(places), bool)
    places[which], on_line[which] = moved, True
    least = _MIN_DOUBLE_AREA * step_m[faces[:, 0]] ** 2
    around = np.flatnonzero(on_line[faces].any(axis=1))
    while True:
        a, b, c = (places[faces[around, k]] for k in range(3))
        (u, v), (p, q) = (b - a).T, (c - a).T
        folded = np.unique(faces[around[u * q - v * p < least[around]]])
        folded = folded[on_line[folded]]
        if not folded.size:
            return on_line
        on_line[folded] = False
        back = np.isin(which, folded)
        places[which[back]] = start[back]


def _edge_crosses_line(value: Array, start: Array, end: Array, widest_m: float) -> Array:
    """Return whether a line crosses edges, from the signed distances at their ends."""
    one, other = value[start], value[end]
    return (one * other < 0.0) & (np.abs(one - other) < widest_m)


def _find_crossed(value: Array, faces: Array, widest_m: float) -> Array:
    """Find the indices of the triangles with an edge that a line crosses."""
    edges = [_edge_crosses_line(value, faces[:, k], faces[:, (k + 1) % 3], widest_m) for k in range(3)]
    return np.flatnonzero(np.logical_or.reduce(edges))


def _move_onto_line(start: Array, line: Line, furthest_m: Array) -> tuple[Array, Array]:
    """Find places on the line near the ``start`` places, and whether each is within ``furthest_m``."""
    places, h = start.copy(), 1e-3 * furthest_m
    for _ in range(_NEWTON_STEPS if len(start) else 0):
        x, y = places.T
        value = line(x, y)
        slope = np.stack([line(x + h, y) - line(x - h, y), line(x, y + h) - line(x, y - h)], axis=1) / (2 * h)[:, None]
        steepness = np.maximum(np.square(slope).sum(axis=1), 1e-12)
        places -= (value / steepness)[:, None] * slope
    left = np.abs(line(*places.T)) if len(start) else furthest_m
    return places, (np.hypot(*(places - start).T) <= furthest_m) & (left < 1e-3 * furthest_m)


def _split_crossed(
    places: Array,
    faces: Array,
    value: Array,
    on_line: Array,
    crossed: Array,
    line: Line,
    widest_m: float,
) -> CutMesh:
    some = faces[crossed]
    pairs = np.stack([np.sort(some[:, [k, (k + 1) % 3]], axis=1) for k in range(3)], axis=1)  # (c, 3 edges, 2)
    cut = _edge_crosses_line(value, pairs[..., 0], pairs[..., 1], widest_m)
    edges, which = np.unique(pairs[cut], axis=0, return_inverse=True)
    new = len(places) + np.arange(len(edges))
    middle = np.full(pairs.shape[:2], -1)
    middle[cut] = new[which.ravel()]
    places = np.concatenate([places, _bisect_edges(places, edges, value, line)])
    on_line = np.concatenate([on_line, np.ones(len(edges), bool)])
    made = np.concatenate([np.delete(faces, crossed, axis=0), split_at_sides(some, middle)[0]])
    return CutMesh(places, made.astype(faces.dtype), on_line)


def _bisect_edges(places: Array, edges: Array, value: Array, line: Line) -> Array:
    """Find the places (k, 2) at which the line crosses each edge (k, 2)."""
    start, end = places[edges[:, 0]].copy(), places[edges[:, 1]].copy()
    sign = np.sign(value[edges[:, 0]])
    for _ in range(_BISECTIONS if len(edges) else 0):
        half = 0.5 * (start + end)
        same = (np.sign(line(half[:, 0], half[:, 1])) == sign)[:, None]
        start, end = np.where(same, half, start), np.where(same, end, half)
    return 0.5 * (start + end)

"""A hole in a mesh for the finer patch of a trench: the triangles to remove, and the loop of vertices around the
hole.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Maximum number of passes that remove triangles at vertices where the rim meets itself.
_MAX_PINCH_PASSES = 8
#: Largest distance of an edge from the side that it lies on, over the length of the side.
_ON_SIDE_DISTANCE = 1.0e-3


def cut_hole(
    positions: Array, faces: Array, bounds_m: tuple[float, float, float, float], free_m: float
) -> tuple[Array, Array] | None:
    """Cut a hole into a mesh. Return the mask (m,) of the triangles that stay, and the counter-clockwise loop of
    vertices around the hole. None if the rim is not one closed loop, or if the mesh does not surround it.

    Triangles are removed if their box meets the rectangle west, south, east, north, widened by ``free_m``; if they are
    at a vertex where the rim would meet itself; or if a seam joins them to removed triangles. At a seam several small
    triangles lie along one side of a larger triangle.
    """
    west, south, east, north = bounds_m
    meets = np.ones(len(faces), bool)
    for axis, low, high in ((0, west, east), (1, south, north)):
        values = positions[:, axis]
        corners = [values[faces[:, k]] for k in range(3)]
        meets &= np.maximum(np.maximum(corners[0], corners[1]), corners[2]) >= low - free_m
        meets &= np.minimum(np.minimum(corners[0], corners[1]), corners[2]) <= high + free_m
    for _ in range(_MAX_PINCH_PASSES):
        meets, rim = _close_seams(positions, faces, meets)
        starts, times = np.unique(rim[:, 0], return_counts=True)
        if not (times > 1).any():
            break
        meets = meets | np.isin(faces, starts[times > 1]).any(axis=1)
    loop = _order_loop(rim)
    if loop is None:
        return None
    x, y = positions[loop, 0], positions[loop, 1]
    if x.min() > west - free_m or x.max() < east + free_m or y.min() > south - free_m or y.max() < north + free_m:
        return None
    return ~meets, loop


def _close_seams(positions: Array, faces: Array, meets: Array) -> tuple[Array, Array]:
    """Find the triangles to remove, bool (m,), including triangles across a seam, and the edges (k, 2) between them and
    the others.
    """
    while True:
        edges, owners, sides = _find_seams(positions, faces, meets)
        grown, across = meets.copy(), owners[sides]
        while len(across) and (open_seams := grown[across[:, 0]] != grown[across[:, 1]]).any():
            grown[across[open_seams]] = True
        if (grown == meets).all():  # the added triangles may have seams too
            break
        meets = grown
    rim, _ = _find_rim_edges(faces[meets])
    many = len(positions)
    seams = edges[np.unique(sides)]
    return meets, rim[~np.isin(rim[:, 0] * many + rim[:, 1], seams[:, 0] * many + seams[:, 1])]


def _find_seams(positions: Array, faces: Array, meets: Array) -> tuple[Array, Array, Array]:
    """Find edges (k, 2) near the triangles to remove, the triangle of each edge (k,), and pairs (n, 2) of edge indices:
    the first edge belongs to a larger triangle, and the second lies along it.
    """
    used = np.zeros(len(positions), bool)
    used[faces[meets]] = True
    around = np.zeros(len(positions), bool)
    around[faces[used[faces].any(axis=1)]] = True  # small triangles along a side have additional corners
    near = np.flatnonzero(around[faces].any(axis=1))
    edges, owners = _find_rim_edges(faces[near])
    owners = near[owners]
    begin, end = positions[edges[:, 0], :2], positions[edges[:, 1], :2]
    along, middle = end - begin, (begin + end) / 2
    length2 = np.maximum((along**2).sum(axis=1), 1e-30)
    pairs: list[tuple[int, int]] = []
    for k in np.flatnonzero(used[edges].any(axis=1)):
        off = middle - begin[k]
        share = off @ along[k] / length2[k]
        aside = np.abs(off[:, 0] * along[k, 1] - off[:, 1] * along[k, 0]) / length2[k]
        found = np.flatnonzero((share > 0) & (share < 1) & (aside < _ON_SIDE_DISTANCE))
        pairs += [(int(k), int(j)) for j in found if owners[j] != owners[k]]
    return edges, owners, np.array(pairs, np.int64).reshape(-1, 2)


def _order_loop(once: Array) -> Array | None:
    """Order the vertices of edges (k, 2); None if they are not one loop."""
    if not len(once):
        return None
    follows = dict(once.tolist())
    if len(follows) != len(once):
        return None
    loop = [int(once[0, 0])]
    while (after := follows.get(loop[-1], loop[0])) != loop[0]:
        loop.append(after)
    return np.array(loop) if len(loop) == len(once) else None


def _find_rim_edges(faces: Array) -> tuple[Array, Array]:
    """Find the edges (k, 2) of triangles that have a triangle on their left only, and the index of this triangle
    (k,).
    """
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    many = int(faces.max()) + 1 if len(faces) else 1
    forward, backward = edges[:, 0] * many + edges[:, 1], edges[:, 1] * many + edges[:, 0]
    once = np.flatnonzero(~np.isin(forward, backward))
    return edges[once], once // 3


def list_grid_rim(rows: int, columns: int) -> Array:
    """List the indices of the vertices on the rim of a grid, counter-clockwise from the first."""
    number = np.arange(rows * columns).reshape(rows, columns)
    return np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])


def is_inside_loop(points: Array, loop: Array) -> Array:
    """Return whether points (n, 2) are inside a loop (k, 2): whether a ray eastward crosses it an odd number of
    times.
    """
    inside = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(loop, np.roll(loop, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crosses = (points[:, 1] >= y0) != (points[:, 1] >= y1)
        inside ^= crosses & (points[:, 0] < x0 + (points[:, 1] - y0) / (y1 - y0) * (x1 - x0))
    return inside

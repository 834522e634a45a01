"""A hole in a mesh of triangles for a finer patch: which triangles go, and the loop of vertices round it."""

from __future__ import annotations

import numpy as np


def cut_hole(positions: np.ndarray, faces: np.ndarray, bounds_m: tuple[float, float, float, float],
             free_m: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Which triangles (m,) of a mesh stay, and the loop of vertices, counter-clockwise, round those that do not.

    All go whose box meets the rectangle west, south, east, north, widened by ``free_m``. None if the rim is not one
    loop that closes, or the mesh does not go all round it.
    """
    west, south, east, north = bounds_m
    meets = np.ones(len(faces), bool)
    for axis, low, high in ((0, west, east), (1, south, north)):
        values = positions[:, axis]
        corners = [values[faces[:, k]] for k in range(3)]
        meets &= np.maximum(np.maximum(corners[0], corners[1]), corners[2]) >= low - free_m
        meets &= np.minimum(np.minimum(corners[0], corners[1]), corners[2]) <= high + free_m
    loop = _rim(faces[meets])
    if loop is None:
        return None
    x, y = positions[loop, 0], positions[loop, 1]
    if x.min() > west - free_m or x.max() < east + free_m or y.min() > south - free_m or y.max() < north + free_m:
        return None
    return ~meets, loop


def _rim(faces: np.ndarray) -> np.ndarray | None:
    """The vertices round triangles, in order; None if they are not one loop."""
    if not len(faces):
        return None
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    many = int(faces.max()) + 1
    forward, backward = edges[:, 0] * many + edges[:, 1], edges[:, 1] * many + edges[:, 0]
    once = edges[~np.isin(forward, backward)]
    follows = dict(once.tolist())
    if len(follows) != len(once):
        return None
    loop = [int(once[0, 0])]
    while (after := follows.get(loop[-1], loop[0])) != loop[0]:
        loop.append(after)
    return np.array(loop) if len(loop) == len(once) else None


def rim_of(rows: int, columns: int) -> np.ndarray:
    """Numbers of the vertices on the rim of a grid, counter-clockwise from the first."""
    number = np.arange(rows * columns).reshape(rows, columns)
    return np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])


def inside_loop(points: np.ndarray, loop: np.ndarray) -> np.ndarray:
    """Whether points (n, 2) are inside a loop (k, 2): whether a ray eastward crosses it an odd number of times."""
    inside = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(loop, np.roll(loop, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crosses = (points[:, 1] >= y0) != (points[:, 1] >= y1)
        inside ^= crosses & (points[:, 0] < x0 + (points[:, 1] - y0) / (y1 - y0) * (x1 - x0))
    return inside

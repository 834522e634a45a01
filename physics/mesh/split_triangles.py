"""Cuts some triangles of a mesh into equal smaller triangles, without a crack to the triangles that stay whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array


@dataclass(frozen=True)
class SplitMesh:
    """A mesh after the cut.

    Its first vertices are the vertices from before the cut. Each added vertex is the mean of three earlier vertices,
    ``parents`` (a, 3), with ``weights`` (a, 3). ``faces`` (m, 3) int32 are the triangles, uncut ones first; ``cut``
    (m,) is true for parts of a cut triangle. ``bordering`` (n,) is true for a vertex that touches, or lies on an edge
    of, an uncut triangle.
    """

    parents: Array
    weights: Array
    faces: Array
    cut: Array
    bordering: Array

    def spread(self, values: Array) -> Array:
        """Compute values (n, …) of all vertices from the ``values`` of the vertices before the cut."""
        of_parents = np.asarray(values)[self.parents]
        weights = self.weights.reshape(self.weights.shape + (1,) * (of_parents.ndim - 2))
        return np.concatenate([values, (of_parents * weights).sum(axis=1)])


def split_triangles(faces: Array, which: Array, vertices: int, parts: int) -> SplitMesh:
    """Cut each side of the triangles in the mask ``which`` (k,) into equal ``parts``; the mesh has ``vertices``
    vertices. Both triangles at an edge get the same vertices on it. Vertices on the border of the mask lie on straight
    edges of uncut triangles, so they must not be moved."""
    chosen = faces[which].astype(np.int64)
    begin, end = chosen, chosen[:, [1, 2, 0]]
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    keys, edge, uses = np.unique((low * vertices + high).ravel(), return_inverse=True, return_counts=True)
    edge = edge.reshape(-1, 3)
    along, inside = parts - 1, (parts - 1) * (parts - 2) // 2
    first_inside = vertices + along * len(keys)

    def on_edge(side: int, step: int) -> Array:
        """Return the vertices ``step`` parts from the start of a side, of each triangle."""
        from_low = np.where(begin[:, side] == low[:, side], step, parts - step)
        return np.asarray(vertices + along * edge[:, side] + from_low - 1)

    ids: dict[tuple[int, int], Array] = {(0, 0): chosen[:, 0], (parts, 0): chosen[:, 1], (0, parts): chosen[:, 2]}
    for k in range(1, parts):
        ids[k, 0], ids[parts - k, k], ids[0, parts - k] = on_edge(0, k), on_edge(1, k), on_edge(2, k)
    middle = [(i, j) for j in range(1, parts) for i in range(1, parts - j)]
    for k, place in enumerate(middle):
        ids[place] = first_inside + inside * np.arange(len(chosen)) + k
    up = [((i, j), (i + 1, j), (i, j + 1)) for j in range(parts) for i in range(parts - j)]
    down = [((i + 1, j), (i + 1, j + 1), (i, j + 1)) for j in range(parts - 1) for i in range(parts - 1 - j)]
    small = np.concatenate([np.stack([ids[corner] for corner in corners], axis=1) for corners in (*up, *down)])

    share = np.tile(np.arange(1, parts) / parts, len(keys))
    ends = np.repeat(np.stack([keys // vertices, keys % vertices, keys % vertices], axis=1), along, axis=0)
    weights = np.array([[parts - i - j, i, j] for i, j in middle]).reshape(-1, 3) / parts
    border = np.concatenate(
        [np.zeros(vertices, bool), np.repeat(uses == 1, along), np.zeros(inside * len(chosen), bool)]
    )
    border[np.unique(faces[~which])] = True
    return SplitMesh(
        np.concatenate([ends, np.repeat(chosen, inside, axis=0)]),
        np.concatenate([np.stack([1.0 - share, share, 0.0 * share], axis=1), np.tile(weights, (len(chosen), 1))]),
        np.concatenate([faces[~which], small]).astype(np.int32),
        np.repeat([False, True], [int(np.sum(~which)), len(small)]),
        border,
    )


def split_at_sides(faces: Array, middle: Array) -> tuple[Array, Array]:
    """Cut triangles (c, 3) at vertices ``middle`` (c, 3) on their sides. Return the parts (m, 3), and the index (m,) of
    the original triangle of each. Side k goes from corner k to the next; -1 is a side without a cut. Each triangle has
    at least one cut.
    """
    made: list[Array] = []
    which: list[Array] = []
    number, index = (middle >= 0).sum(axis=1), np.arange(len(faces))

    def add(some: Array, *corners: tuple[Array, Array, Array]) -> None:
        made.extend(np.stack(each, axis=1)[some] for each in corners)
        which.extend([index[some]] * len(corners))

    for k in range(3):
        a, b, c = (faces[:, (k + j) % 3] for j in range(3))
        ab, bc, ca = (middle[:, (k + j) % 3] for j in range(3))
        add((number == 1) & (ab >= 0), (a, ab, c), (ab, b, c))
        add((number == 2) & (ca < 0), (ab, b, bc), (a, ab, bc), (a, bc, c))
    a, b, c = faces.T
    ab, bc, ca = middle.T
    add(number == 3, (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate(made), np.concatenate(which)

"""The faults of a triangle mesh, and their repair.

Reconstructed meshes come with holes, flipped and doubled faces and vertices that are not finite. All functions take
``positions`` (n, 3) and ``faces`` (m, 3) of vertex indices, and leave these arrays unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ...support.number_text import format_count

_AXES = "XYZ"


@dataclass(frozen=True)
class MeshReport:
    """Counts of a mesh's parts and faults. ``facing_down`` is a share of the area, ``extents_m`` (3,) are metres.

    ``boundary_loops`` are the rims of holes; an open sheet has one, its outer rim. ``inconsistent_edges`` lie between
    two faces, one of them turned inside out. ``up`` is the axis toward which most of the area faces.
    """

    vertices: int
    triangles: int
    non_finite_vertices: int
    degenerate_faces: int
    duplicate_vertices: int
    duplicate_faces: int
    boundary_edges: int
    boundary_loops: int
    non_manifold_edges: int
    inconsistent_edges: int
    facing_down: float
    parts: int
    area_m2: float
    extents_m: tuple[float, float, float]
    up: str

    def lines(self) -> list[str]:
        """Describe the report as lines of text, without counts of 0."""
        size = " x ".join(f"{e:.4g}" for e in self.extents_m)
        rim = f" beside the outer rim ({format_count(self.boundary_edges, 'open edge')})"
        counted = (
            (self.non_finite_vertices, ("vertex", "vertices"), " without finite coordinates"),
            (self.duplicate_vertices, ("duplicate vertex", "duplicate vertices"), ""),
            (self.duplicate_faces, ("duplicate face",), ""),
            (self.degenerate_faces, ("face",), " without area"),
            (max(self.boundary_loops - 1, 0), ("hole",), rim),
            (self.non_manifold_edges, ("edge",), " shared by more than two faces"),
            (self.inconsistent_edges, ("edge",), " between a face and a flipped one"),
            (max(self.parts - 1, 0), ("loose part",), " beside the largest"),
        )
        found = [format_count(n, *noun) + rest for n, noun, rest in counted if n]
        if self.facing_down > 0.001:
            found.append(f"{self.facing_down:.1%} of the area faces down")
        return [
            f"{format_count(self.vertices, 'vertex', 'vertices')}, {format_count(self.triangles, 'triangle')}, "
            f"{size} m, "
            f"{self.area_m2:.4g} m²",
            *found,
        ]


def face_normals(positions: Array, faces: Array) -> Array:
    """Compute the normals (m, 3) of triangles; their length is twice the area."""
    a, b, c = (np.asarray(positions, np.float64)[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def label_components(n: int, a: Array, b: Array) -> Array:
    """Label each of n nodes by the smallest node of its component, (n,). Links connect the nodes ``a`` and ``b``."""
    label = np.arange(n)
    while len(a):
        low = np.minimum(label[a], label[b])
        np.minimum.at(label, label[a], low)
        np.minimum.at(label, label[b], low)
        while not np.array_equal(label, shorter := label[label]):
            label = shorter
        apart = label[a] != label[b]
        a, b = a[apart], b[apart]
    return label


def find_equal_rows(rows: Array) -> tuple[Array, Array]:
    """Find the index (k,) of the first occurrence of each distinct row, and for each row (n,) its index among the
    distinct rows.

    ``np.unique`` along an axis does the same ten times slower.
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    new = np.ones(len(rows), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    which = np.empty(len(rows), np.int64)
    which[order] = np.cumsum(new) - 1
    return order[new], which


def _count_groups(label: Array) -> int:
    """Count the connected components, from the label of each node."""
    return int(np.count_nonzero(label == np.arange(len(label))))


@dataclass(frozen=True)
class _Edges:
    """The half-edges of faces, sorted by edge. ``face`` (k,) is the face of a half-edge; ``forward`` (k,) is true if it
    runs from the smaller to the larger vertex. ``first`` (e,) is the first half-edge of an edge, ``count`` (e,) the
    edge's number of half-edges, and ``ends`` (e, 2) its vertices, the smaller first.
    """

    face: Array
    forward: Array
    first: Array
    count: Array
    ends: Array


def _sort_edges(faces: Array, vertices: int) -> _Edges:
    """Sort the half-edges of faces (m, 3) by edge; ``vertices`` is the number of vertices."""
    begin, end = faces[:, [0, 1, 2]].ravel().astype(np.int64), faces[:, [1, 2, 0]].ravel().astype(np.int64)
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    order = np.argsort(low * vertices + high, kind="stable")
    key = (low * vertices + high)[order]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    return _Edges(
        order // 3,
        (begin < end)[order],
        first,
        np.diff(first, append=len(key)),
        np.stack([low[order][first], high[order][first]], axis=1),
    )


def _find_neighbours(edges: _Edges) -> tuple[Array, Array, Array]:
    """Find the two faces of each edge that exactly two faces share, and whether both have the same orientation."""
    at = edges.first[edges.count == 2]
    return edges.face[at], edges.face[at + 1], edges.forward[at] != edges.forward[at + 1]


def examine_mesh(positions: Array, faces: Array) -> MeshReport:
    """Examine a mesh. Vertices that are not finite are counted and left out of everything else."""
    finite = np.isfinite(positions).all(axis=1)
    good = faces[finite[faces].all(axis=1)]
    normals = face_normals(positions, good)
    twice = np.linalg.norm(normals, axis=1)
    size = np.ptp(positions[finite], axis=0).astype(np.float64) if finite.any() else np.zeros(3)
    edges = _sort_edges(good, len(positions))
    one, other, alike = _find_neighbours(edges)
    rim = edges.ends[edges.count == 1]
    part = label_components(len(good), one, other)
    corners = np.unique(rim)
    loops = label_components(len(corners), *np.searchsorted(corners, rim).T)
    total = float(twice.sum())
    facing = np.abs(normals).sum(axis=0)
    return MeshReport(
        vertices=len(positions),
        triangles=len(faces),
        non_finite_vertices=int((~finite).sum()),
        degenerate_faces=int(_find_degenerate(positions, good, twice).sum()),
        duplicate_vertices=int(finite.sum()) - len(find_equal_rows(positions[finite])[0]),
        duplicate_faces=len(good) - len(find_equal_rows(np.sort(good, axis=1))[0]),
        boundary_edges=len(rim),
        boundary_loops=_count_groups(loops),
        non_manifold_edges=int((edges.count > 2).sum()),
        inconsistent_edges=int((~alike).sum()),
        facing_down=float(twice[normals[:, 2] < 0].sum()) / total if total else 0.0,
        parts=_count_groups(part),
        area_m2=total / 2,
        extents_m=(float(size[0]), float(size[1]), float(size[2])),
        up=_AXES[int(np.argmax(facing))],
    )


def _find_degenerate(positions: Array, faces: Array, twice_area: Array) -> Array:
    """Find the faces, bool (m,), of finite vertices without area, within the rounding of single precision. Rounding
    grows with the distance from the middle, and a site with ground to the horizon has fine triangles near the middle.
    """
    if not len(faces):
        return np.zeros(0, bool)
    middle = np.median(positions[np.isfinite(positions).all(axis=1)], axis=0)
    away = np.abs(positions - middle).max(axis=1)
    return np.asarray(twice_area <= 1e-14 * np.maximum(away[faces].max(axis=1), 1e-30) ** 2)


def repair_mesh(positions: Array, faces: Array, uv: Array | None = None) -> tuple[Array, Array, Array | None]:
    """Return the mesh without parts that cannot be rendered, and with its upper side up.

    Faces without area, doubled faces, and faces with a vertex that is not finite are dropped. Vertices of equal
    coordinates are merged. The faces of each part are turned alike: an open part up, a closed part outward. Holes stay,
    since nothing was measured there. ``uv`` (m, 3, 2) belongs to the corners of faces and is repaired with them.
    Vertices are merged across a seam of the image, but the seam stays.
    """
    finite = np.isfinite(positions).all(axis=1)
    of_face = np.flatnonzero(finite[faces].all(axis=1))
    faces = faces[of_face]
    first, which = find_equal_rows(positions[finite])
    kept = positions[finite][first]
    index = np.zeros(len(positions), np.int64)
    index[finite] = which
    faces = index[faces]
    solid = ~_find_degenerate(kept, faces, np.linalg.norm(face_normals(kept, faces), axis=1))
    faces, of_face = faces[solid], of_face[solid]
    once = np.sort(find_equal_rows(np.sort(faces, axis=1))[0])
    faces, of_face = faces[once], of_face[once]
    turned = orient_faces(kept, faces)
    if uv is not None:
        uv = np.where((turned[:, 0] != faces[:, 0])[:, None, None], uv[of_face][:, ::-1], uv[of_face])
    used = np.zeros(len(kept), bool)
    used[turned] = True
    return kept[used], (np.cumsum(used) - 1)[turned].astype(np.int32), uv


def orient_faces(positions: Array, faces: Array) -> Array:
    """Turn the faces alike within each part: an open part up, a closed part outward.

    Every face is two nodes, one for each orientation. Links connect states that fit together, so that one component
    contains a consistent choice for a part. A part with both states of a face in one component cannot be turned alike
    (a Möbius strip) and stays unchanged.
    """
    m = len(faces)
    edges = _sort_edges(faces, len(positions))
    one, other, alike = _find_neighbours(edges)
    away = np.where(alike, other, other + m)
    back = np.where(alike, other + m, other)
    state = label_components(2 * m, np.concatenate([one, one + m]), np.concatenate([away, back]))
    part = np.minimum(state[:m], state[m:])
    turn = (state[:m] != part) & (state[:m] != state[m:])
    faces = np.where(turn[:, None], faces[:, ::-1], faces)
    normals = face_normals(positions, faces)
    open_part = np.zeros(m, bool)
    open_part[part[edges.face[edges.first[edges.count != 2]]]] = True
    # A closed part faces outward if its volume is positive: the sum over faces of a corner, seen from the part's
    # middle, times the normal.
    corner = np.asarray(positions, np.float64)[faces[:, 0]]
    count = np.maximum(np.bincount(part, minlength=m), 1)
    middle = np.stack([np.bincount(part, corner[:, k], m) / count for k in range(3)], axis=1)
    volume = np.bincount(part, ((corner - middle[part]) * normals).sum(axis=1), m)
    up = np.bincount(part, normals[:, 2], m)
    down = np.where(open_part, up, volume)[part] < 0
    return np.where(down[:, None], faces[:, ::-1], faces)

"""UV coordinates of a triangle mesh: the position on an image of each corner of each face.

They belong to corners, not to vertices, because the two sides of a seam lie apart on the image. ``uv`` is (m, 3, 2)
float32: u to the right and v up, with 0 at the image's lower left corner and 1 at its upper right corner.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Number of surface points over which an image is averaged; the mean is right within 1/256 of the image's contrast.
_SURFACE_POINTS = 65536
#: Step that fills a line evenly (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
_LINE_STEP = 0.6180339887498949
#: Steps that fill a square evenly.
_SQUARE_STEPS = (0.7548776662466927, 0.5698402909980532)


def halve_coordinates(uv: Array) -> Array:
    """Compute the coordinates of the triangles into which ``halve_edges`` cuts each triangle, in its order."""
    a, b, c = uv[:, 0], uv[:, 1], uv[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate(
        [np.stack(corners, axis=1) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )


def repair_coordinates(uv: Array) -> tuple[Array | None, list[str]]:
    """Replace NaN and infinity in coordinates by 0. Return the coordinates, None if they cover no area, and sentences
    about them.
    """
    known = np.isfinite(uv).all(axis=2)
    kept = np.where(known[..., None], uv, np.float32(0.0))
    edges = (kept[:, 1:] - kept[:, :1]).astype(np.float64)
    area = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    if not area.any():
        return None, ["UV coordinates that cover no area of an image and are left out"]
    low, high = kept[known].min(axis=0), kept[known].max(axis=0)
    found = [f"UV coordinates from {low[0]:.4g} to {high[0]:.4g} and {low[1]:.4g} to {high[1]:.4g}"]
    if not known.all():
        found.append(f"{int((~known).sum())} of {known.size} face corners have no UV coordinates; 0 is taken")
    if flat := int((area == 0).sum()):
        found.append(f"{flat} of {len(uv)} triangles have no area on the image")
    return kept, found


def _double_areas(positions: Array, faces: Array) -> Array:
    """Compute twice the area (m,) of each triangle."""
    corner = positions[faces].astype(np.float64)
    return np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)


def sample_surface(positions: Array, faces: Array, uv: Array) -> tuple[Array, Array]:
    """Sample points spread over the surface of a mesh. Return their coordinates (k, 2) float64, and the share (k,) of
    the area that each represents; the shares sum to 1. ``positions`` are (n, 3) metres, ``faces`` (m, 3) vertices.
    """
    rank = np.arange(_SURFACE_POINTS)
    if len(faces) > _SURFACE_POINTS:  # some triangles by their area, evenly spread
        face = np.unique((rank * _LINE_STEP % 1.0 * len(faces)).astype(np.int64))
        weight = _double_areas(positions, faces[face])
    else:  # more points on larger triangles, so that all stand for about the same area
        share = np.cumsum(_double_areas(positions, faces))
        face = np.searchsorted(share, (rank + 0.5) / _SURFACE_POINTS * share[-1]).clip(max=len(faces) - 1)
        weight = np.ones(_SURFACE_POINTS)
    a, b = (np.arange(1, len(face) + 1)[:, None] * _SQUARE_STEPS % 1.0).T
    beyond = a + b > 1.0
    a, b = np.where(beyond, 1.0 - a, a), np.where(beyond, 1.0 - b, b)
    at, corner = np.stack([1.0 - a - b, a, b], axis=1), uv[face].astype(np.float64)
    return (at[..., None] * corner).sum(axis=1), weight / weight.sum()


def find_pixels(uv: Array, rows: int, columns: int) -> tuple[Array, Array]:
    """Find the row (k,), from the bottom, and column (k,) of the pixels of an image, repeated, at coordinates ``uv``
    (k, 2).
    """
    u, v = (uv % 1.0).T
    return (v * rows).astype(np.int64).clip(max=rows - 1), (u * columns).astype(np.int64).clip(max=columns - 1)

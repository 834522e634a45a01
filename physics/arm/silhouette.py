"""The silhouette of a solid: all pixels that it covers in a pinhole image, without occlusion by other objects."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Planar depth in metres at which triangles are cut off.
_NEAR_PLANE_M = 1e-3


def find_silhouette(vertices: Array, triangles: Array, matrix: Array, shape: tuple[int, ...]) -> Array:
    """Return the mask (rows, columns) of the pixels whose centres a solid covers; ``shape`` is the image's size.

    ``vertices`` (n, 3) are in the camera's axes (x right, y down, z forward), in metres; ``matrix`` (3, 3) has pixel
    centres at halves.
    """
    mask = np.zeros(shape, bool)
    corners = _clip_behind_eye(np.asarray(vertices, np.float64)[triangles])
    projected = corners @ np.asarray(matrix, np.float64).T
    pixels = projected[..., :2] / projected[..., 2:] - 0.5  # a centre now has whole coordinates
    low = np.maximum(np.ceil(pixels.min(axis=1)), 0).astype(int)
    high = np.minimum(np.floor(pixels.max(axis=1)), (shape[1] - 1, shape[0] - 1)).astype(int)
    for k in np.flatnonzero((low <= high).all(axis=1)):
        (x0, y0), (x1, y1) = low[k], high[k]
        part = mask[y0 : y1 + 1, x0 : x1 + 1]
        part |= _is_inside(pixels[k], np.arange(x0, x1 + 1), np.arange(y0, y1 + 1)[:, None])
    return mask


def _is_inside(triangle: Array, x: Array, y: Array) -> Array:
    """Return whether each point is inside a triangle (3, 2) of either orientation."""
    sides = [
        (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        for (ax, ay), (bx, by) in zip(triangle, np.roll(triangle, -1, axis=0), strict=True)
    ]
    return np.asarray((np.minimum.reduce(sides) >= 0) | (np.maximum.reduce(sides) <= 0))


def _clip_behind_eye(corners: Array) -> Array:
    """Cut triangles (m, 3, 3) off at the near plane. Returns the parts beyond it as triangles (k, 3, 3)."""
    ahead = corners[..., 2] > _NEAR_PLANE_M
    kept = [corners[ahead.all(axis=1)]]
    for triangle, front in zip(
        corners[ahead.any(axis=1) & ~ahead.all(axis=1)], ahead[ahead.any(axis=1) & ~ahead.all(axis=1)], strict=True
    ):
        outline = []
        for k in range(3):
            a, b = triangle[k], triangle[(k + 1) % 3]
            if front[k]:
                outline.append(a)
            if front[k] != front[(k + 1) % 3]:
                outline.append(a + (_NEAR_PLANE_M - a[2]) / (b[2] - a[2]) * (b - a))
        kept += [np.array([[outline[0], outline[n], outline[n + 1]]]) for n in range(1, len(outline) - 1)]
    return np.concatenate(kept)

"""The height of the ground under a point, for ground that is a triangle mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers
from .horizon import drop_m


@dataclass(frozen=True)
class MeshGround:
    """The highest surface of a mesh above each point: vertices (n, 3) in metres, triangles (m, 3). Every point is
    compared with all triangles, 10 ms per million, which suits the few points on which a camera stands.
    """

    positions: Array
    faces: Array

    @property
    def size_m(self) -> float:
        """Side in metres of the square about the origin that contains the mesh."""
        return 2 * float(np.abs(self.positions[:, :2]).max())

    def heights(self, x_m: Numbers, y_m: Numbers, shortest_m: float = 0.0) -> Array:
        """Find heights in metres at east and north coordinates (arrays that broadcast); NaN where there is no mesh."""
        x, y = np.broadcast_arrays(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64))
        found = [self._highest_at(a, b) for a, b in zip(x.ravel().tolist(), y.ravel().tolist(), strict=True)]
        return np.array(found).reshape(x.shape)

    def _highest_at(self, x: float, y: float) -> float:
        # A triangle that contains the point has corners on both sides of it along both axes.
        near = self.faces
        for axis, at in ((0, x), (1, y)):
            beyond = (self.positions[:, axis] >= at)[near].sum(axis=1)
            on_axis = (self.positions[:, axis] == at)[near].any(axis=1)
            near = near[((beyond > 0) & (beyond < 3)) | on_axis]
        a, b, c = (self.positions[near[:, k]].astype(np.float64) - [x, y, 0.0] for k in range(3))
        weights = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))])
        area = weights.sum(axis=0)
        inside = (area != 0) & ((weights * np.sign(area) >= -1e-12 * np.abs(area)).all(axis=0))
        if not inside.any():
            return math.nan
        share = weights[:, inside] / area[inside]
        return float((share * np.stack([a[inside, 2], b[inside, 2], c[inside, 2]])).sum(axis=0).max())


@dataclass(frozen=True)
class SurroundedGround(MeshGround):
    """The mesh of a patch with ground around it out to the horizon, on a body that is a sphere at the origin.

    ``patch_m`` is the side of the patch, on which rocks lie, and ``spacing_m`` the distance of vertices there.
    """

    patch_m: float
    spacing_m: float
    body_radius_m: float

    @property
    def size_m(self) -> float:
        """Side in metres of the patch."""
        return self.patch_m

    def drop_m(self, x_m: Numbers, y_m: Numbers) -> Array:
        """Compute the depth in metres of the curved body below the tangent plane at the origin."""
        return drop_m(np.hypot(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)), self.body_radius_m)

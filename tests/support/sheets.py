"""Small meshes of tests."""

from __future__ import annotations

import numpy as np
from icymoon.support.arrays import Array


def sheet(n: int = 6) -> tuple[Array, Array]:
    """A level square of n x n vertices, faces up."""
    y, x = np.mgrid[0:n, 0:n].astype(float)
    positions = np.stack([x, y, 0.1 * np.sin(x + y)], axis=-1).reshape(-1, 3)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return positions, np.concatenate([np.stack([k, k + 1, k + n + 1], 1), np.stack([k, k + n + 1, k + n], 1)])

"""The interface of a ground: its size and its heights."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ...support.arrays import Array, Numbers


class Surface(Protocol):
    """Ground, procedural or from a file."""

    @property
    def size_m(self) -> float:
        """Side in metres of the square about the origin that contains the ground."""
        ...

    def heights(self, x_m: Numbers, y_m: Numbers, shortest_m: float = 0.0) -> Array:
        """Heights in metres at east and north coordinates (arrays that broadcast); NaN outside the ground. Procedural
        roughness leaves out wavelengths below ``shortest_m``.
        """
        ...


def compute_fine_heights(roughness: Surface, x_m: Array, y_m: Array, longest_m: float, shortest_m: float) -> Array:
    """Compute the part of a procedural ground's heights with wavelengths from ``shortest_m`` to ``longest_m``, in
    metres.
    """
    if shortest_m >= longest_m:
        return np.zeros(np.broadcast_shapes(np.shape(x_m), np.shape(y_m)))
    return roughness.heights(x_m, y_m, shortest_m) - roughness.heights(x_m, y_m, longest_m)

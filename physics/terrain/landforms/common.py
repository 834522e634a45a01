"""What the landforms share: their interface, turned coordinates, steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..noise.lattice_noise import gradient_noise
from ..roughness.roughness import carried_share


@dataclass(frozen=True)
class Landform:
    """A height field. ``heights(x_m, y_m, shortest_m)`` takes arrays that broadcast and gives metres.

    ``finest_m`` is its smallest length; infinite where the field itself leaves out what is too fine.
    """

    finest_m: float
    heights: Callable[[np.ndarray, np.ndarray, Any], np.ndarray]

    def carried_share(self, shortest_m: Any) -> Any:
        """Which share of the heights a mesh shows whose shortest wavelength is ``shortest_m``: all where the
        smallest length spans 1.5 vertex spacings, none where it spans one, so that no step shows in a mesh
        that gets coarser."""
        return carried_share(2.0 * self.finest_m, shortest_m)


def draw_key(random: np.random.Generator) -> int:
    """A 32-bit key for a lattice noise."""
    return int(random.integers(0, 2**32))


def turn(x_m: np.ndarray, y_m: np.ndarray, azimuth_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates along an azimuth (clockwise from north) and to the right of it, as full arrays."""
    sin, cos = math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg))
    return sin * x_m + cos * y_m, cos * x_m - sin * y_m


def smooth_step(t: np.ndarray) -> np.ndarray:
    """Cubic step from 0 at 0 to 1 at 1, constant outside."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def wander(u: np.ndarray, v: np.ndarray, key: int) -> np.ndarray:
    """Gradient noise of full arrays, shifted by a fraction so that a feature's origin is no lattice point."""
    return gradient_noise(u + 0.37, v + 0.61, key)

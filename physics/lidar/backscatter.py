"""The reflectance of surfaces towards their light, at phase 0 and any incidence, as a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ..surfaces.photometry import Law

#: Number of steps of the cosine in a table. Linear interpolation between them is off by less than 1e-6 for our laws to
#: an incidence of 85 degrees; a test measures it.
_STEPS = 2**14


@dataclass(frozen=True)
class Backscatter:
    """``reflectance`` (_STEPS + 1,), bidirectional reflectance r in 1/sr where light and sensor are in one direction,
    at equal steps of the cosine of incidence from 0 to 1. r is the BRDF times that cosine; the opposition surge is
    included."""

    reflectance: Array

    def find(self, cosine: Array) -> Array:
        """r at cosines of incidence, any shape, from 0 to 1."""
        place = cosine * _STEPS
        below = np.minimum(place.astype(np.int64), _STEPS - 1)
        return np.asarray(
            self.reflectance[below] + (place - below) * (self.reflectance[below + 1] - self.reflectance[below])
        )


def tabulate_backscatter(law: Law) -> Backscatter:
    """The table of a law of reflectance, see ``photometry``."""
    angle = np.arccos(np.linspace(0, 1, _STEPS + 1))
    return Backscatter(np.asarray(law(angle, angle, np.zeros(len(angle)))))

"""Ground that is steeper than its strength holds, and the surface down to which it breaks off.

Ground with cohesion c, density ρ and angle of friction φ stands no higher than

    a(θ) = 2 c cos φ / (ρ g cos θ sin(θ - φ))

above any plane of dip θ > φ that nowhere rises above the ground: at this height, the wedge between the plane and the
surface is as heavy as its shear strength allows. This is Culmann's law for faces of any slope (``standing_slopes``),
written for his planes: θ = (β + φ) / 2 gives H(β) = a(θ) sin β cos θ / sin(β - θ). The least a, for θ = 45° + φ / 2, is
the height of an upright wall. Without cohesion all ground steeper than φ fails.

So the highest surface that stands is the least, over θ, of a(θ) plus the highest surface under the ground with slopes
up to tan θ. It depends on heights only, not on an order of failures, and ground below it never fails again. A few
planes stand for all θ; the limit is then up to 3 % of its height above the limit of the law, for faces of up to 100
times the height of an upright one. Slopes on the grid are measured in 16 directions, so between these directions they
can be 2.8 % steeper. Ice at rest over long times creeps, cracks and has joints; this law knows cohesion and friction
only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers

#: Number of planes that represent all dips.
_PLANES = 6
#: Steps in rows and columns to the neighbours in 8 of 16 directions; the other 8 are their opposites.
_NEIGHBOURS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (2, -1), (1, 2), (1, -2))


@dataclass(frozen=True)
class Strength:
    """Strength of the ground against gravity: cohesion in Pa, angle of friction in degrees, density in kg/m³, gravity
    in m/s².
    """

    cohesion_pa: float
    friction_deg: float
    density_kg_m3: float
    gravity_m_s2: float

    def list_planes(self) -> list[tuple[float, float]]:
        """List the planes on which ground fails: the height in metres up to which ground stands above each, and the
        tangent of its dip. Both are rounded, because tangents differ between machines in the last bit.
        """
        friction = math.radians(self.friction_deg)
        if self.cohesion_pa == 0.0:
            return [(0.0, float(np.float32(math.tan(friction))))]
        weight = self.density_kg_m3 * self.gravity_m_s2
        planes = []
        for k in range(1, _PLANES + 1):
            over = (math.pi / 4 - friction / 2) * (k / _PLANES) ** 2
            dip = friction + over
            height = 2.0 * self.cohesion_pa * math.cos(friction) / (weight * math.cos(dip) * math.sin(over))
            planes.append((float(np.float32(height)), float(np.float32(math.tan(dip)))))
        return planes


def find_highest_standing(height_m: Array, cell_m: float, strength: Strength, cohesion_share: Numbers = 1.0) -> Array:
    """Find the heights (rows, columns) in metres above which ground of heights ``height_m`` breaks off; infinite if all
    of it stands. ``cohesion_share``, a number or (rows, columns), multiplies the cohesion at each place.
    """
    limit = np.full(height_m.shape, np.inf)
    relief, weakest = float(np.ptp(height_m)), float(np.min(cohesion_share))
    for stands_m, tangent in strength.list_planes():
        if stands_m * weakest < relief:
            np.minimum(limit, stands_m * cohesion_share + cut_to_slope(height_m, cell_m, tangent), out=limit)
    return limit


def cut_to_slope(height_m: Array, cell_m: float, tangent: float) -> Array:
    """Find the highest surface (rows, columns) at or under heights whose slope in 16 directions is at most ``tangent``.

    A distance along a direction is a sum of strides of 1, 2, 4 … cells, so one pass over all strides is enough.
    """
    low, reach = height_m.copy(), float(np.ptp(height_m)) / (tangent * cell_m)
    stride = 1 << max(int(min(reach, max(height_m.shape))).bit_length() - 1, 0)
    while stride:
        for down, right in _NEIGHBOURS:
            _lower_pairs(low, stride * down, stride * right, tangent * cell_m * stride * math.hypot(down, right))
        stride //= 2
    return low


def _lower_pairs(low: Array, down: int, right: int, rise_m: float) -> None:
    """Lower the higher cell of each pair ``down`` rows and ``right`` columns apart, in place, to at most ``rise_m``
    above the other.
    """
    rows, columns = low.shape
    if down >= rows or abs(right) >= columns:
        return
    first = low[: rows - down, max(-right, 0) : columns - max(right, 0)]
    second = low[down:, max(right, 0) : columns - max(-right, 0)]
    np.minimum(second, first + rise_m, out=second)
    np.minimum(first, second + rise_m, out=first)

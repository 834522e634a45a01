"""Code that the landforms share: their interface, rotated coordinates, and steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....support.arrays import Array, Numbers
from ..noise.lattice_noise import gradient_noise
from ..noise.voronoi import find_voronoi_cells
from ..roughness.roughness import resolved_share

#: Largest slope of a facet toward either axis, heights and lengths in facets.
_FACET_TILT = 0.45
#: Greatest height of a facet: no point of a cell is farther than sqrt(2) from the cell's own point.
_HIGHEST_FACET = 1.0 + 2.0 * _FACET_TILT
#: Depth of chips as a share of their width.
_CHIP_DEPTH_SHARE = 0.4


@dataclass(frozen=True)
class Crests:
    """Sharp crests of a landform. Each of ``lines`` is a function ``line(x_m, y_m)`` that returns the signed distance
    from the nearest crest in metres; the next crest is about ``apart_m`` away. Crests of one line do not cross; crests
    of different lines may. A mesh with edges along them uses ``heights``, which are sharp where the mesh is fine
    enough."""

    lines: Sequence[Callable[[Array, Array], Array]]
    heights: Callable[[Array, Array, Numbers], Array]
    apart_m: float


@dataclass(frozen=True)
class Walls:
    """Steep walls of broken ice, about ``height_m`` high; ``key`` selects the noise that breaks them."""

    height_m: float
    key: int


@dataclass(frozen=True)
class Landform:
    """A height field. ``heights(x_m, y_m, shortest_m)`` takes arrays that broadcast and returns metres. ``finest_m`` is
    its smallest length; infinite if the field itself leaves out waves that are too fine."""

    finest_m: float
    heights: Callable[[Array, Array, Numbers], Array]
    crests: Crests | None = None
    walls: Walls | None = None

    def with_sharp_crests(self) -> Landform:
        """Return the landform for a mesh that has edges along its crests."""
        return replace(self, heights=self.crests.heights) if self.crests else self

    def resolved_share(self, shortest_m: Numbers) -> Numbers:
        """Compute the share of the heights on a mesh whose shortest wavelength is ``shortest_m``: 1 if the smallest
        length spans at least 1.5 vertex spacings, 0 if it spans one or less. The share changes smoothly, so that a mesh
        that gets coarser shows no step.
        """
        return resolved_share(2.0 * self.finest_m, shortest_m)


def draw_key(random: np.random.Generator) -> int:
    """Draw a 32-bit key for a lattice noise."""
    return int(random.integers(0, 2**32))


def rotate_coordinates(x_m: Array, y_m: Array, azimuth_deg: float) -> tuple[Array, Array]:
    """Rotate coordinates: return them along an azimuth (clockwise from north) and to the right of it, as full
    arrays.
    """
    sin, cos = math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg))
    return sin * x_m + cos * y_m, cos * x_m - sin * y_m


def smooth_step(t: Array) -> Array:
    """Compute the cubic step from 0 at 0 to 1 at 1, constant outside."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def sample_shifted_noise(u: Array, v: Array, key: int) -> Array:
    """Sample the gradient noise of full arrays, shifted by a fraction so that a feature's origin is not a lattice
    point.
    """
    return gradient_noise(u + 0.37, v + 0.61, key)


def facet_heights(u: Array, v: Array, side: float, key: int) -> Array:
    """Compute the heights of flat, tilted tops, as of broken ice, at random levels between 0 and about 1, one in each
    Voronoi cell of width 1. At the edges of the cells they fall to 0, with the slope ``side`` or less. ``u`` and ``v``
    are in facets.
    """
    cells = find_voronoi_cells(u, v, key)
    high = cells.random(key ^ 1)
    # The tilt turns with the height's later digits, so that no further random number is needed.
    tilt_u, tilt_v = (_FACET_TILT * (2.0 * (digits * high % 1.0) - 1.0) for digits in (64.0, 4096.0))
    # Half of F2 - F1 is the distance to an edge where the edge crosses the line between two points, less elsewhere.
    return np.minimum(high - tilt_u * cells.x1 - tilt_v * cells.y1, 0.5 * side * (cells.f2 - cells.f1))


def evaluate_where(mask: Array, of: Callable[..., Array], *coordinates: Array) -> Array:
    """Evaluate a function of coordinates where a mask of their shape is set; 0 elsewhere."""
    result = np.zeros(mask.shape)
    if mask.any():
        result[mask] = of(*(np.broadcast_to(c, mask.shape)[mask] for c in coordinates))
    return result


def broken_step(
    distance: Array,
    u: Array,
    v: Array,
    foot: float,
    width: float,
    chips: Sequence[float],
    keys: Sequence[int],
) -> Array:
    """Compute a step from 0 at the distance ``foot`` to 1 at ``foot + width``, with chips broken out of it. It has a
    ledge for each of the widths of ``chips``, from the foot up; chips reach behind the straight edge by up to 0.4 of
    their width. All lengths have the unit of ``distance``, ``u`` and ``v``.
    """

    def ledges(behind: Array, u: Array, v: Array) -> Array:
        total = np.zeros(behind.shape)
        for k, (size, key) in enumerate(zip(chips, keys, strict=True)):
            lost = _CHIP_DEPTH_SHARE * size * np.maximum(facet_heights(u / size, v / size, 2.0, key), 0.0)
            total += np.clip((behind - lost) * (len(chips) / width) - k, 0.0, 1.0)
        return total / len(chips)

    whole = distance >= foot + width + _CHIP_DEPTH_SHARE * _HIGHEST_FACET * max(chips)
    return whole + evaluate_where((distance > foot) & ~whole, ledges, distance - foot, u, v)

"""Cracks: fractures with steep walls and, where material was pushed up, raised rims.

They run along the edges of Voronoi plates. Stretched plates give the long sub-parallel fractures of a
tiger stripe's flank (Helfenstein & Porco 2015, Astron. J. 150, 96, map them at 100 m and coarser; at
the scale of a lander their size is an assumption).

The walls of **rounded** cracks are smooth steps from edge to middle. Those of **broken** ones are steep and chipped,
and fallen fragments lie on the floor: a guess from fractures in glacier ice. **Jointed** ones run straight, between
plane faces that meet at corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....settings.topics.landforms import CracksSettings
from ....support.arrays import Array, Numbers
from ..noise.voronoi import find_voronoi_cells
from .joints import JointedWall
from .landform import (
    Landform,
    Walls,
    broken_step,
    draw_key,
    evaluate_where,
    facet_heights,
    rotate_coordinates,
    sample_shifted_noise,
    smooth_step,
)

#: Sideways bending of the cracks, in plates.
_BEND_SIZE = 0.06
#: Wavelength of the bending, in plates.
_BEND_WAVELENGTH = 0.6
#: Foot of the wall of a broken crack, in half widths.
_WALL_FOOT = 0.65
#: Widths of its chips, in half widths.
_CHIP_WIDTHS = (0.4, 0.8, 1.3)
#: Widths of the faces of jointed walls and lengths of the spalls at their rims, in half widths.
_FACE_WIDTH, _SPALL_LENGTHS = 3.0, (1.6, 0.7)
#: Fallen fragments by size: width in half widths, height as a share of the depth, buried part.
_FALLEN_FRAGMENTS = ((1.1, 0.7, 0.35), (0.35, 0.16, 0.1), (0.12, 0.05, 0.0))
#: Slope of their sides.
_FRAGMENT_SLOPE = 2.2


def make(settings: CracksSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make cracks ``depth_m`` deep and ``width_m`` wide from edge to edge, with rims over another width to either side.
    None without depth and rims.
    """
    keys = [draw_key(random) for _ in range(6 + len(_CHIP_WIDTHS))]
    depth, half, rim = settings.depth_m, settings.width_m / 2, settings.rim_m
    if depth == 0.0 and rim == 0.0:
        return None
    broken, bend = settings.edges != "ROUNDED", 0.0 if settings.edges == "JOINTED" else _BEND_SIZE
    joints = JointedWall(_WALL_FOOT, 1.0 - _WALL_FOOT, max(depth, rim) / half, _FACE_WIDTH, _SPALL_LENGTHS)
    broad = settings.plate_m
    long = broad * settings.elongation

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        along, across = rotate_coordinates(x_m, y_m, settings.azimuth_deg)
        u, v = along / long, across / broad
        bend_u, bend_v = (bend * sample_shifted_noise(u / _BEND_WAVELENGTH, v / _BEND_WAVELENGTH, k) for k in keys[1:3])
        distance = find_voronoi_cells(u + bend_u, v + bend_v, keys[0]).edge_distance(long, broad) / half
        # Over a crack's width the rim falls smoothly to 0.
        outer = np.clip((3.0 - distance) / 2.0, 0.0, 1.0)
        outside = rim * outer * outer
        if not broken:
            return np.where(distance < 1.0, (depth + rim) * smooth_step(distance) - depth, outside)
        x, y = along / half, across / half
        if settings.edges == "JOINTED":
            step = joints.step(distance, x, y, keys[6:])
        else:
            step = broken_step(distance, x, y, _WALL_FOOT, 1.0 - _WALL_FOOT, _CHIP_WIDTHS, keys[6:])
        fallen = evaluate_where(step < 1.0, lambda x, y: _fallen_fragment_heights(x, y, keys[3:6]), x, y)
        return step * outside - depth * (1.0 - step) * (1.0 - fallen)

    walls = Walls(depth, keys[6]) if broken and depth else None
    return Landform(half * (1.0 - _WALL_FOOT if broken else 1.0), heights, walls=walls)


def _fallen_fragment_heights(x: Array, y: Array, keys: Sequence[int]) -> Array:
    """Compute the height of the fragments on the floor as a share of the depth; coordinates are in half widths."""
    return sum(
        (
            high * np.maximum(facet_heights(x / size, y / size, _FRAGMENT_SLOPE, key) - buried, 0.0)
            for size, high, buried, key in zip(*_FALLEN_FRAGMENTS, keys, strict=True)
        ),
        start=np.zeros(()),
    )

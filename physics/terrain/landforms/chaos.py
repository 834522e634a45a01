"""Chaos: plates of broken crust, lifted and tilted, standing in a lumpy matrix.

Conamara Chaos on Europa has plates of kilometres standing up to hundreds of metres above a matrix
(Carr et al. 1998, Nature 391, 363); the pattern is used here at whatever scale is asked for.

Plates have one of three kinds of edges. **Rounded**: edges bend, scarps of 60 degrees end smoothly, and the matrix is
lumps. **Broken**: straight edges that fit their neighbours', with chips, scarps of 80 degrees with sharp rims, and a
matrix of tilted fragments as between floes of broken sea ice. **Jointed**: as broken, but walls are plane faces that
meet at corners. No image shows either moon at metres: all are guesses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ....settings.topics.landforms import ChaosSettings
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

#: Slope of the plates' scarps by kind of edge; debris at the foot keeps rounded scarps from being steeper.
_SCARP_SLOPE = {"ROUNDED": math.tan(math.radians(60.0))} | dict.fromkeys(
    ("BROKEN", "JOINTED"), math.tan(math.radians(80.0))
)
#: Height of the lowest plate, as a share of the relief.
_LOWEST_PLATE = 0.5
#: RMS of the matrix by kind of edge: three octaves of noise, or fragments.
_MATRIX_RMS = {"ROUNDED": 0.350, "BROKEN": 0.2055, "JOINTED": 0.2055}
#: Widths of the fragments between broken plates, in plates, from large to small; heights are proportional.
_FRAGMENT_WIDTHS = (0.28, 0.11, 0.04)
#: Slope of a fragment's sides.
_FRAGMENT_SLOPE = 2.2
#: Widths of the chips of broken edges, in plates.
_CHIP_WIDTHS = (0.09, 0.16, 0.26)
#: Widths of the faces of jointed walls and lengths of the spalls at their rims, in plates.
_FACE_WIDTH, _SPALL_LENGTHS = 0.3, (0.16, 0.07)


def make(settings: ChaosSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make plates up to ``relief_m`` above a matrix of RMS height ``matrix_m``; None without relief."""
    keys = [draw_key(random) for _ in range(13 + len(_CHIP_WIDTHS))]
    relief, plate, gap, edges = settings.relief_m, settings.plate_m, settings.gap_m, settings.edges
    rough, share = settings.matrix_m / _MATRIX_RMS[edges], settings.plate_share
    if relief == 0.0 and rough == 0.0:
        return None
    scarp = max(relief / _SCARP_SLOPE[edges], 0.02 * plate)
    tilt = math.tan(math.radians(settings.tilt_deg))
    joints = JointedWall(gap / 2 / plate, scarp / plate, max(relief, 1.0e-9) / plate, _FACE_WIDTH, _SPALL_LENGTHS)

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        v, u = rotate_coordinates(x_m / plate, y_m / plate, 0.0)
        if edges == "JOINTED":
            cells = find_voronoi_cells(u, v, keys[2])
            inside = joints.step(cells.edge_distance(), u, v, keys[13:])
        elif edges == "BROKEN":
            cells = find_voronoi_cells(u, v, keys[2])
            inside = broken_step(cells.edge_distance(), u, v, gap / 2 / plate, scarp / plate, _CHIP_WIDTHS, keys[13:])
        else:
            bend_u, bend_v = (0.08 * sample_shifted_noise(1.7 * u, 1.7 * v, k) for k in keys[:2])
            cells = find_voronoi_cells(u + bend_u, v + bend_v, keys[2])
            inside = smooth_step((plate * cells.edge_distance() - gap / 2) / scarp)
        # Random direction of the tilt from a point in the square: no sines needed.
        east, north = (tilt * (2.0 * cells.random(k) - 1.0) for k in keys[3:5])
        top = relief * (_LOWEST_PLATE + (1.0 - _LOWEST_PLATE) * cells.random(keys[5])) - plate * (
            east * cells.x1 + north * cells.y1
        )
        inside *= cells.random(keys[6]) < share
        low = rough * evaluate_where(inside < 1.0, matrix, u, v) if rough else 0.0
        return low + inside * (top - low)

    def matrix(u: Array, v: Array) -> Array:
        return _fragment_heights(u, v, keys[10:13]) if edges != "ROUNDED" else _lump_heights(u, v, keys[7:10])

    walls = Walls(relief, keys[13]) if edges != "ROUNDED" and relief else None
    return Landform(scarp, heights, walls=walls)


def _lump_heights(u: Array, v: Array, keys: Sequence[int]) -> Array:
    """Sum three octaves of gradient noise."""
    return sum(
        (0.5**k * sample_shifted_noise(u * 4.0 * 2.0**k, v * 4.0 * 2.0**k, key) for k, key in enumerate(keys)),
        start=np.zeros(()),
    )


def _fragment_heights(u: Array, v: Array, keys: Sequence[int]) -> Array:
    """Compute the heights of tilted fragments of three sizes; smaller fragments lie between and on larger ones."""
    return sum(
        (
            width / _FRAGMENT_WIDTHS[0] * facet_heights(u / width, v / width, _FRAGMENT_SLOPE, key)
            for width, key in zip(_FRAGMENT_WIDTHS, keys, strict=True)
        ),
        start=np.zeros(()),
    )

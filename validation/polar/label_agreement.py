"""The agreement of the labels with each other, an upper bound for the agreement of renders with them.

Rocks do not move between the lamps, so outlines of one view are compared between photographs. Two photographs that
share an outline are left out, because it was copied. The shadows of a lamp were outlined in both eyes, so the left
eye's outlines are laid on the fitted sand and seen with the right eye.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...stereo.images.masks import compute_intersection_over_union, fill_polygons
from ...support.arrays import Array
from .camera import Calibration, Eye
from .data_set import HEIGHT_PX, ROCK, SHADOW, WIDTH_PX, Terrain, View
from .lamp import HeightTable
from .sand import Sand

#: Scale of the masks.
_MASK_SCALE = 0.5
#: Spacing in pixels of the points of an outline that is laid on the sand.
_OUTLINE_STEP_PX = 8.0
_MASK_SHAPE = (int(HEIGHT_PX * _MASK_SCALE), int(WIDTH_PX * _MASK_SCALE))


@dataclass(frozen=True)
class LabelAgreement:
    """Intersections over union of labels with labels, by position; NaN where nothing can be compared.

    ``rocks`` compares one lamp with another, ``shadows`` the left eye with the right eye.
    """

    rocks: dict[str, float]
    shadows: dict[str, float]


def measure_label_agreement(terrain: Terrain, camera: Calibration, sand: Sand) -> LabelAgreement:
    """Measure the agreement of the labels at each position with each other."""
    table = HeightTable(sand)
    return LabelAgreement(
        {position: _average_known(compare_rock_labels(terrain, position)) for position in terrain.positions},
        {
            position: _average_known(
                [
                    _measure_shadow_label_overlap(terrain, camera, table, position, azimuth)
                    for azimuth in terrain.azimuths
                ]
            )
            for position in terrain.positions
        },
    )


def _average_known(found: list[float]) -> float:
    known = [value for value in found if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def _fill_outlines(outlines: list[Array]) -> Array:
    return fill_polygons(_MASK_SHAPE, [each * _MASK_SCALE for each in outlines], finer=3)


def compare_rock_labels(terrain: Terrain, position: str) -> list[float]:
    """Compute the intersections over union of rocks under one lamp and under another, from separately drawn
    outlines."""
    found = []
    for view in (view for view in terrain.views if view.position == position):
        drawn = [terrain.polygons(view, azimuth, ROCK) for azimuth in terrain.azimuths]
        found += [
            compute_intersection_over_union(_fill_outlines(one), _fill_outlines(other))
            for one, other in combinations(drawn, 2)
            if not _share_an_outline(one, other)
        ]
    return found


def _share_an_outline(one: list[Array], other: list[Array]) -> bool:
    """Return whether two photographs have an outline in common, to the last digit."""
    return not {each.tobytes() for each in one}.isdisjoint(each.tobytes() for each in other)


def _measure_shadow_label_overlap(
    terrain: Terrain, camera: Calibration, table: HeightTable, position: str, azimuth: int
) -> float:
    left, right = View(position, "L"), View(position, "R")
    laid = [
        camera.eyes[right].project(trace_pixels_to_sand(camera.eyes[left], _densify_outline(each), table))
        for each in terrain.polygons(left, azimuth, SHADOW)
    ]
    rock = _fill_outlines(terrain.polygons(right, azimuth, ROCK))
    return compute_intersection_over_union(
        _fill_outlines(laid) & ~rock, _fill_outlines(terrain.polygons(right, azimuth, SHADOW)) & ~rock
    )


def _densify_outline(outline: Array) -> Array:
    """Return the outline (n, 2) with further points, so that neighbours are no more than a step apart."""
    found = []
    for here, there in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        count = max(1, int(np.linalg.norm(there - here) / _OUTLINE_STEP_PX))
        found.append(here + (there - here) * np.arange(count)[:, None] / count)
    return np.concatenate(found)


def trace_pixels_to_sand(eye: Eye, pixels: Array, heights: Callable[[Array], Array]) -> Array:
    """Trace pixels (n, 2) along their downward rays to the points (n, 3) on the sand, by iteration."""
    way = eye.rays(pixels) @ eye.turn
    level = np.zeros(len(pixels))
    for _ in range(12):
        points = eye.place_m + way * ((level - eye.place_m[2]) / way[:, 2])[:, None]
        level = heights(points[:, :2])
    return np.asarray(points)

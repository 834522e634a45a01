"""A fine map and a coarser map as the heights of one ground: the fine map where it is known, elsewhere the coarse
map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ..terrain.landforms.landform import smooth_step
from .height_map import fill_holes
from .nested_rings import Level

#: Known share of the square around a place above which the map counts there; at a straight edge it is a half.
_MIN_SHARE = 0.5 - 1e-6


@dataclass(frozen=True)
class LevelMeans:
    """Mean heights (n, n) in metres over the cell around each point of a level's lattice, rows from the south, NaN
    without a known pixel. ``share`` is the known share of the map in a wider square around each point.
    """

    heights_m: Array
    share: Array


@dataclass(frozen=True)
class BlendedMaps:
    """Heights (n, n) in metres of each level, NaN where no map has ground. ``offset_m`` is the mean of fine minus
    coarse heights where both are blended; it was added to the coarse heights. ``apart_m`` is the RMS of the remaining
    differences. Both are None if the maps are not blended anywhere.
    """

    heights_m: list[Array]
    offset_m: float | None = None
    apart_m: float | None = None


def blend_maps(levels: Sequence[Level], fine: Sequence[LevelMeans], coarse: Sequence[LevelMeans] | None) -> BlendedMaps:
    """Blend the heights of a fine map into a coarse map toward the edges and the large gaps of the fine map.

    The fine map counts fully where the square of ``LevelMeans.share`` is known, and not at all where half of it is
    missing, as at an edge. Gaps that are smaller than half of the square are filled smoothly.
    """
    known = [_fill_gaps(each) for each in fine]
    if coarse is None:
        return BlendedMaps(known)
    others = [_fill_gaps(each) for each in coarse]
    weights = [
        np.where(np.isfinite(f), smooth_step(2.0 * means.share - 1.0), 0.0)
        for f, means in zip(known, fine, strict=True)
    ]
    differences, areas = [], []
    for level, f, c, w in zip(levels, known, others, weights, strict=True):
        band = level.find_ring_vertices() & (w > 0.0) & (w < 1.0) & np.isfinite(f) & np.isfinite(c)
        differences.append((f - c)[band])
        areas.append(np.full(int(band.sum()), level.cell_m**2))
    difference, area = np.concatenate(differences), np.concatenate(areas)
    if not len(difference):
        return BlendedMaps([np.where(np.isfinite(f), f, c) for f, c in zip(known, others, strict=True)])
    offset = float(np.average(difference, weights=area))
    apart = float(np.sqrt(np.average((difference - offset) ** 2, weights=area)))
    heights = [_mix(f, c + offset, w) for f, c, w in zip(known, others, weights, strict=True)]
    return BlendedMaps(heights, offset, apart)


def _fill_gaps(means: LevelMeans) -> Array:
    """Return the heights where enough of the map is known, with gaps filled; NaN elsewhere."""
    counts = means.share >= _MIN_SHARE
    heights = means.heights_m
    if not np.isfinite(heights).any():
        return np.full(heights.shape, np.nan)
    if (counts & ~np.isfinite(heights)).any():
        heights = fill_holes(heights)
    return np.where(counts, heights, np.nan)


def _mix(fine: Array, coarse: Array, weight: Array) -> Array:
    both = np.where(weight > 0.0, fine, 0.0) * weight + np.where(weight < 1.0, coarse, 0.0) * (1.0 - weight)
    return np.where(np.isfinite(both), both, np.where(np.isfinite(fine), fine, coarse))

"""Rocks beyond the patch, out to the distance at which the largest rock is too small to be seen.

They follow the law of the patch, with as many per square metre of each size; the law may go on to larger rocks than the
patch has. Only rocks that are wide enough in the image are drawn, so that the field has no visible edge and needs only
a few thousand rocks. The apparent width is computed from the nearest place of the patch, so that moving the camera over
the patch changes no rock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...settings.topics.rocks import RocksSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ..rig.focal_length import focal_px
from .size_laws import SizeLaw, make_law_beyond

_DISTANCE_STEPS = 2048  # of the table of distances; the trapezoidal rule is then within 1e-5
_ANGLE_STEP = 1.05  # by which the angle grows until the rocks are few enough


@dataclass(frozen=True)
class ViewBeyond:
    """The view that decides which rocks are drawn: the least apparent width in radians, the height in metres of the
    eye, and the distance in metres at which the ground ends.
    """

    smallest_rad: float
    height_m: float
    farthest_m: float


@dataclass(frozen=True)
class RocksBeyond:
    """Positions (n, 2) and diameters (n,) in metres, largest first, and apparent widths (n,) in radians from the
    nearest place on the patch. ``smallest_rad`` is the least apparent width that was used."""

    places_m: Array
    diameter_m: Array
    angle_rad: Array
    smallest_rad: float


def make_view_beyond(settings: Settings) -> ViewBeyond | None:
    """Make the view of complete settings; None if they ask for no rocks beyond the patch or have no ground there."""
    rocks, rig = settings.rocks, settings.rig
    if rocks.beyond_px == 0.0 or settings.mesh.kind != "GRADED" or settings.source.kind != "PROCEDURAL":
        return None
    return ViewBeyond(float(rocks.beyond_px) / focal_px(rig), float(rig.height_m), float(settings.mesh.farthest_m))


def draw_beyond(rocks: RocksSettings, size_m: float, view: ViewBeyond, random: np.random.Generator) -> RocksBeyond:
    """Draw rocks outside a square patch of side ``size_m`` about the origin, at most ``rocks.most``. If there would be
    more, the least apparent width is larger than in the view.
    """
    law, angle = make_law_beyond(rocks), view.smallest_rad
    while (count := _count_rocks(law, size_m, view, angle)[1][-1]) > rocks.most:
        angle *= _ANGLE_STEP
    radii, above = _count_rocks(law, size_m, view, angle)
    n = round(float(count))
    radius = np.interp((np.arange(n) + random.random(n)) / max(n, 1) * count, above, radii)
    turn = random.uniform(0.0, 2.0 * math.pi, n)
    xy = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    diameter = law.diameter_m(random.random(n) * _per_m2_above(law, angle * _nearest_m(radius, size_m, view)))
    xy = _gather_to_clusters(rocks, xy, law.total_per_m2, random)
    # A rock may not reach onto the patch, which has its own.
    outside = np.abs(xy).max(axis=1, initial=0.0) > size_m / 2 + diameter / 2
    order = np.flatnonzero(outside)[np.argsort(-diameter[outside], kind="stable")]
    xy, diameter = xy[order], diameter[order]
    return RocksBeyond(xy, diameter, diameter / _nearest_m(np.hypot(*xy.T), size_m, view), angle)


def _nearest_m(radius_m: Array, size_m: float, view: ViewBeyond) -> Array:
    """Compute the distance in metres of places from the nearest possible eye over the patch; ``radius_m`` is from its
    middle.
    """
    return np.hypot(np.maximum(radius_m - size_m * math.sqrt(0.5), 0.0), view.height_m)


def _per_m2_above(law: SizeLaw, diameter_m: Array) -> Array:
    """Compute the number of rocks per square metre that are larger than diameters, also for diameters outside the
    law.
    """
    largest = law.diameter_m(np.zeros(1))
    inside = np.where(diameter_m < largest, law.per_m2_above(np.clip(diameter_m, law.smallest_m, largest)), 0.0)
    return np.where(diameter_m <= law.smallest_m, law.total_per_m2, inside)


def _count_rocks(law: SizeLaw, size_m: float, view: ViewBeyond, angle: float) -> tuple[Array, Array]:
    """Count the rocks within distances in metres from the middle of the patch. Return the distances and the counts;
    corners of the patch count as outside.
    """
    last = min(float(np.max(law.diameter_m(np.zeros(1)))) / angle + size_m * math.sqrt(0.5), view.farthest_m)
    radii = np.geomspace(size_m / 2, max(last, size_m / 2), _DISTANCE_STEPS)
    rings = 2.0 * math.pi * radii * _per_m2_above(law, angle * _nearest_m(radii, size_m, view))
    return radii, np.append(0.0, np.cumsum((rings[1:] + rings[:-1]) / 2.0 * np.diff(radii)))


def _gather_to_clusters(rocks: RocksSettings, xy: Array, per_m2: float, random: np.random.Generator) -> Array:
    """Move the share ``clustering`` of positions to clusters; each square of the map has one cluster."""
    member = random.random(len(xy)) < rocks.clustering
    away = random.normal(0.0, rocks.cluster_radius_m, xy.shape)
    if not member.any():
        return xy
    side = math.sqrt(rocks.cluster_blocks / (per_m2 * rocks.clustering))
    squares, of = np.unique(np.floor(xy / side).astype(np.int64), axis=0, return_inverse=True)
    centres = (squares + random.random(squares.shape)) * side
    return np.where(member[:, None], centres[of.reshape(-1)] + away, xy)

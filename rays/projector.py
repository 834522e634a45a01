"""Patterns of a projector as eyes see them. Rays of each pixel meet the ground, and rays from there meet the
projector."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..physics.projector.device import Projector, sample_pattern
from ..support.arrays import Array
from .stereo_truth import Eye, Stage, list_squares
from .surface import find_surface

#: Width in pixels of the filter of images: Cycles' Blackman-Harris filter of the width 1.5 ends 1.5 pixels away.
_FILTER_PX = 3.0
#: Share of the way from the ground to the projector, counted from the ground, in which no occluder counts.
_CLEARANCE = 1e-5


@dataclass(frozen=True)
class ProjectedEye:
    """A projector's light in the image of an eye. ``share`` (count, rows, columns) float32 is the direct light of each
    pattern, divided by the light of a lamp that has the projector's intensity in the whole cone around its field; 0 in
    shadow. ``place`` (rows, columns, 2) float32 are the projector's coordinates that light the middle of each pixel;
    NaN in shadow.
    """

    share: Array
    place: Array


@lru_cache
def find_sample_offsets(count: int) -> tuple[float, ...]:
    """Find the offsets in pixels of ``count`` samples of equal weight, for either axis. They spread as the pixel filter
    of images does, on which the contrast of patterns depends."""
    at = np.linspace(-0.5, 0.5, 20001)
    angle = 2 * np.pi * (at + 0.5)
    weight = 0.35875 - 0.48829 * np.cos(angle) + 0.14128 * np.cos(2 * angle) - 0.01168 * np.cos(3 * angle)
    total = np.cumsum(weight) - weight / 2
    found = np.interp((np.arange(count) + 0.5) / count, total / weight.sum(), at) * _FILTER_PX
    spread = _FILTER_PX * np.sqrt((weight * at**2).sum() / weight.sum())
    return tuple((found * (spread / found.std()) if count > 1 else 0.0 * found).tolist())


def trace_patterns(
    stage: Stage,
    eye: Eye,
    projector: Projector,
    pose: Array,
    patterns: Array,
    clip_m: tuple[float, float],
    samples: int = 4,
) -> ProjectedEye:
    """Trace the light of a projector at ``pose`` (4, 4) with ``patterns`` (count, rows, columns) to the image of an
    eye, by ``samples`` rays across and down each pixel. The eye sees surfaces at planar depths ``clip_m`` (nearest,
    farthest)."""
    size = eye.rows * eye.columns
    shares, place = np.zeros((len(patterns), size), np.float32), np.full((size, 2), np.nan, np.float32)
    offsets = find_sample_offsets(samples)
    for pixels in list_squares(eye.rows, eye.columns):
        lit, white = np.zeros((len(patterns), len(pixels))), np.zeros(len(pixels))
        for dx in offsets:
            for dy in offsets:
                moved = replace(eye, cx_px=eye.cx_px - dx, cy_px=eye.cy_px - dy)
                at, light = _find_light(stage, moved, pixels, projector, pose, clip_m)
                white += light
                for k, pattern in enumerate(patterns):
                    lit[k] += light * sample_pattern(pattern, at)
        shares[:, pixels] = lit / np.where(white > 0, white, 1.0)
        at, light = _find_light(stage, eye, pixels, projector, pose, clip_m)
        place[pixels] = np.where(light[:, None] > 0, at, np.nan)
    shape = eye.rows, eye.columns
    return ProjectedEye(shares.reshape(len(patterns), *shape), place.reshape(*shape, 2))


def _find_light(
    stage: Stage, eye: Eye, pixels: Array, projector: Projector, pose: Array, clip_m: tuple[float, float]
) -> tuple[Array, Array]:
    """Find the projector coordinates (n, 2), px, of the points that pixels see, and the irradiance (n,) there from a
    projector of intensity 1; 0 in shadow and outside the cone around the field."""
    direction, (_, origin) = eye.directions(pixels), eye.place(pixels)
    seen = find_surface(stage.ground, stage.ground_tracer.intersect(origin, direction, *clip_m), origin, direction)
    met = np.flatnonzero(np.isfinite(seen.along))
    at, light = np.full((len(pixels), 2), np.nan), np.zeros(len(pixels))
    point = origin + direction[met] * seen.along[met, None]
    away = point - pose[:3, 3]
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
    unit = away / distance[:, None]
    cosine = -np.einsum("ij,ij->i", unit, seen.normal[met])
    at[met] = projector.locate(point, pose)
    in_cone = unit @ pose[:3, 2] >= np.cos(np.radians(projector.cone_deg) / 2)
    asked = np.flatnonzero((cosine > 0) & in_cone)
    blocked = stage.ground_tracer.is_blocked(pose[:3, 3], unit[asked], 0.0, distance[asked] * (1 - _CLEARANCE))
    free = asked[~blocked]
    light[met[free]] = cosine[free] / distance[free] ** 2
    return at, light

"""The profile of a laser beam as a few rays, and the part of it that the receiver sees.

The intensity of a Gaussian beam is exp(-2 θ²/θd²) at the angle θ from its axis, where θd is the half-angle at 1/e². A
coordinate across the beam has the variance s² = θd²/4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from ...support.arrays import Array, Numbers

#: Full width at half maximum of a Gaussian beam, in half-angles at 1/e²: √(2 ln 2).
FWHM_PER_HALF_ANGLE = float(np.sqrt(2 * np.log(2)))
#: Numbers of rays by which a beam can be sampled.
SubRayCount = Literal[1, 20, 60]
#: Number of nearest rays that count as neighbours of a ray, as in a hexagonal grid.
_NEIGHBOURS = 6
#: The angle from one point of Vogel's spiral to the next.
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True)
class SubRays:
    """Rays of a beam. ``offset`` (n, 2) is across the beam, in half-angles at 1/e². ``weight`` (n,) is the share of the
    pulse's energy; the weights add up to 1. The first ray is the axis, without energy if the beam has several rays. The
    other rays follow by distance from the axis.
    """

    offset: Array
    weight: Array

    @cached_property
    def neighbours(self) -> Array:
        """Pairs (e, 2) of rays that are neighbours across the beam."""
        count = len(self.weight)
        away = ((self.offset[:, None] - self.offset) ** 2).sum(axis=2)
        near = np.argsort(away, axis=1, kind="stable")[:, 1 : _NEIGHBOURS + 1]
        pairs = np.stack([np.repeat(np.arange(count), near.shape[1]), near.ravel()], axis=1)
        return np.unique(np.sort(pairs, axis=1), axis=0)


@lru_cache
def make_sub_rays(count: int) -> SubRays:
    """Make the axis alone for a ``count`` of 1; otherwise the axis and an even ``count`` of rays of equal energy.

    Half of the rays are on Vogel's spiral, at radii that divide the energy equally; the others are their mirror images,
    so that odd moments vanish. A linear map then gives them the beam's second moments, so that a tilted plane returns
    the right energy to the fourth order of the beam's width.
    """
    if count == 1:
        return SubRays(np.zeros((1, 2)), np.ones(1))
    k = np.arange(count // 2)
    radius = np.sqrt(-np.log1p(-(k + 0.5) / len(k)) / 2)
    half = np.stack([radius * np.cos(k * GOLDEN_ANGLE), radius * np.sin(k * GOLDEN_ANGLE)], axis=1)
    moments = half.T @ half / len(k)
    half = half @ np.linalg.inv(np.linalg.cholesky(moments)).T / 2
    half = half[np.argsort(np.hypot(*half.T), kind="stable")]
    offset = np.concatenate([np.zeros((1, 2)), np.stack([half, -half], axis=1).reshape(-1, 2)])
    return SubRays(offset, np.concatenate([[0.0], np.full(count, 1 / count)]))


def spread_beams(axis: Array, rays: SubRays, half_angle_rad: tuple[float, float]) -> Array:
    """Compute the unit vectors (m, n, 3) of the rays of beams along ``axis`` (m, 3), unit vectors in the sensor's axes.

    ``half_angle_rad`` is the half-angle at 1/e² along the sensor's horizon and across it.
    """
    bend = rays.offset * half_angle_rad
    angle = np.hypot(*bend.T)
    share = np.sinc(angle / np.pi)  # sin θ / θ
    left = np.stack([-axis[:, 1], axis[:, 0], np.zeros(len(axis))], axis=1)
    level = np.hypot(axis[:, 0], axis[:, 1])
    left = np.where(level[:, None] > 0, left / np.maximum(level, 1e-300)[:, None], [0.0, 1.0, 0.0])
    up = np.cross(axis, left)
    frames = np.stack([axis, left, up], axis=1)
    return np.asarray(np.stack([np.cos(angle), share * bend[:, 0], share * bend[:, 1]], axis=1) @ frames)


def compute_overlap(
    range_m: Numbers,
    separation_m: float,
    beam_radius_m: float,
    half_angle_rad: float,
    aperture_radius_m: float,
    field_half_angle_rad: float,
) -> Array:
    """Compute the share of the beam's disc that the receiver sees at a distance. Both are cones with parallel axes
    ``separation_m`` apart, and the beam is even across its disc.

    Source: the overlap of two circles as in Measures, Laser Remote Sensing, 1984, section 7.4.
    """
    range_m = np.asarray(range_m, np.float64)
    beam, seen = beam_radius_m + half_angle_rad * range_m, aperture_radius_m + field_half_angle_rad * range_m
    share = np.ones(range_m.shape)
    cut = separation_m > seen - beam  # elsewhere the receiver sees the whole disc
    if cut.any():
        share[cut] = _share_of_disc(separation_m, beam[cut], seen[cut])
    return share


def _share_of_disc(separation_m: float, beam: Array, seen: Array) -> Array:
    """Compute the share of discs of radius ``beam`` (n,) that is inside discs of radius ``seen`` (n,)."""
    near, far = np.minimum(beam, seen), np.maximum(beam, seen)
    apart = np.clip(separation_m, far - near, far + near)
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.arccos(np.clip((apart**2 + near**2 - far**2) / (2 * apart * near), -1, 1))
        second = np.arccos(np.clip((apart**2 + far**2 - near**2) / (2 * apart * far), -1, 1))
        common = near**2 * (first - np.sin(2 * first) / 2) + far**2 * (second - np.sin(2 * second) / 2)
        common = np.where(separation_m <= far - near, np.pi * near**2, common)
        # A beam without width is a point, which is seen or not.
        return np.asarray(np.where(beam > 0, common / (np.pi * beam**2), separation_m <= seen))

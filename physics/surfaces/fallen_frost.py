"""Frost of grains that fall from one side, as from a plume. It caps tops and spares walls, by where grains arrive and
hold.

Without air, grains keep to parallel paths over a site. A surface with the unit normal n gets max(0, n·d) / d_z of the
grains that fall on level, open ground, with the unit vector d to their origin. Grains fall at random places, one on
another. They leave free the share exp(-tau) of a surface, where tau is the share of its area that they would cover
without overlap. So a share s of level, open ground becomes 1 - (1 - s)^x on a surface that gets x times the grains.
Steep surfaces hold less: the share falls to 0 over the slopes within 15 degrees of a stated one, smoothly with the
cosine.

The laws are geometry. The steepest slope that holds frost at 0.01 g, and the width of its limit, are guesses.
"""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array, Numbers

#: Half of the range of slopes, in degrees, over which the held share of frost falls to 0.
HOLD_RANGE_DEG = 15.0
#: Largest share of level ground that grains cover, since no number of random grains covers all of it.
MAX_SHARE = 0.9999


def find_origin(surface: SurfaceSettings) -> tuple[float, float, float]:
    """Compute the unit vector (east, north, up) toward the origin of falling grains."""
    tilt, azimuth = math.radians(surface.frost_tilt_deg), math.radians(surface.frost_azimuth_deg)
    return math.sin(tilt) * math.sin(azimuth), math.sin(tilt) * math.cos(azimuth), math.cos(tilt)


def find_hold_cosines(surface: SurfaceSettings) -> tuple[float, float]:
    """Compute the upward parts of the normals of two slopes: one holds none of the frost, the other all of it. The
    first is at least 0.
    """
    none, all_ = (surface.frost_hold_deg + sign * HOLD_RANGE_DEG for sign in (1.0, -1.0))
    return math.cos(math.radians(min(none, 90.0))), math.cos(math.radians(max(all_, 0.0)))


def find_free_exponent(surface: SurfaceSettings) -> float:
    """Compute the logarithm of the share of level, open ground that falling grains leave free."""
    return math.log(1.0 - min(surface.frost_share, MAX_SHARE))


def fallen_share(surface: SurfaceSettings, normal: Array, exposed: Numbers = 1.0) -> Array:
    """Compute the share (n,) of surfaces with unit normals (n, 3) that fallen frost covers, averaged over its patches.

    ``exposed`` is the share of the grains that no other ground keeps away.
    """
    origin = find_origin(surface)
    received = np.maximum(normal @ np.array(origin), 0.0) / origin[2] * exposed
    none, all_ = find_hold_cosines(surface)
    holds = np.clip((normal[:, 2] - none) / (all_ - none), 0.0, 1.0)
    covered = -np.expm1(find_free_exponent(surface) * received)
    return np.asarray(holds * holds * (3.0 - 2.0 * holds) * covered)

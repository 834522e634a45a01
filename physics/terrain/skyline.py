"""The elevation of distant hills above the horizontal, and whether they hide the Sun from the site."""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from .terrain import Terrain, make_terrain

#: Ratio of successive distances at which the skyline is sampled: steps are at most a tenth of the narrowest hill there.
_DISTANCE_RATIO = 1.01


def find_skyline_deg(
    ground: Terrain, site_m: tuple[float, float], azimuth_deg: float, body_radius_m: float, farthest_m: float
) -> float:
    """Find the elevation in degrees of the highest ground outside the patch, seen from the ground at the site.

    ``azimuth_deg`` is from north over east. The body falls away as a parabola, which is within 0.1 % of a sphere out to
    a tenth of its radius.
    """
    start = ground.size_m * math.sqrt(0.5)
    farthest = max(min(farthest_m, 0.1 * body_radius_m), 2.0 * start)
    distance = np.geomspace(start, farthest, math.ceil(math.log(farthest / start) / math.log(_DISTANCE_RATIO)) + 1)
    azimuth = math.radians(azimuth_deg)
    z = ground.heights(site_m[0] + distance * math.sin(azimuth), site_m[1] + distance * math.cos(azimuth), start / 2)
    rise = z - float(ground.heights(*site_m, start / 2)) - distance**2 / (2.0 * body_radius_m)
    return math.degrees(math.atan(float((rise / distance).max())))


def advise_on_skyline(settings: Settings, toward_sun: Array, sun_diameter_deg: float) -> list[str]:
    """Return a sentence, in a list, if distant hills hide the Sun, in the direction of a unit vector (3,), from the
    site; else an empty list.
    """
    elevation = math.degrees(math.asin(float(np.clip(toward_sun[2], -1.0, 1.0))))
    if settings.hills.rms_slope_deg == 0.0 or settings.mesh.kind != "GRADED" or settings.source.kind != "PROCEDURAL":
        return []
    ground, rig = make_terrain(settings, int(settings.dataset.seed), with_skirts=False), settings.rig
    azimuth = math.degrees(math.atan2(toward_sun[0], toward_sun[1]))
    skyline = find_skyline_deg(
        ground, (rig.x_m, rig.y_m), azimuth, float(settings.terrain.body_radius_m), float(settings.mesh.farthest_m)
    )
    if not -sun_diameter_deg / 2 < elevation < skyline + sun_diameter_deg / 2:
        return []
    share = "Hills hide" if elevation < skyline - sun_diameter_deg / 2 else "Hills hide a part of"
    return [
        f"{share} the Sun from the site: it is {elevation:.1f} degrees above the horizon and the skyline there "
        f"{skyline:.1f}; raise the Sun, turn it, lower hills.rms_slope_deg, or change dataset.seed."
    ]

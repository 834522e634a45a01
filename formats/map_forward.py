"""From longitude and latitude to the coordinates of a map: the projections of ``map_projection``, forward.

On a sphere, by Snyder, "Map Projections: A Working Manual", USGS Professional Paper 1395, 1987.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from .map_projection import MapSystem, conformal_cone, equal_area_cone, half_polar_tangent


def _mercator(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    k = s.scale * math.cos(math.radians(s.parallel_deg))
    if abs(latitude) >= math.pi / 2:
        raise ValueError("a pole, which this map does not have")
    return k * longitude, k * math.asinh(math.tan(latitude))


def _equirectangular(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    return longitude * math.cos(math.radians(s.parallel_deg)), latitude - math.radians(s.latitude_deg)


def _sinusoidal(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    return longitude * math.cos(latitude), latitude


def _polar_stereographic(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    pole = 1.0 if s.latitude_deg >= 0 else -1.0
    k = s.scale * (1 + math.sin(math.radians(abs(s.parallel_deg)))) / 2
    rho = 2 * k * math.tan((math.pi / 2 - pole * latitude) / 2)
    return rho * math.sin(longitude), -pole * rho * math.cos(longitude)


def _transverse_mercator(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    along = math.atan2(math.sin(latitude), math.cos(latitude) * math.cos(longitude))
    across = math.atanh(math.cos(latitude) * math.sin(longitude))
    return s.scale * across, s.scale * (along - math.radians(s.latitude_deg))


def _make_azimuthal(
    radius: Callable[[MapSystem, float], float],
) -> Callable[[MapSystem, float, float], tuple[float, float]]:
    """Make a projection about a point. ``radius`` returns the distance on the map for an angle on the sphere."""

    def forward(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
        origin = math.radians(s.latitude_deg)
        east = math.cos(latitude) * math.sin(longitude)
        north = math.cos(origin) * math.sin(latitude) - math.sin(origin) * math.cos(latitude) * math.cos(longitude)
        up = math.sin(origin) * math.sin(latitude) + math.cos(origin) * math.cos(latitude) * math.cos(longitude)
        aside = math.hypot(east, north)
        if aside == 0.0:
            return 0.0, 0.0
        rho = radius(s, math.atan2(aside, up))
        return rho * east / aside, rho * north / aside

    return forward


def _orthographic_radius(_: MapSystem, angle: float) -> float:
    if angle > math.pi / 2:
        raise ValueError("on the far side")
    return math.sin(angle)


def _conic_conformal(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    n, f, rho0 = conformal_cone(s)
    rho = f / half_polar_tangent(latitude) ** n
    return rho * math.sin(n * longitude), rho0 - rho * math.cos(n * longitude)


def _conic_equal_area(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    n, c, rho0 = equal_area_cone(s)
    rho = math.sqrt(c - 2 * n * math.sin(latitude)) / n
    return rho * math.sin(n * longitude), rho0 - rho * math.cos(n * longitude)


def _cylindrical_equal_area(s: MapSystem, longitude: float, latitude: float) -> tuple[float, float]:
    k = math.cos(math.radians(s.parallel_deg))
    return k * longitude, math.sin(latitude) / k


#: Converts longitude, counted from the central meridian, and latitude, in radians, to the place on the map in radii of
#: the sphere.
_FORWARDS: dict[str, Callable[[MapSystem, float, float], tuple[float, float]]] = {
    "Mercator": _mercator,
    "Equidistant cylindrical": _equirectangular,
    "Sinusoidal": _sinusoidal,
    "Polar stereographic": _polar_stereographic,
    "Transverse Mercator": _transverse_mercator,
    "Lambert conformal conic": _conic_conformal,
    "Albers equal area": _conic_equal_area,
    "Cylindrical equal area": _cylindrical_equal_area,
    "Stereographic": _make_azimuthal(lambda s, angle: 2 * s.scale * math.tan(angle / 2)),
    "Lambert azimuthal equal area": _make_azimuthal(lambda s, angle: 2 * math.sin(angle / 2)),
    "Azimuthal equidistant": _make_azimuthal(lambda s, angle: angle),
    "Orthographic": _make_azimuthal(_orthographic_radius),
}


def project_point(system: MapSystem, longitude_deg: float, latitude_deg: float, turns: int = 0) -> tuple[float, float]:
    """Project a longitude and latitude in degrees to map coordinates in metres.

    The longitude is taken within 180° of the central one; ``turns`` adds multiples of 360°, for maps that continue
    beyond their edge. Raises ValueError for a point that the projection cannot show.
    """
    apart = (longitude_deg - system.longitude_deg + 180.0) % 360.0 - 180.0 + 360.0 * turns
    x, y = _FORWARDS[system.kind](system, math.radians(apart), math.radians(latitude_deg))
    return system.radius_m * x + system.east_m, system.radius_m * y + system.north_m

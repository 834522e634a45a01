"""From map coordinates to the ground: the length of a metre of the map at a place, and the direction of north there.

A map's metre is a metre of ground only if its projection is true to scale: a Mercator map at 60° is twice too wide.
Projections are from a sphere (Snyder, "Map Projections: A Working Manual", USGS Professional Paper 1395, 1987); on an
ellipsoid such as Earth's they are right to the flattening, 0.3 % in latitude and scale. Numbers of keys: GeoTIFF 1.1
(OGC 19-008r4); parameters of systems that a file states by number: the EPSG registry (epsg.org).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

#: Step in metres over which scale is measured.
_SCALE_STEP_M = 1.0
#: Distance in metres from a pole within which a place counts as the pole; rounding of coordinates is smaller.
_AT_POLE_M = 1e-3
#: Mean radius of Earth in metres.
_EARTH_RADIUS_M = 6371008.8
#: Radius in metres of the sphere of web maps.
_WEB_MAP_RADIUS_M = 6378137.0
_MODEL_KEY, _PROJECTED_KEY, _METHOD_KEY, _USER_DEFINED, _GEOGRAPHIC = 1024, 3072, 3075, 32767, 2
_GEOGRAPHIC_KEY, _SEMI_MAJOR_KEY, _SEMI_MINOR_KEY = 2048, 2057, 2058
#: Keys that are numbers and that ``read_system`` reads.
PROJECTION_KEYS = frozenset({1024, 2048, 2054, 2057, 2058, 2059, 2051, 2061, 3072, 3075, *range(3078, 3096)})
#: Geographic systems of Earth by number: WGS 84, NAD27, NAD83, ETRS89, WGS 72, GDA94, GDA2020, and others of EPSG.
_EARTH_SYSTEMS = range(4001, 5000)


@dataclass(frozen=True)
class MapSystem:
    """The projection of a map; angles in degrees, lengths in metres. ``kind`` is a key of ``INVERSES``. ``scale`` is
    the scale at the origin; ``parallel_deg`` and ``second_deg`` are the parallels true to scale. ``name`` is for
    sentences."""

    kind: str
    name: str
    radius_m: float
    longitude_deg: float = 0.0
    latitude_deg: float = 0.0
    parallel_deg: float = 0.0
    second_deg: float = 0.0
    scale: float = 1.0
    east_m: float = 0.0
    north_m: float = 0.0

    def to_sphere(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Convert a place on the map to longitude and latitude in degrees. Raises ValueError beyond the map's edge."""
        longitude, latitude = INVERSES[self.kind](
            self, (x_m - self.east_m) / self.radius_m, (y_m - self.north_m) / self.radius_m
        )
        turned = math.degrees(longitude) + self.longitude_deg
        return (turned + 180.0) % 360.0 - 180.0, math.degrees(latitude)


@dataclass(frozen=True)
class LocalScale:
    """The scale at a point of a map. ``east`` and ``north`` are metres of ground per metre of map along its x and y.
    ``north_deg`` is the clockwise angle in degrees from the map's y to north, and ``skew_deg`` the deviation of the two
    directions from a right angle."""

    east: float
    north: float
    north_deg: float
    skew_deg: float
    longitude_deg: float
    latitude_deg: float


def find_local_scale(system: MapSystem, x_m: float, y_m: float) -> LocalScale:
    """Find the scale of a map at map coordinates in metres. A pole, which has every longitude, gets the map's
    central longitude. Raises ValueError beyond the map's edge."""
    longitude, latitude = system.to_sphere(x_m, y_m)
    if math.radians(90.0 - abs(latitude)) * system.radius_m < _AT_POLE_M:
        longitude, latitude = (system.longitude_deg + 180.0) % 360.0 - 180.0, math.copysign(90.0, latitude)
    east, north, _ = _local_axes(longitude, latitude)
    half = _SCALE_STEP_M / 2

    def step(dx: float, dy: float) -> tuple[float, float]:
        """Return the metres east and north on the ground per metre along a direction of the map."""
        ends = [_local_axes(*system.to_sphere(x_m + side * dx, y_m + side * dy))[2] for side in (-half, half)]
        moved = [system.radius_m * (b - a) / _SCALE_STEP_M for a, b in zip(*ends, strict=True)]
        return _dot(moved, east), _dot(moved, north)

    along_x, along_y = step(1.0, 0.0), step(0.0, 1.0)
    across = math.degrees(math.atan2(along_y[0], along_y[1]))  # of the map's y, from north over east
    aside = math.degrees(math.atan2(along_x[0], along_x[1]))
    return LocalScale(
        math.hypot(*along_x),
        math.hypot(*along_y),
        -across,
        (aside - across - 90.0 + 180.0) % 360.0 - 180.0,
        longitude,
        latitude,
    )


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _local_axes(longitude_deg: float, latitude_deg: float) -> tuple[list[float], list[float], list[float]]:
    """Return the unit vectors east, north and up at a place, in the axes of the body."""
    u, v = math.radians(longitude_deg), math.radians(latitude_deg)
    return (
        [-math.sin(u), math.cos(u), 0.0],
        [-math.sin(v) * math.cos(u), -math.sin(v) * math.sin(u), math.cos(v)],
        [math.cos(v) * math.cos(u), math.cos(v) * math.sin(u), math.sin(v)],
    )


def _invert_mercator(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    k = s.scale * math.cos(math.radians(s.parallel_deg))
    return x / k, 2 * math.atan(math.exp(y / k)) - math.pi / 2


def _invert_equirectangular(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    latitude = y + math.radians(s.latitude_deg)
    return x / math.cos(math.radians(s.parallel_deg)), _check_latitude(latitude)


def _invert_sinusoidal(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    latitude = _check_latitude(y)
    return x / math.cos(latitude), latitude


def _invert_polar_stereographic(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    pole = 1.0 if s.latitude_deg >= 0 else -1.0
    k = s.scale * (1 + math.sin(math.radians(abs(s.parallel_deg)))) / 2
    latitude = pole * (math.pi / 2 - 2 * math.atan(math.hypot(x, y) / (2 * k)))
    return math.atan2(x, -pole * y), latitude


def _invert_transverse_mercator(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    x, d = x / s.scale, y / s.scale + math.radians(s.latitude_deg)
    return _to_longitude_latitude(math.sinh(x), math.cos(d), math.sin(d))


def _make_azimuthal_inverse(
    angle: Callable[[MapSystem, float], float],
) -> Callable[[MapSystem, float, float], tuple[float, float]]:
    """Make the inverse of a projection about a point. ``angle`` returns the angle on the sphere for a distance on the
    map."""

    def inverse(s: MapSystem, x: float, y: float) -> tuple[float, float]:
        rho, origin = math.hypot(x, y), math.radians(s.latitude_deg)
        if rho == 0:
            return 0.0, origin
        c = angle(s, rho)
        return _to_longitude_latitude(
            x * math.sin(c) / rho,
            math.cos(origin) * math.cos(c) - y * math.sin(origin) * math.sin(c) / rho,
            math.cos(c) * math.sin(origin) + y * math.sin(c) * math.cos(origin) / rho,
        )

    return inverse


def _to_longitude_latitude(east: float, ahead: float, up: float) -> tuple[float, float]:
    """Convert a direction of any length to longitude and latitude. They are computed from both sine and cosine, because
    a sine alone is wrong by decimetres near the poles."""
    return math.atan2(east, ahead), math.atan2(up, math.hypot(east, ahead))


def half_polar_tangent(latitude: float) -> float:
    """Return the tangent of half the angle from the south pole, which conformal projections use."""
    return math.tan(math.pi / 4 + latitude / 2)


def conformal_cone(s: MapSystem) -> tuple[float, float, float]:
    """Return the constant, the size and the radius at the origin of Lambert's conformal cone (Snyder, equations 15-1 to
    15-3)."""
    first, second = math.radians(s.parallel_deg), math.radians(s.second_deg)
    n = (
        math.sin(first)
        if abs(first - second) < 1e-9
        else math.log(math.cos(first) / math.cos(second))
        / math.log(half_polar_tangent(second) / half_polar_tangent(first))
    )
    f = s.scale * math.cos(first) * half_polar_tangent(first) ** n / n
    return n, f, f / half_polar_tangent(math.radians(s.latitude_deg)) ** n


def equal_area_cone(s: MapSystem) -> tuple[float, float, float]:
    """Return the constant, the size and the radius at the origin of Albers' cone (Snyder, equations 14-3 to 14-6)."""
    first, second = math.radians(s.parallel_deg), math.radians(s.second_deg)
    n = (math.sin(first) + math.sin(second)) / 2
    c = math.cos(first) ** 2 + 2 * n * math.sin(first)
    return n, c, math.sqrt(c - 2 * n * math.sin(math.radians(s.latitude_deg))) / n


def _invert_conic_conformal(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    n, f, rho0 = conformal_cone(s)
    rho = math.copysign(math.hypot(x, rho0 - y), n)
    sign = math.copysign(1.0, n)
    return math.atan2(sign * x, sign * (rho0 - y)) / n, 2 * math.atan((f / rho) ** (1 / n)) - math.pi / 2


def _invert_conic_equal_area(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    n, c, rho0 = equal_area_cone(s)
    sign = math.copysign(1.0, n)
    rho = math.hypot(x, rho0 - y)
    return math.atan2(sign * x, sign * (rho0 - y)) / n, math.asin((c - (rho * n) ** 2) / (2 * n))


def _invert_cylindrical_equal_area(s: MapSystem, x: float, y: float) -> tuple[float, float]:
    k = math.cos(math.radians(s.parallel_deg))
    return x / k, math.asin(y * k)


def _check_latitude(latitude: float) -> float:
    if not abs(latitude) <= math.pi / 2 + 1e-9:
        raise ValueError("beyond a pole")
    return latitude


#: Converts a place on the map, in radii of the sphere, to longitude, counted from the central meridian, and latitude,
#: in radians.
INVERSES: dict[str, Callable[[MapSystem, float, float], tuple[float, float]]] = {
    "Mercator": _invert_mercator,
    "Equidistant cylindrical": _invert_equirectangular,
    "Sinusoidal": _invert_sinusoidal,
    "Polar stereographic": _invert_polar_stereographic,
    "Transverse Mercator": _invert_transverse_mercator,
    "Lambert conformal conic": _invert_conic_conformal,
    "Albers equal area": _invert_conic_equal_area,
    "Cylindrical equal area": _invert_cylindrical_equal_area,
    "Stereographic": _make_azimuthal_inverse(lambda s, rho: 2 * math.atan(rho / (2 * s.scale))),
    "Lambert azimuthal equal area": _make_azimuthal_inverse(lambda s, rho: 2 * math.asin(rho / 2)),
    "Azimuthal equidistant": _make_azimuthal_inverse(lambda s, rho: rho),
    "Orthographic": _make_azimuthal_inverse(lambda s, rho: math.asin(rho)),
}
#: Projections by the number of their method (GeoTIFF, section C.4.2).
_KIND_BY_METHOD = {
    1: "Transverse Mercator",
    7: "Mercator",
    8: "Lambert conformal conic",
    9: "Lambert conformal conic",
    10: "Lambert azimuthal equal area",
    11: "Albers equal area",
    12: "Azimuthal equidistant",
    14: "Stereographic",
    15: "Polar stereographic",
    16: "Stereographic",
    17: "Equidistant cylindrical",
    21: "Orthographic",
    24: "Sinusoidal",
    28: "Cylindrical equal area",
}
#: National grids that are true to scale to some thousandths, although their projections are not supported.
TRUE_GRIDS = {2056, 2154, 2180, 2193, 3006, 3057, 3067, 5514, 8088, 21781, 27700, 28992, 31287, 31370}
#: Systems of Earth that a file may state by number only.
KNOWN_SYSTEMS = {
    3857: MapSystem("Mercator", "EPSG:3857", _WEB_MAP_RADIUS_M),
    3395: MapSystem("Mercator", "EPSG:3395", _WEB_MAP_RADIUS_M),
    6933: MapSystem("Cylindrical equal area", "EPSG:6933", _EARTH_RADIUS_M, parallel_deg=30.0),
    4087: MapSystem("Equidistant cylindrical", "EPSG:4087", _WEB_MAP_RADIUS_M),
    3035: MapSystem(
        "Lambert azimuthal equal area", "EPSG:3035", _EARTH_RADIUS_M, 10.0, 52.0, east_m=4321000.0, north_m=3210000.0
    ),
    **{
        code: MapSystem(
            "Polar stereographic", f"EPSG:{code}", _WEB_MAP_RADIUS_M, longitude, math.copysign(90.0, parallel), parallel
        )
        for code, longitude, parallel in (
            (3031, 0.0, -71.0),
            (3976, 0.0, -70.0),
            (3413, -45.0, 70.0),
            (3995, 0.0, 71.0),
        )
    },
    **{
        code: MapSystem(
            "Polar stereographic",
            f"EPSG:{code}",
            _WEB_MAP_RADIUS_M,
            0.0,
            pole,
            pole,
            scale=0.994,
            east_m=2e6,
            north_m=2e6,
        )
        for code, pole in ((32661, 90.0), (32761, -90.0), (5041, 90.0), (5042, -90.0))
    },
}


def states_degrees(keys: Mapping[int, Any]) -> bool:
    """Return whether the GeoKeys describe longitudes and latitudes in degrees."""
    return bool(keys.get(_MODEL_KEY) == _GEOGRAPHIC)


def read_system(keys: Mapping[int, Any], unit_m: float) -> MapSystem | None:
    """Read the projection from GeoKeys; None for an unsupported one. ``unit_m`` is the file's unit in metres."""
    if states_degrees(keys):
        radius = find_geographic_radius_m(keys)
        return None if radius is None else MapSystem("Equidistant cylindrical", "longitude and latitude", radius)
    code = keys.get(_PROJECTED_KEY)
    if code in KNOWN_SYSTEMS:
        return KNOWN_SYSTEMS[code]
    if isinstance(code, int) and (zone := _utm_zone(code)):
        number, south = zone
        middle, north_m = 6.0 * number - 183.0, 1e7 if south else 0.0
        name = f"EPSG:{code}"
        return MapSystem(
            "Transverse Mercator", name, _EARTH_RADIUS_M, middle, scale=0.9996, east_m=5e5, north_m=north_m
        )
    kind = _KIND_BY_METHOD.get(keys.get(_METHOD_KEY, 0))
    return None if kind is None else _stated_system(kind, keys, unit_m)


def _stated_system(kind: str, keys: Mapping[int, Any], unit_m: float) -> MapSystem:
    """Read the projection of a kind whose parameters GeoKeys state."""
    angle = read_angle_unit(keys)

    def stated(*numbers: int, otherwise: float = 0.0) -> float:
        return next((float(keys[number]) for number in numbers if isinstance(keys.get(number), float)), otherwise)

    latitude = angle * stated(3081, 3089, 3085)
    longitude = angle * stated(3095, 3080, 3088, 3084)
    first, scale = angle * stated(3078), stated(3092, 3093, otherwise=1.0)
    second = angle * stated(3079, otherwise=stated(3078))
    if kind == "Polar stereographic":  # without an origin, the parallel that is true to scale is used, or the pole
        first = first or latitude
        latitude = math.copysign(90.0, first)
    if kind == "Lambert conformal conic" and 3078 not in keys:
        first = second = latitude
    if kind == "Equidistant cylindrical" and 3078 not in keys:  # older writers have the parallel as the origin
        first, latitude = latitude, 0.0
    if kind == "Mercator" and 3078 not in keys:
        first, latitude = (latitude, 0.0) if 3092 not in keys else (0.0, 0.0)
    return MapSystem(
        kind,
        kind,
        _volumetric_radius_m(keys),
        longitude,
        latitude,
        first,
        second,
        scale,
        unit_m * stated(3082, 3086, 3090),
        unit_m * stated(3083, 3087, 3091),
    )


#: PROJ's names of projections, and the parameters of each, by the field of ``MapSystem``.
_PROJ_PARAMETERS = {
    "Mercator": ("merc", "lon_0=longitude_deg lat_ts=parallel_deg k=scale"),
    "Equidistant cylindrical": ("eqc", "lon_0=longitude_deg lat_0=latitude_deg lat_ts=parallel_deg"),
    "Sinusoidal": ("sinu", "lon_0=longitude_deg"),
    "Polar stereographic": ("stere", "lon_0=longitude_deg lat_0=latitude_deg lat_ts=parallel_deg k=scale"),
    "Transverse Mercator": ("tmerc", "lon_0=longitude_deg lat_0=latitude_deg k=scale"),
    "Lambert conformal conic": (
        "lcc",
        "lon_0=longitude_deg lat_0=latitude_deg lat_1=parallel_deg lat_2=second_deg k_0=scale",
    ),
    "Albers equal area": ("aea", "lon_0=longitude_deg lat_0=latitude_deg lat_1=parallel_deg lat_2=second_deg"),
    "Cylindrical equal area": ("cea", "lon_0=longitude_deg lat_ts=parallel_deg"),
    "Stereographic": ("stere", "lon_0=longitude_deg lat_0=latitude_deg k=scale"),
    "Lambert azimuthal equal area": ("laea", "lon_0=longitude_deg lat_0=latitude_deg"),
    "Azimuthal equidistant": ("aeqd", "lon_0=longitude_deg lat_0=latitude_deg"),
    "Orthographic": ("ortho", "lon_0=longitude_deg lat_0=latitude_deg"),
}
#: PROJ's words for geographic systems that are stated by number only.
_PROJ_DATUMS = {4326: "+datum=WGS84", 4269: "+datum=NAD83", 4267: "+datum=NAD27", 4258: "+ellps=GRS80"}
_GREENWICH = 8901


def make_crs_text(keys: Mapping[int, Any], unit_m: float) -> str:
    """Write the map system of GeoKeys as text for PROJ and GDAL: ``EPSG:`` and its number, or a PROJ string in the unit
    of the file. Empty without a system or for an unknown one."""
    geographic = states_degrees(keys)
    code = keys.get(_GEOGRAPHIC_KEY if geographic else _PROJECTED_KEY)
    if isinstance(code, int) and code not in (0, _USER_DEFINED):
        return f"EPSG:{code}"
    body = _make_body_text(keys)
    if geographic:
        return f"+proj=longlat {body} +no_defs" if body else ""
    system = read_system(keys, unit_m)
    if system is None or not body:
        return ""
    name, parameters = _PROJ_PARAMETERS[system.kind]
    stated = [(key, getattr(system, field)) for key, _, field in (each.partition("=") for each in parameters.split())]
    # A scale and a parallel that is true to scale exclude each other.
    kept = [
        f"+{key}={value!r}"
        for key, value in stated
        if not (key in ("k", "k_0") and value == 1.0) and not (key == "lat_ts" and system.scale != 1.0)
    ]
    unit = "+units=m" if unit_m == 1.0 else f"+to_meter={unit_m!r}"
    return " ".join([f"+proj={name}", *kept, f"+x_0={system.east_m!r} +y_0={system.north_m!r}", body, unit, "+no_defs"])


def _make_body_text(keys: Mapping[int, Any]) -> str:
    """Write PROJ's words for the body's ellipsoid and its prime meridian; empty if they are unsupported."""
    if keys.get(2051, _GREENWICH) not in (_GREENWICH, _USER_DEFINED):
        return ""
    first = f" +pm={read_angle_unit(keys) * keys[2061]!r}" if keys.get(2061) else ""
    major, minor = read_ellipsoid_m(keys)
    if major:
        return f"+a={major!r} +b={minor!r}{first}"
    code = keys.get(_GEOGRAPHIC_KEY, _USER_DEFINED)
    return _PROJ_DATUMS[code] + first if code in _PROJ_DATUMS else ""


def make_datum_text(keys: Mapping[int, Any]) -> str:
    """Describe the datum that GeoKeys state: ``EPSG:`` and the number of a geographic system, the half axes of the
    ellipsoid, or the datum of a numbered map system. Empty without a datum."""
    code, projected = (keys.get(key, 0) for key in (_GEOGRAPHIC_KEY, _PROJECTED_KEY))
    if code not in (0, _USER_DEFINED):
        return f"EPSG:{code}"
    major, minor = read_ellipsoid_m(keys)
    if major:
        return f"ellipsoid with half axes of {major!r} and {minor!r} m"
    return f"that of EPSG:{projected}" if projected not in (0, _USER_DEFINED) else ""


def find_geographic_radius_m(keys: Mapping[int, Any]) -> float | None:
    """Find the radius, m, of the body to which a file's longitudes and latitudes belong. None if the file states
    neither a radius nor a system of Earth."""
    if _SEMI_MAJOR_KEY in keys:
        return _volumetric_radius_m(keys)
    return _EARTH_RADIUS_M if keys.get(_GEOGRAPHIC_KEY, _USER_DEFINED) in _EARTH_SYSTEMS else None


def _volumetric_radius_m(keys: Mapping[int, Any]) -> float:
    """Compute the radius, m, of the sphere with the same volume as the body's ellipsoid; Earth's radius without an
    ellipsoid."""
    major, minor = read_ellipsoid_m(keys)
    return float((major * major * minor) ** (1 / 3)) if major else _EARTH_RADIUS_M


def read_ellipsoid_m(keys: Mapping[int, Any]) -> tuple[float, float]:
    """Read the half axes, m, of the body's ellipsoid, at the equator and at the poles; 0 if the file states none."""
    major = keys.get(_SEMI_MAJOR_KEY)
    if not (isinstance(major, float) and 0 < major < math.inf):
        return 0.0, 0.0
    minor = keys.get(_SEMI_MINOR_KEY)
    flattening = keys.get(2059)
    if not (isinstance(minor, float) and 0 < minor < math.inf):
        minor = major * (1 - 1 / flattening) if isinstance(flattening, float) and flattening > 1 else major
    return major, minor


def read_angle_unit(keys: Mapping[int, Any]) -> float:
    """Read the degrees per unit of the angles in the GeoKeys; 1 if these state no unit."""
    return {9101: math.degrees(1.0), 9105: 0.9, 9106: 0.9}.get(keys.get(2054, 9102), 1.0)


def _utm_zone(code: int) -> tuple[int, bool] | None:
    """Return the number of an EPSG system's UTM zone, and whether the zone is southern."""
    for first, last, before in ((32601, 32660, 32600), (25828, 25838, 25800), (26901, 26923, 26900)):
        if first <= code <= last:
            return code - before, False
    return (code - 32700, True) if 32701 <= code <= 32760 else None

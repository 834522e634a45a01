"""A site that is stated by longitude and latitude, or by the coordinates of a map, in the metres of the map."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..support.number_text import show_place
from . import gdal_lines
from .map_forward import project_point
from .map_projection import MapSystem, make_crs_text, read_ellipsoid_m, states_degrees
from .tiff import UnreadError

_WEB_MERCATOR, _MODEL_KEY, _PROJECTED_KEY, _MERIDIAN_KEY = 3857, 1024, 3072, 2061
_NO_SYSTEM = "states no coordinate system, so it has no longitudes"
#: Half axes of WGS 84, for systems of Earth that a file states by number only.
_WGS84_M = (6378137.0, 6356752.314245)
#: Relative difference of the half axes of a sphere, as writers round it.
_SPHERE = 1e-9
#: Tolerated distance of a place beyond the edge of a map, as a share of the map's size.
_ROUNDED = 1e-8


@dataclass(frozen=True)
class MapPoint:
    """A place on a map: with ``degrees``, planetocentric longitude and latitude in degrees, else easting and northing
    in the unit of the file."""

    x: float
    y: float
    degrees: bool


@dataclass(frozen=True)
class MapExtent:
    """The outer edges of a map, in metres of the map, and the file's unit."""

    west: float
    south: float
    east: float
    north: float
    unit_m: float

    def contains(self, x: float, y: float) -> bool:
        """Return whether map coordinates, m, are on the map, within rounding."""
        slack = _ROUNDED * (self.east - self.west + self.north - self.south)
        west, east, south, north = self.west - slack, self.east + slack, self.south - slack, self.north + slack
        return west <= x <= east and south <= y <= north

    def in_file_unit(self) -> tuple[float, float, float, float]:
        """Return the west, south, east and north edge in the unit of the file."""
        west, south, east, north = (edge / self.unit_m for edge in (self.west, self.south, self.east, self.north))
        return west, south, east, north

    def describe(self) -> str:
        """Describe the extent in the unit of the file, for a sentence."""
        west, south, east, north = (f"{edge:.10g}" for edge in self.in_file_unit())
        return f"from {west} to {east} east and from {south} to {north} north"


def find_point(
    point: MapPoint, system: MapSystem | None, keys: Mapping[int, Any], extent: MapExtent, name: str
) -> tuple[float, float]:
    """Find a point's map coordinates in metres. ``name`` is the file's, for commands.

    Raises UnreadError for a point outside the map, and for a map with unknown longitudes.
    """
    if not point.degrees:
        x, y = point.x * extent.unit_m, point.y * extent.unit_m
        if extent.contains(x, y):
            return x, y
        raise UnreadError(
            f"does not contain easting {point.x:.10g}, northing {point.y:.10g}, for its coordinates go "
            f"{extent.describe()}; set source.site_easting and source.site_northing to a place among them."
        )
    if system is None:
        raise UnreadError(
            ("is in an unsupported projection" if keys.get(_MODEL_KEY) else _NO_SYSTEM)
            + "; set source.site to MAP, with source.site_easting and source.site_northing."
        )
    where = show_place(point.y, point.x, ".9g")
    latitude = _find_map_latitude(point, keys, extent.unit_m, name)
    candidates = _list_places(system, point.x - _first_meridian_deg(keys), latitude)
    for place in candidates:
        if extent.contains(*place):
            return place
    at = ", ".join(f"{value / extent.unit_m:.10g}" for value in candidates[0]) if candidates else "nowhere"
    raise UnreadError(
        f"does not contain {where}, which is {at} in its coordinates, for these go {extent.describe()}"
        f"{_describe_middle(system, extent)}; set source.site_longitude_deg and source.site_latitude_deg to a place "
        "on it."
    )


def _first_meridian_deg(keys: Mapping[int, Any]) -> float:
    """Return the east longitude, in degrees, of the meridian from which a file counts; 0 if the file states none."""
    stated = keys.get(_MERIDIAN_KEY, 0.0)
    return float(stated) if isinstance(stated, int | float) else 0.0


def _list_places(system: MapSystem, longitude_deg: float, latitude_deg: float) -> list[tuple[float, float]]:
    """List the map positions, m, of a longitude and latitude, degrees: first the position nearest to the central
    meridian, then those 360° west and east of it."""
    found = []
    for turns in (0, -1, 1):
        try:
            found.append(project_point(system, longitude_deg, latitude_deg, turns))
        except (ValueError, OverflowError, ZeroDivisionError):
            continue
    return found


def _describe_middle(system: MapSystem, extent: MapExtent) -> str:
    """Describe the middle of a map in degrees, for a sentence; empty where it has none."""
    try:
        longitude, latitude = system.to_sphere((extent.west + extent.east) / 2, (extent.south + extent.north) / 2)
    except (ValueError, OverflowError, ZeroDivisionError):
        return ""
    return f", about {show_place(latitude, longitude, '.6g')}"


def _find_map_latitude(point: MapPoint, keys: Mapping[int, Any], unit_m: float, name: str) -> float:
    """Convert a point's latitude, in degrees, to the map's convention: planetographic on an ellipsoid.

    Raises UnreadError for a projection of an ellipsoid, because positions on it are known here only to its flattening.
    """
    major, minor = read_ellipsoid_m(keys)
    code = keys.get(_PROJECTED_KEY)
    if not major:
        major, minor = _WGS84_M
    if abs(major - minor) <= _SPHERE * major:
        return point.y
    latitude = math.degrees(
        math.atan2(major**2 * math.sin(math.radians(point.y)), minor**2 * math.cos(math.radians(point.y)))
    )
    if states_degrees(keys) or code == _WEB_MERCATOR:
        return latitude
    body = f"+proj=longlat +a={major!r} +b={minor!r} +no_defs"
    raise UnreadError(
        "is in a projection of an ellipsoid, where Icy Moon has no exact place of a longitude and latitude; set "
        "source.site to MAP, with the easting and northing that this prints: "
        + gdal_lines.make_transform_command(body, make_crs_text(keys, unit_m), (point.x, latitude))
    )

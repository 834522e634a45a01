"""The site of the settings on the map of their ground's file."""

from __future__ import annotations

from pathlib import Path

from ..settings.topics.ground import SourceSettings
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import geotiff
from .geotiff import MapPlace, Site
from .map_point import MapPoint

#: Largest longitudes and latitudes of a place, degrees.
_MOST_LONGITUDE_DEG, _MOST_LATITUDE_DEG = 360.0, 90.0


def read_site_place(path: Path, settings: Settings) -> MapPlace | None:
    """Where the site of the settings is on the map of a GeoTIFF file, from its tags; None if it has no map.

    Raises IcyMoonError for a file that cannot be read, and for a site that is not on its map.
    """
    return geotiff.read_place(path, make_map_site(settings))


def make_map_site(settings: Settings) -> Site:
    """The part of a map that the settings of a height map want. Raises IcyMoonError for half a place."""
    source, terrain = settings.source, settings.terrain
    return Site(
        bool(source.centre),
        (float(source.origin_x_m), float(source.origin_y_m)),
        float(terrain.size_m),
        float(terrain.body_radius_m),
        _find_stated_point(source),
    )


def _find_stated_point(source: SourceSettings) -> MapPoint | None:
    """The place that the settings state by coordinates; None if they state none. Raises IcyMoonError for half a
    place, and for a place that no globe has."""
    if source.site == "OFFSET":
        return None
    degrees = source.site == "DEGREES"
    keys = ("site_longitude_deg", "site_latitude_deg") if degrees else ("site_easting", "site_northing")
    for key in keys:
        if not source[key]:
            raise IcyMoonError(f"source.site is {source.site}, but source.{key} is empty; set it, such as 12.5.")
    point = MapPoint(float(source[keys[0]]), float(source[keys[1]]), degrees)
    if degrees and not (abs(point.x) <= _MOST_LONGITUDE_DEG and abs(point.y) <= _MOST_LATITUDE_DEG):
        raise IcyMoonError(
            f"source.site_longitude_deg is {point.x:g} and source.site_latitude_deg {point.y:g}; longitudes are -360 "
            "to 360 and latitudes -90 to 90 degrees, so give the longitude first."
        )
    return point

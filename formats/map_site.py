"""The file of a height map before its heights are read: its format, its pixels, and the site on its map."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

from ..settings.topics.ground import SourceSettings
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.foreign_bytes import read
from . import gdal_lines, geotiff, sidecar_files
from .geotiff import MapPlace, Site
from .map_point import MapPoint
from .tiff import MAX_BYTES

#: Suffixes of height maps that are read, TIFF's suffixes first.
TIFF_SUFFIXES = (".tif", ".tiff")
SUFFIXES = (*TIFF_SUFFIXES, ".npy", ".png", ".exr")
#: First bytes of a file that show its format.
_START_BYTES = 32

#: Largest longitudes and latitudes of a place, degrees.
_MAX_LONGITUDE_DEG, _MAX_LATITUDE_DEG = 360.0, 90.0


def read_site_place(path: Path, settings: Settings) -> MapPlace | None:
    """Read the position of the settings' site on the map of a GeoTIFF file, from its tags; None without a map.

    Raises IcyMoonError for a file that cannot be read, and for a site that is not on its map.
    """
    return geotiff.read_place(path, make_map_site(settings))


def check_map(path: Path, settings: Settings) -> None:
    """Raise IcyMoonError for a height map of an unsupported format, and for one whose pixel size is stated neither by
    the file nor by the settings. Only the head of the file is read."""
    source, radius_m = settings.source, float(settings.terrain.body_radius_m)
    refuse_size_by_hand(source)
    read_start(path, radius_m)
    if source.metres_per_pixel > 0:
        return
    is_tiff = path.suffix.lower() in TIFF_SUFFIXES
    unplaced = geotiff.find_why_pixel_size_unknown(path, radius_m) if is_tiff else sidecar_files.why_unplaced(path)
    if unplaced:
        refuse_unknown_pixel_size(path, unplaced, source)


def read_start(path: Path, body_radius_m: float) -> bytes:
    """Read the first bytes of a height map, which show its format. Raises IcyMoonError for an unsupported format.

    ``body_radius_m`` is for commands that convert a file in degrees.
    """
    suffix = path.suffix.lower()
    if suffix not in (*SUFFIXES, *gdal_lines.SUFFIXES):
        raise IcyMoonError(f"{path}: is not a height map that Icy Moon reads; give one of {', '.join(SUFFIXES)}.")
    start = read(
        path,
        lambda foreign: foreign.part(0, min(foreign.size, _START_BYTES)),
        "a height map",
        "check source.file",
        MAX_BYTES,
    )
    if suffix in gdal_lines.SUFFIXES:
        raise IcyMoonError(f"{path}: {gdal_lines.advise(path, start, body_radius_m)}")
    return start


def refuse_size_by_hand(source: SourceSettings) -> None:
    """Raise IcyMoonError if the settings state a pixel size in place of the map, but give the site by the map's
    coordinates."""
    if source.site != "OFFSET" and source.metres_per_pixel > 0:
        raise IcyMoonError(
            f"source.metres_per_pixel = {source.metres_per_pixel:g} replaces the map of the file, in which source.site "
            "states a place; set it to 0, or source.site to OFFSET."
        )


def refuse_unknown_pixel_size(path: Path, unplaced: str, source: SourceSettings) -> NoReturn:
    """Raise IcyMoonError for a file that does not state the size of its pixels; ``unplaced`` is the reason, as the end
    of a sentence."""
    fix = (
        "set source.metres_per_pixel"
        if source.site == "OFFSET"
        else "set source.site to OFFSET, or give a GeoTIFF with a map"
    )
    # A sentence with a command ends with it.
    raise IcyMoonError(f"{path}: {unplaced}{'' if ' with: ' in unplaced else f'; {fix}.'}")


def make_map_site(settings: Settings) -> Site:
    """Make the site that a height map's settings request. Raises IcyMoonError if one of two coordinates is missing."""
    source, terrain = settings.source, settings.terrain
    return Site(
        bool(source.centre),
        (float(source.origin_x_m), float(source.origin_y_m)),
        float(terrain.size_m),
        float(terrain.body_radius_m),
        _find_stated_point(source),
    )


def _find_stated_point(source: SourceSettings) -> MapPoint | None:
    """Find the point that the settings give by coordinates; None without coordinates. Raises IcyMoonError if one of the
    two coordinates is missing or impossible."""
    if source.site == "OFFSET":
        return None
    degrees = source.site == "DEGREES"
    keys = ("site_longitude_deg", "site_latitude_deg") if degrees else ("site_easting", "site_northing")
    for key in keys:
        if not source[key]:
            raise IcyMoonError(f"source.site is {source.site}, but source.{key} is empty; set it, such as 12.5.")
    point = MapPoint(float(source[keys[0]]), float(source[keys[1]]), degrees)
    if degrees and not (abs(point.x) <= _MAX_LONGITUDE_DEG and abs(point.y) <= _MAX_LATITUDE_DEG):
        raise IcyMoonError(
            f"source.site_longitude_deg is {point.x:g} and source.site_latitude_deg {point.y:g}; longitudes are -360 "
            "to 360 and latitudes -90 to 90 degrees, so give the longitude first."
        )
    return point

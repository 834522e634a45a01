"""Digital elevation models in GeoTIFF: heights and places in metres, north up, or a sentence on why they cannot be
used.

Blender's own loader turns whole numbers into fractions of their range, and ignores pixel size and missing values. Tags
and keys: GeoTIFF 1.1 (OGC 19-008r4); GDAL_METADATA and GDAL_NODATA (gdal.org/drivers/raster/gtiff.html); units and
vertical systems: the EPSG registry (epsg.org).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.mesh.height_map import NO_HEIGHT, clear_missing_mark, clear_stated_mark
from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes, parse_xml
from ..support.foreign_bytes import read as read_foreign
from ..support.number_text import show_place
from . import gdal_lines, sidecar_files
from .geokeys import VERTICAL, GeoKeys, make_geokeys, read_numbers
from .map_point import MapExtent, MapPoint, find_point
from .map_projection import (
    KNOWN_SYSTEMS,
    PROJECTION_KEYS,
    TRUE_GRIDS,
    LocalScale,
    MapSystem,
    find_geographic_radius_m,
    find_local_scale,
    make_crs_text,
    make_datum_text,
    read_angle_unit,
    read_ellipsoid_m,
    read_system,
)
from .sidecar_files import NO_PIXEL_SIZE
from .tiff import (
    FIX,
    KIND,
    MAX_BYTES,
    Directory,
    Tags,
    UnreadError,
    grant_memory,
    read_directories,
    read_pixels,
)

#: Metres per unit of length by its EPSG code.
_METRES_PER_EPSG_UNIT = {
    1025: 0.001,
    1033: 0.01,
    9001: 1.0,
    9002: 0.3048,
    9003: 1200 / 3937,
    9005: 0.3047972654,
    9014: 1.8288,
    9030: 1852.0,
    9031: 1.0000135965,
    9036: 1000.0,
    9093: 1609.344,
    9096: 0.9144,
    9097: 20.1168,
}
#: Metres per unit of length by the names that GDAL and others write into a band's unit.
_METRES_PER_NAMED_UNIT = {
    "m": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "mm": 0.001,
    "cm": 0.01,
    "km": 1000.0,
    "kilometre": 1000.0,
    "kilometer": 1000.0,
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "us-ft": 1200 / 3937,
    "ftus": 1200 / 3937,
    "us survey foot": 1200 / 3937,
    "us survey feet": 1200 / 3937,
}
#: Map systems of Earth in metres that a file may state by number only.
_SYSTEMS_IN_METRES = {
    3031,
    3395,
    3413,
    3857,
    3976,
    3995,
    32661,
    32761,
    *range(25828, 25839),
    *range(26901, 26924),
    *range(32601, 32661),
    *range(32701, 32761),
}
#: Vertical systems of Earth that count downwards.
_DEPTH_SYSTEMS = {
    5336,
    5612,
    5614,
    5706,
    5715,
    5734,
    5739,
    5789,
    5831,
    *range(5861, 5868),
    5873,
    6357,
    6358,
    6359,
    7976,
    8051,
    8053,
    8358,
    8378,
    8897,
    9287,
    9288,
    9672,
    10150,
    10151,
    10349,
    10364,
    *range(10370, 10380),
    *range(10547, 10553),
    10649,
    10650,
    10678,
}
#: GeoKeys in use: model, kind of raster, map system, unit, size of the unit, vertical system, its unit; and the keys of
#: projections.
_GEOKEYS = {1024, 1025, 3072, 3076, 3077, 4096, 4099} | PROJECTION_KEYS
#: Largest number of pixels of a file that is read as a whole, with 63 bytes for each. Of a larger file only the site's
#: part is read.
_MAX_WHOLE_PIXELS = 2**22
#: Number of pixels that are read around the site's part.
_MARGIN_PIXELS = 16
#: A scale that differs from 1 by less than this, such as UTM's, counts as 1.
_SCALE_TOLERANCE = 1e-3
#: Least deviation in degrees from a right angle at which the axes of a map count as skewed.
_SKEW_DEG = 0.5
#: Least angle in degrees between a map's up and north that is reported.
_TURNED_DEG = 0.1
#: Least such angle in degrees that gives a warning; UTM turns north by at most 3°.
_FAR_TURNED_DEG = 5.0
#: Bytes of GDAL's metadata; a list of some items has some hundreds.
_MAX_METADATA_BYTES = 2**20
#: Value of a GeoKey: a projected map.
_PROJECTED = 1
#: Value of a GeoKey: longitude and latitude.
_GEOGRAPHIC = 2
#: Value of a GeoKey: a system that the file defines itself.
_USER_DEFINED = 32767
#: Radii of one body in maps of several sources differ by less than this share.
_SAME_BODY = 0.01
_PIXEL_IS_POINT = 2  # value of GTRasterTypeGeoKey: coordinates refer to pixel centres
#: A turned grid counts as lying along the axes if its rotation moves no pixel by more than this number of pixels, over
#: the whole length.
_MAX_TURN_PX = 1e-3
#: The option of ``gdal_translate`` that writes the units of a system that a file states by number.
_STATE_UNITS_OPTION = "-co GEOTIFF_VERSION=1.0"
#: Ratio of the sides of the part that a command cuts out of a map to the sides of the wanted ground.
_CUT_MARGIN = 1.1


@dataclass(frozen=True)
class Site:
    """The requested part of a map: ``size_m`` metres of ground around an origin. With ``centre``, ``origin_m`` (east,
    north) is the origin's distance, in metres of ground, from the middle of the map; otherwise it is the origin's map
    coordinates in metres. With a ``point``, the origin is ``origin_m`` metres of ground from that point.

    ``body_radius_m`` is the radius of the site's body, for a file in degrees that states no radius; 0 if unknown.
    """

    centre: bool
    origin_m: tuple[float, float]
    size_m: float
    body_radius_m: float = 0.0
    point: MapPoint | None = None


#: The conversion of a point in the site's frame to its map, for files that state a ``MapPlace``.
MAP_FORMULA = (
    "map x = (origin[0] + x / scale[0]) / unit_m, map y = (origin[1] + y / scale[1]) / unit_m, height of "
    "the file in metres = z + height_zero_m, and with body_radius_m R plus the drop R - sqrt(R^2 - x^2 - y^2)"
)


def describe_map_place(ground: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the position on a map from the ``ground`` of a ``pair.json``, with the formula for its points; empty for
    ground without a map."""
    place = (ground or {}).get("map")
    return {**place, "formula": MAP_FORMULA} if place else {}


def describe_map_notes(ground: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the result of ``describe_map_place`` as {"map": JSON text}, for the metadata of a file; empty without a
    map."""
    place = describe_map_place(ground)
    return {"map": json.dumps(place)} if place else {}


@dataclass(frozen=True)
class MapPlace:
    """The position of the site's origin on a map, and the scale there.

    A point at (x, y) metres east and north of the origin has the map coordinates ``origin`` + (x / ``scale[0]``, y /
    ``scale[1]``), in metres of the map; divided by ``unit_m`` they are in the file's unit. ``crs`` is the map system as
    PROJ takes it, empty if the file states no supported system; ``datum`` its geographic system or ellipsoid, and
    ``height_system`` the vertical system that the file states, empty if it states none. ``north_deg`` is the angle from
    the map's up to north, clockwise. ``geokeys`` are the GeoKeys of the file as it has them, for files that are written
    in the same system, and ``bounds`` the outer edges of the map in the file's unit.
    """

    crs: str
    unit_m: float
    origin: tuple[float, float]
    scale: tuple[float, float]
    longitude_deg: float | None = None
    latitude_deg: float | None = None
    north_deg: float = 0.0
    datum: str = ""
    height_system: str = ""
    geokeys: GeoKeys | None = None
    bounds: tuple[float, float, float, float] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the map position as a table for ``pair.json`` and exports."""
        return {
            "crs": self.crs,
            "datum": self.datum,
            "height_system": self.height_system,
            "unit_m": self.unit_m,
            "origin": list(self.origin),
            "scale": list(self.scale),
            "longitude_deg": self.longitude_deg,
            "latitude_deg": self.latitude_deg,
            "north_deg": self.north_deg,
            **({"bounds": list(self.bounds)} if self.bounds else {}),
            **({"geokeys": self.geokeys.to_json()} if self.geokeys else {}),
        }


@dataclass(frozen=True)
class GeoTiff:
    """Heights (rows, columns) float64 in metres, row 0 northernmost and column 0 westernmost, NaN where missing.

    ``pixel_m`` is the size of a pixel (east, north) on the ground. ``corner_m`` is the position of the centre of the
    lower left pixel, from the origin of the ``Site``, or in map coordinates if there is no ``Site``. Both are None if
    the file does not state them; ``unplaced`` is then the reason, as the end of a sentence. ``report`` lists the file's
    statements about its heights, ``warnings`` the assumptions. ``file_shape`` is (rows, columns) of the whole file.
    """

    heights_m: Array
    pixel_m: tuple[float, float] | None
    corner_m: tuple[float, float] | None
    unplaced: str
    report: tuple[str, ...]
    warnings: tuple[str, ...]
    file_shape: tuple[int, int]
    place: MapPlace | None = None


def read(path: Path, site: Site | None = None, missing: float | None = None) -> GeoTiff:
    """Read a one-band elevation model; from a large file only the part that the ``site`` needs.

    ``missing`` is a value of the file, before scale and unit, that marks missing heights, beside the file's own marks.
    Raises IcyMoonError, with the fix, if the file cannot be read.
    """
    found = read_foreign(path, lambda foreign: _read(foreign, site, missing), KIND, FIX, MAX_BYTES)
    if found.unplaced != NO_PIXEL_SIZE:
        return replace(found, warnings=(*found.warnings, *sidecar_files.describe_gdal_notes(path)))
    return replace(
        found,
        unplaced=sidecar_files.why_unplaced(path),
        warnings=(*found.warnings, *sidecar_files.describe_world_file(path), *sidecar_files.describe_gdal_notes(path)),
    )


def read_place(path: Path, site: Site) -> MapPlace | None:
    """Read the position of a site on the map of a file, without heights; None if the file has no map.

    Raises IcyMoonError if the file is damaged or its map does not contain the site.
    """

    def parse(foreign: ForeignBytes) -> MapPlace | None:
        grant_memory(foreign)
        image = read_directories(foreign)[0]
        keys = read_keys(image.tags)
        grid = read_placement(image, keys)
        unit, _ = find_coordinate_unit(keys, foreign.name, site.body_radius_m)
        if grid is None or unit is None:
            return None
        return _place_site(image.shape, *grid, unit, keys, foreign.name, site, make_geokeys(image.tags)).place

    return read_foreign(path, parse, KIND, FIX, MAX_BYTES)


def find_why_pixel_size_unknown(path: Path, body_radius_m: float) -> str:
    """Find from a file's tags why the ground size of its pixels is unknown. Returns the end of a sentence, empty if the
    size is known.

    ``body_radius_m`` is for commands that convert a file in degrees. Raises IcyMoonError for a file that cannot be
    read.
    """

    def parse(foreign: ForeignBytes) -> str:
        grant_memory(foreign)
        image = read_directories(foreign)[0]
        keys = read_keys(image.tags)
        grid = read_placement(image, keys)
        unit, sentence = find_coordinate_unit(keys, foreign.name, body_radius_m)
        if grid is None:
            return NO_PIXEL_SIZE
        return _describe_unknown_size(sentence, grid[0]) if unit is None else ""

    why = read_foreign(path, parse, KIND, FIX, MAX_BYTES)
    return sidecar_files.why_unplaced(path) if why == NO_PIXEL_SIZE else why


def _describe_unknown_size(sentence: str, step: tuple[float, float]) -> str:
    """Return the end of a sentence about pixels whose size is stated in an unknown unit."""
    return sentence.replace("{size}", f"{abs(step[0]):g} x {abs(step[1]):g}")


def _read(foreign: ForeignBytes, site: Site | None, missing: float | None) -> GeoTiff:
    grant_memory(foreign)
    images = read_directories(foreign)
    image = images[0]
    keys = read_keys(image.tags)
    grid = read_placement(image, keys)
    unit, sentence = find_coordinate_unit(keys, foreign.name, site.body_radius_m if site else 0.0)
    placed: _Placed | None = None
    if grid is not None and unit is not None:
        placed = _place_site(image.shape, *grid, unit, keys, foreign.name, site, make_geokeys(image.tags))
    window = placed.window if placed else None
    heights, number = read_pixels(foreign, image, window)
    warnings = clear_missing(heights, number, image.tags.get(42113))
    stated: tuple[str, ...] = ()
    if missing is not None:
        stated = clear_stated_mark(heights, missing, number)
    warnings += apply_mask(heights, foreign, images, window)
    scaled, in_unit = scale_to_metres(heights, image, keys)
    report = (*stated, *scaled)
    if not in_unit and keys.get(1024, 0) != _GEOGRAPHIC:
        warnings += warn_unstated_metres(unit, foreign.name)
    if grid is None:
        return GeoTiff(heights, None, None, NO_PIXEL_SIZE, report, tuple(warnings), image.shape)
    (east, north), _ = grid
    heights = heights[::-1] if north > 0 else heights  # rows that go north
    heights = heights[:, ::-1] if east < 0 else heights
    if placed is None:
        unplaced = _describe_unknown_size(sentence, (east, north))
        return GeoTiff(heights, None, None, unplaced, report, tuple(warnings), image.shape)
    warnings += [*([sentence] if sentence else []), *placed.warnings]
    return GeoTiff(
        heights,
        placed.pixel_m,
        placed.corner_m,
        "",
        (*report, *placed.report),
        tuple(warnings),
        image.shape,
        placed.place if site else None,
    )


@dataclass(frozen=True)
class _Placed:
    """A window of a map (rows and columns in the file's order), the size of its pixels in metres of ground, and its
    position."""

    window: tuple[range, range] | None
    pixel_m: tuple[float, float]
    corner_m: tuple[float, float]
    place: MapPlace
    report: list[str]
    warnings: list[str]


def _warn_other_body(radius_m: float, body_radius_m: float) -> list[str]:
    """Warn if the body of a map differs in size from the body that gives the site its horizon and sky."""
    if abs(radius_m / body_radius_m - 1) <= _SAME_BODY:
        return []
    return [
        f"it is a map of a body with a radius of {radius_m / 1000:.6g} km, but terrain.body_radius_m is "
        f"{body_radius_m / 1000:.6g} km, and a date has the sky of light.body; if the map is right, set "
        f"terrain.body_radius_m to {radius_m:.7g} and light.directions_from to ANGLES"
    ]


def _describe_place(map_of: _Map, place: MapPlace, body_radius_m: float) -> tuple[list[str], list[str]]:
    """Return sentences for the report, and warnings, about a map's scale at a position and the direction of north
    there. ``body_radius_m`` is the radius of the body in the settings, or 0 for no check."""
    report: list[str] = []
    warnings: list[str] = []
    if map_of.system is not None and place.scale != (1.0, 1.0):
        assert place.latitude_deg is not None
        assert place.longitude_deg is not None
        where = show_place(place.latitude_deg, place.longitude_deg, ".4f")
        report.append(
            f"Map ({map_of.system.name}) at {where}: a metre of it is {place.scale[0]:.6g} m of ground along "
            f"x, {place.scale[1]:.6g} m along y"
        )
    if map_of.system is not None and body_radius_m:
        warnings += _warn_other_body(map_of.system.radius_m, body_radius_m)
    if abs(place.north_deg) > _TURNED_DEG:
        turned = (
            f"orth is {place.north_deg:.1f}° clockwise of the map's up, from which azimuths and headings are counted"
        )
        report.append(f"N{turned}")
        warnings += [f"n{turned}"] if abs(place.north_deg) > _FAR_TURNED_DEG else []
    return report, warnings


def _place_site(
    shape: tuple[int, int],
    step: tuple[float, float],
    corner: tuple[float, float],
    unit: float,
    keys: Mapping[int, Any],
    name: str,
    site: Site | None,
    stored: GeoKeys | None,
) -> _Placed:
    """Locate a site on a map. Raises UnreadError if it is outside the map system or the map's directions are skewed."""
    size = abs(step[0]) * unit, abs(step[1]) * unit
    first = corner[0] * unit, corner[1] * unit
    if site is None:
        return _Placed(None, size, first, MapPlace("", unit, (0.0, 0.0), (1.0, 1.0)), [], [])
    middle = first[0] + (shape[1] - 1) * size[0] / 2, first[1] + (shape[0] - 1) * size[1] / 2
    map_of = _Map(read_system(keys, unit), keys, unit, size, site.size_m, name)
    _refuse_unknown_projection(map_of)
    origin, base = site.origin_m, middle
    west, south = first[0] - size[0] / 2, first[1] - size[1] / 2
    extent = MapExtent(west, south, west + shape[1] * size[0], south + shape[0] * size[1], unit)
    if site.point is not None:
        base = find_point(site.point, map_of.system, keys, extent, name)
    if site.centre or site.point is not None:
        scale = _locate_on_map(map_of, base).scale
        origin = base[0] + site.origin_m[0] / scale[0], base[1] + site.origin_m[1] / scale[1]
    place = replace(_locate_on_map(map_of, origin), geokeys=stored, bounds=extent.in_file_unit())
    report, warnings = _describe_place(map_of, place, site.body_radius_m if site.point else 0.0)
    pixel = size[0] * place.scale[0], size[1] * place.scale[1]
    window, west, south = None, 0, 0
    if shape[0] * shape[1] > _MAX_WHOLE_PIXELS:
        columns, rows = (
            _range_around(shape[1 - k], (place.origin[k] - first[k]) / size[k], site.size_m / 2 / pixel[k])
            for k in range(2)
        )
        west, south = columns.start, rows.start
        window = (
            rows if step[1] > 0 else range(shape[0] - rows.stop, shape[0] - rows.start),
            columns if step[0] > 0 else range(shape[1] - columns.stop, shape[1] - columns.start),
        )
    corner_m = (
        (first[0] + west * size[0] - origin[0]) * place.scale[0],
        (first[1] + south * size[1] - origin[1]) * place.scale[1],
    )
    return _Placed(window, pixel, corner_m, place, report, warnings)


def _range_around(count: int, middle: float, half: float) -> range:
    """Return the pixels, of ``count``, that lie within ``half`` pixels of the ``middle``, and a margin from which holes
    are filled. There are at least two."""
    low = min(max(math.floor(middle - half) - _MARGIN_PIXELS, 0), count - 2)
    return range(low, max(min(math.ceil(middle + half) + _MARGIN_PIXELS + 1, count), low + 2))


@dataclass(frozen=True)
class _Map:
    """The map of a file: its projection (None if unsupported), its GeoKeys, its unit in metres, the size of a pixel in
    metres of the map, the size of the wanted ground in metres, and the file's name."""

    system: MapSystem | None
    keys: Mapping[int, Any]
    unit_m: float
    pixel_m: tuple[float, float]
    size_m: float
    name: str


def _refuse_unknown_projection(map_of: _Map) -> None:
    """Raise UnreadError for a map with an unknown projection, and so an unknown scale."""
    keys = map_of.keys
    code = keys.get(3072, 0)
    numbered = code not in (0, _USER_DEFINED)
    if (
        map_of.system is not None
        or keys.get(1024) != _PROJECTED
        or code in TRUE_GRIDS
        or not (numbered or 3075 in keys)
    ):
        return
    major, minor = read_ellipsoid_m(keys)
    degrees = f'"+proj=longlat +a={major!r} +b={minor!r} +no_defs"' if major else "EPSG:4326"
    kind = f"EPSG:{code}" if numbered else f"projection {keys[3075]} of GeoTIFF"
    raise UnreadError(
        f"has a map ({kind}) whose scale Icy Moon cannot compute; set source.metres_per_pixel if it is true to "
        f"scale, else project it in its folder with: {gdal_lines.make_warp_command(map_of.name, f'-t_srs {degrees}')}"
    )


def _locate_on_map(map_of: _Map, at: tuple[float, float]) -> MapPlace:
    """Locate a map position with its scale, which is 1 if unknown or within a thousandth of 1."""
    system, keys = map_of.system, map_of.keys
    vertical = keys.get(4096, 0)
    place = MapPlace(
        make_crs_text(keys, map_of.unit_m),
        map_of.unit_m,
        at,
        (1.0, 1.0),
        datum=make_datum_text(keys),
        height_system=f"EPSG:{vertical}" if vertical not in (0, _USER_DEFINED) else "",
    )
    if system is None:
        return place
    try:
        found = find_local_scale(system, *at)
    except (ValueError, OverflowError, ZeroDivisionError):
        raise UnreadError(
            f"has no ground at ({at[0]:g}, {at[1]:g}) m of its map ({system.name}); set source.centre, "
            "source.origin_x_m and source.origin_y_m to a place on it."
        ) from None
    if abs(found.skew_deg) > _SKEW_DEG:
        raise UnreadError(
            f"has a map ({system.name}) whose directions are {90 - abs(found.skew_deg):.1f}° apart at "
            "the origin, so its squares are not square on the ground; set source.centre with "
            "source.origin_x_m = source.origin_y_m = 0 for the part that you make in its folder with: "
            + _cut_command(map_of, system, found)
        )
    true = max(abs(found.east - 1), abs(found.north - 1)) < _SCALE_TOLERANCE
    return replace(
        place,
        scale=(1.0, 1.0) if true else (found.east, found.north),
        longitude_deg=found.longitude_deg,
        latitude_deg=found.latitude_deg,
        north_deg=found.north_deg,
    )


def _cut_command(map_of: _Map, system: MapSystem, at: LocalScale) -> str:
    """Make the command that cuts the requested part of a map around a position, true to scale."""
    half = (map_of.size_m / 2) * _CUT_MARGIN
    return gdal_lines.make_warp_command(
        map_of.name,
        f'-t_srs "+proj=aeqd +lat_0={at.latitude_deg:.9f} '
        f'+lon_0={at.longitude_deg:.9f} +R={system.radius_m:.1f} +units=m +no_defs"',
        f"-te {-half:g} {-half:g} {half:g} {half:g}",
        f"-tr {map_of.pixel_m[0] * at.east:g} {map_of.pixel_m[1] * at.north:g}",
    )


def _flat_system_option(keys: Mapping[int, Any]) -> str:
    """Make the command option for the horizontal map system of a file without its vertical one."""
    text = make_crs_text(keys, 1.0)
    return f'-a_srs "{text}"' if text else ""


def read_keys(tags: Tags) -> dict[int, Any]:
    """Read the GeoKeys in use, by number: whole numbers or floats. Raises ValueError if a key is text."""
    return read_numbers(tags.get(34735, ()), tags.get(34736, ()), _GEOKEYS)


def clear_missing(grid: Array, number: np.dtype[Any], nodata: tuple[Any, ...] | None) -> list[str]:
    """Set missing and impossible heights to NaN. Returns warnings."""
    grid[~(np.abs(grid) < NO_HEIGHT)] = np.nan
    text = _decode_text(nodata)
    if not text:
        return []
    try:
        value = float(text)
    except ValueError:
        return [f"its mark of missing heights, {text[:40]!r}, is not a number, so no height counts as missing"]
    if math.isfinite(value) and abs(value) < NO_HEIGHT:
        clear_missing_mark(grid, value, number)
    return []


def apply_mask(
    grid: Array, foreign: ForeignBytes, images: list[Directory], window: tuple[range, range] | None
) -> list[str]:
    """Set the heights that the file's mask marks as unknown to NaN. Returns warnings about the file's other images."""
    others = [image for image in images[1:] if not image.is_reduced]
    masks = [image for image in others if image.is_mask and image.shape == images[0].shape]
    for image in masks[:1]:
        grid[read_pixels(foreign, image, window)[0] == 0] = np.nan
    count = sum(not image.is_mask for image in others)
    return [f"it holds {count + 1} images, of which the first was read"] if count else []


def _decode_text(tag: tuple[Any, ...] | None) -> str:
    return b"".join(tag or ()).split(b"\0")[0].decode("utf-8", "replace").strip()


def warn_unstated_metres(unit_m: float | None, file: str) -> list[str]:
    """Warn if a file has no unit for its heights, but a unit other than the metre for its coordinates."""
    if unit_m is None or math.isclose(unit_m, 1.0, rel_tol=1e-6):
        return []
    name = next(
        (name for name, metres in _METRES_PER_NAMED_UNIT.items() if math.isclose(metres, unit_m, rel_tol=1e-6)), ""
    )
    state = gdal_lines.make_edit_command(file, f"-units '{name}'")
    fix = (
        f"if they are in {name}, as its coordinates are, state it in its folder with: {state}"
        if name
        else "if they are in another unit, write them in metres"
    )
    return [
        f"it states no unit for its heights, which were read as metres although its coordinates are in units of "
        f"{unit_m:g} m; {fix}"
    ]


def scale_to_metres(grid: Array, image: Directory, keys: Mapping[int, Any]) -> tuple[tuple[str, ...], bool]:
    """Convert the values to metres in place, by the scale, offset and unit that the file states. Returns sentences on
    the conversion, and whether the file states a unit.

    Raises UnreadError if scale, offset and unit contradict each other or are of an unknown kind.
    """
    items = read_metadata(image)
    scale, offset = read_scaling(image, items)
    unit, name = _find_height_unit(keys, items.get("unittype", ""), (scale, offset), image.name)
    if third := _read_height_scale(image.tags):
        raise UnreadError(
            "scales its heights by the third number of ModelPixelScale; state it as others do, in its "
            f"folder with: {gdal_lines.make_translate_command(image.name, _scale_options(*third))}"
        )
    with np.errstate(over="ignore"):
        if (scale, offset) != (1.0, 0.0):
            grid *= scale
            grid += offset
        if unit != 1.0:
            grid *= unit
    if max(abs(scale), abs(offset)) * unit > 1e6:  # else no height leaves the range of numbers
        grid[~(np.abs(grid) < NO_HEIGHT)] = np.nan
    if (scale, offset, unit) == (1.0, 0.0, 1.0):
        return (), bool(name)
    return (f"The file states {name}heights of {scale:g} x value + {offset:g}, which is followed",), bool(name)


def _read_height_scale(tags: Tags) -> tuple[float, float] | None:
    """Read the scale and offset of the values, if tie point and pixel scale change heights."""
    third = float((*tags.get(33550, ()), 0.0, 0.0, 0.0)[2])
    _, _, from_z, _, _, to_z = (*tags.get(33922, ()), *(0.0,) * 6)[:6]
    if third not in (0.0, 1.0) or (third and (from_z or to_z)):
        return third, float(to_z) - float(from_z) * third
    return None


def _scale_options(scale: float, offset: float) -> str:
    """Return the options of ``gdal_translate`` that state heights of scale x value + offset."""
    return f"-a_scale {scale!r} -a_offset {offset!r}"


def read_metadata(image: Directory) -> dict[str, str]:
    """Read the entries of GDAL_METADATA about the first band, by role: 'scale', 'offset', 'unittype'."""
    text = _decode_text(image.tags.get(42112))
    if "<!" in text:  # entities, which no writer of metadata needs
        raise UnreadError(
            "has metadata that are not a plain list; drop them in its folder with: "
            + gdal_lines.make_translate_command(image.name)
        )
    if len(text) > _MAX_METADATA_BYTES:
        raise UnreadError(
            f"has {len(text) / 1e6:.1f} MB of metadata; drop everything except the scale in its folder with: "
            + gdal_lines.make_edit_command(image.name, "-unsetmd")
        )
    if not text:
        return {}
    return {
        item.get("role", ""): (item.text or "").strip()
        for item in parse_xml(text).iter("Item")
        if item.get("sample", "0") == "0"
    }


def read_scaling(image: Directory, items: Mapping[str, str]) -> tuple[float, float]:
    """Read the scale and offset of the values from the file's metadata. Raises UnreadError if they are not numbers, or
    if the scale is 0."""
    scale, offset = (
        _parse_finite(items.get(role, otherwise), role, image.name)
        for role, otherwise in (("scale", "1"), ("offset", "0"))
    )
    if scale == 0:
        raise UnreadError(
            "states a scale of 0 for its values, which makes it flat; state the right one, such as 1, "
            f"in its folder with: {gdal_lines.make_translate_command(image.name, _scale_options(1.0, offset))}"
        )
    return scale, offset


def _parse_finite(text: str, role: str, file: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UnreadError(
            f"states the {role} {text[:40]!r} for its values, which is not a number; state the right one "
            f"in its folder with: {gdal_lines.make_translate_command(file, _scale_options(1.0, 0.0))}"
        )
    return value


def _find_height_unit(
    keys: Mapping[int, Any], named: str, scaling: tuple[float, float], file: str
) -> tuple[float, str]:
    """Find the metres per unit of the heights, and the unit's name for a message; '' if the file states no unit.
    ``scaling`` is the scale and offset of the values, ``file`` the name for commands."""
    stated = {}
    if named:
        if named.lower() not in _METRES_PER_NAMED_UNIT:
            raise UnreadError(
                f"states its heights in {named[:40]!r}, an unknown unit; name the one that "
                f"they are in, such as m or ft, in its folder with: {gdal_lines.make_edit_command(file, '-units m')}"
            )
        stated[named] = _METRES_PER_NAMED_UNIT[named.lower()]
    code, system = keys.get(4099), keys.get(4096, 0)
    if system in _DEPTH_SYSTEMS:
        turned = _scale_options(-scaling[0], -scaling[1])
        raise UnreadError(
            f"holds depths (EPSG:{system}), which go down, not heights; change their sign and drop the "
            "vertical system in its folder with: "
            + gdal_lines.make_translate_command(file, turned, _flat_system_option(keys))
        )
    if code is None and system not in (0, _USER_DEFINED):
        code = VERTICAL.get(system, 0)
    if code == _USER_DEFINED:  # GeoTIFF has no key for the size of such a unit, so GDAL loses it too
        if not named:
            raise UnreadError(
                "states heights in a user-defined vertical system, whose unit a GeoTIFF cannot contain; state their "
                f"unit, such as m or ft, in its folder with: {gdal_lines.make_edit_command(file, '-units m')}"
            )
    elif code is not None:
        if code not in _METRES_PER_EPSG_UNIT:
            raise UnreadError(
                f"states heights by the vertical system {system} in the unit {code or 'of that system'}, "
                f"which are unknown; state it in its folder with: "
                f"{gdal_lines.make_translate_command(file, _STATE_UNITS_OPTION)}"
            )
        stated[f"EPSG unit {code}"] = _METRES_PER_EPSG_UNIT[code]
    _refuse_two_units(stated, file)
    return next(((value, f"({name}) ") for name, value in stated.items()), (1.0, ""))


def _refuse_two_units(stated: Mapping[str, float], file: str) -> None:
    """Raise UnreadError if the named units, given in metres, differ in size."""
    if len({round(value, 9) for value in stated.values()}) > 1:
        second = list(stated.values())[-1]
        same = next((name for name, metres in _METRES_PER_NAMED_UNIT.items() if math.isclose(metres, second)), "")
        raise UnreadError(
            f"states its heights in two units, {' and '.join(stated)}; "
            + (
                "if the second is right, state it twice in its folder with: "
                + gdal_lines.make_edit_command(file, f"-units {same}")
                if same
                else "write its heights in metres."
            )
        )


def find_coordinate_unit(keys: Mapping[int, Any], file: str, body_radius_m: float) -> tuple[float | None, str]:
    """Find the metres per unit of the file's coordinates, and the assumption behind them; or None and the reason why
    the unit is unknown."""
    model, system, code = keys.get(1024, 0), keys.get(3072), keys.get(3076)
    if model == _GEOGRAPHIC:
        radius = find_geographic_radius_m(keys)
        if radius is None:
            state = gdal_lines.make_translate_command(file, gdal_lines.make_sphere_option(body_radius_m))
            return None, (
                "has pixels of {size} degrees on a body whose radius it does not state"
                + (f"; state it in its folder with: {state}" if body_radius_m else "")
            )
        return math.radians(read_angle_unit(keys)) * radius, ""
    if model not in (0, _PROJECTED, _USER_DEFINED):
        return None, "has coordinates that do not belong to a map"
    if code == _USER_DEFINED:
        size = keys.get(3077, math.nan)
        if isinstance(size, float) and 0 < size < math.inf:
            return size, ""
        return None, "has pixels of {size} in a unit that it does not state"
    if code is not None and code in _METRES_PER_EPSG_UNIT:
        return _METRES_PER_EPSG_UNIT[code], ""
    if code:
        return None, "has pixels of {size} in the EPSG unit " + str(code) + ", which is unknown"
    if system in _SYSTEMS_IN_METRES or system in KNOWN_SYSTEMS:
        return 1.0, ""
    if system not in (None, 0, _USER_DEFINED):
        return None, (
            "has pixels of {size} in the unit of EPSG:" + str(system) + ", which is unknown; state it "
            "in its folder with: " + gdal_lines.make_translate_command(file, _STATE_UNITS_OPTION)
        )
    return 1.0, "it states no unit of length, so its coordinates were read as metres"


def read_placement(image: Directory, keys: Mapping[int, Any]) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Read the steps (east, north) per column and per row, which may be negative, and the coordinates of the centre of
    the south-western pixel. None if the file lacks them. Raises UnreadError for a rotated grid and for pixels of
    negative height."""
    tags, (rows, columns) = image.tags, image.shape
    if 33550 in tags:
        east, down = (float(v) for v in tags[33550][:2])
        if down < 0:
            raise UnreadError(
                "has pixels of a negative size from north to south, which programs read in two ways; "
                "write it as GDAL reads it, with its first row in the north, in its folder with: "
                + gdal_lines.make_translate_command(image.name)
            )
        north = -down
        column, row, _, x, y = (float(v) for v in tags.get(33922, (0.0,) * 6)[:5])
    elif 34264 in tags:
        m = [float(v) for v in tags[34264]]
        if max(abs(m[1] * rows), abs(m[4] * columns)) > _MAX_TURN_PX * min(abs(m[0]), abs(m[5])):
            raise UnreadError(
                "has a grid that is turned against north; turn it in its folder with: "
                + gdal_lines.make_warp_command(image.name)
            )
        east, north, column, row, x, y = m[0], m[5], 0.0, 0.0, m[3], m[7]
    else:
        return None
    if not (0 < abs(east) < math.inf and 0 < abs(north) < math.inf and math.isfinite(x) and math.isfinite(y)):
        return None
    centre = 0.0 if keys.get(1025) == _PIXEL_IS_POINT else 0.5  # else the place refers to a pixel's corner
    first = (x + (centre - column) * east, y + (centre - row) * north)
    last = (first[0] + (columns - 1) * east, first[1] + (rows - 1) * north)
    return (east, north), (min(first[0], last[0]), min(first[1], last[1]))

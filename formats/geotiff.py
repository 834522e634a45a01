"""Digital elevation models in GeoTIFF: heights and places in metres, north up, or a sentence that explains why not.

Blender's own loader turns whole numbers into fractions of their range and knows neither pixel size nor missing
values. Tags and keys: GeoTIFF 1.1 (OGC 19-008r4); GDAL_METADATA and GDAL_NODATA
(gdal.org/drivers/raster/gtiff.html); units and vertical systems: the EPSG registry (epsg.org).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.mesh.height_map import NO_HEIGHT
from ..support.foreign_bytes import ForeignBytes, parse_xml
from ..support.foreign_bytes import read as read_foreign
from .tiff import (
    FIX,
    KIND,
    MOST_BYTES,
    Directory,
    Tags,
    UnreadError,
    grant_memory,
    read_directories,
    read_pixels,
)

#: Metres per unit of length by its EPSG code.
_UNITS_M = {1025: 0.001, 1033: 0.01, 9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937, 9005: 0.3047972654, 9014: 1.8288,
            9030: 1852.0, 9031: 1.0000135965, 9036: 1000.0, 9093: 1609.344, 9096: 0.9144, 9097: 20.1168}
#: Metres per unit of length by the names that GDAL and others write into a band's unit.
_NAMED_M = {"m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "mm": 0.001, "cm": 0.01, "km": 1000.0,
            "kilometre": 1000.0, "kilometer": 1000.0, "ft": 0.3048, "foot": 0.3048, "feet": 0.3048,
            "us-ft": 1200 / 3937, "ftus": 1200 / 3937, "us survey foot": 1200 / 3937, "us survey feet": 1200 / 3937}
#: Map systems of Earth whose unit is the metre although a file may state their number only.
_METRIC = {3031, 3395, 3413, 3857, 3976, 3995, 32661, 32761, *range(25828, 25839), *range(26901, 26924),
           *range(32601, 32661), *range(32701, 32761)}
#: Vertical systems of Earth whose heights go up, and their unit, although a file may state their number only.
_VERTICAL = {
    **dict.fromkeys((3855, 5621, 5701, 5703, 5709, 5711, 5714, 5720, 5730, 5773, 5783, 5798, 6647, 7837), 9001),
    **dict.fromkeys((6130, 6131, 6132, 8050, 8228), 9002), **dict.fromkeys((5702, 6360, 8052, 10919), 9003)}
#: Vertical systems of Earth that count downwards.
_DEPTHS = {5336, 5612, 5614, 5706, 5715, 5734, 5739, 5789, 5831, *range(5861, 5868), 5873, 6357, 6358, 6359, 7976, 8051,
           8053, 8358, 8378, 8897, 9287, 9288, 9672, 10150, 10151, 10349, 10364, *range(10370, 10380),
           *range(10547, 10553), 10649, 10650, 10678}
#: GeoKeys: model, kind of raster, map system, unit, its size, vertical system, its unit.
_KEYS = {1024, 1025, 3072, 3076, 3077, 4096, 4099}
#: Bytes of GDAL's metadata; a list of some items has some hundreds.
_MOST_METADATA = 2**20
_PROJECTED, _GEOGRAPHIC, _USER_DEFINED = 1, 2, 32767
_POINT = 2  # value of GTRasterTypeGeoKey: coordinates are those of pixel centres
#: Most that a turned grid may be off over its whole length, in pixels, to be taken for one along the axes.
_SKEW_PX = 1e-3
_STATE_UNITS = "gdal_translate -co GEOTIFF_VERSION=1.0 in.tif out.tif"


@dataclass(frozen=True)
class GeoTiff:
    """Heights (rows, columns) float64 in metres, row 0 northernmost and column 0 westernmost, missing ones NaN.

    ``pixel_m`` is the size of a pixel (east, north) and ``corner_m`` the place of the centre of the lower
    left one, or None where the file does not state them in a unit of length; ``unplaced`` then is the reason,
    as the end of a sentence. ``report`` is what the file states of its heights, ``warnings`` what was assumed.
    """

    heights_m: np.ndarray
    pixel_m: tuple[float, float] | None
    corner_m: tuple[float, float] | None
    unplaced: str
    report: tuple[str, ...]
    warnings: tuple[str, ...]


def read(path: Path) -> GeoTiff:
    """Read a one-band elevation model. Raises IcyMoonError with the fix where it cannot be read."""
    return read_foreign(path, _read, KIND, f"copy it again or {FIX}", MOST_BYTES)


def _read(foreign: ForeignBytes) -> GeoTiff:
    grant_memory(foreign)
    images = read_directories(foreign)
    image = images[0]
    keys = _read_keys(image.tags)
    heights, number = read_pixels(foreign, image)
    warnings = _clear_missing(heights, number, image.tags.get(42113))
    warnings += _apply_mask(heights, foreign, images)
    report = _scale_to_metres(heights, image.tags, keys)
    place = _read_placement(image, keys)
    if place is None:
        return GeoTiff(heights, None, None, "does not state the size of its pixels", report, tuple(warnings))
    (east, north), corner = place
    heights = heights[::-1] if north > 0 else heights  # rows that go north
    heights = heights[:, ::-1] if east < 0 else heights
    unit, sentence = _unit(keys)
    if unit is None:
        size = f"{abs(east):g} x {abs(north):g}"
        return GeoTiff(heights, None, None, sentence.format(size=size), report, tuple(warnings))
    warnings += [sentence] if sentence else []
    return GeoTiff(heights, (abs(east) * unit, abs(north) * unit), (corner[0] * unit, corner[1] * unit), "", report,
                   tuple(warnings))


def _read_keys(tags: Tags) -> dict[int, Any]:
    """The GeoKeys that are used, by number: a whole number or a float. Raises ValueError for one that is text."""
    directory, doubles = tags.get(34735, ()), tags.get(34736, ())
    keys: dict[int, Any] = {}
    for k in range(4, len(directory) - 3, 4):
        key, where, _, value = directory[k:k + 4]
        if key in _KEYS and where not in (0, 34736):
            raise ValueError(f"GeoKey {key} is no number")
        if key in _KEYS:
            keys[key] = float(doubles[value]) if where else value
    return keys


def _clear_missing(grid: np.ndarray, number: np.dtype[Any], nodata: tuple[Any, ...] | None) -> list[str]:
    """Make NaN what the file calls missing and what no height can be; warnings."""
    grid[~(np.abs(grid) < NO_HEIGHT)] = np.nan
    text = _decode_text(nodata)
    if not text:
        return []
    try:
        value = float(text)
    except ValueError:
        return [f"its mark of missing heights, {text[:40]!r}, is no number, so none was taken for missing"]
    if math.isfinite(value) and abs(value) < NO_HEIGHT:
        # The text may state a number of the file's type with fewer digits than it has.
        with np.errstate(over="ignore", invalid="ignore"):
            slack = 2 * float(np.spacing(number.type(abs(value)))) if number.kind == "f" else 0.0
        grid[np.abs(grid - value) <= slack] = np.nan
    return []


def _apply_mask(grid: np.ndarray, foreign: ForeignBytes, images: list[Directory]) -> list[str]:
    """Make NaN what the file's own mask calls unknown; warnings about its other images."""
    others = [image for image in images[1:] if not image.is_reduced]
    masks = [image for image in others if image.is_mask and image.shape == grid.shape]
    for image in masks[:1]:
        grid[read_pixels(foreign, image)[0] == 0] = np.nan
    count = sum(not image.is_mask for image in others)
    return [f"it holds {count + 1} images, of which the first was read"] if count else []


def _decode_text(tag: tuple[Any, ...] | None) -> str:
    return b"".join(tag or ()).split(b"\0")[0].decode("utf-8", "replace").strip()


def _scale_to_metres(grid: np.ndarray, tags: Tags, keys: Mapping[int, Any]) -> tuple[str, ...]:
    """Turn the values into metres in place, by the scale, offset and unit that the file states; a report of it.

    Raises UnreadError if they are contradictory or of an unknown kind.
    """
    items = _read_metadata(tags)
    scale, offset = (_parse_finite(items.get(role, otherwise), role) for role,
                     otherwise in (("scale", "1"), ("offset", "0")))
    unit, name = _height_unit(keys, items.get("unittype", ""))
    if scale == 0:
        raise UnreadError("states a scale of 0 for its heights, which makes it flat; fix it with: gdal_edit -scale")
    if _is_scaled_by_third(tags):
        raise UnreadError(f"scales its heights by the third number of ModelPixelScale; {FIX}")
    with np.errstate(over="ignore"):
        if (scale, offset) != (1.0, 0.0):
            grid *= scale
            grid += offset
        if unit != 1.0:
            grid *= unit
    if max(abs(scale), abs(offset)) * unit > 1e6:  # else no height leaves the range of numbers
        grid[~(np.abs(grid) < NO_HEIGHT)] = np.nan
    if (scale, offset, unit) == (1.0, 0.0, 1.0):
        return ()
    return (f"The file states {name}heights of {scale:g} x value + {offset:g}, which is followed",)


def _is_scaled_by_third(tags: Tags) -> bool:
    """Whether the tie point and the pixel scale place heights elsewhere than at the values."""
    third = (*tags.get(33550, ()), 0.0, 0.0, 0.0)[2]
    _, _, from_z, _, _, to_z = (*tags.get(33922, ()), *(0.0,) * 6)[:6]
    return third not in (0.0, 1.0) or bool(third and (from_z or to_z))


def _read_metadata(tags: Tags) -> dict[str, str]:
    """What GDAL_METADATA states about the first band, by role: 'scale', 'offset', 'unittype'."""
    text = _decode_text(tags.get(42112))
    if "<!" in text or len(text) > _MOST_METADATA:  # entities, which no writer of metadata needs
        raise UnreadError(f"has metadata that are no plain list; {FIX}")
    if not text:
        return {}
    return {item.get("role", ""): (item.text or "").strip() for item in parse_xml(text).iter("Item")
            if item.get("sample", "0") == "0"}


def _parse_finite(text: str, role: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UnreadError(f"states the {role} {text[:40]!r} for its heights, which is no number; fix it with: "
                          f"gdal_edit -{role}")
    return value


def _height_unit(keys: Mapping[int, Any], named: str) -> tuple[float, str]:
    """Metres per unit of the heights, and their unit for a sentence, '' if the file states none."""
    stated = {}
    if named:
        if named.lower() not in _NAMED_M:
            raise UnreadError(f"states its heights in {named[:40]!r}, a unit that is not known here; write metres "
                              "into it with: gdal_edit -units m")
        stated[named] = _NAMED_M[named.lower()]
    code, system = keys.get(4099), keys.get(4096, 0)
    if system in _DEPTHS:
        raise UnreadError(f"holds depths (EPSG:{system}), which go down, not heights; turn their sign and drop the "
                          "vertical system with: gdal_calc -A in.tif --calc=-A --outfile=out.tif")
    if code is None and system not in (0, _USER_DEFINED):
        code = _VERTICAL.get(system, 0)
    if code is not None:
        if code not in _UNITS_M:
            raise UnreadError(f"states heights by the vertical system {system} in the unit {code or 'of that system'}, "
                              f"which are not known here; state it with: {_STATE_UNITS}")
        stated[f"EPSG unit {code}"] = _UNITS_M[code]
    if len({round(value, 9) for value in stated.values()}) > 1:
        raise UnreadError(f"states its heights in two units, {' and '.join(stated)}; fix it with: gdal_edit -units")
    return next(((value, f"({name}) ") for name, value in stated.items()), (1.0, ""))


def _unit(keys: Mapping[int, Any]) -> tuple[float | None, str]:
    """Metres per unit of the file's coordinates, and what was assumed; or None and why it is not known."""
    model, system, code = keys.get(1024, 0), keys.get(3072), keys.get(3076)
    if model == _GEOGRAPHIC:
        return None, "has pixels of {size} degrees (or another angle); project it with: gdalwarp -t_srs"
    if model not in (0, _PROJECTED, _USER_DEFINED):
        return None, "has coordinates that are no map's; project it with: gdalwarp -t_srs"
    if code == _USER_DEFINED:
        size = keys.get(3077, math.nan)
        if isinstance(size, float) and 0 < size < math.inf:
            return size, ""
        return None, "has pixels of {size} in a unit that it does not state"
    if code is not None and code in _UNITS_M:
        return _UNITS_M[code], ""
    if code:
        return None, "has pixels of {size} in the EPSG unit " + str(code) + ", which is not known here"
    if system in _METRIC:
        return 1.0, ""
    if system not in (None, 0, _USER_DEFINED):
        return None, ("has pixels of {size} in the unit of EPSG:" + str(system) + ", which is not known here; state it "
                      "with: " + _STATE_UNITS)
    return 1.0, "it states no unit of length, so its coordinates were taken for metres"


def _read_placement(image: Directory, keys: Mapping[int, Any]) -> tuple[tuple[float, float],
                                                                        tuple[float, float]] | None:
    """Step (east, north) per column and per row, either of which may be negative, and the coordinates of the centre
    of the lower left pixel as it lies on the ground; None if the file states none. Raises UnreadError if it is turned.
    """
    tags, (rows, columns) = image.tags, image.shape
    if 33550 in tags:
        east, down = (float(v) for v in tags[33550][:2])
        if down < 0:
            raise UnreadError("has pixels of a negative size from north to south, which programs read in two ways; "
                              "turn it with: gdalwarp in.tif out.tif")
        north = -down
        column, row, _, x, y = (float(v) for v in tags.get(33922, (0.0,) * 6)[:5])
    elif 34264 in tags:
        m = [float(v) for v in tags[34264]]
        if max(abs(m[1] * rows), abs(m[4] * columns)) > _SKEW_PX * min(abs(m[0]), abs(m[5])):
            raise UnreadError("has a grid that is turned against north; turn it with: gdalwarp in.tif out.tif")
        east, north, column, row, x, y = m[0], m[5], 0.0, 0.0, m[3], m[7]
    else:
        return None
    if not (0 < abs(east) < math.inf and 0 < abs(north) < math.inf and math.isfinite(x) and math.isfinite(y)):
        return None
    centre = 0.0 if keys.get(1025) == _POINT else 0.5  # else the place is that of a pixel's corner
    first = (x + (centre - column) * east, y + (centre - row) * north)
    last = (first[0] + (columns - 1) * east, first[1] + (rows - 1) * north)
    return (east, north), (min(first[0], last[0]), min(first[1], last[1]))

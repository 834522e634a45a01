"""Files beside a height map that state its place or the meaning of its numbers, as GDAL and ESRI's programs write them.

Their content is not used. Sentences name the facts that only these files state, with the command that writes the facts
into a GeoTIFF. World files contain six numbers (gdal.org/drivers/raster/wld.html), the others XML
(gdal.org/user/raster_data_model.html).
"""

from __future__ import annotations

from pathlib import Path

from ..support.errors import IcyMoonError
from ..support.foreign_bytes import read
from . import gdal_lines

#: Why a file without a step from pixel to pixel has no place, as the end of a sentence.
NO_PIXEL_SIZE = "does not state the size of its pixels"
#: Suffixes of world files by the suffix of the map.
_WORLD_SUFFIXES = {
    ".tif": (".tfw", ".tifw", ".wld"),
    ".tiff": (".tfw", ".tiffw", ".wld"),
    ".png": (".pgw", ".pngw", ".wld"),
}
#: Elements of the XML that change the place or the meaning of heights; most such files have only statistics.
_PLACING_ELEMENTS = {
    "GeoTransform": "its place",
    "SRS": "its map system",
    "NoDataValue": "which heights are missing",
    "Scale": "the scale of its heights",
    "Offset": "their offset",
    "UnitType": "their unit",
}
_MAX_BYTES = 2**24


def why_unplaced(path: Path) -> str:
    """Return the end of a sentence on a map without a position: the file has none, and world files are not read."""
    world = _find_world_file(path)
    return NO_PIXEL_SIZE + (f", and {world.name} beside it {_not_read_text(path)}" if world else "")


def describe_world_file(path: Path) -> list[str]:
    """Describe, as a clause, the world file of a map without a position; empty without a world file."""
    world = _find_world_file(path)
    return [f"{world.name} beside it, which states its place, {_not_read_text(path)}"] if world else []


def describe_gdal_notes(path: Path) -> list[str]:
    """Describe, as a clause, the facts that GDAL's notes beside a map state; empty without notes."""
    notes = path.with_name(f"{path.name}.aux.xml")
    if not notes.is_file():
        return []
    try:
        text = read(notes, lambda foreign: foreign.text(), "notes of GDAL", "remove it", _MAX_BYTES)
    except IcyMoonError:
        return [f"{notes.name} beside it cannot be read; look whether it states the place of the map"]
    # An element's name ends with its bracket or with a space before its first attribute.
    names = {name for part in text.split("<")[1:] for name in part.split(">", 1)[0].split(maxsplit=1)[:1]}
    stated = [words for name, words in _PLACING_ELEMENTS.items() if name in names]
    return [f"{notes.name} beside it, which states {', '.join(stated)}, {_not_read_text(path)}"] if stated else []


def _find_world_file(path: Path) -> Path | None:
    suffixes = _WORLD_SUFFIXES.get(path.suffix.lower(), ())
    names = (path.with_suffix(each) for lower in suffixes for each in (lower, lower.upper()))
    return next((name for name in names if name.is_file()), None)


def _not_read_text(path: Path) -> str:
    return (
        "is not read; write its numbers into a GeoTIFF, in its folder with: "
        f"{gdal_lines.make_translate_command(path.name)}"
    )

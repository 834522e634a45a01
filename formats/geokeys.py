"""GeoKeys as a file stores them: three tags that state the coordinate system of a GeoTIFF (OGC 19-008r4).

Files that are written in the system of another file copy them, so that every reader takes both for one system.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .tiff import Tags

_DIRECTORY, _DOUBLES, _TEXT = 34735, 34736, 34737
#: Largest number of numbers or letters of the tags that is kept; a system has some hundreds.
_MOST, _MAX_LETTERS = 4096, 2**16
#: Keys that are not copied because the copy states its own: kind of raster, and vertical system with name, datum and
#: unit.
_RASTER_TYPE, _OF_HEIGHTS, _VERTICAL_UNIT, _METRE = 1025, (4096, 4097, 4098, 4099), 4099, 9001
_LARGEST_SHORT = 65535
#: Vertical systems of Earth whose heights go up, and their unit, although a file may state their number only.
VERTICAL = {
    **dict.fromkeys((3855, 5621, 5701, 5703, 5709, 5711, 5714, 5720, 5730, 5773, 5783, 5798, 6647, 7837), 9001),
    **dict.fromkeys((6130, 6131, 6132, 8050, 8228), 9002),
    **dict.fromkeys((5702, 6360, 8052, 10919), 9003),
}


@dataclass(frozen=True)
class GeoKeys:
    """The tags of GeoKeys: directory, floating-point numbers and texts."""

    directory: tuple[int, ...]
    doubles: tuple[float, ...] = ()
    text: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the keys as JSON for ``pair.json`` and exports. Each list of numbers is one string, to stay on one
        line."""
        return {
            "directory": " ".join(map(str, self.directory)),
            "doubles": " ".join(map(repr, self.doubles)),
            "text": self.text,
        }

    def numbers(self) -> dict[int, Any]:
        """Return the keys that are numbers."""
        wanted = {
            self.directory[k] for k in range(4, len(self.directory) - 3, 4) if self.directory[k + 1] in (0, _DOUBLES)
        }
        return read_numbers(self.directory, self.doubles, wanted)

    def for_areas_in_metres(self) -> GeoKeys:
        """Return the keys for values that are means of areas, and for heights in metres above the zero of the same
        system.

        A vertical system with another unit is left out, because the heights are in metres.
        """
        entries = [tuple(self.directory[k : k + 4]) for k in range(4, len(self.directory) - 3, 4)]
        stated = {entry[0]: entry[3] for entry in entries if entry[1] == 0}
        unit = stated.get(_VERTICAL_UNIT, VERTICAL.get(stated.get(_OF_HEIGHTS[0], 0), _METRE))
        dropped = {_RASTER_TYPE, *(_OF_HEIGHTS if unit != _METRE else ())}
        kept = [entry for entry in entries if entry[0] not in dropped and entry[1] != _DIRECTORY]
        kept = sorted([*kept, (_RASTER_TYPE, 0, 1, 1)])
        return GeoKeys(
            (*self.directory[:3], len(kept), *(number for entry in kept for number in entry)), self.doubles, self.text
        )


def make_geokeys(tags: Tags) -> GeoKeys | None:
    """Make the GeoKeys of a file; None if it has none, or more than a system needs."""
    directory, doubles = tags.get(_DIRECTORY, ()), tags.get(_DOUBLES, ())
    text = b"".join(tags.get(_TEXT, ()))
    if len(directory) < 8 or max(len(directory), len(doubles), len(text)) > _MOST:
        return None
    return GeoKeys(
        tuple(map(int, directory)), tuple(map(float, doubles)), text.rstrip(b"\0").decode("ascii", "replace")
    )


def read_numbers(directory: Sequence[Any], doubles: Sequence[Any], wanted: Collection[int]) -> dict[int, Any]:
    """Read the ``wanted`` keys by number: whole numbers or floats. Raises ValueError if a key is text."""
    keys: dict[int, Any] = {}
    for k in range(4, len(directory) - 3, 4):
        key, where, _, value = directory[k : k + 4]
        if key in wanted and where not in (0, _DOUBLES):
            raise ValueError(f"GeoKey {key} is not a number")
        if key in wanted:
            keys[key] = float(doubles[value]) if where else value
    return keys


def geokeys_from_json(stated: object) -> GeoKeys | None:
    """Parse the GeoKeys of a ``pair.json``; None if they are missing or malformed."""
    texts = [stated.get(key) for key in ("directory", "doubles", "text")] if isinstance(stated, Mapping) else []
    known = [each for each in texts if isinstance(each, str) and len(each) <= _MAX_LETTERS]
    if len(known) != 3:
        return None
    try:
        directory, doubles = tuple(map(int, known[0].split())), tuple(map(float, known[1].split()))
    except ValueError:
        return None
    whole = all(0 <= each <= _LARGEST_SHORT for each in directory) and all(map(math.isfinite, doubles))
    if not (whole and 8 <= len(directory) <= _MOST and len(doubles) <= _MOST and known[2].isascii()):
        return None
    inside = all(
        directory[k + 1] != _DOUBLES or directory[k + 3] < len(doubles) for k in range(4, len(directory) - 3, 4)
    )
    return GeoKeys(directory, doubles, known[2]) if inside else None

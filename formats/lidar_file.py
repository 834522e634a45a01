"""A laser scanner in a TOML file: a ``[lidar]`` table with the figures of its data sheet, and their sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.lidar.beam import FWHM_PER_HALF_ANGLE
from ..physics.lidar.instrument import Instrument
from ..physics.lidar.returns import Reported
from ..physics.lidar.scan_patterns import ScanPattern
from ..support.errors import IcyMoonError
from ..support.file_schemas import COUNT, NUMBER, POSITIVE, TABLE, TEXT, Each, Kind, Maybe, check_record
from ..support.files import quote
from ..support.foreign_bytes import ForeignBytes, parse_toml, read
from ..support.suggestions import suggest_nearest

#: Bytes of the file at most.
_MOST_BYTES = 2**18
_FIX = "correct the file, or take a shipped one of icymoon lidar --help"
_PATTERNS = ("SPINNING", "RASTER", "FLASH")
_REPORTED = ("ALL", "FIRST", "STRONGEST", "LAST")
_AIMS = ("CAMERA", "LEVEL")


def _one_of(*names: str) -> Kind:
    return Kind(f"one of {', '.join(names)}", lambda value: value in names)


_LIDAR_SHAPE: dict[str, Any] = {
    "title": Maybe(TEXT),
    "pattern": _one_of(*_PATTERNS),
    "rows": COUNT,
    "columns": COUNT,
    "width_deg": NUMBER,
    "height_deg": NUMBER,
    "elevation_deg": Maybe(NUMBER),
    "period_s": Maybe(NUMBER),
    "pulse_uj": NUMBER,
    "wavelength_nm": POSITIVE,
    "fwhm_deg": Each(NUMBER),
    "exit_mm": Maybe(NUMBER),
    "aperture_mm": NUMBER,
    "field_mrad": Maybe(NUMBER),
    "separation_mm": Maybe(NUMBER),
    "efficiency": Maybe(NUMBER),
    "nearest_m": Maybe(NUMBER),
    "farthest_m": Maybe(NUMBER),
    "gate_m": Maybe(NUMBER),
    "rays": Maybe(COUNT),
    "returns": Maybe(_one_of(*_REPORTED)),
    "aim": Maybe(_one_of(*_AIMS)),
}
_SHAPE: dict[str, Any] = {"lidar": _LIDAR_SHAPE, "sources": Maybe(Each(TEXT, TEXT))}


@dataclass(frozen=True)
class LidarFile:
    """A laser scanner, its title, and where it looks unless a pose is stated: along the cameras (CAMERA), or level
    along their heading (LEVEL)."""

    title: str
    instrument: Instrument
    aim: str


def read_lidar(path: Path) -> LidarFile:
    """Read a laser scanner. Raises IcyMoonError, one sentence with a fix."""
    text = read(path, ForeignBytes.text, "a laser scanner", _FIX, _MOST_BYTES)
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise IcyMoonError(f"{path}: is not a TOML file that can be read ({error}); {_FIX}.") from None
    return parse_lidar(data, path)


def parse_lidar(data: Mapping[str, Any], path: Path) -> LidarFile:
    """The laser scanner of the content of a file. Raises IcyMoonError as ``read_lidar``."""
    check_record(dict(data), {"lidar": TABLE}, path, _FIX)
    for known, there, name in ((_SHAPE, data, ""), (_LIDAR_SHAPE, data["lidar"], "lidar.")):
        for key in there:
            if key not in known:
                raise IcyMoonError(f"{path}: unknown key {name}{quote(key)}, {suggest_nearest(key, known, 0.4)}")
    check_record(dict(data), _SHAPE, path, _FIX)
    values = data["lidar"]
    if len(values["fwhm_deg"]) != 2:
        raise IcyMoonError(
            f"{path}: lidar.fwhm_deg has {len(values['fwhm_deg'])} numbers; give two, along the rows first."
        )
    try:
        return LidarFile(values.get("title", path.stem), _make_instrument(values), values.get("aim", "CAMERA"))
    except IcyMoonError as error:
        raise IcyMoonError(f"{path}: {error}") from None


def _make_instrument(values: Mapping[str, Any]) -> Instrument:
    half_angles = tuple(float(np.radians(width)) / FWHM_PER_HALF_ANGLE for width in values["fwhm_deg"])
    field_mrad = values.get("field_mrad")
    return Instrument(
        ScanPattern(
            values["pattern"],
            values["rows"],
            values["columns"],
            values["width_deg"],
            values["height_deg"],
            values.get("elevation_deg", 0.0),
            values.get("period_s", 0.1),
        ),
        values["pulse_uj"] * 1e-6,
        (half_angles[0], half_angles[1]),
        values["aperture_mm"] * 0.5e-3,
        values["wavelength_nm"] * 1e-9,
        values.get("exit_mm", 0.0) * 0.5e-3,
        np.pi / 2 if field_mrad is None else field_mrad * 0.5e-3,
        values.get("separation_mm", 0.0) * 1e-3,
        values.get("efficiency", 1.0),
        values.get("nearest_m", 0.0),
        values.get("farthest_m", np.inf),
        values.get("gate_m", 0.15),
        values.get("rays", 20),
        values.get("returns", "ALL"),
    )


def change_lidar(
    lidar: LidarFile, rows: int | None, columns: int | None, rays: int | None, returns: Reported | None
) -> LidarFile:
    """The scanner with another number of beams, of rays of a beam, or other returns; None leaves what it has."""
    own = lidar.instrument
    pattern = replace(
        own.pattern,
        rows=own.pattern.rows if rows is None else rows,
        columns=own.pattern.columns if columns is None else columns,
    )
    changed = replace(
        own,
        pattern=pattern,
        sub_rays=own.sub_rays if rays is None else rays,
        reported=own.reported if returns is None else returns,
    )
    return replace(lidar, instrument=changed)

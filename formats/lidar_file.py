"""A laser scanner in a TOML file: a ``[lidar]`` table with the figures of its data sheet, and their sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.lidar.apd import Apd
from ..physics.lidar.beam import FWHM_PER_HALF_ANGLE
from ..physics.lidar.instrument import Instrument
from ..physics.lidar.measured_returns import AnalogReceiver, Measurement, PhotonCounter, Sensing
from ..physics.lidar.returns import Reported
from ..physics.lidar.scan_patterns import ScanPattern
from ..support.errors import IcyMoonError
from ..support.file_schemas import COUNT, FLAG, NUMBER, POSITIVE, TABLE, TEXT, Each, Kind, Maybe, check_record
from ..support.files import quote
from ..support.foreign_bytes import ForeignBytes, parse_toml, read
from ..support.suggestions import suggest_nearest

#: Largest file in bytes.
_MAX_BYTES = 2**18
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
    "pulse_ns": Maybe(NUMBER),
}
#: Keys of ``[detector]`` for both kinds, and for each.
_DETECTOR_SHAPE: dict[str, Any] = {
    "kind": _one_of("APD", "SPAD"),
    "efficiency": Maybe(NUMBER),
    "jitter_ps": Maybe(NUMBER),
    "resolution_mm": Maybe(NUMBER),
    "filter_nm": Maybe(POSITIVE),
}
_SHAPE_BY_KIND: dict[str, dict[str, Any]] = {
    "APD": {
        "gain": Maybe(NUMBER),
        "ionisation_ratio": Maybe(NUMBER),
        "bandwidth_mhz": Maybe(NUMBER),
        "dark_na": Maybe(NUMBER),
        "load_ohm": Maybe(NUMBER),
        "threshold_snr": Maybe(POSITIVE),
        "timing": Maybe(_one_of("EDGE", "CENTROID")),
        "saturation_electrons": Maybe(POSITIVE),
        "corrects_walk": Maybe(FLAG),
    },
    "SPAD": {"dark_khz": Maybe(NUMBER)},
}
_SHAPE: dict[str, Any] = {"lidar": _LIDAR_SHAPE, "sources": Maybe(Each(TEXT, TEXT)), "detector": Maybe(TABLE)}


@dataclass(frozen=True)
class LidarFile:
    """A laser scanner with its title. If no pose is stated, ``aim`` is its direction: along the cameras (CAMERA), or
    level along their heading (LEVEL). ``detector`` is None for a scanner without a detector. ``filter_nm`` is the width
    of the filter before it (0: not stated)."""

    title: str
    instrument: Instrument
    aim: str
    detector: AnalogReceiver | PhotonCounter | None = None
    filter_nm: float = 0.0


def read_lidar(path: Path) -> LidarFile:
    """Read a laser scanner. Raises IcyMoonError, one sentence with a fix."""
    text = read(path, ForeignBytes.text, "a laser scanner", _FIX, _MAX_BYTES)
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise IcyMoonError(f"{path}: is not a TOML file that can be read ({error}); {_FIX}.") from None
    return parse_lidar(data, path)


def parse_lidar(data: Mapping[str, Any], path: Path) -> LidarFile:
    """Parse a laser scanner from the content of a file. Raises IcyMoonError as ``read_lidar`` does."""
    check_record(dict(data), {"lidar": TABLE}, path, _FIX)
    _refuse_unknown(data, _SHAPE, "", path)
    _refuse_unknown(data["lidar"], _LIDAR_SHAPE, "lidar.", path)
    check_record(dict(data), _SHAPE, path, _FIX)
    detector = data.get("detector")
    if detector is not None:
        check_record(dict(data), {"detector": {"kind": _DETECTOR_SHAPE["kind"]}}, path, _FIX)
        shape = _DETECTOR_SHAPE | _SHAPE_BY_KIND[detector["kind"]]
        _refuse_unknown(detector, shape, "detector.", path)
        check_record(dict(data), {"detector": shape}, path, _FIX)
    values = data["lidar"]
    if len(values["fwhm_deg"]) != 2:
        raise IcyMoonError(
            f"{path}: lidar.fwhm_deg has {len(values['fwhm_deg'])} numbers; give two, along the rows first."
        )
    try:
        instrument = _make_instrument(values)
        made = None if detector is None else _make_detector(detector)
        if made is not None:
            Measurement(instrument, Sensing({}, made))
            if isinstance(made, AnalogReceiver):
                made.make_detector(instrument)
    except IcyMoonError as error:
        raise IcyMoonError(f"{path}: {error}") from None
    filter_nm = 0.0 if detector is None else detector.get("filter_nm", 0.0)
    return LidarFile(values.get("title", path.stem), instrument, values.get("aim", "CAMERA"), made, filter_nm)


def _refuse_unknown(there: Mapping[str, Any], known: Mapping[str, Any], name: str, path: Path) -> None:
    for key in there:
        if key not in known:
            raise IcyMoonError(f"{path}: unknown key {name}{quote(key)}, {suggest_nearest(key, known, 0.4)}")


def _make_detector(values: Mapping[str, Any]) -> AnalogReceiver | PhotonCounter:
    jitter_s, resolution_m = values.get("jitter_ps", 0.0) * 1e-12, values.get("resolution_mm", 0.0) * 1e-3
    if values["kind"] == "SPAD":
        return PhotonCounter(values.get("efficiency", 0.3), values.get("dark_khz", 10.0) * 1e3, jitter_s, resolution_m)
    apd = Apd(
        values.get("gain", 100.0),
        values.get("ionisation_ratio", 0.02),
        values.get("efficiency", 0.7),
        values.get("bandwidth_mhz", 200.0) * 1e6,
        values.get("dark_na", 0.05) * 1e-9,
        values.get("load_ohm", 1e4),
    )
    return AnalogReceiver(
        apd,
        values.get("threshold_snr", 6.0),
        values.get("timing", "EDGE"),
        jitter_s,
        resolution_m,
        values.get("saturation_electrons", np.inf),
        values.get("corrects_walk", True),
    )


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
        values.get("pulse_ns", 1.0) * 1e-9,
    )


def change_lidar(
    lidar: LidarFile, rows: int | None, columns: int | None, rays: int | None, returns: Reported | None
) -> LidarFile:
    """Change the number of rows, columns or rays per beam of a scanner, or the returns that it reports; None keeps a
    value."""
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

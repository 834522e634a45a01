"""Writes scans of laser scanners for other programs: PLY, LAS and LAZ, and bags of ROS 2, in parts of bounded memory.

A point is where the instrument puts a return: at the measured range of a scan with a detector, along the beam's axis.
Lost returns have no point. False alarms are points without a label, with the return number 0.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.lidar_points import find_cells, read_returns
from ...formats.map_frame import MapFrame, map_frame_from_json
from ...formats.ply import write_cloud_parts
from ...formats.wave_packets import FACTS_SHAPE, HEADER_BYTES, check_packets, count_packet_bytes
from ...physics.camera.rotations import quaternion
from ...physics.lidar.digitiser import Waves
from ...physics.lidar.scan_patterns import PatternKind, ScanPattern
from ...physics.light.photons import LIGHT_M_S, PLANCK_J_S
from ...render.pairs.dataset_file_names import is_regular_file
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import COUNT, MATRIX, NUMBER, TEXT, Each, Maybe, read_record
from ...support.files import write_atomically
from ...support.system import remove

#: File of each format, beside the scan's own files.
FILES = {"ply": "lidar.ply", "las": "lidar.las", "laz": "lidar.laz", "ros2": "lidar_bag"}
_FIX = "scan the scene again"
_FACTS_SHAPE = {
    "pattern": TEXT,
    "rows": COUNT,
    "columns": COUNT,
    "period_s": NUMBER,
    "wavelength_nm": NUMBER,
    "position_m": Each(NUMBER),
    "sensor_to_world": MATRIX,
    "returns": COUNT,
    "beams": COUNT,
    "beams_without_return": COUNT,
    "lost_returns": Maybe(COUNT),
    "false_alarms": Maybe(COUNT),
    "waveforms": Maybe(FACTS_SHAPE),
}
_RETURN_NAMES = (
    "beam",
    "order",
    "of",
    "range_m",
    "energy_j",
    "point_m",
    "true_range_m",
    "label",
    "number",
    "row",
    "time_s",
)
#: Arrays of scans with a detector or ice.
_SENSED_NAMES = ("measured_range_m", "measured_electrons", "ice_delay_m", "ice_edge_m")
_ALARM_NAMES = ("false_beam", "false_range_m", "false_point_m")
#: Arrays of scans with waveforms.
_WAVE_NAMES = tuple(each.name for each in fields(Waves))
#: Step of LAS coordinates in metres; 32 bits of them reach 214 km.
_LAS_STEP_M = 1e-4
#: Most points of a message, about 40 MB.
_POINTS_A_MESSAGE = 10**6
_NS_PER_S = 1_000_000_000
#: Round-trip time of light for a metre of range, in picoseconds.
_PS_PER_M = 2e12 / LIGHT_M_S
#: Record number of the first Waveform Packet Descriptor of LAS.
_FIRST_DESCRIPTOR = 100


@dataclass(frozen=True)
class ScanPoints:
    """Points (k,) of a scan.

    ``point_m`` (k, 3) is in the site's axes. ``range_m`` is the measured range, ``error_m`` its error, NaN for a false
    alarm. ``energy_j`` is the light that came back, ``light`` its number of electrons or photons. ``order`` and ``of``
    are the return number and the number of returns, ``label`` and ``number`` the label and the instance, ``row`` the
    row of the beam, ``time_s`` the time after the scan began, ``ice_m`` the delay in ice. ``waves`` are the points'
    places in the waveforms, if the scan has any.
    """

    point_m: Array
    range_m: Array
    error_m: Array
    energy_j: Array
    light: Array
    order: Array
    of: Array
    label: Array
    number: Array
    row: Array
    time_s: Array
    ice_m: Array
    waves: Waves | None = field(default=None, kw_only=True)

    def __len__(self) -> int:
        return len(self.range_m)


def read_facts(folder: Path) -> dict[str, Any]:
    """Read the ``lidar.json`` of a scan. Raises IcyMoonError if it is missing or damaged."""
    try:
        return dict(read_record(folder / "lidar.json", _FACTS_SHAPE, _FIX))
    except FileNotFoundError:
        raise IcyMoonError(f"{folder / 'lidar.json'} is missing; {_FIX}.") from None


def count_points(facts: Mapping[str, Any]) -> int:
    """Return the number of points of a scan."""
    return int(facts["returns"] - (facts.get("lost_returns") or 0) + (facts.get("false_alarms") or 0))


def read_points(folder: Path, facts: Mapping[str, Any]) -> Iterator[ScanPoints]:
    """Yield the points of a scan in parts: the returns in the order of their beams, then the false alarms.

    Raises IcyMoonError if the file of the scan is damaged.
    """
    path, position = folder / "lidar.npz", np.array(facts["position_m"])
    photons_1_j = facts["wavelength_nm"] * 1e-9 / (PLANCK_J_S * LIGHT_M_S)
    waves = _WAVE_NAMES if facts.get("waveforms") else ()
    for part in read_returns(path, (*_RETURN_NAMES, *_SENSED_NAMES, *waves)):
        _refuse_missing(path, part, (*_RETURN_NAMES, *waves))
        range_m = part.get("measured_range_m", part["range_m"])
        kept = np.isfinite(range_m)
        with np.errstate(invalid="ignore"):
            along = (range_m / part["range_m"])[:, None]
        point = part["point_m"] if "measured_range_m" not in part else position + (part["point_m"] - position) * along
        yield ScanPoints(
            point[kept],
            range_m[kept],
            (range_m - part["true_range_m"])[kept],
            part["energy_j"][kept],
            part.get("measured_electrons", part["energy_j"] * photons_1_j)[kept],
            part["order"][kept],
            part["of"][kept],
            part["label"][kept],
            part["number"][kept],
            part["row"][kept],
            part["time_s"][kept],
            part.get("ice_delay_m", part.get("ice_edge_m", np.zeros(len(kept))))[kept],
            waves=_find_waves(part, facts, kept),
        )
    names = (*_ALARM_NAMES, *(f"false_{name}" for name in waves))
    for part in read_returns(path, names):
        _refuse_missing(path, part, names)
        yield _make_alarm_points(part, facts)


def _refuse_missing(path: Path, part: Mapping[str, Array], names: Collection[str]) -> None:
    if missing := [name for name in names if name not in part]:
        raise IcyMoonError(f"{path} lacks {missing[0]}; {_FIX}.")


def _find_waves(
    part: Mapping[str, Array], facts: Mapping[str, Any], kept: Array | slice, start: str = ""
) -> Waves | None:
    """Return the indices of the kept points' waveforms, from the arrays whose names begin with ``start``.

    None without waveforms. Raises IcyMoonError for an index beyond the waveforms.
    """
    stated = facts.get("waveforms")
    if not stated:
        return None
    waves = Waves(*(part[start + name][kept] for name in _WAVE_NAMES))
    for values, most in ((waves.packet, stated["packets"]), (waves.packet_gain, stated["gains"])):
        if not ((values >= 0) & (values < most)).all():
            raise IcyMoonError(f"lidar.npz has points beyond the waveforms that lidar.json states; {_FIX}.")
    return waves


def _make_alarm_points(part: Mapping[str, Array], facts: Mapping[str, Any]) -> ScanPoints:
    """Make the points of false alarms."""
    pattern = ScanPattern(_check_kind(facts), facts["rows"], facts["columns"], 0, 0, 0, facts["period_s"])
    row, _, time_s = find_cells(part["false_beam"], pattern)
    count = len(row)
    none, zero = np.zeros(count), np.zeros(count, np.uint8)
    number, unknown = np.zeros(count, np.int64), np.full(count, np.nan)
    return ScanPoints(
        part["false_point_m"],
        part["false_range_m"],
        unknown,
        none,
        none,
        zero,
        zero,
        zero,
        number,
        row,
        time_s,
        none,
        waves=_find_waves(part, facts, slice(None), "false_"),
    )


def _check_kind(facts: Mapping[str, Any]) -> PatternKind:
    for kind in ("SPINNING", "RASTER", "FLASH"):
        if facts["pattern"] == kind:
            return kind
    raise IcyMoonError(f"lidar.json has the pattern {str(facts['pattern'])[:40]!r}, which no scanner has; {_FIX}.")


def write_scan(folder: Path, kind: str) -> Path:
    """Write the points of the scan in a folder as ``kind``, one of ``FILES``, and return the file's path.

    Raises IcyMoonError if a package is missing, or if the disk refuses.
    """
    facts = read_facts(folder)
    write = {"ply": _write_ply, "las": _write_las, "laz": _write_las, "ros2": _write_bag}[kind]
    write(folder / FILES[kind], folder, facts)
    return folder / FILES[kind]


def discard_points(folder: Path, kinds: Collection[str]) -> None:
    """Remove the points of an earlier scan in a folder, before another scan writes ``kinds`` of files there.

    Raises IcyMoonError if one of them is an existing bag, because bags are not overwritten.
    """
    if "ros2" in kinds and (folder / FILES["ros2"]).exists():
        bag = folder / FILES["ros2"]
        raise IcyMoonError(f"{bag} exists already, and a bag is not written over; remove it or choose another folder.")
    for kind in ("ply", "las", "laz"):
        if is_regular_file(folder / FILES[kind]):
            remove(folder / FILES[kind])


def check_format(kind: str) -> str:
    """Return in a sentence why a format cannot be written in this Python; empty if it can."""
    needed = {"las": ("laspy",), "laz": ("laspy", "lazrs")}.get(kind, ())
    for name in needed:
        if importlib.util.find_spec(name) is None:
            return f'{kind.upper()} files need the package {name}; pip install "icymoon[las]".'
    if kind == "ros2":
        from .bag_file import check

        return check()
    return ""


def _write_ply(path: Path, folder: Path, facts: Mapping[str, Any]) -> None:
    names = ["x", "y", "z", "energy_j", "range_m", "range_error_m", "return_number", "label", "instance"]
    measured = facts.get("lost_returns") is not None
    names += ["electrons", "ice_delay_m"] if measured else []

    def list_parts() -> Iterator[Array]:
        for part in read_points(folder, facts):
            columns = [part.point_m, part.energy_j, part.range_m, part.error_m, part.order, part.label, part.number]
            yield np.column_stack(columns + ([part.light, part.ice_m] if measured else []))

    comment = "Icy Moon: range_error_m is measured minus true range"
    write_cloud_parts(path, tuple(names), list_parts(), count_points(facts), (comment,))


def _write_las(path: Path, folder: Path, facts: Mapping[str, Any]) -> None:
    """Write LAS 1.4 with points of format 6, or 9 with waveforms. The suffix .laz compresses the file."""
    import laspy

    waveforms = facts.get("waveforms")
    frame = map_frame_from_json(facts.get("site"))
    header = _make_header(laspy, facts, frame)
    if waveforms:
        check_packets(folder, waveforms)
        header.global_encoding.waveform_data_packets_external = True
        header.vlrs.extend(_describe_packets(waveforms))
    position_m = np.array(facts["position_m"])

    def write(part_path: Path) -> None:
        packed = path.suffix == ".laz"
        with part_path.open("wb") as stream, laspy.LasWriter(stream, header, packed, closefd=False) as out:
            for part in read_points(folder, facts):
                if len(part):
                    record = _make_records(laspy, header, part, _to_map(part.point_m, frame))
                    if waveforms:
                        _set_waves(record, part, waveforms, frame, position_m)
                    out.write_points(record)

    write_atomically(path, write)


def _make_header(laspy: Any, facts: Mapping[str, Any], frame: MapFrame | None) -> Any:
    """Make the header of a LAS file: point format, coordinates, extra dimensions and position on a map."""
    site = facts.get("site")
    header = laspy.LasHeader(point_format=9 if facts.get("waveforms") else 6, version="1.4")
    header.generating_software = "Icy Moon"
    header.global_encoding.wkt = True  # LAS 1.4 demands it of records from 6 on, with or without a WKT
    header.system_identifier = str(facts.get("title", ""))[:31].encode("ascii", "replace").decode()
    header.offsets = np.floor(_to_map(np.array([facts["position_m"]]), frame)[0])
    unit_m = 1.0 if frame is None else frame.unit_m
    header.scales = np.array([_LAS_STEP_M / unit_m, _LAS_STEP_M / unit_m, _LAS_STEP_M])
    extra = ("range_m", "range_error_m", "energy_j", "electrons", "ice_delay_m")
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, "f8") for name in extra] + [laspy.ExtraBytesParams("instance", "i8")]
    )
    if frame is not None and site is not None:
        text = json.dumps(site["map"]).encode()
        header.vlrs.append(laspy.VLR("icymoon", 1, "place of the site on a map", text[:65535]))
    return header


def _describe_packets(waveforms: Mapping[str, Any]) -> list[Any]:
    """Make the Waveform Packet Descriptors of LAS, one for each gain. LAS's volts are electrons in an interval here."""
    from laspy.vlrs.known import WaveformPacketStruct, WaveformPacketVlr

    found = []
    for gain in range(waveforms["gains"]):
        step = math.ldexp(waveforms["step_electrons"], gain)
        vlr = WaveformPacketVlr(_FIRST_DESCRIPTOR + gain, "electrons in an interval")
        vlr.parsed_record = WaveformPacketStruct(
            waveforms["bits"], 0, waveforms["samples"], waveforms["spacing_ps"], step, -waveforms["zero"] * step
        )
        found.append(vlr)
    return found


def _set_waves(
    record: Any,
    part: ScanPoints,
    waveforms: Mapping[str, Any],
    frame: MapFrame | None,
    position_m: Array,
) -> None:
    """Set the wave packets of points.

    By LAS 1.4 R15, the sample at the time t after the first one, in ps, lies at P + (L - t) (dx, dy, dz), where P is
    the point and L its own time. So dx, dy and dz lead back to the sensor.
    """
    waves, size = part.waves, count_packet_bytes(waveforms["samples"])
    assert waves is not None
    record.wavepacket_index = waves.packet_gain + np.uint8(1)
    record.wavepacket_offset = HEADER_BYTES + waves.packet.astype(np.uint64) * np.uint64(size)
    record.wavepacket_size = np.full(len(part), size, np.uint32)
    time_ps = part.range_m * _PS_PER_M - waves.packet_start * float(waveforms["spacing_ps"])
    record.return_point_wave_location = time_ps
    back = position_m - part.point_m
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    step = (_to_map(part.point_m + back, frame) - _to_map(part.point_m, frame)) / _PS_PER_M
    record.x_t, record.y_t, record.z_t = step.T


def _to_map(point_m: Array, frame: MapFrame | None) -> Array:
    """Convert points (n, 3) of the site to the map's unit, with heights in metres of its file.

    Without a map, points are unchanged.
    """
    if frame is None:
        return point_m
    x, y, z = point_m.T
    easting, northing = frame.to_map(x, y)
    return np.stack([easting, northing, z + frame.height_zero_m + frame.find_drop_m(x, y)], axis=1)


def _make_records(laspy: Any, header: Any, part: ScanPoints, point: Array) -> Any:
    """Make the records of LAS from the points of a part."""
    record = laspy.ScaleAwarePointRecord.zeros(len(part), header=header)
    record.x, record.y, record.z = point.T
    record.intensity = np.clip(np.rint(part.light), 0, 65535).astype(np.uint16)
    # A point of LAS 1.4 has at most 15 returns, and none has the number 0: a false alarm is withheld.
    record.return_number = np.clip(part.order, 1, 15)
    record.number_of_returns = np.clip(part.of, 1, 15)
    record.withheld = (part.order == 0).astype(np.uint8)
    record.user_data = part.label
    record.gps_time = part.time_s
    record.range_m, record.range_error_m = part.range_m, part.error_m
    record.energy_j, record.electrons = part.energy_j, part.light
    record.ice_delay_m, record.instance = part.ice_m, part.number
    return record


#: Fields of a point in a message of ROS: name, numpy type, number of the type in PointField.
_ROS_FIELDS = (
    ("x", "<f4", 7),
    ("y", "<f4", 7),
    ("z", "<f4", 7),
    ("intensity", "<f4", 7),
    ("t", "<u4", 6),
    ("ring", "<u2", 4),
    ("return_number", "<u2", 4),
    ("range_error", "<f4", 7),
    ("label", "<u4", 6),
)
_ROS_LAYOUT = np.dtype([(name, kind) for name, kind, _ in _ROS_FIELDS])


def _write_bag(path: Path, folder: Path, facts: Mapping[str, Any]) -> None:
    """Write a bag with ``/lidar/points`` (PointCloud2 in the sensor's axes; t in ns after the stamp) and ``/tf``."""
    from .bag_file import WORLD_FRAME, open_bag

    matrix = np.array(facts["sensor_to_world"])
    with open_bag(path) as (write, types):
        kinds = types.types
        write("/tf", _make_pose(kinds, matrix, WORLD_FRAME), 0)
        for part in read_points(folder, facts):
            for start in range(0, len(part), _POINTS_A_MESSAGE):
                chosen = slice(start, start + _POINTS_A_MESSAGE)
                time = round(float(part.time_s[chosen].min()) * _NS_PER_S)
                write("/lidar/points", _make_cloud(kinds, part, chosen, matrix, time), time)


def _make_stamp(kinds: Mapping[str, Callable[..., object]], time: int, frame: str) -> object:
    stamp = kinds["builtin_interfaces/msg/Time"](sec=time // _NS_PER_S, nanosec=time % _NS_PER_S)
    return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _make_pose(kinds: Mapping[str, Callable[..., object]], matrix: Array, frame: str) -> object:
    w, x, y, z = map(float, quaternion(matrix[:3, :3]))
    along = dict(zip("xyz", map(float, matrix[:3, 3]), strict=True))
    transform = kinds["geometry_msgs/msg/TransformStamped"](
        header=_make_stamp(kinds, 0, frame),
        child_frame_id="lidar",
        transform=kinds["geometry_msgs/msg/Transform"](
            translation=kinds["geometry_msgs/msg/Vector3"](**along),
            rotation=kinds["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
        ),
    )
    return kinds["tf2_msgs/msg/TFMessage"](transforms=[transform])


def _make_cloud(
    kinds: Mapping[str, Callable[..., object]], part: ScanPoints, chosen: slice, matrix: Array, time: int
) -> object:
    rows = np.zeros(len(part.range_m[chosen]), _ROS_LAYOUT)
    local = (part.point_m[chosen] - matrix[:3, 3]) @ matrix[:3, :3]
    for k, name in enumerate("xyz"):
        rows[name] = local[:, k]
    rows["intensity"] = part.light[chosen]
    rows["t"] = np.rint(part.time_s[chosen] * _NS_PER_S) - time
    rows["ring"], rows["return_number"] = part.row[chosen], part.order[chosen]
    rows["range_error"], rows["label"] = part.error_m[chosen], part.label[chosen]
    fields = [
        kinds["sensor_msgs/msg/PointField"](name=name, offset=_ROS_LAYOUT.fields[name][1], datatype=code, count=1)  # type: ignore[index]
        for name, _, code in _ROS_FIELDS
    ]
    return kinds["sensor_msgs/msg/PointCloud2"](
        header=_make_stamp(kinds, time, "lidar"),
        height=1,
        width=len(rows),
        fields=fields,
        is_bigendian=False,
        point_step=_ROS_LAYOUT.itemsize,
        row_step=rows.nbytes,
        data=np.frombuffer(rows.tobytes(), np.uint8),
        is_dense=bool(np.isfinite(rows["range_error"]).all()),
    )

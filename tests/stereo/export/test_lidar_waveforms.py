"""Waveforms in LAS and LAZ, read back by laspy and by this module's own reader of the specification."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.formats.lidar_points import ReturnWriter
from icymoon.formats.wave_packets import PacketWriter
from icymoon.physics.lidar.apd import Apd
from icymoon.physics.lidar.digitiser import Recorder, make_digitiser
from icymoon.physics.lidar.instrument import make_pose
from icymoon.physics.lidar.measured_returns import Alarms, AnalogReceiver, Measurement, Sensing
from icymoon.physics.lidar.noise_streams import IDEAL, Effects
from icymoon.stereo.export.lidar import write_scan
from icymoon.stereo.lidar_view import read_shown_points
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import write_json
from lidar_returns import instrument, returns
from lidar_scans import MAP

pytest.importorskip("laspy")

POSE = make_pose((100.0, -200.0, 30.0), (0.8, 0.0, 0.6, 0.0))
#: Two returns of one beam in one packet, one far behind them in its own, and one lost return among three beams.
BEAM, ORDER, RANGE_M = [0, 0, 0, 1, 2], [1, 2, 3, 1, 1], np.array([10.0, 12.5, 30.0, 20.0, 40.0])
ELECTRONS = np.array([3e4, 2e3, 4e3, 1.0, 5e7])


def write_folder(
    folder: Path, effects: Effects = IDEAL, place: dict[str, Any] | None = None, threshold: float = 6.0
) -> dict[str, Any]:
    """A scan with waveforms, and its facts."""
    own = instrument(3)
    found = returns(ELECTRONS / 0.7, RANGE_M, beam=BEAM, order=ORDER)
    along = own.pattern.make_beams().direction @ POSE.rotation.T
    point_m = POSE.position_m + along[found.beam] * RANGE_M[:, None]
    found = replace(found, point_m=point_m, of=np.array([3, 3, 3, 1, 1], np.uint8))
    receiver = AnalogReceiver(Apd(), threshold)
    measurement = Measurement(own, Sensing({}, receiver, effects=effects))
    measured, beam, alarm_m = measurement.measure(found, 0, 3)
    digitiser = make_digitiser(receiver, own, 64)
    made = Recorder(digitiser, measurement).record(found, np.arange(5), beam, alarm_m, 0, 3)
    with ReturnWriter(folder, own.pattern) as writer, PacketWriter(folder, digitiser) as packets:
        alarms = Alarms(beam, alarm_m, POSE.position_m + along[beam] * alarm_m[:, None])
        writer.add(found, vars(measured), alarms, (made.returns, made.alarms))
        packets.add(made.samples, made.gain)
        writer.finish(folder / "lidar.npz")
        facts = {
            "title": "Test",
            "pattern": "FLASH",
            "rows": 1,
            "columns": 3,
            "period_s": 0.0,
            "wavelength_nm": 532.0,
            "position_m": POSE.position_m.tolist(),
            "sensor_to_world": POSE.matrix.tolist(),
            "site": {"map": place} if place else {},
            "returns": 5,
            "beams": 3,
            "beams_without_return": 0,
            "lost_returns": int(np.isnan(measured.measured_range_m).sum()),
            "false_alarms": len(beam),
            "waveforms": packets.finish(),
        }
    write_json(folder / "lidar.json", facts)
    return facts


@dataclass(frozen=True)
class Point:
    """A point as the specification places it: coordinates, flags, samples as numbers times gain plus offset, their
    times in ps, its own time, dx, dy and dz, and where its packet begins."""

    xyz: Any
    withheld: bool
    light: Any
    time_ps: Any
    own_ps: float
    back: Any
    offset: int

    def locate(self, time_ps: float) -> Any:
        """The place of a time after the first sample: by the anchor P + L d, and from there t d towards the sensor."""
        anchor = self.xyz + self.own_ps * self.back
        return anchor - time_ps * self.back


def read_las(folder: Path) -> list[Point]:
    """Points and waveforms, by ASPRS, LAS specification 1.4 R15, without laspy."""
    data, packets = (folder / "lidar.las").read_bytes(), (folder / "lidar.wdp").read_bytes()
    assert struct.unpack_from("<H", data, 6)[0] & 6 == 4  # packets are external, and not internal
    assert data[25] == 4
    first, vlrs = struct.unpack_from("<II", data, 96)
    kind, size = data[104], struct.unpack_from("<H", data, 105)[0]
    assert kind == 9
    scale, offset = np.array(struct.unpack_from("<3d", data, 131)), np.array(struct.unpack_from("<3d", data, 155))
    assert struct.unpack_from("<Q", data, 227) == (0,)  # no waveform data packet record in this file
    (count,) = struct.unpack_from("<Q", data, 247)
    descriptors, at = {}, struct.unpack_from("<H", data, 94)[0]
    for _ in range(vlrs):
        user, record, length = struct.unpack_from("<2x16sHH", data, at)
        if user.rstrip(b"\0") == b"LASF_Spec" and 99 < record < 355:
            assert length == 26
            descriptors[record - 99] = struct.unpack_from("<BBIIdd", data, at + 54)
        at += 54 + length
    found = []
    for k in range(count):
        at = first + k * size
        xyz = np.array(struct.unpack_from("<3i", data, at)) * scale + offset
        index, begin, length, own_ps, *back = struct.unpack_from("<BQI4f", data, at + 30)
        bits, packed, samples, spacing_ps, gain, least = descriptors[index]
        assert (bits, packed, length) == (16, 0, 2 * samples)
        raw = np.frombuffer(packets[begin : begin + length], "<u2")
        withheld, time_ps = bool(data[at + 15] & 4), np.arange(samples) * spacing_ps
        found.append(Point(xyz, withheld, gain * raw + least, time_ps, own_ps, np.array(back), begin))
    return found


def find_centre(point: Point) -> float:
    """Time in ps of the light within 0.8 m of the point's own time."""
    near = np.abs(point.time_ps - point.own_ps) < 0.8 / 299792458 * 2e12
    return float((point.light * point.time_ps)[near].sum() / point.light[near].sum())


def test_waveforms_lie_where_the_points_do(tmp_path):
    write_folder(tmp_path)
    write_scan(tmp_path, "las")
    points = read_las(tmp_path)
    kept = [0, 1, 2, 4]
    along = instrument(3).pattern.make_beams().direction @ POSE.rotation.T
    truth = POSE.position_m + along[np.array(BEAM)[kept]] * RANGE_M[kept, None]
    assert len(points) == 4
    assert points[0].offset == points[1].offset == 60  # after the header of the file
    assert len({point.offset for point in points}) == 3
    for point, place, electrons in zip(points, truth, ELECTRONS[kept], strict=True):
        # Steps of 0.1 mm of each coordinate, and times of single precision.
        assert point.xyz == pytest.approx(place, abs=6e-5)
        # The weakest light of 2000 electrons has the sum of its times within half a step of 0.25 electrons.
        assert point.locate(find_centre(point)) == pytest.approx(place, abs=1e-3)
        assert point.locate(0.0) @ along[0] < point.xyz @ along[0]  # the first sample is nearer
        near = np.abs(point.time_ps - point.own_ps) < 0.8 / 299792458 * 2e12
        assert point.light[near].sum() == pytest.approx(electrons, rel=2e-3)
        step_m = np.linalg.norm(point.back) * 1000
        assert step_m == pytest.approx(299792458 / 2 * 1e-9, rel=1e-6)


def test_waveforms_follow_the_coordinates_of_a_map(tmp_path):
    write_folder(tmp_path, place=MAP)
    write_scan(tmp_path, "las")
    along = instrument(3).pattern.make_beams().direction @ POSE.rotation.T
    for point, beam, range_m in zip(read_las(tmp_path), (0, 0, 0, 2), (10.0, 12.5, 30.0, 40.0), strict=True):
        first_m = range_m - point.own_ps * 299792458 / 2e12
        x, y, z = POSE.position_m + along[beam] * first_m
        drop_m = 1e6 - np.sqrt(1e12 - x**2 - y**2)
        expected = [(4e5 + x / 0.5) / 1000, (5.4e6 + y) / 1000, z + 40 + drop_m]
        found = point.locate(0.0)
        assert found[:2] == pytest.approx(expected[:2], abs=1.5e-7)  # kilometres
        assert found[2] == pytest.approx(expected[2], abs=1e-4)


def test_false_alarms_have_waveforms_too(tmp_path):
    facts = write_folder(tmp_path, Effects(), threshold=1.5)
    assert facts["false_alarms"] > 0
    write_scan(tmp_path, "las")
    points = read_las(tmp_path)
    alarms = [point for point in points if point.withheld]
    assert len(alarms) == facts["false_alarms"]
    for point in alarms:
        nearest = np.abs(point.time_ps - point.own_ps).argmin()
        # The threshold is 16 steps of the finest gain.
        assert point.light[nearest] >= 15.4 * facts["waveforms"]["step_electrons"]


@pytest.mark.parametrize("kind", ["las", "laz"])
def test_laspy_reads_points_and_descriptors(kind, tmp_path):
    import laspy

    if kind == "laz":
        pytest.importorskip("lazrs")
    facts = write_folder(tmp_path)
    write_scan(tmp_path, "las")
    read = laspy.read(write_scan(tmp_path, kind))
    assert read.header.global_encoding.waveform_data_packets_external
    assert not read.header.global_encoding.waveform_data_packets_internal
    assert read.header.point_format.id == 9
    assert read.point_format.has_waveform_packet
    stated = read.vlrs.get("WaveformPacketVlr")
    assert [vlr.record_id for vlr in stated] == list(range(100, 100 + facts["waveforms"]["gains"]))
    for k, vlr in enumerate(stated):
        own = vlr.parsed_record
        assert (own.bits_per_sample, own.number_of_samples, own.temporal_sample_spacing) == (16, 64, 500)
        assert own.digitizer_gain == facts["waveforms"]["step_electrons"] * 2**k
        assert own.digitizer_offset == -4096 * own.digitizer_gain
    for k, point in enumerate(read_las(tmp_path)):
        assert read.xyz[k] == pytest.approx(point.xyz, abs=1e-9)
        assert int(read["wavepacket_offset"][k]) == point.offset
        assert float(read["return_point_wave_location"][k]) == point.own_ps
        assert [float(read[name][k]) for name in ("x_t", "y_t", "z_t")] == point.back.tolist()


def test_a_scan_without_its_waveforms_is_one_sentence(tmp_path):
    facts = write_folder(tmp_path)
    (tmp_path / "lidar.wdp").rename(tmp_path / "other.wdp")
    with pytest.raises(IcyMoonError, match=r"lidar\.wdp is missing; scan the scene again"):
        write_scan(tmp_path, "las")
    (tmp_path / "other.wdp").rename(tmp_path / "lidar.wdp")
    facts["waveforms"]["gains"] = 1
    write_json(tmp_path / "lidar.json", facts)
    with pytest.raises(IcyMoonError, match=r"points beyond the waveforms that lidar\.json states"):
        write_scan(tmp_path, "las")
    assert not (tmp_path / "lidar.las").exists()


def test_points_of_a_scan_with_waveforms_are_shown(tmp_path):
    facts = write_folder(tmp_path)
    assert read_shown_points([tmp_path], 10).total == facts["returns"] - facts["lost_returns"]

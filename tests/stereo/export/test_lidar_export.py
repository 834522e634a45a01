"""Scans in formats of the field, read back by foreign readers."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.formats.lidar_points import ReturnWriter
from icymoon.formats.ply import read_properties
from icymoon.physics.lidar.returns import NO_RETURNS
from icymoon.stereo.export import lidar
from icymoon.stereo.export.lidar import check_format, discard_points, write_scan
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import write_json
from lidar_scans import ALONG, MAP, MEASURED_M, PATTERN, POSE, RANGE_M, write_folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_folder(tmp_path / "scan", measured=True)


def test_points_lie_where_the_instrument_measures_them(folder):
    read = read_properties(write_scan(folder, "ply"), "x", "y", "z", "range_m", "range_error_m", "return_number")
    assert read is not None
    expected = POSE.position_m + ALONG[[0, 2]] * MEASURED_M[[0, 2], None]
    assert read[:2, :3] == pytest.approx(expected)
    assert read[:2, 3:] == pytest.approx(np.array([[2.5, 0.625, 1], [4.25, 0.375, 1]]))
    assert read[2, :4].tolist() == [100, -191, 3, 9]
    assert np.isnan(read[2, 4])
    assert read[2, 5] == 0


def test_a_scan_without_a_detector_has_all_returns(tmp_path):
    folder = write_folder(tmp_path, measured=False)
    read = read_properties(write_scan(folder, "ply"), "x", "y", "z", "range_m", "range_error_m", "instance")
    assert read is not None
    assert read[:, :3] == pytest.approx(POSE.position_m + ALONG * RANGE_M[:, None])
    assert read[:, 4:].tolist() == [[0.125, 0], [0.125, 7], [0.125, 2**40]]


@pytest.mark.parametrize("kind", ["las", "laz"])
def test_las_is_read_back(kind, folder):
    laspy = pytest.importorskip("laspy")
    if kind == "laz":
        pytest.importorskip("lazrs")
    path = write_scan(folder, kind)
    head = path.read_bytes()[:375]
    assert (head[:4], head[24], head[25], head[104] & 63) == (b"LASF", 1, 4, 6)
    assert struct.unpack_from("<Q", head, 247) == (3,)
    assert struct.unpack_from("<H", head, 6) == (16,)  # bit 4: LAS 1.4 allows records from 6 on only WKT
    read = laspy.read(path)
    expected = POSE.position_m + ALONG[[0, 2]] * MEASURED_M[[0, 2], None]
    assert read.xyz[:2] == pytest.approx(expected, abs=5.1e-5)
    assert np.asarray(read.return_number).tolist() == [1, 1, 1]
    assert np.asarray(read.number_of_returns).tolist() == [2, 1, 1]
    assert np.asarray(read.withheld).tolist() == [0, 0, 1]
    assert np.asarray(read.intensity).tolist() == [50, 65535, 0]
    assert np.asarray(read.user_data).tolist() == [1, 1, 0]
    assert np.asarray(read["instance"]).tolist() == [0, 2**40, 0]
    assert np.asarray(read["range_error_m"])[:2].tolist() == [0.625, 0.375]
    assert np.asarray(read["ice_delay_m"]).tolist() == [0.04, 0.06, 0]  # what the measured range has of it
    assert np.asarray(read.gps_time).tolist() == pytest.approx([0.0, 0.2, 0.2])


def test_a_scan_without_points_is_a_file_without_points(tmp_path):
    with ReturnWriter(tmp_path, PATTERN) as writer:
        writer.add(NO_RETURNS, {})
        writer.finish(tmp_path / "lidar.npz")
    facts = json.loads((write_folder(tmp_path / "other", False) / "lidar.json").read_text(encoding="utf-8"))
    write_json(tmp_path / "lidar.json", facts | {"returns": 0, "beams_without_return": 6})
    assert b"element vertex 0" in write_scan(tmp_path, "ply").read_bytes()
    laspy = pytest.importorskip("laspy")
    assert len(laspy.read(write_scan(tmp_path, "las"))) == 0


def test_las_has_the_coordinates_of_the_map(tmp_path):
    laspy = pytest.importorskip("laspy")
    read = laspy.read(write_scan(write_folder(tmp_path, True, MAP), "las"))
    x, y, z = 102.5, -200.0, 3.0
    drop_m = 1e6 - np.sqrt(1e12 - x**2 - y**2)
    expected = [(4e5 + x / 0.5) / 1000, (5.4e6 + y) / 1000, z + 40 + drop_m]
    assert read.xyz[0][:2] == pytest.approx(expected[:2], abs=6e-8)  # kilometres
    assert read.xyz[0][2] == pytest.approx(expected[2], abs=5.1e-5)
    assert b'"directory": "1 1 0 1 3072 0 1 32633"' in read.vlrs.get_by_id("icymoon")[0].record_data


def test_a_bag_is_read_back(folder, monkeypatch):
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader

    monkeypatch.setattr(lidar, "_POINTS_A_MESSAGE", 1)
    path = write_scan(folder, "ros2")
    clouds, poses = [], []
    with AnyReader([path]) as reader:
        for connection, time, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            (clouds if connection.topic == "/lidar/points" else poses).append((time, message))
    assert [time for time, _ in clouds] == [0, 200_000_000, 200_000_000]
    codes, fields_of = {7: "<f4", 6: "<u4", 4: "<u2"}, clouds[0][1].fields
    layout: Any = {
        "names": [field.name for field in fields_of],
        "formats": [codes[field.datatype] for field in fields_of],
        "offsets": [field.offset for field in fields_of],
        "itemsize": clouds[0][1].point_step,
    }
    rows = np.concatenate([np.frombuffer(message.data.tobytes(), np.dtype(layout)) for _, message in clouds])
    local = np.stack([rows[name] for name in "xyz"], axis=1)
    assert local[:2] == pytest.approx((ALONG[[0, 2]] * MEASURED_M[[0, 2], None]) @ POSE.rotation, abs=1e-6)
    assert rows["ring"].tolist() == [1, 1, 0]
    assert rows["return_number"].tolist() == [1, 1, 0]
    assert [message.is_dense for _, message in clouds] == [True, True, False]
    transform = poses[0][1].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "lidar")
    assert transform.transform.translation.x == 100
    assert transform.transform.rotation.z == pytest.approx(0.6)
    with pytest.raises(IcyMoonError, match="exists already"):
        write_scan(folder, "ros2")


def test_points_of_an_earlier_scan_do_not_stay(folder):
    (folder / "lidar.laz").write_bytes(b"old")
    (folder / "thesis.ply").write_bytes(b"mine")
    (folder / "lidar_bag").mkdir()
    discard_points(folder, ["laz"])
    assert {path.name for path in folder.iterdir()} == {"lidar.npz", "lidar.json", "lidar_bag", "thesis.ply"}
    with pytest.raises(IcyMoonError, match="a bag is not written over"):
        discard_points(folder, ["ros2"])


def test_a_missing_package_and_a_missing_scan_are_one_sentence(monkeypatch, tmp_path):
    monkeypatch.setattr(lidar.importlib.util, "find_spec", lambda name: None)
    assert check_format("laz") == 'LAZ files need the package laspy; pip install "icymoon[las]".'
    assert check_format("ply") == ""
    with pytest.raises(IcyMoonError, match=r"lidar.json is missing"):
        write_scan(tmp_path, "ply")


@pytest.mark.parametrize("lacking", ["true_range_m", "false_range_m"])
def test_a_scan_without_an_array_is_one_sentence(folder, lacking):
    with np.load(folder / "lidar.npz") as stored:
        kept = {name: stored[name] for name in stored.files if name != lacking}
    np.savez(folder / "lidar.npz", **kept)
    with pytest.raises(IcyMoonError, match=f"lacks {lacking}; scan the scene again"):
        write_scan(folder, "ply")

"""A scan of a built scene meets the triangles that are exported of it."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from icymoon.formats.lidar_file import change_lidar, read_lidar
from icymoon.formats.ply import read_properties
from icymoon.physics.lidar.digitiser import Packets, Waves, make_digitiser
from icymoon.physics.lidar.instrument import SensorPose
from icymoon.physics.lidar.measured_returns import Alarms
from icymoon.physics.lidar.returns import NO_RETURNS, Returns
from icymoon.rays.embree import load_library
from icymoon.rays.lidar import ScannedBeams
from icymoon.rays.shapes import Placed, World
from icymoon.render import geometry_worker, lidar_worker
from icymoon.render.workers.lidar_request import ScanRequest
from icymoon.settings.preset_files import LIDARS
from icymoon.support.errors import IcyMoonError
from ray_worlds import by_hand, shape
from rendering import SMALL

JOB = {"settings": {**SMALL, "terrain": {"resolution": 33, "size_m": 8.0, "rms_slope_deg": 8.0}}}


def test_a_scan_without_waveforms_removes_those_of_an_earlier_one(tmp_path):
    lidar = read_lidar(LIDARS / "livox_hap.toml")
    digitiser = make_digitiser(lidar.detector, lidar.instrument, 64)
    samples, gain = np.full((1, 64), 4096, np.uint16), np.zeros(1, np.uint8)
    place = Waves(np.zeros(1, np.int64), gain, np.zeros(1, np.int64))
    none = Waves(*(values[:0] for values in vars(place).values()))
    no_alarms = Alarms(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)))
    one = Returns(**{name: np.zeros((1, *value.shape[1:]), value.dtype) for name, value in vars(NO_RETURNS).items()})
    beside = {"measured_range_m": np.ones(1)}
    scanned = ScannedBeams(one, beside, no_alarms, 1, 0, Packets(samples, gain, place, none))
    pattern = lidar.instrument.pattern
    told: list[float] = []
    counts = lidar_worker._write_scan(tmp_path, [scanned], pattern, digitiser, told.append)
    assert counts["waveforms"]["packets"] == counts["returns"] == 1
    assert told == [1 / pattern.count]
    assert (tmp_path / "lidar.wdp").stat().st_size == 60 + 128
    with np.load(tmp_path / "lidar.npz") as stored:
        assert stored["packet"].tolist() == [0]
        assert stored["false_packet_start"].shape == (0,)
    bare = replace(scanned, packets=None)
    assert "waveforms" not in lidar_worker._write_scan(tmp_path, [bare], pattern, None, told.append)
    assert [path.name for path in tmp_path.iterdir()] == ["lidar.npz"]


@pytest.mark.parametrize("name", [path.stem for path in sorted(LIDARS.glob("*.toml"))])
def test_a_scan_states_the_numbers_of_its_scanner_file(name):
    lidar = read_lidar(LIDARS / f"{name}.toml")
    stated = lidar_worker._describe_scan(lidar, SensorPose(np.zeros(3), np.eye(3)))
    asked = tomllib.loads((LIDARS / f"{name}.toml").read_text(encoding="utf-8"))["lidar"]
    names = {"wavelength_nm", "pulse_uj", "pulse_ns"} & asked.keys()
    assert "pulse_uj" in names
    assert {key: stated[key] for key in names} == {key: asked[key] for key in names}


@pytest.mark.long
@pytest.mark.skipif(load_library() is None, reason="there is no Embree; pip install embreex")
def test_ranges_are_those_of_the_exported_mesh(tmp_path):
    lidar = change_lidar(read_lidar(LIDARS / "flash_like_alhat.toml"), 5, 6, None, None)
    lidar_worker.run_job(JOB, tmp_path / "scan", lidar, ScanRequest(), lambda *words, **facts: None)
    geometry_worker.run_job(JOB, tmp_path / "mesh", lambda *words, **facts: None)
    (scan,), (mesh,) = (list((tmp_path / name).iterdir()) for name in ("scan", "mesh"))
    vertices = read_properties(mesh / "terrain.ply", "x", "y", "z")
    data = (mesh / "terrain.ply").read_bytes()
    count = int(data.split(b"element face ")[1].split(b"\n")[0])
    faces = np.frombuffer(data[-13 * count :], np.dtype([("n", "u1"), ("v", "<i4", 3)]))["v"]
    world = World([Placed(shape(vertices, faces), np.eye(4)[None], np.array([1]))])
    facts = json.loads((scan / "lidar.json").read_text(encoding="utf-8"))
    matrix = np.array(facts["sensor_to_world"])
    pose = SensorPose(matrix[:3, 3], matrix[:3, :3])
    with np.load(scan / "lidar.npz") as stored:
        found = dict(stored)
    axis = lidar.instrument.pattern.make_beams().direction @ pose.rotation.T
    along, _, normal = by_hand(world, pose.position_m, axis)
    first = found["on_axis"]
    assert first.sum() == np.isfinite(along).sum() == facts["beams"] == 30
    assert found["true_range_m"][first] == pytest.approx(along, rel=1e-5)
    assert found["normal"][first] == pytest.approx(normal, abs=1e-4)
    assert set(found["label"].tolist()) == {1}
    assert {path.name for path in scan.iterdir()} == {"lidar.npz", "lidar.json"}
    assert found["measured_range_m"].shape == found["range_m"].shape
    assert facts["light_in_ice"]["terrain"].startswith("left out")
    under = ScanRequest(pose=(0, 0, -3, 1, 0, 0, 0))
    with pytest.raises(IcyMoonError, match="is under the ground; give another --position"):
        lidar_worker.run_job(JOB, tmp_path / "under", lidar, under, lambda *words, **facts: None)

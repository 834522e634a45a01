"""Laser scanners in TOML files, and their returns in npz and PLY."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from icymoon.formats import lidar_points
from icymoon.formats.lidar_file import change_lidar, read_lidar
from icymoon.formats.lidar_points import ReturnWriter, find_cells, read_returns
from icymoon.physics.lidar.measured_returns import Alarms, AnalogReceiver, Measurement, PhotonCounter, Sensing
from icymoon.physics.lidar.returns import NO_RETURNS, Returns, join_returns
from icymoon.physics.lidar.scan_patterns import ScanPattern
from icymoon.settings.preset_files import LIDARS, lidar_names, preset_names
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import parse_toml

GOOD = """[lidar]
pattern = "RASTER"
rows = 2
columns = 3
width_deg = 30.0
height_deg = 10.0
pulse_uj = 1.0
wavelength_nm = 1064.0
fwhm_deg = [0.1, 0.2]
aperture_mm = 20.0
"""


def test_the_shipped_scanners_have_sources_and_are_no_presets_of_scenes():
    assert {"ouster_os1", "livox_hap", "elsa", "splice_hazard", "flash_like_alhat"} == {*lidar_names()}
    assert not any(name.startswith("lidars/") for name in preset_names())
    for name in lidar_names():
        path = LIDARS / f"{name}.toml"
        lidar = read_lidar(path)
        assert lidar.title != name
        # A scanner is the figures of its source, or states what is assumed.
        assert any("ssumed" in source for source in parse_toml(path.read_text(encoding="utf-8"))["sources"].values())


def test_figures_of_data_sheets():
    ouster, livox = (read_lidar(LIDARS / f"{name}.toml").instrument for name in ("ouster_os1", "livox_hap"))
    assert ouster.pattern.count * 10 == 128 * 1024 * 10
    assert ouster.wavelength_m == pytest.approx(850e-9)
    # Half of the intensity is left at half of 0.18°.
    assert np.exp(-2 * (np.radians(0.09) / ouster.half_angle_rad[0]) ** 2) == pytest.approx(0.5)
    assert livox.pattern.count / livox.pattern.period_s == pytest.approx(452_000, rel=1e-3)
    splice = read_lidar(LIDARS / "splice_hazard.toml").instrument.pattern
    assert (splice.count, splice.period_s) == (16_000_000, 2)


@pytest.mark.parametrize(
    ("changed", "part"),
    [
        ('pattern = "RASTER"', "lidar.pattern is 'ROSETTE', not one of SPINNING, RASTER, FLASH"),
        ("rows = 2", "0 rows"),
        ("pulse_uj = 1.0", "pulse has -1e-06 J"),
        ("aperture_mm = 20.0", "aperture_mm is missing"),
        ("fwhm_deg = [0.1, 0.2]", "give two"),
        ("width_deg = 30.0", "unknown key"),
        ("height_deg = 10.0", "TOML"),
    ],
)
def test_a_mistake_is_one_sentence_that_names_the_file(changed, part, tmp_path):
    other = {
        'pattern = "RASTER"': 'pattern = "ROSETTE"',
        "rows = 2": "rows = 0",
        "pulse_uj = 1.0": "pulse_uj = -1.0",
        "aperture_mm = 20.0": "",
        "fwhm_deg = [0.1, 0.2]": "fwhm_deg = [0.1]",
        "width_deg = 30.0": "width_deg = 30.0\nwidth = 3",
        "height_deg = 10.0": "height_deg = ",
    }
    path = tmp_path / "mine.toml"
    path.write_text(GOOD.replace(changed, other[changed]), encoding="utf-8")
    with pytest.raises(IcyMoonError, match=part) as found:
        read_lidar(path)
    assert str(found.value).startswith(str(path))
    assert "\n" not in str(found.value)


def test_a_scanner_is_changed(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD, encoding="utf-8")
    lidar = read_lidar(path)
    assert lidar.title == "mine"
    changed = change_lidar(lidar, 5, None, 60, "LAST").instrument
    assert (changed.pattern.rows, changed.pattern.columns, changed.sub_rays, changed.reported) == (5, 3, 60, "LAST")
    assert change_lidar(lidar, None, None, None, None) == lidar
    with pytest.raises(IcyMoonError, match="no beams"):
        change_lidar(lidar, 0, None, None, None)


@pytest.mark.parametrize("kind", ["SPINNING", "RASTER", "FLASH"])
def test_cells_of_beams_are_those_of_the_pattern(kind):
    pattern = ScanPattern(kind, 4, 5, 50, 20, 0, 0.7)
    beams = pattern.make_beams()
    row, column, time_s = find_cells(np.arange(20), pattern)
    assert np.array_equal(row, beams.row)
    assert np.array_equal(column, beams.column)
    assert time_s == pytest.approx(beams.time_s, rel=1e-14)


DETECTORS = """
[detector]
kind = "APD"
gain = 50.0
timing = "CENTROID"
saturation_electrons = 1000.0
filter_nm = 1.0
"""


def test_a_detector_is_read(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD + "farthest_m = 90.0\npulse_ns = 2.0\n" + DETECTORS, encoding="utf-8")
    lidar = read_lidar(path)
    assert isinstance(lidar.detector, AnalogReceiver)
    assert (lidar.detector.apd.gain, lidar.detector.timing, lidar.filter_nm) == (50, "CENTROID", 1)
    assert lidar.instrument.pulse_fwhm_s == pytest.approx(2e-9)
    path.write_text(GOOD + 'farthest_m = 90.0\n[detector]\nkind = "SPAD"\ndark_khz = 2.0\n', encoding="utf-8")
    counter = read_lidar(path).detector
    assert isinstance(counter, PhotonCounter)
    assert counter.dark_hz == 2000
    kinds = {name: type(read_lidar(LIDARS / f"{name}.toml").detector) for name in lidar_names()}
    assert kinds["elsa"] is PhotonCounter
    assert {kinds[name] for name in kinds if name != "elsa"} == {AnalogReceiver}


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('kind = "PMT"', "detector.kind is 'PMT', not one of APD, SPAD"),
        ('kind = "SPAD"\ngain = 3.0', "unknown key detector.'gain'"),
        ('kind = "APD"\ngain = 0.1', "gain of the photodiode is 0.1"),
        ('kind = "APD"\nefficiency = 0.0', "quantum efficiency of the photodiode is 0"),
        ('kind = "SPAD"\nefficiency = 2.0', "efficiency of the photon counter is 2"),
        ("gain = 3.0", "kind is missing"),
        ('kind = "APD"', "give lidar.farthest_m"),
    ],
)
def test_a_mistake_in_a_detector_is_one_sentence(text, part, tmp_path):
    path = tmp_path / "mine.toml"
    far = "" if "farthest" in part else "farthest_m = 9.0\n"
    path.write_text(f"{GOOD}{far}[detector]\n{text}\n", encoding="utf-8")
    with pytest.raises(IcyMoonError, match=part) as found:
        read_lidar(path)
    assert str(found.value).startswith(str(path))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("name", "range_m", "most_m"),
    [
        ("livox_hap", 20.0, 0.02),  # the manual
        ("splice_hazard", 500.0, 0.01),  # NASA 2021
        ("ouster_os1", 100.0, 0.1),  # data sheet: 10 cm at the lowest signal
    ],
)
def test_detectors_have_the_precision_that_is_published(name, range_m, most_m):
    lidar, count = read_lidar(LIDARS / f"{name}.toml"), 2000
    zero = {
        field.name: np.zeros((count, *getattr(NO_RETURNS, field.name).shape[1:]), getattr(NO_RETURNS, field.name).dtype)
        for field in fields(Returns)
    }
    found = replace(
        Returns(**zero),
        beam=np.arange(count),
        order=np.ones(count, np.uint8),
        range_m=np.full(count, range_m),
        energy_j=lidar.instrument.collect(np.full(count, range_m)) * 0.8 / np.pi,
    )
    measured, _, _ = Measurement(lidar.instrument, Sensing({}, lidar.detector)).measure(found, 0, count)
    assert measured.detected.mean() > 0.999
    error_m = measured.measured_range_m[measured.detected] - range_m
    assert error_m.std() < most_m
    assert abs(error_m.mean()) < 0.1 * most_m


def make_returns() -> Returns:
    first = Returns(
        **{
            field.name: np.full(
                (1, *getattr(NO_RETURNS, field.name).shape[1:]), 2, getattr(NO_RETURNS, field.name).dtype
            )
            for field in fields(Returns)
        }
    )
    return join_returns([first, replace(first, range_m=np.array([1.25]), beam=np.array([5]))])


def test_returns_are_written_in_parts_as_numpy_writes_them(tmp_path: Path):
    returns, pattern = make_returns(), ScanPattern("RASTER", 2, 3, 30, 10)
    late = {"ice_edge_m": np.array([0.5, 0.25])}
    with ReturnWriter(tmp_path, pattern) as writer:
        for k in range(2):
            alarms = Alarms(np.full(k, 3), np.full(k, 7.5), np.full((k, 3), 1.5))
            writer.add(returns.take(np.array([k])), {"ice_edge_m": late["ice_edge_m"][[k]]}, alarms)
        writer.finish(tmp_path / "a.npz")
    row, column, time_s = find_cells(returns.beam, pattern)
    alarm = {"false_beam": np.array([3]), "false_range_m": np.array([7.5]), "false_point_m": np.full((1, 3), 1.5)}
    np.savez(tmp_path / "b.npz", **vars(returns), **late, row=row, column=column, time_s=time_s, **alarm)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "b.npz"]
    parts = list(read_returns(tmp_path / "a.npz", ["point_m", "range_m", "absent"], 1))
    assert [part["range_m"].tolist() for part in parts] == [[2.0], [1.25]]
    assert [part["point_m"].shape for part in parts] == [(1, 3), (1, 3)]
    assert "absent" not in parts[0]


@pytest.mark.parametrize(
    "arrays",
    [
        {"range_m": np.zeros((4, 10**6), np.int8)},  # 65 GB for the rows of a part
        {"range_m": np.zeros(4), "point_m": np.zeros((4, 2))},
        {"range_m": np.array(1.0)},
        {"range_m": np.array(["a"])},
        {"range_m": np.zeros(4), "point_m": np.zeros((3, 3))},
    ],
    ids=["wide", "plane", "number", "text", "lengths"],
)
def test_returns_of_another_shape_are_one_sentence(tmp_path, arrays):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(IcyMoonError, match="scan the scene again"):
        list(read_returns(tmp_path / "a.npz", ["range_m", "point_m"]))


def test_damaged_returns_are_one_sentence(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK no archive")
    with pytest.raises(IcyMoonError, match="scan the scene again"):
        list(read_returns(tmp_path / "a.npz", ["range_m"]))
    with pytest.raises(IcyMoonError, match="scan the scene again"):
        list(read_returns(tmp_path / "none.npz", ["range_m"]))


def test_a_scan_that_does_not_fit_on_the_disk_is_refused_before_it_begins(tmp_path, monkeypatch):
    file = tmp_path / "lidar.npz"
    with ReturnWriter(tmp_path, ScanPattern("RASTER", 1, 1, 1, 1)) as writer:
        some = {"ice": np.zeros((1000, 7))}  # four numbers on the delay in ice, and three of the detector
        writer.add(
            Returns(
                **{key: np.zeros((1000, *value.shape[1:]), value.dtype) for key, value in vars(NO_RETURNS).items()}
            ),
            some,
        )
        writer.finish(file)
    needed = 2 * file.stat().st_size
    for free, fits in ((1.01 * needed, True), (0.97 * needed, False)):
        monkeypatch.setattr(lidar_points.shutil, "disk_usage", lambda path, free=free: SimpleNamespace(free=free))
        if fits:
            lidar_points.check_room(tmp_path / "not" / "there", 1000)
        else:
            with pytest.raises(IcyMoonError, match=r"a scan of 1e\+03 beams may need .* fewer rows and columns"):
                lidar_points.check_room(tmp_path / "not" / "there", 1000)
    # A packet of 64 samples, and its three arrays with their copies: 162 bytes more for each beam.
    for free, fits in ((needed + 165_000, True), (needed + 145_000, False)):
        monkeypatch.setattr(lidar_points.shutil, "disk_usage", lambda path, free=free: SimpleNamespace(free=free))
        if fits:
            lidar_points.check_room(tmp_path, 1000, 64)
        else:
            with pytest.raises(IcyMoonError, match="fewer samples of --waveforms, or fewer rows and columns"):
                lidar_points.check_room(tmp_path, 1000, 64)
    assert not (tmp_path / "not").exists()

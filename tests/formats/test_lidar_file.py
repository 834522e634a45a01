"""Laser scanners in TOML files, and their returns in npz and PLY."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from icymoon.formats.lidar_file import change_lidar, read_lidar
from icymoon.formats.lidar_points import find_cells, write_points, write_returns
from icymoon.formats.ply import read_properties
from icymoon.physics.lidar.returns import NO_RETURNS, join_returns
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


def test_returns_are_written_and_read_back(tmp_path: Path):
    one = {
        name: np.ones((1, *getattr(NO_RETURNS, name).shape[1:]), getattr(NO_RETURNS, name).dtype)
        for name in ("beam", "order", "of", "range_m", "energy_j", "spread_m", "share", "point_m", "true_range_m")
    }
    rest = {
        name: np.full((1, *getattr(NO_RETURNS, name).shape[1:]), 2, getattr(NO_RETURNS, name).dtype)
        for name in ("true_point_m", "incidence_rad", "normal", "label", "number", "on_axis")
    }
    first = replace(NO_RETURNS, **one, **rest)
    returns = join_returns([first, replace(first, range_m=np.array([1.25]), beam=np.array([5]))])
    write_returns(tmp_path / "a.npz", returns, ScanPattern("RASTER", 2, 3, 30, 10))
    with np.load(tmp_path / "a.npz", allow_pickle=False) as stored:
        assert stored["range_m"].tolist() == [1, 1.25]
        assert stored["row"].tolist() == [0, 1]
        assert stored["column"].tolist() == [1, 2]
        assert stored["point_m"].shape == (2, 3)
    write_points(tmp_path / "a.ply", returns)
    read = read_properties(tmp_path / "a.ply", "x", "range_m", "range_error_m", "instance")
    assert read is not None
    assert read.tolist() == [[1, 1, 0, 2], [1, 1.25, 0.25, 2]]
    write_points(tmp_path / "none.ply", NO_RETURNS)
    write_returns(tmp_path / "none.npz", NO_RETURNS, ScanPattern("FLASH", 2, 3, 30, 10))

"""Mistakes of ``icymoon lidar`` are one sentence, before Blender starts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from icymoon.commands import lidar
from icymoon.commands.cli import main
from icymoon.commands.lidar import find_lidar
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.preset_files import LIDARS, lidar_names
from icymoon.settings.user_files import hash_content
from lidar_scans import write_folder


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--lidar", "ouster_os2"], "ouster_os1"),
        (["--lidar", "../heads/trinocular"], "There is no laser scanner"),
        (["--rows", "0"], "no beams"),
        (["--position", "0", "0", "2"], "give --position and --quaternion"),
        (["--position", "0", "0", "2", "--quaternion", "0", "0", "0", "0"], "pose has no rotation"),
        (["--set", "terrain.size_m=-1"], "terrain.size_m"),
        (["--grain-um", "0"], "grain radius is 0 m"),
        (["--grain-um", "100", "--density", "2000"], "density of snow is 2000"),
        (["--density", "nan"], "density of snow is nan"),
        (["--seed", "-1"], "--seed is -1"),
        (["--lidar", "elsa", "--waveforms", "64"], "counts single photons, so it has no waveform"),
        (["--without", "detector", "--waveforms", "64"], "do not leave the detector out, or ask for no waveforms"),
        (["no_pair"], "no_pair"),
        (["no_pair", "--preset", "enceladus_block_field"], "A pair has its own settings"),
    ],
)
def test_a_mistake_is_one_sentence(words, part, tmp_path, capsys):
    assert main(["lidar", *words, "--out", str(tmp_path / "out"), "--blender", "/nowhere/blender"]) == 1
    told = capsys.readouterr().err
    assert part in told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()


def test_ground_of_a_users_file_is_planned_with_its_content(tmp_path, monkeypatch):
    """Without the content in its id, the build refuses the ground as one whose file has changed."""
    file = tmp_path / "dem.npy"
    np.save(file, np.zeros((4, 4)))
    asked = []
    monkeypatch.setattr(lidar, "build_geometry", lambda planned, *words, **more: asked.append(planned[0]))
    words = ["--set", "source.kind=HEIGHT_MAP", "--set", f"source.file={file}"]
    assert main(["lidar", *words, "--out", str(tmp_path / "out")]) == 1  # there is no scan to read
    settings = asked[0].settings
    assert asked[0].id == make_pair_id(settings, hash_content(settings))
    assert asked[0].id != make_pair_id(settings, "")


@pytest.mark.parametrize(
    ("pose", "count"), [([], 3), (["--position", "0", "0", "2", "--quaternion", "1", "0", "0", "0"], 1)]
)
def test_each_heading_is_scanned_and_told(pose, count, tmp_path, monkeypatch, capsys):
    out, asked = tmp_path / "out", []

    def scan(planned: Any, *words: Any, **more: Any) -> None:
        asked.extend(planned)
        for each in planned:
            write_folder(out / each.id, measured=True)

    monkeypatch.setattr(lidar, "build_geometry", scan)
    assert main(["lidar", "--set", "dataset.headings=3", *pose, "--ply", "--out", str(out)]) == 0
    assert len({each.id for each in asked}) == len({each.turn_deg for each in asked}) == count
    told = capsys.readouterr().out.splitlines()
    assert [line.split(": ")[0] for line in told] == [str(out / each.id) for each in asked]
    assert all((out / each.id / "lidar.ply").is_file() for each in asked)


def test_a_scan_that_is_there_is_written_in_other_formats(tmp_path, capsys):
    folder = write_folder(tmp_path / "scan", measured=True)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert main(["lidar", "--convert", str(folder), "--ply"]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "lidar.ply")
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "lidar.ply"} == before


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ([], "--convert has no format"),
        (["--ply", "--out", "other"], "--convert scans nothing"),
        (["--ply", "--preset", "europa_chaos"], "--convert scans nothing"),
        (["--ply", "--waveforms", "64"], "--convert scans nothing"),
        (["--ply", "--rows", "9"], "--convert scans nothing"),
        (["--ply", "--without", "ice"], "--convert scans nothing"),
    ],
)
def test_a_conversion_takes_formats_alone(words, part, tmp_path, capsys):
    folder = write_folder(tmp_path / "scan", measured=True)
    assert main(["lidar", "--convert", str(folder), *words]) == 1
    assert part in capsys.readouterr().err
    assert not (folder / "lidar.ply").exists()


def test_a_conversion_needs_a_scan(tmp_path, capsys):
    assert main(["lidar", "--convert", str(tmp_path), "--ply"]) == 1
    assert "lidar.json is missing" in capsys.readouterr().err


def test_each_shipped_scanner_is_found_by_its_name():
    assert [find_lidar(name) for name in lidar_names()] == [LIDARS / f"{name}.toml" for name in lidar_names()]

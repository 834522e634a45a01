"""Mistakes of ``icymoon lidar`` are one sentence, before Blender starts."""

from __future__ import annotations

import pytest
from icymoon.commands.cli import main
from icymoon.commands.lidar import find_lidar
from icymoon.settings.preset_files import LIDARS, lidar_names


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
        (["--seed", "-1"], "--seed is -1"),
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


def test_each_shipped_scanner_is_found_by_its_name():
    assert [find_lidar(name) for name in lidar_names()] == [LIDARS / f"{name}.toml" for name in lidar_names()]

"""Reading a folder of the POLAR data, and what is wrong with one."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.support.errors import IcyMoonError
from icymoon.validation.polar.data_set import EYES, ROCK, SHADOW, View, read_terrains
from polar_folders import EGGS, SAND_M, write_polar_folder


def test_a_folder_is_read_as_it_was_written(tmp_path):
    write_polar_folder(tmp_path)
    (terrain,) = read_terrains(tmp_path)
    assert (terrain.name, terrain.positions, terrain.azimuths) == ("07", ["A"], [30])
    assert terrain.views == [View("A", eye) for eye in EYES]
    assert len(terrain.rocks) == len(EGGS)
    for kind in (ROCK, SHADOW):
        assert len(terrain.polygons(View("A", "R"), 30, kind)) == len(EGGS)
    assert min(rock.vertices[:, 2].min() for rock in terrain.rocks) == pytest.approx(SAND_M)


def test_two_terrains_are_two(tmp_path):
    for name in ("07", "11"):
        write_polar_folder(tmp_path, name)
    assert [terrain.name for terrain in read_terrains(tmp_path)] == ["07", "11"]


def _remove(folder, pattern):
    for path in folder.glob(pattern):
        path.unlink()


def _write(folder, name, text):
    (folder / name).write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("damage", "word"),
    [
        (lambda folder: _remove(folder, "rocks/*"), "rocks has no files"),
        (lambda folder: _remove(folder, "labels/*"), "labels has no files"),
        (
            lambda folder: (folder / "rocks" / "terrain07_rock1.obj").rename(folder / "rocks" / "terrain09_rock1.obj"),
            "terrain 09 has labels or rocks, but not both",
        ),
        (lambda folder: _remove(folder, "rocks/*_rock[1-5].obj"), "has 5 rocks, too few .* at least 3 of its others"),
        (lambda folder: _remove(folder, "labels/*_R.txt"), "no photograph of position A, eye R"),
        (lambda folder: _write(folder, "labels/07_D_off_30_L.txt", ""), "no survey of camera position D"),
        (lambda folder: _write(folder, "labels/07_A_off_45_L.txt", ""), "lamp at 45°"),
        (lambda folder: _write(folder, "labels/07_A_off_30_L.txt", "2 0.1 0.2 0.3"), "line 1: is not a polygon"),
        (
            lambda folder: _write(folder, "labels/07_A_off_30_L.txt", "2 0.1 0.2 0.3 nan 0.5 0.6"),
            "line 1: is not a polygon",
        ),
        (lambda folder: _write(folder, "labels/07_A_off_30_L.txt", "\n"), "line 1: is not a polygon"),
        (
            lambda folder: _write(folder, "labels/07_A_off_30_L.txt", "2 968 608 970 610 960 600"),
            "corner at 970, which is not a share .* 1936 columns and 1216 rows",
        ),
        (lambda folder: (folder / "labels" / "07_A_off_30_L.txt").write_bytes(b"\xff\xd8\xff"), "is not text"),
        (lambda folder: _write(folder, "rocks/terrain07_rock3.obj", "v 1 2 3\nf 1 2 3"), "face of line 2 has vertex 3"),
        (lambda folder: _write(folder, "rocks/terrain07_rock3.obj", "v 1 2 x"), "vertex of line 1 is not"),
    ],
)
def test_what_is_wrong_with_a_folder_is_one_sentence(tmp_path, damage, word):
    write_polar_folder(tmp_path)
    damage(tmp_path)
    with pytest.raises(IcyMoonError, match=word):
        read_terrains(tmp_path)


@pytest.mark.parametrize("scale", [1000.0, 0.001])
def test_a_mesh_that_is_not_in_metres_is_refused(tmp_path, scale):
    write_polar_folder(tmp_path, scale=scale)
    with pytest.raises(IcyMoonError, match="export it in metres"):
        read_terrains(tmp_path)


@pytest.mark.parametrize(("options", "word"), [([], "pass --polar FOLDER"), (["--polar", "nowhere"], "no folder")])
def test_the_command_without_data_names_where_they_are(tmp_path, capsys, options, word):
    assert main(["validate", "--only", "polar", "--out", str(tmp_path), *options]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert word in printed
    assert "github.com/uwsbel/POLAR-Sim" in printed


def test_numbers_of_instances_may_stand_before_the_corners(tmp_path):
    write_polar_folder(tmp_path)
    path = tmp_path / "labels" / "07_A_off_30_L.txt"
    before = read_terrains(tmp_path)[0].polygons(View("A", "L"), 30, ROCK)
    path.write_text(
        "\n".join(line.replace(" ", " 5 ", 1) for line in path.read_text(encoding="utf-8").splitlines()),
        encoding="utf-8",
    )
    after = read_terrains(tmp_path)[0].polygons(View("A", "L"), 30, ROCK)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))

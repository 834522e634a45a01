"""Rocks of the user's own table: read as they are written, refused by their line, put where they are stated."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.rocks.place_rocks import scatter_rocks
from icymoon.physics.rocks.rock_shapes import make_rock_shapes
from icymoon.physics.rocks.rock_table import covered_share, read_rock_table
from icymoon.settings.description import defaults
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError


def written(tmp_path, text: str):
    path = tmp_path / "rocks.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_are_found_by_name_and_the_largest_come_first(tmp_path):
    path = written(tmp_path, "name, diameter_m,y_m,x_m\na,0.5,2,1\n\nb,1.5,-3,4\n")
    assert read_rock_table(path).tolist() == [[4, -3, 1.5], [1, 2, 0.5]]
    assert covered_share(read_rock_table(path), 10.0) == pytest.approx(np.pi / 4 * (0.25 + 2.25) / 100)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x_m,y_m\n1,2\n", "diameter_m"),
        ("x_m,y_m,diameter\n", "'diameter'"),
        ("x_m,y_m,diameter_m\n1,2,3\n1,2\n", "line 3"),
        ("x_m,y_m,diameter_m\n1,2,big\n", "line 2"),
        ("x_m,y_m,diameter_m\n1,nan,1\n", "line 2"),
        ("x_m,y_m,diameter_m\n1,1,1\n0,0,0\n", "line 3"),
    ],
)
def test_what_is_no_rock_is_refused_by_its_line(tmp_path, text, words):
    with pytest.raises(IcyMoonError, match=words):
        read_rock_table(written(tmp_path, text))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(IcyMoonError, match=r"none\.csv.*rocks\.file"):
        read_rock_table(tmp_path / "none.csv")


def test_rocks_are_where_the_table_has_them(tmp_path):
    path = written(tmp_path, "x_m,y_m,diameter_m\n1,2,0.5\n-3,4,1.0\n50,0,2\n")
    rocks = defaults().rocks | {"law": "TABLE", "file": str(path), "coverage": 0.1, "clear_radius_m": 0.0}
    shapes = make_rock_shapes(rocks.family, rocks.angularity, 1)

    def ground(x: Array, y: Array) -> Array:
        return np.where(np.maximum(np.abs(x), np.abs(y)) <= 10.0, 0.1 * x, np.nan)

    found = scatter_rocks(rocks, 20.0, 1, ground, shapes, (0.0, 0.0, -np.inf))
    # The third lies beyond the ground, where none is.
    assert found.position_m[:, :2].tolist() == [[-3, 4], [1, 2]]
    assert found.diameter_m.tolist() == [1.0, 0.5]
    few = scatter_rocks(rocks | {"most": 1}, 20.0, 1, ground, shapes, (0.0, 0.0, -np.inf))
    assert few.smallest_m == 2.0, "what is left out is told"

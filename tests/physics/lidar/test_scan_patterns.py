"""The directions of scan patterns against the angles that they state."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.lidar.scan_patterns import ScanPattern
from icymoon.support.errors import IcyMoonError


def angles_of(direction):
    """Azimuth and elevation (n,) in degrees."""
    return np.degrees(np.arctan2(direction[:, 1], direction[:, 0])), np.degrees(np.arcsin(direction[:, 2]))


def test_a_spinning_scanner_fires_its_rows_together_and_turns_from_x_to_y():
    pattern = ScanPattern("SPINNING", 4, 8, 360, 40, -10, 0.1)
    beams = pattern.make_beams()
    azimuth, elevation = angles_of(beams.direction)
    assert np.linalg.norm(beams.direction, axis=1) == pytest.approx(np.ones(32), rel=1e-15)
    assert elevation[:4] == pytest.approx([5, -5, -15, -25])
    assert np.diff(azimuth[::4]) == pytest.approx(np.full(7, 45))
    assert azimuth[:4] == pytest.approx(np.full(4, -157.5))
    assert beams.time_s[:9] == pytest.approx([0] * 4 + [0.0125] * 4 + [0.025])


def test_a_raster_goes_row_by_row_from_left_to_right():
    beams = ScanPattern("RASTER", 2, 3, 30, 10, 0, 0.6).make_beams()
    azimuth, elevation = angles_of(beams.direction)
    assert azimuth == pytest.approx([10, 0, -10] * 2, abs=1e-12)
    assert elevation == pytest.approx([2.5] * 3 + [-2.5] * 3)
    assert beams.time_s == pytest.approx(np.arange(6) / 10)


def test_the_beams_of_a_flash_go_through_the_pixels_of_a_pinhole():
    pattern = ScanPattern("FLASH", 6, 8, 60, 45, -30)
    beams = pattern.make_beams()
    lower = np.radians(30)
    turn = np.array([[np.cos(lower), 0, np.sin(lower)], [0, 1, 0], [-np.sin(lower), 0, np.cos(lower)]])
    own = beams.direction @ turn  # in the axes of the tilted camera
    across = (own[:, 1] / own[:, 0]).reshape(6, 8)
    upward = (own[:, 2] / own[:, 0]).reshape(6, 8)
    half = np.tan(np.radians(30)), np.tan(np.radians(22.5))
    assert across[3] == pytest.approx(half[0] * (1 - (2 * np.arange(8) + 1) / 8))
    assert upward[:, 2] == pytest.approx(half[1] * (1 - (2 * np.arange(6) + 1) / 6))
    assert not beams.time_s.any()


@pytest.mark.parametrize("kind", ["SPINNING", "RASTER", "FLASH"])
def test_parts_of_a_pattern_are_the_whole(kind):
    pattern = ScanPattern(kind, 5, 7, 80, 20, 3)
    whole, parts = pattern.make_beams(), [pattern.make_beams(first, first + 4) for first in range(0, 35, 4)]
    for name in ("direction", "row", "column", "time_s"):
        assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))


@pytest.mark.parametrize(
    ("values", "part"),
    [
        (("RASTER", 0, 5, 10, 10), "no beams"),
        (("RASTER", 5, -1, 10, 10), "no beams"),
        (("RASTER", 10**5, 10**5, 10, 10), "reduce lidar.rows"),
        (("FLASH", 5, 5, 180, 10), "at most 170°"),
        (("SPINNING", 5, 5, 360, 181), "180°"),
        (("SPINNING", 5, 5, float("nan"), 10), "nan° wide"),
        (("RASTER", 5, 5, 10, 10, 0, -1), "takes -1 s"),
    ],
)
def test_an_impossible_pattern_is_one_sentence(values, part):
    with pytest.raises(IcyMoonError, match=part) as found:
        ScanPattern(*values)
    assert str(found.value).count(". ") == 0


@pytest.mark.parametrize("kind", ["SPINNING", "RASTER", "FLASH"])
@pytest.mark.parametrize(("rows", "columns"), [(40, 70), (3, 500), (1, 1)])
def test_spread_beams_are_those_of_the_scan_with_its_corners(kind, rows, columns):
    pattern = ScanPattern(kind, rows, columns, 60, 30, -5)
    number = pattern.choose_spread(5, 9)
    assert len(number) == len(np.unique(number)) == min(rows, 5) * min(columns, 9)
    every, chosen = pattern.make_beams(), pattern.make_chosen(number)
    assert chosen.direction.tolist() == every.direction[number].tolist()
    assert chosen.time_s.tolist() == every.time_s[number].tolist()
    assert {0, rows - 1} == {int(chosen.row.min()), int(chosen.row.max())}
    assert {0, columns - 1} == {int(chosen.column.min()), int(chosen.column.max())}

"""Which points of a LiDAR's scan a view shows, and in which colours."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from icymoon.stereo import lidar_view
from icymoon.stereo.export.lidar import ScanPoints
from icymoon.stereo.images.colours import INVALID_GREY
from icymoon.stereo.lidar_view import (
    ICE_DELAY,
    INTENSITY,
    RANGE_ERROR,
    RETURN_NUMBER,
    colour_points,
    describe_colours,
    list_values,
    read_shown_points,
)
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import write_json
from lidar_scans import ALONG, POSE, write_folder


def test_points_lie_where_they_were_measured_with_their_values(tmp_path):
    shown = read_shown_points([write_folder(tmp_path, measured=True)])
    order = np.argsort(shown.range_m)
    assert shown.range_m[order].tolist() == [2.5, 4.25, 9.0]  # the lost return is no point
    assert shown.point_m[order[:2]] == pytest.approx(POSE.position_m + ALONG[[0, 2]] * [[2.5], [4.25]])
    assert shown.error_m[order[:2]] == pytest.approx([0.625, 0.375])
    assert shown.order[order].tolist() == [1, 1, 0]  # the last is a false alarm
    assert shown.ice_m[order].tolist() == [0.04, 0.06, 0.0]
    assert (shown.total, shown.title, shown.beams, shown.returned) == (3, "Test", 6, 2)


def test_points_of_several_scans_are_seen_from_their_own_places(tmp_path):
    folders = [write_folder(tmp_path / name, measured=True) for name in ("a", "b")]
    facts = json.loads((folders[1] / "lidar.json").read_text(encoding="utf-8"))
    write_json(folders[1] / "lidar.json", facts | {"position_m": [0.0, 0.0, 9.0]})
    shown = read_shown_points(folders)
    assert (shown.total, shown.beams, shown.returned) == (6, 12, 4)
    places = [tuple(place) for place in shown.position_m.tolist()]
    assert sorted(places) == sorted([tuple(POSE.position_m.tolist()), (0.0, 0.0, 9.0)] * 3)


def test_fewer_points_are_the_first_of_more_whatever_the_parts(monkeypatch):
    def make_part(first: int, end: int) -> ScanPoints:
        x = np.arange(first, end, dtype=float)
        return ScanPoints(np.stack([x, x, x], 1), *[x] * 11)

    def read(parts: list[tuple[int, int]], most: int) -> list[float]:
        monkeypatch.setattr(lidar_view, "read_points", lambda folder, facts: [make_part(*part) for part in parts])
        return read_shown_points([tmp], most).range_m.tolist()

    tmp = Path("anywhere")
    facts = {"position_m": [0, 0, 0], "returns": 400, "beams": 500, "beams_without_return": 100}
    monkeypatch.setattr(lidar_view, "read_facts", lambda folder: facts)
    every = read([(0, 400)], 1000)
    assert sorted(every) == list(range(400))
    assert read([(0, 400)], 50) == every[:50]
    assert read([(0, 7), (7, 300), (300, 400)], 50) == every[:50]
    # A random part of a scan has its mean: that of 50 of 400 numbers deviates by 400 / sqrt(12 * 50) = 16.
    assert np.mean(every[:50]) == pytest.approx(199.5, abs=4 * 16)


def test_a_scan_without_points_and_a_damaged_one_are_refused(tmp_path, monkeypatch):
    with pytest.raises(IcyMoonError, match=r"lidar\.json is missing; scan the scene again"):
        read_shown_points([tmp_path / "none"])
    folder = write_folder(tmp_path, measured=True)
    monkeypatch.setattr(lidar_view, "read_points", lambda folder, facts: [])
    with pytest.raises(IcyMoonError, match="has no points; scan again with the ground in the range"):
        read_shown_points([folder])
    bad = ScanPoints(np.full((2, 3), np.nan), *[np.zeros(2)] * 11)
    monkeypatch.setattr(lidar_view, "read_points", lambda folder, facts: [bad])
    with pytest.raises(IcyMoonError, match="points without a place"):
        read_shown_points([folder])


#: Two returns that are too far and too near, and a false alarm.
VALUES = {
    INTENSITY: np.array([10.0, 1000.0, 0.0]),
    RANGE_ERROR: np.array([0.2, -0.2, np.nan]),
    ICE_DELAY: np.array([0.0, 0.2, 0.0]),
    RETURN_NUMBER: np.array([1, 9, 0]),
}


def test_colours_rise_with_light_and_delay_and_tell_far_from_near():
    grey = [INVALID_GREY] * 3
    for kind in (INTENSITY, ICE_DELAY):
        low, high, alarm = colour_points(kind, VALUES).astype(int).tolist()
        assert low[2] > low[0]  # viridis begins in violet and ends in yellow
        assert min(high[0], high[1]) > 200 > high[2]
        assert alarm == grey
    far, near, alarm = colour_points(RANGE_ERROR, VALUES).astype(int).tolist()
    assert far[0] > far[2]
    assert near[2] > near[0]
    assert alarm == grey
    assert len(np.unique(colour_points(RETURN_NUMBER, VALUES), axis=0)) == 3


@pytest.mark.parametrize("kind", list(VALUES))
def test_the_legend_states_what_colours_mean(kind):
    told = " ".join(text for text, _ in describe_colours(kind, VALUES))
    assert "alse alarm" in told
    nothing = {name: values[:0] for name, values in VALUES.items()}
    assert describe_colours(kind, nothing)  # nothing is divided by
    assert colour_points(kind, nothing).shape == (0, 3)


def test_values_are_those_of_points(tmp_path):
    shown = read_shown_points([write_folder(tmp_path, measured=False)])
    assert set(list_values(shown)) == set(VALUES)
    assert all(len(values) == len(shown.range_m) for values in list_values(shown).values())

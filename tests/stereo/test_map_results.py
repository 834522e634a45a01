"""Results on the map of the ground: rasterio opens them beside the file, and true depth gives the file's heights."""

from __future__ import annotations

import json

import numpy as np
import pairs
import pytest
from icymoon.formats import geotiff
from icymoon.formats.geotiff import Site
from icymoon.formats.map_point import MapPoint
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.evaluate_while_rendering import measure_completed_pairs
from icymoon.stereo.map_results import (
    MEASURED,
    MISSING,
    NOT_SEEN,
    OCCLUDED,
    choose_cell_m,
    find_map_frame,
    make_cells,
    name_maps,
    write_maps,
)
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.support.errors import IcyMoonError
from map_systems import EUROPA_M, POLAR

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")

pytestmark = [pytest.mark.filterwarnings("ignore:Use `@` matmul"), pytest.mark.usefixtures("undrawn")]

ZERO_M = 1200.0
#: A polar map about 60° south, where a metre of it is 0.933 m of ground; its heights are those of the pair's plane.
PLACE = (418215.1, 724369.8)


def write_sited_pair(tmp_path, rock=False):
    """A pair that looks down on the plane of ``pairs.Scene`` from 3 m above the origin of a site, and its map."""
    scene = pairs.Scene(rock=rock)
    folder = pairs.write_pair(tmp_path / "pair", scene, rig=pairs.camera(192, 96))
    size, pixel = 161, 0.25
    corner = PLACE[0] - size * pixel / 2, PLACE[1] + size * pixel / 2
    transform = rasterio.transform.from_origin(*corner, pixel, pixel)
    profile = {"driver": "GTiff", "width": size, "height": size, "count": 1, "dtype": "float64", "crs": POLAR}
    with rasterio.open(tmp_path / "dem.tif", "w", **profile, transform=transform) as out:
        out.write(np.zeros((size, size)), 1)
    place = geotiff.read_place(tmp_path / "dem.tif", Site(True, (0.0, 0.0), 30.0, EUROPA_M, MapPoint(*PLACE, False)))
    assert place is not None
    scale = place.scale
    # z from the plane: the camera at 3 m looks down with its upper edge in the north, so x is east and y south.
    with rasterio.open(tmp_path / "dem.tif", "r+") as out:
        column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
        east = (corner[0] + column * pixel - PLACE[0]) * scale[0]
        south = -(corner[1] - row * pixel - PLACE[1]) * scale[1]
        out.write(ZERO_M + 3.0 - (scene.distance_m - scene.slope_x * east - scene.slope_y * south), 1)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 3.0
    path = folder / "pair.json"
    data = json.loads(path.read_text())
    right = pose.copy()
    right[0, 3] += data["camera"]["baseline_m"]
    poses = {"left": pose.tolist(), "right": right.tolist()}
    ground = {"map": place.to_json() | {"height_zero_m": ZERO_M}}
    path.write_text(
        json.dumps(data | {"poses_camera_to_world": poses, "edited_by_hand": True, "ground": ground}), encoding="utf-8"
    )
    return folder, scene


def read_maps(files):
    found = {}
    for kind, path in files.items():
        with rasterio.open(path) as opened:
            found[kind] = opened.read(1, masked=True), opened.profile, opened.bounds, opened.transform
    return found


def test_true_depth_gives_back_the_heights_of_the_file(tmp_path):
    folder, scene = write_sited_pair(tmp_path)
    prepared = prepare_pair(folder, {})
    frame = find_map_frame(prepared)
    assert frame is not None
    (method,) = parse_methods("sgbm")
    files = {kind: tmp_path / name for kind, name in name_maps(method, 0.0).items()}
    write_maps(prepared, frame, prepared.pair.camera.disparity(prepared.truth), files)
    with rasterio.open(tmp_path / "dem.tif") as source:
        heights, bounds, crs, transform = source.read(1), source.bounds, source.crs, source.transform
    maps = read_maps(files)
    for _, profile, edges, _ in maps.values():
        assert profile["crs"] == crs
        assert bounds.left <= edges.left < edges.right <= bounds.right
        assert bounds.bottom <= edges.bottom < edges.top <= bounds.top
    values, profile, _, placed = maps["height_map"]
    # Cells are square on the ground.
    cell = choose_cell_m(prepared.truth[prepared.known], prepared.pair.camera)
    assert (placed.a * frame.scale[0], -placed.e * frame.scale[1]) == pytest.approx((cell, cell), rel=1e-9)
    rows, columns = np.nonzero(~np.ma.getmaskarray(values))
    assert len(rows) > 200
    x, y = placed * (columns + 0.5, rows + 0.5)
    column, row = (~transform) * (x, y)
    i, j = (row - 0.5).astype(int), (column - 0.5).astype(int)
    u, v = column - 0.5 - j, row - 0.5 - i
    there = (heights[i, j] * (1 - u) + heights[i, j + 1] * u) * (1 - v) + (
        heights[i + 1, j] * (1 - u) + heights[i + 1, j + 1] * u
    ) * v
    off = values.compressed() - there
    # The median point of a cell is off its middle by half a cell at most, along the slope; a plane has no other error
    # but that of a 32-bit float at 1200 m. On average points are about the middle.
    slope = np.hypot(scene.slope_x, scene.slope_y)
    assert np.abs(off).max() < slope * cell / np.sqrt(2) + 2e-4
    assert abs(off.mean()) < 0.1 * slope * cell
    assert np.abs(maps["height_error_map"][0]).max() < 1e-12
    np.testing.assert_array_equal(maps["true_height_map"][0].filled(0)[rows, columns], values.compressed())


def test_errors_and_classes_are_the_matchers(tmp_path):
    """Depths 1 % too large are heights too low; a strip is missing, and so is what the right eye does not see."""
    folder, _ = write_sited_pair(tmp_path, rock=True)
    prepared = prepare_pair(folder, {})
    frame = find_map_frame(prepared)
    assert frame is not None
    disparity = prepared.pair.camera.disparity(prepared.truth) / 1.01
    disparity[:, 100:130] = np.nan
    disparity[~prepared.visible] = np.nan
    (method,) = parse_methods("sgbm")
    files = {kind: tmp_path / name for kind, name in name_maps(method, 0.0).items()}
    write_maps(prepared, frame, disparity, files)
    maps = read_maps(files)
    classes, profile, *_ = maps["class_map"]
    assert profile["nodata"] == NOT_SEEN
    error, height = maps["height_error_map"][0], maps["height_map"][0]
    measured = classes.filled(NOT_SEEN) == MEASURED
    # Where there is an error, points are measured; only cells at the edge of the strip have less than half of them.
    known = ~np.ma.getmaskarray(error)
    assert measured[known].mean() > 0.95
    np.testing.assert_array_equal(classes.filled(NOT_SEEN) != NOT_SEEN, ~np.ma.getmaskarray(maps["true_height_map"][0]))
    # 1 % of the distance below the eye, in the middle of cells without an edge.
    below = ZERO_M + 3.0 - maps["true_height_map"][0]
    assert np.ma.median(error / below) == pytest.approx(-0.01, abs=2e-3)
    np.testing.assert_allclose((height - error - maps["true_height_map"][0]).compressed(), 0.0, atol=3e-4)
    counts = {kind: int((classes.filled(NOT_SEEN) == kind).sum()) for kind in (MEASURED, MISSING, OCCLUDED)}
    assert counts[MISSING] > 20
    assert counts[OCCLUDED] > 0
    assert counts[MEASURED] > counts[MISSING] + counts[OCCLUDED]


def test_maps_that_are_asked_for_later_need_no_matching(tmp_path, monkeypatch):
    folder, _ = write_sited_pair(tmp_path)
    methods = parse_methods("sgbm")
    (before,) = evaluate([folder], methods, tmp_path / "out")["rows"]
    assert "height_map" not in before["images"]
    monkeypatch.setattr("icymoon.stereo.fusion.fuse.match_checked", None)
    (auto,) = evaluate([folder], methods, tmp_path / "out", maps=0.0)["rows"]
    (stated,) = evaluate([folder], methods, tmp_path / "out", maps=0.2)["rows"]
    assert auto["l1_m"] == stated["l1_m"] == before["l1_m"]
    names = {kind: tmp_path / "out" / path for kind, path in stated["images"].items() if kind.endswith("_map")}
    assert names["height_map"].name == "sgbm_height_0.2m.tif"
    for _, _, _, placed in read_maps(names).values():
        assert placed.a == pytest.approx(0.2 / 0.9330127, rel=1e-5)


def test_maps_are_written_while_other_pairs_are_rendered(tmp_path, monkeypatch):
    write_sited_pair(tmp_path / "set" / "pairs")
    looks, methods = iter(range(100)), parse_methods("sgbm")
    measure_completed_pairs(tmp_path / "set", methods, tmp_path / "out", {}, lambda: next(looks) > 2, maps=0.2)
    names = name_maps(methods[0], 0.2).values()
    written = {path.name: path for path in (tmp_path / "out").rglob("*.tif")}
    assert set(written) == set(names)
    monkeypatch.setattr("icymoon.stereo.fusion.fuse.match_checked", None)
    monkeypatch.setattr("icymoon.stereo.measure_pair.write_maps", None)
    (row,) = evaluate([tmp_path / "set"], methods, tmp_path / "out", maps=0.2)["rows"]
    assert {tmp_path / "out" / path for kind, path in row["images"].items() if kind.endswith("_map")} == set(
        written.values()
    )


def test_a_pair_on_no_map_is_still_measured(tmp_path):
    folder = pairs.write_pair(tmp_path / "pair", rig=pairs.camera(192, 96))
    events: list[dict[str, str]] = []
    (row,) = evaluate([folder], parse_methods("sgbm"), tmp_path / "out", on_event=events.append, maps=0.0)["rows"]
    assert row["status"] == "ok"
    assert any("states no map" in event["message"] for event in events if event["type"] == "warning")


def test_cells_end_within_the_file_and_are_refused_where_they_do_not_fit(tmp_path):
    folder, _ = write_sited_pair(tmp_path)
    frame = find_map_frame(prepare_pair(folder, {}))
    assert frame is not None
    west, south, east, north = frame.bounds
    far = np.array([[-1000.0, -1000.0], [1000.0, 1000.0]])
    cells = make_cells(frame, far, 0.7)
    assert (cells.west, cells.north - cells.grid.rows * cells.pixel[1]) == pytest.approx((west, south))
    assert west + (cells.grid.columns + 1) * cells.pixel[0] > east >= west + cells.grid.columns * cells.pixel[0]
    assert cells.north <= north < cells.north + cells.pixel[1]
    with pytest.raises(IcyMoonError, match="larger than the map"):
        make_cells(frame, far, 100.0)
    with pytest.raises(IcyMoonError, match=r"give --maps 0\.018 or more"):
        make_cells(frame, far, 0.001)

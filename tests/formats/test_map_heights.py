"""Heights around a site from files: windows and blocks of any layout give the same means, other projections lie where
PROJ has them, and a map that does not fit is refused in one sentence."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.formats import geotiff, map_heights
from icymoon.formats.geotiff import Site
from icymoon.formats.map_frame import map_frame_from_json
from icymoon.formats.map_heights import read_cover, read_means
from icymoon.formats.map_point import MapPoint
from icymoon.formats.map_surroundings import measure_displacement
from icymoon.physics.mesh.nested_rings import plan_levels
from icymoon.support.errors import IcyMoonError
from map_systems import EUROPA_M, LONLAT, POLAR, write_map

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
warp = pytest.importorskip("rasterio.warp")

pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul", "ignore:The given matrix")

PLACE = (4e5, 7e5)


def write(path, crs, values, pixel, middle, upward=False, **more):
    rows, columns = values.shape
    west, north = middle[0] - columns * pixel / 2, middle[1] + rows * pixel / 2
    transform = rasterio.transform.from_origin(west, north, pixel, pixel)
    if upward:
        transform = rasterio.transform.Affine(pixel, 0, west, 0, pixel, north - rows * pixel)
    return write_map(path, crs, transform, values[::-1] if upward else values, **more)


def make_frame(tmp_path, crs=POLAR, middle=PLACE):
    path = write(tmp_path / "fine.tif", crs, np.zeros((9, 9), np.float32), 0.5, middle)
    place = geotiff.read_place(path, Site(True, (0.0, 0.0), 4.0, 0.0, MapPoint(middle[0], middle[1], False)))
    assert place is not None
    frame = map_frame_from_json({"map": place.to_json() | {"height_zero_m": 0.0}})
    assert frame is not None
    return frame


LEVELS = plan_levels(8, 40.0, 900.0, lambda _: 4.0)


def test_layout_and_memory_change_no_mean(tmp_path, monkeypatch):
    frame = make_frame(tmp_path)
    values = np.random.default_rng(1).normal(size=(517, 530)).astype(np.float32)
    values[200:260, 300:310] = -9999.0
    paths = [
        write(tmp_path / "a.tif", POLAR, values, 4.0, PLACE, nodata=-9999.0),
        write(tmp_path / "b.tif", POLAR, values, 4.0, PLACE, upward=True, nodata=-9999.0),
        write(
            tmp_path / "c.tif", POLAR, values, 4.0, PLACE, nodata=-9999.0, tiled=True, blockxsize=64, blockysize=32,
            compress="deflate",
        ),
    ]  # fmt: skip
    wanted = read_means(paths[0], frame, LEVELS, 30.0, None).levels
    monkeypatch.setattr(map_heights, "_KEPT_PIXELS", 5000)
    monkeypatch.setattr(map_heights, "_BLOCK_PIXELS", 20000)
    monkeypatch.setattr(map_heights, "_BLOCK_WIDTH", 128)
    for path in paths:
        for found, each in zip(read_means(path, frame, LEVELS, 30.0, None).levels, wanted, strict=True):
            np.testing.assert_allclose(found.heights_m, each.heights_m, atol=1e-9)
            np.testing.assert_allclose(found.share, each.share, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "pixel"),
    [
        (f"+proj=eqc +lat_ts=-60 +R={EUROPA_M} +units=m +no_defs", 8.0),
        (f"+proj=stere +lat_0=-90 +lon_0=70 +R={EUROPA_M} +units=m +no_defs", 8.0),
        (LONLAT, 3e-4),
    ],
    ids=["cylindrical", "turned", "degrees"],
)
def test_a_plane_on_another_projection_stays_one(tmp_path, text, pixel):
    """Heights are 0.1 x - 0.05 y of the ground's own map by PROJ. Bilinear between pixels and between places of the
    projection, so within the bend of the other map over a cell: its share of the radius times the slope."""
    frame = make_frame(tmp_path)
    (x,), (y,) = warp.transform(POLAR, text, [PLACE[0]], [PLACE[1]])
    size = 301
    transform = rasterio.transform.from_origin(x - pixel * size / 2, y + pixel * size / 2, pixel, pixel)
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    east, north = transform * (column, row)
    px, py = (np.array(each).reshape(size, size) for each in warp.transform(text, POLAR, east.ravel(), north.ravel()))
    heights = (0.1 * (px - PLACE[0]) - 0.05 * (py - PLACE[1])).astype(np.float32)
    path = write(tmp_path / "other.tif", text, heights, pixel, (x, y))
    found = read_means(path, frame, LEVELS, 0.0, None).levels
    for level, each in zip(LEVELS, found, strict=True):
        at = level.axis_m
        wanted = 0.1 * at[None, :] / frame.scale[0] - 0.05 * at[:, None] / frame.scale[1]
        inside = each.share > 1 - 1e-9
        assert inside.mean() > 0.5
        bend = level.half_m * level.cell_m / EUROPA_M + level.half_m**2 / 33**2 / EUROPA_M
        assert np.abs(each.heights_m - wanted)[inside].max() < 0.2 * bend + 2e-4


def test_longitudes_to_180_and_to_360_meet(tmp_path):
    frame = make_frame(tmp_path, LONLAT, (-20.0, -30.0))
    path = write(tmp_path / "all.tif", LONLAT, np.full((90, 361), 5.0, np.float32), 1.0, (180.0, -40.0))
    for each in read_means(path, frame, LEVELS, 0.0, None).levels:
        np.testing.assert_allclose(each.heights_m, 5.0)


def test_a_map_that_does_not_fit_is_refused_in_one_sentence(tmp_path):
    frame = make_frame(tmp_path)
    zeros = np.zeros((50, 50), np.float32)
    far = write(tmp_path / "far.tif", POLAR, zeros, 100.0, (9e5, 7e5))
    with pytest.raises(
        IcyMoonError, match=r"does not contain the site, which is at 400000 east, 700000 north .* from 8"
    ):
        read_means(far, frame, LEVELS, 0.0, None)
    mars = write(tmp_path / "mars.tif", POLAR.replace(str(EUROPA_M), "3396190"), zeros, 100.0, PLACE)
    with pytest.raises(IcyMoonError, match=r"3396\.19 km.*give a map of the same body"):
        read_cover(mars, frame)
    pole = make_frame(tmp_path, POLAR, (0.0, 0.0))
    globe = write(tmp_path / "globe.tif", LONLAT, np.zeros((180, 360), np.float32), 1.0, (0.0, 0.0))
    with pytest.raises(
        IcyMoonError, match=r'bent or torn around the site; .* gdalwarp -t_srs "\+proj=stere .* globe\.tif'
    ):
        read_means(globe, pole, LEVELS, 0.0, None)


def test_a_usual_mark_that_the_file_does_not_state_is_told(tmp_path):
    frame = make_frame(tmp_path)
    values = np.full((500, 500), 5.0, np.float32)
    values[100:120, 100:120] = -9999.0
    path = write(tmp_path / "a.tif", POLAR, values, 4.0, PLACE)
    found = read_means(path, frame, LEVELS, 0.0, None)
    assert "exactly -9999" in found.warnings[0]
    assert not read_means(path, frame, LEVELS, 0.0, -9999.0).warnings


def test_the_cover_of_a_map_is_in_metres_of_ground(tmp_path):
    frame = make_frame(tmp_path)
    path = write(tmp_path / "a.tif", POLAR, np.zeros((100, 200), np.float32), 10.0, (PLACE[0] + 300.0, PLACE[1]))
    cover, scale = read_cover(path, frame), frame.scale[0]
    assert cover.pixel_m == pytest.approx(10.0 * scale)
    assert cover.farthest_m == pytest.approx(1300.0 * scale)
    assert cover.nearest_m == pytest.approx(500.0 * scale)


def test_displacement_is_that_of_proj(tmp_path):
    """Of a Mercator map, over 100 km, beside an orthographic map about the site."""
    text = f"+proj=merc +R={EUROPA_M} +units=m +no_defs"
    frame = make_frame(tmp_path, text, (4e5, 2e6))
    assert frame.system is not None
    found = measure_displacement(frame, frame.system, 1e5)
    (longitude,), (latitude,) = warp.transform(text, LONLAT, [4e5], [2e6])
    local = f"+proj=ortho +lat_0={latitude} +lon_0={longitude} +R={EUROPA_M} +units=m +no_defs"
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    x, y = 1e5 * np.cos(turn), 1e5 * np.sin(turn)
    there = warp.transform(text, local, 4e5 + x / frame.scale[0], 2e6 + y / frame.scale[1])
    wanted = np.hypot(np.array(there[0]) - x, np.array(there[1]) - y).max() / 1e5
    assert found == pytest.approx(wanted, rel=1e-4)
    assert found > 0.02

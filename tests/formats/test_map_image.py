"""Images that lie by their own coordinate system: each value is where PROJ and rasterio have it, and gaps are told."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.formats import geotiff
from icymoon.formats.geotiff import Site
from icymoon.formats.map_frame import MapFrame, map_frame_from_json
from icymoon.formats.map_image import MapImage, read_map_image
from icymoon.formats.map_point import MapPoint
from icymoon.support.errors import IcyMoonError
from map_systems import EUROPA_M, LONLAT, POLAR, write_map

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
warp = pytest.importorskip("rasterio.warp")

pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul", "ignore:The given matrix")

SIZE_M = 40.0
#: Systems of the image, and the size of its pixels in its unit.
SYSTEMS = {
    "km": (f"+proj=stere +lat_0=-90 +R={EUROPA_M} +units=km +no_defs", 0.0005),
    "turned": (f"+proj=stere +lat_0=-90 +lon_0=70 +R={EUROPA_M} +units=m +no_defs", 0.5),
    "cylindrical": (f"+proj=eqc +lat_ts=-60 +R={EUROPA_M} +units=m +no_defs", 0.5),
    "degrees": (LONLAT, 2e-5),
    "sinusoidal": (f"+proj=sinu +lon_0=10 +R={EUROPA_M} +units=m +no_defs", 0.5),
}


def make_frame(tmp_path, longitude=30.0, latitude=-60.0, text=POLAR) -> MapFrame:
    """The frame of a site on a polar map of 1 m pixels about it."""
    (x,), (y,) = warp.transform(LONLAT, text, [longitude], [latitude])
    transform = rasterio.transform.from_origin(x - 50.25, y + 50.5, 1.0, 1.0)
    write_map(tmp_path / "dem.tif", text, transform, np.ones((101, 101), np.float32))
    site = Site(True, (0.0, 0.0), SIZE_M, 0.0, MapPoint(longitude, latitude, True))
    place = geotiff.read_place(tmp_path / "dem.tif", site)
    assert place is not None
    frame = map_frame_from_json({"map": place.to_json() | {"height_zero_m": 0.0}})
    assert frame is not None
    return frame


def centres(found: MapImage):
    """East and north of the middles of the pixels in the frame of the site, (rows, columns)."""
    rows, columns = found.values.shape
    east = found.west_m + (np.arange(columns) + 0.5) * found.pixel_m[0]
    north = found.south_m + (np.arange(rows)[::-1] + 0.5) * found.pixel_m[1]
    return np.meshgrid(east, north)


@pytest.mark.parametrize("upward", [False, True])
def test_pixels_in_the_system_of_the_ground_stay_to_a_millionth_of_a_pixel(tmp_path, upward):
    """Another origin, size and extent, scale and offset, and rows that run north."""
    frame = make_frame(tmp_path)
    x, y = (at / frame.unit_m for at in frame.origin)
    rows, columns, pixel = 300, 260, 0.3
    top = y + 41.11
    transform = rasterio.transform.Affine(
        pixel, 0, x - 33.33, 0, pixel if upward else -pixel, top - rows * pixel if upward else top
    )
    stored = np.random.default_rng(1).integers(1, 10000, (rows, columns)).astype(np.uint16)
    path = write_map(tmp_path / "a.tif", POLAR, transform, stored, scales=(1e-4,), offsets=(0.05,))
    found = read_map_image(path, frame, SIZE_M)
    easting, northing = frame.to_map(*centres(found))
    column, row = (~transform) * (easting, northing)
    # The middles of our pixels are middles of the file's, and the values are theirs.
    assert np.abs(column - np.floor(column) - 0.5).max() < 1e-6
    assert np.abs(row - np.floor(row) - 0.5).max() < 1e-6
    np.testing.assert_allclose(
        found.values, stored[row.astype(int), column.astype(int)] * 1e-4 + 0.05, rtol=0, atol=1e-12
    )
    assert found.covered == 1.0
    assert not found.warnings
    inside = np.maximum(*map(np.abs, centres(found))) <= SIZE_M / 2
    assert found.mean == pytest.approx(found.values[inside].mean(), rel=1e-12)


@pytest.mark.parametrize("name", SYSTEMS)
def test_values_from_another_projection_are_where_proj_has_them(tmp_path, name):
    """Its values are a plane and a wave of its own coordinates; bilinear between pixels of a wave of 20 pixels is right
    to (2 pi / 20)² / 8 = 1.2 % of the amplitude, once or twice."""
    frame = make_frame(tmp_path)
    text, pixel = SYSTEMS[name]
    (x,), (y,) = warp.transform(LONLAT, text, [30.0], [-60.0])
    n = 300
    transform = rasterio.transform.from_origin(x - n * pixel / 2, y + n * pixel / 2, pixel, pixel)
    at = np.arange(n) + 0.5

    def law(column, row):
        return 0.5 + 0.001 * (column - n / 2) + 0.0005 * (row - n / 2) + 0.1 * np.sin(2 * np.pi * (column + row) / 28)

    path = write_map(tmp_path / "a.tif", text, transform, law(at[None, :], at[:, None]).astype(np.float32))
    found = read_map_image(path, frame, SIZE_M)
    easting, northing = frame.to_map(*centres(found))
    inside = np.maximum(*map(np.abs, centres(found))) <= SIZE_M / 2
    xs, ys = map(np.array, warp.transform(POLAR, text, easting[inside], northing[inside]))
    column, row = (~transform) * (xs, ys)
    assert np.abs(found.values[inside] - law(column, row)).max() < 0.1 * 2 * (2 * np.pi / 20) ** 2 / 8
    assert found.covered == 1.0
    # Its pixels are about as wide as in the file.
    assert 0.25 < min(found.pixel_m) < max(found.pixel_m) < 0.7


def test_the_line_of_180_degrees_is_no_edge(tmp_path):
    frame = make_frame(tmp_path, 180.0, 5.0, f"+proj=eqc +lon_0=180 +R={EUROPA_M} +units=m +no_defs")
    pixel = 2e-5
    for west in (180.0 - 1e-3, -180.0 - 1e-3):  # to 360, or from beyond -180
        transform = rasterio.transform.from_origin(west, 5.0 + 1e-3, pixel, pixel)
        columns = np.broadcast_to(np.arange(100, dtype=np.float32) + 1, (100, 100)).copy()
        found = read_map_image(write_map(tmp_path / "a.tif", LONLAT, transform, columns), frame, SIZE_M)
        assert found.covered == 1.0
        easting, _ = frame.to_map(*centres(found))
        degrees = np.degrees(easting / EUROPA_M)  # east of the line
        inside = np.maximum(*map(np.abs, centres(found))) <= SIZE_M / 2
        np.testing.assert_allclose(found.values[inside], ((degrees + 1e-3) / pixel + 0.5)[inside], rtol=0, atol=1e-3)


def test_ground_without_a_value_has_the_mean_and_is_told(tmp_path):
    frame = make_frame(tmp_path)
    x, y = frame.origin
    values = np.full((100, 50), 0.4, np.float32)  # the west half of the ground, and more to the north
    values[:50] = 0.6
    values[60:70, :40] = -1.0  # marked as missing
    transform = rasterio.transform.from_origin(x - 50, y + 50, 1.0, 1.0)
    found = read_map_image(write_map(tmp_path / "a.tif", POLAR, transform, values, nodata=-1.0), frame, SIZE_M)
    east, north = centres(found)
    inside = np.maximum(np.abs(east), np.abs(north)) <= SIZE_M / 2
    scale = frame.scale[0]  # the map's metres are not the ground's
    known = (east < 0) & ~((north < -10 * scale) & (north > -20 * scale) & (east < -10 * scale))
    wanted = np.where(north > 0, 0.6, 0.4)
    np.testing.assert_allclose(found.values[inside & known], wanted[inside & known], atol=1e-6)
    assert found.mean == pytest.approx(wanted[inside & known].mean(), rel=1e-6)
    np.testing.assert_allclose(found.values[inside & ~known], found.mean)
    assert found.covered == pytest.approx((inside & known).sum() / inside.sum())
    (told,) = found.warnings
    assert f"{100 * (1 - found.covered):.2g} % of the ground has no value in a.tif" in told
    assert f"{found.mean:.4g}" in told


def refuse(tmp_path, pattern, text=POLAR, shift=(0.0, 0.0), values=None, unplaced=False):
    frame = make_frame(tmp_path)
    radius = float(text.split("+R=")[1].split()[0]) if "+R=" in text else None
    body = f"+proj=longlat +R={radius} +no_defs" if radius else "EPSG:4326"
    (x,), (y,) = warp.transform(body, text, [30.0], [-60.0])
    transform = rasterio.transform.from_origin(x - 50 + shift[0], y + 50 + shift[1], 1.0, 1.0)
    values = np.ones((100, 100), np.float32) if values is None else values
    write_map(
        tmp_path / "a.tif", None if unplaced else text, rasterio.Affine.identity() if unplaced else transform, values
    )
    with pytest.raises(IcyMoonError, match=pattern) as caught:
        read_map_image(tmp_path / "a.tif", frame, SIZE_M)
    return str(caught.value)


def test_an_image_elsewhere_is_a_sentence_with_its_extent(tmp_path):
    told = refuse(tmp_path, "no values over the ground", shift=(1000.0, 0.0))
    with rasterio.open(tmp_path / "a.tif") as opened:
        assert all(f"{edge:.10g}" in told for edge in opened.bounds)


def test_images_that_cannot_be_placed_are_sentences(tmp_path):
    refuse(tmp_path, "map of the same body", text="+proj=stere +lat_0=-90 +R=252100 +units=m +no_defs")
    refuse(tmp_path, "no coordinate system.*gdal_edit", unplaced=True)
    refuse(tmp_path, "mean of 0", values=np.zeros((100, 100), np.float32))


def test_a_projection_that_is_not_known_is_answered_with_a_command_that_works(tmp_path):
    """gdalwarp's own engine, which rasterio has, makes the file that is then read."""
    text = f"+proj=moll +R={EUROPA_M} +units=m +no_defs"
    told = refuse(tmp_path, "unsupported projection; project it", text=text)
    target = told.split('-t_srs "')[1].split('"')[0]
    with rasterio.open(tmp_path / "a.tif") as source:
        transform, width, height = warp.calculate_default_transform(
            source.crs, target, source.width, source.height, *source.bounds
        )
        made = np.full((height, width), np.nan, np.float32)
        warp.reproject(
            source.read(1),
            made,
            src_transform=source.transform,
            src_crs=source.crs,
            dst_transform=transform,
            dst_crs=target,
            dst_nodata=np.nan,
        )
    write_map(tmp_path / "new.tif", target, transform, made, nodata=np.nan)
    found = read_map_image(tmp_path / "new.tif", make_frame(tmp_path), SIZE_M)
    assert found.covered == 1.0
    assert found.mean == pytest.approx(1.0, abs=1e-6)


def test_an_image_beyond_the_patch_ends_in_the_mean_of_the_patch(tmp_path):
    """Its pixels go on out to the wider square, and the outermost ones, which the surface repeats, are the mean."""
    frame = make_frame(tmp_path)
    x, y = (at / frame.unit_m for at in frame.origin)
    values = np.random.default_rng(4).uniform(0.4, 0.6, (400, 400)).astype(np.float32)
    path = write_map(tmp_path / "a.tif", POLAR, rasterio.transform.from_origin(x - 100, y + 100, 0.5, 0.5), values)
    patch, wide = read_map_image(path, frame, SIZE_M), read_map_image(path, frame, SIZE_M, 120.0)
    assert wide.mean == patch.mean
    assert wide.west_m < -60.0 < patch.west_m
    for edge in (wide.values[0], wide.values[-1], wide.values[:, 0], wide.values[:, -1]):
        np.testing.assert_array_equal(edge, wide.mean)
    left = round((patch.west_m - wide.west_m) / patch.pixel_m[0])
    low = round((patch.south_m - wide.south_m) / patch.pixel_m[1])
    rows, columns = patch.values.shape
    top = len(wide.values) - low - rows
    np.testing.assert_array_equal(wide.values[top : top + rows, left : left + columns], patch.values)

"""Height maps: interpolation, holes, placing, added roughness, and GeoTIFF bytes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.formats import geotiff
from icymoon.physics.mesh import height_map
from icymoon.physics.mesh.height_map import HeightMap, fill_holes, place_map
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from tiffs import write_tiff


def bumpy(rows: int = 12, columns: int = 17) -> Array:
    return np.random.default_rng(3).normal(0, 100, (rows, columns))


def test_heights_at_pixel_centres_are_the_pixels_row_0_being_north():
    values = bumpy()
    ground = HeightMap(values, (2.0, 0.5), 10.0, -3.0, 1000.0)
    x, y = 10.0 + 2.0 * np.arange(17), -3.0 + 0.5 * np.arange(12)
    assert np.allclose(ground.heights(x[None, :], y[:, None])[::-1], values, atol=1e-10)
    assert ground.heights(10.0, y[-1]) == pytest.approx(values[0, 0])


def test_a_tilted_plane_is_interpolated_exactly_and_nothing_is_beyond_it():
    row, column = np.mgrid[0:9, 0:5]
    ground, _ = place_map(0.25 * column - 0.5 * row, (1.0, 1.0), (0.0, 0.0), centre=True, origin_m=(0, 0), size_m=100.0)
    assert ground.bounds_m == (-2.0, 2.0, -4.0, 4.0)
    x, y = np.random.default_rng(0).uniform((-2, -4), (2, 4), (200, 2)).T
    assert np.allclose(ground.heights(x, y), 0.25 * x + 0.5 * y, atol=1e-12)
    assert np.isnan(ground.heights(np.array([-2.01, 2.01, 0, 0]), np.array([0, 0, -4.01, 4.01]))).all()


def test_the_patch_ends_where_the_settings_say():
    ground, _ = place_map(
        np.zeros((101, 101)), (1.0, 1.0), (0.0, 0.0), centre=True, origin_m=(30.0, -10.0), size_m=20.0
    )
    assert ground.bounds_m == (-10.0, 10.0, -10.0, 10.0)
    assert np.isnan(ground.heights(10.5, 0.0))
    edge, _ = place_map(np.zeros((101, 101)), (1.0, 1.0), (0.0, 0.0), centre=True, origin_m=(45.0, 0.0), size_m=20.0)
    assert edge.bounds_m == (-10.0, 5.0, -10.0, 10.0)


def test_placing_moves_and_says_by_how_much():
    values = bumpy(3, 5)
    ground, shift = place_map(values, (10.0, 10.0), (500000.0, 20000.0), centre=True, origin_m=(5.0, 0.0), size_m=1e3)
    assert shift == pytest.approx((-500025.0, -20010.0, -np.median(values)))
    assert ground.heights(-5.0, 0.0) == pytest.approx(values[1, 2] - np.median(values))
    kept, shift = place_map(values, (10.0, 10.0), (-20.0, -10.0), centre=False, origin_m=(0.0, 0.0), size_m=1e3)
    assert shift == (0.0, 0.0, 0.0)
    assert kept.heights(0.0, 0.0) == pytest.approx(values[1, 2])


def test_holes_are_filled_from_around_and_known_heights_stay():
    row, column = np.mgrid[0:40, 0:33].astype(float)
    plane = 3.0 + 0.2 * row - 0.1 * column
    holed = plane.copy()
    holed[10:18, 5:9] = holed[0, 0] = holed[30, 20:] = np.nan
    filled = fill_holes(holed)
    known = np.isfinite(holed)
    assert np.array_equal(filled[known], plane[known])
    assert np.isfinite(filled).all()
    assert np.abs(filled - plane)[10:18, 5:9].max() < 0.8  # 1.6 m of relief across the hole
    with pytest.raises(ValueError, match="finite"):
        fill_holes(np.full((3, 3), np.nan))


@given(st.integers(1, 9), st.integers(1, 9), st.data())
def test_any_pattern_of_holes_is_filled_within_the_range(rows, columns, data):
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=rows * columns, max_size=rows * columns)))
    values = np.random.default_rng(1).uniform(-5, 7, (rows, columns))
    values[mask.reshape(rows, columns)] = np.nan
    if np.isfinite(values).any():
        filled = fill_holes(values)
        assert np.nanmin(values) - 1e-9 <= filled.min() <= filled.max() <= np.nanmax(values) + 1e-9


class Waves:
    """Made-up ground of two waves, 8 m and 0.5 m long."""

    size_m = 20.0

    def heights(self, x_m, y_m, shortest_m=0.0):
        x, _ = np.broadcast_arrays(np.asarray(x_m, float), y_m)
        return sum(np.sin(2 * np.pi * x / length) for length in (8.0, 0.5) if length >= shortest_m) + np.zeros(x.shape)


def test_added_roughness_keeps_to_wavelengths_below_the_pixels():
    ground = height_map.add_roughness(HeightMap(np.ones((21, 21)), (1.0, 1.0), -10.0, -10.0, 20.0), Waves())
    x, y = np.random.default_rng(0).uniform(-9, 9, (2, 500))
    assert np.allclose(ground.heights(x, y, 0.3), 1.0 + np.sin(4 * np.pi * x))
    assert np.array_equal(ground.heights(x, y, 2.0), np.ones(500))  # the mesh carries nothing finer


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"order": ">"},
        {"rows_per_strip": 5},
        {"deflate": True, "rows_per_strip": 5},
        {"tile": 16},
        {"tile": 16, "deflate": True, "order": ">"},
        {"predictor": 2, "deflate": True},
        {"predictor": 2, "order": ">"},
    ],
    ids=str,
)
@pytest.mark.parametrize("kind", ["u1", "u2", "i2", "i4", "f4", "f8"])
def test_geotiff_values_are_exact(tmp_path, kind, options):
    if kind[0] == "f" and options.get("predictor") == 2:
        options = {**options, "predictor": 3}
    values = np.random.default_rng(5).integers(0, 250, (23, 37)).astype(kind)
    if kind[0] != "u":
        values = (values * 37 - 4000).astype(kind) + np.array(0.125, kind if kind[0] == "f" else "i2").astype(kind)
    read = geotiff.read(write_tiff(tmp_path / "a.tif", values, **options))
    assert np.array_equal(read.heights_m, values.astype(float))
    assert (read.pixel_m, read.corner_m) == (None, None)


def test_geotiff_states_pixels_place_and_missing_values(tmp_path):
    values = np.array([[1.5, -9999.0, 2.0], [3.0, -3.4028235e38, 4.0]], np.float32)
    read = geotiff.read(
        write_tiff(tmp_path / "a.tif", values, pixel=(2.0, 3.0), tie=(0, 0, 0, 1000.0, 500.0, 0), nodata="-9999")
    )
    assert np.array_equal(np.isnan(read.heights_m), values < -9000)
    assert read.pixel_m == (2.0, 3.0)
    assert read.corner_m == (1001.0, 495.5)  # pixel is area: the tie point is the north-west corner
    read = geotiff.read(
        write_tiff(tmp_path / "a.tif", values, pixel=(2.0, 3.0), tie=(0, 0, 0, 1000.0, 500.0, 0), point=True)
    )
    assert read.corner_m == (1000.0, 497.0)


@pytest.mark.parametrize(
    ("extra", "word"),
    [({259: (34887,)}, "LERC"), ({259: (7,)}, "JPEG"), ({277: (3,)}, "3 bands"), ({258: (12,)}, "12-bit")],
)
def test_what_is_not_read_names_the_mend(tmp_path, extra, word):
    path = write_tiff(tmp_path / "a.tif", np.zeros((4, 4), np.float32), extra=extra)
    with pytest.raises(IcyMoonError, match=r"a\.tif.*gdal_translate") as caught:
        geotiff.read(path)
    assert word in str(caught.value)


def test_a_torn_tiff_is_a_sentence_at_every_length(tmp_path):
    whole = write_tiff(
        tmp_path / "a.tif", bumpy().astype(np.float32), deflate=True, rows_per_strip=4, pixel=(1.0, 1.0)
    ).read_bytes()
    for length in range(0, len(whole), max(1, len(whole) // 40)):
        (tmp_path / "torn.tif").write_bytes(whole[:length])
        with pytest.raises(IcyMoonError, match=r"torn\.tif"):
            geotiff.read(tmp_path / "torn.tif")
    assert math.isfinite(geotiff.read(tmp_path / "a.tif").heights_m.sum())

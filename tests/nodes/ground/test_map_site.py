"""Sites on maps: true to scale wherever the map is, only what the site needs is read, and points go back to the map."""

from __future__ import annotations

import json
import math
import resource
import subprocess
import sys

import numpy as np
import pytest
from icymoon.formats import geotiff
from icymoon.formats.geotiff import Site
from icymoon.nodes.build_scene import build_scene
from icymoon.nodes.ground.user_ground import load_ground
from icymoon.support.errors import IcyMoonError
from rendering import complete, empty_scene

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
warp = pytest.importorskip("rasterio.warp")

EUROPA_M = 1560800.0
#: Map systems, the middle of a map of each in its own unit, and a pixel there.
MAPS = {
    "web map at 60°": ("EPSG:3857", (1e6, 8399737.9), 2.0),
    "UTM": ("EPSG:32633", (5.0e5, 7.5e6), 2.0),
    "equidistant cylindrical at 70° south": (
        f"+proj=eqc +R={EUROPA_M} +no_defs",
        (3e5, -math.radians(70) * EUROPA_M),
        4.0,
    ),
    "Mercator": (f"+proj=merc +R={EUROPA_M} +no_defs", (2e5, 1.2e6), 3.0),
    "polar, off its parallel": (f"+proj=stere +lat_0=-90 +lat_ts=-71 +R={EUROPA_M} +no_defs", (1e5, 9e5), 2.0),
    "degrees": ("EPSG:4326", (15.0, 50.0), 2e-5),
    "false easting": (
        f"+proj=tmerc +lat_0=10 +lon_0=20 +k=0.9999 +x_0=5000000 +y_0=-2000000.25 +R={EUROPA_M} +no_defs",
        (5.02e6, -1.98e6),
        2.0,
    ),
    "false easting in feet": (
        f"+proj=lcc +lat_1=30 +lat_2=40 +lat_0=35 +lon_0=15 +x_0=3e6 +y_0=1e6 +R={EUROPA_M} +units=us-ft +no_defs",
        (9.9e6, 3.3e6),
        6.0,
    ),
}


def written(path, name, size=80):
    """A plane that rises by 0.5 m per metre of ground to the east and 0.2 to the north, by PROJ's own distances."""
    text, (x, y), pixel = MAPS[name]
    crs = rasterio.crs.CRS.from_string(text)
    transform = rasterio.transform.from_origin(x - pixel * size / 2, y + pixel * size / 2, pixel, pixel)
    columns, rows = np.meshgrid(np.arange(size), np.arange(size))
    xs, ys = rasterio.transform.xy(transform, rows.ravel(), columns.ravel())
    radius = 6371008.8 if text.startswith("EPSG") else EUROPA_M
    geographic = (
        rasterio.crs.CRS.from_epsg(4326)
        if text.startswith("EPSG")
        else rasterio.crs.CRS.from_string(f"+proj=longlat +R={EUROPA_M} +no_defs")
    )
    lon, lat = map(np.array, warp.transform(crs, geographic, xs, ys))
    (lon0,), (lat0,) = warp.transform(crs, geographic, [x], [y])
    east = np.radians(lon - lon0) * np.cos(np.radians(lat0)) * radius
    north = np.radians(lat - lat0) * radius
    heights = (100.0 + 0.5 * east + 0.2 * north).reshape(size, size).astype(np.float32)
    with rasterio.open(
        path, "w", driver="GTiff", width=size, height=size, count=1, dtype="float32", crs=crs, transform=transform
    ) as out:
        out.write(heights, 1)
    return path, (x, y)


def ground_of(path, **source):
    settings = complete(
        {
            "source": {"kind": "HEIGHT_MAP", "file": str(path), **source},
            "terrain": {"size_m": 60.0, "resolution": 65},
            "rig": {"height_m": 3.0},
        }
    )
    return build_scene(empty_scene(), settings)


def slopes(built):
    """Rise of the ground per metre along x and y, by least squares."""
    vertices = np.empty(3 * len(built.terrain.data.vertices))
    built.terrain.data.vertices.foreach_get("co", vertices)
    x, y, z = vertices.reshape(-1, 3).T
    (a, b, _), *_ = np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], axis=1), z, rcond=None)
    return float(a), float(b)


@pytest.mark.parametrize("name", MAPS)
def test_a_plane_has_its_slope_on_every_map(tmp_path, name):
    path, _ = written(tmp_path / "dem.tif", name)
    built = ground_of(path)
    place = built.ground["map"]
    # A map may be turned against north; so the slope is compared in the map's directions. The sphere that stands for
    # Earth's ellipsoid is off by up to a hundredth.
    turn = math.radians(place["north_deg"])
    east, north = slopes(built)
    found = (east * math.cos(turn) - north * math.sin(turn), east * math.sin(turn) + north * math.cos(turn))
    tolerance = 0.01 if MAPS[name][0].startswith("EPSG") else 1e-3
    assert found == (pytest.approx(0.5, rel=tolerance, abs=0.2 * tolerance), pytest.approx(0.2, rel=5 * tolerance))


@pytest.mark.parametrize("name", MAPS)
def test_a_point_goes_back_to_its_map_coordinates_within_a_millimetre(tmp_path, name):
    path, (x, _) = written(tmp_path / "dem.tif", name)
    read = geotiff.read(path, Site(True, (3.0, -2.0), 40.0))
    assert read.place is not None
    assert read.corner_m is not None
    # The lower left pixel's centre, by the file's own transform.
    with rasterio.open(path) as opened:
        corner = opened.xy(opened.height - 1, 0)
    for k in range(2):
        back = (read.place.origin[k] + read.corner_m[k] / read.place.scale[k]) / read.place.unit_m
        assert abs(back - corner[k]) * read.place.unit_m < 1e-3
    middle = (read.place.origin[0] - 3.0 / read.place.scale[0]) / read.place.unit_m
    assert abs(middle - x) * read.place.unit_m < 1e-3


def large(path, side=14400):
    """A map of 207 megapixels whose heights are its coordinates, in deflated tiles."""
    profile = {
        "driver": "GTiff",
        "width": side,
        "height": side,
        "count": 1,
        "dtype": "float32",
        "tiled": True,
        "blockxsize": 256,
        "blockysize": 256,
        "compress": "deflate",
        "crs": "EPSG:32633",
        "transform": rasterio.transform.from_origin(4e5, 7e6, 1.0, 1.0),
    }
    with rasterio.open(path, "w", **profile) as out:
        for row in range(7168, 7680, 256):  # the rest stays empty
            window = rasterio.windows.Window(6912, row, 1024, 256)
            rows, columns = np.mgrid[row : row + 256, 6912:7936]
            out.write((rows * 0.01 + columns * 0.001).astype(np.float32), 1, window=window)
    return path


def test_only_the_sites_part_of_a_large_map_is_read(tmp_path):
    """In a process of its own with 300 MB beside what it has: 207 megapixels would need 1.6 GB as doubles."""
    path = large(tmp_path / "dtm.tif")
    program = f"""
import resource
from pathlib import Path
import numpy as np
from icymoon.formats import geotiff
with open("/proc/self/statm") as stream:
    now = int(stream.read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (now + 300 * 10**6,) * 2)
read = geotiff.read(Path({str(path)!r}), geotiff.Site(False, (407300.5, 6992600.5), 50.0))
print(read.heights_m.shape, read.file_shape, read.corner_m)
rows = 14399 - np.rint((read.corner_m[1] + 6992600.5 - 6985600.5) - 0)
print(float(read.heights_m[-1, 0] - (rows * 0.01 + (read.corner_m[0] + 407300.5 - 400000.5) * 0.001)))
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 0, ended.stderr
    shape, off = ended.stdout.splitlines()
    assert shape.startswith("(83, 83) (14400, 14400)")
    assert abs(float(off)) < 1e-4
    assert resource.getrlimit(resource.RLIMIT_AS)[0] != 0


def test_a_window_is_the_cut_of_the_whole(tmp_path, monkeypatch):
    path, _ = written(tmp_path / "dem.tif", "UTM", 200)
    site = Site(True, (11.0, -23.0), 60.0)
    whole = geotiff.read(path, site)
    monkeypatch.setattr(geotiff, "_MAX_WHOLE_PIXELS", 100)
    part = geotiff.read(path, site)
    assert part.heights_m.shape == (63, 63)
    assert whole.corner_m is not None
    assert part.corner_m is not None
    left, low = (round((part.corner_m[k] - whole.corner_m[k]) / 2.0) for k in range(2))
    cut = whole.heights_m[200 - low - 63 : 200 - low, left : left + 63]
    np.testing.assert_array_equal(part.heights_m, cut)


@pytest.mark.parametrize(("mark", "count"), [(-9999.0, 9), (-32768.0, 1), (0.0, 5), (65535.0, 3), (1e6, 2)])
def test_missing_heights_without_a_mark_are_found(tmp_path, mark, count):
    heights = 1500 + np.random.default_rng(1).uniform(0, 10, (64, 64))
    heights.ravel()[: count * 65 : 65] = mark
    np.save(tmp_path / "a.npy", heights)
    built = ground_of(tmp_path / "a.npy", metres_per_pixel=2.0)
    said = " ".join(built.warnings)
    assert f"{count} pixel" in said
    assert f"of exactly {mark:g}" in said
    vertices = np.empty(3 * len(built.terrain.data.vertices))
    built.terrain.data.vertices.foreach_get("co", vertices)
    assert np.ptp(vertices[2::3]) < 11


def save_npy(path, heights):
    np.save(path.with_suffix(".npy"), heights)
    return path.with_suffix(".npy")


def save_tiff(path, heights):
    """Heights of half a metre per value, with a mark of their own in the first pixel."""
    values = np.rint(2 * heights).astype(np.int16)
    values[0, 0] = -1
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=64,
        height=64,
        count=1,
        dtype="int16",
        crs="EPSG:32633",
        nodata=-1,
        transform=rasterio.transform.from_origin(5e5, 7.5e6, 2, 2),
    ) as out:
        out.write(values, 1)
        out.scales = (0.5,)
    return path


@pytest.mark.parametrize("save", [save_npy, save_tiff])
def test_a_stated_value_is_missing_beside_the_files_own_mark(tmp_path, save):
    """0 between heights below and above it, which nothing else finds."""
    heights = np.rint(np.random.default_rng(1).uniform(-40, 40, (64, 64)))
    heights[heights == 0] = 1
    heights[5:8, 5:8] = 0
    path = save(tmp_path / "a.tif", heights)
    built = ground_of(path, missing="0", metres_per_pixel=2.0)
    assert "9 pixels of 0 without a height, by source.missing" in " ".join(built.ground["report"])
    share = 10 / 4096 if save is save_tiff else 9 / 4096
    assert f"{share:.2%} of" in " ".join(built.warnings)
    assert "by source.missing" not in " ".join(ground_of(path, metres_per_pixel=2.0).ground["report"])


def test_none_keeps_heights_that_look_like_a_mark(tmp_path):
    heights = 1500 + np.random.default_rng(1).uniform(0, 10, (64, 64))
    heights[30:33, 30:33] = -9999.0
    np.save(tmp_path / "a.npy", heights)
    said = " ".join(ground_of(tmp_path / "a.npy", metres_per_pixel=2.0).warnings)
    assert "set source.missing = none" in said
    kept = ground_of(tmp_path / "a.npy", metres_per_pixel=2.0, missing="none")
    assert "source.missing" not in " ".join(kept.warnings)
    vertices = np.empty(3 * len(kept.terrain.data.vertices))
    kept.terrain.data.vertices.foreach_get("co", vertices)
    assert np.ptp(vertices[2::3]) > 11_000


def test_a_file_without_a_map_has_its_exact_offset(tmp_path):
    heights = 1234.5678 + np.random.default_rng(1).uniform(0, 10, (65, 65))
    np.save(tmp_path / "a.npy", heights)
    place = ground_of(tmp_path / "a.npy", metres_per_pixel=2.0, origin_x_m=0.12345679).ground["map"]
    assert place["origin"] == [64.12345679, 64.0]
    assert place["height_zero_m"] == np.median(heights)
    assert place["crs"] == ""


def test_a_mesh_in_map_coordinates_has_its_exact_offset(tmp_path):
    """Vertices in feet, millions of them from the origin, in double precision."""
    corner = (
        np.array(
            [[9.9e6, 3.3e6, 400.0], [9.9e6 + 40, 3.3e6, 410], [9.9e6, 3.3e6 + 40, 420], [9.9e6 + 40, 3.3e6 + 40, 450]]
        )
        + 0.123456789
    )
    head = [
        "ply",
        "format ascii 1.0",
        "element vertex 4",
        *(f"property double {axis}" for axis in "xyz"),
        "element face 2",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    rows = [*(" ".join(map(repr, map(float, vertex))) for vertex in corner), "3 0 1 2", "3 1 3 2"]
    (tmp_path / "a.ply").write_text("\n".join([*head, *rows]) + "\n")
    settings = complete({"source": {"kind": "MESH", "file": str(tmp_path / "a.ply"), "scale": 0.3048}})
    ground = load_ground(settings, lambda _: None)
    place = ground.map_place
    assert place is not None
    offset = np.array([*place["origin"], place["height_zero_m"]])
    back = (ground.positions.astype(float) + offset) / place["unit_m"]
    distance = np.linalg.norm(back[:, None] - corner[None], axis=2) * place["unit_m"]
    assert distance.min(axis=0).max() < 1e-3


@pytest.mark.parametrize(
    "heights",
    [
        lambda: np.random.default_rng(1).uniform(0, 10, (64, 64)),
        lambda: np.maximum(np.mgrid[:64, :64][0] - 20.0, 0.0),
        lambda: np.where(np.mgrid[:64, :64][0] > 60, -30.0, np.random.default_rng(1).uniform(0, 15, (64, 64))),
        lambda: np.full((64, 64), 7.0),
    ],
    ids=["noise", "a plain", "a pit", "level"],
)
def test_heights_that_are_there_stay(tmp_path, heights):
    np.save(tmp_path / "a.npy", heights())
    assert "taken for missing" not in " ".join(ground_of(tmp_path / "a.npy", metres_per_pixel=2.0).warnings)


def test_a_place_beyond_the_map_and_skewed_ground_are_refused_with_a_way(tmp_path):
    path, _ = written(tmp_path / "dem.tif", "Mercator")
    with pytest.raises(IcyMoonError, match=r"no height within terrain\.size_m"):
        ground_of(path, centre=False)
    crs = rasterio.crs.CRS.from_string(f"+proj=sinu +R={EUROPA_M} +no_defs")
    with rasterio.open(
        tmp_path / "s.tif",
        "w",
        driver="GTiff",
        width=9,
        height=9,
        count=1,
        dtype="float32",
        crs=crs,
        transform=rasterio.transform.from_origin(9e5, 1.3e6, 2.0, 2.0),
    ) as out:
        out.write(np.ones((9, 9), np.float32), 1)
    with pytest.raises(IcyMoonError, match=r'gdalwarp -t_srs "\+proj=aeqd .*" .* s\.tif s_new\.tif$') as caught:
        ground_of(tmp_path / "s.tif")
    srs = str(caught.value).split('"')[1]
    rasterio.crs.CRS.from_string(srs)  # PROJ understands it


@pytest.mark.parametrize("name", MAPS)
def test_the_stated_system_leads_from_the_origin_to_its_longitude_and_latitude(tmp_path, name):
    """By PROJ, from the coordinates in the unit of the file and the system that are stated."""
    path, _ = written(tmp_path / "dem.tif", name)
    place = geotiff.read(path, Site(True, (3.0, -2.0), 40.0)).place
    assert place is not None
    earth = MAPS[name][0].startswith("EPSG")
    body = "EPSG:4326" if earth else f"+proj=longlat +R={EUROPA_M} +no_defs"
    (lon,), (lat,) = warp.transform(place.crs, body, *([at / place.unit_m] for at in place.origin))
    # Longitude and latitude of Earth are those of a sphere.
    assert (lon, lat) == pytest.approx((place.longitude_deg, place.latitude_deg), abs=0.25 if earth else 1e-8)
    # The file's own system agrees to a hundredth of a millimetre, all parameters included.
    with rasterio.open(path) as opened:
        (x,), (y,) = warp.transform(place.crs, opened.crs, *([at / place.unit_m] for at in place.origin))
    assert (x * place.unit_m, y * place.unit_m) == pytest.approx(place.origin, abs=1e-5)
    wanted = f"that of {place.crs}" if name in ("UTM", "web map at 60°") else "EPSG:4326" if earth else "1560800.0"
    assert wanted in place.datum


@pytest.mark.parametrize(("off_m", "side"), [((60.0, 0.0), "east"), ((0.0, -55.0), "south"), ((40.0, 0.0), "")])
def test_ground_that_ends_near_a_stated_site_is_told(tmp_path, off_m, side):
    """Of a map of 160 m about its middle, around a site off it by so many metres of the map."""
    path, (x, y) = written(tmp_path / "dem.tif", "UTM")
    site = {"site": "MAP", "site_easting": str(x + off_m[0]), "site_northing": str(y + off_m[1])}
    near = [each for each in ground_of(path, **site).warnings if "and the ground ends there" in each]
    reached = 80.0 - max(map(abs, off_m)) - 1.0  # to the middle of the last pixel, of 2 m
    assert [f"ends {reached:g} m {side} of the site" in each for each in near] == [True] * bool(side)


def test_a_map_of_another_body_is_told_where_a_site_is_stated(tmp_path):
    """Its site would get the horizon of Enceladus, and the sky there."""
    path, (x, y) = written(tmp_path / "dem.tif", "Mercator")
    stated = ground_of(path, site="MAP", site_easting=str(x), site_northing=str(y)).warnings
    (told,) = [each for each in stated if "radius of 1560.8 km" in each]
    assert told.endswith("set terrain.body_radius_m to 1560800 and light.directions_from to ANGLES.")
    assert not [each for each in ground_of(path).warnings if "radius of" in each]


def test_the_record_has_the_exact_place(tmp_path):
    path, (x, y) = written(tmp_path / "dem.tif", "web map at 60°")
    place = json.loads(json.dumps(ground_of(path, origin_x_m=4.0).ground["map"]))
    assert place["crs"] == "EPSG:3857"
    assert place["origin"][0] == pytest.approx(x + 8.0, abs=1e-3)
    assert place["origin"][1] == pytest.approx(y, abs=1e-6)
    assert place["height_zero_m"] == pytest.approx(100.0, abs=0.01)
    assert place["latitude_deg"] == pytest.approx(60, abs=1e-4)
    assert place["longitude_deg"] == pytest.approx(8.983, abs=1e-3)


def test_a_sentence_with_a_command_ends_with_it(tmp_path):
    with rasterio.open(
        tmp_path / "f.tif",
        "w",
        driver="GTiff",
        width=9,
        height=9,
        count=1,
        dtype="float32",
        crs="EPSG:2263",
        GEOTIFF_VERSION="1.1",
        transform=rasterio.transform.from_origin(9e5, 1.3e5, 2.0, 2.0),
    ) as out:
        out.write(np.ones((9, 9), np.float32), 1)
    with pytest.raises(IcyMoonError, match=r"with: gdal_translate .* f\.tif f_new\.tif$"):
        ground_of(tmp_path / "f.tif")

"""Maps and meshes of the ground are what the scene contains, as foreign readers read them."""

from __future__ import annotations

import json

import bpy
import numpy as np
import pytest
from icymoon.formats import geotiff
from icymoon.formats.tiff_write import encode_tiff
from icymoon.physics.surfaces.surface_law import find_albedos
from icymoon.render.geometry_worker import run_job
from icymoon.support.errors import IcyMoonError
from rendering import SMALL, complete, on_height_map

SIZE_M, CELL_M = 8.0, 0.25


def slope(x, y):
    """Ground that no symmetry confuses: it rises eastward, and more so northward."""
    return 0.1 * x + 0.25 * y


def written(folder, kind, *changes, cell_m=None):
    """The folder and the facts of a scene's ground."""
    settings = complete({"rocks": {"coverage": 0.0}, "surface": {"grain_amplitude_m": 0.0}}, *changes)
    run_job({"settings": settings}, folder, lambda *a, **k: None, kind, cell_m)
    (made,) = folder.iterdir()
    return made, json.loads((made / "geometry.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def own_files(tmp_path_factory):
    """Heights of ``slope`` and an albedo that is 0.2 in the north-east quarter and else 0.6."""
    folder = tmp_path_factory.mktemp("own")
    at = np.linspace(-SIZE_M / 2, SIZE_M / 2, 33)
    np.save(folder / "heights.npy", slope(at[None, :], at[::-1, None]))
    albedo = np.full((64, 64), 0.6, np.float32)
    albedo[:32, 32:] = 0.2
    (folder / "albedo.tif").write_bytes(encode_tiff(albedo))
    return {
        **on_height_map(folder / "heights.npy", SIZE_M),
        "textures": {"set": "OWN", "mapping": "PATCH", "albedo_file": str(folder / "albedo.tif")},
        "surface": {"model": "LAMBERT", "albedo": 0.5, "albedo_variation": 0.0},
    }


def test_maps_are_the_heights_and_the_albedo_that_were_given(own_files, tmp_path):
    folder, facts = written(tmp_path, "dem", own_files, cell_m=CELL_M)
    heights = geotiff.read(folder / "dem.tif").heights_m
    assert heights.shape == (32, 32)
    at = (np.arange(32) + 0.5) * CELL_M - SIZE_M / 2
    # Depth is a float of single precision, of some metres.
    assert heights == pytest.approx(slope(at[None, :], at[::-1, None]), abs=2e-5)
    assert (facts["cell_m"], facts["west_m"], facts["north_m"]) == (CELL_M, -SIZE_M / 2, SIZE_M / 2)
    assert "x east, y north, z up" in facts["frame"]
    assert not facts["left_out"]


def test_foreign_readers_find_the_frame_the_cells_and_what_is_missing(own_files, tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
    folder, _ = written(tmp_path, "dem", own_files, cell_m=0.3)
    with rasterio.open(folder / "dem.tif") as opened:
        heights, local = opened.read(1), opened.crs.to_wkt()
        assert local.startswith(("LOCAL_CS", "ENGCRS"))
        assert "x east, y north, z up, metres" in local
        assert opened.units == ("metre",)
        assert np.isnan(opened.nodata)
        # 27 cells of 0.3 m are 8.1 m: the outermost centres are still on the ground.
        assert opened.shape == (27, 27)
        x, y = opened.xy(3, 20)
        assert heights[3, 20] == pytest.approx(slope(x, y), abs=2e-5)
    with rasterio.open(folder / "albedo.tif") as opened:
        albedo = opened.read()
        assert albedo.shape == (3, 27, 27)
        assert albedo[:, *opened.index(2.0, 2.0)] == pytest.approx(0.2, abs=1e-3)
        for x, y in ((-2.0, 2.0), (2.0, -2.0), (-2.0, -2.0)):
            assert albedo[:, *opened.index(x, y)] == pytest.approx(0.6, abs=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        {"model": "LAMBERT", "albedo": 0.43},
        {"model": "HAPKE"},
        {"model": "PRINCIPLED", "albedo": 0.7},
        {"model": "LOMMEL_SEELIGER", "albedo": 0.3},
    ],
    ids=lambda each: each["model"],
)
def test_the_albedo_of_a_plain_surface_is_that_of_its_law(changes, tmp_path):
    plain = {
        "surface": {
            "albedo_variation": 0.0,
            "trough_dirt": 0.0,
            "slope_dirt": 0.0,
            "salt_share": 0.0,
            "ice_colour": "GREY",
            **changes,
        },
        "terrain": {"resolution": 9},
    }
    folder, _ = written(tmp_path, "dem", plain, cell_m=1.0)
    settings = complete(plain)
    law = find_albedos(settings.surface, settings.hapke)
    wanted = law.bond if changes["model"] == "HAPKE" else changes["albedo"]
    # The curve of a node is a table of single precision.
    assert np.unique(tiff_values(folder / "albedo.tif")) == pytest.approx(wanted, abs=1e-5)


def test_patches_of_hapkes_ground_are_between_the_albedos_of_their_w(tmp_path):
    varied = {
        "surface": {
            "model": "HAPKE",
            "albedo_variation": 0.6,
            "trough_dirt": 0.0,
            "slope_dirt": 0.0,
            "salt_share": 0.0,
            "ice_colour": "GREY",
        },
        "terrain": {"resolution": 9},
    }
    folder, _ = written(tmp_path, "dem", varied, cell_m=0.5)
    settings = complete(varied)
    found = tiff_values(folder / "albedo.tif")
    least = find_albedos(settings.surface, settings.hapke | {"w": 0.4 * settings.hapke.w}).bond
    most = find_albedos(settings.surface, settings.hapke).bond
    assert least < found.min() < found.max() < most
    # Far from proportional to w: half of the light is scattered more than once.
    middle = find_albedos(settings.surface, settings.hapke | {"w": 0.7 * settings.hapke.w}).bond
    assert middle < 0.6 * most


def tiff_values(path):
    """The values of a TIFF file, read by OpenCV."""
    cv2 = pytest.importorskip("cv2")
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def test_rocks_stand_on_the_ground_in_one_map_only(tmp_path):
    folder, _ = written(
        tmp_path, "dem", {"terrain": {"resolution": 33, "size_m": SIZE_M}, "rocks": {"coverage": 0.1}}, cell_m=0.05
    )
    ground, surface = (geotiff.read(folder / name).heights_m for name in ("dem.tif", "dsm.tif"))
    above = surface - ground
    assert above.min() >= -1e-5
    # Rocks cover a tenth of the ground; what is buried of them is not seen.
    assert 0.03 < (above > 0.01).mean() < 0.13


def test_a_lander_is_in_no_map(tmp_path):
    ground = {"terrain": {"resolution": 33, "size_m": SIZE_M}, "rocks": {"coverage": 0.0}}
    bare, _ = written(tmp_path / "bare", "dem", ground, cell_m=0.2)
    with_it, _ = written(tmp_path / "with", "dem", {**ground, "lander": {"kind": "PARAMETRIC"}}, cell_m=0.2)
    for name in ("dem.tif", "dsm.tif", "albedo.tif"):
        one, other = tiff_values(bare / name), tiff_values(with_it / name)
        assert np.isfinite(one).all()
        np.testing.assert_array_equal(one, other)


def test_meshes_have_the_sites_axes_in_blenders_formats(own_files, tmp_path):
    for suffix in ("obj", "usd"):
        folder, facts = written(tmp_path / suffix, suffix, own_files)
        assert facts["files"] == [f"ground.{suffix}"]
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        if suffix == "obj":
            rows = [line.split()[1:] for line in (folder / "ground.obj").read_text().splitlines() if line[:2] == "v "]
            places = np.array(rows, float)
        else:
            bpy.ops.wm.usd_import(filepath=str(folder / "ground.usd"))
            (item,) = (each for each in bpy.context.scene.objects if each.type == "MESH")
            places = np.array([item.matrix_world @ vertex.co for vertex in item.data.vertices])
        inside = np.abs(places[:, :2]).max(axis=1) < SIZE_M / 2 - 1e-3
        assert inside.sum() == 31 * 31
        assert places[inside, 2] == pytest.approx(slope(places[inside, 0], places[inside, 1]), abs=1e-5)


def test_cells_that_are_too_small_are_refused(tmp_path):
    with pytest.raises(IcyMoonError, match=r"give .* m or more"):
        run_job({"settings": SMALL}, tmp_path, lambda *a, **k: None, "dem", 1e-5)
    assert not any(tmp_path.iterdir())


def test_a_file_in_the_way_is_a_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(IcyMoonError, match="file"):
        run_job({"settings": SMALL}, tmp_path / "file", lambda *a, **k: None, "ply")


@pytest.mark.parametrize("kind", ["dem", "ply", "obj", "usd", "gltf"])
def test_points_of_every_ground_export_go_back_to_the_map_within_a_millimetre(tmp_path, kind):
    """A plane on a map far from its origin, under a turned camera: each point has the height of its map coordinates."""
    rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
    trimesh = pytest.importorskip("trimesh", reason="pip install trimesh, which only tests need")
    middle, size, pixel = (5020000.0, -1980000.0), 65, 0.25
    at = (np.arange(size) - size // 2) * pixel
    heights = 1234.5 + 0.5 * at[None, :] + 0.2 * at[::-1, None]  # per metre of the map
    crs = "+proj=merc +lat_ts=0 +x_0=5000000 +y_0=-2600000 +R=1560800 +units=m +no_defs"
    with rasterio.open(
        tmp_path / "map.tif",
        "w",
        driver="GTiff",
        width=size,
        height=size,
        count=1,
        dtype="float64",
        crs=crs,
        transform=rasterio.transform.from_origin(
            middle[0] - size * pixel / 2, middle[1] + size * pixel / 2, pixel, pixel
        ),
    ) as out:
        out.write(heights, 1)
    folder, facts = written(
        tmp_path / "out",
        kind,
        {
            "source": {"kind": "HEIGHT_MAP", "file": str(tmp_path / "map.tif"), "origin_x_m": 1.0, "origin_y_m": -0.5},
            "terrain": {"size_m": SIZE_M, "resolution": 33},
            "rig": {"heading_deg": 37.0},
        },
        cell_m=CELL_M if kind == "dem" else None,
    )
    place = facts["map"]
    assert place["scale"][0] == pytest.approx(0.925, abs=0.01)  # at 21.7° north
    assert rasterio.crs.CRS.from_string(place["crs"]) == rasterio.crs.CRS.from_string(crs)
    assert "1560800.0" in place["datum"]
    if kind == "dem":
        with rasterio.open(folder / "dem.tif") as opened:
            assert json.loads(opened.tags()["map"]) == place
            z = opened.read(1).astype(float)
            x, y = (np.reshape(values, z.shape) for values in opened.xy(*np.mgrid[: z.shape[0], : z.shape[1]]))
        local = np.stack([x, y, z], axis=-1)[np.isfinite(z)]
    elif kind == "usd":
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        bpy.ops.wm.usd_import(filepath=str(folder / "ground.usd"))
        (item,) = (each for each in bpy.context.scene.objects if each.type == "MESH")
        local = np.array([item.matrix_world @ vertex.co for vertex in item.data.vertices], float)
    else:
        name = {"ply": "terrain.ply", "obj": "ground.obj", "gltf": "ground.glb"}[kind]
        made = trimesh.load(folder / name, force="mesh", process=False)
        local = np.asarray(made.vertices, float)
        local = np.stack([local[:, 0], -local[:, 2], local[:, 1]], axis=1) if kind == "gltf" else local
    assert len(local) > 100
    x, y = ((place["origin"][k] + local[:, k] / place["scale"][k]) / place["unit_m"] for k in range(2))
    wanted = 1234.5 + 0.5 * (x - middle[0]) + 0.2 * (y - middle[1])
    assert np.abs(local[:, 2] + place["height_zero_m"] - wanted).max() < 1e-3

"""An albedo GeoTIFF lies on the ground where its coordinates say, as the materials of the scene show it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from icymoon.formats.map_frame import map_frame_from_json
from icymoon.nodes.build_scene import build_scene
from icymoon.render.geometry_worker import run_job
from icymoon.support.errors import IcyMoonError
from map_systems import POLAR
from rendering import complete, empty_scene

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")

pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul")

PLACE, SIZE_M, CELL_M, PIXEL, SIDE = (418215.1, 724369.8), 8.0, 0.25, 0.31, 60


def law(easting, northing):
    """An albedo that no symmetry confuses, in map coordinates: bilinear, so that pixels between have it too."""
    return 0.5 + 0.03 * (easting - PLACE[0]) - 0.02 * (northing - PLACE[1])


def write(path, values, corner, pixel):
    rows, columns = values.shape
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": values.dtype.name}
    transform = rasterio.transform.from_origin(*corner, pixel, pixel)
    with rasterio.open(path, "w", **profile, crs=POLAR, transform=transform) as out:
        out.write(values, 1)


@pytest.fixture
def settings(tmp_path):
    write(tmp_path / "dem.tif", np.zeros((81, 81), np.float32), (PLACE[0] - 10.1, PLACE[1] + 10.3), 0.25)
    corner = PLACE[0] - 7.77, PLACE[1] + 9.99
    at = (np.arange(SIDE) + 0.5) * PIXEL
    write(tmp_path / "a.tif", law(corner[0] + at[None, :], corner[1] - at[:, None]), corner, PIXEL)
    return {
        "source": {
            "kind": "HEIGHT_MAP",
            "file": str(tmp_path / "dem.tif"),
            "site": "MAP",
            "site_easting": str(PLACE[0]),
            "site_northing": str(PLACE[1]),
        },
        "terrain": {"size_m": SIZE_M, "resolution": 33},
        "rocks": {"coverage": 0.0},
        "textures": {"set": "OWN", "mapping": "MAP", "albedo_file": str(tmp_path / "a.tif")},
        "surface": {
            "model": "LAMBERT",
            "albedo": 0.5,
            "albedo_variation": 0.0,
            "grain_amplitude_m": 0.0,
            "trough_dirt": 0.0,
            "slope_dirt": 0.0,
            "salt_share": 0.0,
            "ice_colour": "GREY",
        },
    }


def test_the_albedo_of_the_ground_is_the_images_at_its_coordinates(settings, tmp_path):
    run_job({"settings": complete(settings)}, tmp_path / "out", lambda *a, **k: None, "dem", CELL_M)
    (folder,) = (tmp_path / "out").iterdir()
    facts = json.loads((folder / "geometry.json").read_text(encoding="utf-8"))
    frame = map_frame_from_json(facts)
    assert frame is not None
    with rasterio.open(folder / "albedo.tif") as opened:
        albedo = opened.read(1)
        x, y = (np.reshape(each, albedo.shape) for each in opened.xy(*np.mgrid[: albedo.shape[0], : albedo.shape[1]]))
    wanted = law(*frame.to_map(x, y))
    inside = np.maximum(abs(x), abs(y)) < SIZE_M / 2 - CELL_M
    # The image is divided by its mean over the ground, 0.5 to the asymmetry of its pixels; the rest is single precision
    # and the 8-bit fractions with which textures are interpolated on some devices.
    ratio = albedo[inside] / wanted[inside]
    assert ratio.mean() == pytest.approx(1.0, abs=5e-3)
    assert ratio == pytest.approx(ratio.mean(), abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"source": {"metres_per_pixel": 0.5, "site": "OFFSET"}}, "the ground is on no map"),
        ({"textures": {"albedo_file": ""}}, "albedo_file"),
        ({"textures": {"set": "FROST"}}, r"textures\.set OWN"),
        ({"textures": {"roughness_file": "a.png"}}, r"leave textures\.roughness_file out"),
        ({"textures": {"albedo_file": "missing.tif"}}, "there is no such file"),
        ({"source": {"metres_per_pixel": 0.5}}, r"set it to 0, or source\.site to OFFSET"),
        ({"source": {"site_easting": ""}}, r"source\.site_easting is empty"),
        ({"source": {"site": "DEGREES", "site_longitude_deg": "30", "site_latitude_deg": "91"}}, "longitude first"),
    ],
)
def test_what_cannot_be_placed_is_a_sentence(settings, tmp_path, changes, told):
    changed = {topic: values | changes.get(topic, {}) for topic, values in settings.items()}
    for key in ("albedo_file", "roughness_file"):
        if (name := changed["textures"].get(key, "")) in ("missing.tif", "a.png"):
            changed["textures"][key] = str(tmp_path / name)
    with pytest.raises(IcyMoonError, match=told):
        build_scene(empty_scene(), complete(changed))

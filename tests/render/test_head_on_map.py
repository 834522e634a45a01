"""The map coordinates of the cameras beside a pair, in pair.json and in the export, against PROJ."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext

import numpy as np
import pytest
from icymoon.nodes.build_scene import build_scene
from icymoon.render.pairs.pair_folder import find_pairs
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.export import head
from icymoon.stereo.export.plug_in import FoldersContext
from map_systems import LONLAT, POLAR
from rendering import complete, empty_scene

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
warp = pytest.importorskip("rasterio.warp")

pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul")

SITE, HEIGHT_M = (418215.1, 724369.8), -1234.5
#: Where the cameras stand, in metres east and north of the site, and the azimuths that they look along, from the map's
#: up. One looks down, and has its image's upper edge along its azimuth.
CAMERAS = {"left": ((1.5, -2.0), 70.0), "above": ((-0.5, 0.25), 200.0)}


def _write_head(path):
    lines = []
    for name, ((x, y), azimuth_deg) in CAMERAS.items():
        ahead = [math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg)), 0.0]
        turn = {"forward": [0.0, 0.0, -1.0], "up": ahead} if name == "above" else {"forward": [*ahead[:2], -0.5]}
        keys = {"frame": "ZERO", "position_m": [x, y, 1.5], "width_px": 8, "height_px": 6, "field_deg": 40.0, **turn}
        lines += [f'[[camera]]\nname = "{name}"\nmodel = "PINHOLE"']
        lines += [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    path.write_text("\n".join(lines), encoding="utf-8")


def test_cameras_of_a_head_are_where_proj_has_them(tmp_path):
    _write_head(tmp_path / "head.toml")
    profile = {"driver": "GTiff", "width": 41, "height": 41, "count": 1, "dtype": "float32"}
    corner = rasterio.transform.from_origin(SITE[0] - 5.0, SITE[1] + 5.0, 0.25, 0.25)
    with rasterio.open(tmp_path / "dem.tif", "w", **profile, crs=POLAR, transform=corner) as out:
        out.write(np.full((41, 41), HEIGHT_M, np.float32), 1)
    easting, northing = map(str, SITE)
    settings = complete(
        {
            "source": {
                "kind": "HEIGHT_MAP",
                "file": str(tmp_path / "dem.tif"),
                "site": "MAP",
                "site_easting": easting,
                "site_northing": northing,
            },
            "terrain": {"size_m": 6.0, "resolution": 17},
            "rocks": {"coverage": 0.0},
            "surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0},
            "quality": {"samples": 1},
            "rig": {"width_px": 16, "height_px": 12, "head_file": str(tmp_path / "head.toml"), "images": "HEAD"},
        }
    )
    built = build_scene(empty_scene(), settings)
    render_pairs(built, expand_headings(settings), tmp_path / "set", 1, 0.0, lambda *a, **k: None)
    (pair,) = find_pairs(tmp_path / "set")
    stated = {camera["name"]: camera["on_map"] for camera in pair.data["head"]}
    assert set(stated) == set(CAMERAS)
    # The scale of the polar projection: a metre of ground is 2 / (1 - sin(latitude)) metres of the map.
    (_,), (latitude,) = warp.transform(POLAR, LONLAT, [SITE[0]], [SITE[1]])
    scale = 2 / (1 + math.sin(math.radians(-latitude)))
    for name, ((x, y), azimuth_deg) in CAMERAS.items():
        found = stated[name]
        # Blender's single precision is 1e-7 of metres here; the scale changes by 1e-6 over the site.
        assert found["easting"] == pytest.approx(SITE[0] + scale * x, abs=1e-5)
        assert found["northing"] == pytest.approx(SITE[1] + scale * y, abs=1e-5)
        assert found["height_m"] == pytest.approx(HEIGHT_M + 1.5, abs=1e-3)
        (longitude,), (latitude,) = warp.transform(POLAR, LONLAT, [found["easting"]], [found["northing"]])
        assert (longitude - found["longitude_deg"] + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)
        assert found["latitude_deg"] == pytest.approx(latitude, abs=1e-9)
        assert found["azimuth_grid_deg"] == pytest.approx(azimuth_deg, abs=1e-4)
        # About the south pole north is the longitude, clockwise of the map's up.
        assert (found["azimuth_true_deg"] - azimuth_deg + longitude + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-4)
    assert set(pair.data["cameras_on_map"]) == {"left", "right"}
    assert pair.data["cameras_on_map"]["left"]["easting"] != stated["left"]["easting"]
    context = FoldersContext("", print, lambda _: nullcontext(lambda _: None))
    head.write_folders([pair.folder], tmp_path / "out", context)
    (exported,) = (tmp_path / "out").glob("*/cameras.json")
    assert {c["name"]: c["on_map"] for c in json.loads(exported.read_text(encoding="utf-8"))["cameras"]} == stated

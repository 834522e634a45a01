"""Rays through an exported mesh, as a foreign reader reads it, meet the depth that the pair has."""

from __future__ import annotations

import json

import numpy as np
import pytest
from icymoon.formats import geotiff
from icymoon.render import geometry_worker, ground_files
from icymoon.render.geometry_worker import run_job
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.images.exr import read_truth
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import ROCK
from mesh_rays import depth_errors, heights_below, read_mesh
from rendering import complete, render

#: Relative, of depths: those of the pair and the corners in the file are of single precision, each right to 6e-8, and
#: a facet may be seen at 1/50 of its area, which makes 100 times of it.
_TOLERANCE = 1e-5
#: Pixels that may differ: rays that pass the edge of a rock by less than the corners are rounded, and facets that are
#: seen more edgewise.
_EDGES = 1e-3
NEAR = {
    "rig": {"height_m": 0.4, "baseline_m": 0.03, "pitch_deg": 50.0},
    "quality": {"samples": 1},
    "terrain": {"size_m": 3.0, "resolution": 65, "rms_slope_deg": 8.0},
}
ROCKS = {"coverage": 0.2, "smallest_m": 0.08, "largest_m": 0.3, "most": 20, "clear_radius_m": 0.0}
RELIEF = {"grain_size_m": 0.05, "grain_amplitude_m": 0.02}
SCENES: dict[str, list[dict]] = {
    "real relief": [NEAR, {"mesh": {"kind": "GRADED"}, "rocks": ROCKS, "surface": {**RELIEF, "relief": "REAL"}}],
    "real relief for the camera": [
        NEAR,
        {
            "mesh": {"kind": "GRADED"},
            "rocks": {"coverage": 0.0},
            "surface": {**RELIEF, "relief": "REAL", "model": "LAMBERT"},
            "quality": {"fine_relief": "CAMERA"},
        },
    ],
    "bump": [NEAR, {"mesh": {"kind": "GRADED"}, "rocks": ROCKS, "surface": {**RELIEF, "relief": "BUMP"}}],
    "real relief of a grid": [
        NEAR,
        {"rocks": {"coverage": 0.0}, "surface": {"relief": "REAL", "grain_size_m": 0.4, "grain_amplitude_m": 0.05}},
    ],
    "displaced grid and rocks": [NEAR, {"rocks": ROCKS, "surface": {**RELIEF, "relief": "DISPLACEMENT"}}],
    "displaced broken rocks": [
        NEAR,
        {"rocks": {**ROCKS, "family": "BROKEN_ICE"}, "surface": {**RELIEF, "relief": "DISPLACEMENT"}},
    ],
}


def export(folder, settings, kind):
    """The files of a scene's ground, and what is known of it."""
    run_job({"settings": settings}, folder, lambda *a, **k: None, kind)
    (made,) = folder.iterdir()
    facts = json.loads((made / "geometry.json").read_text(encoding="utf-8"))
    return [made / name for name in facts["files"]], facts


def read_all(files):
    """Positions and triangles of several files as one."""
    found = [read_mesh(path) for path in files]
    starts = np.cumsum([0, *(len(places) for places, _ in found)])
    return (
        np.concatenate([places for places, _ in found]),
        np.concatenate([triangles + start for (_, triangles), start in zip(found, starts, strict=False)]),
    )


def check(pair, files):
    errors = depth_errors(pair, *read_all(files))
    known = errors[~np.isnan(errors)]
    assert known.size > errors.size / 2
    assert (known > _TOLERANCE).mean() <= _EDGES


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("name", SCENES)
def test_rays_meet_the_depth_of_the_pair(name, tmp_path):
    pair, _ = render(tmp_path / "pair", *SCENES[name])
    files, facts = export(tmp_path / "out", pair.settings, "gltf")
    check(pair, files)
    assert [line.split(":")[0] for line in facts["left_out"]] == (
        [] if name.startswith("displaced") else ["surface.grain_amplitude_m"]
    )
    if "rock" in facts["meshes"]:
        assert (read_truth(pair.truth("left"), "left").semantic == ROCK).mean() > 0.01


def test_displacement_of_ground_from_a_file_is_in_the_mesh(tmp_path):
    at = np.linspace(-1.0, 1.0, 41)
    np.save(tmp_path / "heights.npy", 0.1 * at[None, :] + 0.05 * np.sin(7.0 * at[:, None]))
    pair, _ = render(
        tmp_path / "pair",
        NEAR,
        {
            "rocks": {"coverage": 0.0},
            "surface": {**RELIEF, "relief": "DISPLACEMENT"},
            "source": {
                "kind": "HEIGHT_MAP",
                "file": str(tmp_path / "heights.npy"),
                "metres_per_pixel": 0.05,
                "height_scale_m": 1.0,
                "centre": True,
            },
        },
    )
    check(pair, export(tmp_path / "out", pair.settings, "ply")[0])


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("kind", ["ply", "obj", "usd"])
def test_each_format_has_the_triangles_that_were_rendered(kind, tmp_path):
    pair, _ = render(tmp_path / "pair", *SCENES["displaced grid and rocks"])
    files, facts = export(tmp_path / "out", pair.settings, kind)
    check(pair, files)
    assert sum(of["triangles"] for of in facts["meshes"].values()) == len(read_all(files)[1])


@pytest.mark.heavy
@pytest.mark.parametrize(
    "presets",
    [
        pytest.param(presets, id="+".join(presets), marks=marks)
        for presets, marks in (
            (("gallery/trench",), pytest.mark.long),
            (("scenes/workspace_europa_lander",), ()),
            (("scenes/enceladus_block_field", "rocks/block_field"), pytest.mark.long),
        )
    ],
)
def test_shipped_scenes_are_exported_as_they_were_rendered(presets, tmp_path):
    """Small images, so that the meshes are coarse."""
    small = {
        "rig": {"width_px": 96, "height_px": 72},
        "quality": {"samples": 1, "denoiser": "NONE", "threads": 2},
        "rocks": {"most": 300},
    }
    pair, _ = render(tmp_path / "pair", *map(load_preset, presets), small)
    check(pair, export(tmp_path / "out", pair.settings, "gltf")[0])


def test_maps_and_meshes_have_the_same_heights(tmp_path):
    """Rays straight down meet the mesh at the heights of the map. Cycles' samples are 5e-5 of a cell beside its centre,
    and relief is as steep as 1."""
    settings = complete(NEAR, {"rocks": {"coverage": 0.0}, "surface": {**RELIEF, "relief": "DISPLACEMENT"}})
    cell_m = 0.25
    run_job({"settings": settings}, tmp_path / "dem", lambda *a, **k: None, "dem", cell_m)
    heights = geotiff.read(next((tmp_path / "dem").iterdir()) / "dem.tif").heights_m
    centres = (np.arange(len(heights)) + 0.5) * cell_m - settings.terrain.size_m / 2
    east, north = np.meshgrid(centres, centres[::-1])
    found = heights_below(east.ravel(), north.ravel(), *read_all(export(tmp_path / "ply", settings, "ply")[0]))
    assert found.reshape(heights.shape) == pytest.approx(heights, abs=5e-5 * cell_m)


@pytest.mark.parametrize("kind", ["ply", "obj"])
def test_too_many_triangles_are_refused_before_they_are_made(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(ground_files, "MAX_TRIANGLES", 100_000)
    monkeypatch.setattr(geometry_worker, "read_mesh_triangles", lambda mesh: pytest.fail("memory was taken"))
    with pytest.raises(IcyMoonError, match=f"21 meshes .* 0 million triangles.* As {kind} .*export usd or gltf"):
        export(tmp_path, complete(*SCENES["bump"], {"mesh": {"kind": "GRID"}}), kind)


def test_rocks_of_one_shape_share_their_triangles(tmp_path):
    files, facts = export(tmp_path, complete(*SCENES["bump"], {"mesh": {"kind": "GRID"}}), "usd")
    of = facts["meshes"]["rock"]
    assert of["shapes"] < of["instances"] == 20
    assert files[0].read_text(encoding="utf-8").count("def Mesh") == of["shapes"] + 1

"""The true heights of a workspace that a worker writes beside a pair."""

from __future__ import annotations

from contextlib import closing

import bpy
import numpy as np
import pytest
from icymoon.formats.exr_pixels import decode_parts
from icymoon.nodes.build_scene import build_scene
from icymoon.render.ground_maps import make_heights, make_materials
from icymoon.render.pairs.pair_folder import find_changed_files
from icymoon.render.pairs.workspace_cells import find_workspace_extent
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.ray_stage import CannotTrace, SceneRays
from icymoon.render.render_pair import open_render_scene
from icymoon.render.worker import render_pairs
from icymoon.settings.pair_ids import make_pair_id
from rendering import complete, empty_scene, on_height_map, render

#: Ground of a height map that no symmetry confuses.
SIZE_M = 8.0
ON = {"workspace": {"cell_m": 0.1, "east_m": 0.5, "north_m": 1.0, "size_m": 2.0}}


def slope(x, y):
    return 0.1 * x + 0.25 * y


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    at = np.linspace(-SIZE_M / 2, SIZE_M / 2, 33)
    np.save(folder / "heights.npy", slope(at[None, :], at[::-1, None]))
    return {
        **on_height_map(folder / "heights.npy", SIZE_M),
        "rocks": {"coverage": 0.0},
        "surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0},
    }


@pytest.mark.heavy
def test_the_heights_are_those_of_the_ground(plane, tmp_path):
    pair, _ = render(tmp_path / "set", plane, ON)
    stated = pair.data["workspace"]
    heights = np.load(pair.folder / stated["file"])
    (west, north), cell = stated["origin_m"], stated["cell_m"]
    east = west + (np.arange(20) + 0.5) * cell
    y = north - (np.arange(20) + 0.5) * cell
    true = slope(east[None, :], y[:, None])
    assert heights.shape == (2, 20, 20)
    assert (west, north) == pytest.approx((-0.5, 2.0))
    # The mesh and the file are of single precision, at some metres.
    assert np.abs(heights - true).max() < 1e-6
    assert stated["file"] in pair.data["files"]
    assert not find_changed_files(pair)


@pytest.mark.heavy
def test_rocks_are_in_the_one_and_not_in_the_other(plane, tmp_path):
    rocky = {"rocks": {"coverage": 0.3, "smallest_m": 0.3, "largest_m": 0.6}}
    pair, built = render(tmp_path / "set", plane, rocky, ON)
    top, ground = np.load(pair.folder / "workspace.npy")
    assert 0.02 < (top - ground > 0.03).mean() < 0.9
    assert (top >= ground - 1e-4).all()
    assert not any(item.hide_render for item in built.collection.all_objects if item.type == "MESH")


def add(built, data, z):
    """An object of the user's over the workspace."""
    item = bpy.data.objects.new("Own", data)
    built.collection.objects.link(item)
    item.location = (0.5, 1.0, z)
    return item


def some_quad():
    mesh = bpy.data.meshes.new("Own")
    mesh.from_pydata([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [], [(0, 1, 2, 3)])
    return mesh


def test_heights_are_of_ground_and_rocks_alone_and_rays_meet_the_rest_again_after(plane):
    """A sheet of the user's lies above all of the workspace, and a wire that no ray could meet."""
    settings = complete(plane, {"rocks": {"coverage": 0.3, "smallest_m": 0.3, "largest_m": 0.6}}, ON)
    built = build_scene(empty_scene(), settings)
    add(built, some_quad(), 3.0)
    extent = find_workspace_extent(settings.workspace)
    east, north = extent.west_m + (np.arange(20) + 0.5) * 0.1, extent.north_m - (np.arange(20) + 0.5) * 0.1
    eye, down = np.array([0.5, 1.0, 9.0]), np.array([[0.0, 0.0, -1.0]])
    with open_render_scene(built, 1) as scene, closing(SceneRays(scene, np.inf)) as rays:
        top, ground = make_heights(rays, extent)
        stage = rays.prepare()
        assert stage.ground_tracer.intersect(eye, down, 0.0, np.inf).along == pytest.approx(6.0)
        add(built, bpy.data.curves.new("Own", "CURVE"), 4.0)
        with pytest.raises(CannotTrace, match=r"the object Own.* has no mesh"):
            rays.prepare()
        again = make_heights(rays, extent)
    assert np.abs(ground - slope(east[None, :], north[:, None])).max() < 1e-6
    assert 0.02 < (top - ground > 0.03).mean() < 0.9
    assert (top >= ground).all()
    assert top.max() < 2.0
    assert np.array_equal(again, [top, ground])


SALTY = {
    "surface": {"albedo": 0.6, "salt": "OWN", "salt_share": 0.5, "salt_patch_m": 1.0},
    "workspace": {"materials": True},
}


@pytest.mark.heavy
def test_the_true_albedo_is_the_mixture_of_ice_and_salt_by_area(plane, tmp_path):
    """Salt of the reflectances (1, .85, .6) relative to ice of albedo .6, and nothing else, on the plane."""
    pair, _ = render(tmp_path / "set", plane, ON, SALTY)
    stated = pair.data["workspace"]
    found = np.load(pair.folder / stated["materials"])
    albedo, salt = found[:3], found[3]
    assert found.shape == (4, 20, 20)
    assert 0.1 < salt.mean() < 0.9
    assert ((salt > 0.05) & (salt < 0.95)).mean() < 0.3
    mixed = 0.6 * (1 - salt * (1 - np.array([1.0, 0.85, 0.6]))[:, None, None])
    assert np.abs(albedo - mixed).max() < 1e-5  # some roundings of single precision, of numbers below 1
    assert stated["materials"] in pair.data["files"]
    assert not find_changed_files(pair)


@pytest.mark.heavy
def test_frost_and_dirt_hide_salt(plane, tmp_path):
    """Frost all over; and dirt on level ground, which leaves a share of (1 - cos) / (1 - cos 45°) free on a slope."""
    free = (1 - 1 / np.sqrt(1 + 0.1**2 + 0.25**2)) / (1 - np.sqrt(0.5))
    found = []
    for part in ({}, {"frost_share": 1.0}, {"dirt": "SULPHUR", "slope_dirt": -1.0}):
        settings = complete(plane, ON, SALTY, {"surface": {"model": "PRINCIPLED", **part}})
        built = build_scene(empty_scene(), settings)
        with open_render_scene(built, 1) as scene:
            found.append(make_materials(built, scene, tmp_path, find_workspace_extent(settings.workspace))[3])
    plain, frosted, dirty = found
    assert plain.mean() > 0.1
    assert frosted.max() < 0.01
    np.testing.assert_allclose(dirty, free * plain, atol=1e-4)


@pytest.mark.heavy
def test_maps_of_albedo_and_salts_change_nothing_of_the_pairs_after_them(plane, tmp_path):
    rocky = {"rocks": {"coverage": 0.3, "smallest_m": 0.3, "largest_m": 0.6}, "dataset": {"headings": 2}}
    settings = complete(plane, rocky, ON, SALTY)
    planned = expand_headings(settings)
    made = {}
    for name, wanted in (("both", planned), ("second", planned[1:])):
        built = build_scene(empty_scene(), settings)
        made[name] = render_pairs(built, wanted, tmp_path / name, 1, 0.0, lambda *a, **k: None)[-1]
    assert made["both"].name == made["second"].name
    for file in ("left.exr", "right.exr"):
        one, other = (
            {name: each for _, found in decode_parts((folder / file).read_bytes()) for name, each in found.items()}
            for folder in made.values()
        )
        assert one.keys() == other.keys()
        for name, values in one.items():
            np.testing.assert_array_equal(values, other[name], err_msg=name)


def test_without_a_workspace_ids_are_as_before():
    base = complete()
    assert make_pair_id(base) != make_pair_id(complete(ON))
    assert make_pair_id(complete({"workspace": {"cell_m": 0.0}})) == make_pair_id(base)
    assert make_pair_id(complete({"workspace": {"materials": False}}, ON)) == make_pair_id(complete(ON))

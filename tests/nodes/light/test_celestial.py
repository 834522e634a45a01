"""Stars and rings as the cameras see them, against their irradiance, the truth and the ground."""

import math
from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks import fingerprint
from icymoon.operators import sidebar_text
from icymoon.physics.light.saturn_rings import RINGS, ring_brightness
from icymoon.physics.light.sky import compute_sky
from icymoon.physics.light.stars import stars_above_horizon
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth
from icymoon.stereo.images.exr import read_view
from icymoon.support.labels import PLANET
from rendering import complete, empty_scene, render

LAMBERT = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 40.0},
    "mesh": {"kind": "GRID"},
    "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0, "albedo": 0.8},
    "quality": {"diffuse_bounces": 0},
}
NIGHT = {"sun_azimuth_deg": 180.0, "sun_elevation_deg": -30.0}
SATURN = {
    "planet": True,
    "planet_angular_diameter_deg": 29.33,
    "planet_flattening": 0.098,
    "latitude_deg": -80.0,
    "planet_elevation_deg": 40.0,
    "planet_azimuth_deg": 0.0,
    "planet_albedo": 0.499,
    "planet_phase_law": "SATURN",
    "planet_rings": True,
}
UP = {"rig": {"width_px": 320, "height_px": 240, "pitch_deg": -50.0}}


def rotation(pair, eye):
    """From camera axes (OpenCV's) to the world's."""
    return np.array(pair.data["poses_camera_to_world"][eye])[:3, :3]


def solid_angles(camera):
    """Of each pixel, sr (H, W)."""
    x = (np.arange(camera.width_px) + 0.5 - camera.cx_px) / camera.focal_px
    y = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    return (1 + x[None, :] ** 2 + y[:, None] ** 2) ** -1.5 / camera.focal_px**2


@pytest.mark.long
@pytest.mark.heavy
def test_each_star_has_its_light_and_place_and_no_depth(tmp_path):
    pair, _ = render(
        tmp_path,
        LAMBERT,
        UP,
        {
            "light": NIGHT | {"stars": True, "latitude_deg": 45.0},
            "rig": {"heading_deg": 90.0},
            "quality": {"samples": 100},
        },
    )
    shown = stars_above_horizon(2.5, 1, compute_sky(pair.settings.light).from_j2000)
    for eye in ("left", "right"):  # at infinity: both eyes see them in the same pixels
        view, camera = read_view(pair.image(eye)), pair.camera
        light = view.radiance * solid_angles(camera)[..., None]
        seen = shown.direction @ rotation(pair, eye)
        column, row = (seen[:, k] / seen[:, 2] * camera.focal_px + c for k, c in ((0, camera.cx_px), (1, camera.cy_px)))
        inside = np.nonzero((seen[:, 2] > 0) & (column > 6) & (column < 314) & (row > 6) & (row < 234))[0]
        assert len(inside) > 5
        for k in inside:
            u, v = int(column[k]), int(row[k])
            around = light[v - 4 : v + 5, u - 4 : u + 5]
            # Where it falls in the pixels 2 % (see celestial.STAR_PX), the paths' noise 1 %, at 16 of them 4 %.
            np.testing.assert_allclose(around.sum(axis=(0, 1)), shown.irradiance_wm2[k], rtol=0.05)
            grey = around.sum(axis=2)
            middle = [(grey * axis).sum() / grey.sum() for axis in np.mgrid[v - 4 : v + 5, u - 4 : u + 5] + 0.5]
            assert np.hypot(middle[0] - row[k], middle[1] - column[k]) < 0.15
        assert np.isnan(view.depth).all()
        assert np.isnan(find_scene_depth(view)).all()
        assert not view.semantic.any()
        assert not view.instance.any()


@pytest.mark.long
def test_stars_give_the_ground_nothing_and_are_in_no_group(tmp_path):
    for light in (NIGHT, {"sun_elevation_deg": 30.0}):
        pairs = [
            render(tmp_path, LAMBERT, {"rig": {"pitch_deg": 10.0}, "light": light | more})[0]
            for more in ({}, {"stars": True, "stars_faintest_mag": 6.0})
        ]
        views = [read_view(pair.image("left")) for pair in pairs]
        assert (views[0].semantic[48:] > 0).all()
        assert (views[0].semantic[:24] == 0).all()
        # By night the ground is black without noise; by day two samples of the Sun's disc differ by 1e-3.
        np.testing.assert_allclose(views[0].radiance[50:], views[1].radiance[50:], rtol=3e-3)
        np.testing.assert_array_equal(views[0].depth, views[1].depth)
        assert views[0].groups == {}
        assert views[1].groups["Sun"][:24].max() == 0
        assert views[1].radiance[:24].max() > 0  # so the Sun's factor leaves the stars alone


def test_stars_are_made_for_the_lens_and_cost_nothing_when_off():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete({"light": NIGHT}))
    assert not built.several_lights
    assert not [item for item in bpy.data.objects if "Stars" in item.name]
    sizes = []
    changes: tuple[dict[str, Any], ...] = (
        {"light": {"stars": True}},
        {"light": {"stars": True}, "rig": {"focal_length_mm": 64.0}},
        {"light": {"stars": True, "stars_faintest_mag": 5.0}},
        {"light": {"stars": False}},
    )
    for change in changes:
        preview.show_settings(built, complete({"light": NIGHT}, change), 65)
        built = scenes.find_built(scene)
        assert not built.edited
        found = [item for item in bpy.data.objects if "Stars" in item.name]
        assert [item.name for item in found] == (["Icy Moon Stars"] if change["light"]["stars"] else [])
        sizes += [
            (len(item.data.vertices) // 7, np.linalg.norm(item.data.vertices[1].co - item.data.vertices[0].co))
            for item in found
        ]
    (few, wide), (same, narrow), (more, _) = sizes
    assert few == same < 92 < more
    assert wide == pytest.approx(2 * narrow, rel=1e-3)
    assert not [m for m in bpy.data.materials if "Stars" in m.name]


@pytest.mark.long
def test_rings_are_seen_as_bright_as_they_are_before_and_behind_the_planet(tmp_path):
    light = SATURN | {"planet_elevation_deg": 25.0, "sun_elevation_deg": -30.0, "sun_azimuth_deg": 150.0}
    rig = {"rig": {"width_px": 320, "height_px": 240, "pitch_deg": -40.0, "heading_deg": 0.0}}
    images = {}
    for has in (True, False):
        pair, _ = render(tmp_path, LAMBERT, rig, {"light": light | {"planet_rings": has}, "quality": {"samples": 16}})
        images[has] = read_view(pair.image("left"))
    view, bare, camera = images[True], images[False], pair.camera
    assert set(np.unique(view.semantic)) == {0, PLANET}
    assert np.isnan(find_scene_depth(view)).all()
    np.testing.assert_allclose(sum(view.groups.values()), view.radiance, atol=1e-5 * view.radiance.max())
    shown = compute_sky(complete().light | light).planet
    x = (np.arange(camera.width_px) + 0.5 - camera.cx_px) / camera.focal_px
    y = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    ray = np.stack(np.broadcast_arrays(x[None, :], y[:, None], np.ones(1)), axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    ray = ray @ rotation(pair, "left").T
    # Beside the planet and outside its shadow: the formula at the point of the plane that the pixel's ray meets.
    distance = (shown.direction @ shown.pole) / (ray @ shown.pole)
    point = distance[..., None] * ray - shown.direction
    radius = np.linalg.norm(point, axis=-1) / math.sin(math.radians(29.33 / 2)) * 60268
    sun = float(shown.sun @ shown.pole)
    lit_side = sun * float(-shown.direction @ shown.pole) > 0
    for ring in (RINGS["A"], RINGS["B"], RINGS["C"]):
        inside = (radius > 60268 * ring.inner + 2500) & (radius < 60268 * ring.outer - 2500) & (distance > 0)
        lit = inside & (bare.semantic == 0) & (view.radiance[..., 0] > 0)
        assert lit.sum() > 100
        expected = (
            14.82
            / math.pi
            * ring_brightness(ring, abs(sun), np.abs(ray[lit] @ shown.pole), np.arccos(-ray[lit] @ shown.sun), lit_side)
        )
        ratio = view.radiance[lit][:, 0] / expected
        # Triangles between circles a sixth of a ring apart; at its edges a pixel holds a part of the ring.
        assert np.median(ratio) == pytest.approx(1, abs=0.01)
        assert np.mean(np.abs(ratio - 1) < 0.03) > 0.9
    # Before the planet ring B hides it; behind it nothing of the rings is seen.
    before = (bare.radiance[..., 0] > 0) & (distance > 0) & (distance < 0.97) & (radius > 95000) & (radius < 114000)
    assert before.sum() > 20
    assert not np.allclose(view.radiance[before], bare.radiance[before], rtol=0.05)
    behind = (bare.radiance[..., 0] > 0) & (distance > 1.02) & (radius < 136000)
    assert behind.sum() > 500
    assert np.isclose(view.radiance[behind], bare.radiance[behind], rtol=0.03).mean() > 0.9  # but for the limb


@pytest.mark.long
@pytest.mark.heavy
def test_saturn_shines_less_through_the_shadow_of_its_rings(tmp_path):
    light = SATURN | {"planet_elevation_deg": 15.0, "sun_elevation_deg": -30.0, "sun_azimuth_deg": 150.0}
    found = {}
    for has in (True, False):
        pair, _ = render(
            tmp_path,
            LAMBERT,
            {
                "light": light | {"planet_rings": has},
                "quality": {"samples": 256},
                "rig": {"pitch_deg": 90.0, "width_px": 48, "height_px": 36},
            },
        )
        expected = compute_sky(pair.settings.light).ground_irradiance_wm2[1] * 0.8 / math.pi
        found[has] = read_view(pair.image("left")).radiance.mean()
        assert found[has] == pytest.approx(expected, rel=2e-3)
    assert found[True] < 0.97 * found[False]


def mark_planet(built):
    """The marks of the planet's object, mesh and materials."""
    return fingerprint.read_marks(built.collection, "planet").parts


def test_planet_keeps_its_mesh_while_only_the_sun_moves():
    low = SATURN | {"planet_elevation_deg": 5.0}  # the horizon cuts the disc
    changes: tuple[tuple[dict[str, Any], bool], ...] = (
        ({"sun_elevation_deg": 12.0}, True),
        ({"sun_elevation_deg": 12.0, "sun_azimuth_deg": 200.0}, True),
        ({"planet_elevation_deg": 6.0}, False),
        ({"planet_elevation_deg": 6.0, "planet_angular_diameter_deg": 20.0}, False),
    )
    fresh = [mark_planet(scenes.build_scene(empty_scene(), complete({"light": low | change}))) for change, _ in changes]
    assert len({marks["planet materials"] for marks in fresh}) == len(fresh)
    built = scenes.build_scene(empty_scene(), complete({"light": low}))
    for (change, keeps), expected in zip(changes, fresh, strict=True):
        mesh = bpy.data.objects["Icy Moon Planet"].data.as_pointer()
        preview.show_settings(built, complete({"light": low | change}), 65)
        assert (bpy.data.objects["Icy Moon Planet"].data.as_pointer() == mesh) == keeps
        assert mark_planet(built) == expected
        assert not built.edited


def test_edited_planet_is_made_again_when_the_sun_moves():
    built = scenes.build_scene(empty_scene(), complete({"light": SATURN}))
    mesh = bpy.data.objects["Icy Moon Planet"].data
    before = mark_planet(built)["planet data"]
    mesh.vertices[0].co.x += 1e4
    assert mark_planet(built)["planet data"] != before
    preview.show_settings(built, complete({"light": SATURN | {"sun_elevation_deg": 12.0}}), 65)
    assert mark_planet(built)["planet data"] == before


def test_rings_give_the_ground_nothing_and_go_when_they_are_below():
    built = scenes.build_scene(empty_scene(), complete({"light": SATURN}))
    assert [item.name for item in bpy.data.objects if "Rings" in item.name] == ["Icy Moon Rings"]
    item = bpy.data.objects["Icy Moon Rings"]
    assert not any((item.visible_diffuse, item.visible_shadow, item.visible_glossy))
    assert min(v.co.z for v in item.data.vertices) >= 0
    for change in (
        {"planet_elevation_deg": -60.0},
        {"planet": False},
        {"planet_rings": False},
        {"planet_elevation_deg": 10.0},
    ):  # the last has the site exactly in their plane
        preview.show_settings(built, complete({"light": SATURN | change}), 65)
        assert not [item for item in bpy.data.objects if "Rings" in item.name]
        assert not [m for m in bpy.data.materials if "Rings" in m.name]
        assert not built.edited
    built = scenes.build_scene(
        empty_scene(),
        complete(
            {
                "terrain": {"body_radius_m": 1.5608e6},
                "light": {"directions_from": "DATE", "body": "EUROPA", "planet": True, "planet_rings": True},
            }
        ),
    )
    assert "Only Saturn has bright rings" in " ".join(built.warnings)


def test_the_panel_says_how_the_rings_stand_and_that_there_is_an_eclipse():
    light = complete({"light": SATURN}).light
    assert "Rings 30° from edge-on, seen from north" in sidebar_text.list_sky_lines(light)
    assert "Rings exactly edge-on: not seen" in sidebar_text.list_sky_lines(light | {"planet_elevation_deg": 10.0})
    eclipsed = light | {"sun_elevation_deg": 40.0, "sun_azimuth_deg": 0.0}
    assert "Eclipse: planet hides 100 % of Sun" in sidebar_text.list_sky_lines(eclipsed)
    assert max(map(len, sidebar_text.list_sky_lines(eclipsed))) <= 42


@pytest.mark.parametrize("elevation_deg", [40.0, 49.0, -5.0])
def test_the_panel_shows_the_light_of_the_sun_that_the_scene_renders(elevation_deg):
    """Less what the planet hides, all, part or nothing of it, and 0 by night."""
    settings = complete(
        {
            "light": {
                "planet": True,
                "planet_elevation_deg": 40.0,
                "planet_azimuth_deg": 0.0,
                "planet_angular_diameter_deg": 18.0,
                "planet_flattening": 0.0,
                "sun_elevation_deg": elevation_deg,
                "sun_azimuth_deg": 0.0,
            }
        }
    )
    built = scenes.build_scene(empty_scene(), settings)
    assert (compute_sky(settings.light).eclipse > 0) == (elevation_deg > 0)
    lamp = float(built.sun.data.energy)
    shown = next(line for line in sidebar_text.list_sky_lines(settings.light) if "W/m²" in line)
    assert shown.split()[0] == f"{lamp:.3g}"

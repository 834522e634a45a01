"""The other moons as the cameras see them: their light, their order before and behind the planet, their truth."""

import math

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.physics.light.sky import compute_sky
from icymoon.physics.light.sunlight import sun_colour
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth
from icymoon.stereo.images.exr import read_view
from icymoon.support.labels import PLANET
from rendering import complete, empty_scene, render

FLAT = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 40.0},
    "mesh": {"kind": "GRID"},
    "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0},
}
#: Mimas crosses Saturn's disc, Titan is behind it, Dione and Rhea stand above it, Tethys in the east.
TRANSIT = {
    "directions_from": "DATE",
    "date_utc": "2038-08-03T10:20",
    "latitude_deg": 0.0,
    "longitude_deg": 40.0,
    "planet": True,
    "planet_phase_law": "SATURN",
    "moons": True,
}
#: West, from 35° to 85° high, with pixels 0.28° wide.
WEST = {
    "width_px": 240,
    "height_px": 180,
    "focal_length_mm": 51.0,
    "sensor_width_mm": 60.0,
    "heading_deg": 270.0,
    "pitch_deg": -60.0,
}


def find_pixel(camera, pose, direction):
    """Column and row, in pixels, of a direction in the world."""
    seen = np.array(pose)[:3, :3].T @ direction
    return (
        seen[0] / seen[2] * camera.focal_px + camera.cx_px,
        seen[1] / seen[2] * camera.focal_px + camera.cy_px,
    )


@pytest.mark.long
def test_moons_have_their_light_and_hide_behind_the_planet(tmp_path):
    """The light of an image with moons, less that of one without, around the place of each moon. Mimas also hides a
    part of Saturn as large as itself."""
    views = {}
    for moons in (True, False):
        pair, _ = render(tmp_path, FLAT, {"light": TRANSIT | {"moons": moons}, "rig": WEST, "quality": {"samples": 64}})
        views[moons] = read_view(pair.image("left"))
        if moons:
            camera, pose, settings = pair.camera, pair.data["poses_camera_to_world"]["left"], pair.settings
            assert {moon["name"] for moon in pair.data["light"]["moons"]} >= {"MIMAS", "TITAN", "RHEA"}
        else:
            assert "moons" not in pair.data["light"]
    sky, colour = compute_sky(settings.light), sun_colour(settings.light.sun_temperature_k)
    x = (np.arange(camera.width_px) + 0.5 - camera.cx_px) / camera.focal_px
    y = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    solid_angle = (1 + x[None, :] ** 2 + y[:, None] ** 2) ** -1.5 / camera.focal_px**2
    more = (views[True].radiance - views[False].radiance) * solid_angle[..., None]
    before = views[False].radiance
    for moon in sky.moons:
        if moon.name == "TETHYS":
            continue
        column, row = find_pixel(camera, pose, moon.globe.direction)
        u, v = int(column), int(row)
        near = np.s_[v - 4 : v + 5, u - 4 : u + 5]
        found = more[near].sum(axis=(0, 1))
        if moon.name == "TITAN":
            assert np.abs(more[near]).max() < 1e-6 * before[near].max()
            continue
        hidden = math.pi * math.sin(math.radians(moon.globe.angular_diameter_deg / 2)) ** 2
        expected = moon.irradiance_wm2 * colour - hidden * before[near].mean(axis=(0, 1))
        # Stars of the same width are within 5 % where they fall between pixels; so are moons and what they hide.
        np.testing.assert_allclose(found, expected, atol=0.06 * moon.irradiance_wm2.max())
    assert np.array_equal(views[True].depth, views[False].depth, equal_nan=True)
    assert np.isnan(find_scene_depth(views[True])).all()
    assert set(np.unique(views[True].semantic)) == {0, PLANET}


@pytest.mark.long
def test_a_wide_moon_is_a_disc_with_the_label_of_the_planet(tmp_path):
    """Tethys in the east, 0.367° wide, with pixels of 0.0125°: 29 px."""
    rig = WEST | {"heading_deg": 87.6, "pitch_deg": -44.2, "focal_length_mm": 1146.0, "sensor_width_mm": 20.0}
    rig |= {"width_px": 80, "height_px": 60}
    pair, _ = render(tmp_path, FLAT, {"light": TRANSIT, "rig": rig, "quality": {"samples": 16}})
    view, camera = read_view(pair.image("left")), pair.camera
    moon = next(each for each in compute_sky(pair.settings.light).moons if each.name == "TETHYS")
    radius = math.radians(moon.globe.angular_diameter_deg / 2) * camera.focal_px
    labelled = view.semantic == PLANET
    # A circle's area on a grid of pixels is good to about half the root of its circumference.
    assert labelled.sum() == pytest.approx(math.pi * radius**2, rel=0.02)
    light = view.radiance.sum(axis=(0, 1)) / camera.focal_px**2
    colour = sun_colour(pair.settings.light.sun_temperature_k)
    np.testing.assert_allclose(light, moon.irradiance_wm2 * colour, rtol=0.01)
    assert np.isnan(find_scene_depth(view)).all()


def test_moons_light_nothing_and_go_with_the_setting():
    scene = empty_scene()
    settings = complete(FLAT, {"light": TRANSIT})
    built = scenes.build_scene(scene, settings)
    item = bpy.data.objects["Icy Moon Moons"]
    assert not any((item.visible_diffuse, item.visible_shadow, item.visible_glossy))
    assert item.lightgroup == ""
    assert min(vertex.co.z for vertex in item.data.vertices) > -200  # cut at the horizon, 0.2° under the horizontal
    assert not built.warnings
    for change, said in (({"moons": False}, False), ({"directions_from": "ANGLES"}, True), ({"planet": False}, False)):
        built = scenes.build_scene(empty_scene(), complete(FLAT, {"light": TRANSIT | change}))
        assert not [each for each in bpy.data.objects if "Moons" in each.name]
        assert ("light.moons has no effect" in " ".join(built.warnings)) == said

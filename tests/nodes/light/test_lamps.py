"""Rendered lamps against their laws: inverse square, Lambert, cone, Hapke, light groups, places, factors."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hapke_rendering import angles, picture, rays
from icymoon.formats.ies import read_ies
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.eyes_above_ground import find_reasons
from icymoon.nodes.light.lamps import find_lamp_matrix
from icymoon.physics.light.lamps import find_light_factors, intensity, pair_power_w
from icymoon.physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
from icymoon.render.pairs.pair_folder import EYES, Pair
from icymoon.stereo.images.develop import develop, scale_radiance
from icymoon.stereo.images.exr import View, read_view
from icymoon.support.arrays import Array
from icymoon.support.labels import TERRAIN
from lit_scenes import NIGHT
from rendering import complete, empty_scene, render

PLANE = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 40.0},
    "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0, "albedo": 0.8},
    "quality": {"diffuse_bounces": 0, "samples": 16},
    "light": NIGHT,
}
DOWN = {"pitch_deg": 90.0, "width_px": 32, "height_px": 24, "height_m": 2.0, "sensor_width_mm": 60.0}
LAMP = {"place": "SITE", "x_m": 0.0, "y_m": 0.0, "elevation_deg": -90.0, "power_w": 10.0, "size_m": 1e-3}


def make_lamp(kind: str, height_m: float, **more: object) -> dict[str, object]:
    return LAMP | {"kind": kind, "z_m": height_m, "size_m": 1e-3 * min(height_m, 1.0)} | more


def see_from_above(width_m: float) -> dict[str, float]:
    """A rig that sees this width of the ground."""
    return DOWN | {"focal_length_mm": 60.0 * 2.0 / width_m}


def by_formula(pair: Pair, view: View, k: int) -> Array:
    """Irradiance (H, W) of a level ground from lamp ``k``, a point at its place."""
    lamp, stated = pair.settings.light.lamps[k], pair.data["light"]["lamps"][k]
    pose = np.array(pair.data["poses_rectified_to_world"]["left"])
    camera = pair.camera
    x, y = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    ahead = np.stack([(x - camera.cx_px) / camera.focal_px, (y - camera.cy_px) / camera.focal_px, 0 * x + 1], axis=-1)
    points = pose[:3, 3] + ahead @ pose[:3, :3].T * view.depth[..., None]
    way = np.array(stated["position_m"]) - points
    distance = np.linalg.norm(way, axis=-1)
    cosine = way @ -np.array(stated["direction_to_world"]) / distance
    return pair_power_w(lamp, pair.settings.light) * intensity(lamp, cosine) * (way[..., 2] / distance) / distance**2


def read(pair: Pair) -> View:
    return read_view(pair.image("left"))


def test_a_lamp_at_night_has_its_power_its_law_and_its_light_group(tmp_path):
    """One lamp, so that no sample chooses between lights and nothing is noise."""
    light = {"lamps": [make_lamp("SPOT", 2.0, cone_deg=120.0, blend=1.0, temperature_k=3000.0)]}
    pair, built = render(tmp_path, PLANE, {"rig": see_from_above(1.2), "light": light})
    view = read(pair)
    assert not built.warnings
    assert not built.edited
    expected = 0.8 / math.pi * by_formula(pair, view, 0)
    # A pixel's mean differs from its middle by its curvature, 3e-4 here.
    np.testing.assert_allclose(view.radiance.mean(axis=-1), expected, rtol=5e-3)
    assert view.radiance.mean() == pytest.approx(expected.mean(), rel=1e-3)
    np.testing.assert_array_equal(view.groups["Lamp1"], view.radiance)
    assert not view.groups["Sun"].any()
    red, green, blue = view.radiance.mean(axis=(0, 1))
    assert red > green > blue
    assert np.isfinite(develop(pair, view, view, pair.settings).exposure_s)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "more"), [("POINT", {}), ("SPOT", {"cone_deg": 60.0, "blend": 0.5}), ("AREA", {})])
def test_light_falls_with_the_square_of_the_distance(tmp_path, kind, more):
    for height in (0.3, 1.0, 20.0):
        light = {"lamps": [make_lamp(kind, height, **more)]}
        pair, _ = render(tmp_path / str(height), PLANE, {"rig": see_from_above(0.4 * height), "light": light})
        view = read(pair)
        expected = 0.8 / math.pi * by_formula(pair, view, 0)
        assert view.radiance.mean() == pytest.approx(expected.mean(), rel=1e-3)


@pytest.mark.long
def test_all_the_light_of_a_narrow_spot_falls_in_its_cone(tmp_path):
    """The integral over the ground in its light, whose area each pixel knows, is the power."""
    light = {"lamps": [make_lamp("SPOT", 2.0, cone_deg=30.0, blend=0.2, efficiency=0.5)]}
    rig = see_from_above(1.6) | {"width_px": 256, "height_px": 192}
    pair, _ = render(tmp_path, PLANE, {"rig": rig, "light": light})
    irradiance = read(pair).radiance.mean(axis=-1) * math.pi / 0.8
    area_m2 = (2.0 / pair.camera.focal_px) ** 2
    lamp = pair.settings.light.lamps[0]
    assert irradiance.sum() * area_m2 == pytest.approx(pair_power_w(lamp, pair.settings.light), rel=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("law", ["HAPKE", "SNOW"])
def test_laws_follow_each_lamp_and_the_sun(tmp_path, law):
    lamps = [
        make_lamp("POINT", 1.5, x_m=0.4, y_m=3.0),
        {"kind": "POINT", "place": "CAMERA", "x_m": -0.2, "y_m": 0.0, "z_m": 0.1, "size_m": 1e-3},
    ]
    pair, _ = picture(
        tmp_path,
        {"surface": {"model": law}, "hapke": {"backend": "NODES"}},
        {"light": {"sun_elevation_deg": 30.0, "lamps": lamps}, "rig": {"width_px": 32, "height_px": 24}},
    )
    view = read(pair)
    np.testing.assert_allclose(sum(view.groups.values()), view.radiance, rtol=1e-5, atol=1e-9)
    assert all(view.groups[group].max() > 0 for group in ("Sun", "Lamp1", "Lamp2"))
    if law != "HAPKE":
        return
    law_of = partial(bidirectional_reflectance, parameters=hapke_from_settings(pair.settings.hapke))
    up, eye = np.array([0.0, 0.0, 1.0]), rays(pair)
    pose = np.array(pair.data["poses_rectified_to_world"]["left"])
    along = -eye / (-eye @ pose[:3, 2])[..., None]
    points = pose[:3, 3] + along * view.depth[..., None]
    for k in range(2):
        way = np.array(pair.data["light"]["lamps"][k]["position_m"]) - points
        toward = way / np.linalg.norm(way, axis=-1, keepdims=True)
        irradiance = by_formula(pair, view, k)
        law_per_irradiance = law_of(*angles(up, toward, eye)) / np.maximum(toward[..., 2], 1e-9)
        expected = irradiance * law_per_irradiance
        lit = (view.semantic == TERRAIN) & (expected > 0.02 * np.nanmax(expected))
        found = view.groups[f"Lamp{k + 1}"].mean(axis=-1)
        np.testing.assert_allclose(found[lit], expected[lit], rtol=2e-3)


@pytest.mark.long
def test_groups_of_two_lamps_and_the_sun_are_the_joint_image_and_are_mixed(tmp_path):
    lamps = [make_lamp("POINT", 1.5, y_m=4.0), make_lamp("SPOT", 3.0, y_m=6.0, x_m=1.0)]
    light = {"sun_elevation_deg": 20.0, "lamps": lamps}
    pair, _ = render(tmp_path, {"light": light, "rig": {"width_px": 48, "height_px": 36}})
    view = read(pair)
    np.testing.assert_allclose(sum(view.groups.values()), view.radiance, rtol=1e-4, atol=1e-6)

    def mixed(**scales: object) -> Array:
        settings = complete(pair.settings, {"light": scales})
        return scale_radiance(view, pair, settings)

    on, off = mixed(sun_scale=0.0, lamp_scales="1, 0"), mixed(sun_scale=0.0, lamp_scales="0, 0")
    np.testing.assert_allclose(on - off, view.groups["Lamp1"], atol=1e-4 * view.radiance.max())
    np.testing.assert_allclose(off, 0.0, atol=1e-4 * view.radiance.max())
    bright = complete(pair.settings, {"light": {"sun_scale": 0.0, "lamp_scales": "0.0001, 0"}})
    views = {eye: read_view(pair.image(eye)) for eye in EYES}
    exposures = [develop(pair, views["left"], views["right"], each).exposure_s for each in (pair.settings, bright)]
    assert exposures[1] > exposures[0]
    assert (
        "light of lamps is not baked" in " ".join(pair.data["left_out"]) or pair.settings.quality.indirect == "TRACED"
    )


def test_lamps_stand_where_they_are_stated_and_follow_the_camera():
    lamps = [
        {"kind": "SPOT", "place": "CAMERA", "x_m": 0.3, "y_m": 0.5, "z_m": -0.2, "azimuth_deg": 90.0},
        {"kind": "AREA", "place": "SITE", "x_m": 1.0, "y_m": 2.0, "z_m": 3.0, "azimuth_deg": 90.0},
    ]
    settings = complete({"light": {"lamps": lamps}, "rig": {"heading_deg": 0.0, "pitch_deg": 0.0}})
    built = scenes.build_scene(empty_scene(), settings)
    assert not find_reasons(built, ask_eyes=False)
    built.lamps[1].location.z = -2.0
    (told,) = find_reasons(built, ask_eyes=False)
    assert told.startswith("light.lamps[1] is ")
    built.lamps[1].location.z = 3.0
    camera = built.camera.matrix_world.translation

    def stands(k: int) -> tuple[Array, Array]:
        world = np.array(find_lamp_matrix(built.lamps[k]))
        return world[:3, 3], -world[:3, 2]

    place, ahead = stands(0)
    np.testing.assert_allclose(place - camera, [0.3, 0.5, -0.2], atol=1e-5)
    np.testing.assert_allclose(ahead, [1.0, 0.0, 0.0], atol=1e-6)  # right of north
    place, ahead = stands(1)
    np.testing.assert_allclose(place, [1.0, 2.0, 3.0], atol=1e-6)
    np.testing.assert_allclose(ahead, [1.0, 0.0, 0.0], atol=1e-6)
    turned = complete(
        {"light": {"lamps": [lamps[0] | {"kind": "POINT"}]}, "rig": {"heading_deg": 90.0, "pitch_deg": 0.0}}
    )
    preview.show_settings(built, turned, 65)
    assert not preview.read_notes(built.scene)
    assert [lamp.data.type for lamp in built.lamps] == ["POINT"]
    assert not built.edited_parts("lamp 1")
    np.testing.assert_allclose(stands(0)[0] - built.camera.matrix_world.translation, [0.5, -0.3, -0.2], atol=1e-5)
    assert find_light_factors(turned) == {"Sun": 1.0, "Planet": 1.0, "Lamp1": 1.0}


def write_leaning_lamp(folder: Path) -> Path:
    """An IES file without symmetry, with a coarse table: brightest 30° off, toward its plane of 60°."""
    vertical, horizontal = np.arange(0.0, 91.0, 15.0), np.arange(0.0, 361.0, 30.0)
    lean = np.sin(np.radians(vertical)) * np.cos(np.radians(horizontal - 60.0))[:, None]
    rows = [vertical, horizontal, *(100 * np.cos(np.radians(vertical)) * (1 + 0.8 * lean))]
    body = "\n".join(" ".join(f"{value:.6f}" for value in row) for row in rows)
    (folder / "lamp.ies").write_text(f"TILT=NONE\n1 -1 1 {len(vertical)} {len(horizontal)} 1 2 0 0 0\n1 1 9\n{body}\n")
    return folder / "lamp.ies"


@pytest.mark.long
@pytest.mark.parametrize("place", ["SITE", "CAMERA"])
def test_an_ies_lamp_has_the_intensity_of_its_table_and_its_power(tmp_path, place):
    lamp = make_lamp("IES", 2.0)
    if place == "CAMERA":  # which looks down, so that the lamp shines down
        lamp |= {"place": "CAMERA", "x_m": 0.0, "y_m": 0.0, "z_m": 0.0, "elevation_deg": 0.0}
    file = write_leaning_lamp(tmp_path)
    pair, _ = render(tmp_path, PLANE, {"rig": see_from_above(4.0), "light": {"lamps": [lamp], "ies_file": str(file)}})
    view, camera = read(pair), pair.camera
    stated, pose = pair.data["light"]["lamps"][0], np.array(pair.data["poses_rectified_to_world"]["left"])
    x, y = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    ahead = np.stack([(x - camera.cx_px) / camera.focal_px, (y - camera.cy_px) / camera.focal_px, 0 * x + 1], axis=-1)
    away = pose[:3, 3] + ahead @ pose[:3, :3].T * view.depth[..., None] - np.array(stated["position_m"])
    right, up = (pose[:3, 0], -pose[:3, 1]) if place == "CAMERA" else (np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    own = np.stack([away @ right, away @ up, away @ -np.array(stated["direction_to_world"])], axis=-1)
    distance = np.linalg.norm(away, axis=-1)
    share = read_ies(file).find_share(own)
    expected = 0.8 / math.pi * stated["pair_w"] * share * -away[..., 2] / distance**3
    found = view.radiance.mean(axis=-1)
    assert found.mean() == pytest.approx(expected.mean(), rel=2e-3)
    # The light changes by up to a tenth from pixel to pixel, and 16 samples are spread unevenly over a pixel.
    off = np.abs(found / expected - 1)
    assert np.median(off) < 5e-3
    assert np.quantile(off, 0.99) < 1.5e-2

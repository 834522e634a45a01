"""The view is as bright as the images of the pair, and the user's own exposure and look come back."""

from __future__ import annotations

import json
import math

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.operators import view_exposure
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings import rebuilt_parts
from icymoon.settings.blender import scene_properties
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.pair_views import read_pair_views
from rendering import render

SENSOR = {"shot_noise": False, "read_noise_e": 0.0, "prnu": 0.0, "dsnu_e": 0.0, "black_level": 0.0}


@pytest.fixture
def built(small, tmp_path):
    """A scene that is lit, of a camera almost without noise."""
    scene_properties.write_settings(
        small.icymoon,
        {
            "sensor": SENSOR,
            "dataset": {"folder": str(tmp_path)},
            "quality": {"samples": 16},
            "light": {"sun_elevation_deg": 30.0, "sun_irradiance_wm2": 50.0},
        },
    )
    small.view_settings.view_transform, small.view_settings.exposure = "Filmic", 0.25
    small.view_settings.look = "High Contrast"
    bpy.ops.icymoon.build_scene()
    return small


@pytest.fixture
def pair(built, tmp_path):
    bpy.ops.icymoon.render_pair()
    (folder,) = (tmp_path / "pairs").iterdir()
    return folder


def brightness(scene, folder) -> tuple[float, float]:
    """The mean of a pair's light as the view shows it in ``Raw``, and that of its image; both from 0 to 1."""
    left = read_view(read_pair(folder).image("left"), "left").radiance.mean(axis=2)
    image = (
        read_pair_views(folder, rebuilt_parts.select_response(scene_properties.read_settings(scene.icymoon))).left / 255
    )
    kept = (image > 0.05) & (image < 0.95)
    assert kept.mean() > 0.2
    return float((left * 2.0**scene.view_settings.exposure)[kept].mean()), float(image[kept].mean())


@pytest.mark.heavy
def test_the_view_is_as_bright_as_the_image(built, pair):
    view, image = brightness(built, pair)
    assert 0.5 < view / image < 2.0
    assert view_exposure.describe_exposure(built) in ("estimated", "other")
    view_exposure.expose_as_rendered(built, pair, read_pair_views(pair, {}).exposures_s)
    view, image = brightness(built, pair)
    assert view == pytest.approx(image, rel=0.02)
    built.icymoon.sensor.auto_target = 0.4  # half as bright
    assert brightness(built, pair)[0] == pytest.approx(view / 2, rel=0.03)
    built.icymoon.sensor.auto_exposure = False
    built.icymoon.sensor.exposure_s = 0.7 * read_pair_views(pair, {}).exposures_s[0]
    view, image = brightness(built, pair)
    assert view == pytest.approx(image, rel=0.02)


@pytest.mark.long
@pytest.mark.heavy
@pytest.mark.parametrize("name", ["scenes/europa_chaos", "scenes/europa_sublimation_pits", "gallery/rugged_1_low"])
def test_the_estimate_knows_which_ground_has_faces_that_face_the_sun(tmp_path, name):
    """The view of a chosen scene is within a half of an f-stop of its image before a pair was rendered."""
    pair, _ = render(
        tmp_path,
        load_preset(name),
        {
            "mesh": {"kind": "GRADED"},
            "quality": {"samples": 8, "denoiser": "NONE"},
            "rig": {"width_px": 96, "height_px": 72},
            "dataset": {"folder": str(tmp_path)},
        },
    )
    brightest = np.quantile(read_view(pair.image("left"), "left").radiance.mean(axis=2), 0.99)
    expected = view_exposure.estimate_white(pair.settings) * pair.settings.sensor.auto_target
    assert abs(math.log2(brightest / expected)) < 0.5


def test_an_exposure_of_the_user_stays_and_clear_gives_all_back(built):
    assert built.view_settings.view_transform == view_exposure.TRANSFORM
    first = built.view_settings.exposure
    built.icymoon.sensor.auto_target *= 0.5
    assert built.view_settings.exposure == pytest.approx(first - 1.0, abs=1e-4)
    assert view_exposure.describe_exposure(built) == "estimated"
    built.view_settings.exposure = 1.5
    built.icymoon.sensor.auto_target *= 2.0
    bpy.ops.icymoon.build_scene()
    assert built.view_settings.exposure == 1.5
    assert view_exposure.describe_exposure(built) == "other"
    bpy.ops.icymoon.clear_scene()
    found = built.view_settings
    assert (found.view_transform, found.look, found.exposure) == ("Filmic", "High Contrast", 0.25)


def test_a_transform_that_the_user_has_chosen_since_stays(built):
    built.view_settings.view_transform = "Standard"
    assert view_exposure.describe_exposure(built) == "other"
    bpy.ops.icymoon.clear_scene()
    assert built.view_settings.view_transform == "Standard"


def test_in_the_dark_the_exposure_stays(built):
    before = built.view_settings.exposure
    built.icymoon.light.planet = False
    built.icymoon.light.sun_elevation_deg = -30.0
    view_exposure.expose_view(built, scene_properties.read_settings(built.icymoon))
    assert built.view_settings.exposure == before


@pytest.mark.parametrize("evil", ["x", -1.0, 0.0, float("nan"), float("inf"), [1.0, 2.0]])
def test_any_value_in_a_file_counts_as_none(built, evil):
    collection, before = scenes.find_collection(built), built.view_settings.exposure
    collection[view_exposure.MEASURED] = evil
    view_exposure.expose_view(built, scene_properties.read_settings(built.icymoon))
    assert built.view_settings.exposure == before
    collection[view_exposure.EXPOSED] = evil
    view_exposure.expose_view(built, scene_properties.read_settings(built.icymoon))
    assert built.view_settings.exposure == before


@pytest.fixture
def under_jupiter(built):
    """Planetshine of a few ten-thousandths of the sunlight, as on Europa."""
    built.icymoon.light.planet, built.icymoon.light.planet_elevation_deg = True, 50.0
    bpy.ops.icymoon.build_scene()
    return built


def lamp(scene) -> bpy.types.Object:
    return next(item for item in scenes.find_collection(scene).all_objects if item.get("icymoon") == "planetshine")


def test_planetshine_that_nobody_can_see_is_only_in_renders(under_jupiter):
    """A light more halves the share of the first light paths that reach the Sun."""
    facts = json.loads(next(item["icymoon_sky"] for item in under_jupiter.objects if "icymoon_sky" in item))
    irradiance = facts["planet"]["irradiance_wm2"]
    assert 0 < irradiance < 4e-3 * facts["sun"]["irradiance_wm2"]
    assert lamp(under_jupiter).hide_viewport
    assert not lamp(under_jupiter).hide_render
    assert not scenes.find_built(under_jupiter).edited
    assert view_exposure.is_without_planetshine(under_jupiter)
    # What it adds at most, to ground that faces it, is less than a step of 8 bits.
    assert irradiance / math.pi * 2.0**under_jupiter.view_settings.exposure < 1 / 255


def test_planetshine_that_can_be_seen_is_shown(under_jupiter):
    group = under_jupiter.icymoon
    group.sensor.auto_exposure, group.sensor.exposure_s = False, 10.0
    assert not lamp(under_jupiter).hide_viewport
    group.sensor.auto_exposure = True
    assert lamp(under_jupiter).hide_viewport
    under_jupiter.view_settings.exposure = 8.0  # by the user, who looks into the shadows
    bpy.ops.icymoon.build_scene()
    assert not view_exposure.is_without_planetshine(under_jupiter)


def test_planetshine_is_shown_at_night(under_jupiter):
    under_jupiter.icymoon.light.sun_elevation_deg = -30.0
    bpy.ops.icymoon.build_scene()
    assert not lamp(under_jupiter).hide_viewport

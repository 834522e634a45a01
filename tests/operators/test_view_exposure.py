"""The view is as bright as the images of the pair, and the user's own exposure and look come back."""

from __future__ import annotations

import bpy
import pytest
from icymoon import scene_properties
from icymoon.nodes import scene as scenes
from icymoon.operators import view_exposure
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings import changes
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.pair_views import read_pair_views

SENSOR = {"shot_noise": False, "read_noise_e": 0.0, "prnu": 0.0, "dsnu_e": 0.0, "black_level": 0.0}


@pytest.fixture
def built(small, tmp_path):
    """A scene that is lit, of a camera almost without noise."""
    scene_properties.write_settings(small.icymoon, {
        "sensor": SENSOR, "dataset": {"folder": str(tmp_path)}, "quality": {"samples": 16},
        "light": {"sun_elevation_deg": 30.0, "sun_irradiance_wm2": 50.0}})
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
    image = read_pair_views(folder, changes.response(scene_properties.read_settings(scene.icymoon))).left / 255
    kept = (image > 0.05) & (image < 0.95)
    assert kept.mean() > 0.2
    return float((left * 2.0 ** scene.view_settings.exposure)[kept].mean()), float(image[kept].mean())


@pytest.mark.heavy
def test_the_view_is_as_bright_as_the_image(built, pair):
    view, image = brightness(built, pair)
    assert 0.5 < view / image < 2.0
    assert view_exposure.how_exposed(built) in ("estimated", "other")
    view_exposure.measure(built, pair, read_pair_views(pair, {}).exposures_s)
    view, image = brightness(built, pair)
    assert view == pytest.approx(image, rel=0.02)
    built.icymoon.sensor.auto_target = 0.4  # half as bright
    assert brightness(built, pair)[0] == pytest.approx(view / 2, rel=0.03)
    built.icymoon.sensor.auto_exposure = False
    built.icymoon.sensor.exposure_s = 0.7 * read_pair_views(pair, {}).exposures_s[0]
    view, image = brightness(built, pair)
    assert view == pytest.approx(image, rel=0.02)


def test_an_exposure_of_the_user_stays_and_clear_gives_all_back(built):
    assert built.view_settings.view_transform == view_exposure.TRANSFORM
    first = built.view_settings.exposure
    built.icymoon.sensor.auto_target *= 0.5
    assert built.view_settings.exposure == pytest.approx(first - 1.0, abs=1e-4)
    assert view_exposure.how_exposed(built) == "estimated"
    built.view_settings.exposure = 1.5
    built.icymoon.sensor.auto_target *= 2.0
    bpy.ops.icymoon.build_scene()
    assert built.view_settings.exposure == 1.5
    assert view_exposure.how_exposed(built) == "other"
    bpy.ops.icymoon.clear_scene()
    found = built.view_settings
    assert (found.view_transform, found.look, found.exposure) == ("Filmic", "High Contrast", 0.25)


def test_a_transform_that_the_user_has_chosen_since_stays(built):
    built.view_settings.view_transform = "Standard"
    assert view_exposure.how_exposed(built) == "other"
    bpy.ops.icymoon.clear_scene()
    assert built.view_settings.view_transform == "Standard"


def test_in_the_dark_the_exposure_stays(built):
    before = built.view_settings.exposure
    built.icymoon.light.planet = False
    built.icymoon.light.sun_elevation_deg = -30.0
    view_exposure.expose(built, scene_properties.read_settings(built.icymoon))
    assert built.view_settings.exposure == before


@pytest.mark.parametrize("evil", ["x", -1.0, 0.0, float("nan"), float("inf"), [1.0, 2.0]])
def test_any_value_in_a_file_counts_as_none(built, evil):
    collection, before = scenes.find_collection(built), built.view_settings.exposure
    collection[view_exposure.MEASURED] = evil
    view_exposure.expose(built, scene_properties.read_settings(built.icymoon))
    assert built.view_settings.exposure == before
    collection[view_exposure.EXPOSED] = evil
    view_exposure.expose(built, scene_properties.read_settings(built.icymoon))
    assert built.view_settings.exposure == before

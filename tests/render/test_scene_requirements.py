"""What a scene does not need is not rendered, and the pair says so."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.formats.exr_layout import read_channels
from icymoon.formats.exr_parts import read_pieces
from icymoon.nodes.build_scene import build_scene
from icymoon.nodes.change_scene import adapt_scene, open_empty_scene
from icymoon.nodes.surface.sun_inputs import is_osl
from icymoon.stereo.images.exr import read_truth, read_view
from icymoon.stereo.measure.prepare_pair import prepare_pair
from rendering import complete, empty_scene, render

SNOW = {"surface": {"subsurface_weight": 1.0, "subsurface_radius_m": 4.0e-4, "albedo": 0.8}}


def snow(built):
    """The Principled node of the ground."""
    return next(node for node in built.terrain.data.materials[0].node_tree.nodes if node.label == "Snow")


def test_light_is_followed_under_the_surface_only_where_a_camera_could_tell():
    far, near = complete(SNOW), complete(SNOW, {"rig": {"height_m": 0.02}})
    built = open_empty_scene(far)
    assert snow(built).inputs["Subsurface Weight"].default_value == 0.0
    built, kept = adapt_scene(built, near)
    assert kept
    assert snow(built).inputs["Subsurface Weight"].default_value == 1.0
    always = build_scene(empty_scene(), complete(SNOW, {"quality": {"walk_px": 0.0}}))
    assert snow(always).inputs["Subsurface Weight"].default_value == 1.0


def test_light_under_the_surface_is_followed_as_the_settings_ask():
    near = {"rig": {"height_m": 0.02}}
    built = open_empty_scene(complete(SNOW, near))
    assert snow(built).subsurface_method == "RANDOM_WALK"
    built, kept = adapt_scene(built, complete(SNOW, near, {"surface": {"subsurface_method": "BURLEY"}}))
    assert kept
    assert snow(built).subsurface_method == "BURLEY"


def test_half_floats_are_what_was_rendered_rounded(tmp_path):
    small = {"rig": {"width_px": 32, "height_px": 24}, "quality": {"samples": 1, "files": "FULL"}}
    full, _ = render(tmp_path / "full", small)
    half, _ = render(tmp_path / "half", small, {"quality": {"half_floats": "RADIANCE_NORMALS"}})
    for eye in ("left", "right"):
        a, b = read_view(full.image(eye)), read_view(half.image(eye))
        # Another id is another seed, so the noise of the light differs.
        assert np.array_equal(b.radiance, b.radiance.astype(np.float16))
        assert not np.array_equal(a.radiance, a.radiance.astype(np.float16))
        assert 0 < np.abs(a.normal - b.normal).max() <= 2.0**-12  # half of the distance of numbers from 0.5 to 1
        for name in ("depth", "instance", "semantic", "hidden"):
            assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=name == "depth"), name
    assert half.id != full.id
    assert any("quality.half_floats" in line for line in half.data["left_out"])


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("truth_by", ["RAYS", "CYCLES"])
def test_compact_files_are_the_full_ones_of_the_same_render_with_exact_truth(tmp_path, truth_by):
    scene = {
        "rig": {"width_px": 32, "height_px": 24},
        "quality": {"samples": 1, "truth_by": truth_by},
        "rocks": {"coverage": 0.1},
        "light": {"planet": True, "planet_elevation_deg": 40.0},
    }
    compact, _ = render(tmp_path / "compact", scene)
    full, _ = render(tmp_path / "full", scene, {"quality": {"files": "FULL"}})
    assert compact.id == full.id
    assert "16-bit" in compact.data["channels"]["stored"]
    assert "stored" not in full.data["channels"]
    for eye in ("left", "right"):
        a, b = read_view(full.image(eye)), read_view(compact.image(eye))
        for group in ("Sun", "Planet"):
            np.testing.assert_allclose(b.groups[group], a.groups[group], rtol=2.0**-11, atol=2.0**-25)
        np.testing.assert_allclose(b.radiance, a.radiance, rtol=1.01 * 2.0**-11, atol=2.0**-24)
        assert 0 < np.abs(a.normal - b.normal).max() <= 2.0**-12
        for name in ("depth", "instance", "semantic", "hidden"):
            assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=name == "depth"), name
        # Blender 5 names a part by its pass, earlier ones by its layer.
        stored = " ".join(
            f"{piece.name.split('-')[0]}.{channel}"
            for piece in read_pieces(compact.image(eye).read_bytes())
            for channel in read_channels(piece.value(b"channels"))
        )
        assert "Combined_Sun.R" in stored
        assert "Combined_Planet.R" in stored
        assert "Combined.R" not in stored


def test_a_denoised_image_is_stored_beside_its_lights(tmp_path):
    scene = {
        "rig": {"width_px": 32, "height_px": 24},
        "quality": {"samples": 1, "denoiser": "OIDN"},
        "light": {"planet": True, "planet_elevation_deg": 40.0},
    }
    pair, _ = render(tmp_path, scene)
    view = read_view(pair.image("left"))
    assert np.abs(view.radiance - view.groups["Sun"] - view.groups["Planet"]).max() > 0.01


@pytest.mark.long
@pytest.mark.heavy
def test_without_the_walk_as_much_light_comes_back(tmp_path):
    """A walk of a hundredth of a pixel and none, under a high Sun: the same mean radiance, within what the table of
    base colours is known to (1 %). Under a low one a walk returns up to 3 % more, whatever its length."""
    noon = {"light": {"sun_elevation_deg": 60.0}, "quality": {"samples": 16}}
    means = []
    for name, walk_px in (("without", 0.1), ("with", 0.0)):
        pair, _ = render(tmp_path / name, SNOW, noon, {"quality": {"walk_px": walk_px}})
        means.append(float(np.mean(read_view(pair.image("left")).radiance)))
        assert [("radius of 0.4 mm" in line) for line in pair.data["left_out"]] == [True] * (name == "without")
    assert means[0] == pytest.approx(means[1], rel=0.01)


@pytest.mark.parametrize(
    ("light", "lamp", "said"),
    [
        ({"sun_elevation_deg": 30.0}, True, ""),
        ({"planet_elevation_deg": -40.0}, False, "below the horizon"),
        # A crescent: the Sun stands beside the planet.
        ({"sun_elevation_deg": 26.0, "sun_azimuth_deg": 0.0}, False, "of the Sun's"),
        ({"sun_elevation_deg": 26.0, "sun_azimuth_deg": 0.0, "planet_least": 0.0}, True, ""),
        ({"sun_elevation_deg": -5.0, "sun_azimuth_deg": 180.0}, True, ""),
    ],
)
def test_the_planet_lights_the_ground_only_if_it_can_be_seen(light, lamp, said, tmp_path):
    sky = {"light": {"planet": True, **light}}
    pair, built = render(tmp_path, sky, {"quality": {"samples": 1}})
    assert (built.planetshine is not None) == lamp
    assert said in " ".join(pair.data["left_out"])
    assert bool(pair.data["left_out"]) == bool(said)
    asked, made = (pair.data["terrain"][key] for key in ("asked", "made"))
    assert asked["rms_slope_deg"] == built.settings.terrain.rms_slope_deg
    assert made == built.statistics["made"]


@pytest.mark.long
def test_without_labels_there_is_one_render_and_the_same_depth(tmp_path, monkeypatch):
    from icymoon.render import render_pair

    calls = []
    original = render_pair._run_cycles
    monkeypatch.setattr(render_pair, "_run_cycles", lambda *a: (calls.append(1), original(*a))[1])
    rocks = {"rocks": {"coverage": 0.05}, "quality": {"samples": 8, "truth_by": "CYCLES"}}
    full, _ = render(tmp_path / "full", rocks)
    assert len(calls) == 5  # radiance, truth, and truth at three other places of a pixel, which finds what is hidden
    alone, _ = render(tmp_path / "alone", rocks, {"quality": {"truth": "DEPTH"}})
    assert len(calls) == 6
    render(tmp_path / "rays", rocks, {"quality": {"truth_by": "RAYS"}})
    assert len(calls) == 7  # radiance alone
    assert full.data["id"] != alone.data["id"]
    for eye in ("left", "right"):
        ours, theirs = read_truth(alone.truth(eye), eye), read_truth(full.truth(eye), eye)
        np.testing.assert_array_equal(ours.depth, theirs.depth)
        assert (ours.normal, ours.semantic, ours.instance) == (None, None, None)
    assert theirs.semantic is not None
    assert set(alone.data["channels"]) == {"radiance", "depth", "stored"}
    ready = prepare_pair(alone.folder, {})
    assert np.isfinite(ready.truth).any()


@pytest.mark.long
@pytest.mark.parametrize("law", ["PRINCIPLED", "HAPKE"])
def test_semantic_labels_come_with_the_light_and_are_the_same(tmp_path, monkeypatch, law):
    """Of the first sample, at the pixel's centre, not a mean of samples that see two things."""
    from icymoon.render import render_pair

    scene = {"rocks": {"coverage": 0.1}, "quality": {"samples": 8, "truth_by": "CYCLES"}, "surface": {"model": law}}
    full, _ = render(tmp_path / "full", scene)
    calls = []
    original = render_pair._run_cycles
    monkeypatch.setattr(render_pair, "_run_cycles", lambda *a: (calls.append(1), original(*a))[1])
    alone, _ = render(tmp_path / "alone", scene, {"quality": {"truth": "SEMANTIC"}})
    assert len(calls) == 1
    for eye in ("left", "right"):
        ours, theirs = read_truth(alone.truth(eye), eye), read_truth(full.truth(eye), eye)
        np.testing.assert_array_equal(ours.depth, theirs.depth)
        np.testing.assert_array_equal(ours.semantic, theirs.semantic)
        assert len(np.unique(ours.semantic)) > 1
        assert (ours.normal, ours.instance) == (None, None)
    assert set(alone.data["channels"]) == {"radiance", "depth", "semantic", "stored"}
    assert any("labels of single rocks" in line for line in alone.data["left_out"])
    assert np.isfinite(prepare_pair(alone.folder, {}).truth).any()


def test_blurred_images_without_labels_have_sharp_depth(tmp_path):
    blurred = {"rig": {"focus_distance_m": 1.0}, "quality": {"samples": 4}}
    full, _ = render(tmp_path / "full", blurred)
    alone, _ = render(tmp_path / "alone", blurred, {"quality": {"truth": "DEPTH"}})
    np.testing.assert_array_equal(
        read_truth(alone.truth("left"), "left").depth, read_truth(full.truth("left"), "left").depth
    )


@pytest.mark.parametrize(
    ("model", "needed"), [("PRINCIPLED", False), ("LAMBERT", False), ("LUNAR_LAMBERT", False), ("HAPKE", True)]
)
def test_open_shading_language_is_on_only_for_what_is_made_of_it(model, needed, tmp_path, monkeypatch):
    from icymoon.render import render_pair

    on = []
    original = render_pair._run_cycles
    monkeypatch.setattr(
        render_pair, "_run_cycles", lambda scene, *a: (on.append(scene.cycles.shading_system), original(scene, *a))[1]
    )
    _, built = render(tmp_path, {"surface": {"model": model}, "quality": {"samples": 1, "truth_by": "CYCLES"}})
    assert any(map(is_osl, built.materials)) == needed
    assert on == [needed, False, False, False, False]  # the truth never
    assert bpy.context.scene.cycles.shading_system == needed

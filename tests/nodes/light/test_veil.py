"""The veil against the laws of Beer and Lambert and of single scattering, and what it leaves as it is."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.benchmarks.light import furnace
from icymoon.formats.exr_pixels import decode_parts
from icymoon.nodes.light.veil import add_veil_temporarily
from icymoon.nodes.surface.ice_material import build_material
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.physics.scene_checks import find_reasons_in_settings
from icymoon.physics.scene_requirements import find_left_out, find_why_not_baked
from icymoon.settings.description import defaults, merged
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.topics.light import VeilSettings
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.support.labels import TERRAIN
from mathutils import Vector
from rendering import complete, empty_scene, render

IRRADIANCE, TOP_M = 10.0, 20.0


def veil(**more: float) -> VeilSettings:
    found: VeilSettings = merged(defaults(), {"veil": {"top_m": TOP_M, **more}}).veil
    return found


def ice(albedo: float) -> bpy.types.Material:
    settings = merged(defaults(), {"surface": {"model": "LAMBERT", "albedo": albedo, "grain_amplitude_m": 0.0}})
    return build_material("Test", settings.surface, 1, TERRAIN)


def sunlit(albedo: float, elevation_deg: float) -> bpy.types.Scene:
    """A wide plane of Lambert ice in the light of a Sun in the east."""
    scene = empty_scene()
    scene.render.engine = "CYCLES"
    furnace.plane(scene, "Ground", 0.0, 200.0, ice(albedo))
    lamp = bpy.data.lights.new("Sun", "SUN")
    lamp.energy, lamp.angle = IRRADIANCE, 1e-3
    item = bpy.data.objects.new("Sun", lamp)
    elevation = math.radians(elevation_deg)
    item.rotation_euler = Vector((math.cos(elevation), 0.0, math.sin(elevation))).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(item)
    return scene


def seen(scene: bpy.types.Scene, of: VeilSettings, bounces: int, height_m: float, samples: int = 64) -> Array:
    """Radiance (16, 16) of the ground from straight above, over 0.4 m."""
    cycles, render = scene.cycles, scene.render
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = samples, False, False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.light_sampling_threshold = 0.0
    cycles.max_bounces = cycles.diffuse_bounces = bounces
    render.resolution_x = render.resolution_y = 16
    render.resolution_percentage = 100
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_start = "ORTHO", 0.4, 1e-3
    camera.location = (0.0, 0.0, height_m)
    scene.collection.objects.link(camera)
    scene.camera = camera
    image = render.image_settings
    image.file_format, image.color_depth, scene.view_settings.view_transform = "OPEN_EXR", "32", "Raw"
    with tempfile.TemporaryDirectory() as folder, add_veil_temporarily(scene, of, bounces):
        render.filepath = str(Path(folder) / "seen.exr")
        bpy.ops.render.render(write_still=True)
        channels = dict(item for _, each in decode_parts(Path(render.filepath).read_bytes()) for item in each.items())
    return np.mean([values for name, values in channels.items() if name[-1] in "RGB"], axis=0)


@pytest.mark.heavy
@pytest.mark.parametrize("elevation_deg", [90.0, 30.0])
def test_grains_that_only_absorb_take_what_beer_and_lambert_say(elevation_deg):
    """On the slanted way of the Sun down, and on the way up to the eye."""
    of = veil(optical_depth=0.8, grain_albedo=0.0)
    sine = math.sin(math.radians(elevation_deg))
    expected = IRRADIANCE * sine * 0.5 / math.pi * math.exp(-0.8 / sine) * math.exp(-0.8 * 5.0 / TOP_M)
    # Nothing is sampled but the Sun's disc, whose elevations differ by 1e-3: 3e-4 of the light.
    np.testing.assert_allclose(seen(sunlit(0.5, elevation_deg), of, 4, 5.0), expected, rtol=5e-4)


@pytest.mark.heavy
@pytest.mark.parametrize("asymmetry", [0.0, 0.85, -0.5])
def test_a_thin_veil_before_black_ground_has_the_radiance_of_single_scattering(asymmetry):
    """The integral of E p(angle) over the way, with what grains take before and after, in steps of 5 mm."""
    depth, height, sine = 0.04, 10.0, 0.5
    cosine = -sine  # from the way of the light to the way up
    phase = (1 - asymmetry**2) / (1 + asymmetry**2 - 2 * asymmetry * cosine) ** 1.5 / (4 * math.pi)
    extinction = depth / TOP_M
    z = np.linspace(0.0, height, 2001)
    left = np.exp(-extinction * ((TOP_M - z) / sine + height - z))
    expected = IRRADIANCE * phase * extinction * float((left[1:] + left[:-1]).sum() / 2 * (z[1] - z[0]))
    found = seen(sunlit(0.0, 30.0), veil(optical_depth=depth, asymmetry=asymmetry), 0, height)
    assert found.mean() == pytest.approx(expected, rel=1e-3)  # 16384 paths; along one they differ by 6 %


@pytest.mark.heavy
def test_the_contrast_of_a_lit_white_target_falls_by_the_exponential_of_the_way():
    """Between eyes 1 m and 3 m above the target, whatever light reaches it through the veil."""
    of = veil(optical_depth=4.0)
    scene = sunlit(0.0, 90.0)
    furnace.plane(scene, "Target", 0.001, 0.2, ice(0.8))
    contrast = []
    for height_m in (1.0, 3.0):
        radiance = seen(scene, of, 4, height_m, 512)
        contrast.append(radiance[5:11, 5:11].mean() - np.concatenate([radiance[:2], radiance[-2:]]).mean())
    # Grains scatter some of the target's light into its own image, at most the share of a narrow forward lobe.
    assert contrast[1] / contrast[0] == pytest.approx(math.exp(-4.0 * 2.0 / TOP_M), rel=0.02)


def test_nothing_is_added_without_a_veil_and_nothing_stays_of_one():
    scene = empty_scene()

    def there():
        return len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.materials), len(scene.objects)

    before = there()
    with add_veil_temporarily(scene, veil(), 4):
        assert there() == before
        assert scene.cycles.volume_bounces == empty_volume_bounces(scene)
    with add_veil_temporarily(scene, veil(optical_depth=0.1), 4):
        assert there() == tuple(count + 1 for count in before)
    assert there() == before


def empty_volume_bounces(scene: bpy.types.Scene) -> int:
    return int(scene.cycles.bl_rna.properties["volume_bounces"].default)


FLAT = {
    "terrain": {"rms_slope_deg": 4.0, "size_m": 40.0},
    "rig": {"pitch_deg": 5.0},
    "rocks": {"coverage": 0.1, "smallest_m": 0.3, "largest_m": 0.6},
    "surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0},
    "quality": {"files": "FULL"},
}


@pytest.mark.ci_takes(1)
@pytest.mark.heavy
@pytest.mark.parametrize("truth_by", ["RAYS", "CYCLES"])
def test_the_truth_of_a_pair_is_that_of_the_ground_behind_it(tmp_path, truth_by):
    parts = FLAT, {"quality": {"truth_by": truth_by}}
    clear, _ = render(tmp_path / "clear", *parts)
    veiled, built = render(tmp_path / "veiled", *parts, {"veil": {"optical_depth": 2.0}})
    for eye in ("left", "right"):
        one, other = (read_view(each.image(eye)) for each in (clear, veiled))
        for name in ("depth", "normal", "instance", "semantic", "hidden"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
        sky_px = ~(other.depth < 1e9)
        assert np.median(one.radiance[sky_px]) == 0.0
        assert np.median(other.radiance[sky_px]) > 0.05  # grains are lit before the black sky
    assert any("truth: no veil" in sentence for sentence in veiled.data["left_out"])
    assert not any("Veil" in item.name for item in built.collection.all_objects)


def admitted(*parts) -> Settings:
    return complete({"veil": {"optical_depth": 0.3}}, *parts)


def test_what_cannot_have_a_veil_is_refused_or_said():
    assert not find_reasons_in_settings(admitted())
    for part, name in (
        ({"quality": {"truth": "DEPTH"}}, "quality.truth"),
        ({"surface": {"model": "HAPKE"}}, "hapke.backend"),
    ):
        assert [name in str(each) for each in find_reasons_in_settings(admitted(part))] == [True]
    assert not find_reasons_in_settings(admitted({"surface": {"model": "HAPKE"}, "hapke": {"backend": "NODES"}}))
    lambert = {"surface": {"model": "LAMBERT"}, "quality": {"indirect": "BAKED"}}
    assert "veil.optical_depth" in find_why_not_baked(admitted(lambert))
    said = find_left_out(admitted(lambert), describe_sky(compute_sky(admitted().light)))
    assert any("irradiances are those above the veil" in each for each in said)
    assert any("traced although" in each and "veil.optical_depth" in each for each in said)


@pytest.mark.parametrize(("depth", "bounces", "is_said"), [(4.0, 3, False), (4.001, 3, True), (4.001, 4, False)])
def test_scattering_that_is_not_followed_is_said(depth, bounces, is_said):
    thick = admitted({"veil": {"optical_depth": depth}, "quality": {"diffuse_bounces": bounces}})
    said = find_left_out(thick, describe_sky(compute_sky(thick.light)))
    assert any("more than" in each and "quality.diffuse_bounces" in each for each in said) == is_said


def test_without_a_veil_its_settings_change_no_id():
    assert make_pair_id(complete({"veil": {"optical_depth": 0.0}})) == make_pair_id(complete())
    assert make_pair_id(admitted()) != make_pair_id(complete())

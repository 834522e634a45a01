"""Hapke's law as Cycles renders it, of OSL and of nodes, against the reference in double precision."""

from __future__ import annotations

from functools import partial

import bpy
import numpy as np
import pytest
from hapke_rendering import BARE, FACETS, FLAT, POINT, SMOOTH, angles, expected, long, picture, rays, slow
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.surface import reflectance_laws, sun_inputs
from icymoon.physics.surfaces import photometry, snow
from icymoon.physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
from icymoon.render import cycles_settings
from icymoon.render.pairs.pair_folder import Pair
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.support.blender import compat
from icymoon.support.errors import IcyMoonError
from rendering import complete, empty_scene

BOTH = pytest.mark.parametrize("made_of", ["OSL", "NODES"])


@pytest.fixture(scope="session", autouse=True)
def osl_is_there():
    assert compat.has_osl(), "the bpy wheels have OSL; what is tested here is not there"


def errors(pair: Pair, law=None) -> Array:
    """Relative errors of the left image where there is ground that is lit."""
    image, truth = read_view(pair.image("left")).radiance[..., 0], expected(pair, law)
    assert np.isfinite(image).all()
    assert (image >= 0).all()
    lit = truth > 0
    assert lit.mean() > 0.1
    return np.abs(image[lit] / truth[lit] - 1)


def ball(built: scenes.Built, radius_m: float = 1.0) -> None:
    """Put a sphere of flat facets in the place of the ground, at the height that the camera looks at."""
    mesh = built.terrain.data
    import bmesh

    shape = bmesh.new()
    bmesh.ops.create_uvsphere(shape, u_segments=180, v_segments=90, radius=radius_m)
    shape.to_mesh(mesh)
    shape.free()
    mesh.polygons.foreach_set("use_smooth", np.zeros(len(mesh.polygons), bool))
    forward = -np.array(built.camera.matrix_world.to_3x3().col[2])
    built.terrain.location = np.array(built.camera.matrix_world.translation) + 2.6 * radius_m * forward


@pytest.mark.ci_takes(2)
@BOTH
@pytest.mark.parametrize("theta_bar_deg", [10.0, *slow(0.0, 40.0)])
def test_a_plane_is_as_bright_as_the_reference(tmp_path, made_of, theta_bar_deg):
    pair, _ = picture(tmp_path, {"hapke": {"backend": made_of, "theta_bar_deg": theta_bar_deg}})
    assert np.quantile(errors(pair), 0.999) < SMOOTH


@pytest.mark.ci_takes(2)
@BOTH
@pytest.mark.parametrize(
    "changes",
    [
        {"h_function": "2002", "b": -0.6, "c": -0.9, "filling_factor": 0.4, "b_c0": 0.8, "h_c": 0.02},
        *slow(
            {"h_function": "1993", "w": 0.9995},
            {"h_function": "2002", "w": 1.0, "b": 0.0, "theta_bar_deg": 0.0},
            {"b_c0": 0.8, "h_c": 0.02, "b_s0": 0.0, "theta_bar_deg": 25.0},
            {"w": 0.05, "b": 0.9, "c": 1.0},
        ),
    ],
)
def test_every_part_of_the_law(tmp_path, made_of, changes):
    pair, _ = picture(tmp_path, {"hapke": {"backend": made_of, **changes}})
    assert np.quantile(errors(pair), 0.999) < SMOOTH


@pytest.mark.ci_takes(1)
@BOTH
@pytest.mark.parametrize("azimuth_deg", [120.0, *slow(180.0, 60.0)])
def test_a_sphere_is_as_bright_as_the_reference(tmp_path, made_of, azimuth_deg):
    pair, _ = picture(
        tmp_path,
        {
            "hapke": {"backend": made_of, "theta_bar_deg": 25.0},
            "light": {"sun_azimuth_deg": azimuth_deg, "sun_elevation_deg": 30.0},
        },
        change=ball,
    )
    assert np.quantile(errors(pair), 0.999) < FACETS


@pytest.mark.long
@pytest.mark.parametrize("level", ["ACCURATE", "REFERENCE"])
def test_the_traced_sun_is_the_lamp(tmp_path, level):
    for change in (None, ball):
        pair, built = picture(
            tmp_path,
            {
                "hapke": {"backend": "OSL", "accuracy": level, "theta_bar_deg": 25.0},
                "light": {"sun_azimuth_deg": 150.0},
            },
            change=change,
        )
        assert built.sun.light_linking.receiver_collection is not None
        assert np.quantile(errors(pair), 0.999) < (FACETS if change else SMOOTH)


@pytest.mark.ci_takes(2)
@BOTH
@pytest.mark.parametrize(
    ("azimuth_deg", "theta_bar_deg"),
    [(0.0, 40.0), *(pytest.param(*pair, marks=pytest.mark.slow) for pair in ((0.0, 0.0), (180.0, 25.0), (90.0, 25.0)))],
)
def test_grazing_light_and_sight(tmp_path, made_of, azimuth_deg, theta_bar_deg):
    pair, _ = picture(
        tmp_path,
        {
            "hapke": {"backend": made_of, "theta_bar_deg": theta_bar_deg},
            "light": {"sun_azimuth_deg": azimuth_deg, "sun_elevation_deg": 0.6},
            "rig": {"pitch_deg": 3.0, "focal_length_mm": 600.0, "height_m": 1.0},
        },
    )
    assert errors(pair).max() < 2e-3


def by_distance(pair: Pair) -> list[Array]:
    """Radiance of the left eye's ground, in five parts of as many pixels from near to far."""
    view = read_view(pair.image("left"))
    image, ground = view.radiance[..., 0], ~np.isnan(view.depth)
    return np.array_split(image[ground][np.argsort(view.depth[ground], kind="stable")], 5)


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    "changes",
    [
        {},
        *slow(
            # w is small, since at that level the ground shines by itself: an interreflection even without bounces.
            {"hapke": {"accuracy": "ACCURATE", "w": 0.02}},
            {"surface": {"grain_amplitude_m": 0.01, "grain_size_m": 0.1}},
            {"hapke": {"theta_bar_range_deg": 20.0}, "textures": {"set": "FROST"}},
        ),
    ],
    ids=str,
)
def test_seen_at_a_slant_osl_is_as_bright_as_nodes_near_and_far(tmp_path, monkeypatch, changes):
    """Many shading normals turn away from a low eye that sees their facets: those of 7 % of the farthest fifth here.

    The same rays draw both, so that nothing but single precision and what OSL traces itself tells them apart.
    """
    apply = cycles_settings.apply_quality

    def applied(scene, *given):
        apply(scene, *given)
        scene.cycles.seed = 1

    monkeypatch.setattr(cycles_settings, "apply_quality", applied)
    rolling = {
        "terrain": {"rms_slope_deg": 15.0, "size_m": 100.0, "resolution": 65, "inner_scale_m": 1.0},
        "quality": {"samples": 4},
        "light": {"sun_elevation_deg": 30.0, "sun_azimuth_deg": 180.0},
        "rig": {"height_m": 0.5, "pitch_deg": 0.0},
    }
    osl, nodes = (
        by_distance(
            picture(
                tmp_path / made_of,
                rolling,
                changes,
                {"hapke": {"backend": made_of, **({"accuracy": "FAST"} if made_of == "NODES" else {})}},
            )[0]
        )
        for made_of in ("OSL", "NODES")
    )
    for found, wanted in zip(osl, nodes, strict=True):
        lit = wanted > 1e-3 * wanted.max()
        ratio = found[lit] / wanted[lit]
        assert lit.sum() > 100
        # A hundredth of an interreflection is 1e-4.
        assert found.mean() == pytest.approx(wanted.mean(), rel=1e-3)
        assert np.median(ratio) == pytest.approx(1.0, abs=1e-3)
        assert not np.mean(ratio < 0.8)


@BOTH
def test_the_opposition_surge_to_phase_zero(tmp_path, made_of):
    """The Sun stands behind the camera; the image spans 0.06 degrees, a third of the surge's width."""
    pair, _ = picture(
        tmp_path,
        {
            "hapke": {"backend": made_of, "b_s0": 1.0, "h_s": 0.0016, "b_c0": 0.5, "h_c": 0.001},
            "light": {"sun_azimuth_deg": 180.0, "sun_elevation_deg": 45.0},
            "rig": {"pitch_deg": 45.0, "focal_length_mm": 5000.0, "sensor_width_mm": 5.0},
        },
    )
    # A direction of single precision is 6e-8 off, which is 4e-5 of the narrower surge's width.
    assert errors(pair).max() < 2e-4


@pytest.mark.ci_takes(4)
@BOTH
@pytest.mark.parametrize(
    "changes",
    [
        {"theta_bar_deg": 60.0, "b": 0.99, "c": -1.0, "w": 1.0},
        *long(
            {"w": 0.0},
            {"w": 1.0},
            {"theta_bar_deg": 60.0},
            {"theta_bar_deg": 1e-4},
            {"b": 0.99, "c": -1.0},
            {"b": -0.99, "c": 0.3},
            {"h_s": 1e-8, "b_c0": 1.0, "h_c": 1e-8},
            {"h_s": 10.0, "b_s0": 3.0, "w": 0.7},
            {"filling_factor": 0.75, "w": 0.5},
        ),
    ],
)
@pytest.mark.parametrize("sun", [(0.0, 5.0), (180.0, 45.84), *slow((0.0, 1e-3), (0.0, 90.0))])
def test_no_extreme_leaves_a_bad_pixel(tmp_path, made_of, changes, sun):
    pair, _ = picture(
        tmp_path,
        {
            "hapke": {"backend": made_of, **changes},
            "light": {"sun_azimuth_deg": sun[0], "sun_elevation_deg": sun[1]},
            "rig": {"width_px": 48, "height_px": 36, "pitch_deg": 45.84},
        },
    )
    image, truth = read_view(pair.image("left")).radiance[..., 0], expected(pair)
    assert np.isfinite(image).all()
    assert (image >= 0).all()
    # A surge of 1e-8 is narrower than a single-precision direction; all else holds to 1 % even at a Sun of 0.001
    # degrees, whose cosine has three digits.
    narrow = changes.get("h_s") == 1e-8 and sun == (180.0, 45.84)
    assert np.allclose(image, truth, rtol=1.0 if narrow else 0.01, atol=1e-12)


@BOTH
def test_dirt_drives_w_and_salt_tints(tmp_path, made_of):
    """Negative dirt on slopes darkens level ground by that share; all of the ground is stained."""
    pair, _ = picture(
        tmp_path,
        {
            "surface": {"slope_dirt": -0.5, "salt_share": 1.0, "salt_red": 1.0, "salt_green": 0.7, "salt_blue": 0.4},
            "hapke": {"backend": made_of},
        },
    )
    darker = hapke_from_settings(pair.settings.hapke | {"w": pair.settings.hapke.w * 0.5})
    truth = expected(pair, partial(bidirectional_reflectance, parameters=darker))
    image = read_view(pair.image("left")).radiance
    ground = truth > 0
    for band, factor in enumerate((1.0, 0.7, 0.4)):
        found = np.abs(image[ground][:, band] / (truth[ground] * factor) - 1)
        assert np.quantile(found, 0.99) < SMOOTH  # one in ten thousand places is not stained


def test_the_other_laws(tmp_path):
    for model, share in (("LAMBERT", 0.0), ("LOMMEL_SEELIGER", 1.0), ("LUNAR_LAMBERT", 0.3)):
        pair, _ = picture(tmp_path, {"surface": {"model": model, "albedo": 0.4, "lommel_seeliger_share": 0.3}})
        assert np.quantile(errors(pair, photometry.lunar_lambert(0.4, share)), 0.999) < SMOOTH


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("made_of", ["AUTO", "NODES", "OSL", "OSL ACCURATE"])
@pytest.mark.parametrize("case", [(0.9, 60.0), *slow((0.3, 20.0), (1.0, 4.0))])
def test_the_snow_law(tmp_path, made_of, case):
    albedo, elevation_deg = case
    backend, _, level = made_of.partition(" ")
    pair, built = picture(
        tmp_path,
        {
            "surface": {"model": "SNOW", "albedo": albedo},
            "hapke": {"backend": backend, "accuracy": level or "FAST"},
            "light": {"sun_elevation_deg": elevation_deg},
        },
    )
    assert any(map(sun_inputs.is_osl, built.terrain.data.materials)) == (backend == "OSL")
    assert pair.data["hapke"] is None
    # Exponentials of up to 16 in single precision, where the phase angle is large.
    assert np.quantile(errors(pair, snow.snow_law(albedo)), 0.999) < SMOOTH + 2e-6


@BOTH
def test_a_sun_turned_by_hand_is_followed(tmp_path, made_of):
    def turn(built):
        built.sun.rotation_euler = (0.9, 0.2, 2.0)
        built.sun.data.energy = 10.0

    level = {"accuracy": "ACCURATE"} if made_of == "OSL" else {}
    pair, built = picture(tmp_path, {"hapke": {"backend": made_of, **level}}, change=turn)
    assert pair.data["light"]["sun"]["irradiance_wm2"] == pytest.approx(10.0)
    assert built.edited
    assert np.quantile(errors(pair), 0.999) < SMOOTH


@pytest.mark.ci_takes(1)
@BOTH
def test_rendering_is_no_edit_and_the_pair_says_what_was_used(tmp_path, made_of):
    pair, built = picture(tmp_path, {"hapke": {"backend": made_of}, "rocks": {"coverage": 0.02}})
    assert pair.data["hapke"] == {"made_of": made_of, "accuracy": "FAST", "neighbours_as_here": []}
    assert not pair.data["edited_by_hand"]
    assert not built.edited


def mean_radiance(pair: Pair) -> float:
    view = read_view(pair.image("left"))
    return float(view.radiance[..., 0][~np.isnan(view.depth)].mean())


@pytest.mark.long
def test_the_levels_agree_where_there_is_only_the_sun_and_its_disc(tmp_path):
    """Half shadows of blocks by a disc of 4 degrees, hardly any interreflection: traced or by the lamp, the same."""
    means = []
    for number, accuracy in enumerate(("FAST", "ACCURATE")):
        pair, _ = picture(
            tmp_path / str(number),
            {
                "hapke": {"backend": "OSL", "accuracy": accuracy, "b_s0": 0.0, "w": 0.02, "b": 0.0},
                "light": {"sun_angular_diameter_deg": 4.0},
                "rocks": {"coverage": 0.3},
                "quality": {"samples": 64, "diffuse_bounces": 1},
            },
        )
        means.append(mean_radiance(pair))
    # At w = 0.02 the two differ in interreflection by far less than what is left of the noise, about 0.1 %; that the
    # law bends over the disc is of the order of its radius squared, 0.1 %.
    assert means[1] == pytest.approx(means[0], rel=4e-3)


@pytest.mark.long
def test_the_blur_of_the_surge_is_that_of_the_suns_disc(tmp_path):
    """Fast accuracy has the disc's mean in closed form; accurate takes it by sampling."""
    surge = {"b_s0": 1.0, "h_s": 0.0016, "theta_bar_deg": 0.0, "backend": "OSL"}
    behind = {
        "light": {"sun_azimuth_deg": 180.0, "sun_elevation_deg": 45.0, "sun_angular_diameter_deg": 0.1024},
        "rig": {"pitch_deg": 45.0, "focal_length_mm": 5000.0, "sensor_width_mm": 5.0, "width_px": 24, "height_px": 18},
    }
    point = mean_radiance(picture(tmp_path / "p", behind, {"hapke": surge, "light": POINT})[0])
    fast = mean_radiance(picture(tmp_path / "f", behind, {"hapke": surge})[0])
    exact = mean_radiance(
        picture(tmp_path / "e", behind, {"hapke": surge | {"accuracy": "ACCURATE"}, "quality": {"samples": 256}})[0]
    )
    assert exact < 0.98 * point
    # The closed form is wrong by up to an eighth of what the disc takes away; noise adds a little.
    assert abs(fast - exact) < 0.15 * (point - exact)


def test_what_lights_itself_leaves_the_lamp_to_the_persons_objects(tmp_path):
    def add_plate(built):
        mesh = bpy.data.meshes.new("Plate")
        mesh.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
        material = bpy.data.materials.new("White")
        compat.ensure_nodes(material).nodes.clear()
        tree = material.node_tree
        tree.links.new(
            tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[0]
        )
        tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
        mesh.materials.append(material)
        plate = bpy.data.objects.new("Plate", mesh)
        plate.location.z = 0.5
        built.collection.objects.link(plate)

    pair, _ = picture(tmp_path, {"hapke": {"backend": "OSL", "accuracy": "ACCURATE"}}, change=add_plate)
    view, light = read_view(pair.image("left")), pair.data["light"]["sun"]
    plate = view.instance == 2
    assert plate.mean() > 0.3
    lambert = light["irradiance_wm2"] * light["direction_to_world"][2] * 0.5 / np.pi
    assert view.radiance[..., 0][plate] == pytest.approx(lambert, rel=1e-4)


def test_without_osl_and_on_a_gpu_nodes_are_taken_and_it_is_said(monkeypatch):
    hapke = complete({"hapke": {"accuracy": "REFERENCE"}}).hapke
    assert reflectance_laws.choose_backend(hapke, "CPU") == (True, "REFERENCE", "")
    use_osl, level, message = reflectance_laws.choose_backend(hapke, "GPU")
    assert (use_osl, level) == (False, "FAST")
    assert "CPU" in message
    monkeypatch.setattr(compat, "has_osl", lambda: False)
    settings = complete({"surface": BARE, "hapke": {"accuracy": "REFERENCE"}, "terrain": FLAT})
    built = scenes.build_scene(empty_scene(), settings)
    assert any("without Open Shading Language" in warning for warning in built.warnings)
    assert not any(sun_inputs.is_osl(material) for material in built.materials)
    assert built.extra == scenes.make_build_facts(settings) != ""  # a pair of nodes is another than one of OSL
    for model in ("HAPKE", "SNOW"):
        refused = complete({"surface": {**BARE, "model": model}, "hapke": {"backend": "OSL"}, "terrain": FLAT})
        with pytest.raises(IcyMoonError, match=r"hapke\.backend"):
            scenes.build_scene(empty_scene(), refused)
    # Nobody is told of Hapke's law who does not use it.
    assert not scenes.build_scene(
        empty_scene(), complete({"hapke": {"accuracy": "REFERENCE"}, "terrain": FLAT})
    ).warnings


def test_a_surface_of_osl_is_not_rendered_where_there_is_none(tmp_path, monkeypatch):
    with pytest.raises(IcyMoonError, match="Open Shading Language"):
        picture(
            tmp_path,
            {"hapke": {"backend": "OSL"}},
            change=lambda _: monkeypatch.setattr(compat, "has_osl", lambda: False),
        )


def test_building_again_and_clearing_leave_nothing_behind():
    scene = empty_scene()
    settings = complete(
        {"surface": BARE, "terrain": FLAT, "rocks": {"coverage": 0.02}, "hapke": {"accuracy": "ACCURATE"}}
    )

    def blocks():
        return [len(getattr(bpy.data, kind)) for kind in ("objects", "materials", "collections", "texts")]

    scenes.build_scene(scene, settings)
    after_one = blocks()
    scenes.build_scene(scene, settings)
    assert blocks() == after_one
    assert scene.cycles.shading_system  # or the window would show it black
    scenes.build_scene(scene, complete({"terrain": FLAT}))
    assert not scene.cycles.shading_system
    scenes.clear_scene(scene)
    assert not len(bpy.data.materials)
    assert not len(bpy.data.collections)


def valley(built: scenes.Built) -> None:
    """Flat ground with a wall 3 m north of the camera, which scatter the Sun once but not more often."""
    mesh = built.terrain.data
    material = mesh.materials[0]
    mesh.clear_geometry()
    mesh.from_pydata(
        [(-4, -4, 0), (4, -4, 0), (4, 3, 0), (-4, 3, 0), (4, 3, 4), (-4, 3, 4)], [], [(0, 1, 2, 3), (3, 2, 4, 5)]
    )
    mesh.materials.append(material)
    mesh.polygons.foreach_set("use_smooth", np.zeros(2, bool))
    for k in range(4):
        material.node_tree.nodes["Hapke"].inputs[f"Albedo{k}"].default_value = (0.0, 0.0, 0.0)


def reflected(place: Array, eye: Array, sun: Array, law, often: int, rng: np.random.Generator) -> Array:
    """Radiance (N, often) of the ground of the valley after 1, 2, … interreflections, per irradiance of the Sun.

    One random path from each place, cosine-distributed at each end; ``place`` and ``eye`` are (N, 3).
    """
    up, south = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    found, left = np.zeros((len(place), often)), np.ones(len(place))
    for k in range(often):
        normal, other = (up, south) if k % 2 == 0 else (south, up)
        along, across = np.array([1.0, 0.0, 0.0]), np.cross(normal, [1.0, 0.0, 0.0])
        turn, radius = 2 * np.pi * rng.random(len(place)), np.sqrt(rng.random(len(place)))
        away = (
            (radius * np.cos(turn))[:, None] * along
            + (radius * np.sin(turn))[:, None] * across
            + np.sqrt(1 - radius**2)[:, None] * normal
        )
        # To the wall at y = 3 from the ground, to the ground at z = 0 from the wall.
        towards = -(away @ other)
        distance = (3.0 - place[:, 1] if k % 2 == 0 else place[:, 2]) / np.where(towards > 0, towards, np.nan)
        there = place + distance[:, None] * away
        inside = (
            (towards > 0)
            & (np.abs(there[:, 0]) < 4)
            & ((there[:, 2] > 0) & (there[:, 2] < 4) if k % 2 == 0 else (there[:, 1] > -4) & (there[:, 1] < 3))
        )
        # r holds the cosine of incidence already, so that the cosine of the path's density leaves r pi/cos.
        left = np.where(inside, left * np.pi * law(*angles(normal, away, eye)) / (away @ normal), 0.0)
        place, eye = np.where(inside[:, None], there, place), -away
        found[:, k] = left * law(*angles(other, sun, eye))
    return found


@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_reference_level_has_the_law_at_every_end_of_three_interreflections(tmp_path):
    """Light between a wall and the ground, against paths in double precision."""
    pair, _ = picture(
        tmp_path,
        {
            "hapke": {"backend": "OSL", "accuracy": "REFERENCE", "h_function": "2002"},
            "quality": {"samples": 256},
            "light": {"sun_azimuth_deg": 200.0, "sun_elevation_deg": 30.0},
            "rig": {"width_px": 32, "height_px": 24},
        },
        change=valley,
    )
    view, light = read_view(pair.image("left")), pair.data["light"]["sun"]
    law = partial(bidirectional_reflectance, parameters=hapke_from_settings(pair.settings.hapke))
    pose, sun = np.array(pair.data["poses_camera_to_world"]["left"]), np.array(light["direction_to_world"])
    eye = rays(pair)
    forward = -eye @ pose[:3, 2]
    where = pose[:3, 3] - eye * (view.depth / forward)[..., None]
    # Away from the corner, so that no path is so short that its noise dominates.
    ground = (np.abs(where[..., 2]) < 1e-3) & (where[..., 1] < 2.4)
    assert ground.mean() > 0.5
    paths = 2000
    found = reflected(
        np.repeat(where[ground], paths, axis=0),
        np.repeat(eye[ground], paths, axis=0),
        sun,
        law,
        3,
        np.random.default_rng(1),
    )
    first, second, third = light["irradiance_wm2"] * found.sum(axis=0) / paths
    direct = expected(pair)[ground]
    assert first > 0.03 * direct.sum()
    assert min(second, third) > 0.01 * first
    # Within 1 % in the mean; the noise of 256 samples in 500 pixels is 0.3 %, of the paths here 0.1 %.
    image = view.radiance[..., 0][ground]
    assert (image - direct).sum() == pytest.approx(first + second + third, rel=0.01)

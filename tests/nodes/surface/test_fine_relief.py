"""Fine relief for the camera alone: what is seen is the same, and light by way of other ground nearly so."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from extremes import rays
from icymoon.benchmarks.light.furnace import plane, radiance
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.ground.terrain_mesh import SPACING, mark_relief_as_bump
from icymoon.nodes.surface.ice_material import build_material
from icymoon.nodes.surface.patches_and_grain import add_grain, add_grain_by_fineness, measure_limited_patches
from icymoon.nodes.tree.builder import Tree, list_non_socket_values
from icymoon.physics.mesh.finer_in_view import resolved_share
from icymoon.render import cycles_settings
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings.description import merged
from icymoon.stereo.images.exr import read_truth, read_view
from icymoon.support.blender import compat
from icymoon.support.labels import NORMAL_AOV, TERRAIN, TRUTH
from rendering import complete, empty_scene, png, render

ALL, CAMERA = ({"quality": {"fine_relief": choice}} for choice in ("ALL", "CAMERA"))
#: Bumps on bright ground that lights itself, under a low Sun.
BUMPY = {
    "terrain": {"rms_slope_deg": 20.0},
    "light": {"sun_elevation_deg": 20.0},
    "surface": {"albedo": 0.9, "grain_size_m": 0.1, "grain_amplitude_m": 0.004, "subsurface_weight": 0.0},
}
LAWS = [{"model": "LAMBERT"}, {"model": "PRINCIPLED"}]


@pytest.fixture
def one_seed(monkeypatch):
    """Light paths are drawn alike, whatever the description."""
    apply = cycles_settings.apply_quality

    def applied(scene, *given):
        apply(scene, *given)
        scene.cycles.seed = 1

    monkeypatch.setattr(cycles_settings, "apply_quality", applied)


def tree_of(*changes):
    """What the ground's material is made of, node by node, and its links."""
    empty_scene()
    settings = complete(*changes)
    tree = build_material("Test", settings.surface, 1, TERRAIN, None, settings).node_tree
    return (
        [
            (node.bl_idname, node.name, list_non_socket_values(node), [_value(s) for s in node.inputs])
            for node in tree.nodes
        ],
        [(k.from_node.name, k.from_socket.identifier, k.to_node.name, k.to_socket.identifier) for k in tree.links],
    )


def _value(socket):
    value = getattr(socket, "default_value", None)
    return value if value is None or isinstance(value, (int, float, str)) else tuple(value)


def bounced(folder, *changes):
    """Radiance of the left eye."""
    return read_view(render(folder, *changes)[0].image("left")).radiance.astype(np.float64)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law["model"])
def test_direct_light_is_the_same_to_rounding(law, tmp_path, one_seed):
    """Without bounces, of gloss neither, the camera's is the only light."""
    scene = (
        BUMPY,
        {"surface": law | {"specular": 0.0, "grain_amplitude_m": 0.02}},
        {"quality": {"diffuse_bounces": 0, "samples": 4}},
    )
    pairs = [render(tmp_path / name, *scene, choice)[0] for name, choice in (("all", ALL), ("camera", CAMERA))]
    found = [read_view(pair.image("left")).radiance for pair in pairs]
    truth = [read_truth(pair.truth("left"), "left") for pair in pairs]
    assert found[0].max() > 0
    np.testing.assert_allclose(found[1], found[0], rtol=2e-3)  # half floats are 1e-3 apart
    for kind in ("depth", "normal", "semantic"):
        np.testing.assert_array_equal(getattr(truth[1], kind), getattr(truth[0], kind))
    assert [any("fine_relief" in line for line in pair.data["left_out"]) for pair in pairs] == [False, True]


@pytest.mark.heavy
@pytest.mark.parametrize("law", [pytest.param(LAWS[0], marks=pytest.mark.long), LAWS[1]], ids=lambda law: law["model"])
def test_with_bounces_the_mean_is_the_same(law, tmp_path, one_seed):
    """Bumps turn what ground reflects and take little of it: of steepness 0.04 0.02 % (``principled.json``),
    under a low Sun a few times that, of what other ground sends, which is a tenth of the light. The rest is noise:
    light paths that part at the first bounce, of 64 samples of 7000 pixels."""
    scene = (BUMPY, {"surface": law}, {"quality": {"samples": 64}})
    every, alone = (bounced(tmp_path / name, *scene, choice) for name, choice in (("all", ALL), ("camera", CAMERA)))
    assert not np.array_equal(every, alone)
    assert alone.mean() == pytest.approx(every.mean(), rel=2e-3)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law["model"])
def test_of_the_ground_s_nodes_only_the_closure_is_there_twice(law):
    patchy = {"surface": {**BUMPY["surface"], **law, "albedo_variation": 0.3, "salt_share": 0.2}}
    every, alone = (tree_of(patchy, choice)[0] for choice in (ALL, CAMERA))
    added = sorted(node[1] for node in alone if node[1] not in {n[1] for n in every})
    assert added == sorted(
        {
            "LAMBERT": ["Smooth Lambert", "Light Path", "Seen or Not"],
            "PRINCIPLED": ["Smooth Snow", "Base of Smooth Snow", "Light Path", "Seen or Not"],
        }[law["model"]]
    )


@pytest.mark.parametrize(
    "surface",
    [
        {"model": "LAMBERT", "grain_amplitude_m": 0.0},
        {"model": "PRINCIPLED", "grain_amplitude_m": 0.0},
        {"model": "LAMBERT", "relief": "DISPLACEMENT"},
        {"model": "PRINCIPLED", "subsurface_weight": 1.0},
        {"model": "LUNAR_LAMBERT"},
        {"model": "HAPKE"},
    ],
    ids=str,
)
def test_what_has_no_shaded_relief_or_another_law_is_left_as_it_is(surface):
    described = {"surface": surface, "hapke": {"backend": "NODES"}}
    assert tree_of(described, CAMERA) == tree_of(described, ALL)


def test_a_normal_image_is_relief(tmp_path, one_seed):
    """A leaning normal is seen as it is, whatever light by way of other ground meets."""
    leaning = np.array([0.4, 0.0, 1.0]) / np.hypot(0.4, 1.0)
    path = png(tmp_path / "n.png", np.broadcast_to((leaning + 1) / 2, (8, 8, 3)))
    scene = (
        {"textures": {"set": "OWN", "normal_file": str(path)}, "surface": {"grain_amplitude_m": 0.0}},
        {"surface": {"model": "LAMBERT"}, "quality": {"diffuse_bounces": 0, "samples": 4}},
    )
    every, alone = (bounced(tmp_path / name, *scene, choice) for name, choice in (("all", ALL), ("camera", CAMERA)))
    plain = bounced(tmp_path / "plain", *scene[1:], {"surface": {"grain_amplitude_m": 0.0}})
    np.testing.assert_allclose(alone, every, rtol=2e-3)
    assert abs(plain.mean() / every.mean() - 1) > 0.02


def height_of_grain(seed, node, view_m, **surface):
    """Heights over the amplitude, with 0.1 m for a wavelength, on 256 x 256 points; ``node`` gives them."""
    empty_scene()
    settings = complete().surface | {"grain_size_m": 0.1, "grain_amplitude_m": 1.0, "relief": "DISPLACEMENT", **surface}
    material = build_material("Height", settings, seed, TERRAIN)
    tree = Tree(material.node_tree, keep=True)
    shifted = tree.math("ADD", "Height over -9", tree.tree.nodes[node].outputs[0], 9.0)
    shown = tree.node("ShaderNodeEmission", "Shown", {"Color": shifted, "Strength": 1.0}, if_present={"Weight": 0.0})
    output = tree.tree.nodes["Surface"]
    tree.tree.links.new(shown.outputs[0], output.inputs["Surface"])
    tree.tree.links.remove(output.inputs["Displacement"].links[0])
    bpy.context.scene.render.engine, bpy.context.scene.cycles.samples = "CYCLES", 1
    plane(bpy.context.scene, "Ground", 0.0, 4.0 * view_m, material)
    return radiance(bpy.context.scene, 0.0, view_m, 256)[..., 0] - 9.0


def test_patchy_grain_has_smooth_places_beside_rough_ones_at_the_same_height():
    """On 240 x 240 wavelengths are about 225 of the longest patches, whose squared factor has a deviation of
    sqrt(exp(4 * 0.4²) - 1) = 0.95, so the RMS height is within 0.95 / 2 / 15 = 3 % by chance; four of these, and 5 %
    for the noise that is not quite Gaussian."""
    even, patchy = (
        height_of_grain(1, node, 24.0, grain_patchiness=share)
        for node, share in (("Grain Height", 0.0), ("Multiply.001", 0.4))
    )

    def of_squares(field):
        """RMS heights of squares of 7.5 wavelengths."""
        return np.sqrt(np.square(field.reshape(32, 8, 32, 8)).mean(axis=(1, 3)))

    assert patchy.std() == pytest.approx(even.std(), rel=0.17)
    spread, before = (np.log(of_squares(field)).std() for field in (patchy, even))
    assert before < 0.2
    assert 0.25 < spread < 0.45  # patches narrower than a square even out


@pytest.mark.parametrize("limit", [0.5, 2.0, 6.0])
@pytest.mark.parametrize("patchiness", [0.3, 0.7, 1.0])
def test_mean_square_of_limited_patches_is_the_integral_over_a_clipped_gaussian(patchiness, limit):
    """The sum over a fine grid of deviations. A limit of 6 is as good as none: exp(2 s²)."""
    g = np.linspace(-9.0, 9.0, 200001)
    density = np.exp(-g * g / 2.0) / np.sqrt(2.0 * np.pi) * (g[1] - g[0])
    expected = np.sum(density * np.exp(2.0 * patchiness * np.clip(g, -limit, limit)))
    found = measure_limited_patches(patchiness, limit)
    assert found == pytest.approx(expected, rel=1e-4)
    if limit == 6.0:
        assert found == pytest.approx(np.exp(2.0 * patchiness**2), rel=2e-3)


def test_limited_patches_have_no_rougher_places_and_the_same_height():
    """The factor is at most exp(s c) over the root of its mean square; without a limit, some of 225 patches are at 2.5
    deviations or more. Tolerances of the height as without a limit."""
    even, free, limited = (
        height_of_grain(1, node, 24.0, grain_patchiness=share, grain_patch_limit=limit)
        for node, share, limit in (("Grain Height", 0.0, 0.0), ("Multiply.001", 0.7, 0.0), ("Multiply.001", 0.7, 1.5))
    )
    assert limited.std() == pytest.approx(even.std(), rel=0.17)
    factor = [np.abs(field / even)[np.abs(even) > 0.02] for field in (free, limited)]
    greatest = np.exp(0.7 * 1.5) / np.sqrt(measure_limited_patches(0.7, 1.5))
    assert factor[1].max() <= greatest * 1.01 < factor[0].max()
    assert factor[1].min() == pytest.approx(greatest * np.exp(-2.0 * 0.7 * 1.5), rel=0.05)


def test_grain_is_of_a_span_and_told_apart_by_the_seed():
    """Heights of 64 x 64 wavelengths: RMS 0.068 within 5 %, as the span of grain is made for, and as much again
    for what so many wavelengths leave to chance. Fields that have nothing to do with each other correlate by
    1/64 or so."""
    fields = [height_of_grain(seed, "Grain Height", 6.4) for seed in (1, 2)]
    for field in fields:
        assert abs(field.mean()) < 0.01
        assert field.std() == pytest.approx(0.068, rel=0.1)
    assert abs(np.corrcoef(fields[0].ravel(), fields[1].ravel())[0, 1]) < 0.06


#: A small camera near rough ice, without rocks.
NEAR_ICE = {
    "rig": {"height_m": 0.2, "width_px": 96, "height_px": 72, "baseline_m": 0.03, "pitch_deg": 60.0},
    "terrain": {"rms_slope_deg": 0.0},
    "mesh": {"kind": "GRADED"},
    "quality": {"samples": 1},
    "surface": {"model": "LAMBERT", "grain_size_m": 0.05, "grain_amplitude_m": 0.02},
}


def shading_angles_deg(pair):
    """Angles between the left eye's shading normals and facets, (n,)."""
    facet = read_truth(pair.truth("left"), "left").normal
    shading = read_truth(pair.truth("left"), "left", without=[f"{TRUTH}.{NORMAL_AOV}"]).normal
    cosine = (facet * shading).sum(-1) / np.linalg.norm(facet, axis=-1) / np.linalg.norm(shading, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine[np.isfinite(cosine)], -1, 1)))


@pytest.fixture(scope="module")
def reliefs(tmp_path_factory):
    """A pair for each kind of fine relief."""
    folder = tmp_path_factory.mktemp("reliefs")
    shaded = {"quality": {"truth_by": "CYCLES"}}  # which has the normals of shading
    return {
        relief: render(folder / relief, NEAR_ICE, shaded, {"surface": {"relief": relief}})[0]
        for relief in ("BUMP", "REAL")
    }


def test_what_the_image_shows_of_real_relief_is_in_the_depth(reliefs):
    painted, real = (np.median(shading_angles_deg(reliefs[relief])) for relief in ("BUMP", "REAL"))
    assert painted > 8.0
    assert real < 2.0


def test_real_relief_is_as_high_in_the_depth_as_it_is_described(reliefs):
    """On level ground: an RMS height of 0.068 of the amplitude. Few waves, and sides that face the camera, fill the
    image, so it is within a fifth."""
    for relief, expected in (("BUMP", 0.0), ("REAL", 0.068 * 0.02)):
        pair = reliefs[relief]
        start, toward = rays(pair, "left")
        depth = read_truth(pair.truth("left"), "left").depth
        height = (start + depth[..., None] * toward)[..., 2]
        assert np.nanstd(height) == pytest.approx(expected, rel=0.2, abs=2e-5)


def test_octaves_by_fineness_add_up_to_grain(tmp_path, one_seed):
    """On a mesh that carries nothing of it, real relief is the same bump. Cycles then makes the normals at vertices
    itself, and not quite as Blender does, which moves the ends of shades by a pixel here and there."""
    coarse = {"mesh": {"kind": "GRID"}, "terrain": {"resolution": 129, "size_m": 8.0}, "quality": {"samples": 4}}
    shown = []
    for relief in ("BUMP", "REAL"):
        empty_scene()
        settings = complete(NEAR_ICE, coarse, {"surface": {"relief": relief}})
        built = scenes.build_scene(bpy.context.scene, settings)
        mark_relief_as_bump(built.terrain.data)
        assert built.terrain.data.materials[0].displacement_method == "BUMP"  # a vertex in 6 cm carries nothing
        ice = build_material("Again", settings.surface, 1, TERRAIN, None, settings, by_fineness=True)
        assert ice.displacement_method == ("DISPLACEMENT" if relief == "REAL" else "BUMP")
        built.terrain.data.materials[0] = ice
        shown.append(radiance_of_left_eye(built, tmp_path / relief))
    lit = shown[0] > 0.0
    assert np.median(np.abs(shown[1][lit] / shown[0][lit] - 1.0)) < 0.02
    assert np.corrcoef(shown[0].ravel(), shown[1].ravel())[0, 1] > 0.97


@pytest.mark.parametrize("spacing_m", [1e6, 0.08, 0.06, 0.03, 0.011, 0.001])
def test_vertices_carry_the_octaves_that_the_law_names(spacing_m):
    """Moved and painted heights add up to the grain of one fractal, and what is moved is as high as the sum of the
    shares of octaves that do not depend on each other. On 64 wavelengths heights are by chance within 5 %."""
    empty_scene()
    surface = complete().surface | {"grain_size_m": 0.1, "grain_amplitude_m": 1.0, "grain_patchiness": 0.0}
    material = bpy.data.materials.new("Parts")
    tree = Tree(compat.ensure_nodes(material))
    where = tree.node("ShaderNodeNewGeometry", "Place").outputs["Position"]
    heights = [
        *add_grain_by_fineness(tree, surface, where, (1.0, 2.0, 3.0)),
        add_grain(tree, where, 0.1, (1.0, 2.0, 3.0)),
    ]
    above = [tree.math("ADD", "Over -9", each, 9.0) for each in heights]
    tree.surface(tree.emission("Shown", tree.combined("All", *above), 1.0))
    bpy.context.scene.render.engine, bpy.context.scene.cycles.samples = "CYCLES", 1
    plane(bpy.context.scene, "Ground", 0.0, 20.0, material)
    mesh = bpy.data.objects["Ground"].data
    mesh.attributes.new(SPACING, "FLOAT", "POINT").data.foreach_set("value", [spacing_m] * len(mesh.vertices))
    moved, painted, whole = (radiance(bpy.context.scene, 0.0, 6.4, 256) - 9.0).reshape(-1, 3).T
    np.testing.assert_allclose(moved + painted, whole, atol=1e-4)
    assert moved.std() / whole.std() == pytest.approx(resolved_share(surface, spacing_m), abs=0.05)


def radiance_of_left_eye(built, folder):
    (pair,) = render_pairs(built, expand_headings(built.settings), folder, 1, 0.0, lambda *a, **k: None)
    return read_view(read_pair(pair).image("left")).radiance.astype(np.float64)


def test_displacement_on_a_coarse_mesh_is_reported():
    empty_scene()
    built = scenes.build_scene(
        bpy.context.scene, complete(NEAR_ICE, {"surface": {"relief": "DISPLACEMENT"}, "mesh": {"kind": "GRID"}})
    )
    assert any("of the height of the fine relief" in warning for warning in built.warnings)


def test_grain_that_changes_asks_for_a_new_mesh_only_if_relief_is_in_it():
    empty_scene()
    settings = complete(NEAR_ICE, {"surface": {"relief": "BUMP"}})
    built = scenes.build_scene(bpy.context.scene, settings)
    preview.show_settings(built, merged(settings, {"surface": {"grain_amplitude_m": 0.01}}), 33)
    assert built.preview == {}
    preview.show_settings(built, merged(settings, {"surface": {"relief": "REAL"}}), 33)
    assert built.preview["surface"]["relief"] == "REAL"
    assert built.settings.surface.relief == "BUMP"
    preview.show_settings(built, settings, 33)
    assert built.preview == {}


@pytest.mark.long
def test_ground_with_sharp_crests_has_no_holes(tmp_path):
    """Cycles moves the vertices of a mesh with sharp edges apart, all over it; one pixel in a hundred was sky."""
    pair, built = render(
        tmp_path,
        {
            "mesh": {"kind": "GRADED", "crests": "CUT"},
            "ridges": {"height_m": 0.3, "width_m": 2.6, "spacing_m": 5.0},
            "surface": {"relief": "REAL", "grain_size_m": 0.1, "grain_amplitude_m": 0.08, "subsurface_weight": 0.0},
            "rig": {"width_px": 192, "height_px": 144, "pitch_deg": 45.0},
            "quality": {"samples": 1},
        },
    )
    mesh = built.terrain.data
    assert SPACING in mesh.attributes
    assert "sharp_edge" not in mesh.attributes
    assert np.isfinite(read_truth(pair.truth("left"), "left").depth).all()

"""A roughness image on Hapke's ice varies θ̄: against the reference in double precision, place by place."""

from __future__ import annotations

from functools import partial

import bpy
import numpy as np
import pytest
from hapke_rendering import BARE, FLAT, SMOOTH, expected, picture, rays
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.surface import reflectance_laws
from icymoon.physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
from icymoon.physics.surfaces.photometry import hemispherical_albedo
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.support.blender import compat
from marks import heavy_but
from obj_files import obj
from rendering import complete, empty_scene, png

WAYS = [("NODES", "FAST"), ("OSL", "FAST"), ("OSL", "ACCURATE"), ("OSL", "REFERENCE")]
EVERY_WAY = pytest.mark.parametrize(("made_of", "accuracy"), heavy_but(WAYS[:2], WAYS))
SIDE_M, CELLS, PIXELS = 60.0, 16, 256


def level_ground(tmp_path):
    """A level square of triangles whose image runs from west to east."""
    axis = np.linspace(-SIDE_M / 2, SIDE_M / 2, CELLS + 1)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    k = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + CELLS + 2], 1), np.stack([k, k + CELLS + 2, k + CELLS + 1], 1)])
    positions = np.stack([x, y, np.zeros_like(x)], axis=1)
    return obj(tmp_path / "ground.obj", positions, faces, positions[faces][..., :2] / SIDE_M + 0.5)


def textured(tmp_path, values, hapke):
    """Settings of that ground under a roughness image of these values from west to east."""
    tmp_path.mkdir(exist_ok=True)
    image = png(tmp_path / "roughness.png", np.repeat(np.broadcast_to(values, (4, PIXELS))[..., None], 3, axis=-1))
    return {
        "hapke": hapke,
        "source": {"kind": "MESH", "file": str(level_ground(tmp_path)), "up_axis": "Z"},
        "textures": {"set": "OWN", "mapping": "UV", "roughness_file": str(image)},
    }


def east_m(pair) -> Array:
    """The x (H, W) of the level ground where the left eye sees it."""
    pose, eye = np.array(pair.data["poses_camera_to_world"]["left"]), rays(pair)
    return pose[0, 3] - eye[..., 0] * read_view(pair.image("left")).depth / (-eye @ pose[:3, 2])


HALVES = np.repeat([0.0, 1.0], PIXELS // 2)


@pytest.mark.ci_takes(2)
@EVERY_WAY
@pytest.mark.parametrize(
    ("theta_bar_deg", "range_deg"),
    [(30.0, 60.0), *(pytest.param(*pair, marks=pytest.mark.slow) for pair in ((12.0, 10.0), (15.0, -20.0)))],
)
def test_each_half_has_its_own_roughness(tmp_path, made_of, accuracy, theta_bar_deg, range_deg):
    """The west is smooth and the east rough, or the other way round; at most 0 and 60 degrees."""
    hapke = {"backend": made_of, "accuracy": accuracy, "theta_bar_deg": theta_bar_deg, "theta_bar_range_deg": range_deg}
    pair, _ = picture(tmp_path, textured(tmp_path, HALVES, hapke))
    east, image = east_m(pair), read_view(pair.image("left")).radiance[..., 0]
    assert np.isfinite(image).all()
    for side, value in ((-1, 0.0), (1, 1.0)):
        there = pair.settings.hapke | {"theta_bar_deg": theta_bar_deg + (value - 0.5) * range_deg}
        truth = expected(pair, partial(bidirectional_reflectance, parameters=hapke_from_settings(there)))
        seen = (truth > 0) & (side * east > SIDE_M / PIXELS)  # beside the step, where texels are blended
        assert seen.mean() > 0.2
        assert np.quantile(np.abs(image[seen] / truth[seen] - 1), 0.999) < SMOOTH


@pytest.mark.long
@EVERY_WAY
def test_an_even_image_is_the_constant(tmp_path, made_of, accuracy):
    hapke = {"backend": made_of, "accuracy": accuracy, "theta_bar_deg": 20.0}
    images = [
        read_view(
            picture(
                tmp_path / str(range_deg),
                textured(tmp_path / str(range_deg), 0.6, hapke | {"theta_bar_range_deg": range_deg}),
            )[0].image("left")
        ).radiance
        for range_deg in (0.0, 30.0)
    ]
    assert np.allclose(images[1], images[0], rtol=SMOOTH)


def nodes_of(changes, textures) -> list[str]:
    built = scenes.build_scene(
        empty_scene(), complete({"terrain": FLAT, "surface": BARE}, {"hapke": changes}, {"textures": textures})
    )
    return sorted(node.label for node in built.terrain.data.materials[0].node_tree.nodes)


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("made_of", ["OSL", "NODES"])
def test_what_is_off_costs_no_node(made_of):
    plain = nodes_of({"backend": made_of}, {"set": "NONE"})
    assert nodes_of({"backend": made_of, "theta_bar_range_deg": 20.0}, {"set": "NONE"}) == plain
    image = nodes_of({"backend": made_of}, {"set": "FROST"})
    assert not any("Roughness" in label or "θ̄" in label for label in image)
    assert "tan θ̄" in nodes_of({"backend": made_of, "theta_bar_range_deg": 20.0}, {"set": "FROST"})


@pytest.mark.long
@pytest.mark.parametrize(
    ("w", "span_deg", "within"),
    [
        (0.964, (0.0, 20.0), 0.006),
        (0.97943, (0.0, 60.0), 0.012),
        (1.0, (0.0, 60.0), 0.012),
        (0.447, (5.0, 25.0), 0.006),
    ],
)
def test_the_albedo_for_the_sky_follows_the_roughness(w, span_deg, within):
    """The polynomial against the integral, at slopes and angles between those that it was fitted to."""
    q = hapke_from_settings(complete({"hapke": {"w": w}}).hapke)
    low, high = np.radians(span_deg)
    coefficients = reflectance_laws._fit_hemispherical_albedo(q, 0.5, (float(low), float(high)))
    mu = np.linspace(0.05, 1.0, 9)
    for share in (0.0, 0.13, 0.5, 0.8, 1.0):
        for grey in (1.0, 0.7):
            gamma = np.sqrt(1 - w * grey)
            at = hapke_from_settings(
                complete(
                    {"hapke": {"w": w * grey, "theta_bar_deg": span_deg[0] + share * (span_deg[1] - span_deg[0])}}
                ).hapke
            )
            truth = hemispherical_albedo(partial(bidirectional_reflectance, parameters=at), np.arccos(mu))
            found = np.einsum(
                "knm,kx,n,m->x",
                coefficients,
                mu ** np.arange(4)[:, None],
                ((1 - gamma) / (1 + gamma)) ** np.arange(3),
                (2 * share - 1) ** np.arange(5),
            )
            assert np.abs(found - truth).max() < within


@pytest.mark.ci_takes(1)
@EVERY_WAY
def test_shaded_ground_has_the_albedo_of_its_roughness(tmp_path, made_of, accuracy):
    """Each half under an evenly glowing dome, the Sun below the horizon, against the integral over the dome."""

    def dome(built):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=10 * SIDE_M)
        around = bpy.context.object
        bpy.context.collection.objects.unlink(around)
        built.collection.objects.link(around)
        material = bpy.data.materials.new("Glow")
        tree = compat.ensure_nodes(material)
        tree.nodes.clear()
        glow, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(glow.outputs[0], output.inputs[0])
        # Met by the rays that the closure sends, which leaves no noise: each finds the same.
        material.cycles.emission_sampling = "NONE"
        around.data.materials.append(material)

    hapke = {"backend": made_of, "accuracy": accuracy, "theta_bar_deg": 20.0, "theta_bar_range_deg": 30.0}
    pair, _ = picture(
        tmp_path,
        textured(tmp_path, HALVES, hapke),
        {
            "light": {"sun_elevation_deg": -20.0},
            "quality": {"samples": 4, "diffuse_bounces": 2},
            "rig": {"width_px": 32, "height_px": 24},
        },
        change=dome,
    )
    east, view, eye = east_m(pair), read_view(pair.image("left")), rays(pair)
    for side, value in ((-1, 0.0), (1, 1.0)):
        there = hapke_from_settings(pair.settings.hapke | {"theta_bar_deg": 20.0 + (value - 0.5) * 30.0})
        seen = (view.instance == 1) & (side * east > 0.7) & (eye[..., 2] > 0.2)
        assert seen.mean() > 0.1
        law = partial(bidirectional_reflectance, parameters=there)
        assert np.abs(view.radiance[..., 0][seen] - hemispherical_albedo(law, np.arccos(eye[seen][:, 2]))).max() < 0.012


@pytest.mark.long
def test_the_pair_says_what_neighbours_are_taken_to_be(tmp_path):
    """Only the reference level has the law at the other end of an interreflection, with what holds at this one."""
    described = textured(tmp_path, HALVES, {"backend": "OSL", "accuracy": "REFERENCE", "theta_bar_range_deg": 20.0})
    dirty = {"surface": {"slope_dirt": 0.5}}
    assert picture(tmp_path / "a", described, dirty)[0].data["hapke"]["neighbours_as_here"] == ["theta_bar_deg", "w"]
    accurate = {"hapke": {"accuracy": "ACCURATE"}}
    assert picture(tmp_path / "b", described, dirty, accurate)[0].data["hapke"]["neighbours_as_here"] == []


def test_a_roughness_range_without_an_image_is_said():
    told = scenes.build_scene(
        empty_scene(), complete({"terrain": FLAT, "surface": BARE, "hapke": {"theta_bar_range_deg": 20.0}})
    ).warnings
    assert any("theta_bar_range_deg" in sentence for sentence in told)
    assert len(bpy.data.images) == 0

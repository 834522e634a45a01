"""Light that is baked to the ground: how much it is, its noise, and one bake for all that share it."""

from __future__ import annotations

import json
import math
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.physics.light.baked_rocks import TERM_COUNT
from icymoon.render import baked_light
from icymoon.render.pairs import baked_file
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from
from icymoon.render.workers.pair_claims import Claims
from icymoon.render.workers.shared_light import SharedLight
from icymoon.stereo.images.exr import read_baked_error, read_view
from icymoon.support.arrays import Array
from icymoon.support.blender import compat
from icymoon.support.labels import BAKED_ATTRIBUTES
from rendering import complete, empty_scene, png

#: Rough Lambert ground, of which much sees other ground, with fine relief that bakes must not see.
ROUGH: dict[str, Any] = {
    "surface": {"model": "LAMBERT", "albedo": 0.8, "grain_size_m": 0.5, "grain_amplitude_m": 0.02},
    "terrain": {"size_m": 20.0, "rms_slope_deg": 30.0, "slope_baseline_m": 1.0},
    "dataset": {"headings": 2},
    "light": {"sun_elevation_deg": 24.0, "sun_irradiance_wm2": 10.0},
    "rig": {"width_px": 64, "height_px": 48},
    "quality": {
        "diffuse_bounces": 3,
        "truth": "DEPTH",
        "threads": 2,
        "indirect": "BAKED",
        "bake_samples": 16,
        "bake_noise": 0.0,
        "direct_samples": 2,
    },
}


def planned(*parts: dict) -> list[PlannedPair]:
    return [PlannedPair(pair.id, pair.settings, 0.0) for pair in expand_headings(complete(ROUGH, *parts))]


def run(dataset: Path, pairs: list[PlannedPair]) -> None:
    with ScenesFromSettings(lambda warning: None) as source:
        render_from(source, pairs, dataset, lambda *a, **k: None)


def light_of(pair: PlannedPair, dataset: Path) -> Array:
    return np.stack([read_view(read_pair(pair.folder(dataset)).image(eye)).radiance for eye in ("left", "right")])


def stated(pair: PlannedPair, dataset: Path) -> dict[str, Any]:
    return dict(json.loads((pair.folder(dataset) / "pair.json").read_text()))


def triangles_of(mesh: bpy.types.Mesh) -> Array:
    mesh.calc_loop_triangles()
    return np.array([each.vertices for each in mesh.loop_triangles])


def within_triangles(values: Array, triangles: Array) -> float:
    """The root mean square of what is linear between vertices, at random points of triangles."""
    weights = np.random.default_rng(1).dirichlet((1.0, 1.0, 1.0), len(triangles))
    return float(np.sqrt(np.mean(np.einsum("nk,nkb->nb", weights, values[triangles]) ** 2)))


def sphere(scene: bpy.types.Scene, albedo: float, radius_m: float) -> bpy.types.Object:
    """A closed sphere that is white inside, with a lamp in the middle."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=5, radius=radius_m)
    made = bpy.context.object
    made.data.flip_normals()
    made.data.shade_smooth()
    material = bpy.data.materials.new("White")
    tree = compat.ensure_nodes(material)
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (albedo, albedo, albedo, 1.0)
    tree.links.new(diffuse.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[0])
    made.data.materials.append(material)
    lamp = bpy.data.lights.new("Lamp", "POINT")
    lamp.energy, lamp.shadow_soft_size = 4.0 * math.pi**2 * radius_m**2, 0.001  # irradiance pi: 1 over pi
    scene.collection.objects.link(bpy.data.objects.new("Lamp", lamp))
    return made


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("bounces", [1, 3])
def test_a_closed_sphere_has_the_light_of_the_integrating_sphere(registered, bounces):
    """Every point sees all of the sphere, so each bounce adds the albedo's next power of the direct light: 0.8, 0.64
    and 0.512. The facets of 10242 corners are flat: within 1 %. The mean of 164,000 paths has no noise beside that."""
    scene = empty_scene()
    made = sphere(scene, 0.8, 2.0)
    found = baked_light.bake_indirect_light(made, scene, complete(ROUGH, {"quality": {"diffuse_bounces": bounces}}))
    wanted = sum(0.8**k for k in range(1, bounces + 1))
    assert found.values.mean() == pytest.approx(wanted, rel=0.01)
    assert found.share == pytest.approx(wanted / (1.0 + wanted), rel=0.01)
    assert not any(each.name.startswith(BAKED_ATTRIBUTES["Sun"]) for each in made.data.attributes)


@pytest.mark.long
def test_noise_falls_with_the_root_of_the_samples_and_is_what_differs_from_many(registered):
    with ScenesFromSettings(lambda warning: None) as source:

        def baked(samples: int):
            settings = planned({"quality": {"bake_samples": samples, "bake_noise": 0.0}})[0]
            built, scene, _ = source.prepare(settings)
            return baked_light.bake_indirect_light(built.terrain, scene, settings.settings), triangles_of(
                built.terrain.data
            )

        (few, triangles), (more, _), (many, _) = (baked(samples) for samples in (8, 32, 512))
    assert (few.samples, more.samples, many.samples) == (8, 32, 512)
    # Sobol's points do a little better than the root of 4; a few bright paths do worse.
    assert few.noise / more.noise == pytest.approx(2.0, rel=0.15)
    off = within_triangles(few.values - many.values, triangles) / many.values.mean()
    assert few.noise == pytest.approx(off, rel=0.15)
    assert few.values.mean() == pytest.approx(many.values.mean(), rel=0.02)


@pytest.mark.long
def test_the_error_of_a_bake_is_as_large_as_the_spread_of_independent_bakes(registered):
    """Eight bakes of one ground with other random numbers. The variance of their mean band, over all vertices, has
    seven degrees of freedom a vertex and the square of the errors eight. Neighbours share texels, so of 4,000 vertices
    about 700 are independent, and bright paths make the spread of a variance about twice that of normal noise: 5 % for
    each, 7 % for the ratio, and three times that is the bound. The error says how large the deviation of the light is
    and not which sign it has: their correlation is within 4 / sqrt(700 * 8) of 0."""
    flat = {"mesh": {"kind": "GRID"}, "terrain": {"resolution": 65}}
    with ScenesFromSettings(lambda warning: None) as source:
        pair = planned(flat)[0]
        built, scene, _ = source.prepare(pair)
        bakes = [
            baked_light.bake_indirect_light(built.terrain, scene, complete(ROUGH, flat, {"dataset": {"seed": seed}}))
            for seed in range(8)
        ]
        again = baked_light.bake_indirect_light(built.terrain, scene, complete(ROUGH, flat, {"dataset": {"seed": 7}}))
    assert np.array_equal(again.values, bakes[7].values)
    assert np.array_equal(again.error, bakes[7].error)
    values = np.array([bake.values.mean(axis=1) for bake in bakes], np.float64)
    errors = np.array([bake.error for bake in bakes], np.float64)
    assert np.mean(errors**2) == pytest.approx(np.mean(values.var(axis=0, ddof=1)), rel=0.2)
    assert abs(np.corrcoef((values - values.mean(axis=0)).ravel(), errors.ravel())[0, 1]) < 4 / math.sqrt(5600)


def error_of(pair: PlannedPair, dataset: Path, eye: str) -> dict[str, Array]:
    return read_baked_error(read_pair(pair.folder(dataset)).image(eye), eye)


@pytest.mark.long
def test_the_pass_of_the_error_is_what_such_light_adds_to_the_image(registered, tmp_path, monkeypatch):
    """An error that is all of the baked light must be what the image has more of than without any."""
    bake = baked_light.bake_indirect_light
    (pair,) = planned({"dataset": {"headings": 1}, "quality": {"files": "FULL"}})
    for name, share in (("with", 1.0), ("without", 0.0)):

        def changed(*of: Any, share: float = share) -> baked_file.BakedLight:
            made = bake(*of)
            return replace(made, values=share * made.values, error=made.values.mean(axis=1))

        monkeypatch.setattr(baked_light, "bake_indirect_light", changed)
        run(tmp_path / name, [pair])
    more = (light_of(pair, tmp_path / "with") - light_of(pair, tmp_path / "without"))[0].mean(axis=-1)
    error = error_of(pair, tmp_path / "with", "left")
    assert error.keys() == {"Sun"}
    assert more.max() > 0
    assert np.allclose(error["Sun"], more, atol=1e-5 * more.max())
    assert error_of(pair, tmp_path / "with", "right") == {}


def test_a_pair_states_the_noise_of_its_image(registered, tmp_path):
    """The root mean square over the left image, which shows ground alone, not over the mesh: neither is far from the
    other."""
    (pair,) = planned({"dataset": {"headings": 1}})
    run(tmp_path, [pair])
    view, error = read_view(read_pair(pair.folder(tmp_path)).image("left")), error_of(pair, tmp_path, "left")["Sun"]
    assert np.isfinite(view.depth).all()
    told = stated(pair, tmp_path)["indirect"]
    of_image = math.sqrt(np.mean(error**2)) / view.radiance.mean()
    assert told["noise_of_image"] == pytest.approx(of_image, rel=2e-3)  # of light in 16 bits
    assert 0.5 < told["noise_of_image"] / told["noise"] < 2


@pytest.mark.long
def test_direct_and_baked_light_are_the_light_that_is_traced(registered, tmp_path):
    """Within 1.5 % of the mean at 24 degrees: 1 % for relief that a bake does not see, and for vertices that are 31 cm
    apart, and noise of 0.5 %."""
    baked = planned({"quality": {"bake_samples": 128, "direct_samples": 64}})
    traced = planned({"quality": {"indirect": "TRACED", "samples": 128}})
    run(tmp_path, baked + traced)
    for one, other in zip(baked, traced, strict=True):
        assert light_of(one, tmp_path).mean() == pytest.approx(light_of(other, tmp_path).mean(), rel=0.015)
        assert 0.02 < stated(one, tmp_path)["indirect"]["share"] <= 1.0


def test_a_resumed_run_and_another_worker_have_the_same_light(registered, tmp_path):
    pairs = planned()
    run(tmp_path / "one", pairs)
    (file,) = (tmp_path / "one" / "light").iterdir()
    stamp, images = file.stat().st_mtime_ns, [light_of(pair, tmp_path / "one") for pair in pairs]
    (pairs[1].folder(tmp_path / "one") / "pair.json").unlink()
    run(tmp_path / "one", pairs)
    assert file.stat().st_mtime_ns == stamp
    run(tmp_path / "two", pairs[1:])  # which bakes by itself
    for dataset in (tmp_path / "one", tmp_path / "two"):
        assert np.array_equal(light_of(pairs[1], dataset), images[1])
        told = stated(pairs[1], dataset)["indirect"]
        assert (told["method"], told["lights"]["Sun"]["file"]) == ("BAKED", f"light/{file.name}")
        assert told["noise"] == pytest.approx(told["lights"]["Sun"]["noise_of_baked"] * told["share"], abs=1e-5)


def test_a_worker_waits_for_the_bake_of_another(registered, tmp_path):
    pair = planned()[0]
    with ScenesFromSettings(lambda warning: None) as source:
        built, scene, _ = source.prepare(pair)
        key = baked_light.make_bake_key(built, pair.settings)
        values = np.full((len(built.terrain.data.vertices), 3), 0.25, np.float32)
        made = baked_file.BakedLight(values, values[:, 0], np.zeros((0, TERM_COUNT, 3), np.float32), 0.1, 0.2, 16, 1)
        theirs, ours = Claims(tmp_path), Claims(tmp_path)
        assert theirs.take(key)

        def finish() -> None:
            time.sleep(1.0)
            theirs.write_light_checksum(key, baked_file.write_baked_light(tmp_path, key, made)[1], 1.0)

        worker = threading.Thread(target=finish)
        worker.start()
        found = baked_light.provide_baked_light(built, scene, pair, SharedLight(tmp_path, ours))
        worker.join()
        theirs.close()
        ours.close()
        assert np.array_equal(found.lights["Sun"].light.values, made.values)
        assert built.extra == ""  # what is baked is no edit


@pytest.mark.long
def test_noise_is_kept_below_the_bound_in_images_of_all_headings(registered, tmp_path):
    """The noise of 16 samples, from which their number follows, is an estimate, and images show part of the ground."""
    bound = 0.015
    pairs = planned(
        {
            "quality": {"bake_samples": 4096, "bake_noise": bound},
            "terrain": {"resolution": 65},
            "dataset": {"headings": 4},
        }
    )
    run(tmp_path, pairs)
    told = [stated(pair, tmp_path)["indirect"] for pair in pairs]
    assert [each["method"] for each in told] == ["BAKED"] * 4
    assert 16 < told[0]["lights"]["Sun"]["samples"] < 4096
    assert bound / 2.5 < max(each["noise"] for each in told) <= bound


@pytest.mark.long
def test_rotated_rigs_share_a_bake_and_other_suns_do_not(registered, tmp_path):
    run(tmp_path, [*planned(), *planned({"light": {"sun_elevation_deg": 30.0}, "dataset": {"headings": 1}})])
    assert len(list((tmp_path / "light").iterdir())) == 2


VIEW: dict[str, Any] = {"quality": {"bake_area": "VIEW"}}


@pytest.mark.long
def test_light_that_is_baked_where_it_is_seen_is_that_of_the_whole_ground(registered, tmp_path):
    """Each direction has a bake of its own, of some of the vertices, with other random numbers: the means of images
    agree within the noise of both."""
    few = {"dataset": {"headings": 2}, "quality": {"bake_samples": 64, "direct_samples": 16}}
    pairs, whole = planned(few, VIEW), planned(few)
    run(tmp_path, pairs + whole)
    files = {stated(pair, tmp_path)["indirect"]["lights"]["Sun"]["file"] for pair in [*pairs, *whole]}
    assert len(files) == 3
    for one, other in zip(pairs, whole, strict=True):
        told, all_of_it = (stated(each, tmp_path)["indirect"] for each in (one, other))
        noise = math.hypot(told["noise"], all_of_it["noise"])
        light = light_of(other, tmp_path).mean()
        assert light_of(one, tmp_path).mean() == pytest.approx(light, rel=noise)
        with (
            np.load(tmp_path / told["lights"]["Sun"]["file"]) as found,
            np.load(tmp_path / all_of_it["lights"]["Sun"]["file"]) as of_all,
        ):
            baked = found["values"].any(axis=1)
            assert 0.02 < baked.mean() < 0.5
            assert found["values"][baked].mean() == pytest.approx(of_all["values"][baked].mean(), rel=0.05)


def test_a_turned_camera_has_the_light_of_where_it_looks(registered, tmp_path):
    """The camera of a scene that is kept is turned only while it renders."""
    pairs = planned(VIEW)
    with ScenesFromSettings(lambda warning: None) as source:
        built, _, _ = source.prepare(pairs[0])
        straight = baked_light.find_visible_facets(built, pairs[0])
        turned = baked_light.find_visible_facets(built, PlannedPair(pairs[1].id, pairs[1].settings, 180.0))
        built, _, _ = source.prepare(pairs[1])
        opposite = baked_light.find_visible_facets(built, pairs[1])
    assert np.array_equal(turned, opposite)
    assert (straight & opposite).mean() < 0.01 < straight.mean()


def test_an_image_that_shows_ground_without_baked_light_is_traced(registered, tmp_path, monkeypatch):
    find = baked_light.find_visible_facets

    def lose(*of: Any) -> Array:
        found = find(*of)
        seen = np.flatnonzero(found)
        found[seen[len(seen) // 2 :]] = False
        return found

    monkeypatch.setattr(baked_light, "find_visible_facets", lose)
    (pair,) = planned(VIEW, {"dataset": {"headings": 1}})
    run(tmp_path, [pair])
    told = stated(pair, tmp_path)["indirect"]
    assert told["method"] == "TRACED"
    assert "quality.bake_area" in told["why"]
    assert (light_of(pair, tmp_path) >= 0).all()


@pytest.mark.long
def test_ground_with_an_image_of_much_contrast_is_not_taken_for_ground_without_baked_light(registered, tmp_path):
    # The mean of three pieces, with their contrast kept, would be below black here and there.
    values = np.where(np.random.default_rng(1).random((32, 32)) < 0.25, 0.05, 1.0)[..., None] * np.ones(3)
    image = png(tmp_path / "q.png", values)
    own = {"set": "OWN", "albedo_file": str(image), "width_m": 1.0, "repeat": "TURNED"}
    settings = complete(ROUGH, {"textures": own, "dataset": {"headings": 1}})
    (pair,) = expand_headings(settings, scenes.make_build_facts(settings))
    run(tmp_path / "set", [pair])
    assert stated(pair, tmp_path / "set")["indirect"]["method"] == "BAKED"


def test_what_cannot_be_baked_is_traced_and_states_why(registered, tmp_path):
    pair = planned({"surface": {"model": "PRINCIPLED"}, "dataset": {"headings": 1}})[0]
    plain = planned({"surface": {"model": "PRINCIPLED"}, "dataset": {"headings": 1}, "quality": {"indirect": "TRACED"}})
    run(tmp_path, [pair, *plain])
    told = stated(pair, tmp_path)
    assert told["indirect"] == {"method": "TRACED", "why": "the ground is not Lambert's (surface.model)"}
    assert any("quality.indirect is BAKED" in sentence for sentence in told["left_out"])
    assert not (tmp_path / "light").exists()
    assert "indirect" not in stated(plain[0], tmp_path)


@pytest.mark.long
def test_an_image_in_which_baked_light_is_too_noisy_is_traced(registered, tmp_path):
    limit = {"quality": {"bake_noise": 1e-4}, "dataset": {"headings": 1}}
    (pair,) = planned(limit)
    run(tmp_path, [pair])
    told = stated(pair, tmp_path)
    assert told["indirect"]["method"] == "TRACED"
    assert "above quality.bake_noise" in told["indirect"]["why"]
    assert any(told["indirect"]["why"] in sentence for sentence in told["left_out"])
    assert told["denoiser"] == pair.settings.quality.denoiser
    assert error_of(pair, tmp_path, "left") == {}
    (traced,) = planned({"quality": {"indirect": "TRACED", "samples": 64}, "dataset": {"headings": 1}})
    run(tmp_path, [traced])
    # Two samples of 64 x 48 pixels: of the mean 1 % is noise.
    assert light_of(pair, tmp_path).mean() == pytest.approx(light_of(traced, tmp_path).mean(), rel=0.03)


#: A full planet on the other side of a low Sun. Its lamp gives a twentieth of the Sun's light, and all of it by night.
PLANET: dict[str, Any] = {
    "light": {
        "planet": True,
        "planet_elevation_deg": 40.0,
        "planet_azimuth_deg": 240.0,
        "planet_angular_diameter_deg": 29.0,
        "planet_albedo": 1.0,
    },
    "dataset": {"headings": 1},
}


def groups_of(pair: PlannedPair, dataset: Path) -> dict[str, float]:
    """The mean radiance by light group, of pixels that show the ground."""
    views = [read_view(read_pair(pair.folder(dataset)).image(eye)) for eye in ("left", "right")]
    return {
        name: float(np.mean([view.groups[name][view.depth < 1e9].mean() for view in views]))
        for name in ("Sun", "Planet")
    }


@pytest.mark.long
def test_light_of_sun_and_planet_is_baked_into_its_own_group(registered, tmp_path):
    """Both within 2 % of the traced mean: 1 % as for the Sun alone, and noise, since the samples of direct light
    are shared by the two lamps."""
    (baked,) = planned(PLANET, {"quality": {"bake_samples": 128, "direct_samples": 128}})
    (traced,) = planned(PLANET, {"quality": {"indirect": "TRACED", "samples": 256}})
    (alone,) = planned({"quality": {"bake_samples": 128}, "dataset": {"headings": 1}})
    run(tmp_path, [baked, traced, alone])
    one, other = groups_of(baked, tmp_path), groups_of(traced, tmp_path)
    for group in ("Sun", "Planet"):
        assert one[group] == pytest.approx(other[group], rel=0.02)
    told = stated(baked, tmp_path)["indirect"]
    assert told["lights"].keys() == {"Sun", "Planet"}
    assert all(0.001 < each["share"] < 1.0 for each in told["lights"].values())
    assert told["share"] == pytest.approx(sum(each["share"] for each in told["lights"].values()), abs=1e-4)
    # The Sun's light on the ground does not depend on the planet, whose own bake left it dark.
    files = [stated(pair, tmp_path)["indirect"]["lights"]["Sun"]["file"] for pair in (baked, alone)]
    assert files[0] != files[1]
    one_file, other_file = (np.load(tmp_path / file)["values"] for file in files)
    assert np.array_equal(one_file, other_file)


@pytest.mark.long
def test_by_night_the_light_of_the_planet_alone_is_baked_whatever_came_before(registered, tmp_path):
    (day,) = planned(PLANET)
    (night,) = planned(PLANET, {"light": {"sun_elevation_deg": -20.0}})
    run(tmp_path / "both", [day, night])
    run(tmp_path / "alone", [night])
    assert stated(night, tmp_path / "both")["indirect"]["lights"].keys() == {"Planet"}
    after, alone = (light_of(night, tmp_path / name) for name in ("both", "alone"))
    assert after.max() > 0
    assert np.array_equal(after, alone)


@pytest.mark.long
def test_a_surface_that_stays_while_the_lander_goes_shows_baked_light(registered, tmp_path):
    (with_lander,) = planned({"lander": {"kind": "PARAMETRIC"}, "dataset": {"headings": 1}})
    (without,) = planned({"dataset": {"headings": 1}})
    run(tmp_path / "both", [with_lander, without])
    run(tmp_path / "alone", [without])
    assert stated(with_lander, tmp_path / "both")["indirect"]["method"] == "TRACED"
    after, alone = (light_of(without, tmp_path / name) for name in ("both", "alone"))
    assert np.array_equal(after, alone)


@pytest.mark.long
def test_light_on_rocks_and_around_them_is_the_light_that_is_traced(registered, tmp_path):
    """The mean over pixels of rocks is within 4 %, since twelve numbers do not hold the light near a rock's foot; that
    of the ground within 2 %. Without light on rocks theirs would be 15 % less."""
    stones = {
        "rocks": {"coverage": 0.15, "smallest_m": 0.3, "largest_m": 0.8},
        "dataset": {"headings": 1},
        "terrain": {"size_m": 8.0, "rms_slope_deg": 8.0, "resolution": 129},
        "surface": {"grain_amplitude_m": 0.0},
        "mesh": {"kind": "GRID"},
    }
    (baked,) = planned(stones, {"quality": {"bake_samples": 64, "direct_samples": 64, "truth": "SEMANTIC"}})
    (traced,) = planned(stones, {"quality": {"indirect": "TRACED", "samples": 128, "truth": "SEMANTIC"}})
    run(tmp_path, [baked, traced])
    for kind, bound in ((1, 0.02), (2, 0.04)):
        means = []
        for pair in (baked, traced):
            views = [read_view(read_pair(pair.folder(tmp_path)).image(eye)) for eye in ("left", "right")]
            means.append(np.mean([view.radiance[view.semantic == kind].mean() for view in views]))
        assert means[0] == pytest.approx(means[1], rel=bound)
    assert stated(baked, tmp_path)["indirect"]["method"] == "BAKED"

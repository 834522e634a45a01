"""The ways to compute a scene: each differs from it in what its group names, and in nothing else."""

import pytest
from icymoon.errors import IcyMoonError
from icymoon.render.cost.estimate import work_of
from icymoon.render.cost.variants import GROUPS, SHAPES, candidates, leaner, reference, variants
from icymoon.settings import description

SCENES = ("enceladus_fresh_snow", "europa_rough_ice", "europa_ridged_plain_hapke")
#: Settings that each group may change.
OWN = {"scene": set(), "samples": {"quality.samples", "quality.denoiser"}, "bounces": {"quality.diffuse_bounces"},
       "threshold": {"quality.samples", "quality.noise_threshold"}, "mesh": {"mesh.error_px"},
       "relief": {"surface.relief"}, "shortcuts": {"quality.fine_relief", "quality.walk_px", "quality.truth"},
       "subsurface": {"surface.subsurface_weight", "surface.model",
                      *(f"hapke.{key}" for key in description.defaults()["hapke"])},
       "hapke": {"surface.model", *(f"hapke.{key}" for key in description.defaults()["hapke"])}}


def scene(name, *overrides):
    return description.merged(description.defaults(), description.load(description.preset_path(name)),
                              *map(description.override, overrides))


def changed(settings, base):
    return {f"{topic}.{key}" for topic, values in settings.items() for key, value in values.items()
            if value != base[topic][key]}


@pytest.mark.parametrize("name", SCENES)
def test_each_changes_what_its_group_names(name):
    base = scene(name)
    for variant in variants(base):
        assert changed(variant.settings, base) <= OWN[variant.group], variant.key


@pytest.mark.parametrize("name", SCENES)
def test_all_are_different_and_valid(name):
    found = variants(scene(name))
    assert len({variant.key for variant in found}) == len(found)
    assert len({(str(variant.settings), variant.group in SHAPES) for variant in found}) == len(found)
    for variant in found:
        description.check(variant.settings, variant.key)  # in range, of the right types


def test_only_what_the_scene_has_is_varied():
    groups = {variant.group for variant in variants(scene("europa_rough_ice", "surface.subsurface_weight=0",
                                                          "surface.grain_amplitude_m=0", "mesh.kind=GRID"))}
    assert groups == {"scene", "samples", "bounces", "threshold", "shortcuts"}
    assert {variant.group for variant in variants(scene("europa_ridged_plain_hapke"))} >= {"hapke", "mesh"}


WALK = ("surface.subsurface_weight=1", "surface.subsurface_radius_m=0.05")


def shortcuts(*overrides):
    return {v.name for v in variants(scene("europa_rough_ice", *overrides), ["shortcuts"]) if v.group == "shortcuts"}


def test_what_may_be_left_out_is_varied_to_what_it_is_not():
    bare = ("surface.subsurface_weight=0",)
    assert shortcuts(*bare) == {"fine relief for the camera alone", "depth alone"}
    assert shortcuts(*bare, "quality.fine_relief=CAMERA", "quality.truth=DEPTH") == {
        "fine relief for all light", "normals and labels"}
    assert shortcuts(*bare, "surface.grain_amplitude_m=0") == {"depth alone"}
    # With a walk all light meets the relief, so that there is none to leave out.
    assert shortcuts(*WALK) == {"no walk under the surface", "depth alone"}
    assert "walk under the surface" in shortcuts(*WALK, "quality.walk_px=90")


@pytest.mark.parametrize("overrides", [(), WALK, ("surface.subsurface_weight=0",)])
def test_a_search_leaves_out_what_costs_something(overrides):
    base = scene("europa_rough_ice", *overrides)
    for name, part in leaner(base).items():
        lean = description.merged(base, part)
        assert work_of(lean).seconds(0.0) < work_of(base).seconds(0.0), name
        assert name not in leaner(lean)


def test_asking_for_what_is_not_there_is_refused():
    with pytest.raises(IcyMoonError, match=r"no group 'light'.*samples"):
        variants(scene("europa_rough_ice"), ["light"])
    with pytest.raises(IcyMoonError, match="nothing to vary in hapke"):
        variants(scene("europa_rough_ice"), ["hapke"])
    for samples in (1, 131074):
        with pytest.raises(IcyMoonError, match="give 2 to 131072"):
            reference(scene("europa_rough_ice"), samples)


@pytest.mark.parametrize("fine", [False, True])
def test_the_reference_is_the_most_accurate_of_all(fine):
    base = scene("europa_ridged_plain_hapke")
    best = reference(base, 4096, fine).settings
    assert best["quality"]["denoiser"] == "NONE"
    assert best["quality"]["noise_threshold"] == 0
    assert best["hapke"]["accuracy"] == "REFERENCE"
    for variant in variants(base):
        if (variant.group in SHAPES) == fine:
            assert best["quality"]["diffuse_bounces"] >= variant.settings["quality"]["diffuse_bounces"]
            assert 2 * best["quality"]["samples"] >= variant.settings["quality"]["samples"]
            assert best["mesh"]["error_px"] <= variant.settings["mesh"]["error_px"] or not fine


def test_hapkes_ice_is_as_bright_as_the_snow_that_it_stands_for():
    base = scene("enceladus_fresh_snow", "surface.albedo=0.8", "light.sun_elevation_deg=30")
    (hapke,) = (v for v in variants(base, ["subsurface"]) if v.name == "Hapke")
    from math import radians

    from icymoon.physics.surfaces.hapke import bidirectional_reflectance, from_settings
    from icymoon.physics.surfaces.photometry import hemispherical_albedo
    parameters = from_settings(hapke.settings["hapke"])
    assert float(hemispherical_albedo(lambda i, e, psi: bidirectional_reflectance(i, e, psi, parameters),
                                      radians(60))) == pytest.approx(0.8, abs=1e-6)


def test_the_search_goes_from_cheap_to_dear():
    ladder = [variant.settings["quality"] for variant in candidates(scene("europa_rough_ice"))]
    for denoiser in ("NONE", "OIDN"):
        own = [step["samples"] for step in ladder if step["denoiser"] == denoiser]
        assert own == sorted(set(own))
        assert own
    costs = [work_of(variant.settings).seconds(0.0) for variant in candidates(scene("europa_rough_ice"))]
    assert costs == sorted(costs)
    assert set(GROUPS) == set(OWN) - {"scene"}

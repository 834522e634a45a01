"""The ways to compute a scene: each differs from it in what its group names, and in nothing else."""

from typing import Any

import pytest
from icymoon.render.cost.estimate import estimate_work
from icymoon.render.cost.quality_variants import (
    GROUPS,
    SHAPES,
    list_candidates,
    list_settings_with_less_light,
    list_variants,
    make_reference,
)
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError

SCENES = ("enceladus_fresh_snow", "europa_rough_ice", "europa_ridged_plain_hapke")
#: Settings that each group may change.
OWN = {
    "scene": set(),
    "samples": {"quality.samples", "quality.denoiser"},
    "bounces": {"quality.diffuse_bounces"},
    "threshold": {"quality.samples", "quality.noise_threshold"},
    "mesh": {"mesh.error_px"},
    "relief": {"surface.relief"},
    "shortcuts": {"quality.fine_relief", "quality.walk_px", "quality.truth"},
    "subsurface": {
        "surface.subsurface_weight",
        "surface.subsurface_method",
        "surface.model",
        *(f"hapke.{key}" for key in description.defaults().hapke),
    },
    "indirect": {"quality.indirect", "quality.bake_samples", "quality.bake_noise", "quality.direct_samples"},
    "glints": {"surface.glint_share"},
    "files": {"quality.files", "quality.half_floats"},
    "hapke": {"surface.model", *(f"hapke.{key}" for key in description.defaults().hapke)},
}


def scene(name: str, *overrides: str) -> Settings:
    return description.merged(
        description.defaults(), preset_files.load_preset(name), *map(description.override, overrides)
    )


def changed(settings, base):
    return {
        f"{topic}.{key}"
        for topic, values in settings.items()
        for key, value in values.items()
        if value != base[topic][key]
    }


@pytest.mark.parametrize("name", SCENES)
def test_each_changes_what_its_group_names(name):
    base = scene(name)
    for variant in list_variants(base):
        assert changed(variant.settings, base) <= OWN[variant.group], variant.key


@pytest.mark.parametrize("name", SCENES)
def test_all_are_different_and_valid(name):
    found = list_variants(scene(name))
    assert len({variant.key for variant in found}) == len(found)
    assert len({(str(variant.settings), variant.group in SHAPES) for variant in found}) == len(found)
    for variant in found:
        description.check(variant.settings, variant.key)  # in range, of the right types


def test_only_what_the_scene_has_is_varied():
    groups = {
        variant.group
        for variant in list_variants(
            scene("europa_rough_ice", "surface.subsurface_weight=0", "surface.grain_amplitude_m=0", "mesh.kind=GRID")
        )
    }
    assert groups == {"scene", "samples", "bounces", "threshold", "shortcuts", "files"}
    assert {variant.group for variant in list_variants(scene("europa_ridged_plain_hapke"))} >= {"hapke", "mesh"}


WALK = ("surface.subsurface_weight=1", "surface.subsurface_radius_m=0.05")


def shortcuts(*overrides):
    return {
        v.name for v in list_variants(scene("europa_rough_ice", *overrides), ["shortcuts"]) if v.group == "shortcuts"
    }


def test_what_may_be_left_out_is_varied_to_what_it_is_not():
    bare = ("surface.subsurface_weight=0",)
    assert shortcuts(*bare) == {"fine relief for camera rays only", "depth only", "depth and semantic labels"}
    assert shortcuts(*bare, "quality.fine_relief=CAMERA", "quality.truth=DEPTH") == {
        "fine relief for all light",
        "normals and labels",
    }
    assert shortcuts(*bare, "surface.grain_amplitude_m=0") == {"depth only", "depth and semantic labels"}
    # With a walk all light meets the relief, so that there is none to leave out.
    assert shortcuts(*WALK) == {"no subsurface scattering", "depth only", "depth and semantic labels"}
    assert "subsurface scattering" in shortcuts(*WALK, "quality.walk_px=90")


@pytest.mark.parametrize("overrides", [(), WALK, ("surface.subsurface_weight=0",)])
def test_a_search_leaves_out_what_costs_something(overrides):
    base = scene("europa_rough_ice", *overrides)
    for name, part in list_settings_with_less_light(base).items():
        lean = description.merged(base, part)
        assert estimate_work(lean).seconds(0.0) < estimate_work(base).seconds(0.0), name
        assert name not in list_settings_with_less_light(lean)


def test_asking_for_what_is_not_there_is_refused():
    with pytest.raises(IcyMoonError, match=r"no group 'light'.*samples"):
        list_variants(scene("europa_rough_ice"), ["light"])
    with pytest.raises(IcyMoonError, match="nothing to vary in hapke"):
        list_variants(scene("europa_rough_ice"), ["hapke"])
    for samples in (1, 131074):
        with pytest.raises(IcyMoonError, match="choose 2 to 131072"):
            make_reference(scene("europa_rough_ice"), samples)


@pytest.mark.parametrize("fine", [False, True])
def test_the_reference_is_the_most_accurate_of_all(fine):
    base = scene("europa_ridged_plain_hapke")
    best = make_reference(base, 4096, fine).settings
    assert best.quality.denoiser == "NONE"
    assert best.quality.noise_threshold == 0
    assert best.hapke.accuracy == "REFERENCE"
    for variant in list_variants(base):
        if (variant.group in SHAPES) == fine:
            assert best.quality.diffuse_bounces >= variant.settings.quality.diffuse_bounces
            assert 2 * best.quality.samples >= variant.settings.quality.samples
            assert best.mesh.error_px <= variant.settings.mesh.error_px or not fine


def test_hapkes_ice_is_as_bright_as_the_snow_that_it_stands_for():
    base = scene("enceladus_fresh_snow", "surface.albedo=0.8", "light.sun_elevation_deg=30")
    (hapke,) = (v for v in list_variants(base, ["subsurface"]) if v.name == "Hapke")
    from math import radians

    from icymoon.physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
    from icymoon.physics.surfaces.photometry import hemispherical_albedo

    parameters = hapke_from_settings(hapke.settings.hapke)
    assert float(
        hemispherical_albedo(lambda i, e, psi: bidirectional_reflectance(i, e, psi, parameters), radians(60))
    ) == pytest.approx(0.8, abs=1e-6)


def test_the_search_goes_from_cheap_to_dear():
    ladder = [variant.settings.quality for variant in list_candidates(scene("europa_rough_ice"))]
    for denoiser in ("NONE", "OIDN"):
        own = [step.samples for step in ladder if step.denoiser == denoiser]
        assert own == sorted(set(own))
        assert own
    costs = [estimate_work(variant.settings).seconds(0.0) for variant in list_candidates(scene("europa_rough_ice"))]
    assert costs == sorted(costs)
    assert set(GROUPS) == set(OWN) - {"scene"}


def of_group(settings, group):
    return {variant.name: variant.settings for variant in list_variants(settings, [group]) if variant.group == group}


def test_the_steps_of_each_group_are_what_their_names_say():
    base = scene("europa_rough_ice", "quality.samples=7", "quality.diffuse_bounces=5", "mesh.error_px=3")
    light = of_group(base, "samples")
    assert set(light) == {
        f"{2**k} sample{'s' * (k > 0)}{text}"
        for text, most in (("", 8), (", denoised", 6), (", denoised by colour", 6))
        for k in range(most + 1)
    }
    for name, settings in light.items():
        assert settings["quality"]["samples"] == int(name.split()[0])
        assert settings["quality"]["denoiser"] == (
            "OIDN_COLOUR" if "colour" in name else "OIDN" if "denoised" in name else "NONE"
        )
    bounces = {name: settings["quality"]["diffuse_bounces"] for name, settings in of_group(base, "bounces").items()}
    assert bounces == {
        "0 bounces": 0,
        "1 bounce": 1,
        "2 bounces": 2,
        "3 bounces": 3,
        "4 bounces": 4,
        "8 bounces": 8,
        "16 bounces": 16,
    }
    thresholds = {name: settings["quality"] for name, settings in of_group(base, "threshold").items()}
    assert {name: each["noise_threshold"] for name, each in thresholds.items()} == {
        f"until {limit:g}": limit for limit in (0.2, 0.1, 0.05, 0.02, 0.01)
    }
    assert {each["samples"] for each in thresholds.values()} == {4 * 7}
    assert {name: settings["mesh"]["error_px"] for name, settings in of_group(base, "mesh").items()} == {
        f"{error:g} px": error for error in (0.5, 1, 2, 4, 8, 16)
    }


def test_groups_are_there_where_the_scene_has_something_of_them():
    grains = ("surface.grain_amplitude_m=0.004",)
    assert set(of_group(scene("europa_rough_ice", *grains), "relief")) == {"painted", "real"}
    with pytest.raises(IcyMoonError, match=r"nothing to vary in relief \(fine relief as bump or as geometry\)"):
        list_variants(scene("europa_rough_ice", "surface.grain_amplitude_m=0"), ["relief"])
    for override in ("mesh.kind=GRID", "source.kind=HEIGHT_MAP"):
        with pytest.raises(IcyMoonError, match="nothing to vary in mesh"):
            list_variants(scene("europa_rough_ice", override), ["mesh"])
    with pytest.raises(IcyMoonError, match="nothing to vary in subsurface"):
        list_variants(scene("europa_rough_ice", "surface.subsurface_weight=0"), ["subsurface"])
    with pytest.raises(IcyMoonError, match="nothing to vary in relief"):
        list_variants(scene("europa_ridged_plain_hapke"), ["relief"])
    law = of_group(scene("europa_ridged_plain_hapke"), "hapke")
    assert set(law) == {
        "accurate",
        "reference",
        "as nodes",
        "smooth",
        "without opposition",
        "Lommel-Seeliger",
        "Lambert",
    }  # it is fast as it is described
    assert law["smooth"]["hapke"]["theta_bar_deg"] == 0.0
    assert law["without opposition"]["hapke"]["b_s0"] == law["without opposition"]["hapke"]["b_c0"] == 0.0


def test_a_reference_is_two_renders_of_half_its_samples():
    base = scene("europa_rough_ice", "mesh.error_px=1", "surface.relief=BUMP", "quality.fine_relief=CAMERA")
    plain, fine = make_reference(base, 200), make_reference(base, 200, fine=True)
    assert (plain.name, fine.name, plain.repeats, fine.repeats) == ("200 samples", "200 samples, fine", 2, 2)
    assert plain.settings.quality.samples == fine.settings.quality.samples == 100
    assert (plain.settings.quality.fine_relief, plain.settings.quality.diffuse_bounces) == ("ALL", 32)
    assert (plain.settings.mesh.error_px, plain.settings.surface.relief) == (1, "BUMP")
    assert (fine.settings.mesh.error_px, fine.settings.surface.relief) == (0.25, "REAL")
    assert make_reference(scene("europa_rough_ice", "mesh.error_px=0.1"), 2, True).settings.mesh.error_px == 0.1
    assert (
        make_reference(scene("europa_rough_ice", "quality.diffuse_bounces=99")).settings.quality
        | {"samples": 512, "diffuse_bounces": 99}
        == make_reference(scene("europa_rough_ice", "quality.diffuse_bounces=99"), 1024).settings.quality
    )
    assert {variant.repeats for variant in list_variants(base, ["bounces"])} == {2}
    for samples in (2, 131072):
        assert make_reference(base, samples).settings.quality.samples == samples // 2
    frozen: Any = plain
    with pytest.raises(AttributeError):
        frozen.repeats = 3


def test_a_walk_is_left_out_up_to_the_longest_that_a_setting_takes():
    found = list_settings_with_less_light(scene("europa_rough_ice", *WALK))
    assert found["no subsurface scattering"] == {"quality": {"walk_px": 100.0}}
    assert "no subsurface scattering" not in list_settings_with_less_light(
        scene("europa_rough_ice", "surface.subsurface_weight=0")
    )
    assert "no subsurface scattering" not in list_settings_with_less_light(
        scene("europa_rough_ice", *WALK[:1], "surface.subsurface_radius_m=9")
    )  # longer than can be left out


def test_a_search_tries_neither_a_denoiser_by_colour_nor_a_threshold():
    found = list_candidates(scene("europa_rough_ice", "quality.noise_threshold=0.1", "quality.denoiser=OIDN_COLOUR"))
    assert {variant.settings.quality.denoiser for variant in found} == {"NONE", "OIDN"}
    assert {variant.settings.quality.noise_threshold for variant in found} == {0.0}
    assert {variant.name for variant in found} == {
        f"{2**k} sample{'s' * (k > 0)}{text}" for text, most in (("", 8), (", denoised", 6)) for k in range(most + 1)
    }
    assert {variant.key for variant in found} == {f"auto: {variant.name}" for variant in found}


def test_snow_without_a_walk_is_isotropic_and_as_bright():
    """The law that stands for it has no lobes, no opposition surge and no roughness; only its albedo is fitted."""
    base = scene("europa_rough_ice", *WALK)
    laws = [v.settings.hapke for v in list_variants(base, ["subsurface"]) if v.settings.surface.model == "HAPKE"]
    assert laws
    for law in laws:
        shape = {key: law[key] for key in ("b", "c", "b_s0", "h_s", "b_c0", "h_c", "theta_bar_deg", "filling_factor")}
        assert set(shape.values()) == {0.0}
        assert 0.0 < law.w < 1.0


def test_a_reference_has_1024_paths_per_pixel_unless_told_otherwise():
    base = scene("europa_rough_ice")
    assert make_reference(base).settings.quality.samples == 1024 // 2, "half of them in each of two renders"
    assert make_reference(base).name == "1024 samples"
    assert make_reference(base, 8).settings.quality.samples == 4


LAMBERT = (
    "surface.model=LAMBERT",
    "rocks.coverage=0",
    "mesh.kind=GRID",
    "light.planet=false",
    "light.stars=false",
    "light.directions_from=ANGLES",
    "terrain.resolution=129",
)


def test_light_is_baked_where_it_can_be_for_one_image_where_it_is_seen():
    able = scene("europa_rough_ice", *LAMBERT)
    baked = {name: each["quality"] for name, each in of_group(able, "indirect").items() if name != "traced"}
    assert {(each.bake_samples, each.direct_samples) for each in baked.values()} == {
        (most, n) for most in (64, 256) for n in (1, 2, 4, 9)
    }
    assert {each.indirect for each in baked.values()} == {"BAKED"}
    with pytest.raises(IcyMoonError, match="nothing to vary in indirect"):
        list_variants(scene("europa_rough_ice"), ["indirect"])
    assert {each.bake_area for each in baked.values()} == {"GROUND"}
    alone = [each.settings.quality for each in list_candidates(able) if each.settings.quality.indirect == "BAKED"]
    assert {each.bake_area for each in alone} == {"VIEW"}
    many = [each.settings.quality for each in list_candidates(able, images=36)]
    assert [each.indirect for each in many].count("BAKED") == len(baked)
    # Shared by 36, a bake and one direct sample cost less than a few traced samples.
    assert "BAKED" in [each.indirect for each in many[:4]]


def test_a_reference_and_its_samples_are_traced_even_if_the_scene_is_baked():
    able = scene("europa_rough_ice", *LAMBERT, "quality.indirect=BAKED")
    assert make_reference(able).settings.quality.indirect == "TRACED"
    for group in ("samples", "bounces", "threshold"):
        assert {each["quality"].indirect for each in of_group(able, group).values()} == {"TRACED"}

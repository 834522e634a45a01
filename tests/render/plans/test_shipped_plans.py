"""The shipped plans: the paper's data set, type by type and factor by factor."""

from __future__ import annotations

import json
import re
from collections import Counter

import pytest
from icymoon.errors import IcyMoonError
from icymoon.render.plans.plan_file import Plan, find_plan, read_plan, read_plan_header
from icymoon.settings.preset_files import plan_names, preset_names
from icymoon.settings.table import TOPICS
from icymoon.settings.toml_text import read_toml
from marks import heavy_but

#: Pairs of each type, and how many values of each factor, as counted in the public configuration (Bhaskara et al.
#: 2024: 3060 of reconstructions and 1960 synthetic pairs).
TYPES = {
    "reconstructions": (3060, {"surface.specular": 3, "surface.transmission": 3, "rig.heading_deg": 4}),
    "textures": (168, {"terrain.rms_slope_deg": 3, "textures.albedo_file": 14, "rig.heading_deg": 4}),
    "landforms": (336, {"terrain.rms_slope_deg": 3, "textures.albedo_file": 14, "light.sun_irradiance_wm2": 2,
                        "rig.heading_deg": 4}),
    "generative": (720, {"surface.albedo_variation": 4, "surface.specular": 3, "surface.albedo": 5,
                         "light.sun_irradiance_wm2": 3, "rig.heading_deg": 4}),
    "terrains": (128, {"textures.albedo_file": 4, "rig.heading_deg": 4}),
    "rocks": (320, {"textures.albedo_file": 4, "rocks.coverage": 2, "rocks.largest_m": 2, "rig.heading_deg": 4}),
    "snow": (288, {"surface.grain_size_m": 3, "surface.grain_amplitude_m": 3, "surface.subsurface_weight": 2,
                   "surface.transmission": 2, "surface.albedo": 2, "rig.heading_deg": 4}),
}


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """Reads a shipped plan as a user does who has the files that it names, by default on one ground of each kind:
    how many grounds there are changes no number of pairs, and each takes time to check."""
    folder = tmp_path_factory.mktemp("files")
    for name in plan_names():
        for file in set(re.findall(r'"([^"/]+\.(?:png|ply))"', find_plan(name).read_text(encoding="utf-8"))):
            (folder / file).write_bytes(file.encode())  # each its own content

    def read(name: str, header: str = "grounds = 1") -> Plan:
        own = folder / "plan.toml"
        own.write_text(f'[plan]\ntitle = "Mine"\nextends = "datasets/{name}"\nfiles = "{folder}"\n{header}\n')
        return read_plan(own)
    return read


def values(pairs, name):
    topic, key = name.split(".")
    return Counter(pair.settings[topic][key] for pair in pairs)


@pytest.mark.parametrize("form", heavy_but([""], ["", "_true_sun"], ["_true_sun"]))
@pytest.mark.parametrize("name", TYPES)
def test_each_type_has_the_papers_factors_and_number_of_pairs(mine, name, form):
    plan = mine(f"guiss_{name}{form}")
    pairs = plan.pairs()
    assert not plan.refused()
    count, factors = TYPES[name]
    assert len(pairs) == len({pair.id for pair in pairs}) == count
    for setting, n in factors.items():
        counts = values(pairs, setting)
        # Terrains may share a slope; every other factor comes as often with each of its values.
        assert len(counts) == n, setting
        assert len(set(counts.values())) == 1, setting
    assert values(pairs, "rig.pitch_deg") == {45.84: count}
    assert values(pairs, "rig.width_px") == {640: count}
    if name in ("reconstructions", "rocks"):
        assert len({(p.settings["light"]["sun_elevation_deg"], p.settings["light"]["sun_azimuth_deg"])
                    for p in pairs}) == 5
    if name == "reconstructions":
        assert len({p.settings["source"]["file"] for p in pairs}) == 7
        assert len({(p.settings["source"]["file"], p.settings["rig"]["x_m"], p.settings["rig"]["y_m"])
                    for p in pairs}) == 17


def test_the_suns_are_the_papers_or_the_true_ones(mine):
    lamps = {name: {(p.settings["light"]["sun_irradiance_wm2"], p.settings["light"]["sun_angular_diameter_deg"],
                     p.settings["light"]["planet"]) for p in mine(name).pairs()}
             for name in ("guiss_textures", "guiss_textures_true_sun", "guiss_landforms", "guiss_landforms_true_sun",
                          "guiss_snow", "guiss_generative_true_sun")}
    degrees = 0.57296  # 0.01 rad
    assert lamps == {
        "guiss_textures": {(4.14, degrees, False)}, "guiss_textures_true_sun": {(14.82, 0.0556, False)},
        "guiss_landforms": {(4.14, degrees, False), (50.26, degrees, False)},
        "guiss_landforms_true_sun": {(14.82, 0.0556, False), (50.26, 0.1024, False)},
        "guiss_snow": {(10.0, degrees, False)},
        "guiss_generative_true_sun": {(e, 0.0556, False) for e in (13.28, 14.82, 16.65)}}


@pytest.mark.parametrize("name", ["guiss_all_true_sun", pytest.param("guiss_all", marks=pytest.mark.long)])
def test_all_types_together_are_the_papers_5020(mine, name):
    assert len(mine(name).pairs()) == 5020 == sum(count for count, _ in TYPES.values())


def grounds_of(pairs):
    """How many scenes of terrain there are on each ground: pairs that differ in more than their heading."""
    scenes = {(pair.settings.dataset.seed, *(json.dumps(values) for topic, values in pair.settings.items()
                                             if topic not in ("rig", "dataset"))) for pair in pairs}
    return Counter((seed, terrain) for seed, _, terrain, *_ in scenes)


@pytest.mark.parametrize("name", heavy_but(["guiss_terrains"], [f"guiss_{name}" for name in TYPES
                                                                if name != "reconstructions"]))
def test_each_scene_of_the_papers_sets_has_its_own_ground(mine, name):
    plan = mine(name, "")
    pairs = plan.pairs()
    assert not plan.refused()
    assert len(pairs) == TYPES[name.removeprefix("guiss_")][0]
    grounds = grounds_of(pairs)
    assert len(grounds) == len(pairs) // 4
    assert set(grounds.values()) == {1}
    assert set(grounds_of(mine(name).pairs()).values()) != {1}


def test_meshes_and_albedos_are_compared_on_one_ground(mine):
    for name in ("guiss_reconstructions", "guiss_albedo"):
        assert values(mine(name, "").pairs(), "dataset.seed").keys() == {1}


def test_the_smoke_test_needs_no_files_and_has_every_type():
    pairs = read_plan(find_plan("guiss_smoke")).pairs()
    assert len(pairs) == 14
    assert not any(value for p in pairs for key, value in p.settings.textures.items() if key.endswith("_file"))
    assert values(pairs, "source.kind") == {"PROCEDURAL": 14}


def test_the_plan_of_albedos_fixes_the_exposure():
    pairs = read_plan(find_plan("guiss_albedo")).pairs()
    assert values(pairs, "surface.albedo") == dict.fromkeys((0.2, 0.4, 0.6, 0.8, 1.0), 4)
    assert values(pairs, "sensor.auto_exposure") == {False: 20}
    assert values(pairs, "sensor.exposure_s") == {0.0007: 20}


def test_a_plan_that_needs_files_says_which_and_what_to_do():
    for name in ("guiss_textures", "guiss_reconstructions"):
        with pytest.raises(IcyMoonError, match=r"guiss_\w+\.toml, line \d+: .*is missing; .*plan\.files"):
            read_plan(find_plan(name)).pairs()


def test_every_number_of_a_plan_has_a_source_and_every_plan_a_title():
    for name in plan_names():
        raw = read_toml(find_plan(name))
        stated = {f"{topic}.{key}" for topic, topics in raw.items() if topic in TOPICS for key in topics}
        assert stated == set(raw.get("sources", ())), name
        assert all(read_plan_header(find_plan(name))), name


def test_plans_are_no_presets():
    assert not set(plan_names()) & set(preset_names())
    assert not [name for name in preset_names() if name.startswith("datasets/")]


def test_an_unknown_plan_names_the_nearest():
    with pytest.raises(IcyMoonError, match="guiss_rocks"):
        find_plan("datasets/guiss_rock")

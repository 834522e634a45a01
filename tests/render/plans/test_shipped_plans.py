"""The shipped plans: the paper's data set, type by type and factor by factor."""

from __future__ import annotations

import json
from collections import Counter

import pytest
from icymoon.paper_stand_ins.shown_items import list_items
from icymoon.render.plans.plan_file import Plan, find_plan, read_plan, read_plan_header
from icymoon.settings.preset_files import plan_names, preset_names
from icymoon.settings.table import TOPICS
from icymoon.settings.toml_text import read_toml
from icymoon.settings.topics.stand_ins import MESHES, TEXTURES
from icymoon.support.errors import IcyMoonError
from marks import heavy_but

#: Pairs of each type, and how many values of each factor, as counted in the public configuration (Bhaskara et al.
#: 2024: 3060 of reconstructions and 1960 synthetic pairs).
TYPES = {
    "reconstructions": (3060, {"surface.specular": 3, "surface.transmission": 3, "rig.heading_deg": 4}),
    "textures": (168, {"terrain.rms_slope_deg": 3, "textures.stand_in": 14, "rig.heading_deg": 4}),
    "landforms": (
        336,
        {"terrain.rms_slope_deg": 3, "textures.stand_in": 14, "light.sun_irradiance_wm2": 2, "rig.heading_deg": 4},
    ),
    "generative": (
        720,
        {
            "surface.albedo_variation": 4,
            "surface.specular": 3,
            "surface.albedo": 5,
            "light.sun_irradiance_wm2": 3,
            "rig.heading_deg": 4,
        },
    ),
    "terrains": (128, {"textures.stand_in": 4, "rig.heading_deg": 4}),
    "rocks": (320, {"textures.stand_in": 4, "rocks.coverage": 2, "rocks.largest_m": 2, "rig.heading_deg": 4}),
    "snow": (
        288,
        {
            "surface.grain_size_m": 3,
            "surface.grain_amplitude_m": 3,
            "surface.subsurface_weight": 2,
            "surface.transmission": 2,
            "surface.albedo": 2,
            "rig.heading_deg": 4,
        },
    ),
}


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """Reads a shipped plan, by default on one ground of each kind: how many grounds there are changes no number of
    pairs, and each takes time to check."""
    folder = tmp_path_factory.mktemp("plans")

    def read(name: str, header: str = "grounds = 1") -> Plan:
        own = folder / "plan.toml"
        own.write_text(f'[plan]\ntitle = "Mine"\nextends = "datasets/{name}"\n{header}\n')
        return read_plan(own)

    return read


def values(pairs, name):
    topic, key = name.split(".")
    return Counter(pair.settings[topic][key] for pair in pairs)


@pytest.mark.long
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
    # Hours, not days: docs/datasets.md.
    assert values(pairs, "quality.indirect") == {"BAKED": count}
    if name in ("reconstructions", "rocks"):
        assert (
            len({(p.settings["light"]["sun_elevation_deg"], p.settings["light"]["sun_azimuth_deg"]) for p in pairs})
            == 5
        )
    if name == "reconstructions":
        sites = Counter(
            (p.settings["source"]["stand_in"], p.settings["rig"]["x_m"], p.settings["rig"]["y_m"]) for p in pairs
        )
        assert set(sites) == {(item.key, *site) for item in MESHES[:7] for site in item.sites}
        assert Counter(key for key, _, _ in sites) == {
            "ATHABASCA": 1,
            "GLACIER_42M": 4,
            "BLOODFALLS": 1,
            "SEAICE1": 6,
            "MATANUSKA_A1": 1,
            "MATANUSKA_C1": 2,
            "SVALBARD1": 2,
        }
        assert set(sites.values()) == {180}


@pytest.mark.long
def test_the_suns_are_the_papers_or_the_true_ones(mine):
    lamps = {
        name: {
            (
                p.settings["light"]["sun_irradiance_wm2"],
                p.settings["light"]["sun_angular_diameter_deg"],
                p.settings["light"]["planet"],
            )
            for p in mine(name).pairs()
        }
        for name in (
            "guiss_textures",
            "guiss_textures_true_sun",
            "guiss_landforms",
            "guiss_landforms_true_sun",
            "guiss_snow",
            "guiss_generative_true_sun",
        )
    }
    degrees = 0.57296  # 0.01 rad
    assert lamps == {
        "guiss_textures": {(4.14, degrees, False)},
        "guiss_textures_true_sun": {(14.82, 0.0556, False)},
        "guiss_landforms": {(4.14, degrees, False), (50.26, degrees, False)},
        "guiss_landforms_true_sun": {(14.82, 0.0556, False), (50.26, 0.1024, False)},
        "guiss_snow": {(10.0, degrees, False)},
        "guiss_generative_true_sun": {(e, 0.0556, False) for e in (13.28, 14.82, 16.65)},
    }


@pytest.mark.long
@pytest.mark.parametrize("name", ["guiss_all_true_sun", pytest.param("guiss_all", marks=pytest.mark.long)])
def test_all_types_together_are_the_papers_5020(mine, name):
    pairs = mine(name).pairs()
    assert len(pairs) == 5020 == sum(count for count, _ in TYPES.values())
    # The sets that the public code gives textures and meshes, of 1960 and 3060 pairs.
    assert sum(bool(list_items(pair.settings)) for pair in pairs) == 4012 == 3060 + 168 + 336 + 128 + 320


def grounds_of(pairs):
    """How many scenes of terrain there are on each ground: pairs that differ in more than their heading."""
    scenes = {
        (
            pair.settings.dataset.seed,
            *(json.dumps(values) for topic, values in pair.settings.items() if topic not in ("rig", "dataset")),
        )
        for pair in pairs
    }
    return Counter((seed, terrain) for seed, _, terrain, *_ in scenes)


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    heavy_but(
        ["guiss_terrains"],
        [f"guiss_{name}" for name in TYPES if name != "reconstructions"],
        ["guiss_rocks", "guiss_landforms"],
    ),
)
def test_each_scene_of_the_papers_sets_has_its_own_ground(mine, name):
    plan = mine(name, "")
    pairs = plan.pairs()
    assert not plan.refused()
    assert len(pairs) == TYPES[name.removeprefix("guiss_")][0]
    grounds = grounds_of(pairs)
    assert len(grounds) == len(pairs) // 4
    assert set(grounds.values()) == {1}
    assert set(grounds_of(mine(name).pairs()).values()) != {1}


@pytest.mark.long
def test_meshes_and_albedos_are_compared_on_one_ground(mine):
    for name in ("guiss_reconstructions", "guiss_albedo"):
        assert values(mine(name, "").pairs(), "dataset.seed").keys() == {1}


def test_the_smoke_test_has_every_type():
    pairs = read_plan(find_plan("guiss_smoke")).pairs()
    assert len(pairs) == 14
    assert values(pairs, "source.kind") == {"PROCEDURAL": 12, "STAND_IN": 2}


def test_a_plan_shows_every_stand_in_once():
    plan = read_plan(find_plan("guiss_stand_ins"))
    shown = [item for pair in plan.pairs() for item in list_items(pair.settings)]
    assert shown == [*TEXTURES, *MESHES]
    assert not plan.refused()


@pytest.mark.parametrize(
    ("name", "numbers"), [("textures", range(1, 15)), ("terrains", (4, 6, 7, 11)), ("rocks", (4, 6, 9, 14))]
)
def test_textures_are_those_of_the_public_code_as_wide_as_stated(mine, name, numbers):
    pairs = mine(f"guiss_{name}", "grounds = 1\nat_most = 5000").pairs()
    assert {(p.settings.textures.stand_in, p.settings.textures.width_m) for p in pairs} == {
        (item.key, item.width_m) for item in TEXTURES if item.number in numbers
    }
    assert values(pairs, "textures.set") == {"STAND_IN": len(pairs)}


def test_the_glossy_plan_has_the_materials_and_the_sampling_of_the_public_code(mine):
    pairs = mine("guiss_all_glossy", "grounds = 1\nat_most = 8").pairs()
    assert len(pairs) == 56
    assert values(pairs, "surface.model") == {"PRINCIPLED": 56}
    assert values(pairs, "quality.indirect") == {"TRACED": 56}
    assert values(pairs, "quality.denoiser") == {"OIDN": 56}
    assert values(pairs, "quality.samples") == {16: 56}


def test_the_plan_of_albedos_fixes_the_exposure():
    pairs = read_plan(find_plan("guiss_albedo")).pairs()
    assert values(pairs, "surface.albedo") == dict.fromkeys((0.2, 0.4, 0.6, 0.8, 1.0), 4)
    assert values(pairs, "sensor.auto_exposure") == {False: 20}
    assert values(pairs, "sensor.exposure_s") == {0.0007: 20}


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

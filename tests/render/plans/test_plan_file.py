"""Plans of data sets: what the sweeps combine to."""

from __future__ import annotations

import math
from itertools import product
from textwrap import dedent

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as trials
from hypothesis import strategies as st
from icymoon.physics.light.directions import camera_axes
from icymoon.physics.terrain.standing_places import make_rocky_ground
from icymoon.render.plans.plan_file import read_plan
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description, preset_files

HEAD = '[plan]\ntitle = "Test"\n'


@pytest.fixture
def plan(tmp_path):
    """Writes a plan and reads it."""

    def made(text, name="plan.toml"):
        file = tmp_path / name
        file.write_text(text if "[plan]" in text else HEAD + dedent(text))
        return read_plan(file)

    return made


def taken(pairs, name):
    topic, key = name.split(".")
    return [pair.settings[topic][key] for pair in pairs]


def test_a_plan_without_sweeps_is_the_pair_that_its_settings_make(plan):
    (pair,) = plan(HEAD + 'include = ["rigs/mer_navcam"]\n[terrain]\nrms_slope_deg = 5').pairs()
    described = description.merged(
        description.defaults(), preset_files.load_preset("rigs/mer_navcam"), {"terrain": {"rms_slope_deg": 5.0}}
    )
    assert pair == expand_headings(described)[0]


def test_headings_of_the_data_set_are_pairs_of_their_own(plan):
    pairs = plan("[dataset]\nheadings = 4\n[rig]\nheading_deg = 123.456").pairs()
    described = description.merged(
        description.defaults(), {"dataset": {"headings": 4}, "rig": {"heading_deg": 123.456}}
    )
    assert [p.id for p in pairs] == [p.id for p in expand_headings(described)]
    assert [p.turn_deg for p in pairs] == [0.0] * 4
    # What a pair says of itself makes that pair, and no other.
    assert [[q.id for q in expand_headings(p.settings)] for p in pairs] == [[p.id] for p in pairs]


def test_a_panorama_turns_the_rig(plan):
    pairs = plan('[[sweep]]\nkind = "panorama"\nheadings = 3\npitches_deg = [10, 45]').pairs()
    assert taken(pairs, "rig.heading_deg") == [0.0, 120.0, -120.0] * 2
    assert taken(pairs, "rig.pitch_deg") == [10.0] * 3 + [45.0] * 3
    pairs = plan('[[sweep]]\nkind = "panorama"\nheadings = [-90, 90.5]').pairs()
    assert taken(pairs, "rig.heading_deg") == [-90.0, 90.5]


@pytest.mark.long
@trials(deadline=None)  # each reads files
@given(st.lists(st.integers(1, 4), min_size=1, max_size=4))
def test_a_grid_is_as_large_as_the_product_of_its_values(tmp_path_factory, sizes):
    names = ["surface.albedo", "light.sun_elevation_deg", "rig.pitch_deg", "rig.height_m"]
    lines = [f"{name} = {[(k + 1) / 8 for k in range(size)]}" for name, size in zip(names, sizes, strict=False)]
    file = tmp_path_factory.mktemp("plan") / "plan.toml"
    file.write_text(HEAD + '[[sweep]]\nkind = "grid"\n' + "\n".join(lines))
    pairs = read_plan(file).pairs()
    assert len({p.id for p in pairs}) == len(pairs) == math.prod(sizes)
    wanted = set(product(*([(k + 1) / 8 for k in range(size)] for size in sizes)))
    assert {tuple(row) for row in zip(*(taken(pairs, n) for n in names[: len(sizes)]), strict=True)} == wanted


def test_blocks_combine_and_the_last_one_changes_fastest(plan):
    pairs = plan("""
        [[sweep]]
        kind = "grid"
        surface.albedo = [0.2, 0.4]
        [[sweep]]
        kind = "one_at_a_time"
        rig.pitch_deg = [45.84, 20]
        rig.baseline_m = [0.1]
    """).pairs()
    rows = list(zip(*(taken(pairs, n) for n in ("surface.albedo", "rig.pitch_deg", "rig.baseline_m")), strict=True))
    # The base, then each other value alone; 45.84 is the base's own.
    assert rows == [(a, p, b) for a in (0.2, 0.4) for p, b in ((45.84, 0.25), (20.0, 0.25), (45.84, 0.1))]


def test_cases_go_together_and_take_presets(plan):
    pairs = plan("""
        [[sweep]]
        kind = "cases"
        case = [
          { light.sun_elevation_deg = 30, light.sun_azimuth_deg = 90 },
          { preset = ["terrains/low_1", "lights/guiss_europa"], light.sun_irradiance_wm2 = 3 },
        ]
    """).pairs()
    assert taken(pairs, "light.sun_elevation_deg") == [30.0, 20.0]
    assert taken(pairs, "light.sun_azimuth_deg") == [90.0, 60.0]
    assert taken(pairs, "light.sun_irradiance_wm2") == [14.82, 3.0]
    assert taken(pairs, "terrain.rms_slope_deg") == [12.0, 4.0]


def test_what_comes_twice_is_there_once(plan):
    pairs = plan("""
        [[sweep]]
        kind = "grid"
        surface.albedo = [0.2, 0.3, 0.2]
    """).pairs()
    assert taken(pairs, "surface.albedo") == [0.2, 0.3]


BLOCKS = (
    '[[sweep]]\nkind = "grid"\nsurface.albedo = [0.2, 0.4]\n',
    '[[sweep]]\nkind = "latin_hypercube"\ncount = 3\nlight.sun_elevation_deg = { uniform = [10, 60] }\n',
    '[[sweep]]\nkind = "sites"\ncount = 2\n',
    '[[sweep]]\nkind = "panorama"\nheadings = 2\n',
)


@pytest.mark.long
@trials(deadline=None)  # each reads files
@given(st.permutations(BLOCKS))
def test_ids_do_not_hang_on_the_order_of_the_blocks(tmp_path_factory, order):
    folder = tmp_path_factory.mktemp("plan")
    for name, text in (("a.toml", BLOCKS), ("b.toml", order)):
        (folder / name).write_text(HEAD + "".join(text))
    one, other = ([p.id for p in read_plan(folder / name).pairs()] for name in ("a.toml", "b.toml"))
    assert len(one) == 2 * 3 * 2 * 2
    assert sorted(one) == sorted(other)


@pytest.mark.parametrize("kind", ["random", "sobol", "latin_hypercube"])
def test_draws_hang_on_the_seed_and_on_names_alone(plan, kind):
    text = f'[[sweep]]\nname = "drawn"\nkind = "{kind}"\ncount = 8\nsurface.albedo = {{ uniform = [0.1, 0.9] }}\n'
    first = plan(text).pairs()
    assert [p.id for p in plan(text).pairs()] == [p.id for p in first]
    # Another block before it and another setting in it do not move its draws.
    before = '[[sweep]]\nkind = "grid"\nrig.baseline_m = [0.3]\n'
    more = plan(before + text + "hapke.w = { uniform = [0.5, 0.9] }").pairs()
    assert taken(more, "surface.albedo") == taken(first, "surface.albedo")
    other = plan("[dataset]\nseed = 2\n" + text).pairs()
    assert not set(taken(other, "surface.albedo")) & set(taken(first, "surface.albedo"))
    assert not {p.id for p in other} & {p.id for p in first}


def test_every_distribution_keeps_to_its_limits_and_type(plan):
    pairs = plan("""
        [[sweep]]
        kind = "latin_hypercube"
        count = 40
        surface.grain_size_m = { log_uniform = [0.001, 0.1] }
        hapke.w = { normal = [0.95, 0.1], within = [0.8, 1.0] }
        surface.model = { choice = ["LAMBERT", "HAPKE"] }
        terrain.resolution = { uniform = [65, 68] }
        preset = { choice = ["terrains/low_1", "terrains/high_1"] }
    """).pairs()
    grain = np.log(taken(pairs, "surface.grain_size_m"))
    assert np.histogram(grain, 40, (math.log(0.001), math.log(0.1)))[0].max() <= 2  # one a part but for six digits
    assert all(0.8 <= w <= 1.0 for w in taken(pairs, "hapke.w"))
    for name, values in (
        ("surface.model", {"LAMBERT", "HAPKE"}),
        ("terrain.resolution", {65, 66, 67, 68}),
        ("terrain.rms_slope_deg", {4.0, 20.0}),
    ):
        counts = [taken(pairs, name).count(v) for v in values]
        assert sum(counts) == 40
        assert max(counts) == 40 / len(values)
    assert all(isinstance(n, int) for n in taken(pairs, "terrain.resolution"))


def test_seeds_are_children_of_the_data_sets_seed(plan):
    five, three = (taken(plan(f"{HEAD}seeds = {n}\n").pairs(), "dataset.seed") for n in (5, 3))
    assert five[:3] == three
    assert len(set(five)) == 5
    assert taken(plan(HEAD + "seeds = [4, 7]\n").pairs(), "dataset.seed") == [4, 7]
    assert not set(taken(plan(f"{HEAD}seeds = 5\n[dataset]\nseed = 2\n").pairs(), "dataset.seed")) & set(five)


TEN = """
[[sweep]]
kind = "grid"
light.sun_elevation_deg = [10, 20]
surface.albedo = [0.1, 0.2, 0.3, 0.4, 0.5]
[[sweep]]
kind = "panorama"
headings = 2
"""


@pytest.mark.parametrize("count", [2, 3, 10, 200])
def test_grounds_are_dealt_to_the_scenes_of_a_plan(plan, count):
    """No more pairs than without, all views of a scene on one ground, and each ground about as often as the others."""
    pairs = plan(f"{HEAD}grounds = {count}\n{TEN}").pairs()
    assert len(pairs) == 20
    scenes = {(p.settings.light.sun_elevation_deg, p.settings.surface.albedo, p.settings.dataset.seed) for p in pairs}
    assert len(scenes) == 10
    often = [sum(scene[2] == seed for scene in scenes) for seed in {scene[2] for scene in scenes}]
    assert len(often) == min(count, 10)
    assert max(often) - min(often) <= 1
    assert [p.id for p in plan(f"{HEAD}grounds = {count}\n{TEN}").pairs()] == [p.id for p in pairs]


def test_grounds_do_not_follow_a_setting_that_varies(plan):
    pairs = plan(f"{HEAD}grounds = 2\n{TEN}").pairs()
    on = {
        seed: {p.settings.surface.albedo for p in pairs if p.settings.dataset.seed == seed}
        for seed in taken(pairs, "dataset.seed")
    }
    assert all(len(albedos) > 2 for albedos in on.values())


def test_grounds_are_children_of_each_seed(plan):
    """With ``seeds`` too, each seed has its own grounds; with one ground, pairs are those of a plan without."""
    both = plan(f"{HEAD}seeds = [4, 7]\ngrounds = 200\n{TEN}").pairs()
    assert len(set(taken(both, "dataset.seed"))) == 20
    assert not {4, 7} & set(taken(both, "dataset.seed"))
    assert [p.id for p in plan(f"{HEAD}grounds = 1\n{TEN}").pairs()] == [p.id for p in plan(f"{HEAD}{TEN}").pairs()]


def test_a_ground_from_a_file_keeps_its_seed(plan, tmp_path):
    (tmp_path / "mine.ply").write_bytes(b"ply")
    source = 'source.kind = ["MESH"]\nsource.file = ["mine.ply"]\nsource.detail = [false, true]\n'
    pairs = plan(f"{HEAD}grounds = 9\n{TEN}\n[[sweep]]\nkind = 'grid'\n{source}").pairs()
    assert {p.settings.dataset.seed for p in pairs if not p.settings.source.detail} == {1}
    assert len({p.settings.dataset.seed for p in pairs if p.settings.source.detail}) > 4


def test_a_view_sphere_looks_at_its_target_from_its_distance(plan):
    pairs = plan("""
        [rig]
        x_m = 1.0
        y_m = -2.0
        [[sweep]]
        kind = "view_sphere"
        elevations_deg = [30, 60, 90]
        azimuths_deg = [0, 30, 200]
        distances_m = 3
        target_height_m = 0.2
    """).pairs()
    assert len(pairs) == 9
    ground = make_rocky_ground(pairs[0].settings)
    target = np.array([1.0, -2.0, float(ground.heights(1.0, -2.0)) + 0.2])
    for pair, (elevation, azimuth) in zip(pairs, product((30, 60, 90), (0, 30, 200)), strict=True):
        rig = pair.settings["rig"]
        eye = np.array([rig["x_m"], rig["y_m"], float(ground.heights(rig["x_m"], rig["y_m"])) + rig["height_m"]])
        away = eye - target
        # Six digits of coordinates of a few metres are 1e-5 m.
        assert np.linalg.norm(away) == pytest.approx(3.0, abs=1e-4)
        assert math.degrees(math.asin(away[2] / 3.0)) == pytest.approx(elevation, abs=0.2 if elevation == 90 else 0.01)
        if elevation < 90:
            assert math.degrees(math.atan2(away[0], away[1])) % 360 == pytest.approx(azimuth, abs=0.01)
        forward = camera_axes(rig["heading_deg"], rig["pitch_deg"])[:, 2]
        assert forward == pytest.approx(-away / 3.0, abs=1e-4)


def test_sites_are_clear_of_rocks_and_apart_and_on_the_patch(plan):
    pairs = plan("""
        [rocks]
        coverage = 0.1
        smallest_m = 0.2
        [[sweep]]
        kind = "sites"
        count = 12
        clearance_m = 0.6
        margin_m = 2.0
        apart_m = 1.5
        random_headings = true
    """).pairs()
    ground = make_rocky_ground(pairs[0].settings)
    places = np.column_stack([taken(pairs, "rig.x_m"), taken(pairs, "rig.y_m")])
    rocks = ground.rocks
    away = np.linalg.norm(places[:, None] - rocks.position_m[None, :, :2], axis=2) - rocks.reach_m
    assert away.min() >= 0.6
    assert away.min(axis=1).max() < 3.0  # there are rocks nearby
    assert np.abs(places).max() <= 8.0
    apart = np.linalg.norm(places[:, None] - places[None], axis=2) + 1e9 * np.eye(12)
    assert apart.min() >= 1.5
    assert len(set(taken(pairs, "rig.heading_deg"))) == 12


def test_sites_are_the_same_for_all_that_does_not_change_the_ground(plan):
    pairs = plan("""
        [[sweep]]
        kind = "grid"
        surface.albedo = [0.3, 0.6]
        [[sweep]]
        kind = "sites"
        count = 3
    """).pairs()
    assert taken(pairs[:3], "rig.x_m") == taken(pairs[3:], "rig.x_m")


def test_at_most_takes_pairs_evenly_from_the_whole(plan):
    text = "at_most = 4\n[[sweep]]\nkind = 'grid'\nsurface.albedo = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]"
    assert taken(plan(HEAD + text).pairs(), "surface.albedo") == [0.1, 0.3, 0.5, 0.7]
    assert len(plan(HEAD + text.replace("= 4", "= 99")).pairs()) == 8


def test_a_plan_extends_another(plan, tmp_path):
    plan(
        """
        [light]
        sun_elevation_deg = 33
        [[sweep]]
        name = "bright"
        kind = "grid"
        surface.albedo = [0.1, 0.2, 0.3]
        [[sweep]]
        name = "views"
        kind = "panorama"
    """,
        "parent.toml",
    )
    child = plan(
        HEAD
        + """extends = "parent.toml"
        include = ["lights/guiss_europa"]
        [[sweep]]
        replaces = "bright"
        kind = "grid"
        surface.albedo = [0.9]
        [[sweep]]
        kind = "grid"
        rig.baseline_m = [0.1, 0.2]
    """
    )
    pairs = child.pairs()
    assert taken(pairs, "surface.albedo") == [0.9] * 8
    assert taken(pairs, "light.sun_elevation_deg") == [33.0] * 8
    assert taken(pairs, "light.sun_irradiance_wm2") == [50.26] * 8
    assert child.title == "Test"
    assert child.text == (tmp_path / "plan.toml").read_text()
    fewer = plan(HEAD + 'extends = "parent.toml"\nwithout = ["views"]\n', "fewer.toml")
    assert len(fewer.pairs()) == 3
    both = plan(HEAD + 'extends = ["plan.toml", "fewer.toml"]\n[rig]\nheight_m = 2\n', "both.toml").pairs()
    assert len(both) == 8 + 3
    assert taken(both, "rig.height_m") == [2.0] * 11


def test_files_lie_beside_the_plan_or_in_its_folder_of_files(plan, tmp_path):
    for folder in (tmp_path, tmp_path / "mine"):
        folder.mkdir(exist_ok=True)
        (folder / "ice.png").write_bytes(b"ice" if folder == tmp_path else b"other ice")
    text = '[[sweep]]\nkind = "cases"\ncase = [{ textures.set = "OWN", textures.albedo_file = "ice.png" }]\n'
    (beside,) = plan(text).pairs()
    (elsewhere,) = plan(HEAD + 'extends = "plan.toml"\nfiles = "mine"\n', "child.toml").pairs()
    assert beside.settings["textures"]["albedo_file"] == str(tmp_path / "ice.png")
    assert elsewhere.settings["textures"]["albedo_file"] == str(tmp_path / "mine" / "ice.png")
    assert beside.id != elsewhere.id
    (tmp_path / "mine" / "ice.png").write_bytes(b"ice")
    assert plan(HEAD + 'extends = "plan.toml"\nfiles = "mine"\n', "child.toml").pairs()[0].id == beside.id

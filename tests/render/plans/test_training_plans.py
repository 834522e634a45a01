"""Plans for training: thousands of different scenes, presets to draw from, splits."""

from __future__ import annotations

import json

import pytest
from icymoon.render.pairs.scene_splits import DEFAULT_SPLITS, read_splits
from icymoon.render.plans.frozen_plan import freeze_plan
from icymoon.render.plans.plan_file import parse_plan
from icymoon.support.errors import IcyMoonError

HEAD = '[plan]\ntitle = "T"\n'
SUN = """
[[sweep]]
kind = "random"
name = "sun"
count = 4
light.sun_elevation_deg = { uniform = [5, 60] }
"""


def plan(tmp_path, text):
    return parse_plan(tmp_path / "plan.toml", text)


def suns(read):
    """Elevations of the Sun by seed, in the order of the plan."""
    found = {}
    for pair in read.pairs():
        found.setdefault(int(pair.settings.dataset.seed), []).append(pair.settings.light.sun_elevation_deg)
    return list(found.values())


def test_each_seed_has_draws_of_its_own_where_the_plan_says_so(tmp_path):
    read = plan(tmp_path, f"{HEAD}seeds = 5\ndraw_again = true\n{SUN}")
    drawn = suns(read)
    assert len({value for values in drawn for value in values}) == 20
    assert not read.describe_draws()
    # More seeds change no draw of the first ones.
    assert suns(plan(tmp_path, f"{HEAD}seeds = 7\ndraw_again = true\n{SUN}"))[:5] == drawn


def test_without_it_every_seed_has_the_same_draws_and_the_plan_says_so(tmp_path):
    read = plan(tmp_path, f"{HEAD}seeds = 3\n{SUN}")
    first, *others = suns(read)
    assert len(set(first)) == 4
    assert all(each == first for each in others)
    assert "draw_again = true" in read.describe_draws()
    assert not plan(tmp_path, HEAD + SUN).describe_draws(), "one seed repeats nothing"
    # What version 0.1 gave, whose ids may not change.
    assert [pair.id for pair in read.pairs()] == [
        pair.id for pair in plan(tmp_path, f"{HEAD}seeds = 3\ndraw_again = false\n{SUN}").pairs()
    ]


def test_draws_of_one_setting_are_those_of_its_own_seed(tmp_path):
    """A seed that is stated alone gives what it gives among others."""
    many = suns(plan(tmp_path, f"{HEAD}seeds = [7, 8]\ndraw_again = true\n{SUN}"))
    assert suns(plan(tmp_path, f"{HEAD}seeds = [8]\ndraw_again = true\n{SUN}")) == many[1:]


def test_presets_are_drawn_from_several_lists(tmp_path):
    read = plan(
        tmp_path,
        HEAD
        + """
[[sweep]]
kind = "random"
count = 40
presets.place = { choice = ["scenes/europa_rough_ice", "scenes/enceladus_fresh_snow"] }
presets.quality = { choice = ["qualities/draft", "qualities/standard"] }
rig.pitch_deg = { uniform = [10, 30] }
""",
    )
    found = {(pair.settings.light.body, pair.settings.quality.samples) for pair in read.pairs()}
    assert len(found) == 4, "each of the one list with each of the other"


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ('presets = ["scenes/europa_rough_ice"]', "a single list is called preset"),
        ('presets.place = { choice = ["scenes/europa_rogh_ice"] }', "europa_rough_ice"),
    ],
    ids=["list", "misspelt"],
)
def test_lists_of_presets_that_are_none_are_refused(tmp_path, text, error):
    with pytest.raises(IcyMoonError, match=error):
        plan(tmp_path, f'{HEAD}[[sweep]]\nkind = "random"\ncount = 2\n{text}\n').pairs()


def test_splits_of_the_plan_are_those_of_the_data_set(tmp_path):
    text = f"{HEAD}splits = {{ fit = 0.7, check = 0.3 }}\n{SUN}"
    read = plan(tmp_path, text)
    assert read.describe_splits() == "Splits of the scenes: fit 70 %, check 30 %"
    freeze_plan(tmp_path, read.pairs(), read.text)
    assert read_splits(tmp_path) == {"fit": 0.7, "check": 0.3}
    assert read_splits(tmp_path / "elsewhere") == DEFAULT_SPLITS


@pytest.mark.parametrize(
    "wrong", ['"half"', "{ train = 0.5, test = 0.6 }", '{ train = "most" }', '{ "../a" = 1.0 }', "{ train = true }"]
)
def test_splits_that_are_none_are_refused_with_their_line(tmp_path, wrong):
    with pytest.raises(IcyMoonError, match=r"plan\.toml.* line 3.*split"):
        plan(tmp_path, f"{HEAD}splits = {wrong}\n{SUN}")


def test_a_plan_in_a_data_set_cannot_name_files_of_splits(tmp_path):
    (tmp_path / "plan.jsonl").write_text(json.dumps({"plan": '[plan]\nsplits = { "../x" = 1.0 }\n'}) + "\n")
    with pytest.raises(IcyMoonError, match="letters, digits"):
        read_splits(tmp_path)


def test_progress_is_reported_while_a_plan_is_checked(tmp_path):
    seen = []
    plan(tmp_path, f"{HEAD}{SUN.replace('count = 4', 'count = 250')}").check(lambda *told: seen.append(told))
    assert seen == [(0, 250), (100, 250), (200, 250)]

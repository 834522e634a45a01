"""No part of a plan overwrites what a sweep varies without a word."""

from __future__ import annotations

from itertools import permutations

import pytest
from icymoon.render.plans.plan_file import read_plan
from icymoon.support.errors import IcyMoonError

HEAD = '[plan]\ntitle = "Test"\n'
#: Sweeps of all kinds, and how many variations each has over the defaults.
SWEEPS = {
    'kind = "grid"\nrig.heading_deg = [10, 20, 35]': 3,
    'kind = "grid"\nrig.pitch_deg = [20, 30]\nlight.sun_elevation_deg = [5, 15]': 4,
    'kind = "one_at_a_time"\nrig.pitch_deg = [21]\nrig.baseline_m = [0.1]': 3,
    'kind = "cases"\ncase = [{ rig.pitch_deg = 25, rig.height_m = 1.0 }, { rig.height_m = 2.0 }]': 2,
    'kind = "latin_hypercube"\ncount = 3\nrig.baseline_m = { uniform = [0.1, 0.4] }\n'
    "surface.albedo = { uniform = [0.2, 0.8] }": 3,
    'kind = "grid"\npreset = ["rigs/mer_navcam", "rigs/mer_pancam"]': 2,
    'kind = "grid"\nrig.x_m = [0.0, 0.5]': 2,
    'kind = "panorama"\nheadings = 2': 2,
    'kind = "panorama"\nheadings = [3, 100]': 2,
    'kind = "panorama"\nheadings = [3]\npitches_deg = [31, 41]': 2,
    'kind = "sites"\ncount = 2\nrandom_headings = true': 2,
    'kind = "view_sphere"\nelevations_deg = [50, 60]\nazimuths_deg = 0\ndistances_m = 2': 2,
}


@pytest.fixture
def plan(tmp_path):
    """Writes a plan and reads it."""

    def made(text, name="plan.toml"):
        (tmp_path / name).write_text(text if "[plan]" in text else HEAD + text)
        return read_plan(tmp_path / name)

    return made


def refusal(plan):
    """What a plan is refused with; empty if it is not."""
    try:
        plan.pairs()
    except IcyMoonError as error:
        return str(error)
    return ""


@pytest.mark.long
def test_two_sweeps_give_every_combination_or_are_refused(plan):
    """Of 132 pairs of sweeps. Those that share no setting are not refused."""
    refused = set()
    for one, other in permutations(SWEEPS, 2):
        made = plan(f"[[sweep]]\n{one}\n[[sweep]]\n{other}\n")
        if said := refusal(made):
            assert "would be lost" in said or "are the same" in said, said
            refused.add(frozenset((one, other)))
        else:
            assert len(made.pairs()) == SWEEPS[one] * SWEEPS[other], (one, other)
    heading, pitch, *_, turns, headings, pitches, sites, _ = SWEEPS
    assert frozenset((heading, headings)) in refused
    assert frozenset((pitch, pitches)) in refused
    assert not refused & {
        frozenset(each) for each in ((heading, turns), (heading, pitch), (pitch, headings), (sites, turns))
    }


@pytest.mark.parametrize(
    ("sweeps", "words"),
    [
        (
            ('kind = "grid"\nrig.heading_deg = [0, 10, 20]', 'kind = "panorama"\nheadings = [0, 90]'),
            "line 6: this sweep sets rig.heading_deg, so the values in {file}, line 3 would be lost; "
            "state all values "
            "of rig.heading_deg in one of the two.",
        ),
        (
            (
                'kind = "cases"\ncase = [{ rig.baseline_m = 0.1, rig.height_m = 1.0 }, { rig.height_m = 2.0 }]',
                'kind = "grid"\nrig.baseline_m = [0.3]',
            ),
            "state all values of rig.baseline_m in one of the two.",
        ),
        (
            (
                'kind = "random"\ncount = 2\nlight.sun_irradiance_wm2 = { uniform = [1, 2] }',
                'kind = "grid"\npreset = ["lights/guiss_europa"]',
            ),
            "let the sweep of presets come first.",
        ),
        (('kind = "panorama"\nheadings = 2', 'kind = "panorama"\nheadings = [1, 2]'), "rig.heading_deg"),
        (('kind = "sites"\ncount = 2', 'kind = "sites"\ncount = 2'), "rig.x_m, rig.y_m"),
    ],
)
def test_the_sentence_names_both_lines_and_a_fix(plan, sweeps, words):
    said = refusal(made := plan("".join(f"[[sweep]]\n{each}\n" for each in sweeps)))
    assert words.format(file=made.path) in said


def test_two_presets_that_a_later_sweep_makes_one_are_refused(plan, tmp_path):
    for k in range(2):
        (tmp_path / f"{k}.toml").write_text(
            f"[preset]\ntitle = '{k}'\ndescription = ''\n[rig]\n"
            f"baseline_m = 0.{k + 1}\npitch_deg = {20 + k}\nheight_m = 2.0\n"
        )
    presets = '[[sweep]]\nkind = "grid"\npreset = ["0.toml", "1.toml"]\n'
    baselines, pitches = (
        f'[[sweep]]\nkind = "grid"\nrig.{values}\n' for values in ("baseline_m = [0.3, 0.4]", "pitch_deg = [30, 40]")
    )
    assert len(plan(presets + baselines).pairs()) == 4  # they still differ in their pitch
    assert "leave one of the two out." in refusal(plan(presets + baselines + pitches))
    assert len(plan(baselines.replace("baseline_m", "width_px").replace("0.3, 0.4", "64, 96") + presets).pairs()) == 4


def test_seeds_are_stated_once(plan):
    seeds = '[[sweep]]\nkind = "grid"\ndataset.seed = [1, 2]\n'
    assert "would be lost" in refusal(plan(HEAD + "seeds = 3\n" + seeds))
    assert len(plan(seeds).pairs()) == 2


def test_a_plan_states_no_setting_that_a_sweep_of_its_parent_sets(plan):
    """The parent's own setting under its sweep stays: one at a time needs it."""
    plan(
        HEAD + '[rig]\nbaseline_m = 0.2\n[[sweep]]\nkind = "grid"\nname = "b"\nrig.baseline_m = [0.1, 0.3]\n', "a.toml"
    )
    child = '[plan]\ntitle = "Child"\nextends = "a.toml"\n{}[rig]\nbaseline_m = 0.4\n'
    said = refusal(plan(child.format("")))
    assert "plan.toml, line 5: rig.baseline_m would change nothing" in said
    assert "without = ['b']" in said
    assert [p.settings.rig.baseline_m for p in plan(child.format("without = ['b']\n")).pairs()] == [0.4]
    sweep = "[[sweep]]\nkind = 'grid'\n{}rig.baseline_m = [0.5, 0.6]\n"
    said = refusal(plan('[plan]\ntitle = "Child"\nextends = "a.toml"\n' + sweep.format("")))
    assert "or write replaces = 'b'." in said
    pairs = plan('[plan]\ntitle = "Child"\nextends = "a.toml"\n' + sweep.format("replaces = 'b'\n")).pairs()
    assert [p.settings.rig.baseline_m for p in pairs] == [0.5, 0.6]

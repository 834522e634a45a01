"""The shipped designs, and what a design may not state: one sentence with the file, the fault and a fix."""

from __future__ import annotations

import re
from typing import Any

import pytest
from icymoon.stereo.design.read_design import find_design, list_design_names, measure_seen_share, read_design
from icymoon.support.errors import IcyMoonError

SHIPPED = "suites"


@pytest.mark.parametrize("name", list_design_names())
def test_shipped_designs_are_whole(name):
    design = read_design(find_design(name))
    assert 8 <= len(design.suites) <= 12
    assert len({suite.name for suite in design.suites}) == len(design.suites)
    assert all(suite.settings.workspace == design.suites[0].settings.workspace for suite in design.suites)
    numbers = [f"{table}.{key}" for table in ("costs", "lamp") for key in getattr(design, table).__dataclass_fields__]
    assert set(numbers) <= set(design.sources)  # each has its source


def test_the_shipped_suites_differ_in_each_kind_of_choice():
    suites = {suite.name: suite for suite in read_design(find_design(SHIPPED)).suites}
    base = suites["base"]
    assert {suite.settings.rig.baseline_m for suite in suites.values()} == {0.12, 0.25, 0.4}
    assert {suite.suns for suite in suites.values()} == {1, 3}
    assert {suite.lamp.power_w if suite.lamp else 0 for suite in suites.values()} == {0, 20}
    assert sorted(int(suite.method.lidar["points"]) for suite in suites.values() if suite.method.lidar) == [100, 1000]
    assert len({suite.method.name for suite in suites.values()}) == 4
    fine = suites["fine"].settings
    assert fine.rig.width_px > base.settings.rig.width_px
    assert measure_seen_share(fine) == measure_seen_share(base.settings)  # the same field of view
    assert base.settings.rig.width_px == 320
    assert base.settings.sensor.read_noise_e == 15  # by the preset


#: What is exchanged in the shipped design, and words of the sentence, which end in the fix.
WRONG: dict[str, tuple[Any, str, str]] = {
    "no table": (re.compile(r"(?s)\[costs\].*?(?=# What)"), "", "costs is missing; compare it with the shipped design"),
    "no table of costs": (re.compile(r"(?s)\[costs\].*?(?=# What)"), "[[costs]]\n", "costs is .*; compare it with the"),
    "misspelt table": ("[costs]", "[cost]", "unknown key cost, did you mean 'costs'"),
    "misspelt cost": ("camera_w = 3.0", "camera_watt = 3.0", "unknown key costs.camera_watt, did you mean 'camera_w'"),
    "unknown key": ("rays_per_pixel = 2", "rays_per_pixel = 2\nray = 1", "unknown key design.ray, .*rays_per_pixel"),
    "unknown cost": ("camera_w = 3.0", "camera_w = 3.0\nmotor_w = 1.0", "unknown key costs.motor_w"),
    "unknown table": ("\n[settings]\n", "\n[other]\na = 1\n[settings]\n", "unknown key other"),
    "no cost": ("processor_w = 10.0", "processor_w = 0.0", "costs.processor_w is 0.0, not a number above 0"),
    "terrain": ('"smooth"', '"smoth"', "there is no 'smoth', .*smooth"),
    "no terrain": (re.compile(r"terrains = \[.*\]"), "terrains = []", "names no terrain; name one or more"),
    "Suns": ("[16.0, 65.0]", "[65.0, 16.0]", "give the least and the greatest elevation, from 3 to 65"),
    "rays": ("rays_per_pixel = 2", "rays_per_pixel = 0", "give 1 to 64"),
    "loss": ("abstain_loss = 0.2", "abstain_loss = 1.5", "give a number from 0 to 1"),
    "ready": ("lidar_ready_s = 10.0", "lidar_ready_s = -1.0", "give 0 or more"),
    "preset": ("rigs/guiss", "rigs/guis", "design.include: Unknown preset"),
    "two names": ('name = "short"', 'name = "base"', "2 suites 'base'; give each suite a name of its own"),
    "no Sun": ("suns = 3", "suns = 0", "suite suns_3 has suns = 0; give 1 to 100"),
    "matcher": ('method = "jplv"', 'method = "jpl"', "suite jplv: method: .*jplv"),
    "two methods": ('method = "jplv"', 'method = "jplv,bm"', "has 2 methods, jplv,bm; give one"),
    "truth": ('method = "jplv"', 'method = "bm:disparities=truth"', "bm:disparities=truth searches .* leave"),
    "scan": ("points=100\"", "points=100:returns=scans\"", "grounds by rays have none; leave it out"),
    "setting": ("rig.baseline_m = 0.12", "rig.base_m = 0.12", "suite short.*baseline_m"),
    "lamp": ("rig.baseline_m = 0.12", "light.planet = false", "suite short states light, .*in \\[settings\\]"),
    "no power": ("lamp_w = 20.0", "lamp_w = 0.0", "suite lamp has lamp_w = 0; give the electric power .* above 0"),
    "words for power": ("lamp_w = 20.0", 'lamp_w = "20 W"', "lamp_w.*number; compare it with the shipped design"),
    "no lamp": (re.compile(r"(?ms)^\[lamp\].*?(?=^# What all)"), "", r"no table \[lamp\]; add one with efficiency, "),
    "half a lamp": ("right_m = 0.55\n", "", "lamp.right_m is missing; compare it"),
    "misspelt lamp": ("up_m = -0.2", "high_m = 0.2", "unknown key lamp.high_m"),
    "more light than power": ("efficiency = 0.3", "efficiency = 3", "lamp.efficiency is 3; give the share"),
    "far lamp": ("right_m = 0.55", "right_m = 55", "lamp.right_m is 55; give metres .* from -10 to 10"),
    "buried lamp": ("up_m = -0.2", "up_m = -5", "suite lamp has a lamp .* m under level ground; raise lamp.up_m"),
    "own workspace": ("rig.baseline_m = 0.12", "workspace.cell_m = 0.1", "suite short states workspace"),
    "idle": ("rig.baseline_m = 0.12", "rig.toe_in_deg = 1.0", "rig.toe_in_deg of suite short does not act"),
    "idle for all": ("rig.width_px = 320", "light.sun_elevation_deg = 20.0", "light.sun_elevation_deg of the design"),
    "no workspace": ("workspace.cell_m = 0.02", "", "has no workspace; state workspace.cell_m"),
    "size": ("rig.width_px = 480", "rig.width_px = 484", "484 x 360 px; give multiples of 8"),
    "aside": ("workspace.east_m = 0.3", "workspace.east_m = 1.5", "suite base: both cameras .* aim them by rig.pitch"),
    "one eye": ("rig.baseline_m = 0.12", "rig.baseline_m = 2.0", "suite short: both cameras see 3 % of the workspace"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_design_is_one_sentence(name, tmp_path):
    old, new, words = WRONG[name]
    text = find_design(SHIPPED).read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(old.sub(new, text) if isinstance(old, re.Pattern) else text.replace(old, new), encoding="utf-8")
    assert path.read_text(encoding="utf-8") != text
    with pytest.raises(IcyMoonError, match=words) as found:
        read_design(path)
    assert str(path) in str(found.value)
    assert "\n" not in str(found.value)


def test_a_design_without_suites_and_one_that_is_not_there(tmp_path):
    text = find_design(SHIPPED).read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text("suite = []\n" + text[: text.index("[[suite]]")], encoding="utf-8")
    with pytest.raises(IcyMoonError, match="has no suite; add a table"):
        read_design(path)
    with pytest.raises(IcyMoonError, match=r"no design 'suite', did you mean 'suites'"):
        find_design("suite")
    with pytest.raises(IcyMoonError, match="cannot be read"):
        read_design(find_design(str(tmp_path / "absent.toml")))


def test_the_seen_share_of_a_workspace_is_that_of_the_field_of_view():
    """A camera that looks straight down from 2 m at 60 mm and 60 mm wide sees 2 m x 1.5 m; the other one 0.5 m to the
    east."""
    settings = read_design(find_design(SHIPPED)).suites[0].settings
    settings.rig.update({"focal_length_mm": 60.0, "height_m": 2.0, "pitch_deg": 90.0, "baseline_m": 0.5})
    settings.workspace.update({"east_m": 0.25, "north_m": 0.0, "size_m": 1.2})
    assert measure_seen_share(settings) == 1.0
    settings.workspace.update({"size_m": 2.4})  # 1.5 m of 2.4 m both ways
    assert measure_seen_share(settings) == pytest.approx((1.5 / 2.4) ** 2, abs=0.06)

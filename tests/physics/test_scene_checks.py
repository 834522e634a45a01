"""What is refused since it would be silently wrong, in plans, renders and the window alike."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from icymoon.commands import render_scenes
from icymoon.physics import scene_checks
from icymoon.physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance, hapke_from_settings
from icymoon.physics.terrain.standing_places import make_rocky_ground
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.render.plans.plan_file import read_plan
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT

#: The scene of which the right eye was in the ground, and its images black, without a word.
UNDERGROUND = {"terrain": {"rms_slope_deg": 25.0}, "rig": {"height_m": 0.1, "baseline_m": 0.3}}


def complete(*parts: dict) -> Settings:
    return description.merged(description.defaults(), *(description.check(part, "test") for part in parts))


def is_sentence(text):
    return text.endswith(".") and "\n" not in text and len(text) > 20


def test_an_eye_in_the_ground_is_refused_and_admitted_from_where_it_is_above():
    settings = complete(UNDERGROUND)
    ground = make_terrain(settings, int(settings["dataset"]["seed"]))
    # As the rig is described: the right eye is east of the left one and as high, the left one over the origin.
    rise = float(ground.heights(0.3, 0.0) - ground.heights(0.0, 0.0))
    assert rise > 0.1
    (said,) = scene_checks.find_reasons(settings)
    assert is_sentence(said)
    assert f"right eye {rise - 0.1:.3g} m under the ground" in said
    assert "rig.height_m (0.1 m)" in said
    for above_m, admitted in ((0.5e-3, False), (2e-3, True)):  # of the least height, a millimetre
        near = complete(UNDERGROUND, {"rig": {"height_m": rise + above_m}})
        assert bool(scene_checks.find_reasons(near)) != admitted


@pytest.mark.parametrize("roll", [-20.0, 20.0])
def test_the_right_eye_of_a_rolled_rig_is_as_low_as_its_roll_puts_it(roll):
    flat = {"terrain": {"rms_slope_deg": 0.0}, "rig": {"height_m": 0.1, "baseline_m": 0.5, "pitch_deg": 0.0}}
    said = scene_checks.find_reasons(complete(flat, {"rig": {"roll_deg": roll}}))
    if roll < 0:  # anticlockwise
        assert not said
    else:
        assert f"right eye {0.5 * np.sin(np.radians(20.0)) - 0.1:.3g} m under the ground" in said[0]


def test_a_camera_of_a_stated_height_is_held_against_the_ground_beneath():
    settings = complete({"rig": {"x_m": 3.0, "y_m": 2.0, "height_m": 1.0, "height_from": "ZERO"}})
    ground = float(make_terrain(settings, int(settings["dataset"]["seed"])).heights(3.0, 2.0))
    assert not scene_checks.find_reasons(complete(settings, {"rig": {"z_m": ground + 1.0}}))
    (said,) = scene_checks.find_reasons(complete(settings, {"rig": {"z_m": ground - 0.5}}))
    assert is_sentence(said)
    assert "left eye 0.5 m under the ground; raise rig.z_m" in said


def test_rocks_of_which_none_fits_are_refused():
    """Of 25 m² 30 % are under rocks of 1963 m²: 0.004 rocks."""
    none = complete({"terrain": {"size_m": 5.0}, "rocks": {"coverage": 0.3, "smallest_m": 50.0, "largest_m": 50.0}})
    (said,) = scene_checks.find_reasons(none)
    assert is_sentence(said)
    assert "0.0038 rocks" in said
    # As many as there are then: those that the build draws.
    some = complete(none, {"rocks": {"smallest_m": 2.0, "largest_m": 2.0}, "terrain": {"rms_slope_deg": 0.0}})
    assert not scene_checks.find_reasons(some)
    rocks = make_rocky_ground(some).rocks
    assert rocks is not None
    assert len(rocks.diameter_m) == round(0.3 * 25 / np.pi)


@pytest.mark.parametrize(("key", "value", "off"), [("at_rest", True, False), ("low_ground_m", 1.0, 0.0)])
def test_rocks_at_rest_or_on_low_ground_would_leave_their_skirts(key, value, off):
    both = complete({"rocks": {"coverage": 0.1, key: value, "skirt": 0.2}})
    (said,) = scene_checks.find_reasons_in_settings(both)
    assert is_sentence(said)
    assert said.names == (f"rocks.{key}", "rocks.skirt")
    for name, changed in ((key, off), ("skirt", 0.0), ("coverage", 0.0)):
        assert not scene_checks.find_reasons_in_settings(complete(both, {"rocks": {name: changed}}))


def returned(parameters, incidence_deg):
    """Share of a beam's light that a surface returns, by even directions of the hemisphere, without our quadrature."""
    random = np.random.default_rng(1)
    i, cosines = np.radians(incidence_deg), random.random(100_000)
    r = bidirectional_reflectance(i, np.arccos(cosines), random.uniform(0, np.pi, cosines.size), parameters)
    return 2 * np.pi * float((r * cosines).mean()) / np.cos(i)


@pytest.mark.parametrize(
    "hapke",
    [
        {"w": 1.0, "b_s0": 3.0, "h_s": 10.0, "b_c0": 1.0, "h_c": 10.0, "filling_factor": 0.75, "h_function": "2002"},
        {"w": 1.0, "b": 0.9, "c": 1.0, "theta_bar_deg": 0.0},
        {"filling_factor": 0.75},
    ],
)
def test_ice_that_makes_light_is_refused_up_to_the_w_that_is_advised(hapke):
    settings = complete({"surface": {"model": "HAPKE"}, "hapke": hapke})
    (said,) = scene_checks.find_reasons(settings)
    assert is_sentence(said)
    parameters = hapke_from_settings(settings["hapke"])
    share, incidence_deg = scene_checks.find_returned_share(parameters)
    assert f"{share:.3g} times" in said
    # 100 000 directions, of which few hold the peak: 2 %.
    assert returned(parameters, incidence_deg) == pytest.approx(share, rel=0.02)
    advised = float(said.split("lower hapke.w to ")[1].split()[0].rstrip("."))
    most = 1.045 if parameters.h_function == "1981" else 1.01
    for w, admitted in ((advised, True), (advised + 0.01, False)):
        assert (scene_checks.find_returned_share(replace(parameters, w=min(w, 1.0)))[0] <= most) == admitted
    assert not scene_checks.find_reasons(complete(settings, {"hapke": {"w": advised}}))
    assert not scene_checks.find_reasons(
        complete(settings, {"surface": {"model": "LAMBERT"}})
    )  # which has no such parameters


@pytest.mark.parametrize(
    "parameters",
    [
        # Isotropic grains that lose nothing: what is over 1 is the H function's.
        *(HapkeParameters(1.0, h_function=name) for name in ("1981", "1993", "2002")),
        # Of Enceladus, Verbiscer and Veverka 1994; calibrated to an albedo and a Bond albedo that were measured.
        HapkeParameters(0.998, 0.39, 1.0, 0.21, 0.014, theta_bar=np.radians(6), h_function="1981"),
        HapkeParameters(0.97943, 0.39, 1.0, 1.256, 0.014, theta_bar=np.radians(6)),
    ],
)
def test_parameters_that_were_published_are_admitted(parameters):
    assert scene_checks.find_returned_share(parameters)[0] <= (1.045 if parameters.h_function == "1981" else 1.01)


def test_an_image_that_smooths_the_ice_counts():
    bright = {
        "surface": {"model": "HAPKE"},
        "hapke": {"w": 1.0, "b": 0.3, "c": 1.0, "theta_bar_deg": 25.0, "h_function": "2002"},
    }
    smoothing = complete(bright, {"hapke": {"theta_bar_range_deg": 50.0}})
    assert not scene_checks.find_reasons(complete(bright))
    assert not scene_checks.find_reasons(smoothing)  # without an image
    assert scene_checks.find_reasons(complete(smoothing, {"textures": {"set": "FROST"}}))


@pytest.mark.parametrize(
    ("date", "admitted"),
    [
        ("1999-12-31T23:59:59", False),
        ("2000-01-01T00:00:00", True),
        ("2060-12-31T23:59:59", True),
        ("2061-01-01T00:00:01", False),
        ("9999-01-01", False),
    ],
)
def test_a_date_of_years_that_are_not_known_is_refused(date, admitted):
    at = complete({"light": {"directions_from": "DATE", "date_utc": date}})
    said = scene_checks.find_reasons(at)
    assert bool(said) != admitted
    assert all(is_sentence(each) and date in each and "2060" in each for each in said)
    assert not scene_checks.find_reasons(complete(at, {"light": {"directions_from": "ANGLES"}}))


def test_all_reasons_are_said_at_once():
    with pytest.raises(IcyMoonError) as caught:
        scene_checks.refuse_scene(
            complete(
                UNDERGROUND,
                {
                    "light": {"directions_from": "DATE", "date_utc": "1850-01-01"},
                    "rock_surface": {"model": "HAPKE"},
                    "hapke": {"w": 1.0, "filling_factor": 0.7},
                    "rocks": {"own_surface": True, "coverage": 0.01, "smallest_m": 90.0, "largest_m": 90.0},
                },
            )
        )
    for name in ("light.date_utc", "hapke.w", "rocks.coverage", "rig.height_m"):
        assert name in str(caught.value)


def test_what_may_be_meant_is_told_and_not_refused():
    up = complete({"rig": {"pitch_deg": -60.0}})
    assert not scene_checks.find_reasons(up)
    assert "above the horizon" in scene_checks.advise_on_scene(up)[0]
    wide = complete({"mesh": {"kind": "GRID"}, "terrain": {"resolution": 2, "size_m": 2000.0, "rms_slope_deg": 0.0}})
    assert "2e+03 m wide" in scene_checks.advise_on_scene(wide)[0]
    assert not scene_checks.find_reasons(wide)
    assert not scene_checks.advise_on_scene(complete())


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        (
            {"width_px": 320, "principal_x_px": 200.0},
            "outside of the image: rig.principal_x_px puts it 200 px to the right, and rig.width_px is 320.",
        ),
        (
            {"width_px": 320, "principal_x_px": -81.0},
            "far from the middle of the image: rig.principal_x_px puts it 81 px to the left, and",
        ),
        (
            {"height_px": 240, "principal_y_px": 121.0},
            "outside of the image: rig.principal_y_px puts it 121 px down, and rig.height_px is 240.",
        ),
        ({"width_px": 320, "principal_x_px": 80.0}, ""),
    ],
)
def test_a_principal_point_that_did_not_follow_the_size_of_the_image_is_told(rig, words):
    settings = complete({"rig": rig})
    assert not scene_checks.find_reasons(settings)
    said = [each for each in scene_checks.advise_on_scene(settings) if "principal point" in each]
    assert len(said) == bool(words)
    assert all(words in each and each.endswith("by the same factor.") for each in said)


@pytest.mark.parametrize(
    ("indirect", "samples", "model", "told"),
    [
        ("BAKED", 63, "LAMBERT", True),
        ("AUTO", 63, "LAMBERT", True),
        ("BAKED", 64, "LAMBERT", False),
        ("TRACED", 63, "LAMBERT", False),
        ("BAKED", 63, "PRINCIPLED", False),
    ],
)
def test_light_that_is_baked_with_few_samples_is_told(indirect, samples, model, told):
    """Noise that both eyes share passes for texture; where light is traced there is none."""
    few = complete({"quality": {"indirect": indirect, "bake_samples": samples}, "surface": {"model": model}})
    said = scene_checks.advise_on_scene(few)
    assert [("only 63 samples" in each, "raise quality.bake_samples to 64" in each) for each in said] == (
        [(True, True)] if told else []
    )


@pytest.mark.parametrize("name", render_scenes.DEMO)
def test_the_scenes_of_the_demo_need_no_advice(name):
    changes = (dict(render_scenes.DEMO_ALIKE), dict(render_scenes.DEMO[name]))
    assert not scene_checks.advise_on_scene(complete(preset_files.load_preset(name), *changes))


@pytest.mark.ci_takes(8)
@pytest.mark.parametrize("name", preset_files.preset_names())
def test_every_shipped_preset_is_admitted(name):
    settings = complete(preset_files.load_preset(name))
    assert not scene_checks.find_reasons(settings)
    # What any trench states of its walls and rocks asks for no change.
    stated = ("Walls up to ", "Rocks in the trench are not taken away")
    assert [said for said in scene_checks.advise_on_scene(settings) if not said.startswith(stated)] == []


PLAN = """[plan]
title = "Around a slope"
[terrain]
rms_slope_deg = 25
[rig]
height_m = 0.1
baseline_m = 0.3
[[sweep]]
kind = "panorama"
headings = 6
"""


BAKED_PLAN = """[plan]
title = "Baked"
[surface]
model = "LAMBERT"
[quality]
indirect = "BAKED"
[[sweep]]
kind = "grid"
quality.bake_samples = [16, 32, 64]
"""


@pytest.mark.long
def test_a_dry_run_counts_the_pairs_with_bakes_of_few_samples(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(BAKED_PLAN)
    done = subprocess.run(
        [sys.executable, str(ROOT / "__main__.py"), "plan", str(file), "--dry-run"],
        text=True,
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert "In 2 of 3 pairs: Indirect light is baked with only 16 samples." in done.stdout, done.stderr


@pytest.mark.long
def test_a_plan_sets_aside_what_is_refused_and_keeps_the_others(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(PLAN)
    plan = read_plan(file)
    pairs, refused = {pair.id: pair for pair in plan.pairs()}, plan.refused()
    assert len(pairs) == 6
    assert 0 < len(refused) < 6
    for name, pair in pairs.items():  # the same as one that renders says of it, with the line
        assert refused.get(name, "").removeprefix(f"{file}, line 8: ") == " ".join(
            scene_checks.find_reasons(pair.settings)
        )
    for options in ([], ["--dry-run"]):
        done = subprocess.run(
            [sys.executable, str(ROOT / "__main__.py"), "plan", str(file), *options],
            text=True,
            capture_output=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 1
        assert next(iter(refused.values())) in done.stdout + done.stderr
        assert "Traceback" not in done.stderr
    file.write_text(PLAN.replace("headings = 6", "headings = [0]"))
    with pytest.raises(IcyMoonError, match=r"line 8: .*right eye"):
        read_plan(file).pairs()


def test_a_joint_beyond_its_limits_and_an_eye_in_the_arm_are_refused_only_with_a_lander():
    there = {"lander": {"kind": "PARAMETRIC"}}
    fault = {"arm": {"elbow_deg": 160.0, "elbow_offset_deg": 10.0}}
    assert not list(scene_checks.find_lander_reasons(complete(fault)))
    (reason,) = scene_checks.find_lander_reasons(complete(there, fault))
    assert is_sentence(reason)
    assert "the joint elbow at 170°" in reason
    assert "arm.elbow_offset_deg" in reason.names
    upright = {
        "arm": {"shoulder_deg": 90.0, "elbow_deg": 0.0, "wrist_deg": 0.0, "yaw_deg": 0.0, "shoulder_y_m": 0.1},
        "rig": {"height_m": 1.3, "baseline_m": 0.2},
    }
    assert not list(scene_checks.find_lander_reasons(complete(there, upright)))
    # The shoulder's axis is 0.1 m ahead of the yaw axis: it is now under the left eye.
    found = list(
        scene_checks.find_lander_reasons(complete(there, upright, {"arm": {**upright["arm"], "shoulder_x_m": -0.1}}))
    )
    assert [text.split(" is ")[0] for text in found] == ["The left eye"]


@pytest.mark.parametrize("topic", ["surface", "rock_surface"])
def test_a_node_group_needs_the_file_that_has_it(topic):
    settings = complete({topic: {"albedo_group": "Soot"}})
    said = scene_checks.find_reasons_without_file(settings)
    assert bool(said) == (topic == "surface")  # rocks have the surface of the ground
    said = scene_checks.find_reasons_without_file(complete(settings, {"rocks": {"own_surface": True}}))
    assert is_sentence(said[0])
    assert f"{topic}.albedo_group names a node group" in said[0]

"""The qualities that are offered, with what they cost here and what error they leave."""

from __future__ import annotations

import math
from typing import Any

import pytest
from icymoon.render.cost.blender_abilities import Abilities
from icymoon.render.cost.estimate import estimate_prior_spread, estimate_work
from icymoon.render.cost.machine_speed import to_wall_seconds
from icymoon.render.cost.quality_presets import (
    QualityPreset,
    estimate_pair_seconds,
    estimate_render_seconds,
    list_qualities,
)
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import find_preset, load_preset, preset_names, read_preset_header
from icymoon.settings.toml_text import read_toml
from stand_ins import stand_in

ERRORS = {"sgbm_px": 0.0314, "radiance_rms": 0.4567}


def test_a_cost_is_a_range_that_holds_19_of_20():
    assert QualityPreset("", "Mine", 12.0, 1.5, {}).cost == "12 s (8 s to 18 s)"
    assert QualityPreset("", "Mine", 12.0, 1.5, {}, "It cannot.").cost == "It cannot."


def test_an_error_is_in_pixels_and_per_cent_or_not_there():
    assert QualityPreset("", "Mine", 1.0, 1.0, ERRORS).error == "SGBM +0.031 px, radiance 45.7 %"
    assert QualityPreset("", "Mine", 1.0, 1.0, {}).error == ""
    preset: Any = QualityPreset("", "Mine", 1.0, 1.0, {})
    with pytest.raises(AttributeError):
        preset.seconds = 2.0  # the window keeps it from one redraw to the next


@pytest.mark.parametrize("device", ["CPU", "GPU"])
def test_the_seconds_are_off_by_two_deviations_at_most(device, monkeypatch):
    monkeypatch.setattr("icymoon.render.cost.machine_speed.count_processors", lambda: 4)
    settings = merged(defaults(), {"quality": {"device": device}})
    seconds, factor = estimate_pair_seconds(settings, 1e6, None)
    assert seconds == pytest.approx(to_wall_seconds(estimate_work(settings).seconds(1e6), None))
    assert math.log(factor) == pytest.approx(2 * estimate_prior_spread(None, device == "GPU"))
    twice_as_slow = stand_in(factor=2.0, busy=1.0)
    assert estimate_pair_seconds(settings, 1e6, twice_as_slow)[0] == pytest.approx(
        2 * estimate_work(settings).seconds(1e6) / 4
    )


def test_all_presets_are_listed_cheapest_first_and_the_scene_s_own_last():
    settings = merged(defaults(), {"quality": {"samples": 1}})
    *shipped, own = list_qualities(settings, 1e6, None)
    assert {quality.name for quality in shipped} == set(preset_names("qualities"))
    assert [quality.seconds for quality in shipped] == sorted(quality.seconds for quality in shipped)
    assert (own.name, own.title, own.errors, own.lacks) == ("", "As described", {}, "")
    assert (own.seconds, own.factor) == estimate_pair_seconds(settings, 1e6, None)
    for quality in shipped:
        whole = merged(settings, load_preset(quality.name))
        assert quality.title == read_preset_header(quality.name)[0]
        assert (quality.seconds, quality.factor) == estimate_pair_seconds(whole, 1e6, None)


def test_the_quality_that_the_scene_has_is_chosen_and_no_other():
    for name in preset_names("qualities"):
        listed = list_qualities(merged(defaults(), {"terrain": {"size_m": 7.0}}, load_preset(name)), 1e6, None)
        assert [quality.name for quality in listed if quality.chosen] == [name]
    listed = list_qualities(merged(defaults(), {"quality": {"samples": 7}}), 1e6, None)
    assert [quality.title for quality in listed if quality.chosen] == ["As described"]


def test_a_button_has_room_for_the_seconds_and_the_error_only():
    assert QualityPreset("", "Mine", 12.0, 1.5, ERRORS).brief == "12 s, +0.03 px"
    assert QualityPreset("", "Mine", 12.0, 1.5, {}).brief == "12 s"
    assert QualityPreset("", "Mine", 12.0, 1.5, ERRORS, "It cannot.").brief == ""


def test_what_a_blender_lacks_is_shown_with_each_quality_that_asks_for_it():
    plain = Abilities(osl=False, denoiser=False, gpu=False)
    denoised = merged(defaults(), {"quality": {"denoiser": "OIDN"}})
    *shipped, own = list_qualities(denoised, 1e6, None, plain)
    assert "OpenImageDenoise" in own.lacks
    for quality in shipped:
        asks = merged(denoised, load_preset(quality.name)).quality.denoiser != "NONE"
        assert bool(quality.lacks) == asks
    assert not any(quality.lacks for quality in list_qualities(denoised, 1e6, None))


LAMBERT: dict[str, dict[str, Any]] = {
    "surface": {"model": "LAMBERT"},
    "mesh": {"kind": "GRID"},
    "terrain": {"resolution": 257},
    "light": {"planet": False},
}


@pytest.mark.parametrize("name", ["few_headings", "many_headings", "training"])
def test_a_recipe_bakes_so_many_samples_that_their_noise_is_no_texture(name):
    """Bakes of 16 samples are easier to match than a converged render (docs/howto/speed.md); 64 are the fewest that are
    not. A denoiser makes noise alike in both eyes."""
    quality = load_preset(f"qualities/{name}").quality
    assert (quality.indirect, quality.denoiser) == ("AUTO", "NONE")
    assert quality.bake_samples >= 64
    assert quality.bake_noise == 0  # else fewer samples are taken where most light is direct
    assert (quality.bake_area == "GROUND") == (name == "many_headings")


def test_what_a_pair_bakes_for_itself_is_part_of_its_seconds_and_what_all_share_is_not():
    def seconds(name: str, *changes: dict[str, Any]) -> float:
        made = merged(defaults(), LAMBERT, load_preset(f"qualities/{name}"), {"dataset": {"headings": 36}}, *changes)
        return estimate_pair_seconds(made, 1e5, None)[0]

    longer = {"quality": {"bake_samples": 1024}}
    baked = {"quality": {"indirect": "BAKED"}}
    assert seconds("few_headings", longer, baked) > 3 * seconds("few_headings", baked)
    assert seconds("many_headings", longer, baked) == pytest.approx(seconds("many_headings", baked))
    # Ground that cannot be baked is traced, with many samples.
    traced: dict[str, Any] = {"surface": {"model": "PRINCIPLED"}}
    assert seconds("many_headings", traced) > 3 * seconds("many_headings")


def test_a_render_takes_the_time_of_its_pairs_and_of_the_build_and_of_light_that_they_share():
    def seconds(headings: int, speed: Any = None, **quality: Any) -> float:
        parts = {"quality": quality, "dataset": {"headings": headings}}
        made = merged(defaults(), LAMBERT, load_preset("qualities/many_headings"), parts)
        return estimate_render_seconds(made, speed)[0]

    slow = stand_in(factor=3.0, busy=1.0)
    fast = stand_in(factor=1.0, busy=1.0)
    for indirect in ("TRACED", "BAKED"):
        first, second, third = (seconds(n, indirect=indirect) for n in (1, 2, 3))
        assert 0 < second - first == pytest.approx(third - second)
        assert first > second - first  # the process starts and builds once
        assert seconds(1, slow, indirect=indirect) == pytest.approx(3 * seconds(1, fast, indirect=indirect))
    more = [seconds(n, indirect="BAKED", bake_samples=1024) - seconds(n, indirect="BAKED") for n in (1, 2)]
    assert more[0] > 0
    assert more[1] == pytest.approx(more[0])  # baked once for all headings
    own = [
        seconds(n, indirect="BAKED", bake_area="VIEW", bake_samples=1024)
        - seconds(n, indirect="BAKED", bake_area="VIEW")
        for n in (1, 2)
    ]
    assert own[1] == pytest.approx(2 * own[0])


def test_a_render_is_as_uncertain_as_a_pair():
    assert estimate_render_seconds(defaults(), None)[1] == estimate_pair_seconds(defaults(), 1e6, None)[1] > 1


@pytest.mark.parametrize("name", preset_names("qualities"))
def test_each_quality_states_its_cost_and_its_distance_from_a_converged_render(name):
    measured = read_toml(find_preset(name))["measured"]
    assert measured["command"] == "python benchmarks qualities --scale 0.25 --reference-samples 1024 --write"
    assert measured["cpu_s"] > 0
    assert (measured["bake_cpu_s"] > 0) == (load_preset(name).quality.indirect == "AUTO")
    suns = [found for key, found in measured.items() if key.startswith("sun_")]
    assert len(suns) == 2
    for found in suns:
        assert found.keys() == {
            f"{matcher}_{key}" for matcher in ("bm", "sgbm", "jplv") for key in ("bad_1", "coverage")
        }
        assert all(abs(value) < 1 for value in found.values())

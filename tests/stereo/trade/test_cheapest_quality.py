"""The search for the cheapest quality, with renders and measurements that are made up."""

import pytest
from icymoon.render.cost.blender_abilities import Abilities
from icymoon.render.cost.error_tolerance import make_tolerance
from icymoon.render.cost.estimate import estimate_work
from icymoon.settings import description, preset_files
from icymoon.stereo.trade import cheapest_quality as search
from icymoon.stereo.trade import quality_losses as measuring
from icymoon.stereo.trade.measure_variants import TradeBench
from icymoon.support.errors import IcyMoonError


class Truth:
    def __init__(self, own=0.0):
        self.own = {"sgbm": {"epe_px": own, "wrong_or_missing": own}}


def searched(tmp_path, monkeypatch, allowed, loss, doubt=0.001, own=0.0, bias=0.0, overrides=()):
    """What is found where a matcher loses ``loss(settings)`` px, known to within ``doubt`` over the root of the number
    of renders; and how often each was rendered."""
    settings = description.merged(description.defaults(), *map(description.override, overrides))
    rendered = []
    by_folder = {}

    def render(variant, repeat, bench, counter):
        folder = tmp_path / f"{variant.name} {repeat}"
        rendered.append(variant.name)
        by_folder[folder] = variant.settings
        counter.done += 1
        return [folder]

    def measure(folders, reference, methods, images):
        own_settings = by_folder[folders[0]]
        value = loss(own_settings)
        numbers = {"coverage": 0.0, "epe_px": value, "bad_1": value / 10, "wrong_or_missing": value / 10}
        width = doubt / len(folders) ** 0.5
        cost = estimate_work(own_settings).seconds(0.0)
        return {
            "cpu_s": cost,
            "wall_s": cost,
            "bias": bias,
            "loss": {"sgbm": numbers},
            "loss_doubt": {"sgbm": dict.fromkeys(numbers, width)},
        }

    monkeypatch.setattr(search, "render_once", render)
    monkeypatch.setattr(search, "render_all", lambda *given: [])
    monkeypatch.setattr(search, "check_abilities", lambda *given: Abilities())
    monkeypatch.setattr(measuring, "read_reference", lambda *given: Truth(own))
    monkeypatch.setattr(measuring, "measure_variant", measure)
    found = search.find_cheapest_quality(TradeBench(settings, tmp_path, "", "sgbm", 64, 1), allowed)
    return found, rendered


def by_samples(settings):
    return 0.5 / settings["quality"]["samples"] * (0.5 if settings["quality"]["denoiser"] == "OIDN" else 1.0)


BARE = ("surface.grain_amplitude_m=0",)


def test_the_search_stops_at_the_first_that_is_within_and_reports_what_it_tried(tmp_path, monkeypatch):
    found, rendered = searched(tmp_path, monkeypatch, make_tolerance(0.02, None), by_samples, overrides=BARE)
    assert found["chosen"] == "16 samples, denoised"
    assert found["settings"] == {"quality": {"samples": 16, "denoiser": "OIDN", "noise_threshold": 0.0}}
    assert [step["name"] for step in found["tried"]] == rendered
    assert [step["within"] for step in found["tried"]] == [False] * (len(rendered) - 1) + [True]
    assert preset_files.load(tmp_path / "auto.toml") == found["settings"]
    assert found["said"][-1].startswith("Use 16 samples, denoised: ")
    assert len(found["said"]) == len(rendered) + 1


def test_wrong_pixels_alone_may_be_what_counts(tmp_path, monkeypatch):
    # A tenth of the pixels per px: 0.5 % of them is 0.05 px.
    found, _ = searched(tmp_path, monkeypatch, make_tolerance(None, 0.005), by_samples, overrides=BARE)
    assert found["chosen"] == "8 samples, denoised"
    assert "0.5 % bad-1" in found["said"][-1]
    assert "px" not in found["said"][0]


def test_a_candidate_in_doubt_is_rendered_again_if_that_can_decide(tmp_path, monkeypatch):
    found, rendered = searched(tmp_path, monkeypatch, make_tolerance(0.02, None), by_samples, 0.006, overrides=BARE)
    assert found["chosen"] == "16 samples, denoised"
    assert rendered.count("16 samples, denoised") == 2  # 0.0156 ± 0.006, then ± 0.0042
    hopeless, rendered = searched(tmp_path, monkeypatch, make_tolerance(0.02, None), by_samples, 0.05, overrides=BARE)
    assert hopeless["chosen"] is None
    assert max(map(rendered.count, rendered)) <= 4
    assert "larger scale" in hopeless["said"][-1]
    assert not (tmp_path / "auto.toml").exists()  # nor what the search before it found


def test_a_tolerance_that_nothing_meets_gives_the_fix(tmp_path, monkeypatch):
    def said(loss, doubt=0.001, own=0.0):
        allowed = make_tolerance(0.02, None)
        return searched(tmp_path, monkeypatch, allowed, loss, doubt, own, overrides=BARE)[0]["said"][-1]

    assert said(lambda settings: 1.0) == "No quality that was tried is within 0.02 px; allow more."
    assert "reference of 64 samples has too much noise" in said(by_samples, 0.05, 0.015)


def test_parts_of_the_light_are_left_out_if_the_error_stays_within(tmp_path, monkeypatch):
    walk = ("surface.subsurface_weight=1", "surface.subsurface_radius_m=0.05", *BARE)
    found, _ = searched(tmp_path, monkeypatch, make_tolerance(0.02, None), by_samples, overrides=walk)
    assert found["chosen"] == "16 samples, denoised, no subsurface scattering"
    assert found["settings"]["quality"]["walk_px"] == 100.0
    darker, _ = searched(tmp_path, monkeypatch, make_tolerance(0.02, None), by_samples, bias=-0.03, overrides=walk)
    assert darker["chosen"] == "16 samples, denoised"
    assert "walk_px" not in darker["settings"]["quality"]


def test_a_folder_that_cannot_be_written_is_reported(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(IcyMoonError, match="a file, not a folder"):
        searched(file, monkeypatch, make_tolerance(0.02, None), by_samples)

"""What a Blender lacks is said in one sentence before anything is promised or rendered."""

from __future__ import annotations

import json
import os

import pytest
from icymoon.commands import batch, cli
from icymoon.render.cost import blender_abilities, measure_speed
from icymoon.render.cost.blender_abilities import Abilities, describe_lack, find_missing_feature, needs_full_build
from icymoon.render.cost.estimate import estimate_work
from icymoon.render.cost.quality_presets import list_qualities
from icymoon.render.cost.quality_variants import list_candidates, list_variants
from icymoon.render.plans.triangle_count import count_triangles
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.trade import measure_variants
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the stand-in for Blender is a script of a shell")
PLAIN = Abilities(osl=False, denoiser=False, gpu=False)
DENOISED = {"quality": {"denoiser": "OIDN"}}
OSL = {"surface": {"model": "HAPKE"}, "hapke": {"backend": "OSL"}}
SENTENCE = "built without OpenImageDenoise, which 2 of 2 pairs need; set quality.denoiser to NONE or use"


def scene(*parts: dict) -> Settings:
    return merged(defaults(), *(check(part, "test") for part in parts))


@pytest.fixture
def blender(tmp_path):
    """A Blender as Debian builds it: neither denoiser nor OSL. It notes what it is asked, and renders nothing."""
    blender_abilities.query_abilities.cache_clear()
    program = tmp_path / "blender"
    said = json.dumps(
        {
            "type": "probe",
            "blender": "4.3.2",
            "python": "3.13",
            "osl": False,
            "denoiser": False,
            "devices": [],
            "module": False,
        }
    )
    program.write_text(f"#!/bin/sh\nfor last; do :; done\necho \"$last\" >> '{tmp_path}/asked'\necho '{said}'\n")
    program.chmod(0o755)
    yield program
    blender_abilities.query_abilities.cache_clear()


def asked(blender):
    file = blender.parent / "asked"
    return file.read_text().split() if file.exists() else []


@pytest.fixture
def plan(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(
        '[plan]\ntitle = "Two"\n[quality]\ndenoiser = "OIDN"\n[[sweep]]\nkind = "grid"\n'
        "light.sun_elevation_deg = [20, 40]\n"
    )
    return file


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({}, ""),
        (DENOISED, "OpenImageDenoise"),
        ({"quality": {"denoiser": "OIDN_COLOUR"}}, "OpenImageDenoise"),
        ({"quality": {"device": "GPU"}}, "graphics card"),
        (OSL, "Open Shading Language"),
        ({"surface": {"model": "SNOW"}, "hapke": {"backend": "OSL"}}, "Open Shading Language"),
        ({"hapke": {"backend": "OSL"}}, ""),
        ({"surface": {"model": "HAPKE"}}, ""),
    ],
)
def test_only_what_the_settings_ask_for_is_lacking(part, said):
    found = describe_lack(scene(part), PLAIN)
    assert said in found
    assert bool(said) == bool(found) == needs_full_build(scene(part))
    assert describe_lack(scene(part), Abilities()) == ""
    assert not found or found.count(".") == 1 + found.count("quality.") + found.count("hapke.")  # one sentence


def test_a_blender_is_asked_once_and_only_for_what_not_every_one_has(blender):
    assert find_missing_feature([scene()] * 3, str(blender)) == ""
    assert asked(blender) == []
    assert "which 2 of 3 pairs need; set" in find_missing_feature(
        [scene(DENOISED), scene(), scene(DENOISED)], str(blender)
    )
    assert find_missing_feature([scene(DENOISED)], str(blender)).startswith(
        "This Blender was built without OpenImageDenoise; "
    )
    assert asked(blender) == ["probe"]


def run(*words):
    return cli.main([str(word) for word in words])


def test_a_batch_is_refused_before_anything_is_written(blender, plan, tmp_path, capsys):
    assert run("batch", plan, "--out", tmp_path / "set", "--evaluate", "bm", "--blender", blender) == 1
    told = capsys.readouterr().err
    assert SENTENCE in " ".join(told.split())
    assert told.count("icymoon:") == 1
    assert not (tmp_path / "set").exists()
    assert asked(blender) == ["probe"]


def test_so_is_a_shard_of_one_that_another_machine_has_planned(blender, plan, tmp_path, capsys):
    batch._freeze_plan(str(plan), tmp_path / "set")
    assert run("work", tmp_path / "set", "--blender", blender) == 1
    assert SENTENCE in " ".join(capsys.readouterr().err.split())
    assert asked(blender) == ["probe"]


def test_a_dry_run_says_it_first(blender, plan, capsys):
    assert run("plan", plan, "--dry-run", "--blender", blender) == 0
    assert SENTENCE in capsys.readouterr().out.splitlines()[1]
    assert run("plan", plan, "--dry-run", "--json", "--blender", blender) == 0
    assert SENTENCE in json.loads(capsys.readouterr().out)["lines"][0]


def test_the_gallery_is_refused_before_its_first_scene(blender, tmp_path, capsys):
    assert run("gallery", "--out", tmp_path / "out", "--blender", blender) == 1
    assert "pairs need; set quality.denoiser" in " ".join(capsys.readouterr().err.split())
    assert asked(blender) == ["probe"]


def test_a_search_and_a_trade_leave_out_what_is_denoised(blender, tmp_path):
    for found in (list_candidates(scene(), PLAIN), list_variants(scene(), ["samples"], PLAIN)):
        assert len(found) > 5
        assert {variant.settings.quality.denoiser for variant in found} == {"NONE"}
    assert {variant.settings.quality.denoiser for variant in list_candidates(scene())} == {"NONE", "OIDN"}
    told = []
    bench = measure_variants.TradeBench(scene(), tmp_path, str(blender), "bm", 2, 1, told.append)
    assert measure_variants.check_abilities(bench, bench.settings) == PLAIN
    assert [event["type"] for event in told] == ["warning"]
    assert "left out, as this Blender was built without OpenImageDenoise" in told[0]["message"]
    with pytest.raises(IcyMoonError, match=r"set quality\.denoiser to NONE"):
        measure_variants.check_abilities(bench, scene(DENOISED))


def test_a_quality_that_cannot_be_had_shows_why_in_place_of_its_cost():
    shown = {quality.name: quality.cost for quality in list_qualities(scene(), 1e6, None, PLAIN)}
    assert "OpenImageDenoise" in shown["qualities/draft"]
    assert "OpenImageDenoise" not in shown["qualities/standard"]
    assert all("OpenImageDenoise" not in quality.cost for quality in list_qualities(scene(), 1e6, None))


def test_a_machine_is_measured_without_the_denoiser_that_it_lacks(tmp_path):
    settings = measure_speed.make_small_render("CPU", denoiser=False)
    assert settings.quality.denoiser == "NONE"
    folders = [tmp_path / str(k) for k in range(2)]
    expected = estimate_work(settings).seconds(count_triangles(settings))
    for folder in folders:
        folder.mkdir()
        (folder / "pair.json").write_text(
            json.dumps(
                {
                    "seconds": {"render": 3.0 * expected, "write": 0.0},
                    "cpu_seconds": {"pair": 1.5 * expected},
                    "versions": {"blender": "4.3.2"},
                }
            )
        )
    assert measure_speed.read_speed(folders, "CPU", denoiser=False).factor == pytest.approx(1.5)


def test_a_blender_that_cannot_be_asked_is_told_of(tmp_path):
    with pytest.raises(IcyMoonError, match="check its path"):
        find_missing_feature([scene(DENOISED)], str(tmp_path / "none"))

"""How fast a machine is: measured, remembered, and used where seconds are estimated."""

from __future__ import annotations

import json
from datetime import datetime

import pytest
from icymoon.commands import cli
from icymoon.render.cost import estimate, measure_speed
from icymoon.render.cost import machine_speed as machine
from icymoon.render.cost.quality_presets import estimate_pair_seconds, list_qualities
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.plans.triangle_count import count_triangles
from icymoon.settings import description
from icymoon.support import cache_folder as folders
from icymoon.support import system
from icymoon.support.errors import IcyMoonError
from stand_ins import stand_in
from stated_pairs import PAIRS, whole


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv(folders.FOLDER_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def speed(factor=2.0, device="CPU", blender="5.0.1", processors=None, measured="2030-01-01T00:00+00:00", busy=0.8):
    return machine.Speed(factor, device, blender, processors or system.count_processors(), measured, busy)


def test_nothing_is_remembered_before_it_is_measured():
    assert machine.recall_speed("CPU") is None


def test_each_device_and_blender_has_a_speed_of_its_own():
    newer = speed(5.0, blender="5.2.0", measured="2031-01-01T00:00+00:00")
    for each in (speed(), newer, speed(0.1, "GPU")):
        machine.remember_speed(each)
    assert machine.recall_speed("CPU", "5.0.1") == speed()
    assert machine.recall_speed("CPU", "4.2.0") is None
    assert machine.recall_speed("CPU") == newer
    assert machine.recall_speed("GPU").factor == 0.1
    machine.remember_speed(speed(3.0))
    assert machine.recall_speed("CPU", "5.0.1").factor == 3.0


def test_another_number_of_processors_is_another_machine():
    machine.remember_speed(speed(processors=system.count_processors() + 1))
    assert machine.recall_speed("CPU") is None


def test_what_was_kept_without_the_processors_at_work_is_measured_again(cache):
    machine.remember_speed(speed())
    file = cache / "speed.json"
    kept = {
        key: {name: value for name, value in entry.items() if name != "busy"}
        for key, entry in json.loads(file.read_text()).items()
    }
    file.write_text(json.dumps(kept))
    assert machine.recall_speed("CPU") is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"a": 1}', '{"a": {"factor": 1}}'])
def test_a_broken_file_is_as_good_as_none(cache, text):
    cache.mkdir()
    (cache / "speed.json").write_text(text)
    assert machine.recall_speed("CPU") is None
    machine.remember_speed(speed())
    assert machine.recall_speed("CPU") == speed()


def rendered(folder, seconds, cpu_s):
    pairs = []
    for k, (each, spent) in enumerate(zip(seconds, cpu_s, strict=True)):
        pairs.append(folder / str(k))
        pairs[-1].mkdir()
        (pairs[-1] / "pair.json").write_text(
            json.dumps(
                {
                    "seconds": {"render": each - 0.25, "write": 0.25, "build": 9.0},
                    "cpu_seconds": {"before": 9.0, "pair": spent},
                    "versions": {"blender": "5.0.1"},
                }
            )
        )
    return pairs


def expected_of_the_probe():
    settings = measure_speed.make_small_render("CPU")
    return estimate.estimate_work(settings).seconds(count_triangles(settings))


def test_the_fastest_pair_but_the_first_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(measure_speed, "count_processors", lambda: 4)
    found = measure_speed.read_speed(rendered(tmp_path, (1.0, 4.0, 3.0), (1.0, 11.0, 9.0)), "CPU")
    assert found.factor == pytest.approx(9.0 / expected_of_the_probe())
    assert found.busy == pytest.approx(9.0 / (4 * 3.0))  # of four processors
    assert found.blender == "5.0.1"


def test_other_work_changes_the_clock_and_not_the_processor_seconds(tmp_path):
    slowed = measure_speed.read_speed(rendered(tmp_path, (900.0, 800.0), (3.0, 3.0)), "CPU")
    assert slowed.factor == pytest.approx(3.0 / expected_of_the_probe())
    assert slowed.busy == 0.5
    card = measure_speed.read_speed([tmp_path / "0", tmp_path / "1"], "GPU")
    # A card's own work is no processor's, so the clock counts.
    assert card.factor == pytest.approx(system.count_processors() * 800.0 / expected_of_the_probe())
    assert card.busy == 1.0


def at(text):
    """A clock that stands still."""
    return stand_in(now=lambda zone: datetime.fromisoformat(text))


def test_a_rendered_pair_shows_what_others_will_take(tmp_path, monkeypatch):
    for module in (measure_speed, machine):
        monkeypatch.setattr(module, "count_processors", lambda: 4)
    monkeypatch.setattr(measure_speed, "datetime", at("2038-06-01T12:34:56+00:00"))
    settings = description.merged(PAIRS[0].settings, {"quality": {"threads": 0}})
    folder = whole(
        tmp_path / "pair",
        settings=settings,
        seconds={"render": 9.5, "write": 0.5, "build": 3.0},
        cpu_seconds={"before": 7.0, "pair": 32.0},
    )
    found = measure_speed.read_speed_of_pair(folder)
    assert found is not None
    machine.remember_speed(found)
    assert machine.recall_speed("CPU", "5.0.1") == found
    assert found.basis == "this machine, Blender 5.0.1, measured 2038-06-01 by a pair of 32 x 24 pixels with 2 samples"

    def seconds(**changes):
        wanted = description.merged(settings, changes)
        return estimate_pair_seconds(wanted, estimate.ASSUMED_TRIANGLES, found)[0]

    assert seconds() == pytest.approx(10.0)  # as the clock said
    big = {"width_px": 640, "height_px": 480}
    one = seconds(rig=big, quality={"samples": 4096})
    # In a pair of billions of samples, all but the samples of the pixels is less than a thousandth.
    assert seconds(rig=big, quality={"samples": 8192}) == pytest.approx(2 * one, rel=1e-2)
    assert seconds(rig={"width_px": 1280, "height_px": 480}, quality={"samples": 4096}) == pytest.approx(
        2 * one, rel=1e-2
    )


@pytest.mark.parametrize(
    ("quality", "more"),
    [
        ({}, {"cpu_seconds": {"before": 1.0, "pair": 3.9}}),  # too short
        ({}, {"edited_by_hand": True}),
        ({"threads": 3}, {}),
        ({"device": "GPU"}, {"device": "GPU"}),
        ({"indirect": "BAKED"}, {"indirect": {"method": "TRACED"}}),
    ],
)
def test_a_pair_whose_time_shows_little_changes_no_estimate(tmp_path, monkeypatch, quality, more):
    monkeypatch.setattr(measure_speed, "count_processors", lambda: 4)
    settings = description.merged(PAIRS[0].settings, {"quality": {"threads": 0}})
    long = {"settings": settings, "cpu_seconds": {"before": 1.0, "pair": 32.0}}
    assert measure_speed.read_speed_of_pair(whole(tmp_path / "whole", **long)) is not None
    settings = description.merged(settings, {"quality": quality})
    folder = whole(tmp_path / "other", **{**long, **more, "settings": settings})
    assert measure_speed.read_speed_of_pair(folder) is None


def test_a_speed_of_an_earlier_version_is_of_a_small_render(cache):
    machine.remember_speed(speed())
    file = machine._speed_file()
    stored = json.loads(file.read_text())
    for entry in stored.values():
        del entry["by"]
    file.write_text(json.dumps(stored))
    assert machine.recall_speed("CPU") == speed()
    assert speed().basis.endswith("measured 2030-01-01 by a small render")


@pytest.mark.parametrize("busy", [0.5, 1.0])
def test_a_processor_that_idles_makes_the_clock_go_on(busy, monkeypatch):
    monkeypatch.setattr(machine, "count_processors", lambda: 4)
    assert machine.to_wall_seconds(12.0, speed(busy=busy)) == pytest.approx(3.0 / busy)
    assert 3.0 < machine.to_wall_seconds(12.0, None) < 6.0


def test_a_probe_that_says_nothing_is_an_error(tmp_path):
    with pytest.raises(IcyMoonError, match="small render"):
        measure_speed.read_speed([tmp_path, tmp_path], "CPU")


def test_the_probe_is_small_and_has_all_that_a_pair_has():
    settings = measure_speed.make_small_render("GPU")
    assert 1.0 < estimate.estimate_work(settings).seconds(count_triangles(settings)) < 6.0
    assert (settings.quality.device, settings.quality.denoiser) == ("GPU", "OIDN")
    assert settings.dataset.headings > 1


def test_plans_take_as_much_longer_as_the_machine_is_slower():
    pairs = expand_headings(description.merged(description.defaults(), {"mesh": {"kind": "GRID"}}))
    blind, known = estimate.estimate_plan(pairs), estimate.estimate_plan(pairs, speed=speed(3.0))
    assert known.seconds == pytest.approx(3.0 * blind.seconds)
    assert known.factor < blind.factor
    assert "Blender 5.0.1" in "".join(known.lines())
    assert known.left_wall_s == pytest.approx(known.left_s / system.count_processors() / 0.8)
    assert estimate.format_duration(known.left_s) + " of a processor" in known.lines()[2]


@pytest.mark.long
def test_the_dry_run_of_a_plan_uses_what_was_measured(capsys):
    said = []
    for factor in (1.0, 4.0):
        machine.remember_speed(speed(factor))
        assert cli.main(["plan", "datasets/guiss_smoke", "--dry-run", "--json"]) == 0
        said.append(json.loads(capsys.readouterr().out.splitlines()[-1])["seconds"])
    assert said[1] == pytest.approx(4 * said[0])


def test_a_better_quality_costs_more_and_errs_less():
    listed = list_qualities(description.defaults(), 1e6, speed())
    assert listed[-1].title == "As described"
    assert [quality.seconds for quality in listed[:-1]] == sorted(quality.seconds for quality in listed[:-1])
    ours = [next(q for q in listed if q.name == f"qualities/{name}") for name in ("draft", "standard", "reference")]
    for key in ("sgbm_px", "radiance_rms"):
        errors = [quality.errors[key] for quality in ours]
        assert errors == sorted(errors, reverse=True)
    assert all(quality.error.startswith("SGBM") for quality in ours)


def test_the_seconds_are_of_all_processors_and_of_this_machine():
    settings = description.defaults()
    work = estimate.estimate_work(settings).seconds(1e6)
    assert estimate_pair_seconds(settings, 1e6, speed(2.0))[0] == pytest.approx(
        2.0 * work / system.count_processors() / 0.8
    )
    assert estimate_pair_seconds(settings, 1e6, None)[0] == pytest.approx(machine.to_wall_seconds(work, None))
    assert estimate_pair_seconds(settings, 1e6, speed(2.0))[1] < estimate_pair_seconds(settings, 1e6, None)[1]


def test_the_list_is_printed_from_what_is_remembered(capsys):
    machine.remember_speed(speed())
    assert cli.main(["quality", "--set", "mesh.kind=GRID", "--blender", "no-blender-is-needed"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in ("qualities/draft", "qualities/standard", "qualities/reference", "as described"))
    assert cli.main(["quality", "--set", "mesh.kind=GRID", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["speed"]["factor"] == 2.0
    assert len(found["qualities"]) >= 4


@pytest.fixture
def own(monkeypatch, tmp_path):
    """The user's own cache folder, whatever the system."""
    monkeypatch.delenv(folders.FOLDER_VARIABLE)
    monkeypatch.setattr(system, "PLATFORM", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    yield tmp_path / "own" / "icymoon"
    folders.choose_folder("")


def test_the_environment_goes_before_the_preferences_and_these_before_the_users_cache(own, tmp_path, monkeypatch):
    assert folders.own_cache_folder() == own
    folders.choose_folder(str(tmp_path / "chosen"))
    assert folders.own_cache_folder() == tmp_path / "chosen"
    monkeypatch.setenv(folders.FOLDER_VARIABLE, str(tmp_path / "named"))
    assert folders.own_cache_folder() == tmp_path / "named"
    monkeypatch.delenv(folders.FOLDER_VARIABLE)
    folders.choose_folder("")
    assert folders.own_cache_folder() == own


def test_what_is_kept_in_one_folder_is_not_known_in_another(own, tmp_path):
    folders.choose_folder(str(tmp_path / "chosen"))
    machine.remember_speed(speed())
    assert machine.recall_speed("CPU") == speed()
    folders.choose_folder("")
    assert machine.recall_speed("CPU") is None

"""What was varied: a line for each value of the second setting, what is averaged over, and scenes as presets."""

import re

import numpy as np
import pytest
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.measure.row_metrics import NUMBERS
from icymoon.stereo.report import sweep_charts
from icymoon.stereo.report.averaged_settings import describe_averaging
from icymoon.stereo.report.by_setting import SCENE_SWEEP, VariedSetting, average_by_level, find_swept_settings
from icymoon.stereo.report.conditions import join_by_scene, list_conditions, make_pair_titles, name_levels
from icymoon.stereo.report.summary import ResultTable
from icymoon.stereo.report.varied_on_purpose import MAX_LINES, choose_lines

SUNS, ALBEDOS, HEADINGS = (8.0, 20.0, 45.0), (0.2, 0.5, 0.7, 0.9), (0.0, 90.0)
METHODS = ("bm", "sgbm")


def grid(*columns):
    """All combinations of values, as arrays (pairs,)."""
    return [each.ravel() for each in np.meshgrid(*map(np.array, columns), indexing="ij")]


def made(scenes=1):
    """Sweeps and a table of a plan that varies Sun and albedo, at two headings; the error is known."""
    sun, albedo, heading, ground = grid(SUNS, ALBEDOS, HEADINGS, np.arange(scenes))
    sweeps = [
        VariedSetting("rig.heading_deg", "Rig: Heading (°)", heading),
        VariedSetting("light.sun_elevation_deg", "Sun (°)", sun),
        VariedSetting("surface.albedo", "Albedo", albedo),
    ]
    table = ResultTable(METHODS, [str(k) for k in range(len(sun))])
    table.counts[:], table.scenes[:] = True, ground
    for m in range(len(METHODS)):
        table.values[m, :, NUMBERS.index("l1_m")] = (1 + m) * (sun + 100 * albedo)
        table.values[m, :, NUMBERS.index("total_bad_1")] = 0.1
    return sweeps, table


def test_the_first_of_two_settings_has_a_line_for_each_value_of_the_second():
    (_, sun, albedo), table = made()
    for one, other, names in ((sun, albedo, ["0.2", "0.5", "0.7", "0.9"]), (albedo, sun, ["8", "20", "45"])):
        lines = choose_lines(one, [sun, albedo])
        assert (lines.factor, lines.names, lines.grouped) == (other, names, False)
    lines = choose_lines(sun, [sun, albedo])
    mean, _ = average_by_level(sun, table, 1, "l1_m", lines.of == 2)
    assert mean.tolist() == [2 * (each + 70) for each in SUNS]  # of this albedo only


def test_one_setting_and_what_is_drawn_at_random_have_no_lines():
    (heading, sun, _), _ = made()
    assert choose_lines(sun, [heading, sun]) is None  # a heading is averaged over
    assert choose_lines(heading, [heading, sun]) is None
    drawn = VariedSetting("surface.albedo", "Albedo", np.random.default_rng(0).uniform(size=len(sun.values)))
    assert choose_lines(sun, [sun, drawn]) is None
    assert choose_lines(drawn, [sun, drawn]) is None


def test_settings_that_were_varied_one_at_a_time_have_no_lines():
    sun = np.array([8, 8, 20, 20, 45, 45, 20, 20, 20, 20], float)
    albedo = np.array([0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.2, 0.2, 0.9, 0.9])
    sweeps = [VariedSetting("light.sun_elevation_deg", "Sun", sun), VariedSetting("surface.albedo", "Albedo", albedo)]
    assert choose_lines(sweeps[0], sweeps) is None


def test_many_values_form_groups_of_neighbours():
    sun, albedo = grid(SUNS, np.arange(10) / 10)
    sweeps = [
        VariedSetting("light.sun_elevation_deg", "Sun", np.tile(sun, 2)),
        VariedSetting("surface.albedo", "A", np.tile(albedo, 2)),
    ]
    lines = choose_lines(sweeps[0], sweeps)
    assert lines.grouped
    assert lines.names == ["0 to 0.2", "0.3 to 0.5", "0.6 to 0.7", "0.8 to 0.9"]
    assert len(lines.names) <= MAX_LINES
    assert np.bincount(lines.of).tolist() == [18, 18, 12, 12]


def test_a_chart_of_each_method_has_the_lines_and_the_caption_says_what_is_averaged():
    sweeps, table = made(scenes=3)
    summary = [{"method": method} for method in METHODS]
    drawn = {
        sweep.name: found for sweep, found in zip(sweeps, sweep_charts.draw_sweeps(summary, table, sweeps), strict=True)
    }
    sun = drawn["light.sun_elevation_deg"]
    assert sun.caption == (
        "Sun (°). Each point is the mean over 3 scenes and 2 headings. A line for each value of Albedo."
    )
    assert len(sun.rows) == len(sweep_charts.SWEPT_METRICS)
    for charts in sun.rows:
        for chart, title in zip(charts, ("StereoBM", "SGBM"), strict=True):
            texts = re.findall(r">([^<>]+)</text>", chart)
            assert {title, "Albedo", "0.2", "0.5", "0.7", "0.9"} <= set(texts)
    heading = drawn["rig.heading_deg"]
    assert heading.of_all
    assert list(map(len, heading.rows)) == [len(sweep_charts.SWEPT_METRICS)]
    assert heading.caption == "Rig: Heading (°). Each point is the mean over 3 scenes, Sun (°) and Albedo."


@pytest.mark.long
def test_charts_of_one_metric_have_one_scale_for_all_methods():
    (_, sun, albedo), table = made()
    summary = [{"method": method} for method in METHODS]
    one, other = sweep_charts.draw_sweeps(summary, table, [sun, albedo])[0].rows[0]
    numbers = [[text for text in re.findall(r">([^<>]+)</text>", chart) if text.isdigit()] for chart in (one, other)]
    assert numbers[0] == numbers[1]
    assert "250" in numbers[0]  # which only the second method reaches


def test_nothing_is_averaged_where_a_point_is_one_pair():
    sun, albedo = (VariedSetting(name, name, values) for name, values in zip("ab", grid(SUNS, ALBEDOS), strict=True))
    table = ResultTable(["bm"], [str(k) for k in range(12)])
    table.scenes[:] = np.arange(12)
    assert describe_averaging(np.arange(12), [sun, albedo], [sun, albedo], table) == "Each point is one pair."
    table.scenes[:] = 0
    assert describe_averaging(np.zeros(12, int), [sun], [sun], table) == "Each point is the mean over 12 pairs."


def of_presets(*rows):
    """The sweeps of pairs with these presets and settings, with names of their levels."""
    facts = [{"pair": str(k), "settings": merged(defaults(), *parts)} for k, parts in enumerate(rows)]
    places = {str(k): k for k in range(len(facts))}
    sweeps = join_by_scene(find_swept_settings(facts, places), facts, places)
    return sweeps, name_levels(sweeps, facts, places)


@pytest.mark.parametrize("light", [{}, {"light": {"sun_elevation_deg": 55.0}}])
def test_presets_of_scenes_are_one_setting_the_scene(light):
    snow, ice, chaos = (
        load_preset(f"scenes/{name}") for name in ("enceladus_fresh_snow", "europa_rough_ice", "europa_chaos")
    )
    sweeps, levels = of_presets((snow, light), (ice, light), (chaos, light), (snow, light))
    assert [(sweep.name, sweep.together) for sweep in sweeps][:1] == [(SCENE_SWEEP, ())]
    assert levels[0] == ["Enceladus fresh snow", "Europa chaos", "Europa rough ice"]
    assert len(sweeps) == 1
    assert [condition.name for condition in list_conditions(sweeps, levels)] == levels[0]
    assert make_pair_titles(sweeps, levels, 4)[1] == "Europa rough ice"


def test_what_varies_within_a_scene_stays_a_setting():
    snow, ice = (load_preset(f"scenes/{name}") for name in ("enceladus_fresh_snow", "europa_rough_ice"))
    sweeps, _ = of_presets(*((scene, {"light": {"sun_elevation_deg": sun}}) for scene in (snow, ice) for sun in SUNS))
    assert [sweep.name for sweep in sweeps] == [SCENE_SWEEP, "light.sun_elevation_deg"]


def test_settings_of_which_one_is_no_scene_stay_settings():
    ice = load_preset("scenes/europa_rough_ice")
    sweeps, _ = of_presets((ice,), (ice, {"terrain": {"hurst": 0.61}}))
    assert [sweep.name for sweep in sweeps] == ["terrain.hurst"]


def test_the_caption_of_settings_that_vary_together_is_short():
    snow, ice = (load_preset(f"surfaces/{name}") for name in ("fresh_snow", "rough_ice"))
    sweeps, _ = of_presets((snow,), (ice,))
    table = ResultTable(["bm"], ["0", "1"])
    table.scenes[:] = (0, 1)
    (found,) = sweep_charts.draw_sweeps([{"method": "bm"}], table, sweeps)
    assert len(sweeps[0].together) > 6
    assert re.search(r"It varies together with ([^,]+, ){4}[^,]+ and \d+ more settings, so", found.caption)
    assert len(found.caption) < 350

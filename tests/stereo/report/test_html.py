"""The report of many pairs and of hardly any, and in a real browser where there is one."""

import base64
import hashlib
import json
import re
import shutil
import subprocess

import manyrows
import numpy as np
import pairs
import pytest
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.row_metrics import NUMBERS
from icymoon.stereo.report.by_setting import (
    MAX_LEVELS,
    VariedSetting,
    average_by_level,
    find_swept_settings,
    name_scene,
)
from icymoon.stereo.report.html import MAX_PAIRS, choose_pairs
from icymoon.stereo.report.summary import ResultTable, summarise_method

pytestmark = pytest.mark.filterwarnings("error")

METHODS = parse_methods("bm,sgbm")
COUNT = 300


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    root = tmp_path_factory.mktemp("many")
    manyrows.multiply(pairs.write_pair(root / "real", rig=pairs.camera(192, 96)), METHODS, COUNT, root / "out")
    return root / "out"


def page_data(html):
    return json.loads(re.search(r'id="data">(.*?)</script>', html, re.DOTALL)[1])


@pytest.mark.long
def test_every_pair_is_in_the_table_and_a_few_have_pictures(many):
    html = (many / "report.html").read_text(encoding="utf-8")
    data = page_data(html)
    assert [row[0] for row in data["pairs"]] == [f"pair{k:05d}" for k in range(COUNT)]
    assert [row[2] for row in data["pairs"]].count("suspect") == len(range(5, COUNT, 97))
    assert html.count("<img") == MAX_PAIRS * (2 + 2 * 2) + 15 * (1 + 2) + 1  # pairs, matrix, and the enlarged one
    assert len(html) < 2_500_000
    rows = json.loads((many / "report.json").read_text())["rows"]
    assert data["pairs"][7][3] == pytest.approx(100 * rows[14]["total_bad_1"], abs=0.06)
    assert data["pairs"][7][1].startswith("Ice: Albedo 0.6, Sun Elevation ")


@pytest.mark.long
def test_only_the_reports_own_script_may_run(many):
    html = (many / "report.html").read_text(encoding="utf-8")
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in html
    assert "default-src 'none'" in html
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", html)


@pytest.mark.long
def test_each_varied_setting_has_a_plot(many):
    html = (many / "report.html").read_text(encoding="utf-8")
    charts = re.findall(r'<svg [^>]*class="chart".*?</svg>', html, re.DOTALL)
    for words, some in ((("Albedo", "(m)"), charts[-4:-2]), (("Sun Elevation", "(m)"), charts[-2:])):
        assert all(any(word in chart for chart in some) for word in words)
    assert "Seed" not in "".join(charts)
    assert all("currentColor" in chart or "var(--soft)" in chart for chart in charts)
    identifiers = re.findall(r'<(?:path|clipPath) id="([^"]+)"', html)
    assert len(identifiers) == len(set(identifiers))  # or one chart would be clipped by another's frame


def test_summary_tells_scenes_from_pairs(many):
    report = json.loads((many / "report.json").read_text())
    entry = report["summary"][0]
    low, high = entry["intervals"]["l1_m"]
    assert low < entry["l1_m"] < high
    assert (entry["scenes"], entry["pairs"] + entry["suspect"]) == (COUNT // 10, COUNT)
    assert {d["metric"] for d in report["comparisons"]} >= {"common_l1_m", "total_bad_1", "coverage"}
    assert "30 scenes" in report["verdicts"]


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no browser")
def test_in_a_browser(many):
    """The script runs under the page's own policy and shows a page of the table."""
    command = [
        "chromium",
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--virtual-time-budget=3000",
        "--dump-dom",
        (many / "report.html").as_uri(),
    ]
    page = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True)
    assert f"page 1 of {COUNT // 25}, {COUNT} pairs" in page.stdout
    body = re.search(r'id="all-pairs"[^>]*>(.*?)</section>', page.stdout, re.DOTALL)[1]
    assert body.count("<button>pair0") == 25


@pytest.mark.long
@pytest.mark.parametrize("count", [1, 2])
def test_one_and_two_pairs(tmp_path, count):
    for k in range(count):
        pairs.write_pair(tmp_path / "pairs" / f"p{k}", rig=pairs.camera(192, 96))
    report = evaluate([tmp_path], METHODS, tmp_path / "out", guiss=True)
    entry = report["summary"][0]
    assert (entry["pairs"], entry["scenes"]) == (count, 1)
    assert "l1_m" not in entry["intervals"]  # pairs of one scene do not tell what other scenes give
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "One scene" in html
    assert "GUISS" in html
    assert not re.search(r"\b1 (of 1 )?(\w+ )?(pairs|scenes|methods|images)\b", html)
    assert not re.findall(r"\bnan\b", html, re.IGNORECASE)


def test_a_report_of_failures_only(tmp_path):
    pairs.write_pair(tmp_path / "pairs" / "p")
    (tmp_path / "pairs" / "p" / "left.exr").write_bytes(b"")
    report = evaluate([tmp_path], METHODS, tmp_path / "out")
    assert len(report["pairs"]) == 0
    assert report["summary"][0]["l1_m"] is None
    assert page_data((tmp_path / "out" / "report.html").read_text())["pairs"] == [["p", "", "failed"] + [None] * 6]


def test_images_of_one_pixel(tmp_path):
    """Nothing can be matched; the report is written all the same."""
    pairs.write_pair(tmp_path / "pairs" / "p", pairs.Scene(rock=False), pairs.camera(1, 1))
    report = evaluate([tmp_path], METHODS, tmp_path / "out")
    assert {row["status"] for row in report["rows"]} == {"failed"}
    assert "too small" in report["rows"][0]["error"]


def test_few_pairs_are_chosen_from_many_the_worst_among_them():
    names = [f"pair{k:03d}" for k in range(100)]
    table = ResultTable(["bm"], names)
    table.values[0, :, NUMBERS.index("total_bad_1")] = 0.1 + 0.001 * np.arange(100)
    table.values[0, 7, NUMBERS.index("total_bad_1")] = np.nan  # counts in no average
    table.values[0, 50, NUMBERS.index("total_bad_1")] = 9.0
    chosen = choose_pairs(table, names)
    assert len(chosen) == MAX_PAIRS == len(set(chosen))
    assert {"pair007", "pair050", "pair099", "pair000"} <= set(chosen)
    assert len([name for name in chosen if name < "pair050"]) > 4
    assert choose_pairs(table, names[:MAX_PAIRS]) == names[:MAX_PAIRS]
    wide = ResultTable([f"m{k}" for k in range(20)], names)
    assert len(choose_pairs(wide, names)) < 10  # the file stays as small with many methods


def facts(name, **changes):
    settings = {
        "surface": {"albedo": 0.5},
        "rig": {"heading_deg": 0.0},
        "terrain": {"roughness": 1.0},
        "dataset": {"seed": 1, "folder": name},
        "quality": {"device": "CPU"},
    }
    for key, value in changes.items():
        topic, setting = key.split("__")
        settings[topic] = settings[topic] | {setting: value}
    return {"pair": name, "settings": settings}


def test_settings_that_vary_are_found():
    many = [
        facts(str(k), surface__albedo=(0.2, 0.8)[k % 2], rig__heading_deg=float(k), dataset__seed=k) for k in range(40)
    ]
    sweeps = find_swept_settings(many, {str(k): k for k in range(40)})
    assert [sweep.name for sweep in sweeps] == ["surface.albedo", "rig.heading_deg"]  # no seed, no folder
    names, places, level = sweeps[0].levels()
    assert (names, places.tolist()) == (["0.2", "0.8"], [0.2, 0.8])
    assert level.tolist() == [0, 1] * 20
    names, places, level = sweeps[1].levels()
    assert len(names) == MAX_LEVELS
    assert np.bincount(level).tolist() == [4] * MAX_LEVELS
    assert places[0] == pytest.approx(1.5)
    assert find_swept_settings(many[:1], {"0": 0}) == []


def test_settings_that_photographs_lack_are_not_swept():
    """One that is the empty text in all other pairs has no value at all, of which no chart could be drawn."""
    pairs = [{"pair": "a", "settings": {"light": {"body": "EUROPA", "date_utc": ""}}}, {"pair": "b", "settings": {}}]
    assert find_swept_settings(pairs, {"a": 0, "b": 1}) == []


def test_settings_that_vary_together_are_one():
    many = [
        facts(
            str(k),
            surface__albedo=(0.2, 0.8)[k % 2],
            terrain__roughness=(3.0, 1.0)[k % 2],
            rig__heading_deg=float(k // 2),
        )
        for k in range(8)
    ]
    sweeps = find_swept_settings(many, {str(k): k for k in range(8)})
    assert [(sweep.name, len(sweep.together)) for sweep in sweeps] == [("surface.albedo", 1), ("rig.heading_deg", 0)]
    assert sweeps[0].together == ("terrain.roughness",)


def test_words_and_missing_facts_as_levels():
    sweep = VariedSetting("surface.kind", "Kind", np.array(["ice", "", "snow", "ice"]))
    assert sweep.levels()[0] == ["ice", "snow"]
    assert sweep.levels()[2].tolist() == [0, -1, 1, 0]


def test_the_effect_is_the_mean_at_each_level():
    table = ResultTable(["bm"], list("abcdef"))
    table.values[0, :, NUMBERS.index("l1_m")] = [1, 2, 3, 10, np.nan, np.nan]
    table.values[0, :, NUMBERS.index("total_bad_1")] = [0.1, 0.3, 0.2, 0.4, np.nan, np.nan]
    table.scenes[:] = np.arange(6)
    sweep = VariedSetting("surface.albedo", "Albedo", np.array([0.2, 0.2, 0.2, 0.8, 0.8, 1.0]))
    mean, bounds = average_by_level(sweep, table, 0, "l1_m")
    assert mean[:2].tolist() == [2, 10]
    assert np.isnan(mean[2])
    assert np.isnan(bounds).all()  # a mean that is no share needs more scenes
    mean, bounds = average_by_level(sweep, table, 0, "total_bad_1")
    assert bounds[0, 0] < mean[0] < bounds[0, 1]
    assert np.isnan(bounds[1]).all()  # one pair has no interval


def test_a_scene_is_its_ground():
    one = facts("a")
    assert name_scene(one) == name_scene(facts("b", surface__albedo=0.9, rig__heading_deg=90.0))
    assert name_scene(one) != name_scene(facts("b", dataset__seed=2))
    assert name_scene({"pair": "x", "settings": {}}) != name_scene({"pair": "y", "settings": {}})  # of unknown ground


def test_pairs_that_count_nowhere_widen_no_interval():
    values = np.random.default_rng(0).uniform(0, 0.2, 12)
    entries = []
    for failed in (0, 30):
        table = ResultTable(["bm"], [str(k) for k in range(12 + failed)])
        table.values[0, :12, NUMBERS.index("total_bad_1")] = values
        table.counts[0, :12] = True
        table.failed[0, 12:] = True
        table.scenes[:12] = np.arange(12) // 2
        entries.append(summarise_method(table, 0))
    assert entries[0]["intervals"] == entries[1]["intervals"] != {}
    assert entries[0]["scenes"] == entries[1]["scenes"] == 6
    assert entries[1]["failed"] == 30


def test_summary_of_no_pair_at_all():
    entry = summarise_method(ResultTable(["bm"], []), 0)
    assert (entry["pairs"], entry["l1_m"], entry["n"], entry["intervals"]) == (0, None, 0, {})

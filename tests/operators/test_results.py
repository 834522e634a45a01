"""Numbers stay with the scene that they are of, say of what and when they are, and that something is not as it was."""

from __future__ import annotations

import json
import webbrowser
from types import SimpleNamespace

import bpy
import pytest
from evaluations import PAIR, ROW, evaluated, write_evaluation
from icymoon.operators import evaluate, results, trusted_reports
from icymoon.panels import sidebar
from icymoon.settings.blender import scene_properties
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.render_noise import DECIDES
from icymoon.stereo.report.notes import Notes
from icymoon.support.errors import IcyMoonError
from panel_drawing import drawn


def shown(scene) -> bool:
    with bpy.context.temp_override(scene=scene):
        return sidebar.ICYMOON_PT_results.poll(bpy.context)


def test_they_survive_saving_and_are_none_of_another_file(scene, tmp_path):
    evaluated(scene, tmp_path)
    before = results.read_stored_results(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert results.read_stored_results(bpy.context.scene) is None
    assert not shown(bpy.context.scene)
    assert not bpy.ops.icymoon.open_report.poll()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert results.read_stored_results(bpy.context.scene) == before
    assert shown(bpy.context.scene)
    assert results.list_notes(bpy.context.scene) == ["Of an earlier pair; measured 2038-06-01 12:34 UTC"]
    bpy.context.scene.icymoon.pairs = f"{PAIR} other"
    assert results.list_notes(bpy.context.scene) == ["Of the pair rendered last; measured 2038-06-01 12:34 UTC"]
    assert results.find_report_folder(bpy.context.scene) == tmp_path / "evaluation_scene"


def test_the_status_line_names_a_matcher_as_its_tick_does():
    row = {"method": "bm:window=7", "n": 9, "total_bad_1": 0.125, "coverage": 0.9, "l1_m": 0.25}
    assert results.describe_result(row).startswith("StereoBM window=7: 12.5 % wrong or missing")
    assert results.describe_result({**row, "method": "mine", "n": 0}) == "mine: no result"


def test_the_best_matcher_is_reported_last():
    """The status bar shows what is reported last."""
    row = {"method": "bm", "n": 9, "total_bad_1": 0.5, "coverage": 0.9, "l1_m": 0.25}
    rows = [row, {**row, "method": "sgbm", "total_bad_1": 0.25}, {**row, "method": "jplv", "n": 0}]
    assert [text.partition(":")[0] for text in results.describe_results(rows)] == ["JPLV", "StereoBM", "SGBM"]


def test_a_scene_that_knows_no_pair_keeps_those_that_were_measured(scene, tmp_path):
    """As after undo of the render, whose pair Evaluate finds by the settings."""
    evaluated(scene, tmp_path)
    settings = scene_properties.read_settings(scene.icymoon)
    for known, kept in (("", PAIR), ("other", "other")):
        scene.icymoon.pairs = known
        evaluate.ResultKeeper(scene, "SCENE", settings, [PAIR])({"type": "result"})
        assert scene.icymoon.pairs == kept
    scene.icymoon.pairs = ""
    results.keep_results(scene, "SCENE", settings)  # without pairs, as only another program writes it
    assert results.list_notes(scene)[0].startswith("Of an earlier pair;")


def test_the_number_of_pairs_of_a_data_set_is_told(scene, tmp_path):
    evaluated(scene, tmp_path, {**ROW, "pairs": 12}, scope="DATASET")
    assert results.list_notes(scene) == ["Of the data set, 12 pairs; measured 2038-06-01 12:34 UTC"]


def test_a_changed_setting_is_named_by_the_panel_that_has_it(scene, tmp_path):
    evaluated(scene, tmp_path)
    scene.icymoon.dataset.methods = "jplv"
    assert results.list_changed_settings(scene) == ["Evaluation ▸ Matchers"]


def test_what_limits_the_results_is_kept_with_them(scene, tmp_path):
    evaluated(scene, tmp_path)
    assert results.list_limits(scene) == ()
    path = tmp_path / "evaluation_scene" / "summary.json"
    path.write_text(
        json.dumps(
            json.loads(path.read_text())
            | {
                "notes": ["Noise decides: so.", "bm misses.", "A third."],
                "briefs": ["Noise decides", "bm:x=2 misses", "A"],
            }
        )
    )
    results.keep_results(scene, "SCENE", scene_properties.read_settings(scene.icymoon), [PAIR])
    assert results.list_limits(scene) == ("Noise decides: so.", "bm misses.")
    assert results.list_brief_limits(scene) == ("Noise decides", "bm:x=2 misses")
    labels = [entry[2]["text"] for entry in drawn(sidebar.ICYMOON_PT_results) if entry[0] == "label"]
    table = labels.index("Wrong")
    assert labels.index("bm:x=2 misses") < table < labels.index("So.")
    assert not any("Noise decides" in label for label in labels[table:])  # it is above


def test_a_result_that_noise_decides_comes_with_the_button_that_finds_the_remedy(scene, tmp_path):
    evaluated(scene, tmp_path)
    assert "icymoon.auto_quality" not in buttons_of_results()
    notes = Notes(parse_methods("bm"))
    part = {"share": 0.5, "noise_dn": 3.0, "hidden": 0.1}
    notes.add_pair({"noise": {"verdict": DECIDES, "lit": part, "shadow": part, "doubt": 0.2}})
    path = tmp_path / "evaluation_scene" / "summary.json"
    path.write_text(
        json.dumps(
            json.loads(path.read_text())
            | {
                "notes": [note.sentence for note in notes.found()],
                "briefs": [note.brief for note in notes.found()],
                "noise_doubt": notes.noise_doubt,
            }
        )
    )
    results.keep_results(scene, "SCENE", scene_properties.read_settings(scene.icymoon), [PAIR])
    assert results.read_noise_doubt(scene) == 0.2
    assert buttons_of_results().count("icymoon.auto_quality") == 1
    labels = " ".join(entry[2]["text"] for entry in drawn(sidebar.ICYMOON_PT_results) if entry[0] == "label")
    assert labels.count("Noise of the render decides") == 1
    assert "raise Quality and Speed ▸ Samples" in labels


def buttons_of_results():
    return [entry[1] for entry in drawn(sidebar.ICYMOON_PT_results) if entry[0] == "operator"]


def test_matchers_that_fail_rarely_stand_whole_below_the_ranks(scene, tmp_path):
    evaluated(scene, tmp_path)
    sentence = (
        "SGBM fails rarely but heavily: 2 of 40 pairs contain 45 % of its wrong or missing pixels, and other "
        "methods have far fewer there. Chance decides how many such pairs a data set contains, and so any "
        "verdict on it; evaluate more scenes."
    )
    path = tmp_path / "evaluation_scene" / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"rare_failures": [sentence]}))
    results.keep_results(scene, "SCENE", scene_properties.read_settings(scene.icymoon), [PAIR])
    assert results.list_rare_failures(scene) == (sentence,)
    labels = [entry[2]["text"] for entry in drawn(sidebar.ICYMOON_PT_results) if entry[0] == "label"]
    first = next(k for k, label in enumerate(labels) if label.startswith("SGBM fails rarely"))
    assert first > labels.index("Wrong")
    assert sentence in " ".join(labels[first:])  # in lines that the sidebar shows


def test_typical_differences_are_shown_and_an_older_report_has_none(scene, tmp_path):
    evaluated(scene, tmp_path)
    assert results.list_typical_differences(scene) == ()
    sentence = "In the typical scene StereoBM has 8.4 points more wrong or missing pixels than SGBM (2.2 to 20.3)."
    path = tmp_path / "evaluation_scene" / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"typical_differences": [sentence]}))
    results.keep_results(scene, "SCENE", scene_properties.read_settings(scene.icymoon), [PAIR])
    assert results.list_typical_differences(scene) == (sentence,)
    labels = [entry[2]["text"] for entry in drawn(sidebar.ICYMOON_PT_results) if entry[0] == "label"]
    assert sentence in " ".join(labels)


def test_each_scene_has_its_own_and_a_copy_those_of_its_settings(scene, tmp_path):
    evaluated(scene, tmp_path)
    other = bpy.data.scenes.new("Other")
    assert results.read_stored_results(other) is None
    assert not shown(other)
    copy = scene.copy()
    assert results.list_notes(copy) == results.list_notes(scene)
    copy.icymoon.light.sun_elevation_deg = 33.0
    assert len(results.list_notes(copy)) == 2
    assert len(results.list_notes(scene)) == 1


@pytest.mark.parametrize(
    ("topic", "key", "value", "of_a_data_set"),
    [
        ("light", "sun_elevation_deg", 33.0, False),
        ("terrain", "size_m", 30.0, False),
        ("quality", "samples", 5, False),
        ("rig", "baseline_m", 0.3, False),
        ("surface", "albedo", 0.2, False),
        ("dataset", "headings", 2, False),
        ("dataset", "seed", 9, False),
        ("sensor", "exposure_s", 0.5, True),
        ("sensor", "auto_exposure", False, True),
        ("rig", "distortion_k1", 0.1, True),
        ("dataset", "methods", "sgbm:window=7", True),
    ],
)
def test_what_is_not_as_it_was_measured_is_said_until_it_is_set_back(scene, tmp_path, topic, key, value, of_a_data_set):
    group = getattr(scene.icymoon, topic)
    was = getattr(group, key)
    for scope, counts in (("SCENE", True), ("DATASET", of_a_data_set)):
        evaluated(scene, tmp_path, scope=scope)
        assert len(results.list_notes(scene)) == 1
        setattr(group, key, value)
        assert (len(results.list_notes(scene)) == 2) == counts
        if counts:
            assert "Measured with other settings" in results.list_notes(scene)[1]
            assert ("Render and evaluate again" in results.list_notes(scene)[1]) == (not of_a_data_set)
            assert len(results.list_changed_settings(scene)) == 1
        setattr(group, key, was)
        assert len(results.list_notes(scene)) == 1


def test_another_folder_is_no_other_measurement(scene, tmp_path):
    evaluated(scene, tmp_path)
    was = scene.icymoon.dataset.folder
    scene.icymoon.dataset.folder = str(tmp_path / "other")
    assert "in another folder" in results.list_notes(scene)[1]
    assert "Measured with other settings" not in results.list_notes(scene)[1]
    scene.icymoon.dataset.folder = was
    assert len(results.list_notes(scene)) == 1


@pytest.mark.parametrize(("key", "value"), [("threads", 3), ("device", "GPU")])
def test_how_it_runs_does_not_matter(scene, tmp_path, key, value):
    evaluated(scene, tmp_path)
    setattr(scene.icymoon.quality, key, value)
    assert len(results.list_notes(scene)) == 1


def test_the_response_that_was_measured_with_is_the_reports_own(scene, tmp_path):
    """As of a data set that another Blender has left being evaluated."""
    scene.icymoon.dataset.folder = str(tmp_path)
    settings = scene_properties.read_settings(scene.icymoon)
    folder = results.find_evaluation_folder(settings, "DATASET")
    write_evaluation(folder)
    report = json.loads((folder / "summary.json").read_text())
    report["provenance"]["response_overrides"] = {"sensor.gain": 3.0}
    (folder / "summary.json").write_text(json.dumps(report))
    results.keep_results(scene, "DATASET", settings)
    assert "Gain" in results.list_notes(scene)[1]
    scene.icymoon.sensor.gain = 3.0
    assert len(results.list_notes(scene)) == 1


def test_confidence_stands_behind_errors_in_the_list_of_images(scene, tmp_path, monkeypatch):
    evaluated(scene, tmp_path, shown=[{"method": "bm", "images": {"error": "e.png", "confidence": "c.png"}}])
    paths = [tmp_path / "evaluation_scene" / name for name in ("e.png", "c.png")]
    for path in paths:
        path.write_text("x")
    asked = []
    monkeypatch.setattr(results, "show_images", lambda *rest: asked.append(rest) or True)
    assert results.show_error_image(SimpleNamespace(scene=scene), False)
    ((shown, _, names),) = asked
    assert shown == paths
    assert names == {paths[0]: "Error of StereoBM", paths[1]: "Confidence of StereoBM"}


def test_files_of_another_evaluation_are_not_shown_as_those_of_this_one(scene, tmp_path):
    shown_row = {"method": "bm", "images": {"points": "bm.ply", "error": "../../secret.png"}}
    evaluated(scene, tmp_path, shown=[shown_row])
    folder = tmp_path / "evaluation_scene"
    for path in (folder / "bm.ply", tmp_path.parent / "secret.png"):
        path.write_text("x")
    assert results.list_methods_with_points(scene) == ["bm"]
    assert results.find_error_images(scene) == []  # what is not in the folder is no image of this evaluation
    write_evaluation(folder, shown=[shown_row], created="2039-01-01T00:00:00+00:00")
    assert results.list_methods_with_points(scene) == []
    assert results.read_summary(scene)[0]["l1_m"] == ROW["l1_m"]
    with pytest.raises(IcyMoonError, match="Another evaluation has replaced these results"):
        results.find_report_folder(scene)
    with pytest.raises(RuntimeError, match="Another evaluation has replaced these results"):
        bpy.ops.icymoon.open_report()
    (folder / "summary.json").unlink()
    with pytest.raises(RuntimeError, match="no report"):
        bpy.ops.icymoon.open_report()


def test_only_a_report_that_was_made_here_is_opened(scene, tmp_path, monkeypatch):
    """A .blend and a data set may come from the same sender, with the same date in both."""
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    evaluated(scene, tmp_path)
    page = tmp_path / "evaluation_scene" / "report.html"
    bpy.ops.icymoon.open_report()
    trusted_reports._session.clear()  # as after a new start
    bpy.ops.icymoon.open_report()
    assert opened == [page.as_uri()] * 2
    ours = page.read_text()
    page.write_text(f"{ours}<script>fetch('https://example.org')</script>")
    with pytest.raises(RuntimeError, match="was not made by you on this machine"):
        bpy.ops.icymoon.open_report()
    page.write_text(ours)
    monkeypatch.setenv("ICYMOON_CACHE", str(tmp_path / "another's cache"))
    with pytest.raises(RuntimeError, match="was not made by you on this machine"):
        bpy.ops.icymoon.open_report()
    assert len(opened) == 2


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        "{}",
        "[" * 100_000,
        '{"made": 1}',
        json.dumps({"summary": [ROW]}),
        "\x00",
        json.dumps({"made": "x", "scope": "SCENE", "pairs": [1], "settings": {}, "summary": []}),
        json.dumps({"made": "x", "scope": "SCENE", "pairs": [], "settings": {}, "summary": [{"method": ["bm"]}]}),
    ],
)
def test_what_is_no_result_is_none(scene, text):
    scene.icymoon.results = text
    assert results.read_stored_results(scene) is None
    assert not shown(scene)


def test_what_a_file_says_is_text_and_leads_nowhere(scene, tmp_path):
    evil = "/usr/bin/evil\n" * 50
    scene.icymoon.dataset.folder = str(tmp_path)
    scene.icymoon.results = json.dumps(
        {
            "made": evil,
            "scope": evil,
            "pairs": [evil],
            "folder": evil,
            "settings": {"light": {"sun_elevation_deg": evil}},
            "notes": [evil] * 9,
            "briefs": [evil] * 9,
            "rare_failures": [evil] * 9,
            "typical_differences": [evil] * 9,
            "summary": [{"method": evil, **dict.fromkeys(results.METRICS, 0.5)}],
        }
    )
    assert all(len(line) < 200 and line.isprintable() for line in results.list_notes(scene))
    assert len(results.read_summary(scene)[0]["method"]) <= 40
    assert len(results.list_limits(scene)) == 2
    assert all(
        len(line) <= 400 and line.isprintable()
        for line in (
            *results.list_limits(scene),
            *results.list_brief_limits(scene),
            *results.list_rare_failures(scene),
            *results.list_typical_differences(scene),
        )
    )
    with pytest.raises(IcyMoonError, match="no report"):
        results.find_report_folder(scene)


def test_a_scene_that_is_renamed_or_gone_meanwhile_is_found_or_left_out(scene, tmp_path):
    scene.icymoon.dataset.folder = str(tmp_path)
    settings = scene_properties.read_settings(scene.icymoon)
    write_evaluation(tmp_path / "evaluation_scene")
    other = bpy.data.scenes.new("Other")
    keepers = [evaluate.ResultKeeper(each, "SCENE", settings, [PAIR]) for each in (scene, other)]
    scene.name = "Renamed"
    bpy.data.scenes.remove(other)
    bpy.data.scenes.new("Other")
    for keeper in keepers:
        keeper({"type": "result", "report": "unused"})
    assert results.read_stored_results(bpy.data.scenes["Renamed"]).pairs == (PAIR,)
    assert results.read_stored_results(bpy.data.scenes["Other"]) is None

"""Export Pair or Data Set: the formats, options and files of the command line, from the window."""

from __future__ import annotations

import json
import sys
from types import SimpleNamespace

import bpy
import pytest
from icymoon.operators import export_pairs, jobs
from icymoon.operators.session import session
from icymoon.panels.exports import draw_export
from icymoon.plugins.installed import load_plugin
from icymoon.render.pairs.pair_folder import has_pairs
from icymoon.settings.blender import scene_properties
from icymoon.stereo.cli import make_parser
from icymoon.stereo.export import OPTIONS, find_plugins, list_options, list_titles
from pairs import write_pair
from panel_drawing import Layout, texts
from stand_ins import stand_in

NAME = "0123456789ab"


def options_of_command() -> set[str]:
    """The options of the verb export."""
    verbs = next(action.choices for action in make_parser()._actions if isinstance(action.choices, dict))
    return {word for action in verbs["export"]._actions for word in action.option_strings}


@pytest.fixture
def scene(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(export_pairs, "find_evaluator_python", lambda: sys.executable)
    scene.icymoon.dataset.folder = str(tmp_path / "data")
    yield scene
    session.exported.clear()


@pytest.fixture
def pair(scene, tmp_path):
    folder = tmp_path / "data" / "pairs" / NAME
    write_pair(folder)
    return folder


@pytest.fixture
def started(monkeypatch):
    """The commands that are started, in place of their processes."""
    commands: list[list[str]] = []
    monkeypatch.setattr(jobs.Job, "start", lambda title, command, **_: commands.append(command))
    return commands


def start(scene, started, **properties):
    operator = type("ConditionScope", (), {})()
    for name, value in {"source": "DATASET", "response": False, "cell_m": 0.0, "filepath": "/x", **properties}.items():
        setattr(operator, name, value)
    operator._make_command = lambda *words: export_pairs.ICYMOON_OT_export_pairs._make_command(operator, *words)
    export_pairs.ICYMOON_OT_export_pairs.start(operator, bpy.context)
    return started[-1][started[-1].index("export") :]


def test_the_dialog_has_the_formats_and_options_of_the_command_line(scene):
    rna = bpy.ops.icymoon.export_pairs.get_rna_type()
    built_in = [name for name, plugin in find_plugins().usable.items() if plugin.built_in]
    assert [item.identifier for item in rna.properties["kind"].enum_items] == [*built_in, "for-prediction"]
    assert {option.flag for option in OPTIONS} <= options_of_command()
    assert {option.key for option in OPTIONS} <= set(rna.properties.keys())
    assert all(item.name and item.description for item in rna.properties["kind"].enum_items)


def test_each_heading_of_the_formats_has_a_short_list(scene):
    """A menu of one column with all formats is longer than a narrow window is high."""
    shown = bpy.ops.icymoon.export_pairs.get_rna_type().properties["kind"].enum_items_static_ui
    groups = [[]]
    for item in shown:
        if item.identifier:
            groups[-1].append(item.identifier)
        else:
            assert item.name in export_pairs.HEADINGS.values()
            groups.append([])
    assert not groups[0]  # no format stands above the first heading
    assert len(groups) - 1 == len(export_pairs.HEADINGS)
    assert all(1 <= len(group) <= 8 for group in groups[1:])


def test_every_title_names_what_is_written():
    for name, (title, content) in list_titles().items():
        assert title, name
        assert content, name
        assert not content.endswith("."), name


def test_only_maps_have_a_cell():
    assert {name for name in find_plugins().usable if list_options(name)} == {"dem"}
    assert all(load_plugin(find_plugins().usable[name]).write_folders for name in ("dem", "ply"))


def test_without_a_pair_the_button_is_grey(scene, tmp_path):
    assert not bpy.ops.icymoon.export_pairs.poll()
    with pytest.raises(RuntimeError, match="There is no rendered pair; press Render Stereo Pair first"):
        bpy.ops.icymoon.export_pairs(filepath=str(tmp_path / "out"))


def test_the_window_reads_a_data_set_folder_only_when_it_has_changed(scene, tmp_path, monkeypatch):
    read, now = [], 0.0
    monkeypatch.setattr(export_pairs, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(export_pairs, "has_pairs", lambda path: read.append(path) or has_pairs(path))
    scene.icymoon.dataset.folder = str(tmp_path)
    for _ in range(20):
        assert not bpy.ops.icymoon.export_pairs.poll()
    assert len(read) == 1
    (tmp_path / "pairs" / NAME).mkdir(parents=True)
    (tmp_path / "pairs" / NAME / "pair.json").touch()
    assert bpy.ops.icymoon.export_pairs.poll()
    assert len(read) == 2
    now = 60.0
    assert bpy.ops.icymoon.export_pairs.poll()
    assert len(read) == 3  # now and then anyway


def test_the_last_pair_comes_first_and_the_data_set_else(scene, pair):
    assert list(export_pairs.find_sources(scene)) == ["DATASET"]
    scene.icymoon.pairs = NAME
    assert export_pairs.find_sources(scene) == {"SCENE": [pair], "DATASET": [pair.parents[1]]}
    scene.icymoon.pairs = "../../../etc"
    assert list(export_pairs.find_sources(scene)) == ["DATASET"]
    scene.icymoon.dataset.folder = "//beside"
    assert export_pairs.find_sources(scene) == {}  # the file is not saved


def test_pairs_of_the_scene_have_the_response_that_is_shown(scene, pair, started):
    scene.icymoon.pairs = NAME
    assert "--set" in start(scene, started, kind="kitti", source="SCENE")
    assert "--set" not in start(scene, started, kind="kitti")  # each pair's own
    assert "--set" in start(scene, started, kind="kitti", response=True)
    assert "--set" not in start(scene, started, kind="ply", source="SCENE", response=True)  # which ground has not


def test_only_options_of_the_format_are_given(scene, pair, started):
    assert "--cell-m" not in start(scene, started, kind="dem")
    command = start(scene, started, kind="dem", cell_m=0.25)
    assert command[command.index("--cell-m") + 1] == "0.25"
    assert "--cell-m" not in start(scene, started, kind="ply", cell_m=0.25)
    assert start(scene, started, kind="for-prediction")[2] == "--for-prediction"


def test_ground_needs_no_evaluator(scene, pair, started, monkeypatch):
    def find() -> str:
        raise export_pairs.IcyMoonError("There is no evaluator.")

    monkeypatch.setattr(export_pairs, "find_evaluator_python", find)
    assert start(scene, started, kind="ply")
    with pytest.raises(export_pairs.IcyMoonError, match="no evaluator"):
        start(scene, started, kind="kitti")


@pytest.mark.long
def test_a_pair_is_exported_by_the_evaluators_python(scene, pair, tmp_path):
    scene.icymoon.pairs = NAME
    out = tmp_path / "out"
    assert bpy.ops.icymoon.export_pairs(filepath=str(out), kind="png16", source="SCENE") == {"FINISHED"}
    assert json.loads((out / NAME / "calibration.json").read_text())


def draw_outcome(scene, source: str) -> str:
    layout = Layout()
    draw_export(layout, scene, source)
    return texts(layout.record)


def export(scene, pair, folder="/x/y", sentences=("Loss.",)) -> None:
    """A finished export of the pair of the scene."""
    scene.icymoon.pairs = pair.name
    settings = scene_properties.read_for_display(scene.icymoon)
    session.exported[scene.session_uid, "SCENE"] = export_pairs.Exported(folder, sentences, (pair,), settings, "KITTI")


def test_each_scene_and_source_keeps_its_export(scene, pair):
    """An export of the data set forgot the one of the pair."""
    export(scene, pair)
    settings = scene_properties.read_for_display(scene.icymoon)
    session.exported[scene.session_uid, "DATASET"] = export_pairs.Exported("/z", ("Other.",), (pair,), settings)
    assert "Loss." in draw_outcome(scene, "SCENE")
    other = bpy.data.scenes.new("Other")
    other.icymoon.dataset.folder, other.icymoon.pairs = scene.icymoon.dataset.folder, scene.icymoon.pairs
    assert "Loss." not in draw_outcome(other, "SCENE")


def test_an_export_is_shown_beside_its_own_button_until_another_pair_is_there(scene, pair):
    export(scene, pair)
    assert "Loss." in draw_outcome(scene, "SCENE")
    assert "Loss." not in draw_outcome(scene, "DATASET")
    scene.icymoon.rig.baseline_m += 0.1  # the files are what they were
    assert "Loss." in draw_outcome(scene, "SCENE")
    write_pair(pair.parent / "ba9876543210")
    scene.icymoon.pairs = "ba9876543210"
    assert "Loss." not in draw_outcome(scene, "SCENE")
    assert "Open Exported Files" not in draw_outcome(scene, "SCENE")


def test_an_export_names_its_format_and_its_folder(scene, pair):
    """The button alone did not tell what was written where."""
    export(scene, pair)
    assert "Exported KITTI to /x/y" in draw_outcome(scene, "SCENE")
    export(scene, pair, folder="/home/someone/work/moons/data_export")
    assert "moons/data_export" in (told := draw_outcome(scene, "SCENE"))
    assert "someone/work" not in told  # a long path would fill the panel
    export(scene, pair, folder="", sentences=("It broke.",))
    assert "Exported" not in draw_outcome(scene, "SCENE")


def test_why_an_export_failed_is_shown_until_a_setting_changes(scene, pair):
    export(scene, pair, folder="", sentences=("Lower sensor.bits.",))
    assert "Lower sensor.bits." in draw_outcome(scene, "SCENE")
    scene.icymoon.sensor.bits = 10
    assert "Lower sensor.bits." not in draw_outcome(scene, "SCENE")


@pytest.mark.parametrize(("failure", "shown_folder"), [("", "/x/y"), ("It broke.", "")])
def test_the_outcome_is_kept_with_the_pairs_and_settings_of_the_start(scene, pair, started, failure, shown_folder):
    scene.icymoon.pairs = pair.name
    kind = export_pairs.ICYMOON_OT_export_pairs
    operator = stand_in(source="SCENE", kind="ply", response=False, filepath="/x/y", _make_command=lambda *words: words)
    kind.start(operator, bpy.context)
    operator._job = SimpleNamespace(warnings=["Loss."], failure=failure)
    kind._keep_outcome(operator)
    done = export_pairs.find_export(scene, "SCENE")
    assert done is not None
    assert done.title == export_pairs.find_format_title("ply") == list_titles()["ply"][0]
    assert (done.folder, done.sentences) == (shown_folder, ("Loss.", *filter(None, [failure])))


@pytest.mark.parametrize("count", [0, 2, 5])
def test_warnings_stay_beside_the_button(scene, pair, count):
    export(scene, pair, sentences=tuple(f"Loss {k}." for k in range(count)))
    shown = draw_outcome(scene, "SCENE")
    assert "Open Exported Files" in shown
    assert sum(f"Loss {k}." in shown for k in range(count)) == min(count, 3)
    assert ("2 more in the Info editor" in shown) == (count == 5)

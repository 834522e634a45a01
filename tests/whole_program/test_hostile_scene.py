"""A scene from anyone starts no program, whatever is pressed; the person's own matcher, in the preferences, does."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import bpy
import pytest
from icymoon.operators import dataset, preferences
from icymoon.settings.blender import scene_properties
from stand_ins import stand_in

ICYMOON = bpy.ops.icymoon
BUTTONS = {
    "evaluate": lambda: ICYMOON.evaluate(scope="SCENE"),
    "evaluate all": lambda: ICYMOON.evaluate(scope="DATASET"),
    "trade": lambda: ICYMOON.trade(),
    "auto": lambda: ICYMOON.auto_quality(),
    "data set": lambda: ICYMOON.render_dataset(),
    "dry run": lambda: ICYMOON.plan_dry_run(),
    "expose": lambda: ICYMOON.expose(),
}


@pytest.fixture
def hostile(scene, tmp_path):
    """A .blend file of somebody else's, opened with scripts off, whose matchers are a program."""
    group = scene.icymoon
    group.dataset.methods = f"bm,external:command={sys.executable} -c pass {{left}} {{right}} {{out}}"
    group.dataset.folder, group.dataset.evaluate = str(tmp_path / "set"), True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hostile.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "hostile.blend"), use_scripts=False)
    assert "external" in bpy.context.scene.icymoon.dataset.methods
    return bpy.context.scene


@pytest.mark.parametrize("name", BUTTONS)
def test_a_scene_from_anyone_starts_no_program(name, hostile, monkeypatch):
    def started(*arguments, **options):
        raise AssertionError(f"{name} starts {arguments}")

    monkeypatch.setattr(subprocess, "Popen", started)
    with pytest.raises(RuntimeError, match=r"This scene: dataset\.methods names a command, which only you may.*own:"):
        BUTTONS[name]()


def test_neither_do_settings_loaded_into_one(scene, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text('[dataset]\nmethods = "igev:checkpoint=evil.pth"\n', encoding="utf-8")
    with pytest.raises(RuntimeError, match=r"scene\.toml: dataset\.methods names a checkpoint"):
        bpy.ops.icymoon.load_settings(filepath=str(file))
    assert scene.icymoon.dataset.methods == "bm,sgbm"


def test_such_a_scene_can_still_be_looked_at_and_mended(hostile):
    assert scene_properties.read_unchecked(hostile.icymoon).dataset.methods.startswith("bm,external")
    hostile.icymoon.dataset.methods = "bm"
    assert scene_properties.read_settings(hostile.icymoon).dataset.methods == "bm"


@pytest.fixture
def matchers(scene, monkeypatch):
    """The list of the person's own matchers, which only an installed add-on has, kept in the scene."""
    kind = type(
        "ICYMOON_PG_test",
        (bpy.types.PropertyGroup,),
        {
            "__annotations__": {
                "matchers": bpy.props.CollectionProperty(type=preferences.ICYMOON_PG_matcher),
                "workers": bpy.props.IntProperty(),
                "evaluator": bpy.props.StringProperty(),
            }
        },
    )
    bpy.utils.register_class(kind)
    bpy.types.Scene.icymoon_test = bpy.props.PointerProperty(type=kind)
    monkeypatch.setattr(preferences, "get_preferences", lambda: bpy.context.scene.icymoon_test)
    yield scene.icymoon_test.matchers
    del bpy.types.Scene.icymoon_test
    bpy.utils.unregister_class(kind)


def test_one_s_own_matcher_is_set_up_in_the_preferences_and_named_by_scenes(matchers, scene, tmp_path, monkeypatch):
    assert bpy.ops.icymoon.add_matcher() == bpy.ops.icymoon.add_matcher() == {"FINISHED"}
    assert [item.name for item in matchers] == ["mine", "mine1"]
    assert bpy.ops.icymoon.remove_matcher(index=1) == {"FINISHED"}
    matchers[0].program, matchers[0].options = "run, me {left} {right} {out}", "format=pfm:timeout_s=60"
    scene.icymoon.dataset.methods = "bm,own:mine:timeout_s=5"
    scene.icymoon.dataset.folder = str(tmp_path / "set")
    scene.icymoon.dataset.evaluate = True
    commands = []
    monkeypatch.setattr(
        dataset.DetachedProcess,
        "start",
        lambda command, *_: commands.append(command) or SimpleNamespace(facts={"started": 0.0}),
    )
    kind = dataset.ICYMOON_OT_render_dataset
    kind.start(stand_in(_make_job=lambda *_: None), SimpleNamespace(scene=scene))
    words = commands[0][commands[0].index("--evaluate") + 1 :]
    assert words[:7] == [
        "bm,own:mine:timeout_s=5",
        "--own",
        "mine:external:command=run, me {left} {right} {out}",
        "--own",
        "mine:external:format=pfm",
        "--own",
        "mine:external:timeout_s=60",
    ]


def test_a_network_of_one_s_own_needs_no_more_than_its_name(matchers):
    bpy.ops.icymoon.add_matcher()
    matchers[0].method = "igev"
    assert preferences.make_own_matcher_arguments("own:mine") == ["--own", "mine:igev"]
    matchers[0].program = "/trained.pth"
    assert preferences.make_own_matcher_arguments("own:mine") == ["--own", "mine:igev:checkpoint=/trained.pth"]
    for kind, option in (("resident", "command"), ("onnx", "model"), ("stereo_matching", "python")):
        matchers[0].method = kind
        assert preferences.make_own_matcher_arguments("own:mine") == ["--own", f"mine:{kind}:{option}=/trained.pth"]
    assert preferences.make_own_matcher_arguments("bm") == []


def test_a_matcher_that_is_not_set_up_here_is_refused_before_anything_starts(matchers, scene):
    scene.icymoon.dataset.methods, scene.icymoon.dataset.evaluate = "own:hers", True
    with pytest.raises(RuntimeError, match="own:hers is not set up on this machine"):
        bpy.ops.icymoon.render_dataset()

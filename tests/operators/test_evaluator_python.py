"""The evaluator that the Install button makes: found, offered and removed."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from icymoon.operators import evaluate, install_evaluator, jobs, preferences
from icymoon.support.errors import IcyMoonError
from icymoon.support.system import find_venv_python
from stand_ins import stand_in


@pytest.fixture
def extension(monkeypatch, tmp_path):
    """A folder that is the installed extension's."""
    monkeypatch.setattr(preferences, "find_extension_folder", lambda: tmp_path)
    monkeypatch.delenv("ICYMOON_EVALUATOR", raising=False)
    return tmp_path / "evaluator"


def install(folder):
    python = find_venv_python(folder)
    python.parent.mkdir(parents=True)
    python.touch()
    (folder / "pyvenv.cfg").touch()


def test_an_evaluator_is_there_once_it_is_whole(extension, monkeypatch):
    monkeypatch.setattr(bpy, "app", type("App", (), {"binary_path": "/blender", "background": True}))
    assert not preferences.has_own_evaluator()
    assert preferences.is_evaluator_missing()
    install(extension)
    (extension / "unfinished").touch()
    assert not preferences.has_own_evaluator()
    (extension / "unfinished").unlink()
    assert preferences.has_own_evaluator()
    assert not preferences.is_evaluator_missing()


def test_a_wrong_path_of_the_user_is_no_reason_to_install(extension, monkeypatch):
    monkeypatch.setattr(bpy, "app", type("App", (), {"binary_path": "/blender", "background": True}))
    monkeypatch.setenv("ICYMOON_EVALUATOR", "/nowhere/python")
    assert not preferences.is_evaluator_missing()


def test_the_evaluator_is_removed_and_nothing_else(extension):
    assert not bpy.ops.icymoon.remove_evaluator.poll()
    install(extension)
    (extension.parent / "presets").mkdir()
    assert bpy.ops.icymoon.remove_evaluator() == {"FINISHED"}
    assert not extension.exists()
    assert (extension.parent / "presets").is_dir()


def test_what_is_no_environment_is_not_removed(extension):
    install(extension)
    (extension / "pyvenv.cfg").unlink()
    with pytest.raises(RuntimeError, match="is not an environment that Install Evaluator made"):
        bpy.ops.icymoon.remove_evaluator()
    assert extension.is_dir()


def test_a_folder_that_is_a_link_is_not_followed(extension, tmp_path):
    install(tmp_path / "elsewhere")
    extension.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RuntimeError, match="remove it by hand"):
        bpy.ops.icymoon.remove_evaluator()
    assert (tmp_path / "elsewhere" / "pyvenv.cfg").is_file()


class Question:
    """Stands in for the layout of a dialog."""

    def __init__(self) -> None:
        self.texts, self.buttons = [], []

    def label(self, *, text: str) -> None:
        self.texts.append(text)

    def operator(self, name: str, **_: str) -> None:
        self.buttons.append(name)


@pytest.mark.parametrize(("online", "buttons"), [(True, []), (False, ["extensions.userpref_allow_online"])])
def test_the_question_before_installing_offers_online_access_where_it_is_off(monkeypatch, online, buttons):
    monkeypatch.setattr(install_evaluator, "bpy", SimpleNamespace(app=SimpleNamespace(online_access=online)))
    question = Question()
    install_evaluator.ICYMOON_OT_install_evaluator.draw(stand_in(layout=question), bpy.context)
    assert "450 MB" in question.texts[0]
    assert question.buttons == buttons


def test_nothing_is_installed_without_online_access(extension, monkeypatch):
    monkeypatch.setattr(install_evaluator, "bpy", SimpleNamespace(app=SimpleNamespace(online_access=False)))
    monkeypatch.setattr(jobs, "Process", None)
    with pytest.raises(IcyMoonError, match="needs online access; allow it in Preferences ▸ System"):
        install_evaluator.ICYMOON_OT_install_evaluator.start(stand_in(), bpy.context)


def test_after_installing_what_was_asked_for_is_evaluated(monkeypatch):
    asked = []
    icymoon = SimpleNamespace(evaluate=lambda *given, **how: asked.append(how))
    monkeypatch.setattr(install_evaluator, "bpy", SimpleNamespace(ops=SimpleNamespace(icymoon=icymoon)))
    for scope in ("NOTHING", "DATASET"):
        installing = stand_in(then_evaluate=scope, report=lambda *_: None)
        install_evaluator.ICYMOON_OT_install_evaluator.report_success(installing, bpy.context)
    preferences.show_findings([])
    assert asked == [{"scope": "DATASET"}]


@pytest.mark.long
@pytest.mark.parametrize(
    ("background", "said"),
    [
        (True, r"install it with blender --online-mode -b --python-expr .*install_evaluator.*or set ICYMOON_EVALUATOR"),
        (False, "open Preferences ▸ Add-ons ▸ Icy Moon and press Install Evaluator"),
    ],
)
def test_who_has_no_evaluator_is_told_what_can_be_done_there(extension, monkeypatch, background, said):
    monkeypatch.setattr(bpy, "app", SimpleNamespace(binary_path="/blender", background=background))
    with pytest.raises(IcyMoonError, match=said):
        preferences.find_evaluator_python()


@pytest.mark.parametrize("scope", ["SCENE", "DATASET"])
def test_the_evaluator_is_asked_for_only_where_there_is_a_pair(scene, tmp_path, monkeypatch, scope):
    asked, said = [], []
    ops = SimpleNamespace(icymoon=SimpleNamespace(install_evaluator=lambda *how, **what: asked.append(what)))
    monkeypatch.setattr(evaluate, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), ops=ops))
    monkeypatch.setattr(evaluate, "is_evaluator_missing", lambda: True)
    scene.icymoon.dataset.folder = str(tmp_path)
    button = stand_in(scope=scope, fail=lambda error: said.append(str(error)) or {"CANCELLED"})
    invoke = evaluate.ICYMOON_OT_evaluate.invoke
    assert invoke(button, bpy.context, None) == {"CANCELLED"}
    assert asked == []
    assert "Render Stereo Pair" in said[0]
    monkeypatch.setattr(evaluate, "find_rendered_pairs", lambda *_: [tmp_path])
    monkeypatch.setattr(evaluate, "has_pairs", lambda _: True)
    invoke(button, bpy.context, None)
    assert asked == [{"then_evaluate": scope}]


def test_a_measuring_job_counts_and_names_its_last_step():
    process = stand_in(cancelled=False, running=True)
    job = evaluate.MeasuringJob("Evaluate", process)
    message = {"type": "progress", "fraction": 0.5, "done": 1, "total": 2, "message": "0123456789ab StereoBM"}
    job.hear(message)
    assert job.shown[0] == "1 of 2 measured  50 %"
    job.hear({**message, "fraction": 1.0, "done": 2})
    assert job.shown[0] == "Writing the report  100 %"

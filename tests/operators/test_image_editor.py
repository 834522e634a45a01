"""When a window with an Image Editor opens: never within the operator that asks for it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from icymoon.operators import image_editor
from icymoon.operators.session import session
from icymoon.support.version import ROOT


@pytest.fixture
def window(monkeypatch):
    """A Blender with a window, without an Image Editor: what is opened, and the functions that are called later."""
    opened, later = [], []

    def open_editor():
        opened.append("editor")
        return opened[-1]

    monkeypatch.setattr(image_editor, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    monkeypatch.setattr(image_editor, "_find_editor", lambda: opened[-1] if opened else None)
    monkeypatch.setattr(image_editor, "_open_editor", open_editor)
    monkeypatch.setattr(image_editor, "call_later", lambda function: later.append(function))
    yield SimpleNamespace(opened=opened, later=later)
    session.to_show.clear()


def test_a_window_opens_in_the_next_turn(window):
    """A modal operator that opens one itself is not ended by Blender, which crashes later."""
    shown = []
    assert image_editor.show_in_editor(True, shown.append)
    assert (window.opened, shown) == ([], [])
    window.later[0]()
    assert (window.opened, shown) == (["editor"], ["editor"])


def test_what_is_shown_next_finds_the_window_of_the_first(window):
    shown = []
    for _ in range(2):
        assert image_editor.show_in_editor(True, shown.append)
    window.later[0]()
    assert (window.opened, shown) == (["editor"], ["editor", "editor"])
    assert image_editor.show_in_editor(False, shown.append)
    assert len(shown) == 3


def test_no_window_opens_without_being_asked(window):
    assert not image_editor.show_in_editor(False, pytest.fail)
    assert not window.later


def test_windows_are_opened_nowhere_else():
    """An operator that changes the context's window may be modal."""
    folders = ("operators", "panels", "nodes", "support", "settings")
    users = {
        path.name for each in folders for path in (ROOT / each).rglob("*.py") if "window_new" in path.read_text("utf-8")
    }
    assert users == {"image_editor.py"}

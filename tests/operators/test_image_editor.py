"""When a window with an Image Editor opens: never within the operator that asks for it."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from icymoon.operators import image_editor, window_areas
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


class Windows:
    """A Blender with a main window, whose areas show what is given, and the window of a render once it is shown."""

    def __init__(self, image_kind: str = "IMAGE") -> None:
        self.calls: list[str] = []
        self.main = self._make(image_kind, is_temporary=False)
        self.second = self._make("IMAGE", is_temporary=True)
        self.manager = SimpleNamespace(windows=[self.main])
        self.view = SimpleNamespace(render_display_type="NONE")
        self.preferences = SimpleNamespace(view=self.view, is_dirty=False)

    @staticmethod
    def _make(image_kind: str, is_temporary: bool) -> SimpleNamespace:
        space = SimpleNamespace(image=SimpleNamespace(type=image_kind))
        spaces = SimpleNamespace(active=space)
        area = SimpleNamespace(type="IMAGE_EDITOR", ui_type="", spaces=spaces, y=int(is_temporary))  # no two are equal
        render = SimpleNamespace(resolution_x=64, resolution_y=48, resolution_percentage=50)
        scene = SimpleNamespace(library=None, render=render)
        screen = SimpleNamespace(is_temporary=is_temporary, areas=[area])
        return SimpleNamespace(screen=screen, scene=scene, width=1600, height=1000)

    def _open(self, name: str) -> None:
        size = self.main.scene.render
        wide = size.resolution_x * size.resolution_percentage // 100
        self.calls.append(f"{name} {wide} {self.view.render_display_type} {self.over.screen.is_temporary}")
        if len(self.manager.windows) == 1:
            self.manager.windows.append(self.second)

    def _override(self, window: SimpleNamespace) -> object:
        self.over = window
        return nullcontext()

    @property
    def bpy(self) -> SimpleNamespace:
        """What stands in for ``bpy``."""
        ops = SimpleNamespace(
            wm=SimpleNamespace(window_new=lambda: self._open("new")),
            render=SimpleNamespace(view_show=lambda how: self._open("render")),
        )
        context = SimpleNamespace(
            window_manager=self.manager, preferences=self.preferences, temp_override=self._override
        )
        return SimpleNamespace(app=SimpleNamespace(background=False), context=context, ops=ops)


@pytest.mark.parametrize(
    ("image_kind", "call"), [("IMAGE", "render 1280 WINDOW False"), ("RENDER_RESULT", "new 32 NONE False")]
)
def test_the_window_is_one_that_esc_closes_unless_the_users_render_is_shown(monkeypatch, image_kind, call):
    windows = Windows(image_kind)
    for module in (image_editor, window_areas):
        monkeypatch.setattr(module, "bpy", windows.bpy)
    assert image_editor._open_editor() is windows.second.screen.areas[0]
    assert windows.calls == [call]
    assert windows.second.screen.areas[0].ui_type == "IMAGE_EDITOR"
    assert (windows.view.render_display_type, windows.preferences.is_dirty) == ("NONE", False)
    assert vars(windows.main.scene.render) == {"resolution_x": 64, "resolution_y": 48, "resolution_percentage": 50}


def test_a_window_that_esc_closes_comes_to_the_front_and_no_other(monkeypatch):
    windows, later = Windows(), []
    for module in (image_editor, window_areas):
        monkeypatch.setattr(module, "bpy", windows.bpy)
    monkeypatch.setattr(image_editor, "call_later", later.append)
    windows.manager.windows.append(windows.second)
    image_editor.raise_window(windows.main.screen.areas[0])
    assert later == []
    image_editor.raise_window(windows.second.screen.areas[0])
    for function in later:
        function()
    assert windows.calls == ["render 1280 WINDOW False"]  # asked of the main window; of itself it would go to the back
    windows.manager.windows.remove(windows.second)  # closed before the next turn
    later[0]()
    assert len(windows.calls) == 1


def test_windows_are_opened_nowhere_else():
    """An operator that changes the context's window may be modal."""
    folders = ("operators", "panels", "nodes", "support", "settings")
    users = {
        path.name
        for each in folders
        for path in (ROOT / each).rglob("*.py")
        if any(name in path.read_text("utf-8") for name in ("window_new", "view_show"))
    }
    assert users == {"image_editor.py"}

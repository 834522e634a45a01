"""The tab of the sidebar that is opened once after the installation."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from icymoon.operators import open_tab


class Sidebar:
    """Stands in for the region of a sidebar. Like Blender's, it knows its tabs only after it was drawn."""

    type = "UI"

    def __init__(self) -> None:
        self.tabs: set[str] = set()
        self.__dict__["tab"] = "Item"

    def tag_redraw(self) -> None:
        pass

    def __setattr__(self, name: str, value: object) -> None:
        if name == "active_panel_category":
            if value not in self.tabs:
                raise TypeError(f"enum {value} not found")
            self.__dict__["tab"] = value
        else:
            self.__dict__[name] = value


def view(width: int) -> SimpleNamespace:
    spaces = SimpleNamespace(active=SimpleNamespace(show_region_ui=False))
    return SimpleNamespace(width=width, height=100, spaces=spaces, regions=[Sidebar()], tag_redraw=lambda: None)


@pytest.fixture
def views(monkeypatch):
    small, large = view(100), view(900)
    monkeypatch.setattr(open_tab, "list_areas", lambda kind: [(None, small), (None, large)])
    monkeypatch.setattr(open_tab._RemainingTries, "left", 5)
    return small, large


def test_the_tab_of_the_largest_view_is_opened_as_soon_as_it_is_there(views):
    small, large = views
    assert open_tab.open_tab() > 0  # not drawn yet
    assert large.spaces.active.show_region_ui
    large.regions[0].tabs = {"Item", open_tab.TAB}
    assert open_tab.open_tab() is None
    assert large.regions[0].tab == open_tab.TAB
    assert not small.spaces.active.show_region_ui


def test_it_gives_up_where_the_tab_never_is(views):
    assert [open_tab.open_tab() is None for _ in range(5)] == [False] * 4 + [True]


def test_it_is_opened_once(views, monkeypatch):
    views[1].regions[0].tabs = {open_tab.TAB}
    known = SimpleNamespace(tab_was_opened=False)
    monkeypatch.setattr(open_tab, "get_preferences", lambda: known)
    assert open_tab._open_once() is None
    assert known.tab_was_opened
    views[1].spaces.active.show_region_ui = False
    open_tab._open_once()
    assert not views[1].spaces.active.show_region_ui


def test_without_preferences_nothing_is_opened(views, monkeypatch):
    monkeypatch.setattr(open_tab, "get_preferences", lambda: None)
    assert open_tab._open_once() is None
    assert not views[1].spaces.active.show_region_ui

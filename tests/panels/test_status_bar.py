"""The running job stays in the status bar, whatever Blender has shown there before."""

from __future__ import annotations

import bpy
import pytest
from icymoon.panels import menu


def functions() -> list:
    return list(getattr(bpy.types.STATUSBAR_HT_header.draw, "_draw_funcs", []))


@pytest.fixture
def removed():
    """A Blender without the extension's part of the status bar, as it is before the installation."""
    header = bpy.types.STATUSBAR_HT_header
    menu._remove_from_status_bar()
    before, had = header.draw, "_draw_orig" in vars(header)
    yield bpy.data.workspaces[0]
    menu._remove_from_status_bar()
    header.draw = before
    if not had and "_draw_orig" in vars(header):
        del header._draw_orig
    menu._append_to_status_bar()
    assert functions().count(menu._draw_status) == 1


@pytest.mark.parametrize("text", ["Installing", lambda header, context: None], ids=["text", "function"])
def test_it_stays_after_a_text_that_was_there_before_the_extension(removed, text):
    removed.status_text_set(text)
    menu._append_to_status_bar()
    removed.status_text_set(None)
    assert functions().count(menu._draw_status) == 1
    removed.status_text_set("Another")
    removed.status_text_set(None)
    assert functions().count(menu._draw_status) == 1
    menu._remove_from_status_bar()
    removed.status_text_set(None)
    assert menu._draw_status not in functions()


def test_it_stays_after_the_first_text_of_a_session(removed):
    menu._append_to_status_bar()
    removed.status_text_set("First")
    removed.status_text_set(None)
    assert functions().count(menu._draw_status) == 1

"""In a Blender without OpenImageDenoise the window says so before it builds, and when a quality is loaded."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from icymoon.nodes.build_scene import find_built
from icymoon.operators.next_step import DENOISER_OFF, find_next_step
from icymoon.operators.sidebar_text import list_quality_presets
from icymoon.settings.blender import scene_properties
from icymoon.support.blender import compat
from panel_drawing import drawn


@pytest.fixture
def without(small, monkeypatch):
    monkeypatch.setattr(compat, "has_oidn", lambda: False)
    return small


def test_a_quality_that_this_blender_cannot_render_is_told_of_at_once(without, capfd):
    assert bpy.ops.icymoon.load_preset(preset="qualities/draft") == {"FINISHED"}
    assert "built without OpenImageDenoise; set quality.denoiser to NONE" in capfd.readouterr().out
    bpy.ops.icymoon.load_preset(preset="qualities/standard")
    assert "OpenImageDenoise" not in capfd.readouterr().out


def test_the_panel_shows_which_qualities_cannot_be_had(without):
    shown = " ".join(entry[2]["text"] for entry in drawn(bpy.types.ICYMOON_PT_quality) if entry[0] == "label")
    assert shown.count("OpenImageDenoise") == 1  # for Draft and the paper's, whose buttons are grey
    assert "quality.denoiser" not in shown
    assert "lower Samples" in shown
    assert "Denoiser to None" not in shown  # which it is
    without.icymoon.quality.denoiser = "OIDN"
    shown = " ".join(entry[2]["text"] for entry in drawn(bpy.types.ICYMOON_PT_quality) if entry[0] == "label")
    assert "Denoiser to None" in shown


def test_render_is_refused_before_the_scene_is_built(without):
    without.icymoon.quality.denoiser = "OIDN"
    with pytest.raises(RuntimeError, match=r"set quality\.denoiser to NONE"):
        bpy.ops.icymoon.render_pair()
    assert find_built(without) is None


def test_the_next_step_is_another_denoiser_and_render_is_grey(without):
    bpy.ops.icymoon.build_scene()
    assert find_next_step(without) == "Next: Render Stereo Pair"
    assert bpy.ops.icymoon.render_pair.poll()
    without.icymoon.quality.denoiser = "OIDN"
    assert find_next_step(without) == DENOISER_OFF
    assert not bpy.ops.icymoon.render_pair.poll()
    (button,) = [entry for entry in drawn(bpy.types.ICYMOON_PT_main) if entry[1] == "wm.context_set_enum"]
    assert DENOISER_OFF in button
    assert bpy.ops.wm.context_set_enum(data_path="scene.icymoon.quality.denoiser", value="NONE") == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair.poll()


class _Menu:
    """Stands in for the layout of a menu and its rows: the text of each button, whether it is grey, and labels."""

    def __init__(self, buttons: dict[str, _Menu]) -> None:
        self.buttons, self.enabled, self.labels = buttons, True, list[str]()

    def row(self) -> _Menu:
        return _Menu(self.buttons)

    def label(self, text: str, icon: str) -> None:
        self.labels.append(text)

    def operator(self, name: str, text: str) -> SimpleNamespace:
        self.buttons[text] = self
        return SimpleNamespace()


def test_the_menu_of_qualities_offers_only_those_that_can_be_rendered(without):
    buttons: dict[str, _Menu] = {}
    menu = bpy.types.ICYMOON_MT_presets_qualities
    layout = _Menu(buttons)
    menu.draw(SimpleNamespace(layout=layout, kind=menu.kind), SimpleNamespace(scene=without))
    grey = {text for text, place in buttons.items() if not place.enabled}
    shown = list_quality_presets(scene_properties.read_settings(without.icymoon))
    assert grey == {each.title for each in shown if each.lacks}
    assert "Draft" in grey
    assert len(grey) < len(buttons)
    assert layout.labels == ["Grey: This Blender was built without OpenImageDenoise"]


def test_a_scene_that_wants_a_denoiser_is_built_and_f12_has_none(without):
    without.icymoon.quality.denoiser = "OIDN"
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert without.render.engine == "CYCLES"
    assert not without.cycles.use_denoising

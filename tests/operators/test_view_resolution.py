"""The lit view has larger pixels until it rests; the user's come back where they take little time, and with Clear."""

from __future__ import annotations

import bpy
import pytest
from icymoon.operators import view_resolution


class Clocks:
    """The clock and the processor's, as a test sets them."""

    def __init__(self) -> None:
        self.now = self.busy = 0.0

    def monotonic(self) -> float:
        return self.now

    def process_time(self) -> float:
        return self.busy

    def pass_s(self, seconds: float, busy: float) -> None:
        """Let seconds pass in which this part of a processor is busy."""
        self.now, self.busy = self.now + seconds, self.busy + busy * seconds


@pytest.fixture
def clocks(small, monkeypatch):
    """A small scene to be built in a window whose view is lit."""
    found = Clocks()
    monkeypatch.setattr(view_resolution, "has_window", lambda: True)
    monkeypatch.setattr(view_resolution, "_is_traced", lambda scene: True)
    monkeypatch.setattr(view_resolution, "time", found)
    yield found
    view_resolution.unregister()
    view_resolution.register()


def pixels() -> str:
    return bpy.context.scene.render.preview_pixel_size


@pytest.mark.parametrize(("seconds", "rested"), [(10, "AUTO"), (60, "2")])
def test_a_view_that_rests_gets_the_user_s_pixels_if_they_are_fast(clocks, seconds, rested):
    """64 paths for a quarter of the pixels in 60 s: one for all of them takes 3.8 s, in 10 s 0.6 s."""
    bpy.ops.icymoon.build_scene()
    assert pixels() == "2"
    for _ in range(seconds):
        clocks.pass_s(1, busy=1.7)
        assert view_resolution._refine_resting_view()  # asked again
        assert pixels() == "2"
    clocks.pass_s(1, busy=0.01)
    assert view_resolution._refine_resting_view() is None
    assert pixels() == rested
    assert view_resolution.is_coarse(bpy.context.scene) == (rested == "2")
    bpy.ops.icymoon.clear_scene()
    assert pixels() == "AUTO"


def test_what_is_not_traced_is_not_measured(clocks, monkeypatch):
    bpy.ops.icymoon.build_scene()
    monkeypatch.setattr(view_resolution, "_is_traced", lambda scene: False)
    clocks.pass_s(100, busy=0.0)
    assert view_resolution._refine_resting_view()
    assert pixels() == "2"


@pytest.mark.parametrize("chosen", ["1", "4"])
def test_a_choice_of_the_user_stays(clocks, chosen):
    bpy.ops.icymoon.build_scene()
    bpy.context.scene.render.preview_pixel_size = chosen  # after the build
    bpy.ops.icymoon.build_scene()
    assert pixels() == chosen
    bpy.ops.icymoon.clear_scene()
    assert pixels() == chosen
    bpy.ops.icymoon.build_scene()
    assert pixels() == ("2" if chosen == "1" else "4")  # larger ones stay
    bpy.ops.icymoon.clear_scene()
    assert pixels() == chosen


def test_a_graphics_card_traces_the_user_s_pixels(clocks, small):
    small.icymoon.quality.device = "GPU"
    bpy.ops.icymoon.build_scene()
    assert small.cycles.device == "GPU"
    assert pixels() == "AUTO"


@pytest.mark.parametrize("evil", ["", "AUTO", "rm 2", "8 2 2", 7])
def test_a_note_of_a_file_that_means_nothing_changes_nothing(clocks, small, evil):
    bpy.ops.icymoon.build_scene()
    collection = next(c for c in bpy.data.collections if c.get("icymoon") == "scene")
    collection[view_resolution._CHOICE_PROPERTY] = evil
    assert bpy.ops.icymoon.clear_scene() == {"FINISHED"}
    assert pixels() == "2"


@pytest.mark.parametrize(("albedo", "shown"), [(0.3, "2"), (None, "AUTO")])
def test_undo_that_changes_a_setting_shows_larger_pixels_first(clocks, albedo, shown):
    bpy.ops.icymoon.build_scene()
    clocks.pass_s(10, busy=0.01)
    view_resolution._refine_resting_view()
    assert pixels() == "AUTO"
    view_resolution._note_settings()
    if albedo is not None:
        bpy.context.scene.icymoon.surface.albedo = albedo
    view_resolution._follow_undo()
    assert pixels() == shown

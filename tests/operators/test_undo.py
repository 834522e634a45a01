"""What Ctrl Z takes back: a step for everything that changes the file. The window's tests press the keys."""

from __future__ import annotations

import pytest
from icymoon.operators import CLASSES, render
from icymoon.operators.job_operators import JobOperator
from icymoon.settings.blender import scene_properties

#: Operators that change files, processes and windows, but nothing that a .blend file holds.
CHANGE_NOTHING = {
    "save_settings",
    "show_roughness",
    "trade",
    "measure_machine",
    "plan_dry_run",
    "open_report",
    "check_evaluator",
    "install_evaluator",
    "remove_evaluator",
    "cancel",
    "add_matcher",
    "remove_matcher",
    "save_plan",
    "save_trajectory",
    "write_calibration",
    "open_manual",
    "wait",
    "make_asset_library",
    "remove_asset_library",
    "show_ends",
    "evaluate_folder",
    "decide",
    "decide_by_rules",
    "decide_with_guarantee",
    "reproduce",
    "export_pairs",
    "scan_lidar",
}
#: Operators that go on when what they change is changed, and take the step then.
TAKE_THEIR_OWN = {
    "render_pair",
    "render_dataset",
    "watch_dataset",
    "evaluate",
    "expose",
    "show_error",
    "show_last_pair",
    "show_pair",
    "render_variations",
    "show_curve",
    "show_trade",
}


@pytest.fixture
def pushed(monkeypatch):
    """The undo steps that operators take by themselves."""
    steps: list[str] = []
    monkeypatch.setattr(render, "push_undo", steps.append)
    return steps


def test_every_operator_that_changes_the_file_is_a_step_of_its_own():
    without = {
        cls.bl_idname.removeprefix("icymoon.") for cls in CLASSES if "UNDO" not in getattr(cls, "bl_options", ())
    }
    assert without == CHANGE_NOTHING | TAKE_THEIR_OWN


def test_no_operator_that_starts_a_process_can_be_done_again_with_other_options():
    assert [
        cls.bl_idname
        for cls in CLASSES
        if issubclass(cls, JobOperator) and "REGISTER" in getattr(cls, "bl_options", ())
    ] == []


def test_a_render_that_builds_the_scene_is_a_step_and_one_that_does_not_is_none(small, pushed):
    settings = scene_properties.read_settings(small.icymoon)
    render.bring_up_to_date(small, settings)
    assert pushed == ["Build Scene"]
    render.bring_up_to_date(small, settings)
    assert pushed == ["Build Scene"]
    small.icymoon.terrain.rms_slope_deg += 1.0
    render.bring_up_to_date(small, scene_properties.read_settings(small.icymoon))
    assert pushed == ["Build Scene"] * 2

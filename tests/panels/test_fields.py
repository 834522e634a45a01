"""A button that starts a job is another button while a job runs, or Blender would keep it grey under the mouse."""

from __future__ import annotations

import bpy
import pytest
from icymoon.operators import jobs
from icymoon.panels import fields
from icymoon.panels.sidebar import ICYMOON_PT_evaluation, ICYMOON_PT_main, ICYMOON_PT_plan
from panel_drawing import Layout, drawn
from stand_ins import stand_in

#: Operators that start a job.
STARTING = {f"icymoon.{name}" for name in ("render_pair", "evaluate", "evaluate_folder", "render_dataset",
                                              "render_variations", "show_ends")}


@pytest.fixture
def running(monkeypatch):
    process = stand_in(running=True, cancelled=False, stop=lambda: None, cancel=lambda: None)
    monkeypatch.setattr(jobs, "current", jobs.Job("Render Data Set", process, lambda message: None, lambda: None))


def buttons(*panels: type) -> list[tuple[str, str]]:
    return [entry[1:] for panel in panels for entry in drawn(panel) if entry[0] == "operator"]


@pytest.mark.usefixtures("scene")
def test_the_same_texts_are_there_while_a_job_runs_but_start_nothing(request):
    panels = ICYMOON_PT_main, ICYMOON_PT_evaluation, ICYMOON_PT_plan, bpy.types.ICYMOON_PT_vary
    free = buttons(*panels)
    assert {name for name, _ in free} >= STARTING
    request.getfixturevalue("running")
    busy = buttons(*panels)
    assert not {name for name, _ in busy} & STARTING
    assert {text for name, text in busy if name == "icymoon.wait"} == {
        text for name, text in free if name in STARTING}
    assert not bpy.ops.icymoon.wait.poll()


@pytest.mark.usefixtures("scene")
def test_the_texts_are_the_operators_own_where_there_is_one_button():
    for name in STARTING - {"icymoon.evaluate", "icymoon.evaluate_folder"}:
        label = getattr(bpy.ops.icymoon, name.partition(".")[2]).get_rna_type().name
        assert (name, label) in buttons(ICYMOON_PT_main, ICYMOON_PT_plan, bpy.types.ICYMOON_PT_vary)


def test_a_button_gets_its_properties():
    record: list = []
    fields.draw_start(Layout(record), "icymoon.evaluate", "Evaluate", scope="DATASET")
    assert record == [("operator", "icymoon.evaluate", "Evaluate")]
    with pytest.raises(KeyError):
        fields.draw_start(Layout([]), "icymoon.evaluate", "Evaluate", missing=1)

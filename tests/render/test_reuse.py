"""What Cycles keeps from one pair to the next, by what it says while it renders."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import bpy
import pytest
from icymoon.render import truth_without_light
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from
from plans import planned


@contextmanager
def heard() -> Iterator[list[str]]:
    """What Cycles says meanwhile, across new files."""
    said: list[str] = []

    @bpy.app.handlers.persistent
    def listen(*arguments: object) -> None:
        said.append(str(arguments[0]))

    bpy.app.handlers.render_stats.append(listen)
    try:
        yield said
    finally:
        bpy.app.handlers.render_stats.remove(listen)


def trees(pairs: list[PlannedPair], folder: Path) -> list[bool]:
    """Whether Cycles built its tree of triangles for each of these pairs, rendered one after the other."""
    built: list[bool] = []

    def say(kind: str, **facts: object) -> None:
        if kind == "pair":
            built.append(any("Building BVH" in line for line in said))
            said.clear()

    with heard() as said, ScenesFromSettings(lambda warning: None) as stage:
        render_from(stage, pairs, folder, say)
    return built


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("scene", [{}, {"rocks": {"coverage": 0.05}}])
def test_another_camera_builds_no_tree_of_triangles(scene, tmp_path, monkeypatch):
    """Heading, site, lens, frame and noise change; the ground's material, in between, is another scene to Cycles.

    So it is where depth is rendered without surfaces, which is done only where it saves more time than the tree takes.
    And lamps that go out and on again let Cycles join the trees of its meshes anew.
    """
    monkeypatch.setattr(truth_without_light, "MAX_TRIANGLES_PER_PIXEL", 0)
    monkeypatch.setattr(truth_without_light, "switch_lights_off", lambda scene: nullcontext())
    cameras = (
        {},
        {"rig": {"heading_deg": 50.0}},
        {"rig": {"x_m": 1.0, "pitch_deg": 30.0, "focal_length_mm": 20.0}},
        {"rig": {"width_px": 40, "baseline_m": 0.5, "overscan": 0.1}},
        {"quality": {"samples": 3}},
    )
    pairs = [planned(scene, change) for change in cameras]
    other = planned(scene, {"surface": {"albedo": 0.5}})
    assert trees([*pairs, other], tmp_path) == [True, False, False, False, False, True]


def test_nothing_of_a_take_is_left_in_the_camera_of_the_next(tmp_path):
    turned = {
        "rig": {
            "toe_in_deg": 4.0,
            "overscan": 0.2,
            "focus_distance_m": 1.0,
            "roll_deg_s": 5.0,
            "motion_exposure_s": 0.1,
            "principal_x_px": 3.0,
        }
    }
    pairs = [planned(turned), planned({"rig": {"heading_deg": 20.0}}), planned(turned, {"rig": {"pitch_deg": 60.0}})]
    for name, stages in (("shared", [pairs]), ("alone", [[pair] for pair in pairs])):
        for together in stages:
            with ScenesFromSettings(lambda warning: None) as stage:
                render_from(stage, together, tmp_path / name, lambda *a, **k: None)
    made = {
        name: {
            file.relative_to(tmp_path / name): file.read_bytes()
            for file in sorted((tmp_path / name).glob("pairs/*/*.exr"))
        }
        for name in ("shared", "alone")
    }
    assert len(made["alone"]) == 2 * 6 + 2
    assert made["shared"] == made["alone"]

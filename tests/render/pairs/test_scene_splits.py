"""Scenes and splits: what makes a scene another one, and that later versions move none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.pairs.pair_folder import Pair
from icymoon.render.pairs.scene_splits import name_scene
from icymoon.settings.description import defaults, merged
from icymoon.settings.table import TOPICS, list_all_settings


def pair(**changes) -> Pair:
    """A pair of the values that older versions had, and changes."""
    settings = merged(defaults(), *({topic: {s.key: s.old_value}} for topic, s in list_all_settings()), changes)
    return Pair(Path(), "0" * 12, settings, StereoCamera.from_settings(settings.rig), {})


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({"light": {"sun_elevation_deg": 3.0}}, True),
        ({"rig": {"heading_deg": 90.0}}, True),
        ({"surface": {"albedo": 0.2}}, True),
        ({"quality": {"samples": 7}}, True),
        ({"dataset": {"seed": 99}}, False),
        ({"terrain": {"hurst": 0.31}}, False),
        ({"rocks": {"coverage": 0.02}}, False),
        ({"terrain": {"variant": 3}}, False),
    ],
)
def test_only_the_shape_of_ground_and_rocks_makes_another_scene(changes, same):
    assert (name_scene(pair(**changes)) == name_scene(pair())) == same


def test_a_setting_of_a_later_version_moves_no_scene(monkeypatch):
    """A setting counts in no scene where it has the value that stands for versions without it."""
    old = name_scene(pair())
    terrain = TOPICS["terrain"]
    monkeypatch.setitem(
        TOPICS,
        "terrain",
        replace(terrain, settings=tuple(replace(s, before=5) if s.key == "variant" else s for s in terrain.settings)),
    )
    assert name_scene(pair(terrain={"variant": 5})) == old
    assert name_scene(pair(terrain={"variant": 0})) != old

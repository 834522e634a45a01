"""Fallen frost in Cycles against its law: tilted plates in even light, and the node tree without it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from icymoon.benchmarks.light import furnace
from icymoon.nodes.surface.ice_material import build_material
from icymoon.nodes.surface.sheltered_ground import SHELTERED
from icymoon.physics.surfaces.fallen_frost import fallen_share
from icymoon.settings.description import check, defaults
from icymoon.settings.topics.surfaces import SurfaceSettings
from icymoon.support.labels import TERRAIN
from rendering import empty_scene

DARK = {"albedo": 0.2, "specular": 0.0, "frost_albedo": 0.9, "frost_patch_m": 0.1, "grain_amplitude_m": 0.0}


def surface(**changes: Any) -> SurfaceSettings:
    return defaults().surface | check({"surface": {**DARK, "frost_from": "FALL", **changes}}, "test").surface


def seen(
    settings: SurfaceSettings, tilt_deg: float, azimuth_deg: float, view_m: float, sheltered: float = 0.0
) -> float:
    """Radiance in even light of a plate that slopes down toward a direction, seen from straight above it."""
    scene = empty_scene()
    scene.render.engine, scene.cycles.samples = "CYCLES", 32
    scene.world = furnace.shining()
    furnace.plane(scene, "Plate", 0.0, 100.0, build_material("Test", settings, 1, TERRAIN))
    # About x by a negative angle the normal leans north; then it is turned from north over east.
    scene.objects["Plate"].rotation_euler = (-math.radians(tilt_deg), 0.0, -math.radians(azimuth_deg))
    if sheltered:
        mark = scene.objects["Plate"].data.attributes.new(SHELTERED, "FLOAT", "POINT")
        mark.data.foreach_set("value", np.full(4, sheltered, np.float32))
    return float(furnace.radiance(scene, 0.0, view_m, 64).mean())


def normal_of(tilt_deg: float, azimuth_deg: float) -> np.ndarray:
    tilt, azimuth = math.radians(tilt_deg), math.radians(azimuth_deg)
    return np.array([[math.sin(tilt) * math.sin(azimuth), math.sin(tilt) * math.cos(azimuth), math.cos(tilt)]])


@pytest.mark.parametrize(
    ("tilt", "azimuth"), [(0.0, 0.0), (30.0, 60.0), (30.0, 240.0), (50.0, 150.0), (70.0, 60.0), (80.0, 0.0)]
)
def test_a_plate_has_the_share_of_the_law_and_the_albedo_of_the_mixture(tilt, azimuth):
    settings = surface(frost_share=0.7, frost_tilt_deg=35.0, frost_azimuth_deg=60.0)
    share = fallen_share(settings, normal_of(tilt, azimuth))[0]
    # The noise is nearly normal: patches cover their share within 0.03.
    assert seen(settings, tilt, azimuth, 10.0) == pytest.approx(0.2 + 0.7 * share, abs=0.03 * 0.7)


@pytest.mark.parametrize("sheltered", [0.5, 1.0])
def test_ground_that_others_shelter_has_the_share_of_the_grains_that_arrive(sheltered):
    settings = surface(frost_share=0.7)
    share = fallen_share(settings, normal_of(0.0, 0.0), 1.0 - sheltered)[0]
    assert seen(settings, 0.0, 0.0, 10.0, sheltered) == pytest.approx(0.2 + 0.7 * share, abs=0.03 * 0.7)


def test_where_all_grains_hold_patches_leave_nothing_free():
    assert seen(surface(frost_share=1.0), 0.0, 0.0, 0.5) == pytest.approx(0.9, rel=0.01)


def test_the_origin_of_frost_changes_nothing_without_frost_and_no_node_of_other_frost():
    def nodes(**changes: Any) -> list[tuple[str, str, list[Any]]]:
        empty_scene()
        tree = build_material("Test", surface(**changes), 1, TERRAIN).node_tree
        return [
            (
                node.name,
                node.bl_idname,
                [
                    list(s.default_value) if hasattr(s.default_value, "__len__") else s.default_value
                    for s in node.inputs
                    if hasattr(s, "default_value")
                ],
            )
            for node in tree.nodes
        ]

    assert nodes() == nodes(frost_from="VAPOUR")
    other = {"frost_share": 0.5, "frost_from": "VAPOUR"}
    assert nodes(**other) == nodes(**other, frost_tilt_deg=30.0, frost_azimuth_deg=50.0, frost_hold_deg=70.0)
    assert nodes(frost_share=0.5) == nodes(frost_share=0.5)
    assert nodes(frost_share=0.5) != nodes(**other)

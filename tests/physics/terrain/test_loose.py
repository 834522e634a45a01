"""The thickness of loose material: what mantle and skirts add to the ground, on the map and at vertices."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from icymoon.physics.mesh import graded_mesh
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.terrain.terrain import Terrain, make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.scene import Settings

#: Ground with a mantle, skirts, landforms and a regional slope, so that only the first two count.
BURIED: dict[str, dict[str, Any]] = {
    "terrain": {"size_m": 8.0, "regional_slope_deg": 7.0},
    "mantle": {"thickness_m": 0.15, "length_m": 2.0},
    "craters": {"coverage": 0.1},
    "rocks": {"coverage": 0.15, "smallest_m": 0.1, "skirt": 0.3},
    "quality": {"loose_thickness": True},
}

FINE = {"kind": "GRADED", "most": 60000, "farthest_m": 100.0, "error_px": 4.0, "edge_px": 24.0, "seen": "FINE"}


def described(*changes: dict[str, dict[str, Any]]) -> Settings:
    return merged(defaults(), BURIED, *changes)


def bared(ground: Terrain) -> Terrain:
    return replace(ground, mantle_thickness_m=0.0, skirts=None)


@pytest.mark.parametrize("without", [{}, {"mantle": {"thickness_m": 0.0}}, {"rocks": {"skirt": 0.0}}])
@pytest.mark.parametrize("shortest", [0.0, "each"])
def test_the_ground_is_the_hard_ground_and_its_loose_material(without, shortest):
    ground = make_terrain(described(without), 3)
    x, y = np.random.default_rng(1).uniform(-4.0, 4.0, (2, 3000))
    carried = np.linspace(0.01, 0.3, 3000) if shortest == "each" else 0.0
    loose = ground.measure_loose(x, y, carried)
    assert ground.heights(x, y, carried) - bared(ground).heights(x, y, carried) == pytest.approx(loose, abs=1e-12)
    assert loose.min() >= 0.0
    assert loose.max() > 0.02
    assert (loose == 0.0).mean() < 0.99


def test_ground_without_mantle_and_skirts_is_hard():
    ground = make_terrain(described({"mantle": {"thickness_m": 0.0}, "rocks": {"skirt": 0.0}}), 3)
    x, y = np.random.default_rng(1).uniform(-4.0, 4.0, (2, 500))
    assert not ground.measure_loose(x, y).any()


def test_the_vertices_of_a_graded_mesh_have_the_thickness_by_which_it_is_raised():
    settings = described({"mesh": FINE | {"seen": "EVEN"}, "surface": {"relief": "BUMP"}})
    graded = grade_ground(make_terrain(settings, 3), settings)
    made, bare = (ground.mesh_with_relief() for ground in (graded, replace(graded, ground=bared(graded.ground))))
    assert (made.positions[:, :2] == bare.positions[:, :2]).all()
    assert made.positions[:, 2] - bare.positions[:, 2] == pytest.approx(made.loose_m, abs=1e-9)
    assert made.loose_m.max() > 0.05


def test_finer_ground_in_view_has_the_thickness_by_which_it_is_raised(monkeypatch):
    """Also on the straight edges between whole and cut triangles. Both meshes have the same triangles, because the view
    is taken on the map."""
    monkeypatch.setattr(graded_mesh, "is_in_view", lambda rig, east, north, above: (north > 0) & (abs(east) < north))
    settings = described({"mesh": FINE})
    graded = grade_ground(make_terrain(settings, 3), settings)
    made, bare = (ground.mesh_with_relief() for ground in (graded, replace(graded, ground=bared(graded.ground))))
    assert made.fine.any()
    assert (made.faces == bare.faces).all()
    assert made.positions[:, 2] - bare.positions[:, 2] == pytest.approx(made.loose_m, abs=1e-9)


def test_only_ground_that_is_asked_for_it_measures_it():
    settings = described({"mesh": FINE, "quality": {"loose_thickness": False}})
    graded = grade_ground(make_terrain(settings, 3), settings)
    assert graded.mesh_with_relief().loose_m is None

"""Troughs of a stated width: which ground the mark of dirt counts as low."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.nodes.ground.terrain_mesh import build_mesh_from_arrays
from icymoon.nodes.surface.patches_and_grain import ELEVATION, mark_elevation
from icymoon.nodes.tree.evaluate_field import read_numbers
from icymoon.physics.scene_requirements import find_elevation_mark
from icymoon.settings import rebuilt_parts
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.topics.surfaces import SurfaceSettings
from icymoon.support.arrays import Array
from rendering import empty_scene

SIDE = 201
AXIS = np.linspace(-10.0, 10.0, SIDE)
EAST, NORTH = (each.ravel() for each in np.meshgrid(AXIS, AXIS))
#: Small hollows, 1 m apart, in one wide and deep valley.
HOLLOWS_M = 0.05 * np.cos(2 * np.pi * EAST) * np.cos(2 * np.pi * NORTH)
VALLEY_M = -2.0 * np.exp(-((EAST / 5.0) ** 2))


def marked(surface: SurfaceSettings) -> Array:
    empty_scene()
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    faces = np.stack([corner, corner + 1, corner + SIDE + 1, corner + SIDE], axis=1).astype(np.int32)
    positions = np.stack([EAST, NORTH, HOLLOWS_M + VALLEY_M], axis=1).astype(np.float32)
    mesh = build_mesh_from_arrays("Valley", positions, faces)
    mark_elevation(mesh, surface)
    values = read_numbers(mesh, ELEVATION)
    assert values is not None
    return values


def soiled(width_m: float) -> SurfaceSettings:
    return defaults().surface | check({"surface": {"trough_dirt": 0.5, "trough_width_m": width_m}}, "test").surface


def correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])


def test_troughs_of_a_width_are_hollows_of_that_width():
    """The width selects one of two sizes of low ground; without it the deeper one counts."""
    everywhere, local = marked(soiled(0.0)), marked(soiled(1.0))
    assert correlation(everywhere, VALLEY_M) > 0.95
    assert abs(correlation(everywhere, HOLLOWS_M)) < 0.1
    assert correlation(local, HOLLOWS_M) > 0.9
    assert abs(correlation(local, VALLEY_M)) < 0.2
    # Standard deviations; the valley curves enough to add a little.
    assert local.std() == pytest.approx(1.0, abs=0.02)


def test_a_new_width_marks_the_ground_anew_and_no_width_leaves_it_as_before():
    without, wide = (merged(defaults(), {"surface": {"trough_dirt": 0.5, "trough_width_m": w}}) for w in (0.0, 2.0))
    assert find_elevation_mark(without.surface) is True
    assert rebuilt_parts.select_scene(without) != rebuilt_parts.select_scene(wide)
    clean = merged(defaults(), {"surface": {"trough_width_m": 2.0}})
    assert rebuilt_parts.select_scene(clean) == rebuilt_parts.select_scene(defaults())

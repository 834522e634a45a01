"""Broken walls: chips by place in three dimensions, on a mesh that stays closed, only where walls are seen."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.mesh.break_walls import break_walls, scoop_depth, wall_steepness
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.terrain.landforms import Walls
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings import rebuilt_parts
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.declaration import Parts

WALLS = Walls(1.0, 7)
#: Plates with steep sides before a small camera.
PLATES: Parts = {
    "terrain": {"rms_slope_deg": 0.0},
    "chaos": {"relief_m": 1.0, "plate_m": 3.0, "edges": "BROKEN"},
    "surface": {"grain_amplitude_m": 0.0},
    "rig": {"width_px": 120, "height_px": 90},
    "mesh": {"error_px": 4.0, "farthest_m": 40.0, "most": 60_000},
}


def _cliff(n=41, spacing_m=0.05):
    """A plain, a wall of 80 degrees, 1 m high, and a plain: positions, triangles and spacings of a grid."""
    x, y = np.meshgrid(spacing_m * np.arange(n), spacing_m * np.arange(n))
    z = np.clip((x - 0.9) * np.tan(np.radians(80.0)), 0.0, 1.0)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)[None, :]).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + n + 1], 1), np.stack([corner, corner + n + 1, corner + n], 1)]
    ).astype(np.int32)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, np.full(n * n, spacing_m)


def _edge_uses(faces):
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)


def _meshed(*changed):
    settings = merged(defaults(), PLATES, *changed)
    return grade_ground(make_terrain(settings, 1), settings), settings


def test_scoops_are_continuous_and_differ_in_all_directions():
    random = np.random.default_rng(1)
    at = random.uniform(-20, 20, (4000, 3))
    depth = scoop_depth(at, 3)
    assert depth.min() >= 0.0
    assert 0.3 < depth.mean() < 1.0
    assert depth.std() > 0.1  # as deep from edge to middle as the least of them
    assert depth.max() < 1.4
    for axis in np.eye(3):
        # A bowl's slope is at most 0.45 + 2 * 1.3 * sqrt(3), at the far corner of a cell.
        assert np.abs(scoop_depth(at + 1e-4 * axis, 3) - depth).max() < 5e-4
        assert abs(np.corrcoef(scoop_depth(at + 2.0 * axis, 3), depth)[0, 1]) < 0.1
    assert np.array_equal(scoop_depth(at, 3), depth)
    assert not np.array_equal(scoop_depth(at, 4), depth)


@pytest.mark.parametrize("most", [100_000, 4000, 1681])
def test_a_broken_wall_is_closed_shorter_sided_and_within_the_stated_number_of_vertices(most):
    positions, faces, spacing = _cliff()
    broken = break_walls(positions, faces, WALLS, spacing, np.full(len(positions), 0.01), most)
    edges, uses = _edge_uses(broken.faces)
    assert len(broken.positions) <= most
    assert uses.max() == 2
    # The border is what it was: 4 sides of 40 edges, none of which is cut or moved.
    assert (uses == 1).sum() == 160
    on_border = np.unique(edges[uses == 1])
    assert np.array_equal(broken.positions[on_border], positions[on_border])
    assert broken.of_face.shape == (len(broken.faces),)
    if most == 100_000:  # sides of 3 pixels at most, but for what chips stretch; those at the border stay long
        sides = broken.positions[edges]
        inner = ((sides[..., 2] > 0.1) & (sides[..., 2] < 0.9) & (np.abs(sides[..., 1] - 1.0) < 0.85)).all(axis=1)
        assert np.quantile(np.linalg.norm(sides[inner, 0] - sides[inner, 1], axis=1), 0.99) < 0.05


def test_chips_go_into_the_ice_and_differ_from_top_to_bottom():
    """Along a wall of even slope, a height field has one depth from rim to foot; scoops have an RMS of its own."""
    positions, faces, spacing = _cliff()
    broken = break_walls(positions, faces, WALLS, spacing, np.full(len(positions), 0.01), 100_000)
    x, y, z = broken.positions.T
    inner = (z > 0.3) & (z < 0.7) & (y > 0.3) & (y < 1.7)
    depth = (x - 0.9) * np.sin(np.radians(80.0)) - z * np.cos(np.radians(80.0))
    assert depth[inner].min() > -1e-3  # smoothing leaves the middle of a wall
    # The deepest scoops of the three sizes: a quarter of their width, and at most 1.4 of that.
    assert depth[inner].max() < 0.25 * 1.4 * (0.5 + 0.2 + 0.08)
    column = np.floor(y[inner] / 0.1).astype(int)
    mean = np.bincount(column, depth[inner]) / np.maximum(np.bincount(column), 1)
    within = np.sqrt(np.mean((depth[inner] - mean[column]) ** 2))
    assert within > 0.01
    flat = (positions[:, 0] < 0.5) | (positions[:, 0] > 1.5)
    assert np.array_equal(broken.positions[: len(positions)][flat], positions[flat])


def test_what_is_not_seen_stays_as_it_is():
    positions, faces, spacing = _cliff()
    broken = break_walls(positions, faces, WALLS, spacing, np.full(len(positions), np.inf), 100_000)
    assert np.array_equal(broken.positions, positions)
    assert np.array_equal(broken.faces, faces)


def test_steepness_rises_from_ground_to_wall():
    normals = np.array([[np.sin(a), 0.0, np.cos(a)] for a in np.radians([0.0, 51.0, 60.0, 69.0, 90.0])])
    assert wall_steepness(5.0 * normals)[[0, 1, 3, 4]].tolist() == [0, 0, 1, 1]
    assert 0.2 < wall_steepness(normals)[2] < 0.8


def test_walls_of_plates_are_broken_where_it_is_asked_for_and_within_the_limit():
    broken, settings = _meshed({"mesh": {"walls": "BROKEN"}})
    plain, _ = _meshed()
    made, before = broken.mesh_with_relief(), plain.mesh_with_relief()
    assert broken.breaks_walls
    assert not plain.breaks_walls
    assert before.positions.shape[0] < made.positions.shape[0] <= settings.mesh.most
    _, uses = _edge_uses(made.faces)
    assert uses.max() == 2


@pytest.mark.parametrize(
    "change",
    [
        {"chaos": {"edges": "ROUNDED"}},
        {"chaos": {"relief_m": 0.0}},
        {"mesh": {"walls": "FLUTED"}},
        {"mesh": {"kind": "GRID"}},
    ],
    ids=str,
)
def test_the_mesh_depends_on_the_heading_only_with_broken_walls(change):
    broken = {"mesh": {"walls": "BROKEN"}}

    def scene(*changed):
        return rebuilt_parts.select_scene(merged(defaults(), PLATES, broken, *changed))

    turned = {"rig": {"heading_deg": 30.0}}
    assert scene() != scene(turned)
    assert scene(change) == scene(change, turned)

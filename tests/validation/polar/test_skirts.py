"""The sand in a scan is told from its rock by slope and height, and the sand of a terrain is measured by it."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.validation.polar.data_set import Rock, Terrain
from icymoon.validation.polar.sand import measure_sand
from icymoon.validation.polar.skirts import BOUND_M, REPOSE_DEG, find_skirt, fit_rim_plane

#: Spacing of the vertices of a scan, half its width, and radius of its rock, in metres.
_STEP_M, _HALF_M, _ROCK_M = 0.004, 0.1, 0.05


def _scan(height, keep=None):
    """A scan whose height is a function of the distance from its middle; of its triangles those are kept whose middles
    have ``keep`` of the distance."""
    line = np.arange(-_HALF_M, _HALF_M + _STEP_M / 2, _STEP_M)
    x, y = np.meshgrid(line, line)
    n = len(line)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)[None]).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + n + 1], axis=1), np.stack([k, k + n + 1, k + n], axis=1)])
    vertices = np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])
    if keep is not None:
        faces = faces[keep(_from_middle(vertices, faces))]
    return vertices, faces


def _from_middle(vertices, faces):
    return np.hypot(*vertices[faces].mean(axis=1)[:, :2].T)


def _stone(x, y, slope_deg=65.0, top_m=0.08):
    """A truncated cone on level ground."""
    return np.clip((_ROCK_M - np.hypot(x, y)) * np.tan(np.radians(slope_deg)), 0.0, top_m)


def _near_the_foot(vertices, faces):
    # Normals are averaged over two triangles to each side, of 4 mm.
    return np.abs(_from_middle(vertices, faces) - _ROCK_M) < 3.5 * _STEP_M


@pytest.mark.parametrize("tilt", [0.0, 0.2, -0.3])
def test_sand_and_rock_of_a_scan_are_told_apart(tilt):
    vertices, faces = _scan(lambda x, y: _stone(x, y) + tilt * x)
    sure = ~_near_the_foot(vertices, faces)
    sand = _from_middle(vertices, faces) > _ROCK_M
    skirt = find_skirt(vertices, faces)
    assert np.array_equal(skirt[sure], sand[sure])
    assert np.mean(skirt == sand) > 0.9
    # A scan that is wound the other way has the same sand.
    assert np.array_equal(find_skirt(vertices, faces[:, ::-1]), skirt)


def test_sand_lies_up_to_its_angle_of_repose():
    vertices, faces = _scan(lambda x, y: _stone(x, y, REPOSE_DEG - 3, 0.03))
    assert find_skirt(vertices, faces).all()  # a heap
    vertices, faces = _scan(lambda x, y: _stone(x, y, REPOSE_DEG + 3, 0.03))
    side = np.abs(_from_middle(vertices, faces) - 0.03) < 0.005
    assert not find_skirt(vertices, faces)[side].any()


def test_the_top_of_a_rock_is_no_sand_though_a_hole_touches_it():
    def height(x, y):
        return _stone(x, y, 75.0, 1.5 * BOUND_M)

    vertices, faces = _scan(height, lambda off: off > 0.01)
    top = _from_middle(vertices, faces) < 0.025
    assert not find_skirt(vertices, faces)[top].any()
    # A ledge that no edge of the scan reaches is no sand, though it is as low and as flat.
    vertices, faces = _scan(lambda x, y: _stone(x, y, 75.0, 0.5 * BOUND_M))
    top = _from_middle(vertices, faces) < 0.025
    assert top.any()
    assert not find_skirt(vertices, faces)[top].any()


def test_a_closed_scan_has_no_sand():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float) * 0.1
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert not find_skirt(corners, faces).any()
    assert len(Rock(0, corners, faces).rim) == 4


def test_a_rim_that_runs_up_its_rock_does_not_lift_its_plane():
    random = np.random.default_rng(3)
    xy = random.uniform(-0.1, 0.1, (200, 2))
    z = 0.2 + 0.1 * xy[:, 0] - 0.05 * xy[:, 1]
    z[:60] += random.uniform(0.03, 0.1, 60)
    # The robust weights leave a point 3 cm above the plane 3e-4 of the weight of the others.
    assert fit_rim_plane(np.column_stack([xy, z]), np.zeros(2)) == pytest.approx([0.2, 0.1, -0.05], abs=2e-3)


def _terrain(lift=0.0):
    """Nine stones on a plane, the middle one's ground raised by ``lift`` metres."""
    rocks = []
    for k, (i, j) in enumerate(np.ndindex(3, 3)):
        vertices, faces = _scan(_stone)
        east, north = (i - 1) * 0.8, (j - 1) * 0.8
        raised = 0.17 + 0.02 * east - 0.01 * north + (lift if k == 4 else 0.0)
        slope = 0.02 * vertices[:, 0] - 0.01 * vertices[:, 1]
        vertices += [east, north, raised]
        vertices[:, 2] += slope
        rocks.append(Rock(k, vertices, faces))
    return Terrain("07", tuple(rocks), {})


def test_the_sand_is_measured_by_the_scans():
    sand = measure_sand(_terrain())
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21)), axis=-1).reshape(-1, 2)
    assert sand.heights(grid) == pytest.approx(0.17 + grid @ [0.02, -0.01], abs=5e-4)
    lifted = measure_sand(_terrain(0.02))
    # A height at a rock is known to 4 mm where sand spreads by 14 mm: 1 / (1 + 0.08) of it is left.
    assert lifted.heights(np.zeros((1, 2))) == pytest.approx(0.17 + 0.02 / 1.08, abs=1e-3)
    far = np.array([[0.8, 0.8], [-0.8, 0.8]])
    assert lifted.heights(far) == pytest.approx(0.17 + far @ [0.02, -0.01], abs=2e-3)
    high = measure_sand(_terrain(0.1))
    assert np.abs(high.offs).max() == BOUND_M
    assert np.abs(high.heights(grid) - high.on_plane(grid)).max() <= BOUND_M + 1e-12


def test_what_is_seen_of_a_scan_is_its_rock():
    terrain = _terrain()
    sand = measure_sand(terrain)
    for rock in terrain.rocks:
        points, faces = sand.visible(rock)
        off = np.hypot(*(points[faces].mean(axis=1)[:, :2] - rock.vertices[:, :2].mean(axis=0)).T)
        assert off.max() < _ROCK_M + 3.5 * _STEP_M
        # All of the stone's side that is clearly above the sand is there.
        assert len(faces) >= 0.9 * np.count_nonzero(_from_middle(*_scan(_stone)) < _ROCK_M)

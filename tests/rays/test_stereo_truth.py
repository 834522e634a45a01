"""The truth of pairs of scenes whose depth and hidden points follow from a formula."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.camera.rolling_shutter import RollingShutter
from icymoon.rays import stereo_truth
from icymoon.rays.embree import EmbreeTracer, load_library
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.rays.stereo_truth import MIN_GAP_PX, Eye, Stage, trace_eyes

LIBRARY = load_library()
pytestmark = pytest.mark.skipif(LIBRARY is None, reason="there is no Embree; pip install embreex")
COLUMNS, ROWS, FOCAL, BASELINE = 90, 61, 101.3, 0.25
NEAR, FAR = 1e-4, 1e6


def quad(corners, number, label=1):
    placed = Shape(
        np.array(corners, np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        np.zeros(2, bool),
        np.full(2, label, np.uint8),
    )
    return Placed(placed, np.eye(4)[None], np.array([number]))


def wall(z, left, right, number, label=1):
    return quad([[left, -50, z], [right, -50, z], [right, 50, z], [left, 50, z]], number, label)


def stage(*ground, sky=()):
    worlds = World(list(ground)), World(list(sky))
    return Stage(worlds[0], EmbreeTracer(LIBRARY, worlds[0]), worlds[1], EmbreeTracer(LIBRARY, worlds[1]))


def eyes(toe_deg=0.0, axes=None):
    """Parallel eyes along x, or turned toward each other, with a principal point off the middle."""
    found = {}
    axes = np.eye(3) if axes is None else axes
    for name, x, angle in (("left", 0.0, toe_deg), ("right", BASELINE, -toe_deg)):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        found[name] = Eye(COLUMNS, ROWS, FOCAL, 44.0, 31.0, axes @ turn, axes @ np.array([x, 0.0, 0.0]))
    return found


def columns():
    return np.broadcast_to(np.arange(COLUMNS) + 0.5, (ROWS, COLUMNS))


def test_depth_of_a_slope_is_that_of_its_plane_in_any_direction_of_view():
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    axes[:, 0] *= np.linalg.det(axes)
    corners = np.array([[-50, 1.0, -1], [50, 1.0, -1], [50, 1.5, 60], [-50, 1.5, 60]]) @ axes.T
    truth = trace_eyes(stage(quad(corners, 3)), eyes(axes=axes), BASELINE, NEAR, FAR)["left"]
    down = ((np.arange(ROWS) + 0.5 - 31.0) / FOCAL)[:, None]
    slope = 0.5 / 61
    with np.errstate(divide="ignore"):
        depth = np.broadcast_to((1.0 + slope) / (down - slope), (ROWS, COLUMNS))
    seen = (depth > 0) & (depth < 59)
    assert truth.depth_m[seen] == pytest.approx(depth[seen], rel=2e-6)  # corners of 60 m in single precision
    assert np.array_equal(truth.number > 0, truth.depth_m < 1e9)
    normal = axes @ np.array([0.0, -1.0, slope]) / np.hypot(1, slope)
    assert truth.normal[seen] == pytest.approx(np.broadcast_to(normal, (seen.sum(), 3)), abs=1e-5)
    assert not truth.hidden.any()  # a plane does not hide itself, however steep it is


@pytest.mark.parametrize("parts", [2**19, 512])
def test_what_a_wall_hides_is_what_the_formula_says(parts, monkeypatch):
    """A wall at 4 m, from -0.19 to 0.31 m, before one at 10 m."""
    monkeypatch.setattr(stereo_truth, "_PIXELS_AT_ONCE", parts)
    found = trace_eyes(stage(wall(4.0, -0.19, 0.31, 1), wall(10.0, -40, 40, 2, 2)), eyes(), BASELINE, NEAR, FAR)
    for name, x, other in (("left", 0.0, BASELINE), ("right", BASELINE, 0.0)):
        ahead = (columns() - 44.0) / FOCAL
        front = (x + 4 * ahead > -0.19) & (x + 4 * ahead < 0.31)
        assert found[name].depth_m == pytest.approx(np.where(front, 4.0, 10.0), rel=1e-6)
        assert np.array_equal(found[name].number, np.where(front, 1, 2))
        assert np.array_equal(found[name].label, np.where(front, 1, 2))
        crossing = other + (x + 10 * ahead - other) * 0.4  # where the other eye's ray to the far wall is at 4 m
        column = 44.0 + FOCAL * (x + 10 * ahead - other) / 10
        hidden = ~front & (crossing > -0.19) & (crossing < 0.31) & (column >= 0) & (column <= COLUMNS)
        assert hidden.any()
        assert np.array_equal(found[name].hidden, hidden)


@pytest.mark.parametrize(("nearer_px", "hides"), [(0.9 * MIN_GAP_PX, False), (1.1 * MIN_GAP_PX, True)])
def test_what_is_hardly_nearer_hides_nothing(nearer_px, hides):
    disparity = FOCAL * BASELINE / 10
    front = FOCAL * BASELINE / (disparity + nearer_px)
    # With a slanted edge, so that some pixel is in the narrow strip beside it.
    near = quad([[-50, -50, front], [-9, -50, front], [9, 50, front], [-50, 50, front]], 1)
    found = trace_eyes(stage(near, wall(10.0, -40, 40, 2)), eyes(), BASELINE, NEAR, FAR)
    assert bool((found["right"].hidden | found["left"].hidden).any()) is hides


def test_the_sky_has_labels_where_no_ground_is_and_hides_nothing():
    far = quad([[-3e4, -1e4, 9e4], [3e4, -1e4, 9e4], [3e4, 2e4, 9e4], [-3e4, 2e4, 9e4]], 9, 4)
    found = trace_eyes(stage(wall(4.0, -0.19, 0.31, 1), sky=[far]), eyes(), BASELINE, NEAR, FAR)
    left = found["left"]
    assert set(np.unique(left.label)) == {0, 1, 4}
    assert left.depth_m[left.label == 4] == pytest.approx(9e4)
    assert np.isinf(left.depth_m[left.label == 0]).all()
    assert left.hidden[(left.label == 4)].any()  # by the wall, in the other eye
    assert not left.hidden[(left.label != 4)].any()


def test_eyes_that_are_turned_in_see_their_own_depth_and_what_the_other_does_not():
    scene = stage(wall(4.0, -0.19, 0.31, 1), wall(10.0, -40, 40, 2, 2))
    turned = trace_eyes(scene, eyes(toe_deg=2.0), BASELINE, NEAR, FAR)
    ahead = np.radians(2.0) + np.arctan((columns() - 44.0) / FOCAL)
    depth = np.where(turned["left"].number == 1, 4.0, 10.0)
    along = np.cos(np.radians(2.0)) + np.sin(np.radians(2.0)) * np.tan(ahead)  # of depth along the eye's own axis
    assert turned["left"].depth_m == pytest.approx(depth * along, rel=1e-6)
    crossing = BASELINE + (10 * np.tan(ahead) - BASELINE) * 0.4
    beyond = turned["left"].number == 2
    hidden = beyond & (crossing > -0.19) & (crossing < 0.31)
    assert hidden.any()
    assert np.array_equal(turned["left"].hidden, hidden)


def test_what_is_too_near_or_too_far_for_the_lens_is_not_seen():
    scene = stage(wall(0.5, -9, 9, 1), wall(2.0, -9, 9, 2), wall(9.0, -40, 40, 3))
    assert set(np.unique(trace_eyes(scene, eyes(), BASELINE, 1.0, 5.0)["left"].number)) == {2}
    assert np.isinf(trace_eyes(scene, eyes(), BASELINE, 3.0, 5.0)["left"].depth_m).all()


def rolling_eyes(rows):
    """Parallel eyes that move and turn while their rows are read, and each row of them as an eye that stands still."""
    shutter = RollingShutter(0.3, rows, np.array([0.8, -0.3, 0.5]), np.array([4.0, 10.0, -25.0]))
    rolling, still = {}, [{} for _ in range(rows)]
    for name, along in (("left", 0.0), ("right", BASELINE)):
        middle = np.eye(4)
        middle[0, 3] = along
        poses = shutter.list_poses(middle, along)
        rolling[name] = Eye(COLUMNS, rows, FOCAL, 44.0, 31.0, poses[:, :3, :3], poses[:, :3, 3])
        for row in range(rows):
            pose = poses[row]
            still[row][name] = Eye(COLUMNS, rows, FOCAL, 44.0, 31.0, pose[:3, :3], pose[:3, 3])
    return rolling, still


def test_a_row_of_a_rolling_shutter_is_that_row_of_eyes_that_stand_still_at_its_pose():
    """Truth and hidden points, of walls before a wall; the scene has both in most rows."""
    scene = stage(wall(6.0, -50, 50, 1), wall(3.0, -0.6, 0.1, 2, 3), sky=[wall(4e4, -1e5, 1e5, 4)])
    rolling, still = rolling_eyes(ROWS)
    found = trace_eyes(scene, rolling, BASELINE, NEAR, FAR)
    changed = 0
    for row in (0, 17, ROWS // 2, ROWS - 1):
        expected = trace_eyes(scene, still[row], BASELINE, NEAR, FAR)
        for eye, truth in found.items():
            np.testing.assert_allclose(truth.depth_m[row], expected[eye].depth_m[row], rtol=1e-6)
            np.testing.assert_allclose(truth.normal[row], expected[eye].normal[row], atol=1e-6)
            np.testing.assert_array_equal(truth.number[row], expected[eye].number[row])
            np.testing.assert_array_equal(truth.hidden[row], expected[eye].hidden[row])
        changed += int(expected["left"].hidden[row].sum())
    assert changed > 8


def test_both_eyes_see_a_point_in_the_same_row_a_disparity_apart():
    """Left points, by the depth along the axis of their row, are where the right eye has them within 1e-4 px."""
    scene = stage(quad([[-50, 1.0, -1], [50, 1.0, -1], [50, 3.0, 60], [-50, 3.0, 60]], 3))
    rolling, _ = rolling_eyes(ROWS)
    truth = trace_eyes(scene, rolling, BASELINE, NEAR, FAR)
    left, right = rolling["left"], rolling["right"]
    depth = truth["left"].depth_m.astype(np.float64)
    pixels = np.flatnonzero(np.isfinite(depth))
    row, column = np.divmod(pixels, COLUMNS)
    points = left.position[row] + left.directions(pixels) * depth.ravel()[pixels, None]
    seen = np.einsum("nij,ni->nj", right.axes[row], points - right.position[row])
    place = np.stack([44.0 + FOCAL * seen[:, 0] / seen[:, 2], 31.0 + FOCAL * seen[:, 1] / seen[:, 2]], -1)
    disparity = FOCAL * BASELINE / depth.ravel()[pixels]
    np.testing.assert_allclose(place, np.stack([column + 0.5 - disparity, row + 0.5], -1), atol=1e-4)
    # The right eye's own truth there: inverse depth of a plane is linear along a row.
    inverse = 1.0 / truth["right"].depth_m.astype(np.float64)
    at = column - disparity
    inner = np.flatnonzero((at >= 0) & (at < COLUMNS - 1))
    first = at[inner].astype(int)
    share = at[inner] - first
    there = inverse[row[inner], first] * (1 - share) + inverse[row[inner], first + 1] * share
    surface = (inverse[row[inner], first] > 0) & (inverse[row[inner], first + 1] > 0)  # not beside its far edge
    assert surface.sum() > 2000
    np.testing.assert_allclose(FOCAL * BASELINE * there[surface], disparity[inner][surface], atol=1e-4)


def test_one_row_has_the_pose_of_the_middle():
    rolling, _ = rolling_eyes(1)
    np.testing.assert_array_equal(rolling["left"].axes[0], np.eye(3))
    np.testing.assert_array_equal(rolling["right"].position[0], [BASELINE, 0, 0])
    scene = stage(wall(3.0, -50, 50, 1))
    assert np.allclose(trace_eyes(scene, rolling, BASELINE, NEAR, FAR)["left"].depth_m, 3.0)

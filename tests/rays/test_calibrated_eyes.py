"""The truth on the sensors of calibrated eyes: what both eyes and the rectified pair say of a point is one place."""

from __future__ import annotations

import numpy as np
import pytest
from heads import FLOWN, HEADS, head_settings
from icymoon.physics.camera.eyes import make_camera_with_eyes
from icymoon.rays.embree import EmbreeTracer, load_library
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.rays.stereo_truth import CalibratedEye, Eye, Stage, trace_eyes
from icymoon.rays.surface import find_surface

LIBRARY = load_library()
pytestmark = pytest.mark.skipif(LIBRARY is None, reason="there is no Embree; pip install embreex")
#: What the truth of one eye may be off in the other's image, px; it is stored in single precision, which is 1e-5 px.
MAX_PX = 1e-4
NEAR, FAR = 1e-4, 1e6


def hills():
    """Gentle hills of 100 x 100 quads 3 m ahead, which hide nothing of themselves, with a block before them."""
    x, y = np.meshgrid(np.linspace(-9, 9, 101), np.linspace(-9, 9, 101))
    z = 3.0 + 0.2 * np.sin(1.3 * x) * np.cos(1.1 * y) - 0.1 * y
    corner = (np.arange(100)[:, None] * 101 + np.arange(100)).ravel()
    triangles = np.concatenate([corner[:, None] + [0, 1, 102], corner[:, None] + [0, 102, 101]]).astype(np.uint32)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), triangles


def shape(vertices, triangles, number, label):
    count = len(triangles)
    made = Shape(np.asarray(vertices, np.float32), triangles, np.zeros(count, bool), np.full(count, label, np.uint8))
    return Placed(made, np.eye(4)[None], np.array([number]))


def block(z=2.0):
    corners = np.array([[-0.2, -0.15, z], [0.15, -0.15, z], [0.15, 0.2, z], [-0.2, 0.2, z]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def stage(turn, *parts):
    found = World([shape(vertices @ turn.T, triangles, k, k) for k, (vertices, triangles) in enumerate(parts, 1)])
    nothing = World([])
    return Stage(found, EmbreeTracer(LIBRARY, found), nothing, EmbreeTracer(LIBRARY, nothing))


def make_calibrated_eyes(camera, turn):
    return {
        name: CalibratedEye(own, camera.focal_px, turn, turn @ np.array([along, 0.0, 0.0]))
        for name, own, along in zip(("left", "right"), camera.eyes, (0.0, camera.baseline_m), strict=True)
    }


def pixels_of(own):
    return np.stack(np.meshgrid(np.arange(own.width_px, dtype=float), np.arange(own.height_px, dtype=float)), axis=-1)


def points_of(own, pixels, depth):
    """Where pixels of an eye with these depths along its axis are, in the axes of the rectified left eye."""
    rays = own.unproject(pixels)
    return (rays / rays[..., 2:] * depth[..., None] - own.translation_m) @ own.rotation


def look(scene, turn, origin, rays):
    """The points that rays (n, 3) of the rig meet, in its axes."""
    place, direction = turn @ origin, rays @ turn.T
    seen = find_surface(scene.ground, scene.ground_tracer.intersect(place, direction, NEAR, FAR), place, direction)
    return origin + rays * seen.along[:, None]


TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
TURN[:, 0] *= np.linalg.det(TURN)


def around():
    """A rolling shell of 200 x 100 quads about the head, 2.6 to 3.4 m away, which hides nothing of itself."""
    turn, rise = np.meshgrid(np.linspace(-np.pi, np.pi, 201), np.linspace(-np.pi / 2, np.pi / 2, 101))
    far = 3.0 + 0.2 * np.sin(3 * turn) * np.cos(rise) + 0.2 * np.sin(4 * rise)
    points = far[..., None] * np.stack([np.cos(rise) * np.sin(turn), np.sin(rise), np.cos(rise) * np.cos(turn)], -1)
    corner = (np.arange(100)[:, None] * 201 + np.arange(200)).ravel()
    triangles = np.concatenate([corner[:, None] + [0, 1, 202], corner[:, None] + [0, 202, 201]]).astype(np.uint32)
    return points.reshape(-1, 3), triangles


@pytest.mark.parametrize("name", FLOWN)
def test_a_point_of_one_eye_is_where_the_other_one_has_it_in_all_directions(name):
    """As below for fields that no pinhole shows. A planar depth is the farther from a distance the nearer a ray is to
    90 degrees off the axis, so there its rounding moves a point along the ray, and no pixel is left out for it."""
    camera = make_camera_with_eyes(head_settings(name))
    scene = stage(TURN, around())
    truth = trace_eyes(scene, make_calibrated_eyes(camera, TURN), camera.baseline_m, NEAR, FAR)
    for first, second in ((0, 1), (1, 0)):
        own, other = camera.eyes[first], camera.eyes[second]
        depth = truth[("left", "right")[first]].depth_m.astype(np.float64)
        rays = own.unproject(pixels_of(own))
        ahead = rays[..., 2] > 1e-9
        assert np.isfinite(depth[ahead]).all()
        pixels = pixels_of(own)[ahead]
        points = points_of(own, pixels, depth[ahead])
        there = other.project(points)
        inside = ((there >= 0) & (there <= np.array(other.size_px) - 1)).all(axis=-1)
        assert inside.mean() > 0.6
        back = look(scene, TURN, other.centre_m, other.unproject(there[inside]) @ other.rotation)
        assert np.abs(own.project(back) - pixels[inside]).max() < MAX_PX
        assert np.abs(other.project(back) - there[inside]).max() < MAX_PX


@pytest.mark.parametrize("name", HEADS)
def test_a_point_of_one_eye_is_where_the_other_and_the_rectified_pair_have_it(name):
    camera = make_camera_with_eyes(head_settings(name))
    scene = stage(TURN, hills())
    truth = trace_eyes(scene, make_calibrated_eyes(camera, TURN), camera.baseline_m, NEAR, FAR)
    for first, second in ((0, 1), (1, 0)):
        own, other = camera.eyes[first], camera.eyes[second]
        depth = truth[("left", "right")[first]].depth_m.astype(np.float64)
        seen = np.isfinite(depth)
        assert seen.mean() > 0.97
        pixels = pixels_of(own)[seen]
        points = points_of(own, pixels, depth[seen])
        assert np.abs(own.project(points) - pixels).max() < 1e-9
        there = other.project(points)
        inside = ((there >= 0) & (there <= np.array(other.size_px) - 1)).all(axis=-1)
        assert inside.mean() > 0.6
        # The other eye looks at its own subpixel, and sees the point that this one saw.
        back = look(scene, TURN, other.centre_m, other.unproject(there[inside]) @ other.rotation)
        assert np.abs(own.project(back) - pixels[inside]).max() < MAX_PX
        assert np.abs(other.project(back) - there[inside]).max() < MAX_PX
        # So does the rectified pair, with the same row in both eyes.
        for origin in (np.zeros(3), np.array([camera.baseline_m, 0.0, 0.0])):
            away = points - origin
            rectified = look(scene, TURN, origin, away / away[:, 2:])
            assert np.abs(own.project(rectified) - pixels).max() < MAX_PX
            moved = (rectified - points)[:, :2] * camera.focal_px / points[:, 2:]
            assert np.abs(moved).max() < MAX_PX


@pytest.mark.parametrize("name", HEADS)
def test_rectified_truth_is_found_again_on_the_sensors(name):
    """Rectified depth at the place of a raw pixel, interpolated on a plane, where 1 / Z is linear."""
    camera = make_camera_with_eyes(head_settings(name))
    z = np.array([[-40, -40, 4.0], [40, -40, 6.0], [40, 40, 6.0], [-40, 40, 4.0]])
    scene = stage(np.eye(3), (z, np.array([[0, 1, 2], [0, 2, 3]], np.uint32)))
    raw = trace_eyes(scene, make_calibrated_eyes(camera, np.eye(3)), camera.baseline_m, NEAR, FAR)
    plain = {
        eye: Eye(
            *camera.rectified.rendered_px, camera.focal_px, camera.cx_px, camera.cy_px, np.eye(3), np.array([x, 0, 0])
        )
        for eye, x in (("left", 0.0), ("right", camera.baseline_m))
    }
    rectified = trace_eyes(scene, plain, camera.baseline_m, NEAR, FAR)
    for eye, own in zip(("left", "right"), camera.eyes, strict=True):
        points = points_of(own, pixels_of(own), raw[eye].depth_m.astype(np.float64)) - own.centre_m
        place = points[..., :2] / points[..., 2:] * camera.focal_px + [camera.cx_px - 0.5, camera.cy_px - 0.5]
        height, width = rectified[eye].depth_m.shape
        inside = ((place >= 0) & (place < [width - 1, height - 1])).all(axis=-1)
        assert inside.sum() > 1000
        column, row = np.floor(place[inside]).astype(int).T
        inverse, (x, y) = 1 / rectified[eye].depth_m.astype(np.float64), (place[inside] - np.stack([column, row], 1)).T
        here = (inverse[row, column] * (1 - x) + inverse[row, column + 1] * x) * (1 - y) + (
            inverse[row + 1, column] * (1 - x) + inverse[row + 1, column + 1] * x
        ) * y
        off = camera.focal_baseline_px_m * (here - 1 / points[inside][:, 2])
        assert np.abs(off).max() < MAX_PX


@pytest.mark.parametrize("name", HEADS)
def test_what_a_block_hides_from_the_other_eye_is_what_its_shadow_covers(name):
    camera = make_camera_with_eyes(head_settings(name))
    far = np.array([[-40, -40, 3.0], [40, -40, 3.0], [40, 40, 3.0], [-40, 40, 3.0]])
    scene = stage(np.eye(3), (far, np.array([[0, 1, 2], [0, 2, 3]], np.uint32)), block())
    truth = trace_eyes(scene, make_calibrated_eyes(camera, np.eye(3)), camera.baseline_m, NEAR, FAR)
    for eye, own, other in zip(("left", "right"), camera.eyes, camera.eyes[::-1], strict=True):
        found = truth[eye]
        points = points_of(own, pixels_of(own), found.depth_m.astype(np.float64))
        wall = found.label == 1
        assert found.depth_m[wall] == pytest.approx((points @ own.rotation.T + own.translation_m)[wall][:, 2], rel=1e-6)
        assert points[wall][:, 2] == pytest.approx(3.0, rel=1e-5)
        away = points - other.centre_m
        crossing = other.centre_m + away * (2.0 / away[..., 2:])
        covered = (np.abs(crossing[..., 0] + 0.025) < 0.175) & (np.abs(crossing[..., 1] - 0.025) < 0.175)
        there = other.project(points)
        framed = ((there >= -0.5) & (there <= np.array(other.size_px) - 0.5)).all(axis=-1)
        hidden = wall & covered & framed
        assert 15 < hidden.sum() < wall.sum()
        assert np.array_equal(found.hidden, hidden)


def test_depth_ends_90_degrees_off_the_axis_and_labels_do_not():
    settings = head_settings("fisheye and CAHVORE")
    settings.left_eye.fx_px = settings.left_eye.fy_px = 18.0  # 300 degrees wide
    settings.left_eye.update(k1=0.0, k2=0.0, k3=0.0, k4=0.0)
    camera = make_camera_with_eyes(settings)
    truth = trace_eyes(
        stage(np.eye(3), around()), make_calibrated_eyes(camera, np.eye(3)), camera.baseline_m, NEAR, FAR
    )["left"]
    ahead = camera.eyes[0].unproject(pixels_of(camera.eyes[0]))
    behind, blind = ahead[..., 2] <= 0, np.isnan(ahead[..., 2])
    assert 0.2 < behind.mean() < 0.8
    assert not np.isfinite(truth.depth_m[behind]).any()
    assert np.isfinite(truth.depth_m[~behind & ~blind]).all()
    assert truth.label[~blind].all()
    assert not truth.label[blind].any()
    assert not truth.hidden[blind].any()

"""Cameras beside the pair in a render: their images, their truth, and the pair, which they leave as it is."""

from __future__ import annotations

import json
import time

import bpy
import numpy as np
import pytest
from camchains import make_camchain
from icymoon.nodes.build_scene import build_scene
from icymoon.physics.camera.head_camera import show_points
from icymoon.render.pairs.pair_folder import find_pairs, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.images.head_views import develop_head_view, read_head_views
from icymoon.support.errors import IcyMoonError
from rendering import add_shining_ball, complete, empty_scene

FLAT = {
    "terrain": {"size_m": 10.0, "resolution": 17, "rms_slope_deg": 0.0},
    "quality": {"samples": 4, "threads": 2},
    "surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0},
    "rig": {"width_px": 32, "height_px": 24},
}
#: A ball that shines, east, north and up, and its radius, in metres.
BALL, RADIUS = np.array([0.2, 1.6, 0.6]), 0.08
#: Its radiance, far above the ground's.
SHINE = 1e4
HEAD = """
[[camera]]
name = "pin"
role = "mast"
model = "PINHOLE"
width_px = 96
height_px = 72
field_deg = 70

[[camera]]
name = "from_above"
model = "ORTHOGRAPHIC"
width_px = 48
height_px = 64
width_m = 3.0
frame = "GROUND"
position_m = [0, 1.5, 3]
forward = [0, 0.3, -1]

[[camera]]
name = "around"
role = "context"
model = "EQUIRECTANGULAR"
width_px = 160
height_px = 80
field_deg = 360
frame = "GROUND"
position_m = [-0.3, 2.2, 1]

[[camera]]
name = "front"
role = "hazcam"
model = "FISHEYE"
width_px = 96
height_px = 72
field_deg = 190
frame = "ZERO"
position_m = [0.3, 0.5, 0.7]
forward = [0, 1, -0.5]
up = [0.2, 0, 1]

[[camera]]
name = "calibrated"
role = "arm"
model = "CALIBRATED"
calibration = "chain.yaml"
camera = "cam0"

[[camera]]
name = "wide"
role = "arm"
model = "CALIBRATED"
calibration = "chain.yaml"
camera = "cam1"
"""
CAMCHAIN = make_camchain((80.0, 82.0, 50.0, 33.0), (40.0, 41.0, 44.0, 37.0), (96, 72))


def _render(folder, *parts, ball: bool = False):
    settings = complete(FLAT, *parts)
    start = time.perf_counter()
    built = build_scene(empty_scene(), settings)
    if ball:
        add_shining_ball(built, BALL, RADIUS, SHINE)
    render_pairs(built, expand_headings(settings), folder, 1, time.perf_counter() - start, lambda *a, **k: None)
    return find_pairs(folder)[0], built


@pytest.fixture(scope="module")
def head(tmp_path_factory):
    folder = tmp_path_factory.mktemp("head")
    (folder / "chain.yaml").write_text(CAMCHAIN, encoding="utf-8")
    path = folder / "head.toml"
    path.write_text(HEAD, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def with_ball(head, tmp_path_factory):
    """A data set of the head alone, whose scene has a shining ball on level ground."""
    return _render(tmp_path_factory.mktemp("ball"), {"rig": {"head_file": str(head), "images": "HEAD"}}, ball=True)


def _middle(weights) -> np.ndarray:
    rows, columns = np.mgrid[: weights.shape[0], : weights.shape[1]]
    return np.array([(weights * columns).sum(), (weights * rows).sum()]) / weights.sum()


def test_a_ball_is_where_its_points_are_in_image_and_truth_of_every_camera(with_ball):
    """Its centre of light, the middle of its pixels in the truth, and the middle of where its surface is shown."""
    pair, _ = with_ball
    views = list(read_head_views(pair))
    assert [view.camera.name for view in views] == ["pin", "from_above", "around", "front", "calibrated", "wide"]
    random = np.random.default_rng(0).normal(size=(20000, 3))
    surface = BALL + RADIUS * random / np.linalg.norm(random, axis=1, keepdims=True)
    for view in views:
        shown = show_points(view.camera.projection, (surface - view.camera.position_m) @ view.camera.rotation)
        low, high = np.nanmin(shown, axis=0), np.nanmax(shown, axis=0)
        assert view.instance is not None
        truth = view.instance == 77
        assert truth.sum() > 5, view.camera.name
        level = view.light.radiance.mean(axis=-1) / SHINE
        bright = np.where(level > 0.1, np.minimum(level, 1.0), 0.0)  # the ground beside it has 2 % at most
        for found in (_middle(truth), _middle(bright)):
            np.testing.assert_allclose(found, (low + high) / 2, atol=0.5, err_msg=view.camera.name)
        # All points that the truth has of it are on its surface: facets are flat, and 5 mm inside of it at most.
        off = np.linalg.norm(view.points_m[truth] - BALL, axis=-1) - RADIUS
        assert np.abs(off).max() < 5e-3, view.camera.name


def test_points_of_the_ground_are_on_the_plane_that_it_is(with_ball):
    """Closed forms: the plane is at 0, and an orthographic camera that is tilted by an angle sees it slanted."""
    pair, _ = with_ball
    for view in read_head_views(pair):
        ground = view.semantic == 1
        assert ground.sum() > 100, view.camera.name
        # A distance of up to 10 m is stored in single precision, to 1e-6 m, and so is the camera's pose.
        assert np.abs(view.points_m[ground][:, 2]).max() < 1e-5, view.camera.name
        assert view.normal is not None
        np.testing.assert_allclose(view.normal[ground], np.broadcast_to([0, 0, 1], (ground.sum(), 3)), atol=1e-6)
    above = next(view for view in read_head_views(pair) if view.camera.name == "from_above")
    rows = np.arange(64) - 31.5
    tilt = np.arctan(0.3)
    depth = 3.0 / np.cos(tilt) - rows * (3.0 / 48) * np.tan(tilt)
    seen = np.where(above.semantic == 1, above.depth_m, np.nan)
    np.testing.assert_allclose(seen, np.where(np.isnan(seen), np.nan, depth[:, None]), atol=1e-5)


def test_images_are_developed_as_the_pairs_are(with_ball):
    pair, _ = with_ball
    views = list(read_head_views(pair))
    images = [develop_head_view(pair, view, pair.settings) for view in views]
    for view, image in zip(views, images, strict=True):
        assert image.grey.shape == view.distance_m.shape
        assert image.bits == 8
        assert image.grey.max() > 100
    again = develop_head_view(pair, views[0], pair.settings)
    np.testing.assert_array_equal(again.grey, images[0].grey)


def test_a_set_of_the_head_alone_has_no_eyes_and_is_refused_as_a_pair(with_ball):
    pair, _ = with_ball
    assert not pair.has_eyes
    assert all(name.startswith("camera_") for name in pair.data["files"])
    with pytest.raises(IcyMoonError, match="has no stereo pair, only cameras of a head"):
        pair.image("left")


def test_the_pair_is_the_same_to_the_bit_with_the_head_and_without(head, tmp_path):
    ground = {"terrain": {"rms_slope_deg": 5.0}, "quality": {"samples": 1}}
    alone, _ = _render(tmp_path / "alone", ground)
    short = tmp_path / "short.toml"
    short.write_text("[[camera]]".join(HEAD.split("[[camera]]")[:4]), encoding="utf-8")
    beside, built = _render(tmp_path / "beside", ground, {"rig": {"head_file": str(short)}})
    assert not built.edited
    assert {*beside.data["files"]} > {*alone.data["files"]} == {"left.exr", "right.exr"}
    for eye in ("left", "right"):
        one, other = read_view(alone.image(eye)), read_view(beside.image(eye))
        for name in ("radiance", "depth", "normal", "instance", "hidden"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_a_camera_under_the_ground_is_refused_with_its_name(head, tmp_path):
    deep = tmp_path / "deep.toml"
    deep.write_text(HEAD.split("[[camera]]")[1].join(["[[camera]]", "position_m = [0, 5, 0]\n"]), encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"deep\.toml: the camera pin is .* m under the ground; raise"):
        build_scene(empty_scene(), complete(FLAT, {"rig": {"head_file": str(deep)}}))


def test_cameras_of_a_head_are_in_the_scene_follow_the_rig_and_go_with_the_head(head):
    scene = empty_scene()
    built = build_scene(scene, complete(FLAT, {"rig": {"head_file": str(head)}}))
    names = ("Camera", "around", "calibrated", "from_above", "front", "pin", "wide")
    cameras = {item.name: item for item in built.collection.all_objects if item.type == "CAMERA"}
    assert sorted(cameras) == [f"Icy Moon {name}" for name in names]
    assert cameras["Icy Moon wide"].parent == built.camera
    assert cameras["Icy Moon wide"].data.type == "PANO"
    assert cameras["Icy Moon from_above"].data.type == "ORTHO"
    assert cameras["Icy Moon from_above"].parent is None
    again = build_scene(scene, complete(FLAT, {"rig": {"head_file": str(head)}}))
    assert len([item for item in again.collection.all_objects if item.type == "CAMERA"]) == 7
    assert not again.edited
    alone = build_scene(scene, complete(FLAT))
    assert [item.name for item in alone.collection.all_objects if item.type == "CAMERA"] == ["Icy Moon Camera"]
    assert len(bpy.data.cameras) == 1


def test_a_pair_whose_head_was_changed_is_refused(with_ball):
    pair, _ = with_ball
    path = pair.folder / "pair.json"
    before = path.read_text(encoding="utf-8")
    data = json.loads(before)
    try:
        for change, clause in (
            ({"head": []}, "head has 0 cameras"),
            ({"head": [*data["head"], data["head"][0]]}, "two cameras of one name"),
            ({"head": data["head"][:-1]}, "files has camera_wide"),
            ({"head": [{**data["head"][0], "pose_camera_to_world": 3}]}, "not a 4 x 4 matrix"),
        ):
            path.write_text(json.dumps({**data, **change}), encoding="utf-8")
            with pytest.raises(IcyMoonError, match=clause):
                read_pair(pair.folder)
    finally:
        path.write_text(before, encoding="utf-8")

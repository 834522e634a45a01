"""A pair with the user's own arm: what each pixel of a link saw is on the shape of the file, at the stated pose."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from rendering import render
from urdf_files import visual, write_obj, write_robot, write_stl

pytestmark = pytest.mark.heavy

YAW, PITCH, SLIDE_M = math.radians(25.0), math.radians(-35.0), 0.15
JOINTS = """
  <joint name="mount" type="fixed"><parent link="foot"/><child link="post"/><origin xyz="0 0 0.1"/></joint>
  <joint name="yaw" type="continuous"><parent link="post"/><child link="beam"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="pitch" type="revolute"><parent link="beam"/><child link="wedge"/><origin xyz="0.7 0 0"/>
    <axis xyz="0 -1 0"/><limit lower="-2" upper="2"/></joint>
  <joint name="slide" type="prismatic"><parent link="wedge"/><child link="knife"/><origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5"/></joint>
  <joint name="end" type="fixed"><parent link="knife"/><child link="ball"/><origin xyz="0.25 0 0"/></joint>
"""
#: What is seen of each link.
SHAPES = {
    "post": '<visual><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.07" length="0.3"/></geometry></visual>',
    "beam": '<visual><origin xyz="0.35 0 0"/><geometry><box size="0.7 0.1 0.08"/></geometry></visual>',
    "wedge": visual("meshes/t.stl", "0.003 -0.0024 0.0016"),
    "knife": visual("meshes/t.obj", "2.5 2.5 1.5"),
    "ball": '<visual><geometry><sphere radius="0.08"/></geometry></visual>',
}


def from_box(points: Array) -> Array:
    beyond = np.abs(points - [0.35, 0.0, 0.0]) - [0.35, 0.05, 0.04]
    return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0))


def from_cylinder(points: Array) -> Array:
    beyond = np.stack([np.hypot(points[:, 0], points[:, 1]) - 0.07, np.abs(points[:, 2] - 0.05) - 0.15], axis=1)
    return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0))


def from_tetrahedron(sides: tuple[float, float, float]) -> Callable[[Array], Array]:
    """Of the planes at 0 and of the one through the ends of the sides, the outermost."""
    normal = 1.0 / np.array(sides)
    length = float(np.linalg.norm(normal))
    signs = np.sign(sides)
    return lambda points: np.max(np.column_stack([-points * signs, (points @ normal - 1.0) / length]), axis=1)


#: By link, the distance in metres of points (n, 3) of its frame from that surface, positive outside.
DISTANCES = {
    "post": from_cylinder,
    "beam": from_box,
    "wedge": from_tetrahedron((0.3, -0.24, 0.16)),
    "knife": from_tetrahedron((0.25, 0.25, 0.15)),
    "ball": lambda points: np.linalg.norm(points, axis=1) - 0.08,
}


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    root = tmp_path_factory.mktemp("own")
    write_stl(root / "meshes" / "t.stl", 1000.0 * np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]))
    write_obj(root / "meshes" / "t.obj")
    file = write_robot(root, JOINTS, ("foot", "post", "beam", "wedge", "knife", "ball"), SHAPES)
    level: dict[str, Any] = {
        "terrain": {"rms_slope_deg": 0.0, "size_m": 12.0, "resolution": 65},
        "rocks": {"coverage": 0.0},
        "rig": {"width_px": 160, "height_px": 120, "heading_deg": 30.0},
        "quality": {"samples": 4},
        "lander": {"kind": "OWN", "file": str(file), "joints": f"yaw=25 pitch=-35 slide={SLIDE_M}"},
    }
    pair, built = render(root / "set", level)
    return pair, json.loads((Path(pair.image("left")).parent / "pair.json").read_text(encoding="utf-8")), built


def test_each_pixel_of_a_link_is_on_its_shape_at_its_pose(rendered):
    pair, said, _ = rendered
    camera = pair.camera
    links = {link["name"]: link for link in said["lander"]["links"]}
    assert {"post", "beam", "wedge", "knife", "ball", "body"} <= set(links)
    assert len({link["instance"] for link in links.values()}) == len(links)
    for eye in ("left", "right"):
        view = read_view(pair.image(eye))
        for name, distance in DISTANCES.items():
            rows, columns = np.nonzero(view.instance == links[name]["instance"])
            z = view.depth[rows, columns].astype(float)
            seen = np.column_stack(
                [
                    (columns + 0.5 - camera.cx_px) / camera.focal_px * z,
                    (rows + 0.5 - camera.cy_px) / camera.focal_px * z,
                    z,
                    np.ones_like(z),
                ]
            )
            places = seen @ np.linalg.inv(np.array(links[name][f"link_to_{eye}"])).T
            off = np.abs(distance(places[:, :3]))
            assert len(off) > 15, (eye, name)
            # Facets of cylinder and ball, bevels of 2 mm, depth in single precision.
            assert off.max() < 0.003, (eye, name, float(off.max()))


def test_poses_and_keypoints_are_those_of_the_angles_by_hand(rendered):
    pair, said, built = rendered
    lander, camera = said["lander"], pair.camera
    settings = built.settings
    eyes = {
        eye: np.array(next(link for link in lander["links"] if link["name"] == "body")[f"link_to_{eye}"])
        for eye in ("left", "right")
    }
    arm = settings.arm
    out = 0.7 + np.array([0.0, 0.3 + SLIDE_M, 0.55 + SLIDE_M]) * math.cos(PITCH)
    up = 0.3 + np.array([0.0, 0.3 + SLIDE_M, 0.55 + SLIDE_M]) * math.sin(PITCH)
    places = {
        "mount": (0.0, 0.1),
        "yaw": (0.0, 0.3),
        **{name: (out[k], up[k]) for k, name in enumerate(("pitch", "slide", "end"))},
    }
    points = {point["name"]: point for point in lander["keypoints"]}
    assert set(places) <= set(points)
    for name, (ahead, high) in places.items():
        at = [
            arm.shoulder_x_m + ahead * math.cos(YAW),
            arm.shoulder_y_m + ahead * math.sin(YAW),
            arm.shoulder_z_m + high,
            1.0,
        ]
        for eye, to_eye in eyes.items():
            x, y, z = (to_eye @ at)[:3]  # the eyes are in single precision
            assert points[name][f"{eye}_px"] == pytest.approx(
                [camera.focal_px * x / z + camera.cx_px, camera.focal_px * y / z + camera.cy_px], abs=1e-4
            )
    # The body's frame is on the ground under the middle between the eyes, level, with x along the rig's heading.
    rig, pose = settings.rig, eyes["left"]
    below = np.linalg.inv(pose)[:3, 3]
    assert below == pytest.approx([0.0, rig.baseline_m / 2, rig.height_m], abs=1e-6)
    assert lander["joints"] == ["yaw", "pitch", "slide"]
    assert lander["joints_deg"] == pytest.approx([25.0, -35.0, SLIDE_M])
    assert points["yaw"]["visible_left"]
    assert not points["end"]["visible_left"]  # the knife is before the ball

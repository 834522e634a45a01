"""A trajectory over a height map: rendered where the file has it, on ground that is built once, with exact flow."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.nodes import change_scene
from icymoon.physics.camera.optical_flow import find_flow
from icymoon.physics.camera.rotations import quaternion
from icymoon.physics.light.directions import camera_axes
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.plan_file import read_plan
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from
from icymoon.stereo.measure.prepare_pair import load_pair

PLAN = """[plan]
title = "Test"
[source]
kind = "HEIGHT_MAP"
file = "dem.npy"
metres_per_pixel = 0.5
[terrain]
size_m = 10.0
resolution = 21
[quality]
samples = 1
threads = 2
[rig]
width_px = 64
height_px = 48
height_m = 2.0
[[sweep]]
kind = "trajectory"
file = "poses.txt"
"""
#: The last of them is under the ground.
PLACES = ((0.0, -1.0, 2.0), (0.1, -0.9, 2.1), (0.2, -0.8, 2.05), (0.2, -0.8, -3.0))


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """Folders of the frames, in their order, how often a scene was opened, and what was reported."""
    root = tmp_path_factory.mktemp("sequence")
    x = np.arange(21)
    np.save(root / "dem.npy", 0.2 * np.sin(x[None, :] / 2) * np.cos(x[:, None] / 3))
    lines = []
    for k, place in enumerate(PLACES):
        w, *xyz = quaternion(camera_axes(5.0 * k, 45.0, -3.0 * k))
        lines.append(" ".join(repr(float(value)) for value in (0.1 * k, *place, *xyz, w)))
    (root / "poses.txt").write_text("\n".join(lines), encoding="utf-8")
    (root / "plan.toml").write_text(PLAN, encoding="utf-8")
    pairs = read_plan(root / "plan.toml").pairs()
    opened, said = [], []
    usual = change_scene.open_empty_scene
    with pytest.MonkeyPatch.context() as patch, ScenesFromSettings(lambda warning: None) as source:
        patch.setattr(change_scene, "open_empty_scene", lambda settings: opened.append(1) or usual(settings))
        render_from(source, pairs, root, lambda kind, **facts: said.append((kind, facts)), keep_going=True)
    return [pair.folder(root) for pair in pairs], len(opened), [facts for kind, facts in said if kind == "error"]


def test_poses_are_those_of_the_file_and_the_ground_is_built_once(rendered):
    """In single precision: places within 1e-6 m of the file's, axes within 1e-6."""
    folders, opened, _ = rendered
    assert opened == 1
    for k, place in enumerate(PLACES[:3]):
        pose = read_pair(folders[k]).rectified_pose("left")
        np.testing.assert_allclose(pose[:3, 3], place, atol=1e-6)
        np.testing.assert_allclose(pose[:3, :3], camera_axes(5.0 * k, 45.0, -3.0 * k), atol=1e-6)


def test_a_pose_under_the_ground_is_set_aside_in_a_sentence(rendered):
    folders, _, errors = rendered
    (error,) = errors
    assert "left eye" in error["message"]
    assert "under the ground; raise rig.z_m (-3 m)" in error["message"]
    assert not (folders[3] / "pair.json").exists()


def test_flow_leads_to_the_same_point_of_the_ground(rendered):
    """Where a triangle carries the four pixels around a place, the true depth of the other frame leads back as on a
    plane, within 1e-3 px; where an edge of the mesh crosses them, interpolated flow is further off."""
    first, second = (load_pair(folder, {}) for folder in rendered[0][:2])
    camera, poses = first.pair.camera, [pair.pair.rectified_pose("left") for pair in (first, second)]
    forward = find_flow(camera, first.depth["left"], poses[0], second.depth["left"], poses[1])
    backward = find_flow(camera, second.depth["left"], poses[1], first.depth["left"], poses[0])
    v, u = np.mgrid[:48, :64]
    at = np.stack([u, v], -1) + forward.flow_px
    inner = forward.visible & (at >= 0).all(-1) & (at < (63, 47)).all(-1)
    assert inner.mean() > 0.5
    left, top = np.floor(at[inner]).astype(int).T
    a, b = ((at[inner] - np.stack([left, top], -1)).T)[..., None]
    back = sum(
        backward.flow_px[top + j, left + i] * (a if i else 1 - a) * (b if j else 1 - b) for i in (0, 1) for j in (0, 1)
    )
    off = np.linalg.norm(back + forward.flow_px[inner], axis=-1)
    off = off[np.isfinite(off)]  # beside the edge of the map one of the four is sky
    assert np.median(off) < 1e-3
    assert np.quantile(off, 0.95) < 5e-3

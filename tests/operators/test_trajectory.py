"""Save Trajectory: an animated camera's own poses, as a plan reads them."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from icymoon.formats.trajectories import read_trajectory
from rendering import empty_scene


def test_an_animated_camera_is_saved_frame_by_frame(tmp_path):
    """A camera that turns about the vertical by 10 degrees a frame and moves east; Blender's looks down its -z."""
    scene = empty_scene()
    camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    scene.collection.objects.link(camera)
    scene.camera, camera.scale = camera, (2.0, 2.0, 2.0)
    for frame in range(1, 6):
        camera.location = (0.5 * frame, 1.0, 2.0)
        camera.rotation_euler = (math.radians(90.0), 0.0, math.radians(-10.0 * frame))
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_start, scene.frame_end, scene.frame_step, scene.render.fps = 1, 5, 2, 25
    scene.frame_set(4)
    assert bpy.ops.icymoon.save_trajectory(filepath=str(tmp_path / "mine")) == {"FINISHED"}
    assert scene.frame_current == 4
    poses = read_trajectory(tmp_path / "mine.txt").poses
    assert [float(stamp) for stamp in poses.stamp] == [0.0, 0.08, 0.16]
    np.testing.assert_allclose(poses.position_m, [[0.5, 1, 2], [1.5, 1, 2], [2.5, 1, 2]], atol=1e-6)
    for frame, rotation in zip((1, 3, 5), poses.rotation, strict=True):
        heading = math.radians(10.0 * frame)  # from north over east
        forward = [math.sin(heading), math.cos(heading), 0.0]
        np.testing.assert_allclose(rotation[:, 2], forward, atol=1e-6)
        np.testing.assert_allclose(rotation[:, 1], [0, 0, -1], atol=1e-6)


def test_a_scene_without_a_camera_has_none_to_save(tmp_path):
    empty_scene()
    with pytest.raises(RuntimeError, match="no camera"):
        bpy.ops.icymoon.save_trajectory(filepath=str(tmp_path / "mine.txt"))

"""Save Trajectory: save the poses of an animated camera, for plans that follow them."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import bpy

from ..formats.trajectories import tum_text
from ..nodes.rig import find_eye_poses
from ..support.files import write_text
from . import dialogs
from .operator_type import ExplainedOperator


def _read_poses(scene: bpy.types.Scene) -> str:
    """Read the pose of the scene's camera in each frame of its range, as text in TUM's format. The present frame is
    restored."""
    camera, present, subframe = scene.camera, scene.frame_current, scene.frame_subframe
    rate = Decimal(scene.render.fps) / Decimal(repr(round(scene.render.fps_base, 6)))
    frames = range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
    poses = []
    try:
        for frame in frames:
            scene.frame_set(frame)
            seen = camera.evaluated_get(scene.view_layers[0].depsgraph)
            poses.append(find_eye_poses(seen.matrix_world, 0.0)["left"])
    finally:
        scene.frame_set(present, subframe=subframe)
    stamps = [(frame - scene.frame_start) / rate for frame in frames]
    return tum_text(stamps, poses, "camera, x right, y down, z forward")


class ICYMOON_OT_save_trajectory(dialogs.SaveDialog, ExplainedOperator, bpy.types.Operator):
    """Save the poses of the scene's camera, frame by frame, as a text file of TUM's format, for a plan that follows them"""  # noqa: E501

    bl_idname = "icymoon.save_trajectory"
    bl_label = "Save Trajectory"
    first_name = "poses.txt"

    filepath: dialogs.file_property("Text file to write")
    filter_glob: bpy.props.StringProperty(default="*.txt", options={"HIDDEN"})

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if context.scene.camera else "The scene has no camera; add one, or press Build Scene"

    def save(self, context: bpy.types.Context, path: Path) -> None:
        write_text(path, _read_poses(context.scene))


CLASSES = (ICYMOON_OT_save_trajectory,)

"""A scene as another Blender builds it, but in this process, where each test would wait for a start of Blender."""

from __future__ import annotations

from pathlib import Path

import bpy
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.stored_build import write_build
from icymoon.operators import jobs
from icymoon.settings.topics.scene import Settings
from stand_ins import stand_in


def build_beside(settings: Settings, path: Path) -> jobs.Job:
    """The job of a scene that is built and written to a .blend file."""
    elsewhere = bpy.data.scenes.new("Elsewhere")
    write_build(scenes.build_scene(elsewhere, settings), path)
    scenes.clear_scene(elsewhere)
    bpy.data.scenes.remove(elsewhere)
    messages = [{"type": "done", "scene": str(path)}]
    process = stand_in(cancelled=False, left=False, running=False, poll=lambda: [*messages], stop=lambda: None)
    return jobs.Job("Fine Ground", process)

"""Operators that change settings and build the scene with them, so that the window shows both at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from ..settings.blender import scene_properties
from .build import build_and_report
from .build_in_pieces import PiecewiseBuildOperator
from .live_preview import leave_to_build
from .window_areas import find_scene


class ChangeAndBuildOperator(PiecewiseBuildOperator):
    """Mix-in: an operator that changes settings and builds the scene with them. If the build fails or is stopped, the
    settings are as before."""

    _scene_uid = 0
    _before: Mapping[str, Mapping[str, Any]] | None = None  # the changed topics, once the operator has changed them

    def change_settings(self, scene: bpy.types.Scene, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change settings of the scene. The build that comes next shows them, and not the live preview."""
        before = scene_properties.read_unchecked(scene.icymoon)
        self._scene_uid = scene.session_uid
        self._before = {topic: before[topic] for topic in changes}
        with leave_to_build():
            scene_properties.write_settings(scene.icymoon, changes)

    def build_at_once(self, context: bpy.types.Context, coarse: bool = False) -> set[str]:
        """Build the scene with its changed settings, in full or with coarse ground, and return the operator's
        result."""
        result = build_and_report(self, context, coarse)
        if result == {"CANCELLED"}:
            self.take_back(context.scene)
        return result

    def take_back(self, scene: bpy.types.Scene) -> None:
        """Restore the settings that the scene had before the operator."""
        if self._before is not None:
            scene_properties.write_settings(scene.icymoon, self._before)

    def fail(self, error: Exception) -> set[str]:
        """Restore the settings, and report an error."""
        if (scene := find_scene(self._scene_uid)) is not None:
            self.take_back(scene)
        return super().fail(error)

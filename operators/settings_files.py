"""Load settings from TOML files, and save them."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..settings import preset_files, toml_text
from ..settings.blender import scene_properties
from ..support.errors import IcyMoonError
from ..support.files import write_text
from . import dialogs
from .sidebar_text import format_for_window


class ICYMOON_OT_load_settings(dialogs.TomlFileDialog, bpy.types.Operator):
    """Load settings from a TOML file. Settings that the file does not contain stay as they are"""

    bl_idname = "icymoon.load_settings"
    bl_label = "Load Settings"
    bl_options = {"REGISTER", "UNDO"}

    filepath: dialogs.file_property("TOML file to read")

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            scene_properties.write_settings(
                context.scene.icymoon, preset_files.load(Path(bpy.path.abspath(self.filepath)))
            )
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class ICYMOON_OT_save_settings(dialogs.TomlFileDialog, dialogs.SaveDialog, bpy.types.Operator):
    """Save all settings to a TOML file"""

    bl_idname = "icymoon.save_settings"
    bl_label = "Save Settings"
    first_name = "icymoon.toml"

    filepath: dialogs.file_property("TOML file to write")

    def save(self, context: bpy.types.Context, path: Path) -> None:
        write_text(path, toml_text.to_toml(scene_properties.read_settings(context.scene.icymoon)))


CLASSES = (ICYMOON_OT_load_settings, ICYMOON_OT_save_settings)

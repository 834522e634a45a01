"""Presets, and settings from and to TOML files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from .. import settings as description
from ..errors import IcyMoonError
from ..files import write_text

_items: list[tuple[str, str, str]] = []


def preset_items(_self: Any = None, _context: Any = None) -> list[tuple[str, str, str]]:
    """(name, title, description) of the shipped presets, read once; Blender needs them kept alive."""
    if not _items:
        _items.extend((name, *description.preset_header(name)) for name in description.preset_names())
    return _items


class ICYMOON_OT_load_preset(bpy.types.Operator):
    """Load a preset; a scene preset sets everything but the data set, others set their part"""

    bl_idname = "icymoon.load_preset"
    bl_label = "Load Preset"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "preset"

    preset: bpy.props.EnumProperty(items=preset_items, name="Preset",  # type: ignore[valid-type]
                                   description="What to load")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.properties.is_property_set("preset"):
            return self.execute(context)
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        group = context.scene.icymoon
        loaded = description.load(description.preset_path(self.preset))
        if self.preset.startswith("scenes/"):
            fresh = {t: v for t, v in description.defaults().items() if t not in ("dataset", "quality")}
            loaded = description.merged(fresh, loaded)
            group.preset = self.preset
        description.to_group(group, loaded)
        return {"FINISHED"}


class ICYMOON_OT_load_settings(bpy.types.Operator):
    """Load settings from a TOML file; what the file does not state stays as it is"""

    bl_idname = "icymoon.load_settings"
    bl_label = "Load Settings"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="File",  # type: ignore[valid-type]
                                       description="TOML file to read")
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            description.to_group(context.scene.icymoon, description.load(Path(bpy.path.abspath(self.filepath))))
        except IcyMoonError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class ICYMOON_OT_save_settings(bpy.types.Operator):
    """Save all settings to a TOML file"""

    bl_idname = "icymoon.save_settings"
    bl_label = "Save Settings"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="File",  # type: ignore[valid-type]
                                       description="TOML file to write")
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or "icymoon.toml"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath)).with_suffix(".toml")
        try:
            write_text(path, description.to_toml(description.from_group(context.scene.icymoon)))
        except IcyMoonError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Saved {path}")
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_load_preset, ICYMOON_OT_load_settings, ICYMOON_OT_save_settings)

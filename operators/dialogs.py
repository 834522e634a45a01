"""Dialogs in which operators ask for a missing property."""

from __future__ import annotations

import bpy

from .operator_type import OperatorMixin


class SearchDialog(OperatorMixin):
    """Mix-in: an operator whose ``bl_property`` is chosen in a search box if it is not given."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.properties.is_property_set(self.bl_property):
            return self.execute(context)
        context.window_manager.invoke_search_popup(self)
        return {"INTERFACE"}  # as Blender's own searches; a running operator would never be freed


class FileDialog:
    """Mix-in: an operator whose ``filepath`` is chosen in a file browser."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class TomlFileDialog(FileDialog):
    """Mix-in: an operator whose ``filepath`` is a TOML file, chosen in a file browser."""

    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

"""Dialogs in which operators ask for a missing property."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from .operator_type import OperatorMixin
from .sidebar_text import format_for_window


class SearchDialog(OperatorMixin):
    """Mix-in: an operator whose ``bl_property`` is chosen in a search box if it is not given."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.properties.is_property_set(self.bl_property):
            return self.execute(context)
        context.window_manager.invoke_search_popup(self)
        return {"INTERFACE"}  # return as Blender's own searches do; a running operator would never be freed


def file_property(description: str) -> Any:
    """Make the property ``filepath`` of a file dialog."""
    return bpy.props.StringProperty(subtype="FILE_PATH", name="File", description=description)


class FileDialog:
    """Mix-in: an operator whose ``filepath`` is chosen in a file browser."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class SaveDialog(FileDialog, OperatorMixin):
    """Mix-in: an operator that saves a file, chosen in a file browser."""

    #: The name that the browser proposes. The written file gets the suffix of this name.
    first_name: str
    filepath: file_property("File to write")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or self.first_name
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath)).with_suffix(Path(self.first_name).suffix)
        try:
            self.save(context, path)
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        self.report({"INFO"}, show_controls(f"Saved {path}"))
        return {"FINISHED"}

    def save(self, context: bpy.types.Context, path: Path) -> None:
        """Write the file. Raises IcyMoonError if it cannot be written."""
        raise NotImplementedError


class TomlFileDialog(FileDialog):
    """Mix-in: an operator whose ``filepath`` is a TOML file, chosen in a file browser."""

    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})


class JsonFileDialog(FileDialog):
    """Mix-in: an operator whose ``filepath`` is a JSON file, chosen in a file browser."""

    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})

"""Pictures of the shipped scenes, by which the user chooses one."""

from __future__ import annotations

from typing import Any

import bpy
import bpy.utils.previews

from ..operators.presets import preset_items
from ..settings.preset_files import is_whole, preview_path

#: Property of the window manager, which is not saved: the scene preset whose picture the sidebar shows.
CHOICE = "icymoon_scene_preset"
_NONE = ("NONE", "Choose a Scene", "The settings are not from one of these scenes")
_pictures: Any = None
_items: list[tuple[str, str, str, int, int]] = []


def _load_choices(_self: Any = None, _context: Any = None) -> list[tuple[str, str, str, int, int]]:
    """The shipped scenes that have a picture, read once. Blender requires that Python keeps the strings."""
    global _pictures
    if not _items:
        _pictures = bpy.utils.previews.new()
        _items.append((*_NONE, _pictures.load("choose", str(preview_path("choose")), "IMAGE").icon_id, 0))
        for name, title, meaning in preset_items():
            path = preview_path(name)
            if is_whole(name) and path.is_file():
                picture = _pictures.load(name, str(path), "IMAGE")
                _items.append((name, title, meaning, picture.icon_id, len(_items)))
    return _items


def _get(_self: Any) -> int:
    loaded = bpy.context.scene.icymoon.preset
    return next((number for name, *_, number in _load_choices() if name == loaded), 0)


def _set(_self: Any, number: int) -> None:
    name = _load_choices()[number][0]
    if number and name != bpy.context.scene.icymoon.preset:
        bpy.ops.icymoon.load_preset("EXEC_DEFAULT", True, preset=name)


def register() -> None:
    """Add the choice to the window manager."""
    setattr(bpy.types.WindowManager, CHOICE, bpy.props.EnumProperty(
        items=_load_choices, get=_get, set=_set, name="Scene", description="Choose a scene preset by its picture"))


def unregister() -> None:
    """Remove the choice and the pictures."""
    global _pictures
    delattr(bpy.types.WindowManager, CHOICE)
    _items.clear()
    if _pictures is not None:
        bpy.utils.previews.remove(_pictures)
        _pictures = None

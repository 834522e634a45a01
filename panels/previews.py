"""Pictures by which the user chooses a scene: the gallery, the other shipped scenes and the user's presets."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import bpy

from ..operators.presets import OWN, find_picture, is_changed, list_preset_items
from ..operators.window_areas import ButtonPictures
from ..settings.preset_files import find_preview, is_whole_scene

#: Property of the window manager for the scene preset whose picture the sidebar shows; it is not saved.
CHOICE = "icymoon_scene_preset"
_NO_CHOICE = ("NONE", "Choose a Scene", "The settings are not from one of these scenes")
_SHOWN_KINDS = ("gallery", "scenes", "own")  # landscapes first
Item = tuple[str, str, str, int, int]
_pictures = ButtonPictures()
_items: dict[tuple[tuple[str, int], ...], list[Item]] = {}  # by picture and time; Blender needs the texts kept alive


def load_choices(_self: object = None, _context: object = None) -> list[Item]:
    """Load the choices of scenes that have a picture. Each picture is read once until it changes."""
    whole = [(item, find_picture(item[0])) for item in list_preset_items() if is_whole_scene(item[0])]
    shown = sorted(
        (each for each in whole if _exists(each[0][0], each[1])),
        key=lambda each: _SHOWN_KINDS.index(each[0][0].split("/")[0]),
    )
    state = tuple((item[0], path.stat().st_mtime_ns if item[0].startswith(OWN) else 0) for item, path in shown)
    if state not in _items:
        items = [(*_NO_CHOICE, _load_icon("choose", find_preview("choose")), 0)]
        for (name, changed_ns), (item, path) in zip(state, shown, strict=True):
            items.append((*item, _load_icon(f"{name} {changed_ns}", path), len(items)))
        _items[state] = items
    return _items[state]


def _load_icon(key: str, path: Path) -> int:
    known = _pictures.collection
    return int((known.get(key) or known.load(key, str(path), "IMAGE")).icon_id)


def _exists(name: str, picture: Path) -> bool:
    return picture.is_file() if name.startswith(OWN) else _is_shipped(picture)


@cache
def _is_shipped(picture: Path) -> bool:
    return picture.is_file()


def _get_choice(_self: object) -> int:
    loaded = bpy.context.scene.icymoon.preset
    return next((number for name, *_, number in load_choices() if name == loaded), 0)


def _set_choice(_self: object, number: int) -> None:
    name = load_choices()[number][0]
    scene = bpy.context.scene
    if number and (name != scene.icymoon.preset or is_changed(scene)):
        bpy.ops.icymoon.load_preset("INVOKE_DEFAULT", True, preset=name, build=True)


def register() -> None:
    """Add the choice to the window manager."""
    setattr(
        bpy.types.WindowManager,
        CHOICE,
        bpy.props.EnumProperty(
            items=load_choices,
            get=_get_choice,
            set=_set_choice,
            name="Scene",
            description="Choose a scene preset by its picture",
        ),
    )


def unregister() -> None:
    """Remove the choice and the pictures."""
    delattr(bpy.types.WindowManager, CHOICE)
    _items.clear()
    _pictures.remove()

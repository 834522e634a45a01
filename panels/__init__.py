"""The Icy Moon tab of the 3D View's sidebar, and the menu that F3 searches."""

from __future__ import annotations

import bpy

from . import menu, previews, sidebar, topics, trade

CLASSES = (*sidebar.CLASSES, *topics.CLASSES, *sidebar.DETAILS, *trade.CLASSES, *menu.CLASSES)

_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Register panels and menus."""
    _register()
    previews.register()
    menu.register()


def unregister() -> None:
    """Unregister them."""
    menu.unregister()
    previews.unregister()
    _unregister()

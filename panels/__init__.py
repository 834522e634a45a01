"""The Icy Moon tab in the sidebar of the 3D View, and the menus."""

from __future__ import annotations

import bpy

from . import active_sensors, find_setting, menu, pair_views, previews, recent_pairs, sidebar, topics, trade, vary

CLASSES = (
    *find_setting.CLASSES,
    *sidebar.CLASSES,
    *recent_pairs.CLASSES,
    *topics.CLASSES,
    *active_sensors.CLASSES,
    *vary.CLASSES,
    *sidebar.DETAILS,
    *trade.CLASSES,
    *menu.CLASSES,
)

_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Register panels and menus."""
    _register()
    previews.register()
    find_setting.register()
    menu.register()
    pair_views.register()
    vary.register()


def unregister() -> None:
    """Unregister panels and menus."""
    vary.unregister()
    pair_views.unregister()
    menu.unregister()
    find_setting.unregister()
    previews.unregister()
    _unregister()

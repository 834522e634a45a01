"""The settings as Blender's properties, ``Scene.icymoon``: made from the table, read, written and listened to.

Listeners are told of each change of a property, with the effect of its setting as in the table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import bpy

from . import compat
from .physics.surfaces import principled
from .settings.description import canonical, check
from .settings.table import EFFECTS, TOPICS, Setting, Value
from .typed_settings import Settings, typed

#: Called with a scene and the effects of the settings that changed in it.
listeners: list[Callable[[Any, frozenset[str]], None]] = []
_held: dict[Any, set[str]] | None = None  # effects that ``batch_changes`` holds back, by scene


def announce(scene: Any, effect: str) -> None:
    """Tell the listeners that a setting with this effect has changed."""
    if _held is not None:
        _held.setdefault(scene, set()).add(effect)
        return
    for listener in listeners:
        listener(scene, frozenset({effect}))


@contextmanager
def batch_changes() -> Iterator[None]:
    """Tell the listeners of all changes inside it at once, at its end."""
    global _held
    if _held is not None:
        yield
        return
    held: dict[Any, set[str]] = {}
    _held = held
    try:
        yield
    finally:
        _held = None
        for scene, effects in held.items():
            for listener in listeners:
                listener(scene, frozenset(effects))


def _register_group(name: str, doc: str, annotations: dict[str, Any]) -> type:
    """Make and register a property group."""
    group = type(name, (bpy.types.PropertyGroup,), {"__doc__": doc, "__annotations__": annotations})
    bpy.utils.register_class(group)
    _classes.append(group)
    return group


def _make_property(topic: str, setting: Setting) -> Any:
    """The property of a setting, which announces its changes."""
    def update(group: Any, context: Any) -> None:
        announce(group.id_data, setting.effect)

    if setting.kind == "list":
        entry = _register_group(f"ICYMOON_PG_{topic}_{setting.key}", setting.description,
                                {s.key: _make_property(topic, s) for s in setting.entries})
        return bpy.props.CollectionProperty(type=entry, name=setting.label, description=setting.description)
    common: dict[str, Any] = {"name": setting.label, "description": setting.description,
                              "default": setting.default, "update": update}
    if setting.kind == "bool":
        return bpy.props.BoolProperty(**common)
    if setting.kind == "choice":
        return bpy.props.EnumProperty(items=setting.choices, **common)
    if setting.kind == "text":
        if setting.subtype in ("DIR_PATH", "FILE_PATH"):
            return bpy.props.StringProperty(subtype=setting.subtype, options=compat.path_options(), **common)
        return bpy.props.StringProperty(**common)
    low, high = setting.soft or (setting.minimum, setting.maximum)
    common |= {"min": setting.minimum, "max": setting.maximum, "soft_min": low, "soft_max": high,
               "subtype": setting.subtype}
    if setting.kind == "int":
        return bpy.props.IntProperty(**common)
    unit = {"DISTANCE": "LENGTH", "DISTANCE_CAMERA": "CAMERA"}.get(setting.subtype, "NONE")
    return bpy.props.FloatProperty(precision=setting.precision, unit=unit, **common)


_classes: list[type] = []


def register() -> None:
    """Make the property groups from ``TOPICS`` and add them as ``Scene.icymoon``.

    Also selects the table of Principled albedos for this version of Blender.
    """
    principled.use_table(compat.principled_table())
    pointers: dict[str, Any] = {}
    for topic in TOPICS.values():
        members = {s.key: _make_property(topic.key, s) for s in topic.settings}
        members |= {f"{s.key}_active": bpy.props.IntProperty(name=f"Selected of {s.label}", min=0,
                                                               description="The entry that the sidebar shows")
                    for s in topic.settings if s.kind == "list"}
        group = _register_group(f"ICYMOON_PG_{topic.key}", topic.description, members)
        pointers[topic.key] = bpy.props.PointerProperty(type=group, name=topic.label,
                                                        description=topic.description)
    pointers["results"] = bpy.props.StringProperty(name="Results", options={"HIDDEN"},
                                                   description="The last evaluation and its settings")
    pointers["preset"] = bpy.props.StringProperty(name="Preset", description="The scene preset that was loaded last")
    pointers["live"] = bpy.props.BoolProperty(
        name="Live Preview", default=True, update=lambda group, context: announce(group.id_data, EFFECTS[0]),
        description="Show changed settings at once in the built scene. The ground is coarse until Build Scene")
    pointers["follow"] = bpy.props.BoolProperty(
        name="Keep Image Up to Date", default=True,
        description="Develop the shown camera image again when the camera response changes")
    root = _register_group("ICYMOON_PG_description", "All settings of an Icy Moon scene", pointers)
    bpy.types.Scene.icymoon = bpy.props.PointerProperty(
        type=root, name="Icy Moon", description="All settings of an Icy Moon scene")


def unregister() -> None:
    """Undo ``register``, in reverse order."""
    del bpy.types.Scene.icymoon
    while _classes:
        bpy.utils.unregister_class(_classes.pop())


def read_settings(group: Any) -> Settings:
    """The complete settings in a ``Scene.icymoon`` property group.

    Anyone may have made the scene. Raises IcyMoonError if a settings file with these values would be refused.
    """
    return check(read_unchecked(group), "This scene")


def read_unchecked(group: Any) -> Settings:
    """The complete settings without a check: to show them, not to pass them to a process."""
    return typed({topic: {s.key: _read_property(s, getattr(getattr(group, topic), s.key))
                          for s in TOPICS[topic].settings} for topic in TOPICS})


def _read_property(setting: Setting, value: Any) -> Value:
    if setting.kind == "list":
        return [{s.key: _read_property(s, getattr(item, s.key)) for s in setting.entries} for item in value]
    return canonical(setting, value)


def write_settings(group: Any, settings: Mapping[str, Mapping[str, Value]]) -> None:
    """Write checked settings, all or some, into a ``Scene.icymoon`` property group."""
    with batch_changes():
        for topic, values in settings.items():
            for key, value in values.items():
                if isinstance(value, list):
                    _fill(getattr(getattr(group, topic), key), value)
                    announce(group.id_data, TOPICS[topic][key].effect)
                else:
                    setattr(getattr(group, topic), key, value)


def _fill(collection: Any, entries: list[dict[str, Any]]) -> None:
    """Replace the entries of a list of property groups."""
    collection.clear()
    for entry in entries:
        item = collection.add()
        for name, value in entry.items():
            setattr(item, name, value)

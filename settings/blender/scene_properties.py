"""The settings as Blender's properties, ``Scene.icymoon``: makes them from the table, reads and writes them.

Each change of a property is announced to listeners with the effect of its setting in the table.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np

from ...formats.lidar_file import read_lidar
from ...physics.lidar.digitiser import SAMPLE_COUNTS
from ...physics.surfaces import principled
from ...plugins.landforms import PREFIX
from ...render.plans.vary_scene import COMBINATIONS, SPACINGS, SceneVariations, VariedSetting
from ...support.blender import compat
from ...support.errors import IcyMoonError
from ..change_announcements import COLOURS, LIDAR_POINTS, announce, batch_changes, count_changes, make_update_callback
from ..description import check, to_canonical
from ..landform_releases import fill_in_releases, refuse_missing_landforms
from ..mirrored_properties import make_mirror
from ..preset_files import LIDARS, lidar_names
from ..table import TOPICS, list_all_settings
from ..topics.declaration import EFFECTS, Setting, Value
from ..topics.scene import Settings, typed

#: Settings that were read to be displayed, with the time, by the scene's ``session_uid``.
_displayed_settings: dict[int, tuple[float, int, Settings]] = {}
#: Lifetime in seconds of displayed settings, longer than a redraw. Animation changes properties without notice, so
#: settings are then read again. Undo also changes them without notice, and may come sooner after a redraw.
_REDRAW_S = 0.05
_UNDO = (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post)


def _register_group(name: str, doc: str, annotations: dict[str, Any]) -> type:
    """Make and register a property group."""
    group = type(name, (bpy.types.PropertyGroup,), {"__doc__": doc, "__annotations__": annotations})
    bpy.utils.register_class(group)
    _classes.append(group)
    return group


def make_property(setting: Setting, **other: object) -> object:
    """Make a Blender property with the label, tooltip, default and range of a setting that is not a list.

    ``other`` are keywords of Blender's property that replace or extend the keywords of the setting.
    """
    common: dict[str, Any] = {"name": setting.label, "description": setting.description, "default": setting.default}
    if setting.kind == "bool":
        return bpy.props.BoolProperty(**common | other)
    if setting.kind == "choice":
        return bpy.props.EnumProperty(**common | {"items": setting.choices} | other)
    if setting.kind == "text":
        if setting.subtype in ("DIR_PATH", "FILE_PATH"):
            common |= {"subtype": setting.subtype, "options": compat.list_path_options()}
        return bpy.props.StringProperty(**common | other)
    low, high = setting.soft or (setting.minimum, setting.maximum)
    common |= {
        "min": setting.minimum,
        "max": setting.maximum,
        "soft_min": low,
        "soft_max": high,
        "subtype": setting.subtype,
    }
    if setting.kind == "int":
        return bpy.props.IntProperty(**common | other)
    unit = {"DISTANCE": "LENGTH", "DISTANCE_CAMERA": "CAMERA"}.get(setting.subtype, "NONE")
    return bpy.props.FloatProperty(**common | {"precision": setting.precision, "unit": unit} | other)


def _make_scene_property(topic: str, setting: Setting) -> object:
    """Make the property of a setting of the scene; it announces its changes."""
    if setting.kind != "list":
        return make_property(setting, update=make_update_callback(setting.effect))
    entry = _register_group(
        f"ICYMOON_PG_{topic}_{setting.key}",
        setting.description,
        {s.key: _make_scene_property(topic, s) for s in setting.entries},
    )
    return bpy.props.CollectionProperty(type=entry, name=setting.label, description=setting.description)


_classes: list[type] = []


def _make_variations() -> object:
    """Make the property of the varied settings of a data set, which is stored beside the settings."""
    update = make_update_callback("run")
    tick = _register_group(
        "ICYMOON_PG_tick",
        "A value of a choice",
        {"on": bpy.props.BoolProperty(name="On", default=True, update=update, description="Use this value")},
    )
    varied = _register_group(
        "ICYMOON_PG_varied",
        "A setting that varies",
        {
            "setting": bpy.props.StringProperty(name="Setting", update=update, description="Setting that varies"),
            "ticks": bpy.props.CollectionProperty(type=tick, name="Values", description="The values of a choice"),
            **make_varied_fields(update=update),
        },
    )
    group = _register_group(
        "ICYMOON_PG_variations",
        "What varies over the pairs of a data set",
        {
            "varied": bpy.props.CollectionProperty(
                type=varied, name="Varied Settings", description="The settings that vary"
            ),
            "active": bpy.props.IntProperty(name="Selected Setting", min=0, description="Which one the sidebar shows"),
            "combine": bpy.props.EnumProperty(
                name="Combine",
                update=update,
                description="Which pairs are made",
                items=(
                    (COMBINATIONS[0], "Every Combination", "Each value of one setting with each value of the others"),
                    (COMBINATIONS[1], "One at a Time", "The scene as it is, then each value alone"),
                    (COMBINATIONS[2], "Sobol Draws", "A number of pairs that fill the space of all settings evenly"),
                ),
            ),
            "draws": bpy.props.IntProperty(
                name="Draws",
                default=16,
                min=1,
                soft_max=256,
                max=100000,
                update=update,
                description="Number of Sobol draws; 2, 4, 8, 16, … fill the space evenly",
            ),
            "seeds": bpy.props.IntProperty(
                name="Variations by Seed",
                default=1,
                min=1,
                soft_max=20,
                max=100000,
                update=update,
                description="Number of grounds of the same kind: that of the present seed, then others",
            ),
            "folder": bpy.props.StringProperty(
                name="Rendered Folder",
                options={"HIDDEN"},
                description="Folder into which the variations were rendered last",
            ),
            "pairs": bpy.props.StringProperty(
                name="Rendered Variations", options={"HIDDEN"}, description="Ids of the variations that were rendered"
            ),
        },
    )
    return bpy.props.PointerProperty(
        type=group, name="Variations", description="What varies over the pairs of a data set"
    )


def make_varied_fields(**common: object) -> dict[str, Any]:
    """Make the Blender properties of the values of a varied number, for the list and for the dialog."""
    ends = (("first", "From", "The first value"), ("last", "To", "The last value"))
    shown = {
        shown_property_name(end, precision): bpy.props.FloatProperty(
            name=name, description=description, precision=precision, options={"HIDDEN", "SKIP_SAVE"}, **make_mirror(end)
        )
        for end, name, description in ends
        for precision in sorted({s.precision for _, s in list_all_settings()})
    }
    return {
        "first": bpy.props.FloatProperty(name="From", precision=6, description="The first value", **common),
        "last": bpy.props.FloatProperty(name="To", precision=6, description="The last value", **common),
        **shown,
        "first_whole": bpy.props.IntProperty(name="From", description="The first value", **common),
        "last_whole": bpy.props.IntProperty(name="To", description="The last value", **common),
        "count": bpy.props.IntProperty(
            name="Values",
            default=5,
            min=2,
            soft_max=20,
            max=1000,
            description="Number of values, with both ends",
            **common,
        ),
        "spacing": bpy.props.EnumProperty(
            name="Spacing",
            description="Distance between the values",
            items=(
                (SPACINGS[0], "Even Steps", "The same difference between two values"),
                (SPACINGS[1], "Even Ratios", "The same ratio of two values, as in 1, 2, 4, 8"),
                (SPACINGS[2], "Random", "Random values between the ends"),
            ),
            **common,
        ),
    }


def shown_property_name(end: str, precision: int) -> str:
    """Return the name of the property that shows the ``first`` or ``last`` value of a varied number with ``precision``
    decimals.

    The decimals of a property are fixed, and each setting has its own.
    """
    return f"{end}_with_{precision}"


def read_variations(group: bpy.types.PropertyGroup) -> SceneVariations:
    """Read the varied settings of a ``Scene.icymoon`` property group, unchecked."""
    stated = group.variations
    return SceneVariations(tuple(map(read_item, stated.varied)), stated.combine, stated.draws, stated.seeds)


def read_item(item: bpy.types.PropertyGroup) -> VariedSetting:
    """Read one entry of the list of varied settings, unchecked."""
    return read_varied(item, item.setting, tuple(tick.name for tick in item.ticks if tick.on))


def read_varied(fields: bpy.types.PropertyGroup, name: str, values: tuple[str, ...]) -> VariedSetting:
    """Read the varied setting of this name from properties that ``make_varied_fields`` made."""
    topic, _, key = name.partition(".")
    setting = next((s for s in TOPICS[topic].settings if s.key == key), None) if topic in TOPICS else None
    if setting is None or setting.kind not in ("int", "float"):
        return VariedSetting(name, values=values)
    whole = "_whole" if setting.kind == "int" else ""
    first, last = getattr(fields, f"first{whole}"), getattr(fields, f"last{whole}")
    if not whole:
        first, last = _shortest_single(first), _shortest_single(last)
    return VariedSetting(name, first, last, fields.count, fields.spacing)


def _shortest_single(value: float) -> float:
    """Return a single-precision number of Blender in its shortest spelling."""
    return float(str(np.float32(value)))


def write_varied(group: bpy.types.PropertyGroup, varied: VariedSetting) -> None:
    """Store the varied values of a setting in the list, in its existing row or at the end, and select it."""
    stated, setting = group.variations, varied.setting
    place = next((k for k, item in enumerate(stated.varied) if item.setting == varied.name), len(stated.varied))
    item = stated.varied[place] if place < len(stated.varied) else stated.varied.add()
    whole = "_whole" if setting.kind == "int" else ""
    wanted = {"setting": varied.name, "count": varied.count, "spacing": varied.spacing}
    if setting.kind in ("int", "float"):
        wanted |= {f"first{whole}": varied.first, f"last{whole}": varied.last}
    for name, value in wanted.items():
        setattr(item, name, value)
    item.ticks.clear()
    for choice in setting.choices:
        tick = item.ticks.add()
        tick.name, tick.on = choice[0], choice[0] in varied.values
    stated.active = place


#: The choice for a scanner in the user's own file.
OWN_SCANNER = "OWN"
#: How the points of a LiDAR can be coloured, see ``stereo.lidar_view``.
_LIDAR_COLOURS = (
    ("INTENSITY", "Intensity", "The light that came back, in electrons or, without a detector, photons"),
    ("RANGE_ERROR", "Range Error", "Measured less true range: red is too far, blue is too near"),
    ("ICE_DELAY", "Delay in Ice", "How much farther ice seems, because light comes back late"),
    ("RETURN_NUMBER", "Return Number", "First, second or later return of its beam, or a false alarm"),
)


def _make_lidar() -> object:
    """Make the property of the laser scanner with which the window scans, beside the settings."""
    scanners = [(name, read_lidar(LIDARS / f"{name}.toml").title, "") for name in lidar_names()]
    counts = {"min": 0, "max": 100000}
    group = _register_group(
        "ICYMOON_PG_lidar",
        "A laser scanner at the left eye",
        {
            "scanner": bpy.props.EnumProperty(
                name="Scanner",
                description="Pattern, laser and detector of the scanner",
                items=[*scanners, (OWN_SCANNER, "File of Your Own", "A TOML file, as icymoon lidar reads it")],
                default="ouster_os1",
            ),
            "file": bpy.props.StringProperty(
                name="Scanner File",
                description="TOML file of a laser scanner",
                subtype="FILE_PATH",
                options=compat.list_path_options(),
            ),
            "rows": bpy.props.IntProperty(name="Rows", description="Rows of beams; 0 for the scanner's own", **counts),
            "columns": bpy.props.IntProperty(
                name="Columns", description="Columns of beams; 0 for the scanner's own", **counts
            ),
            "detector": bpy.props.BoolProperty(
                name="Detector", default=True, description="Simulate the detector: noise, lost returns, false alarms"
            ),
            "ice": bpy.props.BoolProperty(
                name="Light in Ice",
                default=True,
                description="Let light enter snow and ice, which it leaves late",
            ),
            "waveforms": bpy.props.EnumProperty(
                name="Waveforms",
                description="Samples of what an analog detector receives of each pulse, written to lidar.wdp",
                items=[("NONE", "None", "Ranges only"), *((str(n), f"{n} Samples", "") for n in SAMPLE_COUNTS)],
            ),
            **_make_look_of_points(),
        },
    )
    return bpy.props.PointerProperty(type=group, name="LiDAR", description="A laser scanner at the left eye")


def _make_look_of_points() -> dict[str, Any]:
    """Make the properties that control the display of a scan's points."""
    update = make_update_callback(LIDAR_POINTS)
    return {
        "colour": bpy.props.EnumProperty(
            name="Colour", description="What the colours of points show", items=_LIDAR_COLOURS, update=update
        ),
        "points": bpy.props.IntProperty(
            name="Points Shown",
            default=10000,
            min=1,
            max=100000,
            update=update,
            description="Number of points to show, a random part of the scan",
        ),
    }


def _make_beside_settings() -> dict[str, Any]:
    """Make the properties of a scene beside its settings."""
    return {
        "results": bpy.props.StringProperty(
            name="Results", options={"HIDDEN"}, description="The last evaluation and its settings"
        ),
        "pairs": bpy.props.StringProperty(
            name="Rendered Pairs", options={"HIDDEN"}, description="Ids of the pairs that were rendered last"
        ),
        "preset": bpy.props.StringProperty(name="Preset", description="The scene preset that was loaded last"),
        "live": bpy.props.BoolProperty(
            name="Live Preview",
            default=True,
            update=make_update_callback(EFFECTS[0]),
            description="Show changed settings at once in the built scene. The ground is coarse until Build Scene",
        ),
        "follow": bpy.props.BoolProperty(
            name="Keep Image Up to Date",
            default=True,
            description="Develop the shown camera image again when the camera response changes",
        ),
        "error_range_m": bpy.props.FloatProperty(
            name="Full Colour at",
            default=1.0,
            min=0.02,
            max=1000.0,
            soft_max=10.0,
            subtype="DISTANCE",
            unit="LENGTH",
            precision=2,
            update=make_update_callback(COLOURS),
            description="Depth error with the full colour. Below 1 cm is white, and the scale between is logarithmic",
        ),
        "lidar": _make_lidar(),
        "variations": _make_variations(),
    }


def register() -> None:
    """Make the property groups from ``TOPICS`` and add them as ``Scene.icymoon``.

    Also selects the table of Principled albedos for this version of Blender.
    """
    principled.use_table(compat.choose_principled_table())
    pointers: dict[str, Any] = {}
    for topic in TOPICS.values():
        members = {s.key: _make_scene_property(topic.key, s) for s in topic.settings}
        members |= {
            f"{s.key}_active": bpy.props.IntProperty(
                name=f"Selected of {s.label}", min=0, description="The entry that the sidebar shows"
            )
            for s in topic.settings
            if s.kind == "list"
        }
        group = _register_group(f"ICYMOON_PG_{topic.key}", topic.description, members)
        pointers[topic.key] = bpy.props.PointerProperty(type=group, name=topic.label, description=topic.description)
    pointers |= _make_beside_settings()
    root = _register_group("ICYMOON_PG_description", "All settings of an Icy Moon scene", pointers)
    bpy.types.Scene.icymoon = bpy.props.PointerProperty(
        type=root, name="Icy Moon", description="All settings of an Icy Moon scene"
    )
    for handlers in _UNDO:
        handlers.append(_forget_displayed)


def unregister() -> None:
    """Undo ``register``, in reverse order."""
    for handlers in _UNDO:
        handlers.remove(_forget_displayed)
    del bpy.types.Scene.icymoon
    while _classes:
        bpy.utils.unregister_class(_classes.pop())


def read_settings(group: bpy.types.PropertyGroup) -> Settings:
    """Read the complete settings from a ``Scene.icymoon`` property group.

    Anyone may have made the scene. Raises IcyMoonError if a settings file with these values would be refused, and if
    the scene has settings of a landform whose package this Blender lacks.
    """
    if left := find_missing_landforms(group):
        raise IcyMoonError(
            f"This scene has settings of {', '.join(left)}, a landform of a package that is not "
            "installed in this Blender; install it, or make a new scene."
        )
    return check(read_unchecked(group), "This scene")


def find_missing_landforms(group: bpy.types.PropertyGroup) -> list[str]:
    """Find the landforms of missing plug-ins that the scene uses."""
    return sorted(
        name
        for name, values in compat.read_stored_groups(group).items()
        if name.startswith(PREFIX) and name not in TOPICS and any(values.values())
    )


def read_for_display(group: bpy.types.PropertyGroup) -> Settings:
    """Read the settings as ``read_unchecked`` does, but once for all panels of a redraw. They must not be changed.
    Equal settings are the same object, so results computed from them can be cached by identity."""
    now, changes, uid = time.monotonic(), count_changes(), group.id_data.session_uid
    kept = _displayed_settings.get(uid)
    if kept is None or kept[1] != changes or now - kept[0] > _REDRAW_S:
        found = read_unchecked(group)
        kept = _displayed_settings[uid] = now, changes, kept[2] if kept and kept[2] == found else found
    return kept[2]


@bpy.app.handlers.persistent
def _forget_displayed(*_: object) -> None:
    """Read the displayed settings anew at the next redraw; called after undo and redo."""
    _displayed_settings.clear()


def read_unchecked(group: bpy.types.PropertyGroup) -> Settings:
    """Read the complete settings without a check. Only display them; do not pass them to a process."""
    return fill_in_releases(
        typed(
            {
                topic: {s.key: _read_property(s, getattr(getattr(group, topic), s.key)) for s in TOPICS[topic].settings}
                for topic in TOPICS
            }
        )
    )


def _read_property(setting: Setting, value: Any) -> Value:
    if setting.kind == "list":
        return [{s.key: _read_property(s, getattr(item, s.key)) for s in setting.entries} for item in value]
    return to_canonical(setting, value)


def write_settings(group: bpy.types.PropertyGroup, settings: Mapping[str, Mapping[str, Value]]) -> None:
    """Write checked settings, all or some, into a ``Scene.icymoon`` property group.

    Raises IcyMoonError if they have a landform of a plug-in that this Blender does not have.
    """
    refuse_missing_landforms(settings, "These settings")
    with batch_changes():
        for topic, values in settings.items():
            for key, value in values.items():
                if isinstance(value, list):
                    _replace_entries(getattr(getattr(group, topic), key), value)
                    announce(group.id_data, TOPICS[topic][key].effect)
                else:
                    setattr(getattr(group, topic), key, value)


def _replace_entries(collection: bpy.types.bpy_prop_collection, entries: list[dict[str, Any]]) -> None:
    """Replace the entries of a list of property groups."""
    collection.clear()
    for entry in entries:
        item = collection.add()
        for name, value in entry.items():
            setattr(item, name, value)

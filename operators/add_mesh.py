"""Add ▸ Mesh: a patch of icy ground, or a rock, as an ordinary object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..nodes.add_objects import build_rock_object, build_terrain_object
from ..settings import description
from ..settings.blender import scene_properties
from ..settings.preset_files import load_preset
from ..settings.table import TOPICS, list_ground_settings
from ..settings.topics.declaration import LANDFORMS
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from .operator_type import ExplainedOperator
from .presets import list_preset_items
from .sidebar_text import format_for_window


class _AddOperator(ExplainedOperator):
    """Mix-in: an operator that makes an object from its own settings and the scene's settings, at the 3D cursor."""

    #: (topic, key) of each setting that the operator replaces, by the name of its property.
    own_settings: dict[str, tuple[str, str]]
    seed: int

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if context.mode == "OBJECT" else "Only in Object Mode"

    def read_settings(self, context: bpy.types.Context) -> Settings:
        own = [{topic: {key: getattr(self, name)}} for name, (topic, key) in self.own_settings.items()]
        return description.merged(scene_properties.read_settings(context.scene.icymoon), *own)

    def add_object(self, context: bpy.types.Context, make: Callable[[], bpy.types.Object]) -> set[str]:
        try:
            item = make()
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        context.collection.objects.link(item)
        item.location = context.scene.cursor.location
        for other in context.selected_objects:
            other.select_set(False)
        item.select_set(True)
        context.view_layer.objects.active = item
        return {"FINISHED"}


#: Settings of the ground that the redo panel shows at once; the others are under Advanced.
_MAIN_SETTINGS = ("size_m", "resolution", "rms_slope_deg", "hurst")
_LANDFORM_TOPICS = tuple(key for key, topic in TOPICS.items() if topic.parent == LANDFORMS)
_PROPERTY_OPTIONS: dict[str, dict[str, Any]] = {"resolution": {"default": 257}}


def _list_terrains(_self: object = None, _context: object = None) -> list[tuple[str, str, str]]:
    terrains = [item for item in list_preset_items() if item[0].startswith("terrains/")]
    return [_AS_IN_SIDEBAR, *terrains]


_AS_IN_SIDEBAR = ("SIDEBAR", "As in the Sidebar", "The ground that the sidebar describes")


class ICYMOON_OT_add_terrain(_AddOperator, bpy.types.Operator):
    """Add a patch of procedural ice as an ordinary mesh, of the ground in the sidebar or of a preset"""

    bl_idname = "icymoon.add_terrain"
    bl_label = "Icy Terrain"
    bl_options = {"REGISTER", "UNDO"}

    own_settings = list_ground_settings()
    __annotations__ = {
        name: scene_properties.make_property(
            TOPICS[topic][key], options={"SKIP_SAVE"}, **_PROPERTY_OPTIONS.get(name, {})
        )
        for name, (topic, key) in own_settings.items()
    }
    preset: bpy.props.EnumProperty(
        items=_list_terrains, name="Ground", description="Ground to start from", options={"SKIP_SAVE"}
    )
    advanced: bpy.props.BoolProperty(
        name="Advanced", description="Show all settings of the ground", options={"SKIP_SAVE"}
    )
    #: The preset that the other properties were filled from; empty before the first execution.
    filled_from: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def read_settings(self, context: bpy.types.Context) -> Settings:
        """Return the settings of the sidebar or the preset, with the changes made in this operator."""
        start = scene_properties.read_settings(context.scene.icymoon)
        if self.preset != _AS_IN_SIDEBAR[0]:
            start = description.merged(
                start,
                {key: description.defaults()[key] for key in ("terrain", *_LANDFORM_TOPICS)},
                load_preset(self.preset),
            )
        if self.filled_from != self.preset:
            self._fill(start)
        own = [{topic: {key: getattr(self, name)}} for name, (topic, key) in self.own_settings.items()]
        return description.merged(start, *own)

    def _fill(self, start: Settings) -> None:
        """Fill the settings that the caller did not set from ``start``.

        A preset that is chosen later, in the redo panel, replaces all settings but size, resolution and seed.
        """
        first = not self.filled_from
        for name, (topic, key) in self.own_settings.items():
            given = self.properties.is_property_set(name) if first else name in ("size_m", "seed")
            if not given and name != "resolution":
                setattr(self, name, start[topic][key])
        self.filled_from = self.preset

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.add_object(context, lambda: build_terrain_object(self.read_settings(context)))

    def draw(self, context: bpy.types.Context) -> None:
        layout: bpy.types.UILayout = self.layout
        layout.use_property_split = True
        layout.prop(self, "preset")
        ground = [name for name, (topic, _) in self.own_settings.items() if topic == "terrain"]
        for name in (*_MAIN_SETTINGS, "seed"):
            layout.prop(self, name)
        for topic in _LANDFORM_TOPICS:
            names = [name for name, (owner, _) in self.own_settings.items() if owner == topic]
            column = layout.column(align=True)
            column.prop(self, names[0], text=f"{TOPICS[topic].label}: {TOPICS[topic].settings[0].label}")
            for name in names[1:] if getattr(self, names[0]) > 0 else ():
                column.prop(self, name)
        layout.prop(self, "advanced")
        for name in ground if self.advanced else ():
            if name not in _MAIN_SETTINGS:
                layout.prop(self, name)


class ICYMOON_OT_add_block(_AddOperator, bpy.types.Operator):
    """Add a rock as an ordinary mesh, with the surface that rocks have in the sidebar. In the collection Icy Moon it is rendered"""  # noqa: E501

    bl_idname = "icymoon.add_block"
    bl_label = "Ice Rock"
    bl_options = {"REGISTER", "UNDO"}

    own_settings = {key: ("rocks", key) for key in ("family", "angularity", "elongation", "height_ratio")} | {
        "seed": ("dataset", "seed")
    }
    diameter_m: bpy.props.FloatProperty(
        name="Diameter",
        default=0.5,
        min=1.0e-3,
        max=1.0e4,
        soft_min=0.05,
        soft_max=10.0,
        subtype="DISTANCE",
        unit="LENGTH",
        description="Diameter of a circle with the same area as the rock, seen from above",
    )
    family: bpy.props.EnumProperty(
        name="Shape", items=TOPICS["rocks"]["family"].choices[1:], default="FRAGMENTS", description="Shape of the rock"
    )
    angularity: scene_properties.make_property(TOPICS["rocks"]["angularity"])
    elongation: scene_properties.make_property(TOPICS["rocks"]["elongation"])
    height_ratio: scene_properties.make_property(TOPICS["rocks"]["height_ratio"])
    seed: scene_properties.make_property(TOPICS["dataset"]["seed"])

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.add_object(context, lambda: build_rock_object(self.read_settings(context), self.diameter_m))


CLASSES = (ICYMOON_OT_add_terrain, ICYMOON_OT_add_block)

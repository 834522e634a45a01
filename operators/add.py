"""Add ▸ Mesh: a patch of icy ground, or a rock, as an ordinary object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from .. import scene_properties
from ..errors import IcyMoonError
from ..nodes.add_objects import build_rock_object, build_terrain_object
from ..settings import description
from ..settings.table import TOPICS
from ..typed_settings import Settings
from .sidebar_text import in_window


def setting_property(topic: str, key: str, **other: Any) -> Any:
    """A property of an operator with the label, range and tooltip of a setting."""
    setting = TOPICS[topic][key]
    low, high = setting.soft or (setting.minimum, setting.maximum)
    make = bpy.props.IntProperty if setting.kind == "int" else bpy.props.FloatProperty
    return make(**{"name": setting.label, "description": setting.description, "default": setting.default,
                   "min": setting.minimum, "max": setting.maximum, "soft_min": low, "soft_max": high,
                   "subtype": setting.subtype, **other})


class _AddOperator:
    """Mix-in: makes an object from the settings of the scene and of the operator, at the 3D cursor."""

    #: (topic, key) of each setting that the operator replaces, by the name of its property.
    own_settings: dict[str, tuple[str, str]]
    seed: Any

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Only in Object Mode")  # type: ignore[attr-defined]
        return bool(context.mode == "OBJECT")

    def read_settings(self, context: bpy.types.Context) -> Settings:
        own = [{topic: {key: getattr(self, name)}} for name, (topic, key) in self.own_settings.items()]
        return description.merged(scene_properties.read_settings(context.scene.icymoon), *own)

    def add(self, context: bpy.types.Context, make: Callable[[], bpy.types.Object]) -> set[str]:
        try:
            item = make()
        except IcyMoonError as error:
            self.report({"ERROR"}, in_window(error))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        context.collection.objects.link(item)
        item.location = context.scene.cursor.location
        for other in context.selected_objects:
            other.select_set(False)
        item.select_set(True)
        context.view_layer.objects.active = item
        return {"FINISHED"}


class ICYMOON_OT_add_terrain(_AddOperator, bpy.types.Operator):
    """Add a patch of procedural ice as an ordinary mesh. Landforms, layers and surface are those of the sidebar"""

    bl_idname = "icymoon.add_terrain"
    bl_label = "Icy Terrain"
    bl_options = {"REGISTER", "UNDO"}

    own_settings = {"size_m": ("terrain", "size_m"), "resolution": ("terrain", "resolution"),
             "rms_slope_deg": ("terrain", "rms_slope_deg"), "seed": ("dataset", "seed")}
    size_m: setting_property("terrain", "size_m", unit="LENGTH")  # type: ignore[valid-type]
    resolution: setting_property("terrain", "resolution", default=257)  # type: ignore[valid-type]
    rms_slope_deg: setting_property("terrain", "rms_slope_deg")  # type: ignore[valid-type]
    seed: setting_property("dataset", "seed")  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.add(context, lambda: build_terrain_object(self.read_settings(context)))


class ICYMOON_OT_add_block(_AddOperator, bpy.types.Operator):
    """Add a rock as an ordinary mesh, with the surface that rocks have in the sidebar. In the collection Icy Moon it is rendered"""  # noqa: E501

    bl_idname = "icymoon.add_block"
    bl_label = "Ice Rock"
    bl_options = {"REGISTER", "UNDO"}

    own_settings = {key: ("rocks", key) for key in ("family", "angularity", "elongation", "height_ratio")} | {
        "seed": ("dataset", "seed")}
    diameter_m: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Diameter", default=0.5, min=1.0e-3, max=1.0e4, soft_min=0.05, soft_max=10.0, subtype="DISTANCE",
        unit="LENGTH", description="Diameter of a circle with the same area as the rock, seen from above")
    family: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Shape", items=TOPICS["rocks"]["family"].choices[1:], default="FRAGMENTS",
        description="Shape of the rock")
    angularity: setting_property("rocks", "angularity")  # type: ignore[valid-type]
    elongation: setting_property("rocks", "elongation")  # type: ignore[valid-type]
    height_ratio: setting_property("rocks", "height_ratio")  # type: ignore[valid-type]
    seed: setting_property("dataset", "seed")  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.add(context, lambda: build_rock_object(self.read_settings(context), self.diameter_m))


CLASSES = (ICYMOON_OT_add_terrain, ICYMOON_OT_add_block)

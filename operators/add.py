"""Add ▸ Mesh: a patch of icy ground, or a rock, as an object like any other."""

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


def setting_property(topic: str, key: str, **other: Any) -> Any:
    """An operator's property that is a setting."""
    setting = TOPICS[topic][key]
    low, high = setting.soft or (setting.minimum, setting.maximum)
    make = bpy.props.IntProperty if setting.kind == "int" else bpy.props.FloatProperty
    return make(**{"name": setting.label, "description": setting.description, "default": setting.default,
                   "min": setting.minimum, "max": setting.maximum, "soft_min": low, "soft_max": high,
                   "subtype": setting.subtype, **other})


class _AddOperator:
    """Mix-in: an object is made of the scene's settings and those of the operator, and put at the 3D cursor."""

    #: Settings that the operator has of its own, by its properties.
    own_settings: dict[str, tuple[str, str]]
    seed: Any

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Only in Object Mode")  # type: ignore[attr-defined]
        return bool(context.mode == "OBJECT")

    def described(self, context: bpy.types.Context) -> Settings:
        own = [{topic: {key: getattr(self, name)}} for name, (topic, key) in self.own_settings.items()]
        return description.merged(scene_properties.read_settings(context.scene.icymoon), *own)

    def add(self, context: bpy.types.Context, make: Callable[[], bpy.types.Object]) -> set[str]:
        try:
            item = make()
        except IcyMoonError as error:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        context.collection.objects.link(item)
        item.location = context.scene.cursor.location
        for other in context.selected_objects:
            other.select_set(False)
        item.select_set(True)
        context.view_layer.objects.active = item
        return {"FINISHED"}


class ICYMOON_OT_add_terrain(_AddOperator, bpy.types.Operator):
    """Add a patch of procedural ice as a mesh of your own: the landforms, layers and surface of the sidebar, with the size and ruggedness given here"""  # noqa: E501

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
        return self.add(context, lambda: build_terrain_object(self.described(context)))


class ICYMOON_OT_add_block(_AddOperator, bpy.types.Operator):
    """Add a rock as a mesh of your own, made of the surface that rocks have in the sidebar; put into the collection Icy Moon it is in the images"""  # noqa: E501

    bl_idname = "icymoon.add_block"
    bl_label = "Ice Rock"
    bl_options = {"REGISTER", "UNDO"}

    own_settings = {key: ("rocks", key) for key in ("family", "angularity", "elongation", "height_ratio")} | {
        "seed": ("dataset", "seed")}
    diameter_m: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Diameter", default=0.5, min=1.0e-3, max=1.0e4, soft_min=0.05, soft_max=10.0, subtype="DISTANCE",
        unit="LENGTH", description="Of a circle of the same area as the rock, seen from above")
    family: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Shape", items=TOPICS["rocks"]["family"].choices[1:], default="FRAGMENTS",
        description="What the rock looks like")
    angularity: setting_property("rocks", "angularity")  # type: ignore[valid-type]
    elongation: setting_property("rocks", "elongation")  # type: ignore[valid-type]
    height_ratio: setting_property("rocks", "height_ratio")  # type: ignore[valid-type]
    seed: setting_property("dataset", "seed")  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.add(context, lambda: build_rock_object(self.described(context), self.diameter_m))


CLASSES = (ICYMOON_OT_add_terrain, ICYMOON_OT_add_block)

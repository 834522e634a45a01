"""The Sun and a black sky."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bpy
from mathutils import Vector

from .. import compat
from ..physics.directions import toward
from .builder import Tree


def build_sun(name: str, light: Mapping[str, Any]) -> bpy.types.Object:
    """A Sun lamp from ``light`` settings: energy is the irradiance in W/m² on a facing surface."""
    lamp = bpy.data.lights.new(name, "SUN")
    lamp.color = (1.0, 1.0, 1.0)
    compat.plain_light(lamp)
    sun = bpy.data.objects.new(name, lamp)
    place_sun(sun, light)
    return sun


def place_sun(sun: bpy.types.Object, light: Mapping[str, Any]) -> None:
    """Give an existing Sun the irradiance, disc and direction that ``light`` settings state."""
    sun.data.energy = light["sun_irradiance_wm2"]
    sun.data.angle = math.radians(light["sun_angular_diameter_deg"])
    direction = toward(light["sun_azimuth_deg"], light["sun_elevation_deg"])
    sun.rotation_euler = Vector(direction).to_track_quat("Z", "Y").to_euler()
    sun.location = direction * 10.0  # where the symbol is drawn; a Sun lamp has no place


def build_sky(name: str) -> bpy.types.World:
    """A world that gives no light: on an airless moon only the bodies shine."""
    world = bpy.data.worlds.new(name)
    tree = Tree(compat.ensure_nodes(world))
    black = tree.node("ShaderNodeBackground", "Space", {"Color": (0.0, 0.0, 0.0, 1.0), "Strength": 0.0},
                      if_present={"Weight": 0.0})
    tree.node("ShaderNodeOutputWorld", "Sky", {"Surface": black.outputs[0]}, leave=("Volume",), target="ALL")
    tree.arrange()
    return world

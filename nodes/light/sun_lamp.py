"""The Sun and a black sky."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ...physics.light.scene_sun import SceneSun, sun_from_facts, sun_from_lamp
from ...physics.light.sky import Sky
from ...support.arrays import Array
from ...support.blender import compat
from ..tree.builder import Tree


def build_sun(name: str) -> bpy.types.Object:
    """Build a lamp, which ``place_sun`` must set up."""
    lamp = bpy.data.lights.new(name, "SUN")
    compat.disable_light_factors(lamp)
    return bpy.data.objects.new(name, lamp)


def place_sun(sun: bpy.types.Object, sky: Sky, colour: Array) -> None:
    """Set the direction, angular size and irradiance of a Sun lamp, or of a lamp near the ground in its place.

    The irradiance is in W/m² on a surface that faces the Sun, and ``colour`` contains the factors for R, G and B. A Sun
    below the horizon gives no light: the moon hides it, but the ground is only a patch of the moon. The part that the
    planet covers gives no light either. A lamp of P watts gives P / (4π d²) at the distance d.
    """
    kind = "POINT" if sky.sun_distance_m else "SUN"
    if sun.data.type != kind:
        sun.data.type = kind
    lamp = sun.data  # Blender gives another class to a lamp of another type
    lamp.color = tuple(map(float, colour))
    irradiance = sky.sun_irradiance_wm2 * (1.0 - sky.eclipse) if sky.sun_is_up else 0.0
    if sky.sun_distance_m:
        lamp.energy = irradiance * 4.0 * math.pi * sky.sun_distance_m**2
        lamp.shadow_soft_size = sky.sun_distance_m * math.sin(math.radians(sky.sun_diameter_deg) / 2)
        lamp.use_soft_falloff = False
    else:
        lamp.energy, lamp.angle = irradiance, math.radians(sky.sun_diameter_deg)
    sun.rotation_euler = Vector(sky.sun).to_track_quat("Z", "Y").to_euler()
    sun.location = sky.sun * (sky.sun_distance_m or 10.0)  # moves only the symbol of the real Sun


def read_lamp_irradiance_wm2(sun: bpy.types.Object) -> float:
    """Return the irradiance in W/m² by the lamp in its present state, without its colour, on a surface at the site's
    origin that faces it."""
    lamp = sun.data
    return float(lamp.energy if lamp.type == "SUN" else lamp.energy / (4.0 * math.pi * sun.location.length_squared))


def read_lamp_diameter_rad(sun: bpy.types.Object) -> float:
    """Return the diameter in radians of the lamp in its present state, seen from the origin of the site."""
    lamp = sun.data
    if lamp.type == "SUN":
        return float(lamp.angle)
    return 2 * math.asin(min(lamp.shadow_soft_size / max(sun.location.length, 1e-9), 1.0))


def read_scene_sun(sun: bpy.types.Object, facts: Mapping[str, Any], source: str) -> SceneSun:
    """Read the Sun from the lamp in its present state. ``facts`` and ``source`` describe its setup: the table of
    ``sky.describe_sky`` and the choice of ``light.directions_from``."""
    direction, distance = sun.matrix_world.to_3x3().col[2].normalized(), 0.0
    if sun.data.type != "SUN":  # its light comes from its position, whatever its rotation
        direction, distance = sun.location.normalized(), sun.location.length
    return sun_from_lamp(
        sun_from_facts(facts, source),
        np.array(direction),
        read_lamp_irradiance_wm2(sun),
        math.degrees(read_lamp_diameter_rad(sun)),
        distance,
    )


def build_sky(name: str) -> bpy.types.World:
    """Build a black world: an airless moon has no light from its sky."""
    world = bpy.data.worlds.new(name)
    tree = Tree(compat.ensure_nodes(world))
    black = tree.node(
        "ShaderNodeBackground", "Space", {"Color": (0.0, 0.0, 0.0, 1.0), "Strength": 0.0}, if_present={"Weight": 0.0}
    )
    tree.node("ShaderNodeOutputWorld", "Sky", {"Surface": black.outputs[0], "Volume": None}, target="ALL")
    tree.arrange()
    return world

"""The Sun and a black sky."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector

from ... import compat
from ...physics.light.sky import Sky
from ..tree.builder import Tree


def build_sun(name: str) -> bpy.types.Object:
    """A Sun lamp, which ``place_sun`` must set up."""
    lamp = bpy.data.lights.new(name, "SUN")
    compat.disable_light_factors(lamp)
    return bpy.data.objects.new(name, lamp)


def place_sun(sun: bpy.types.Object, sky: Sky, colour: np.ndarray) -> None:
    """Set the direction, angular size and irradiance of a Sun lamp.

    The irradiance is in W/m² on a surface that faces the Sun, and ``colour`` contains the factors for R, G and B. A Sun
    below the horizon gives no light: the moon hides it, but the ground is only a patch of the moon. The part that the
    planet covers gives no light either.
    """
    sun.data.color = tuple(map(float, colour))
    sun.data.energy = sky.sun_irradiance_wm2 * (1.0 - sky.eclipse) if sky.sun_is_up else 0.0
    sun.data.angle = math.radians(sky.sun_diameter_deg)
    sun.rotation_euler = Vector(sky.sun).to_track_quat("Z", "Y").to_euler()
    sun.location = sky.sun * 10.0  # only moves the symbol in the viewport


def build_sky(name: str) -> bpy.types.World:
    """A black world: an airless moon has no light from its sky."""
    world = bpy.data.worlds.new(name)
    tree = Tree(compat.ensure_nodes(world))
    black = tree.node("ShaderNodeBackground", "Space", {"Color": (0.0, 0.0, 0.0, 1.0), "Strength": 0.0},
                      if_present={"Weight": 0.0})
    tree.node("ShaderNodeOutputWorld", "Sky", {"Surface": black.outputs[0]}, leave=("Volume",), target="ALL")
    tree.arrange()
    return world

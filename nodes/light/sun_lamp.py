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
    """A Sun lamp, which ``place_sun`` is to make what it is."""
    lamp = bpy.data.lights.new(name, "SUN")
    compat.disable_light_factors(lamp)
    return bpy.data.objects.new(name, lamp)


def place_sun(sun: bpy.types.Object, sky: Sky, colour: np.ndarray) -> None:
    """Give a Sun its direction, disc and irradiance in W/m² on a facing surface, of which ``colour`` is the share
    in R, G, B.

    A Sun that is down gives no light: the body hides it, of which the ground is only a patch. What the
    planet covers of it gives none either.
    """
    sun.data.color = tuple(map(float, colour))
    sun.data.energy = sky.sun_irradiance_wm2 * (1.0 - sky.eclipse) if sky.sun_is_up else 0.0
    sun.data.angle = math.radians(sky.sun_diameter_deg)
    sun.rotation_euler = Vector(sky.sun).to_track_quat("Z", "Y").to_euler()
    sun.location = sky.sun * 10.0  # where the symbol is drawn; a Sun lamp has no place


def build_sky(name: str) -> bpy.types.World:
    """A world that gives no light: on an airless moon only the bodies shine."""
    world = bpy.data.worlds.new(name)
    tree = Tree(compat.ensure_nodes(world))
    black = tree.node("ShaderNodeBackground", "Space", {"Color": (0.0, 0.0, 0.0, 1.0), "Strength": 0.0},
                      if_present={"Weight": 0.0})
    tree.node("ShaderNodeOutputWorld", "Sky", {"Surface": black.outputs[0]}, leave=("Volume",), target="ALL")
    tree.arrange()
    return world

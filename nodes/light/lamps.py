"""Lamps as Blender's lights, each in its own light group."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...formats.ies import read_ies, write_for_cycles
from ...physics.light.directions import direction_toward
from ...physics.light.lamps import describe_lamp, list_lamp_groups, pair_power_w, spot_share
from ...physics.light.sunlight import sun_colour
from ...settings.topics.light import Lamp, LightSettings
from ...support.blender import compat
from ...support.labels import LAMP_GROUPS
from ..datablocks.fingerprint import NAME, TAG, find_built_objects
from ..tree.builder import WHITE, Tree

#: Roles of the objects, in the order of ``light.lamps``.
ROLES = tuple(f"lamp {k + 1}" for k in range(len(LAMP_GROUPS)))
SPREAD = "lamp intensity"  # role of the text with the intensity of lamps by direction


def build_lamps(light: LightSettings, camera: bpy.types.Object, ies_file: Path | None) -> list[bpy.types.Object]:
    """Build Blender's lights for the lamps. Lamps of the place CAMERA are children of the ``camera``. The caller links
    them.

    ``ies_file`` has the intensity of lamps of the kind IES. Cameras do not see the lamps themselves, because the rays
    for the truth do not hit lamps. Raises IcyMoonError if the file cannot be read.
    """
    made, spread = [], None
    if ies_file is not None:
        spread = bpy.data.texts.new(f"{NAME} Intensity")
        spread[TAG], spread.use_fake_user = SPREAD, False
        spread.write(write_for_cycles(read_ies(ies_file)))
    for k, (lamp, group) in enumerate(zip(light.lamps, list_lamp_groups(light), strict=True)):
        source = _make_light(f"{NAME} Lamp {k + 1}", lamp, light, spread)
        item = bpy.data.objects.new(source.name, source)
        item[TAG], item.lightgroup, item.visible_camera = ROLES[k], group, False
        _place(item, lamp, camera)
        made.append(item)
    return made


def _make_light(name: str, lamp: Lamp, light: LightSettings, spread: bpy.types.Text | None) -> bpy.types.Light:
    """Make a light that sends out the power of a lamp. Inside its cone, a spot in Blender has the intensity of a point
    light of the same energy, so its energy is larger than its flux."""
    source = bpy.data.lights.new(name, "POINT" if lamp.kind == "IES" else lamp.kind)
    compat.disable_light_factors(source)
    source.color = tuple(map(float, sun_colour(float(lamp.temperature_k))))
    source.energy = pair_power_w(lamp, light)
    if lamp.kind == "AREA":
        source.shape, source.size, source.spread = "SQUARE", lamp.size_m, math.pi
        return source
    source.shadow_soft_size, source.use_soft_falloff = lamp.size_m / 2, False
    if lamp.kind == "IES":
        # A disc that faces each point has the direction of the light as its normal; a sphere does not.
        source.use_soft_falloff = True
        tree = Tree(compat.ensure_light_nodes(source))
        strength = tree.node("ShaderNodeTexIES", "Intensity", {"Vector": None, "Strength": 1.0}, mode="INTERNAL")
        strength.ies = spread
        shining = tree.emission("Lamp", WHITE, strength.outputs[0])
        tree.node("ShaderNodeOutputLight", "Light", {"Surface": shining}, target="ALL")
        tree.arrange()
    if lamp.kind == "SPOT":
        source.spot_size, source.spot_blend = math.radians(lamp.cone_deg), lamp.blend
        source.energy /= spot_share(lamp.cone_deg, lamp.blend)
    return source


def _place(item: bpy.types.Object, lamp: Lamp, camera: bpy.types.Object) -> None:
    """Put a lamp in its place. It shines along its own -z axis, as the camera looks."""
    if lamp.place == "SITE":
        toward = Vector(direction_toward(lamp.azimuth_deg, lamp.elevation_deg))
        item.rotation_euler = toward.to_track_quat("-Z", "Y").to_euler()
        item.location = lamp.x_m, lamp.y_m, lamp.z_m
        return
    item.parent, item.matrix_parent_inverse = camera, Matrix.Identity(4)
    turn, tilt = -math.radians(lamp.azimuth_deg), math.radians(lamp.elevation_deg)
    item.rotation_euler = (Matrix.Rotation(turn, 3, "Y") @ Matrix.Rotation(tilt, 3, "X")).to_euler()
    item.location = lamp.x_m, lamp.z_m, -lamp.y_m


def find_lamps(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    """Find the lamps of a built collection, in the order of their list."""
    there = find_built_objects(collection)
    return [there[role] for role in ROLES if role in there]


def find_lamp_matrix(item: bpy.types.Object) -> Matrix:
    """Find the matrix of a lamp in the world, also while its camera is turned for a pair, before Blender evaluates
    it."""
    if item.parent is None:
        return item.matrix_basis
    return item.parent.matrix_world @ item.matrix_parent_inverse @ item.matrix_basis


def describe_lamps(collection: bpy.types.Collection, light: LightSettings) -> list[dict[str, Any]]:
    """Describe each lamp in its present state, with its light group, for the entry ``light.lamps`` of ``pair.json``."""
    found = []
    for item, lamp in zip(find_lamps(collection), light.lamps, strict=False):
        world = np.array(find_lamp_matrix(item), np.float64)
        ahead = -world[:3, 2] / np.linalg.norm(world[:3, 2])
        found.append(
            {
                "group": item.lightgroup,
                **describe_lamp(lamp, light),
                "position_m": world[:3, 3].tolist(),
                "direction_to_world": ahead.tolist(),
            }
        )
    return found

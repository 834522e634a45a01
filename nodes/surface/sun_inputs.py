"""Inputs of surfaces that describe the Sun and the planet, and settings of lamps and scene for these surfaces.

See ``reflectance_laws`` for the surfaces themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...physics.light.directions import direction_toward
from ...settings.topics.light import LightSettings
from ...support.arrays import Numbers
from ...support.blender import compat
from ...support.errors import IcyMoonError
from ..datablocks.fingerprint import TAG
from ..light.lamps import find_lamp_matrix
from ..light.planet_lamp import MEAN, make_planet_inputs
from ..light.sun_lamp import read_lamp_diameter_rad, read_lamp_irradiance_wm2
from . import hapke_nodes

LEVELS = ("FAST", "ACCURATE", "REFERENCE")
SHARED = "traced sun"  # role of the collection of objects that a lamp does not light
#: Names of the nodes with inputs that describe the Sun. DIRECTION is the place of a source whose NEARNESS is 1.
DIRECTION, NEARNESS, BLUR, SCRIPT = "Sun Direction", "Source Nearness", "Surge Blur", "Hapke"
#: Distance in metres that a lamp at the origin of the site gets, since 0 stands for the real Sun.
_MIN_DISTANCE_M = 1e-6


@dataclass(frozen=True)
class Sun:
    """The Sun as a surface needs it: unit vector toward it, irradiance in R, G, B, and apparent diameter."""

    direction: tuple[float, float, float]
    irradiance_wm2: tuple[float, float, float]
    angular_diameter: float  # radians
    distance_m: float = 0.0  # of a lamp near the ground from the origin of the site; 0 for the real Sun
    with_lamps: bool = False  # whether the surface must follow near and far sources in turn

    @classmethod
    def from_settings(cls, light: LightSettings) -> Sun:
        """Make the Sun that ``light`` settings describe."""
        x, y, z = direction_toward(light.sun_azimuth_deg, light.sun_elevation_deg)
        return cls(
            (x, y, z),
            (light.sun_irradiance_wm2,) * 3,
            math.radians(light.sun_angular_diameter_deg),
            light.sun_distance_m,
            bool(light.lamps),
        )

    @classmethod
    def from_lamp(cls, lamp: bpy.types.Object, world: Matrix) -> Sun:
        """Make the Sun of a lamp. ``world`` (4, 4) is the lamp's present matrix, since the user may have rotated it."""
        x, y, z = world.to_3x3().col[2].normalized()
        red, green, blue = (read_lamp_irradiance_wm2(lamp) * band for band in lamp.data.color)
        distance = 0.0 if lamp.data.type == "SUN" else world.translation.length
        return cls((x, y, z), (red, green, blue), read_lamp_diameter_rad(lamp), distance)

    @classmethod
    def of_planet(cls, shine: bpy.types.Object) -> Sun:
        """Make the planet's light from its lamp ``shine``, as if it all came from the middle of the planet's lit
        part."""
        red, green, blue = (shine.data.energy * band for band in shine.data.color)
        x, y, z = shine[MEAN]
        return cls((x, y, z), (red, green, blue), shine.data.angle)

    @classmethod
    def of_lamp(cls, lamp: bpy.types.Object) -> Sun:
        """Make a point source at a lamp's middle, as if all light came from there."""
        place = find_lamp_matrix(lamp).translation
        x, y, z = place.normalized() if place.length > 0 else Vector((0.0, 0.0, 1.0))
        return cls((x, y, z), (1.0, 1.0, 1.0), 0.0, max(place.length, _MIN_DISTANCE_M))

    @property
    def place(self) -> tuple[float, float, float]:
        """The position of a near source in metres, or the direction of a distant source."""
        x, y, z = (axis * (self.distance_m or 1.0) for axis in self.direction)
        return x, y, z

    @property
    def radius(self) -> float:
        """Tangent of the angular radius."""
        return math.tan(min(self.angular_diameter, 3.0) / 2)

    @property
    def blur(self) -> float:
        """Mean distance of points on the disc from its centre, as the tangent of half the angle.

        For a surge of width h in tan(g/2), averaging over the disc is nearly the same as evaluating the surge at
        √(tan² + blur²). The error is within an eighth of the reduction of its peak: 2 % of the surge for Europa.
        """
        return 2 / 3 * math.tan(self.angular_diameter / 4)


def make_sun_inputs(sun: Sun) -> dict[str, Any]:
    """Make the inputs of ``hapke.osl`` for the Sun."""
    return {
        "SunDirection": sun.direction,
        "SunIrradiance": (*sun.irradiance_wm2, 1.0),
        "SunRadius": sun.radius,
        "SunBlur": sun.blur,
    }


def _find_own_node(material: bpy.types.Material, name: str, kind: str) -> bpy.types.Node | None:
    """Find a node that Icy Moon made, of this ``kind``; None if the user has replaced the material."""
    node = material.node_tree.nodes.get(name) if material.node_tree else None
    return node if node and node.bl_idname == kind else None


def _set_input(socket: bpy.types.NodeSocket, value: Numbers) -> None:
    """Set an input if its value differs, since any change of a material makes Cycles build its scene again."""
    if not np.array_equal(np.float32(socket.default_value), np.float32(value)):
        socket.default_value = value


def set_light_inputs(
    materials: Iterable[bpy.types.Material],
    sun: Sun,
    shine: bpy.types.Object | None,
    lamps: Sequence[bpy.types.Object] = (),
) -> None:
    """Set the inputs of surfaces to the present Sun, the planet, whose lamp is ``shine``, and other ``lamps``.

    A surface from nodes has its law for one source only: the Sun; if the Sun is dark the planet; else the first lamp.
    """
    lit_by = sun
    if not any(sun.irradiance_wm2) and (shine is not None or lamps):
        lit_by = Sun.of_planet(shine) if shine is not None else Sun.of_lamp(lamps[0])
    for material in materials:
        near = _find_own_node(material, NEARNESS, "ShaderNodeMath")
        if near:
            _set_input(near.inputs[0], float(lit_by.distance_m > 0))
        if node := _find_own_node(material, DIRECTION, "ShaderNodeCombineXYZ"):
            for axis, value in zip("XYZ", lit_by.place if near else lit_by.direction, strict=True):
                _set_input(node.inputs[axis], value)
        if node := _find_own_node(material, BLUR, "ShaderNodeMath"):
            _set_input(node.inputs[0], lit_by.blur)
        if node := _find_own_node(material, SCRIPT, "ShaderNodeScript"):
            for name, value in {**make_sun_inputs(sun), **make_planet_inputs(shine)}.items():
                _set_input(node.inputs[name], value)


def has_one_light_source(material: bpy.types.Material) -> bool:
    """Return whether a material has its reflectance law for one source of light only."""
    return any(
        _find_own_node(material, *node) for node in ((DIRECTION, "ShaderNodeCombineXYZ"), (SCRIPT, "ShaderNodeScript"))
    )


def is_osl(material: bpy.types.Material) -> bool:
    """Return whether a material needs Open Shading Language."""
    return _find_own_node(material, SCRIPT, "ShaderNodeScript") is not None


def _read_level(material: bpy.types.Material) -> str:
    node = _find_own_node(material, SCRIPT, "ShaderNodeScript")
    return LEVELS[node.inputs["Level"].default_value] if node else LEVELS[0]


def traces_sun(material: bpy.types.Material) -> bool:
    """Return whether a material traces the Sun, so that the lamp must not light it. Every OSL material traces the
    planet."""
    return _read_level(material) != LEVELS[0]


#: Inputs of ``hapke.osl`` that may vary over the surface, with their names in ``pair.json``.
_VARYING_INPUTS = {"W": "w", "TanTheta": "theta_bar_deg", "Tint": "colour"}


def describe_hapke(materials: Iterable[bpy.types.Material]) -> dict[str, Any] | None:
    """Describe, for ``pair.json``, how these materials implement Hapke's law and how accurately; None without the law.

    ``neighbours_as_here`` lists the inputs that vary over the surface, but for which interreflections use the value at
    the visible point at both ends.
    """
    known, varying = None, set()
    for material in materials:
        nodes = material.node_tree.nodes if material.node_tree else ()
        if any(node.label in (SCRIPT, hapke_nodes.NAME) for node in nodes):
            known = known or {"made_of": "OSL" if is_osl(material) else "NODES", "accuracy": _read_level(material)}
        if _read_level(material) == LEVELS[2]:
            inputs = material.node_tree.nodes[SCRIPT].inputs
            varying |= {name for socket, name in _VARYING_INPUTS.items() if inputs[socket].is_linked}
    return known and {**known, "neighbours_as_here": sorted(varying)}


def exclude_from_lamp(name: str, lamp: bpy.types.Object, tracing: Iterable[bpy.types.Object]) -> None:
    """Exclude objects that trace a lamp themselves from its light."""
    linking, tracing = lamp.light_linking, list(tracing)
    if linking.receiver_collection is not None and linking.receiver_collection.get(TAG) == SHARED:
        linking.receiver_collection = None  # not removed, since a full copy of the scene may use it
    if tracing:
        collection = linking.receiver_collection = bpy.data.collections.new(name)
        collection[TAG] = SHARED
        for item in tracing:
            collection.objects.link(item)
        for entry in collection.collection_objects:
            entry.light_linking.link_state = "EXCLUDE"


def prepare_for_cycles(
    scene: bpy.types.Scene,
    materials: Iterable[bpy.types.Material],
    lamp: bpy.types.Object,
    shine: bpy.types.Object | None,
    lamps: Sequence[bpy.types.Object] = (),
) -> None:
    """Prepare a scene for these materials, after its settings for Cycles are set and the lamp is in place.

    Raises IcyMoonError if the materials need Open Shading Language and the scene cannot use it.
    """
    materials = list(materials)
    depsgraph = scene.view_layers[0].depsgraph
    depsgraph.update()  # otherwise a new or rotated lamp has no world matrix yet
    set_light_inputs(materials, Sun.from_lamp(lamp, lamp.evaluated_get(depsgraph).matrix_world), shine, lamps)
    if any(map(is_osl, materials)):
        if not compat.has_osl() or scene.cycles.device == "GPU":
            raise IcyMoonError(
                "The surface was built for Open Shading Language on the CPU; build the scene again in "
                "this Blender, or set quality.device to CPU."
            )
        scene.cycles.shading_system = True
    if any(map(traces_sun, materials)):
        # These surfaces emit the light of the Sun themselves, one bounce earlier than a lamp would light them.
        scene.cycles.diffuse_bounces = max(scene.cycles.diffuse_bounces - 1, 0)

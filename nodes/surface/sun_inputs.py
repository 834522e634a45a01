"""Sun and planet as surfaces know them, and what lamps and scene need for such surfaces.

See ``reflectance_laws`` for the surfaces themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ... import compat
from ...errors import IcyMoonError
from ...physics.light.directions import toward
from ...typed_settings import LightSettings
from ..datablocks.fingerprint import TAG
from ..light.planet_lamp import MEAN, planet_inputs
from . import hapke_nodes

LEVELS = ("FAST", "ACCURATE", "REFERENCE")
SHARED = "traced sun"  # role of the collection of what a lamp does not light
#: Names of the nodes that know the Sun.
DIRECTION, BLUR, SCRIPT = "Sun Direction", "Surge Blur", "Hapke"


@dataclass(frozen=True)
class Sun:
    """What a surface has to know: unit vector toward the Sun, its irradiance in R, G, B and apparent diameter."""

    direction: tuple[float, float, float]
    irradiance_wm2: tuple[float, float, float]
    angular_diameter: float  # radians

    @classmethod
    def from_settings(cls, light: LightSettings) -> Sun:
        """The Sun that ``light`` settings describe."""
        x, y, z = toward(light.sun_azimuth_deg, light.sun_elevation_deg)
        return cls((x, y, z), (light.sun_irradiance_wm2,) * 3, math.radians(light.sun_angular_diameter_deg))

    @classmethod
    def from_lamp(cls, lamp: bpy.types.Object, world: Matrix) -> Sun:
        """The Sun that a lamp is; ``world`` is its matrix, wherever the user has turned it."""
        x, y, z = world.to_3x3().col[2].normalized()
        red, green, blue = (lamp.data.energy * band for band in lamp.data.color)
        return cls((x, y, z), (red, green, blue), lamp.data.angle)

    @classmethod
    def of_planet(cls, shine: bpy.types.Object) -> Sun:
        """The planet by its lamp, as if all of its light came from the middle of what is lit of it."""
        red, green, blue = (shine.data.energy * band for band in shine.data.color)
        x, y, z = shine[MEAN]
        return cls((x, y, z), (red, green, blue), shine.data.angle)

    @property
    def radius(self) -> float:
        """Tangent of its angular radius."""
        return math.tan(min(self.angular_diameter, 3.0) / 2)

    @property
    def blur(self) -> float:
        """Mean distance from the middle of its disc, as the tangent of half an angle.

        A surge h wide in tan(g/2), seen through the disc, is the surge at √(tan² + blur²) to within an
        eighth of what the disc takes from it at its peak (2 % of the surge, for Europa's).
        """
        return 2 / 3 * math.tan(self.angular_diameter / 4)


def sun_inputs(sun: Sun) -> dict[str, Any]:
    """Inputs of ``hapke.osl`` that the Sun decides."""
    return {"SunDirection": sun.direction, "SunIrradiance": (*sun.irradiance_wm2, 1.0), "SunRadius": sun.radius,
            "SunBlur": sun.blur}


def _find_own_node(material: bpy.types.Material, name: str, kind: str) -> Any:
    """A node that was made here, or None; the user may have put another material in the place of ours."""
    node = material.node_tree.nodes.get(name) if material.node_tree else None
    return node if node and node.bl_idname == kind else None


def _set_input(socket: Any, value: Any) -> None:
    """Set an input, unless it has that value: any change of a material makes Cycles build its scene again."""
    if not np.array_equal(np.float32(socket.default_value), np.float32(value)):
        socket.default_value = value


def aim_surfaces(materials: Iterable[bpy.types.Material], sun: Sun, shine: bpy.types.Object | None) -> None:
    """Tell surfaces where the Sun and the planet, of which ``shine`` is the lamp, are now.

    A surface of nodes has its law for one source only: the Sun, or, if that is dark, the planet.
    """
    lit_by = Sun.of_planet(shine) if shine is not None and not any(sun.irradiance_wm2) else sun
    for material in materials:
        if node := _find_own_node(material, DIRECTION, "ShaderNodeCombineXYZ"):
            for axis, value in zip("XYZ", lit_by.direction, strict=True):
                _set_input(node.inputs[axis], value)
        if node := _find_own_node(material, BLUR, "ShaderNodeMath"):
            _set_input(node.inputs[0], lit_by.blur)
        if node := _find_own_node(material, SCRIPT, "ShaderNodeScript"):
            for name, value in {**sun_inputs(sun), **planet_inputs(shine)}.items():
                _set_input(node.inputs[name], value)


def has_one_light_source(material: bpy.types.Material) -> bool:
    """Whether a material has its law for one source of light."""
    return any(_find_own_node(material, *node)
               for node in ((DIRECTION, "ShaderNodeCombineXYZ"), (SCRIPT, "ShaderNodeScript")))


def is_osl(material: bpy.types.Material) -> bool:
    """Whether a material needs Open Shading Language."""
    return _find_own_node(material, SCRIPT, "ShaderNodeScript") is not None


def _level(material: bpy.types.Material) -> str:
    node = _find_own_node(material, SCRIPT, "ShaderNodeScript")
    return LEVELS[node.inputs["Level"].default_value] if node else LEVELS[0]


def traces_sun(material: bpy.types.Material) -> bool:
    """Whether a material traces the Sun itself, so that the lamp must not light it; the planet every OSL one does."""
    return _level(material) != LEVELS[0]


#: Inputs of ``hapke.osl`` that may vary from place to place, and what they are.
_VARYING = {"W": "w", "TanTheta": "theta_bar_deg", "Tint": "colour"}


def describe_hapke(materials: Iterable[bpy.types.Material]) -> dict[str, Any] | None:
    """What Hapke's law is made of in these materials and at which accuracy; None if none has it.

    ``neighbours_as_here`` is what varies from place to place though interreflections take it to be at both ends what
    it is at the one that is seen.
    """
    known, taken = None, set()
    for material in materials:
        nodes = material.node_tree.nodes if material.node_tree else ()
        if any(node.label in (SCRIPT, hapke_nodes.NAME) for node in nodes):
            known = known or {"made_of": "OSL" if is_osl(material) else "NODES", "accuracy": _level(material)}
        if _level(material) == LEVELS[2]:
            inputs = material.node_tree.nodes[SCRIPT].inputs
            taken |= {what for socket, what in _VARYING.items() if inputs[socket].is_linked}
    return known and {**known, "neighbours_as_here": sorted(taken)}


def exempt_from_lamp(name: str, lamp: bpy.types.Object, tracing: Iterable[bpy.types.Object]) -> None:
    """Let a lamp light everything but the objects that trace it themselves."""
    linking, tracing = lamp.light_linking, list(tracing)
    if linking.receiver_collection is not None and linking.receiver_collection.get(TAG) == SHARED:
        linking.receiver_collection = None  # a full copy of the scene may use it; else it is a leftover
    if tracing:
        collection = linking.receiver_collection = bpy.data.collections.new(name)
        collection[TAG] = SHARED
        for item in tracing:
            collection.objects.link(item)
        for entry in collection.collection_objects:
            entry.light_linking.link_state = "EXCLUDE"


def prepare_for_cycles(scene: bpy.types.Scene, materials: Iterable[bpy.types.Material], lamp: bpy.types.Object,
                       shine: bpy.types.Object | None) -> None:
    """Make a scene that is set up for Cycles render these materials right, wherever the lamp has been turned to.

    Raises IcyMoonError if they need Open Shading Language and the scene cannot have it.
    """
    materials = list(materials)
    depsgraph = scene.view_layers[0].depsgraph
    depsgraph.update()  # a lamp that was only just made or turned has no world matrix yet
    aim_surfaces(materials, Sun.from_lamp(lamp, lamp.evaluated_get(depsgraph).matrix_world), shine)
    if any(map(is_osl, materials)):
        if not compat.has_osl() or scene.cycles.device == "GPU":
            raise IcyMoonError("The surface was built for Open Shading Language on the CPU; build the scene again "
                               "here, or set quality.device to CPU.")
        scene.cycles.shading_system = True
    if any(map(traces_sun, materials)):
        # What a ray finds at its end shines by itself, a bounce earlier than a lamp would light it.
        scene.cycles.diffuse_bounces = max(scene.cycles.diffuse_bounces - 1, 0)

"""Surfaces that know where the Sun is, since no closure of Cycles' has their law of reflection.

Light from the Sun is exact in all of them. What else lights the surface, it scatters as Lambert's
law with the same albedo at this emission angle. Three levels of accuracy of Hapke's law:

* fast: a diffuse closure whose weight is π times the BRDF for the Sun. Light from the ground then
  has that weight too, where the Sun reaches the surface;
* accurate: the Sun is traced in the shader, its disc included, and the closure is left to all
  other light. The lamp lights everything but these surfaces;
* reference: the first interreflection has the law at both ends as well.

Only Open Shading Language on the processor can trace in a shader; nodes are always fast.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from .. import compat
from ..errors import IcyMoonError
from ..physics import hapke as model
from ..physics.directions import toward
from ..physics.photometry import hemispherical_fit, lunar_lambert_normal_albedo
from ..settings import Settings
from . import hapke_nodes
from .builder import Tree
from .fingerprint import TAG
from .formula import Number, Vector
from .hapke_osl import script_node

LEVELS = ("FAST", "ACCURATE", "REFERENCE")
SHARED = "traced sun"  # role of the collection of what a lamp does not light
_SUN, _BLUR, _SCRIPT = "Sun Direction", "Surge Blur", "Hapke"


@dataclass(frozen=True)
class Sun:
    """What a surface has to know: unit vector toward the Sun, its irradiance and apparent diameter."""

    direction: tuple[float, float, float]
    irradiance_wm2: float
    angular_diameter: float  # radians

    @classmethod
    def from_settings(cls, light: Mapping[str, Any]) -> Sun:
        """The Sun that ``light`` settings describe."""
        x, y, z = toward(light["sun_azimuth_deg"], light["sun_elevation_deg"])
        return cls((x, y, z), light["sun_irradiance_wm2"], math.radians(light["sun_angular_diameter_deg"]))

    @classmethod
    def from_lamp(cls, lamp: bpy.types.Object, world: Matrix) -> Sun:
        """The Sun that a lamp is; ``world`` is its matrix, wherever a person has turned it."""
        x, y, z = world.to_3x3().col[2].normalized()
        return cls((x, y, z), lamp.data.energy, lamp.data.angle)

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


@dataclass(frozen=True)
class Ground:
    """What the laws are put on: a tree, the normal's output socket (None: the mesh's own), the grey factor on the
    albedo (on w in Hapke's law), a number or an output socket, and the colour factor, an output socket or None."""

    tree: Tree
    normal: Any
    grey: Any
    colour: Any


@dataclass(frozen=True)
class Grains:
    """Hapke's parameters, and the least that the ground's grey factor on w is."""

    parameters: model.HapkeParameters
    darkest: float


def choose(hapke: Mapping[str, Any], device: str) -> tuple[bool, str, str]:
    """Whether Hapke's law is made of OSL, its level, and a sentence if that is not what was asked for.

    Raises IcyMoonError if OSL is asked for and cannot be had.
    """
    asked, level = hapke["backend"], hapke["accuracy"]
    why = ("" if compat.has_osl() else "this Blender was built without Open Shading Language") or (
        "Open Shading Language traces only on the CPU" if device == "GPU" else "")
    if asked == "OSL" and why:
        raise IcyMoonError(f"hapke.backend is OSL, but {why}; set hapke.backend to AUTO"
                           + (" or quality.device to CPU." if device == "GPU" else "."))
    if asked == "OSL" or (asked == "AUTO" and not why):
        return True, level, ""
    if level != "FAST":
        reason = why or "nodes cannot trace"
        return False, "FAST", f"Hapke's surface is built at accuracy FAST, of nodes, since {reason}."
    return False, level, f"Hapke's surface is built of nodes, since {why}." if why else ""


def uses_hapke(settings: Settings) -> bool:
    """Whether the ground or the blocks reflect by Hapke's law."""
    topics = ["surface"] + (["rock_surface"] if settings["rocks"]["own_surface"] else [])
    return any(settings[topic]["model"] == "HAPKE" for topic in topics)


def advice(settings: Settings) -> list[str]:
    """What a person should know of the surface that will be built. Raises IcyMoonError if it cannot be built."""
    if not uses_hapke(settings):
        return []
    model.from_settings(settings["hapke"])
    message = choose(settings["hapke"], settings["quality"]["device"])[2]
    return [message] if message else []


def _sight(ground: Ground, sun: Sun) -> tuple[Vector, Vector, Vector]:
    """Normal, direction to the Sun and to the viewer."""
    tree = ground.tree
    geometry = tree.node("ShaderNodeNewGeometry", "Sight")
    toward_sun = tree.node("ShaderNodeCombineXYZ", _SUN, dict(zip("XYZ", sun.direction, strict=True)))
    return (Vector(tree, geometry.outputs["Normal"] if ground.normal is None else ground.normal),
            Vector(tree, toward_sun.outputs[0]), Vector(tree, geometry.outputs["Incoming"]))


def _diffuse(ground: Ground, label: str, weight: Number) -> Any:
    """Shader socket of Lambert's law with this reflectance times the ground's colour."""
    tree, value = ground.tree, weight.value
    if ground.colour is not None:
        colour = tree.node("ShaderNodeVectorMath", f"{label} Colour", {"Vector": ground.colour, "Scale": value},
                           operation="SCALE").outputs[0]
    else:
        colour = (*[float(value)] * 3, 1.0) if isinstance(value, (int, float)) else value
    normal = {} if ground.normal is None else {"Normal": ground.normal}
    return tree.node("ShaderNodeBsdfDiffuse", label, {"Color": colour, "Roughness": 0.0, **normal},
                     if_present={"Weight": 0.0}, leave=("Normal",) if ground.normal is None else ()).outputs[0]


def _lit_or_not(ground: Ground, mu0: Number, lit: Number, other: Number) -> Any:
    """Shader socket: one weight of the diffuse closure where the Sun is above the surface, another elsewhere.

    Cycles leaves out the nodes of the side that it does not need.
    """
    return ground.tree.node("ShaderNodeMixShader", "Sunlit or Not", {
        "Fac": mu0.exceeds(0.0).value, "Shader": _diffuse(ground, "Shaded", other),
        "Shader_001": _diffuse(ground, "Sunlit", lit)}).outputs[0]


def lambert(ground: Ground, albedo: float) -> Any:
    """Shader socket of Lambert's law."""
    return _diffuse(ground, "Lambert", Number(ground.tree, ground.grey) * albedo)


def lunar_lambert(ground: Ground, albedo: float, share: float, sun: Sun) -> Any:
    """Shader socket of ``physics.photometry.lunar_lambert``."""
    n, toward_sun, eye = _sight(ground, sun)
    mu0, mu = n.dot(toward_sun).named("µ0"), n.dot(eye).at_least(1e-6).named("µ")
    bond = Number(ground.tree, ground.grey) * albedo
    seeliger = (2.0 * share) / (mu0 + mu).at_least(1e-6)
    lit = (seeliger + (1.0 - share)) * (bond * lunar_lambert_normal_albedo(1.0, share))
    return _lit_or_not(ground, mu0, lit, bond)


@lru_cache(maxsize=64)
def _fit(q: model.HapkeParameters, darkest: float) -> np.ndarray:
    """Coefficients of the hemispherical albedo for w of the parameters times ``darkest`` to 1."""
    least, most = math.sqrt(1 - q.w), math.sqrt(1 - q.w * darkest)
    gammas = np.linspace(least, most, 5) if most - least > 1e-6 else np.array([least])
    return hemispherical_fit(lambda w: partial(model.bidirectional_reflectance, parameters=replace(q, w=w)), gammas)


def _known(ground: Ground, q: model.HapkeParameters) -> hapke_nodes.Grains:
    w = (Number(ground.tree, ground.grey) * float(q.w)).at_most(1.0)
    return hapke_nodes.Grains(
        w, Number(ground.tree, math.tan(q.theta_bar)), q.b, q.c, q.b_s0, q.h_s, q.b_c0, q.h_c,
        float(model.porosity_factor(q.filling_factor)), q.h_function)


def hapke_of_nodes(ground: Ground, grains: Grains, sun: Sun) -> Any:
    """Shader socket of Hapke's law made of nodes."""
    n, toward_sun, eye = _sight(ground, sun)
    tree, known = ground.tree, _known(ground, grains.parameters)
    blur = tree.math("ADD", _BLUR, sun.blur, 0.0)  # a node whose number can be set
    weight = hapke_nodes.brdf(n, toward_sun, eye, Number(tree, blur), known) * math.pi
    if not blur.is_linked:
        tree.tree.nodes.remove(blur.node)
    gamma, white, mu = (1.0 - known.w).at_least(0.0).sqrt(), Number(tree, 0.0), n.dot(eye)
    for c0, c1, c2 in reversed(_fit(grains.parameters, grains.darkest).tolist()):
        white = white.times_plus(mu, gamma.times_plus(c2, c1).times_plus(gamma, c0))
    return _lit_or_not(ground, n.dot(toward_sun), weight, white.at_least(0.0).at_most(1.0))


def hapke_of_osl(ground: Ground, grains: Grains, sun: Sun, level: str) -> Any:
    """Shader socket of Hapke's law in Open Shading Language."""
    tree, q = ground.tree, grains.parameters
    known = _known(ground, q)
    normal = ground.normal
    if normal is None:
        normal = tree.node("ShaderNodeNewGeometry", "Sight").outputs["Normal"]
    albedo = {f"Albedo{k}": tuple(row) for k, row in enumerate(_fit(q, grains.darkest).tolist())}
    return script_node(tree, _SCRIPT, {
        "W": known.w.value, "B": q.b, "C": q.c, "BS0": q.b_s0, "HS": q.h_s, "BC0": q.b_c0, "HC": q.h_c,
        "TanTheta": known.tan_theta.value, "K": known.k, "HFunction": int(q.h_function),
        "Tint": (1.0, 1.0, 1.0, 1.0) if ground.colour is None else ground.colour,
        "Level": LEVELS.index(level), "Normal": normal, **_sun_inputs(sun),
        "PlanetDirection": (0.0, 0.0, 1.0), "PlanetIrradiance": (0.0, 0.0, 0.0, 1.0), "PlanetRadius": 0.0, **albedo,
    }).outputs[0]


def _sun_inputs(sun: Sun) -> dict[str, Any]:
    return {"SunDirection": sun.direction, "SunIrradiance": sun.irradiance_wm2, "SunRadius": sun.radius,
            "SunBlur": sun.blur}


def aim(materials: Iterable[bpy.types.Material], sun: Sun) -> None:
    """Tell surfaces where the Sun is now."""
    for material in materials:
        nodes = material.node_tree.nodes
        if _SUN in nodes:
            for axis, value in zip("XYZ", sun.direction, strict=True):
                nodes[_SUN].inputs[axis].default_value = value
        if _BLUR in nodes:
            nodes[_BLUR].inputs[0].default_value = sun.blur
        if _SCRIPT in nodes:
            for name, value in _sun_inputs(sun).items():
                nodes[_SCRIPT].inputs[name].default_value = value


def is_osl(material: bpy.types.Material) -> bool:
    """Whether a material needs Open Shading Language."""
    return _SCRIPT in material.node_tree.nodes


def _level(material: bpy.types.Material) -> str:
    return LEVELS[material.node_tree.nodes[_SCRIPT].inputs["Level"].default_value] if is_osl(material) else LEVELS[0]


def traces(material: bpy.types.Material) -> bool:
    """Whether a material traces the Sun itself, so that the lamp must not light it."""
    return _level(material) != LEVELS[0]


def made_of(materials: Iterable[bpy.types.Material]) -> dict[str, str] | None:
    """What Hapke's law is made of in these materials and at which accuracy; None if none has it."""
    for material in materials:
        if is_osl(material) or any(node.label == hapke_nodes.NAME for node in material.node_tree.nodes):
            return {"made_of": "OSL" if is_osl(material) else "NODES", "accuracy": _level(material)}
    return None


def share_lamp(name: str, lamp: bpy.types.Object, tracing: Iterable[bpy.types.Object]) -> None:
    """Let a lamp light everything but the objects that trace it themselves."""
    linking, tracing = lamp.light_linking, list(tracing)
    if linking.receiver_collection is not None and linking.receiver_collection.get(TAG) == SHARED:
        linking.receiver_collection = None
    if tracing:
        collection = linking.receiver_collection = bpy.data.collections.new(name)
        collection[TAG] = SHARED
        for item in tracing:
            collection.objects.link(item)
        for entry in collection.collection_objects:
            entry.light_linking.link_state = "EXCLUDE"


def attune(scene: bpy.types.Scene, materials: Iterable[bpy.types.Material], lamp: bpy.types.Object) -> None:
    """Make a scene that is set up for Cycles render these materials right, wherever the lamp has been turned to.

    Raises IcyMoonError if they need Open Shading Language and the scene cannot have it.
    """
    materials = list(materials)
    depsgraph = scene.view_layers[0].depsgraph
    depsgraph.update()  # a lamp that was only just made or turned has no world matrix yet
    aim(materials, Sun.from_lamp(lamp, lamp.evaluated_get(depsgraph).matrix_world))
    if any(map(is_osl, materials)):
        if not compat.has_osl() or scene.cycles.device == "GPU":
            raise IcyMoonError("The surface was built for Open Shading Language on the CPU; build the scene again "
                               "here, or set quality.device to CPU.")
        scene.cycles.shading_system = True
    if any(map(traces, materials)):
        # What a ray finds at its end shines by itself, a bounce earlier than a lamp would light it.
        scene.cycles.diffuse_bounces = max(scene.cycles.diffuse_bounces - 1, 0)

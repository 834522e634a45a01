"""Surfaces with reflectance laws that no closure of Cycles has, so that their shaders must know where the Sun is.

Sunlight is exact for all of them. Hapke's law has three levels of accuracy:

* fast: a diffuse closure whose weight is π times the BRDF for the Sun. Light from other ground gets the same weight
  where the Sun reaches the surface;
* accurate: the shader traces the Sun with its disc. The closure scatters only other light, by Lambert's law with the
  same albedo at this emission angle. The lamp does not light these surfaces;
* reference: the first three interreflections follow Hapke's law at both ends too.

With Open Shading Language, the shader traces the planet at every level. Each sample has one ray to a random point of
the planet's disc, which is exact in the mean. The first interreflection of this light follows the law where it leaves.

Only Open Shading Language on the processor can trace in a shader. Nodes are always fast, and treat the planet as a
point in the middle of its lit part. The law is then within 0.4 % for Jupiter from Europa, and within 2 % for Saturn
from Enceladus, in 95 % of directions (``python benchmarks hapke planet``). A closure has one weight: that for the Sun,
or for the planet if the Sun is dark. So ``render.separate_lights`` renders them one after the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from ...physics.surfaces import hapke as model
from ...physics.surfaces import snow
from ...physics.surfaces.photometry import Law, hemispherical_fit, lunar_lambert_normal_albedo
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import HapkeSettings
from ...support.arrays import Array
from ...support.blender import compat
from ...support.errors import IcyMoonError
from ..light.planet_lamp import make_planet_inputs
from ..tree.builder import Socket, Tree, Triple, Value
from ..tree.formula import Number, Vector
from . import hapke_nodes
from .hapke_osl import add_script_node
from .sun_inputs import BLUR, DIRECTION, LEVELS, NEARNESS, SCRIPT, Sun, make_sun_inputs


@dataclass(frozen=True)
class Slopes:
    """Hapke's θ̄ as varied by an image: its output socket, and its limits, in radians."""

    value: Socket
    low: float
    high: float


@dataclass(frozen=True)
class Ground:
    """The inputs of the laws from the rest of a material's tree.

    ``normal`` is an output socket, or None for the mesh's own normal. ``grey`` is the factor on the albedo (on w for
    Hapke's law), a number or an output socket. ``colour`` is an output socket of the colour factor, or None. ``slopes``
    is Hapke's θ̄ if an image varies it.
    """

    tree: Tree
    normal: Socket | None
    grey: Value
    colour: Socket | None
    slopes: Slopes | None = None


@dataclass(frozen=True)
class Grains:
    """Hapke's parameters, and the minimum of the ground's grey factor on w."""

    parameters: model.HapkeParameters
    darkest: float


def choose_backend(hapke: HapkeSettings, device: str) -> tuple[bool, str, str]:
    """Choose whether Hapke's law uses OSL, and its level. Return both, and a sentence if they differ from the settings,
    else an empty text.

    Raises IcyMoonError if the settings require OSL and it is not available.
    """
    asked, level = hapke.backend, hapke.accuracy
    why = ("" if compat.has_osl() else "this Blender was built without Open Shading Language") or (
        "Open Shading Language traces only on the CPU" if device == "GPU" else ""
    )
    if asked == "OSL" and why:
        raise IcyMoonError(
            f"hapke.backend is OSL, but {why}; set hapke.backend to AUTO"
            + (" or quality.device to CPU." if device == "GPU" else ".")
        )
    if asked == "OSL" or (asked == "AUTO" and not why):
        return True, level, ""
    if level != "FAST":
        reason = why or "nodes cannot trace"
        return False, "FAST", f"Hapke's surface is built from nodes, with hapke.accuracy FAST, because {reason}."
    return False, level, f"Hapke's surface is built from nodes, because {why}." if asked == "AUTO" else ""


def _uses_law(settings: Settings, model: str) -> bool:
    topics = ["surface"] + (["rock_surface"] if settings.rocks.own_surface else [])
    return any(settings[topic]["model"] == model for topic in topics)


def uses_hapke(settings: Settings) -> bool:
    """Return whether the ground or the rocks reflect by Hapke's law."""
    return _uses_law(settings, "HAPKE")


#: A part of the identity of scenes in which nodes replace OSL.
OF_NODES = "Hapke of nodes"


def describe_osl_substitute(settings: Settings) -> str:
    """Return a text for the scene's identity if nodes replace OSL here, on which the settings say nothing; else
    empty."""
    automatic = uses_hapke(settings) and settings.hapke.backend == "AUTO"
    of_osl = not automatic or choose_backend(settings.hapke, settings.quality.device)[0]
    return "" if of_osl else OF_NODES


def advise_on_hapke(settings: Settings) -> list[str]:
    """Return sentences of advice on a Hapke surface. Raises IcyMoonError if it, or snow of OSL, cannot be built."""
    if _uses_law(settings, "SNOW") and settings.hapke.backend == "OSL":
        choose_backend(settings.hapke, settings.quality.device)
    if not uses_hapke(settings):
        return []
    model.hapke_from_settings(settings.hapke)
    message = choose_backend(settings.hapke, settings.quality.device)[2]
    return [message] if message else []


def _add_sight(ground: Ground, sun: Sun) -> tuple[Vector, Vector, Vector]:
    """Return the normal, the direction to the Sun, and the direction to the viewer."""
    tree = ground.tree
    geometry = tree.node("ShaderNodeNewGeometry", "Sight")
    toward_sun = tree.combined(DIRECTION, *sun.direction)
    if sun.with_lamps:
        near = tree.math("ADD", NEARNESS, float(sun.distance_m > 0), 0.0)
        here = tree.scaled("Seen from Near", geometry.outputs["Position"], near)
        toward_sun = tree.vector("NORMALIZE", "Toward the Source", tree.vector("SUBTRACT", "Way", toward_sun, here))
    elif sun.distance_m:
        lamp = tree.scaled("Lamp", toward_sun, sun.distance_m)
        way = tree.vector("SUBTRACT", "Way to the Lamp", lamp, geometry.outputs["Position"])
        toward_sun = tree.vector("NORMALIZE", "Toward the Lamp", way)
    return (
        Vector(tree, geometry.outputs["Normal"] if ground.normal is None else ground.normal),
        Vector(tree, toward_sun),
        Vector(tree, geometry.outputs["Incoming"]),
    )


def _add_reflectance(ground: Ground, label: str, weight: Number) -> Triple:
    """Multiply a reflectance by the ground's colour, and return the colour or its output socket."""
    value = weight.value
    if ground.colour is not None:
        return ground.tree.scaled(f"{label} Colour", ground.colour, value)
    return (*[float(value)] * 3, 1.0) if isinstance(value, (int, float)) else value


def _add_diffuse(ground: Ground, label: str, weight: Number) -> Socket:
    """Add Lambert's law with this reflectance times the ground's colour, and return its shader socket."""
    return ground.tree.diffuse(label, _add_reflectance(ground, label, weight), ground.normal)


def _add_lit_or_not(ground: Ground, mu0: Number, lit: Number, other: Number) -> Socket:
    """Add the diffuse closure with the weight ``lit`` where the Sun is above the surface, else ``other``. Return its
    shader socket.

    Cycles does not evaluate the nodes of the side that it does not need.
    """
    return ground.tree.over(
        "Sunlit or Not",
        mu0.exceeds(0.0).value,
        _add_diffuse(ground, "Shaded", other),
        _add_diffuse(ground, "Sunlit", lit),
    )


def mix_by_camera_ray(tree: Tree, seen: Socket, other: Socket) -> Socket:
    """Use the closure ``seen`` for camera rays, and ``other`` for all other rays. Return the shader socket.

    Cycles does not evaluate the nodes of the side that it does not need.
    """
    ray = tree.node("ShaderNodeLightPath", "Light Path").outputs["Is Camera Ray"]
    return tree.over("Seen or Not", ray, other, seen)


def add_lambert(ground: Ground, albedo: float, smooth: bool) -> Socket:
    """Add Lambert's law, and return its shader socket. If ``smooth``, only camera rays see the ground's normal with its
    relief."""
    colour = _add_reflectance(ground, "Lambert", Number(ground.tree, ground.grey) * albedo)
    seen = ground.tree.diffuse("Lambert", colour, ground.normal)
    if not smooth or ground.normal is None:
        return seen
    return mix_by_camera_ray(ground.tree, seen, ground.tree.diffuse("Smooth Lambert", colour))


def add_lunar_lambert(ground: Ground, albedo: float, share: float, sun: Sun) -> Socket:
    """Add ``physics.surfaces.photometry.lunar_lambert``, and return its shader socket."""
    n, toward_sun, eye = _add_sight(ground, sun)
    mu0, mu = n.dot(toward_sun).named("µ0"), n.dot(eye).at_least(1e-6).named("µ")
    bond = Number(ground.tree, ground.grey) * albedo
    seeliger = (2.0 * share) / (mu0 + mu).at_least(1e-6)
    lit = (seeliger + (1.0 - share)) * (bond * lunar_lambert_normal_albedo(1.0, share))
    return _add_lit_or_not(ground, mu0, lit, bond)


def add_snow(ground: Ground, albedo: float, sun: Sun) -> Socket:
    """Add ``physics.surfaces.snow``, and return its shader socket. Light of ground in shadow gets the albedo of the
    emission angle."""
    n, toward_sun, eye = _add_sight(ground, sun)
    mu0, mu = n.dot(toward_sun).at_least(0.0).named("µ0"), n.dot(eye).at_least(0.0).named("µ")
    both = (mu0 + mu).at_least(snow.MIN_COSINE_SUM)
    half_phase = toward_sun.distance(eye).arctan2((toward_sun + eye).length()).named("g/2")
    white = both * snow.LINEAR + snow.LEVEL + mu0 * mu * snow.PRODUCT
    for amplitude, decay in snow.PHASE_TERMS:
        white = (half_phase * math.degrees(2 * decay)).exp() * (amplitude * math.exp(-180.0 * decay)) + white
    white = (white / (both * 4.0)).named("R0")
    left = (Number(ground.tree, ground.grey) * albedo).at_least(1e-6).log().named("ln albedo")

    def escape(cosine: Number) -> Number:
        return cosine.times_plus(6 / 7, 3 / 7)

    seen = left * escape(mu)
    lit = (seen * escape(mu0) / white).exp() * white
    return _add_lit_or_not(ground, mu0, lit, seen.exp())


def add_snow_of_osl(ground: Ground, albedo: float, sun: Sun, level: str) -> Socket:
    """Add the law of ``add_snow`` in Open Shading Language, and return its shader socket."""
    w = (Number(ground.tree, ground.grey) * albedo).at_most(1.0).value
    return _add_script(
        ground,
        sun,
        level,
        {
            "W": w,
            "Snow": 1,
            "TanTheta": 0.0,
            "K": 1.0,
            "HFunction": 2002,
            **dict.fromkeys(("B", "C", "BS0", "HS", "BC0", "HC"), 0.0),
            **{f"Albedo{k}": (0.0, 0.0, 0.0) for k in range(4)},
        },
        "Snow",
    )


def _add_script(ground: Ground, sun: Sun, level: str, inputs: dict[str, Any], label: str) -> Socket:
    """Add ``hapke.osl`` with these inputs and the inputs for the Sun and the planet, and return its shader socket."""
    normal = ground.normal
    if normal is None:
        normal = ground.tree.node("ShaderNodeNewGeometry", "Sight").outputs["Normal"]
    node = add_script_node(
        ground.tree,
        SCRIPT,
        {
            "Tint": (1.0, 1.0, 1.0, 1.0) if ground.colour is None else ground.colour,
            "Level": LEVELS.index(level),
            "Normal": normal,
            **make_sun_inputs(sun),
            **make_planet_inputs(None),
            **inputs,
        },
    )
    node.label = label
    return node.outputs[0]


@lru_cache(maxsize=64)
def _fit_hemispherical_albedo(q: model.HapkeParameters, darkest: float, slopes: tuple[float, float]) -> Array:
    """Fit the hemispherical albedo, for θ̄ in ``slopes`` and for w times a factor from ``darkest`` to 1, and return the
    coefficients."""
    least, most = math.sqrt(1 - q.w), math.sqrt(1 - q.w * darkest)
    gammas = np.linspace(least, most, 5) if most - least > 1e-6 else np.array([least])

    def law_of(w: float, theta_bar: float) -> Law:
        return partial(model.bidirectional_reflectance, parameters=replace(q, w=w, theta_bar=theta_bar))

    return hemispherical_fit(law_of, gammas, slopes)


def _add_albedo_coefficients(ground: Ground, grains: Grains) -> list[list[Number]]:
    """Add the coefficients (4, 3) of the hemispherical albedo in powers of cos e and r0, for the ground's θ̄."""
    low = high = float(grains.parameters.theta_bar)
    t = Number(ground.tree, 0.0)
    if ground.slopes is not None:
        low, high = ground.slopes.low, ground.slopes.high
        if high > low:
            t = Number(ground.tree, ground.slopes.value).times_plus(2 / (high - low), -(high + low) / (high - low))

    def at(coefficients: list[float]) -> Number:
        value = Number(ground.tree, 0.0)
        for coefficient in reversed(coefficients):
            value = value.times_plus(t, coefficient)
        return value

    return [
        [at(column) for column in row]
        for row in _fit_hemispherical_albedo(grains.parameters, grains.darkest, (low, high)).tolist()
    ]


def _make_node_grains(ground: Ground, q: model.HapkeParameters) -> hapke_nodes.Grains:
    w = (Number(ground.tree, ground.grey) * float(q.w)).at_most(1.0)
    theta_bar = Number(ground.tree, float(q.theta_bar) if ground.slopes is None else ground.slopes.value)
    return hapke_nodes.Grains(
        w,
        theta_bar.tangent().named("tan θ̄"),
        float(q.b),
        float(q.c),
        float(q.b_s0),
        float(q.h_s),
        float(q.b_c0),
        float(q.h_c),
        float(model.porosity_factor(q.filling_factor)),
        q.h_function,
    )


def add_hapke_of_nodes(ground: Ground, grains: Grains, sun: Sun) -> Socket:
    """Add Hapke's law from nodes, and return its shader socket."""
    n, toward_sun, eye = _add_sight(ground, sun)
    tree, known = ground.tree, _make_node_grains(ground, grains.parameters)
    blur = tree.math("ADD", BLUR, sun.blur, 0.0)  # a node whose number can be set
    weight = hapke_nodes.add_brdf(n, toward_sun, eye, Number(tree, blur), known) * math.pi
    if not blur.is_linked:
        tree.tree.nodes.remove(blur.node)
    gamma, white, mu = (1.0 - known.w).at_least(0.0).sqrt(), Number(tree, 0.0), n.dot(eye).at_least(0.0)
    r0 = (1.0 - gamma) / (gamma + 1.0)
    for c0, c1, c2 in reversed(_add_albedo_coefficients(ground, grains)):
        white = white.times_plus(mu, r0.times_plus(c2, c1).times_plus(r0, c0))
    return _add_lit_or_not(ground, n.dot(toward_sun), weight, white.at_least(0.0).at_most(1.0))


def _add_vector(tree: Tree, label: str, numbers: list[Number]) -> Socket:
    """Return three constants, or the output socket of a node that combines the numbers."""
    if all(number.known is not None for number in numbers):
        return tuple(number.known for number in numbers)
    return tree.combined(label, *(number.value for number in numbers))


def add_hapke_of_osl(ground: Ground, grains: Grains, sun: Sun, level: str) -> Socket:
    """Add Hapke's law in Open Shading Language, and return its shader socket."""
    tree, q = ground.tree, grains.parameters
    known = _make_node_grains(ground, q)
    albedo = {
        f"Albedo{k}": _add_vector(tree, f"Albedo {k}", row)
        for k, row in enumerate(_add_albedo_coefficients(ground, grains))
    }
    return _add_script(
        ground,
        sun,
        level,
        {
            "W": known.w.value,
            "B": q.b,
            "C": q.c,
            "BS0": q.b_s0,
            "HS": q.h_s,
            "BC0": q.b_c0,
            "HC": q.h_c,
            "TanTheta": known.tan_theta.value,
            "K": known.k,
            "HFunction": int(q.h_function),
            "Snow": 0,
            **albedo,
        },
        SCRIPT,
    )

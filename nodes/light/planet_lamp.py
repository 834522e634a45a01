"""The planet as a lamp. ``celestial_meshes`` makes the planet that the camera sees.

Cycles loses up to a fifth of the light of a far mesh, because it samples a triangle by its size in metres. So a Sun
lamp with the angular size of the planet lights the ground. It is at infinity, and its nodes compute the radiance in
each direction.
"""

from __future__ import annotations

import json
import math
from functools import partial
from typing import Any

import bpy
from mathutils import Vector

from ...physics.light.planetshine import Planet, find_lit_chords, find_mean_direction, make_ellipsoid, unshaded_share
from ...support.arrays import Array
from ...support.blender import compat
from ...support.file_schemas import NUMBER, Each
from ..datablocks.stored_json import read_stored
from ..tree.builder import WHITE, Socket, Tree, Value
from ..tree.followed_tree import FollowedTree, OtherTreeError

SHAPE = "icymoon_shape"  # property of the lamp: inputs of ``hapke.osl`` on the planet, without its radiance
_HAPKE_INPUTS = {
    "PlanetLit": NUMBER,
    "PlanetRadius": NUMBER,
    "PlanetStretch": NUMBER,
    **dict.fromkeys(("PlanetAcross", "PlanetDirection", "PlanetObserver", "PlanetPole", "PlanetSun"), Each(NUMBER)),
}
MEAN = "icymoon_mean"  # property of the lamp: the mean direction of its light


def build_planet_light(
    name: str, planet: Planet, colour: Array, former: bpy.types.Object | None = None
) -> bpy.types.Object:
    """Build a Sun lamp with the angular size of the planet's equator, which shines where the planet is sunlit.

    A Sun lamp of energy E and angular radius r has the radiance E / (π sin² r) times the strength of its shader. The
    shadow of the rings darkens the whole disc evenly. The lamp of a ``former`` light is kept if only values differ.
    """
    lamp = former.data if former is not None and _follow_planet(former.data, planet) else _build_lamp(name, planet)
    lamp.color = tuple(map(float, colour))
    compat.disable_light_factors(lamp)
    lamp.angle = math.radians(planet.angular_diameter_deg)
    lamp.energy = (
        make_ellipsoid(planet).full_radiance * unshaded_share(planet) * math.pi * math.sin(lamp.angle / 2) ** 2
    )
    item = bpy.data.objects.new(name, lamp)
    item.rotation_euler = Vector(planet.direction).to_track_quat("Z", "Y").to_euler()
    item.location = planet.direction * 10.0  # only moves the symbol in the viewport
    across, lit = find_lit_chords(planet)
    item[SHAPE] = json.dumps(
        {
            "PlanetAcross": across.tolist(),
            "PlanetLit": lit,
            "PlanetDirection": planet.direction.tolist(),
            "PlanetRadius": lamp.angle / 2,
            "PlanetObserver": make_ellipsoid(planet).observer.tolist(),
            "PlanetPole": planet.pole.tolist(),
            "PlanetStretch": 1 / (1 - planet.flattening) - 1,
            "PlanetSun": planet.sun.tolist(),
        }
    )
    item[MEAN] = find_mean_direction(planet).tolist()
    return item


def _build_lamp(name: str, planet: Planet) -> bpy.types.Light:
    lamp = bpy.data.lights.new(name, "SUN")
    _fill_tree(Tree(compat.ensure_light_nodes(lamp)), planet)
    return lamp


def _follow_planet(lamp: bpy.types.Light, planet: Planet) -> bool:
    try:
        _fill_tree(FollowedTree(lamp.node_tree), planet)
    except OtherTreeError:
        return False
    return True


def _fill_tree(tree: Tree, planet: Planet) -> None:
    light = tree.emission("Planet", WHITE, _add_sunlit(tree, planet))
    tree.node("ShaderNodeOutputLight", "Light", {"Surface": light}, target="ALL")
    tree.arrange()


def make_planet_inputs(shine: bpy.types.Object | None) -> dict[str, Any]:
    """Make the inputs of ``hapke.osl`` for the planet's lamp. Without a lamp, their light is zero."""
    if shine is None or shine.hide_render:
        return {
            "PlanetRadiance": (0.0, 0.0, 0.0, 1.0),
            "PlanetDirection": (0.0, 0.0, 1.0),
            "PlanetRadius": 0.0,
            "PlanetObserver": (0.0, 0.0, -2.0),
            "PlanetPole": (0.0, 0.0, 1.0),
            "PlanetStretch": 0.0,
            "PlanetSun": (0.0, 0.0, 1.0),
            "PlanetAcross": (1.0, 0.0, 0.0),
            "PlanetLit": 1.0,
        }
    full = shine.data.energy / (math.pi * math.sin(shine.data.angle / 2) ** 2)
    return {
        "PlanetRadiance": (*(full * band for band in shine.data.color), 1.0),
        **read_stored(shine, SHAPE, _HAPKE_INPUTS),
    }


def _add_sunlit(tree: Tree, planet: Planet) -> Socket:
    """Add the cosine of the Sun's zenith distance on the planet in the direction of the light, and return its output
    socket.

    The ray o + t w meets an ellipsoid, which is the unit sphere after space is stretched along the pole.
    """
    shape = make_ellipsoid(planet)
    vector, scaled = tree.vector, tree.scaled
    dot = partial(vector, "DOT_PRODUCT")

    def stretched(label: str, a: Value) -> Socket:
        along = dot(f"{label} along Pole", a, tuple(planet.pole))
        more = scaled(f"{label} Stretch", tuple(planet.pole * (1 / (1 - planet.flattening) - 1)), along)
        return vector("ADD", f"{label} Stretched", a, more)

    observer = tuple(shape.observer)
    back = tree.node("ShaderNodeNewGeometry", "From the Planet").outputs["Incoming"]
    view = scaled("Direction", back, -1.0)
    ray = scaled("Ray", stretched("Direction", view), 1 / shape.radius)
    a, b = dot("a", ray, ray), dot("b", ray, observer)
    c = float(shape.observer @ shape.observer) - 1
    inside = tree.math("SUBTRACT", "b² - a c", tree.math("MULTIPLY", "b²", b, b), tree.math("MULTIPLY", "a c", a, c))
    root = tree.math("POWER", "Root", tree.math("MAXIMUM", "Real", inside, 0.0), 0.5)
    time = tree.math("DIVIDE", "t", tree.math("SUBTRACT", "-b - Root", tree.math("MULTIPLY", "-b", b, -1.0), root), a)
    point = vector("ADD", "Point", scaled("Way", ray, time), observer)
    normal = vector("NORMALIZE", "Normal", stretched("Point", point))
    sunlit = tree.math("MAXIMUM", "Sunlit", dot("cos i", normal, tuple(planet.sun)), 0.0)
    hit = tree.math(
        "MULTIPLY", "Hit", tree.math("GREATER_THAN", "Meets", inside, 0.0), tree.math("LESS_THAN", "Ahead", b, 0.0)
    )
    up = tree.math("GREATER_THAN", "Above Horizon", dot("Height", view, (0.0, 0.0, 1.0)), 0.0)
    return tree.math("MULTIPLY", "Seen and Sunlit", tree.math("MULTIPLY", "Seen", hit, up), sunlit)

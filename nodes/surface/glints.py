"""Glints of snow: facets of grains that mirror the Sun to one eye and not to the other.

Cells about as wide as a pixel, or as a grain where that is larger, each have one facet. Its slope is drawn by the
distribution of GGX about the surface, so that the mean over many cells is a broad lobe. The facet itself has a narrow
lobe, wider the more grains a cell stands for. Cells and facets depend on the place only: a glint stays where it
is while the camera moves, and ends when the facet no longer mirrors the Sun to it. Blender's nodes have no derivatives,
so the width of a pixel is computed from the distance.

Guesses are the share of the light, the spread of slopes and the width of the lobe of a single grain. No photometry of
single glints was found for icy moons.
"""

from __future__ import annotations

import math

from ..tree.builder import Node, Socket, Tree, Value, find_output
from ..tree.formula import Number, Vector

#: GGX width, as alpha, of the slopes of facets about the surface, and of the lobe of one facet.
_SLOPES_ALPHA, _FACET_ALPHA = 0.6, 0.003
#: Share of all facets with slopes below 50 degrees, the largest one, since other grains hide steeper facets.
_LESS_STEEP = 0.8
#: Maximum width of a cell in pixels: wider cells would be blotches of several pixels.
_CELL_PX = 1.0


def add_glints(
    tree: Tree,
    snow: Socket,
    reflectance: Value,
    geometry: Node,
    normal: Socket,
    share: float,
    size_m: float,
    pixel_rad: float,
    seed: float,
) -> Socket:
    """Shader socket of ``snow`` with facets: camera rays meet facets on a share of it.

    ``reflectance`` is a number or a socket of a colour, ``normal`` a socket, ``size_m`` the size of a grain and
    ``pixel_rad`` the angle of a pixel. ``seed`` selects the facets.
    """
    place = geometry.outputs["Position"]
    level = _add_level(tree, geometry, size_m, pixel_rad, seed)
    per_grain = Number(tree, tree.math("POWER", "Grains per Cell", 2.0, level.value))
    facet = _add_facet(tree, place, normal, level, per_grain * size_m, seed)
    alpha = (per_grain * _FACET_ALPHA).at_most(_SLOPES_ALPHA)
    colour = (*[float(reflectance)] * 3, 1.0) if isinstance(reflectance, (int, float)) else reflectance
    glint = tree.node(
        "ShaderNodeBsdfAnisotropic",
        "Facets",
        {
            "Color": colour,
            "Roughness": alpha.sqrt().named("Roughness of a Facet").value,
            "Anisotropy": 0.0,
            "Rotation": 0.0,
            "Normal": facet,
            "Tangent": None,
        },
        if_present={"Weight": 0.0},
        distribution="MULTI_GGX",
    ).outputs[0]
    ray = Number(tree, tree.node("ShaderNodeLightPath", "Glints for Whom").outputs["Is Camera Ray"])
    return tree.over("Snow or Facet", (ray * share).named("Share of Facets").value, snow, glint)


def _add_level(tree: Tree, geometry: Node, size_m: float, pixel_rad: float, seed: float) -> Number:
    """Add the octave of the cells, a whole number. Each octave doubles the width of cells, from the size of a grain on.

    Between two octaves each point gets one of them at random, so that no line shows where the octave changes.
    """
    away = Number(tree, tree.node("ShaderNodeCameraData", "Camera").outputs["View Distance"])
    pixel = away * (0.5 * _CELL_PX * pixel_rad / size_m)
    octaves = pixel.at_least(1.0).log() * (1.0 / math.log(2.0))
    chance = tree.node(
        "ShaderNodeTexWhiteNoise",
        "Chance of an Octave",
        {"Vector": geometry.outputs["Position"], "W": seed},
        noise_dimensions="4D",
    ).outputs["Value"]
    return Number(tree, tree.math("FLOOR", "Octave", (octaves + Number(tree, chance)).value))


def _add_facet(tree: Tree, place: Socket, normal: Socket, level: Number, cell_m: Number, seed: float) -> Socket:
    """Output socket of the normal of the facet of the cell that a place is in."""
    cell = tree.vector("FLOOR", "Cell", tree.scaled("Place in Cells", place, (1.0 / cell_m).value))
    chance = tree.node(
        "ShaderNodeTexWhiteNoise",
        "Chance of a Facet",
        {"Vector": cell, "W": (level + seed).value},
        noise_dimensions="4D",
    )
    drawn = Number(tree, chance.outputs["Value"]) * _LESS_STEEP
    slope = (drawn / (1.0 - drawn)).sqrt() * _SLOPES_ALPHA
    # The direction of the slope: a random vector, less its part along the normal.
    random = tree.vector("SUBTRACT", "About 0", find_output(chance, "Color"), (0.5, 0.5, 0.5))
    across = Vector(tree, normal).cross(Vector(tree, random)).unit()
    tilted = tree.scaled("Sloping", across.socket, slope.value)
    return (Vector(tree, normal) + Vector(tree, tilted)).unit().socket

"""Materials of the lander: anodized metal, black, silver and white paint, and foil, with frost on surfaces that face
up.

Reflectances of sunlight are 1 less the solar absorptance of such coatings. Clear anodize absorbs 0.27 (Gilmore 2002,
*Spacecraft Thermal Control Handbook*, table A.1); black polyurethane paint 0.95, conducting silver paint 0.37, white
silicone paint 0.26, Kapton over aluminium 0.40 and polished titanium 0.60 (Fortescue et al. 2011, *Spacecraft Systems
Engineering*, table 11.3). The surface of a dielectric reflects 0.04 of the light. The share and the width of the gloss,
and the hues, are chosen: under a black sky, a perfect mirror is black except for its glints.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ...physics.arm import lander_solids as names
from ...support.blender import compat
from ...support.labels import LANDER, NORMAL_AOV
from ..datablocks.fingerprint import NAME, TAG
from ..surface.patches_and_grain import add_noise, find_threshold
from ..tree.builder import Node, Socket, Tree, find_output
from ..tree.formula import Number


@dataclass(frozen=True)
class _Finish:
    """Colour, share of a metal's gloss, roughness, depth of its creases in metres, and length of their facets."""

    colour: tuple[float, float, float]
    metal: float
    roughness: float
    creases_m: float = 0.0
    facet_m: float = 0.05


FINISHES = {
    names.METAL: _Finish((0.74, 0.73, 0.71), 0.45, 0.5, 0.00004, 0.004),
    names.STEEL: _Finish((0.43, 0.40, 0.37), 0.7, 0.35),
    names.BLACK: _Finish((0.012, 0.012, 0.013), 0.0, 0.55),
    names.TUBE: _Finish((0.62, 0.61, 0.59), 0.2, 0.5, 0.00006, 0.006),
    names.WHITE: _Finish((0.74, 0.73, 0.70), 0.0, 0.6),
    names.FOIL: _Finish((0.88, 0.61, 0.25), 0.85, 0.22, 0.006, 0.045),
}
#: The finish of frost, which hides the metal under it.
_FROST = _Finish((0.9, 0.9, 0.9), 0.0, 0.9)
#: Wavelength of patches of frost, m.
_FROST_PATCH_M = 0.06
#: Cosine of the steepest slope with frost.
_MIN_FROST_COSINE = 0.35


def build_materials(frost_share: float) -> dict[str, bpy.types.Material]:
    """Build the materials by name, with frost on a share of the surfaces that face up."""
    return {name: _build_material(name, finish, frost_share) for name, finish in FINISHES.items()}


def _build_material(name: str, finish: _Finish, frost_share: float) -> bpy.types.Material:
    material = bpy.data.materials.new(f"{NAME} Lander {name.title()}")
    material[TAG], material.pass_index = "material", LANDER
    tree = Tree(compat.ensure_nodes(material))
    geometry = tree.node("ShaderNodeNewGeometry", "Geometry")
    # Places on the link itself: the pattern moves with the arm.
    place = find_output(tree.node("ShaderNodeTexCoord", "On the Link", from_instancer=False), "Object")
    shader = _add_finish(tree, name.title(), finish, _add_creases(tree, finish, place))
    if frost_share > 0.0:
        frost = _add_finish(tree, "Frost", _FROST, None)
        shader = tree.over("Frosted", _add_frost(tree, geometry, place, frost_share), shader, frost)
    tree.surface(shader)
    tree.value_pass("Geometric Normal", NORMAL_AOV, geometry.outputs["True Normal"])
    tree.arrange()
    return material


def _add_creases(tree: Tree, finish: _Finish, place: Socket) -> Socket | None:
    """Add the relief of creased foil or brushed metal, and return the socket of its normal; None for a smooth
    finish."""
    if finish.creases_m == 0.0:
        return None
    cells = tree.node(
        "ShaderNodeTexVoronoi",
        "Facets",
        {
            "Vector": place,
            "Scale": 1.0 / finish.facet_m,
            "Detail": 1.5,
            "Roughness": 0.6,
            "Lacunarity": 2.3,
            "Randomness": 1.0,
        },
        voronoi_dimensions="3D",
        feature="F1",
        distance="EUCLIDEAN",
        normalize=False,
    ).outputs[0]
    return tree.bump("Creases", cells, finish.creases_m)


def _add_frost(tree: Tree, geometry: Node, place: Socket, share: float) -> Socket:
    """Add frost, and return the socket of its share: patches on surfaces that face up, none on other surfaces."""
    parts = tree.separated("Which Way Up", geometry.outputs["Normal"])
    up = (Number(tree, parts[2]) - _MIN_FROST_COSINE) / (1.0 - _MIN_FROST_COSINE)
    noise = Number(tree, add_noise(tree, "Frost Patches", place, _FROST_PATCH_M, 17.0, 5.0))
    least = find_threshold(share)
    patch = ((noise - least) * 12.0 + 0.5).at_least(0.0).at_most(1.0)
    return (patch * up.at_least(0.0).sqrt() * 0.9).value


def _add_finish(tree: Tree, label: str, finish: _Finish, normal: Socket | None) -> Socket:
    """Add the shader of a finish, and return its socket."""
    return tree.principled(label, (*finish.colour, 1.0), finish.roughness, Metallic=finish.metal, Normal=normal)

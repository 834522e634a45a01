"""Materials of the lander: anodized metal, black, silver and white paint, foil, with frost on what looks up.

Reflectances of sunlight are 1 less the solar absorptance of such coatings. Clear anodize absorbs 0.27 (Gilmore 2002,
*Spacecraft Thermal Control Handbook*, table A.1); black polyurethane paint 0.95, conducting silver paint 0.37, white
silicone paint 0.26, Kapton over aluminium 0.40 and polished titanium 0.60 (Fortescue et al. 2011, *Spacecraft Systems
Engineering*, table 11.3). The reflection of a dielectric's surface is 0.04 of it. How much of it is a gloss, and how
wide, is chosen, as are the hues: under a black sky a mere mirror is black but for its glints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ...physics.arm import lander_solids as names
from ...support.blender import compat
from ...support.labels import LANDER, NORMAL_AOV
from ..datablocks.fingerprint import NAME, TAG
from ..surface.patches_and_grain import add_noise, threshold_for_share
from ..tree.builder import Tree, output
from ..tree.formula import Number

_WHITE = (1.0, 1.0, 1.0, 1.0)


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
#: Frost: where it is, it hides the metal; wavelength of its patches in metres; cosine of the slope at which it ends.
_FROST, _PATCH_M, _LEAST_UP = _Finish((0.9, 0.9, 0.9), 0.0, 0.9), 0.06, 0.35


def build_materials(frost_share: float) -> dict[str, bpy.types.Material]:
    """The materials by name, with frost on a share of what looks up."""
    return {name: _build(name, finish, frost_share) for name, finish in FINISHES.items()}


def _build(name: str, finish: _Finish, frost_share: float) -> bpy.types.Material:
    material = bpy.data.materials.new(f"{NAME} Lander {name.title()}")
    material[TAG], material.pass_index = "material", LANDER
    tree = Tree(compat.ensure_nodes(material))
    geometry = tree.node("ShaderNodeNewGeometry", "Geometry")
    # Places on the link itself: the pattern moves with the arm.
    place = output(tree.node("ShaderNodeTexCoord", "On the Link", from_instancer=False), "Object")
    shader = _add_finish(tree, name.title(), finish, _add_creases(tree, finish, place))
    if frost_share > 0.0:
        frost = _add_finish(tree, "Frost", _FROST, None)
        shader = tree.node(
            "ShaderNodeMixShader",
            "Frosted",
            {"Fac": _add_frost(tree, geometry, place, frost_share), "Shader": shader, "Shader_001": frost},
        ).outputs[0]
    tree.node(
        "ShaderNodeOutputMaterial",
        "Surface",
        {"Surface": shader},
        leave=("Volume", "Displacement", "Thickness"),
        target="ALL",
    )
    tree.node(
        "ShaderNodeOutputAOV",
        "Geometric Normal",
        {"Color": geometry.outputs["True Normal"], "Value": 0.0},
        aov_name=NORMAL_AOV,
    )
    tree.arrange()
    return material


def _add_creases(tree: Tree, finish: _Finish, place: Any) -> Any:
    """Socket of the normal of creased foil or brushed metal; None for a smooth finish."""
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
    return tree.node(
        "ShaderNodeBump",
        "Creases",
        {"Strength": 1.0, "Distance": finish.creases_m, "Height": cells},
        if_present={"Filter Width": 0.1},
        leave=("Normal",),
        invert=False,
    ).outputs[0]


def _add_frost(tree: Tree, geometry: Any, place: Any, share: float) -> Any:
    """Socket of the share of frost: patches on what looks up, none on what does not."""
    parts = tree.node("ShaderNodeSeparateXYZ", "Which Way Up", {"Vector": geometry.outputs["Normal"]})
    up = (Number(tree, output(parts, "Z")) - _LEAST_UP) / (1.0 - _LEAST_UP)
    noise = Number(tree, add_noise(tree, "Frost Patches", place, _PATCH_M, 17.0, 5.0))
    least = threshold_for_share(share)
    patch = ((noise - least) * 12.0 + 0.5).at_least(0.0).at_most(1.0)
    return (patch * up.at_least(0.0).sqrt() * 0.9).value


def _add_finish(tree: Tree, label: str, finish: _Finish, normal: Any) -> Any:
    """Shader socket of a finish."""
    return tree.node(
        "ShaderNodeBsdfPrincipled",
        label,
        {
            "Base Color": (*finish.colour, 1.0),
            "Metallic": finish.metal,
            "Roughness": finish.roughness,
            "IOR": 1.5,
            "Alpha": 1.0,
            **({} if normal is None else {"Normal": normal}),
            "Subsurface Weight": 0.0,
            "Subsurface Radius": (1.0, 1.0, 1.0),
            "Subsurface Scale": 0.0,
            "Subsurface Anisotropy": 0.0,
            "Specular IOR Level": 0.5,
            "Specular Tint": _WHITE,
            "Anisotropic": 0.0,
            "Anisotropic Rotation": 0.0,
            "Transmission Weight": 0.0,
            "Coat Weight": 0.0,
            "Coat Roughness": 0.0,
            "Coat IOR": 1.5,
            "Coat Tint": _WHITE,
            "Sheen Weight": 0.0,
            "Sheen Roughness": 0.5,
            "Sheen Tint": _WHITE,
            "Emission Color": _WHITE,
            "Emission Strength": 0.0,
        },
        if_present={
            "Weight": 0.0,
            "Diffuse Roughness": 0.0,
            "Thin Film Thickness": 0.0,
            "Thin Film IOR": 1.33,
            "Subsurface IOR": 1.4,
            "Thin Wall": False,
        },
        leave=["Coat Normal", "Tangent", *(["Normal"] if normal is None else [])],
        distribution="MULTI_GGX",
        subsurface_method="RANDOM_WALK",
    ).outputs[0]

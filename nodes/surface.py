"""Snow and ice as a Principled surface with procedural grain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from .. import compat
from ..labels import NORMAL_AOV, TERRAIN
from ..physics import principled
from ..physics.seeds import generator
from .builder import Tree
from .composition import brightness, noise, stain

WHITE = (1.0, 1.0, 1.0, 1.0)
GRAIN_OCTAVES = 3.0


def _base_colour(tree: Tree, surface: Mapping[str, Any], grey: Any, colour: Any) -> Any:
    """The Principled base colour that reflects albedo x grey x colour: a colour, or a socket that gives one."""
    albedo = surface["albedo"]
    if isinstance(grey, float) and colour is None:
        base = principled.base_colour(surface, albedo * grey)
        return (base, base, base, 1.0)
    if colour is None:
        reflectance = tree.math("MULTIPLY", "Reflectance", grey, albedo)
        wanted = tree.node("ShaderNodeCombineColor", "Grey", {"Red": reflectance, "Green": reflectance,
                                                               "Blue": reflectance}, mode="RGB").outputs[0]
    else:
        grey = albedo * grey if isinstance(grey, float) else tree.math("MULTIPLY", "Reflectance", grey, albedo)
        wanted = tree.node("ShaderNodeVectorMath", "Coloured", {"Vector": colour, "Scale": grey},
                           operation="SCALE").outputs[0]
    return tree.curve("Base of Reflectance", wanted, *principled.inverse(surface))


def bump_of(tree: Tree, height: Any, amplitude_m: float) -> Any:
    """Output socket of the normal of bumps that are ``amplitude_m`` high where ``height`` is 1."""
    return tree.node("ShaderNodeBump", "Relief", {"Strength": 1.0, "Distance": amplitude_m, "Height": height},
                     if_present={"Filter Width": 0.1}, leave=("Normal",), invert=False).outputs[0]


def build_material(name: str, surface: Mapping[str, Any], seed: int, semantic: int) -> bpy.types.Material:
    """A material from ``surface`` settings whose reflectance in a white furnace is its albedo.

    Fine relief shades as bump, so that the true depth stays that of the mesh, or moves the mesh's vertices. The
    geometric normal goes to the value pass ``NORMAL_AOV``, because Cycles' own Normal pass contains the bump.
    ``semantic`` is the label that the material-index pass carries.
    """
    material = bpy.data.materials.new(name)
    material.pass_index = semantic
    tree = Tree(compat.ensure_nodes(material))
    patches_at, grain_at, salt_at = (float(w) for w in generator(seed, "surface").uniform(0.0, 1000.0, 3))
    geometry = tree.node("ShaderNodeNewGeometry", "Geometry")
    grey = brightness(tree, surface, geometry, patches_at, elevated=semantic == TERRAIN)
    colour = _base_colour(tree, surface, grey, stain(tree, surface, geometry, salt_at))
    leave, output_leave = ["Coat Normal", "Tangent"], ["Volume", "Thickness"]
    relief: dict[str, Any] = {}
    displacement: dict[str, Any] = {}
    material.displacement_method = "BUMP"
    grain = noise(tree, "Grain", geometry.outputs["Position"], surface["grain_size_m"], grain_at,
                  GRAIN_OCTAVES) if surface["grain_amplitude_m"] > 0.0 else None
    if grain is not None and surface["relief"] == "BUMP":
        relief["Normal"] = bump_of(tree, grain, surface["grain_amplitude_m"])
    else:
        leave.append("Normal")
    if grain is not None and surface["relief"] == "DISPLACEMENT":
        material.displacement_method = "DISPLACEMENT"
        displacement["Displacement"] = tree.node("ShaderNodeDisplacement", "Relief", {
            "Height": grain, "Midlevel": 0.5, "Scale": surface["grain_amplitude_m"]}, leave=("Normal",),
            space="OBJECT").outputs[0]
    else:
        output_leave.append("Displacement")
    radius = surface["subsurface_radius_m"]
    snow = tree.node("ShaderNodeBsdfPrincipled", "Snow", {
        "Base Color": colour, "Metallic": 0.0, "Roughness": surface["roughness"], "IOR": surface["refractive_index"],
        "Alpha": 1.0, **relief,
        "Subsurface Weight": surface["subsurface_weight"] if radius > 0.0 else 0.0,
        "Subsurface Radius": (1.0, 1.0, 1.0), "Subsurface Scale": radius,
        "Subsurface Anisotropy": 0.0,
        "Specular IOR Level": surface["specular"], "Specular Tint": WHITE,
        "Anisotropic": 0.0, "Anisotropic Rotation": 0.0,
        "Transmission Weight": surface["transmission"],
        "Coat Weight": 0.0, "Coat Roughness": 0.0, "Coat IOR": 1.5, "Coat Tint": WHITE,
        "Sheen Weight": 0.0, "Sheen Roughness": 0.5, "Sheen Tint": WHITE,
        "Emission Color": WHITE, "Emission Strength": 0.0,
    }, if_present={"Weight": 0.0, "Diffuse Roughness": 0.0, "Thin Film Thickness": 0.0, "Thin Film IOR": 1.33,
                   "Subsurface IOR": 1.4, "Thin Wall": False},
        leave=leave, distribution="MULTI_GGX", subsurface_method="RANDOM_WALK")
    tree.node("ShaderNodeOutputMaterial", "Surface", {"Surface": snow.outputs[0], **displacement},
              leave=output_leave, target="ALL")
    tree.node("ShaderNodeOutputAOV", "Geometric Normal", {"Color": geometry.outputs["True Normal"], "Value": 0.0},
              aov_name=NORMAL_AOV)
    tree.arrange()
    return material

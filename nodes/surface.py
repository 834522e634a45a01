"""Snow and ice as a Principled surface with procedural grain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from .. import compat
from ..labels import NORMAL_AOV
from ..physics.seeds import generator
from .builder import Tree

WHITE = (1.0, 1.0, 1.0, 1.0)


def build_material(name: str, surface: Mapping[str, Any], seed: int, semantic: int) -> bpy.types.Material:
    """A material from ``surface`` settings.

    reflectance = albedo x (1 - variation x patches); the fine relief shades as bump, in metres, so
    that the true depth stays that of the mesh. The geometric normal goes to the value pass
    ``NORMAL_AOV``, because Cycles' own Normal pass contains the bump. ``semantic`` is the label
    that the material-index pass carries.
    """
    material = bpy.data.materials.new(name)
    material.pass_index = semantic
    material.displacement_method = "BUMP"
    tree = Tree(compat.ensure_nodes(material))
    patches_at, grain_at = (float(w) for w in generator(seed, "surface").uniform(0.0, 1000.0, 2))
    geometry = tree.node("ShaderNodeNewGeometry", "Geometry")
    where = geometry.outputs["Position"]

    def noise(label: str, wavelength_m: float, fourth: float, detail: float) -> Any:
        return tree.node("ShaderNodeTexNoise", label, {
            "Vector": where, "W": fourth, "Scale": 1.0 / wavelength_m, "Detail": detail, "Roughness": 0.5,
            "Lacunarity": 2.0, "Distortion": 0.0}, noise_dimensions="4D", noise_type="FBM", normalize=True,
        ).outputs[0]

    albedo: Any = surface["albedo"]
    colour: Any = (albedo, albedo, albedo, 1.0)
    if surface["albedo_variation"] > 0.0:
        patches = noise("Patches", surface["albedo_patch_m"], patches_at, 4.0)
        darkening = tree.math("MULTIPLY", "Darkening", patches, surface["albedo_variation"])
        kept = tree.math("SUBTRACT", "Kept", 1.0, darkening)
        reflectance = tree.math("MULTIPLY", "Reflectance", kept, albedo)
        colour = tree.node("ShaderNodeCombineColor", "Grey", {"Red": reflectance, "Green": reflectance,
                                                              "Blue": reflectance}, mode="RGB").outputs[0]
    leave = ["Coat Normal", "Tangent"]
    normal: dict[str, Any] = {}
    if surface["grain_amplitude_m"] > 0.0:
        grain = noise("Grain", surface["grain_size_m"], grain_at, 3.0)
        normal["Normal"] = tree.node(
            "ShaderNodeBump", "Relief",
            {"Strength": 1.0, "Distance": surface["grain_amplitude_m"], "Height": grain},
            if_present={"Filter Width": 0.1}, leave=("Normal",), invert=False).outputs[0]
    else:
        leave.append("Normal")
    radius = surface["subsurface_radius_m"]
    snow = tree.node("ShaderNodeBsdfPrincipled", "Snow", {
        "Base Color": colour, "Metallic": 0.0, "Roughness": surface["roughness"], "IOR": surface["refractive_index"],
        "Alpha": 1.0, **normal,
        "Subsurface Weight": surface["subsurface_weight"] if radius > 0.0 else 0.0,
        "Subsurface Radius": (1.0, 1.0, 1.0), "Subsurface Scale": radius,
        "Subsurface Anisotropy": 0.0,
        "Specular IOR Level": surface["specular"], "Specular Tint": WHITE,
        "Anisotropic": 0.0, "Anisotropic Rotation": 0.0,
        "Transmission Weight": 0.0,
        "Coat Weight": 0.0, "Coat Roughness": 0.0, "Coat IOR": 1.5, "Coat Tint": WHITE,
        "Sheen Weight": 0.0, "Sheen Roughness": 0.5, "Sheen Tint": WHITE,
        "Emission Color": WHITE, "Emission Strength": 0.0,
    }, if_present={"Weight": 0.0, "Diffuse Roughness": 0.0, "Thin Film Thickness": 0.0, "Thin Film IOR": 1.33,
                   "Subsurface IOR": 1.4, "Thin Wall": False},
        leave=leave, distribution="MULTI_GGX", subsurface_method="RANDOM_WALK")
    tree.node("ShaderNodeOutputMaterial", "Surface", {"Surface": snow.outputs[0]},
              leave=("Volume", "Displacement", "Thickness"), target="ALL")
    tree.node("ShaderNodeOutputAOV", "Geometric Normal", {"Color": geometry.outputs["True Normal"], "Value": 0.0},
              aov_name=NORMAL_AOV)
    tree.arrange()
    return material

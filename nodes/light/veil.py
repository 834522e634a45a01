"""Falling grains or vapour in front of the ground: a box of an even medium that scatters and absorbs.

The box is in the scene only while radiance is rendered, so truth, maps and meshes show the ground behind it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ...settings.topics.light import VeilSettings
from ...support.blender import compat
from ..datablocks.fingerprint import NAME, TAG
from ..tree.builder import Tree
from .scene_lights import ROLES

#: Metres of the medium below the lowest mesh, since a material may lower vertices.
_BELOW_M = 1.0
#: Corners of each side of a box, in order as seen from outside. The bits of a corner's number are east, north and up.
_BOX_SIDES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def extinction_1_m(veil: VeilSettings) -> float:
    """Compute the extinction in 1/m: the optical depth per metre of path."""
    return float(veil.optical_depth) / float(veil.top_m)


@contextmanager
def add_veil_temporarily(scene: bpy.types.Scene, veil: VeilSettings, bounces: int) -> Iterator[None]:
    """Give ``scene`` the veil, from below its ground upward, and remove it at the end. Light scatters up to 1 +
    ``bounces`` times in it. A veil without optical depth adds nothing.
    """
    if veil.optical_depth <= 0.0:
        yield
        return
    material = _build_medium(veil)
    item = _build_box(float(veil.width_m) / 2, _find_lowest_m(scene) - _BELOW_M, float(veil.top_m))
    item.data.materials.append(material)
    scene.collection.objects.link(item)
    cycles = scene.cycles
    cycles.volume_bounces, cycles.max_bounces = bounces, max(cycles.max_bounces, bounces)
    try:
        yield
    finally:
        mesh = item.data
        bpy.data.objects.remove(item)
        bpy.data.meshes.remove(mesh)
        bpy.data.materials.remove(material)


def _find_lowest_m(scene: bpy.types.Scene) -> float:
    """Find the height in metres of the lowest corner of a box around a mesh of the site, at most 0."""
    scene.view_layers[0].update()
    lows = [0.0]
    for item in scene.objects:
        if item.type == "MESH" and item.get(TAG) not in ROLES:
            matrix = np.array(item.matrix_world)
            lows.append(float((np.array(item.bound_box) @ matrix[2, :3]).min() + matrix[2, 3]))
    return min(lows)


def _build_box(half_m: float, bottom_m: float, top_m: float) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(f"{NAME} Veil")
    corners = [(half_m * (2 * (k & 1) - 1), half_m * ((k & 2) - 1), top_m if k & 4 else bottom_m) for k in range(8)]
    mesh.from_pydata(np.array(corners).tolist(), [], _BOX_SIDES)
    return bpy.data.objects.new(f"{NAME} Veil", mesh)


def _build_medium(veil: VeilSettings) -> bpy.types.Material:
    """Build a material without a surface. A share of the extinction is scattering, the rest absorption."""
    material = bpy.data.materials.new(f"{NAME} Veil")
    tree = Tree(compat.ensure_nodes(material))
    density, share = extinction_1_m(veil), (*[float(veil.grain_albedo)] * 3, 1.0)
    scattered = tree.node(
        "ShaderNodeVolumeScatter",
        "Scattering",
        {"Color": share, "Density": density, "Anisotropy": float(veil.asymmetry)},
        if_present={"Weight": 0.0, "IOR": 1.33, "Backscatter": 0.1, "Alpha": 0.5, "Diameter": 20.0},
    )
    absorbed = tree.node(
        "ShaderNodeVolumeAbsorption", "Absorption", {"Color": share, "Density": density}, if_present={"Weight": 0.0}
    )
    both = {"Shader": scattered.outputs[0], "Shader_001": absorbed.outputs[0]}
    medium = tree.node("ShaderNodeAddShader", "Medium", both)
    tree.node(
        "ShaderNodeOutputMaterial",
        "Veil",
        {"Surface": None, "Displacement": None, "Volume": medium.outputs[0], "Thickness": None},
        target="ALL",
    )
    tree.arrange()
    return material

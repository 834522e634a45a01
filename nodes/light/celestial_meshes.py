"""Planet, rings, moons and stars in the sky, as far meshes that emit light.

Only the camera sees them: lamps light the ground, and the meshes cast no light and no shadows. A mesh has a depth and a
label where it hides at least half of the light behind it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bmesh
import bpy
import numpy as np

from ...physics.light.moon_mesh import MoonMesh
from ...physics.light.planetshine import Planet, make_disc_mesh
from ...physics.light.saturn_rings import RingMesh
from ...physics.light.stars import Stars
from ...support.arrays import Array
from ...support.blender import compat
from ...support.labels import PLANET
from ..datablocks.array_marks import mark_array
from ..datablocks.marks import hash_marks
from ..datablocks.mesh_arrays import fill_with_polygons
from ..tree.builder import Tree
from .planet_material import build_planet_material, follow_planet

#: Distance of the planet from the camera in metres. The planet follows the camera and is so far away that both eyes see
#: it in the same direction. Its size is in proportion, so it looks as large as the real planet.
DISTANCE_M = 1.0e5
STARS_M = 9.0e5  # behind planet and rings, within the camera's clipping distance
#: Attributes of the vertices: radiance in W/(m² sr), as one number or as R, G and B; and the share of light that
#: passes.
RADIANCE, TRANSMISSION = "radiance", "transmission"
DISC = "icymoon_disc"  # property of the planet: hash of the inputs of its mesh
#: Radius of a star's image in pixels. Cycles' pixel filter is narrower than a pixel, so the pixels of a point would get
#: between 0 and 3.5 times its light. A cone of this radius gives all of its light within 2 % in the middle of the
#: image, and within 5 % near the borders.
STAR_PX = 1.0


def build_planet(
    name: str, planet: Planet, colour: Array, pixel_rad: float, dip_deg: float, former: bpy.types.Object | None = None
) -> bpy.types.Object:
    """Build the part of the planet above a horizon ``dip_deg`` under the horizontal, in true proportion. Its limb is
    soft over a pixel of ``pixel_rad`` radians.

    The mesh is taken from a ``former`` planet of the same disc: only the material depends on the Sun, and cutting the
    mesh takes 0.2 s. Its material is kept too if only values differ.
    """
    shown = make_disc_mesh(planet, pixel_rad)
    disc = hash_marks([dip_deg, *map(mark_array, (shown.vertices, shown.faces, shown.transmission))])
    if former is not None and former.get(DISC) == disc:
        if not follow_planet(former.data.materials[0], planet, colour, DISTANCE_M, TRANSMISSION):
            material = build_planet_material(name, planet, colour, DISTANCE_M, TRANSMISSION)
            former.data.materials[0] = _set_up_far_material(material)
        item = _hold_far_mesh(name, former.data)
    else:
        material = build_planet_material(name, planet, colour, DISTANCE_M, TRANSMISSION)
        attributes = {TRANSMISSION: shown.transmission}
        item = _build_far_mesh(name, DISTANCE_M * shown.vertices, shown.faces, attributes, material, dip_deg)
    item[DISC] = disc
    return item


def build_rings(name: str, rings: RingMesh, colour: Array, dip_deg: float) -> bpy.types.Object:
    """Build the part of the rings above a horizon ``dip_deg`` under the horizontal."""
    attributes = {RADIANCE: rings.radiance, TRANSMISSION: rings.transmission}
    return _build_far_mesh(
        name,
        DISTANCE_M * rings.vertices,
        rings.faces,
        attributes,
        _build_shining_material(name, colour, attributes),
        dip_deg,
    )


def build_moons(name: str, moons: MoonMesh, colour: Array, dip_deg: float) -> bpy.types.Object:
    """Build the part of the moons above a horizon ``dip_deg`` under the horizontal. Their distances have the same scale
    as the planet's distance, so that moon, rings and planet hide each other as in the sky."""
    attributes = {RADIANCE: moons.radiance * colour, TRANSMISSION: moons.transmission}
    material = _build_shining_material(name, colour, attributes)
    return _build_far_mesh(name, DISTANCE_M * moons.vertices, moons.faces, attributes, material, dip_deg)


def build_stars(name: str, stars: Stars, pixel_rad: float) -> bpy.types.Object:
    """Build a transparent hexagon for each star. Its radiance falls linearly from its centre to zero at its rim.

    ``pixel_rad`` is the angle of a pixel in radians. A hexagon of circumradius ρ has the area 3√3/2 ρ², and the mean of
    the radiance is a third of its peak.
    """
    radius = STAR_PX * pixel_rad
    peak = 3 * stars.irradiance_wm2 / (1.5 * np.sqrt(3.0) * radius**2)
    side = np.eye(3)[np.abs(stars.direction).argmin(axis=1)]
    x = np.cross(side, stars.direction)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(stars.direction, x)
    angle = np.arange(6) * np.pi / 3
    around = np.cos(angle)[:, None] * x[:, None] + np.sin(angle)[:, None] * y[:, None]
    rim = stars.direction[:, None] + radius * around
    n = len(stars.direction)
    vertices = np.concatenate([stars.direction[:, None], rim], axis=1).reshape(-1, 3)
    radiance = np.concatenate([peak[:, None], np.zeros((n, 6, 3))], axis=1).reshape(-1, 3)
    corner = np.arange(6)
    triangles = np.stack([0 * corner, 1 + corner, 1 + (corner + 1) % 6], axis=1)
    faces = (7 * np.arange(n)[:, None, None] + triangles).reshape(-1, 3)
    attributes = {RADIANCE: radiance, TRANSMISSION: np.ones(7 * n)}
    return _build_far_mesh(
        name, STARS_M * vertices, faces, attributes, _build_shining_material(name, np.ones(3), attributes), 0.0
    )


def _build_far_mesh(
    name: str,
    vertices: Array,
    faces: Array,
    attributes: Mapping[str, Array],
    material: bpy.types.Material,
    dip_deg: float,
) -> bpy.types.Object:
    """Build an object whose mesh has attributes of its vertices and is cut at the horizon. Only the camera sees it. A
    face of ``faces`` (m, 3 or 4) whose last corner is its first has one corner less."""
    mesh = bpy.data.meshes.new(name)
    kept = np.ones(faces.shape, bool)
    kept[:, -1] = faces[:, -1] != faces[:, 0]
    fill_with_polygons(mesh, vertices, faces[kept], kept.sum(axis=1))
    mesh.shade_flat()
    for key, values in attributes.items():
        kind, field = ("FLOAT", "value") if values.ndim == 1 else ("FLOAT_VECTOR", "vector")
        mesh.attributes.new(key, kind, "POINT").data.foreach_set(field, values.ravel().astype(np.float32))
    mesh.materials.append(_set_up_far_material(material))
    slope = math.tan(math.radians(dip_deg))
    if len(vertices) and (vertices[:, 2] + slope * np.hypot(vertices[:, 0], vertices[:, 1])).min() < 0:
        _cut_below_horizon(mesh, slope)
    return _hold_far_mesh(name, mesh)


def _set_up_far_material(material: bpy.types.Material) -> bpy.types.Material:
    """Set up a material that lights nothing and has the label of a planet, and return it."""
    material.cycles.emission_sampling = "NONE"
    material.pass_index = PLANET
    return material


def _hold_far_mesh(name: str, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """Make an object of the mesh that only the camera sees."""
    item = bpy.data.objects.new(name, mesh)
    compat.hide_from_rays(item, from_camera=False)
    return item


def _cut_below_horizon(mesh: bpy.types.Mesh, slope: float) -> None:
    """Remove the part under the horizon, which the moon would hide; the ground covers only a patch of the moon.

    The horizon is a cone with this slope downward, so the mesh is lifted by the cone's drop, cut level and lowered
    again.
    """
    edited = bmesh.new()
    edited.from_mesh(mesh)
    for vertex in edited.verts:
        vertex.co.z += slope * vertex.co.xy.length
    bmesh.ops.bisect_plane(
        edited,
        geom=[*edited.verts, *edited.edges, *edited.faces],
        plane_co=(0.0, 0.0, 0.0),
        plane_no=(0.0, 0.0, 1.0),
        clear_inner=True,
    )
    for vertex in edited.verts:
        vertex.co.z -= slope * vertex.co.xy.length
    edited.to_mesh(mesh)
    edited.free()


def _build_shining_material(name: str, colour: Array, attributes: Mapping[str, Array]) -> bpy.types.Material:
    """Build a material that emits a colour times an attribute, and is transparent if there is an attribute for that."""
    material = bpy.data.materials.new(name)
    tree = Tree(compat.ensure_nodes(material))
    if attributes[RADIANCE].ndim == 1:
        light: tuple[Any, Any] = (*map(float, colour), 1.0), tree.attribute("Radiance", RADIANCE)
    else:
        light = tree.attribute("Radiance", RADIANCE, "Color"), 1.0
    surface = tree.emission("Shine", *light)
    if TRANSMISSION in attributes:
        behind = tree.transparent("Behind", tree.attribute("Transmission", TRANSMISSION))
        surface = tree.node("ShaderNodeAddShader", "Both", {"Shader": surface, "Shader_001": behind}).outputs[0]
    tree.surface(surface)
    tree.arrange()
    return material

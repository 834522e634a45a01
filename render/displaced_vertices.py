"""The displacement by which Cycles moves the vertices of a mesh, by its material, before it traces.

Cycles moves each vertex along its normal by the height that the material has there. Geometry nodes compute the height
of our own materials, see ``nodes.tree.evaluate_field``. For other materials Cycles bakes positions to texels, which
takes four times as long. Positions are baked twice: on the moved surface, and on the surface at rest, with the same
material as shading only. The position at rest locates a texel within its triangle. The difference of both positions is
the shift there, which is linear within the triangle. So a texel for each corner of a facet determines the shifts of the
corners, to a few units of single precision. (Cycles bakes vertices 1e-4 of the coordinates inside the facets, so texels
are more exact.)

A mesh with instances is moved once, at the place of the first instance, as in Cycles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from mathutils import Matrix

from ..nodes.ground.terrain_mesh import SPACING, build_mesh_from_arrays
from ..nodes.tree.evaluate_field import NoGeometryNodeError, evaluate_field, read_numbers
from ..physics.light import baked_texels
from ..support.arrays import Array
from ..support.blender import compat
from ..support.errors import IcyMoonError
from . import texel_bakes
from .mesh_arrays import (
    read_corner_normals,
    read_corners,
    read_smooth_shading,
    read_triangles,
    read_vertex_normals,
    read_vertices,
)

#: Number of facets whose texels are baked together: about 600 MB.
_BAKED_FACETS = 2_000_000
#: Number of facets whose shifts are solved together: about 300 MB.
_SOLVED_FACETS = 250_000
#: Smallest determinant of the corner weights at texels from which shifts are solved. It is 0.25 for triangles and above
#: 0.1 for quadrilaterals; only facets too narrow for single precision have less.
_MIN_DETERMINANT = 0.05
#: Weight of a narrow facet beside the other facets around a vertex. It is so small that the facet counts only if it is
#: alone.
_NARROW_FACET_WEIGHT = 1e-6
_TEMPORARY_NAME = "Icy Moon Moved"


def is_moved(mesh: bpy.types.Mesh) -> bool:
    """Return whether a material of a mesh displaces its vertices in renders."""
    return any(
        material is not None
        and material.displacement_method != "BUMP"
        and material.node_tree is not None
        and any(
            node.bl_idname == "ShaderNodeOutputMaterial" and node.inputs["Displacement"].is_linked
            for node in material.node_tree.nodes
        )
        for material in mesh.materials
    )


@contextmanager
def open_rendered_mesh(
    mesh: bpy.types.Mesh, place: Array, threads: int = 0, still_m: float = math.inf
) -> Iterator[bpy.types.Mesh]:
    """Open a mesh of triangles like ``mesh``, with its vertices displaced as in Cycles.

    ``place`` (4, 4) is the matrix of the mesh's object, or of its first instance. ``threads`` is as in
    ``quality.threads``. Vertices whose attribute ``SPACING`` is ``still_m`` or more never move. Raises IcyMoonError if
    Cycles cannot bake.
    """
    moved, groups = displace_corners(mesh, place, threads, still_m)
    loops, polygons = read_triangles(mesh)
    flat = ~read_smooth_shading(mesh)[polygons]
    made = build_mesh_from_arrays(_TEMPORARY_NAME, moved, groups[loops].astype(np.int32))
    made.polygons.foreach_set("use_smooth", ~flat)
    try:
        yield made
    finally:
        bpy.data.meshes.remove(made)


def displace_corners(
    mesh: bpy.types.Mesh, place: Array, threads: int = 0, still_m: float = math.inf
) -> tuple[Array, Array]:
    """Displace the corners of a mesh's facets as Cycles does. Return the displaced positions (n, 3) float32, in the
    coordinates of the mesh, and the index of the position for each corner (k,). For the arguments see
    ``open_rendered_mesh``.
    """
    groups, vertex, normals = _group_corners(mesh)
    vertices = read_vertices(mesh)
    if (height := _find_heights(mesh, vertices, place, still_m)) is not None:
        shift = height[vertex, None] * normals
    else:
        shift = _find_shifts(mesh, place, groups, len(vertex), threads) @ np.linalg.inv(place[:3, :3]).T
    return (vertices[vertex] + shift).astype(np.float32), groups


def _find_heights(mesh: bpy.types.Mesh, vertices: Array, place: Array, still_m: float) -> Array | None:
    """Find the displacement heights (n,) in metres of the vertices (n, 3) of a mesh by its material; None if geometry
    nodes cannot compute them."""
    if len(mesh.materials) != 1:
        return None
    displacement = mesh.materials[0].node_tree.get_output_node("CYCLES").inputs["Displacement"].links[0].from_node
    inputs = displacement.inputs
    if (
        displacement.bl_idname != "ShaderNodeDisplacement"
        or displacement.space != "OBJECT"
        or inputs["Normal"].is_linked
        or not inputs["Height"].is_linked
        or any(inputs[name].is_linked for name in ("Midlevel", "Scale"))
    ):
        return None
    spacing = read_numbers(mesh, SPACING) if math.isfinite(still_m) else None
    some = np.flatnonzero(spacing < still_m) if spacing is not None else np.arange(len(vertices))
    try:
        value = evaluate_field(
            inputs["Height"].links[0].from_socket,
            vertices[some].astype(np.float64) @ place[:3, :3].T + place[:3, 3],
            mesh,
            some,
        )
    except NoGeometryNodeError:
        return None
    height = np.zeros(len(vertices))
    height[some] = (value.astype(np.float64) - inputs["Midlevel"].default_value) * inputs["Scale"].default_value
    return height


def _group_corners(mesh: bpy.types.Mesh) -> tuple[Array, Array, Array]:
    """Group the corners that move together. Return the group of each corner, and for each group its vertex and the
    normal (3,) along which it moves.

    A group is usually a vertex. Where edges are sharp or the mesh has custom normals, Cycles makes a vertex for each
    normal, and moves these apart.
    """
    corners = read_corners(mesh)
    sharp = mesh.attributes.get("sharp_edge")
    marks = np.zeros(len(sharp.data) if sharp is not None else 0, bool)
    if sharp is not None:
        sharp.data.foreach_get("value", marks)
    if not marks.any() and not mesh.has_custom_normals:
        along = read_vertex_normals(mesh)
        if compat.moves_along_first_corner():
            along[corners[::-1]] = read_corner_normals(mesh)[::-1]
        return corners, np.arange(len(mesh.vertices)), along
    normals = read_corner_normals(mesh)
    # Adding 0 turns negative zeros into zeros.
    rows = np.column_stack([corners.view(np.float32), normals + np.float32(0)])
    _, first, groups = np.unique(
        rows.view(np.dtype((np.void, rows.itemsize * 4))), return_index=True, return_inverse=True
    )
    return groups.reshape(-1), corners[first], normals[first]


def _find_shifts(mesh: bpy.types.Mesh, place: Array, groups: Array, many: int, threads: int) -> Array:
    """Find the shifts (many, 3), m, in the world, of ``many`` ``groups`` of corners that move together."""
    starts, counts, corners, areas = texel_bakes.read_facets(mesh)
    at_rest = read_vertices(mesh) @ place[:3, :3].T + place[:3, 3]
    diagonals = _find_diagonals(mesh, starts)
    total, weights = np.zeros((many, 3)), np.zeros(many)
    for first in range(0, len(starts), _BAKED_FACETS):
        wanted = np.zeros(len(starts), bool)
        wanted[first : first + _BAKED_FACETS] = True
        try:
            found = baked_texels.lay_out_texels(starts, counts, corners, areas, wanted)
        except ValueError:
            raise IcyMoonError(
                "The ground has facets with more than four corners, whose displacement cannot be "
                "exported; set surface.relief to BUMP."
            ) from None
        still, moved = _bake_positions(mesh, place, found, threads)
        for sides, texels in zip((3, 4), found.texels, strict=True):
            facets = np.flatnonzero((counts == sides) & wanted)
            for some in np.array_split(np.arange(len(facets)), len(facets) // _SOLVED_FACETS + 1):
                own = starts[facets[some], None] + np.arange(sides)
                rest = still[texels[some], :3].astype(np.float64)
                shifts, sure = solve_corner_shifts(
                    at_rest[corners[own]], rest, moved[texels[some], :3] - rest, diagonals[facets[some]]
                )
                weight = np.broadcast_to(np.where(sure, 1.0, _NARROW_FACET_WEIGHT)[:, None], own.shape).ravel()
                weights += np.bincount(groups[own].ravel(), weight, many)
                for axis in range(3):
                    total[:, axis] += np.bincount(groups[own].ravel(), weight * shifts[..., axis].ravel(), many)
    return np.asarray(total / np.where(weights > 0, weights, 1.0)[:, None])


def _find_diagonals(mesh: bpy.types.Mesh, starts: Array) -> Array:
    """Find the facets of four corners that are rendered as triangles 0 1 3 and 1 2 3, instead of 0 1 2 and 0 2 3, as
    bool."""
    loops, facets = read_triangles(mesh)
    first = np.zeros(len(starts), np.int64)
    first[facets[::-1]] = np.arange(len(facets))[::-1]
    return np.asarray((loops[first] - starts[:, None] == 3).any(axis=1))


def solve_corner_shifts(corners: Array, rest: Array, shift: Array, across: Array) -> tuple[Array, Array]:
    """Solve for the shifts (n, k, 3) of the ``corners`` (n, k, 3) of facets with k = 3 or 4 corners. Return them, and
    whether (n,) they are determined.

    They are solved from points on the facets: ``rest`` (n, k, 3) before the movement, and their ``shift`` (n, k, 3).
    ``across`` (n,) tells whether a facet of four corners has its diagonal from the second corner to the last.
    """
    count, sides = corners.shape[:2]
    weights, least = np.zeros((count, sides, sides)), np.full((count, sides), -np.inf)
    for straight, turned in (
        (((0, 1, 2), (0, 1, 2)),) if sides == 3 else (((0, 1, 2), (0, 1, 3)), ((0, 2, 3), (1, 2, 3)))
    ):
        of = np.where(across[:, None], turned, straight)
        own = _barycentric(np.take_along_axis(corners, of[..., None], axis=1), rest)
        new = np.zeros_like(weights)
        np.put_along_axis(new, np.broadcast_to(of[:, None], own.shape), own, axis=2)
        nearer = own.min(axis=2) > least
        least = np.where(nearer, own.min(axis=2), least)
        weights = np.where(nearer[..., None], new, weights)
    sure = np.linalg.det(weights) > _MIN_DETERMINANT
    weights[~sure] = np.eye(sides)
    return np.linalg.solve(weights, shift), sure


def _barycentric(triangles: Array, points: Array) -> Array:
    """Compute the barycentric coordinates (n, k, 3) of points (n, k, 3) near triangles (n, 3, 3); 0 for triangles
    without area."""
    sides = triangles[:, 1:] - triangles[:, :1]
    products = sides @ sides.swapaxes(1, 2)
    along = (points - triangles[:, :1]) @ sides.swapaxes(1, 2)
    area = products[:, 0, 0] * products[:, 1, 1] - products[:, 0, 1] ** 2
    scale = 1.0 / np.where(area > 0, area, np.inf)[:, None]
    second = (products[:, None, 1, 1] * along[..., 0] - products[:, None, 0, 1] * along[..., 1]) * scale
    third = (products[:, None, 0, 0] * along[..., 1] - products[:, None, 0, 1] * along[..., 0]) * scale
    return np.stack([1.0 - second - third, second, third], axis=-1)


def _bake_positions(
    mesh: bpy.types.Mesh, place: Array, found: baked_texels.Texels, threads: int
) -> tuple[Array, Array]:
    """Bake the positions (n, 4) in the world at texels, of a mesh at rest and of the moved mesh."""
    baked = []
    with ExitStack() as undo:
        scene = bpy.data.scenes.new(_TEMPORARY_NAME)
        undo.callback(bpy.data.scenes.remove, scene)
        item = bpy.data.objects.new(_TEMPORARY_NAME, mesh)
        undo.callback(bpy.data.objects.remove, item)
        scene.collection.objects.link(item)
        item.matrix_world = Matrix(place.tolist())
        scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 1
        scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
        scene.render.threads_mode = "FIXED" if threads else "AUTO"
        if threads:
            scene.render.threads = threads
        image = texel_bakes.add_target_image(mesh, found, undo)
        materials = [material for material in mesh.materials if material is not None]
        for material in materials:
            texel_bakes.direct_bake_to_image(material.node_tree, image, undo)
            undo.callback(setattr, material, "displacement_method", material.displacement_method)
        own = [material.displacement_method for material in materials]
        for methods in (["BUMP"] * len(own), own):
            for material, method in zip(materials, methods, strict=True):
                material.displacement_method = method
            if why := texel_bakes.run_bake(scene, item, type="POSITION"):
                raise IcyMoonError(
                    f"Cycles could not bake the positions to which the fine relief moves the ground{why}; set "
                    "surface.relief to BUMP."
                )
            baked.append(texel_bakes.read_texels(image))
    return baked[0], baked[1]

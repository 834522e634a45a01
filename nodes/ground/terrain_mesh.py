"""Procedural ground as a mesh: a uniform grid over the patch, or a graded mesh out to the horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from ...physics.mesh.finer_in_view import is_carried_by_grid, is_relief_geometry
from ...physics.mesh.graded_mesh import GradedGround, grade_ground
from ...physics.mesh.ground_interface import Surface
from ...physics.mesh.preview_ground import PreviewGround, make_preview_ground
from ...physics.rocks.place_rocks import HeightAt
from ...physics.terrain.roughness.roughness import list_stated_statistics
from ...physics.terrain.roughness.statistics import Roughness, measure_roughness, power_spectrum
from ...physics.terrain.terrain import Terrain, law_range_m
from ...settings.topics.ground import TerrainSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.labels import UV_LAYER
from ..datablocks.mesh_arrays import fill_with_polygons

#: Attribute of vertices: distance from their neighbours in metres. Meshes whose vertices carry fine relief have it.
SPACING = "icymoon_spacing"
#: Value of that attribute, in metres, for vertices that fine relief does not move.
_UNMOVED_M = 1.0e6
#: Attribute of vertices: thickness of loose material in metres. Meshes whose truth contains it have it.
LOOSE = "icymoon_loose"
#: Points per side of the grid on which the roughness of a graded ground is measured.
_MEASURED_POINTS_PER_SIDE = 513


def compute_vertex_spacing_m(terrain: TerrainSettings) -> float:
    """Compute the distance between neighbouring vertices of the grid in metres."""
    return terrain.size_m / (terrain.resolution - 1)


def shortest_wavelength_m(terrain: TerrainSettings) -> float:
    """Return the shortest wavelength in metres that the grid can contain: two vertex spacings."""
    return 2 * compute_vertex_spacing_m(terrain)


def choose_mesh_of_ground(ground: Terrain, settings: Settings) -> Terrain | GradedGround:
    """Return procedural ground with the mesh of ``settings``: unchanged for a grid, or graded."""
    return grade_ground(ground, settings) if settings.mesh.kind == "GRADED" else ground


def site_wavelength_m(terrain: TerrainSettings, ground: Surface) -> float:
    """Return the shortest wavelength in metres that the mesh of ``ground`` can contain at the site."""
    return ground.site_wavelength_m if isinstance(ground, GradedGround) else shortest_wavelength_m(terrain)


@dataclass(frozen=True)
class MeshedGround:
    """Procedural ground as numbers: its heights, and the positions (n, 3), faces (m, corners per face) and sharp edges
    (k, 2) of its mesh. ``loose_m`` (n,) are the thicknesses of loose material in metres, if they are asked for. Coarse
    ground has at most ``most_rocks`` rocks, namely the rocks that look largest from the site.
    """

    surface: Terrain | GradedGround
    positions: Array
    faces: Array
    sharp: Array
    spacing_m: Array | None = None
    fine: Array | None = None
    most_rocks: int | None = None
    loose_m: Array | None = None

    def before(self, height_at: HeightAt) -> HeightAt:
        """Make a function that returns the heights of the untouched ground, from ``height_at`` of the mesh."""
        return height_at

    def without_skirts(self, height_at: HeightAt, terrain: TerrainSettings) -> HeightAt:
        """Make a function that returns the heights of the ground without skirts, on which rocks lie, from ``height_at``
        of the mesh."""
        if self.surface.skirts is None:
            return height_at
        return lambda x_m, y_m: height_at(x_m, y_m) - self.compute_skirts(x_m, y_m, terrain)

    def compute_skirts(self, x_m: Array, y_m: Array, terrain: TerrainSettings) -> Array:
        """Compute the heights in metres of the skirts above the ground at places (n, …), with the detail of the
        mesh."""
        if isinstance(self.surface, GradedGround):
            return self.surface.compute_skirts(x_m, y_m)
        assert self.surface.skirts is not None
        return self.surface.skirts.heights(x_m, y_m, shortest_wavelength_m(terrain))

    def find_coarse_heights(self, terrain: TerrainSettings) -> HeightAt:
        """Make a function that returns the heights of the ground, without reading the mesh, with the detail that the
        mesh carries at each place. The triangles of coarse ground depart from these heights by as much as they depart
        from the ground.
        """
        surface, shortest_m = self.surface, shortest_wavelength_m(terrain)
        if isinstance(surface, PreviewGround):
            return surface.compute_mesh_heights
        return lambda x_m, y_m: surface.heights(x_m, y_m, shortest_m)

    def build_mesh(self, name: str) -> bpy.types.Mesh:
        """Build the smooth-shaded mesh. Where the mesh is as fine as the image, because of fine relief, the shading is
        flat, so that image and depth show the same shape.

        A mesh that the material displaces has no sharp edges. With them, Cycles makes a vertex for each normal at an
        edge and moves these vertices apart, also at all flat faces, so that the ground has holes. The faces beside such
        edges are flat instead.
        """
        flat = self.fine
        if flat is not None and self.spacing_m is not None and len(self.sharp):
            flat = flat | _find_edge_triangles(self.faces, self.sharp)
        mesh = build_mesh_from_arrays(name, self.positions, self.faces, self.sharp if flat is self.fine else None)
        if self.spacing_m is not None:
            _mark_spacing(mesh, self.spacing_m)
        if flat is not None:
            shade_flat(mesh, flat)
        if self.loose_m is not None:
            mesh.attributes.new(LOOSE, "FLOAT", "POINT").data.foreach_set("value", self.loose_m.astype(np.float32))
        return mesh

    def show_in_mesh(self, mesh: bpy.types.Mesh) -> None:
        """Replace the geometry of a built mesh by coarse ground. The material of the mesh may move its vertices."""
        moved = SPACING in mesh.attributes
        fill_mesh(mesh, self.positions, self.faces)
        if moved:
            _mark_spacing(mesh, np.full(len(self.positions), np.inf) if self.spacing_m is None else self.spacing_m)
        if self.fine is not None:
            shade_flat(mesh, self.fine)


def mesh_ground(ground: Terrain, settings: Settings) -> MeshedGround:
    """Make procedural ground with its mesh, without Blender, so any thread may call this.

    Raises ValueError if a height is not finite.
    """
    surface = choose_mesh_of_ground(ground, settings)
    if not isinstance(surface, GradedGround):
        step = compute_vertex_spacing_m(settings.terrain)
        positions, faces = make_grid(settings.terrain, surface)
        spacing = np.full(len(positions), step) if is_carried_by_grid(settings) else None
        loose = _measure_loose_on_grid(settings.terrain, surface) if settings.quality.loose_thickness else None
        return MeshedGround(surface, positions, faces, np.empty((0, 2), np.int64), spacing, loose_m=loose)
    return _mesh_graded(surface)


def mesh_coarsely(ground: Terrain, settings: Settings, most: int, most_rocks: int) -> MeshedGround:
    """Make procedural ground with a mesh of about ``most`` vertices for a preview, most of them where the cameras look.

    Raises ValueError if a height is not finite.
    """
    if settings.mesh.kind == "GRID" and settings.terrain.resolution**2 <= most:
        return replace(mesh_ground(ground, settings), most_rocks=most_rocks)
    made = _mesh_graded(make_preview_ground(ground, settings, most))
    relief = is_relief_geometry(settings)
    return replace(made, spacing_m=made.spacing_m if relief else None, most_rocks=most_rocks)


def _mesh_graded(surface: GradedGround) -> MeshedGround:
    made = surface.mesh_with_relief()
    _check_finite(made.positions[:, 2])
    return MeshedGround(
        surface, made.positions, made.faces, made.sharp, made.spacing_m, made.fine, loose_m=made.loose_m
    )


def build_mesh(name: str, terrain: TerrainSettings, ground: Surface) -> bpy.types.Mesh:
    """Build a smooth-shaded grid of ``ground``."""
    return build_mesh_from_arrays(name, *make_grid(terrain, ground))


def make_grid(terrain: TerrainSettings, ground: Surface) -> tuple[Array, Array]:
    """Make the positions (n², 3) and faces ((n - 1)², 4) of the grid of ``terrain`` settings, rows from south to north.

    Raises ValueError if a height is not finite.
    """
    n, axis = int(terrain.resolution), _make_grid_axis(terrain)
    heights = ground.heights(axis[None, :], axis[:, None], shortest_wavelength_m(terrain))
    _check_finite(heights)
    positions = np.empty((n, n, 3), np.float32)
    positions[..., 0], positions[..., 1], positions[..., 2] = axis[None, :], axis[:, None], heights
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)[None, :]).ravel()
    faces = np.stack([corner, corner + 1, corner + n + 1, corner + n], axis=1).astype(np.int32)
    return positions.reshape(-1, 3), faces


def _make_grid_axis(terrain: TerrainSettings) -> Array:
    return np.linspace(-terrain.size_m / 2, terrain.size_m / 2, int(terrain.resolution))


def _measure_loose_on_grid(terrain: TerrainSettings, ground: Terrain) -> Array:
    """Return the thicknesses (n²,) in metres of loose material at the vertices of ``make_grid``."""
    axis = _make_grid_axis(terrain)
    return ground.measure_loose(axis[None, :], axis[:, None], shortest_wavelength_m(terrain)).ravel()


def _check_finite(heights: Array) -> None:
    if not np.isfinite(heights).all():
        raise ValueError("terrain heights are not finite")


def _mark_spacing(mesh: bpy.types.Mesh, spacing_m: Array) -> None:
    attribute = mesh.attributes.get(SPACING) or mesh.attributes.new(SPACING, "FLOAT", "POINT")
    attribute.data.foreach_set("value", np.minimum(spacing_m, _UNMOVED_M).astype(np.float32))


def shade_flat(mesh: bpy.types.Mesh, flat: Array) -> None:
    """Shade flat the faces of a smooth mesh that ``flat`` (m,) marks."""
    # polygons.foreach_set("use_smooth") does the same, but takes 30 ms for 175 000 faces.
    attribute = mesh.attributes.get("sharp_face") or mesh.attributes.new("sharp_face", "BOOLEAN", "FACE")
    attribute.data.foreach_set("value", np.ascontiguousarray(flat, np.bool_))


def mark_relief_as_bump(mesh: bpy.types.Mesh) -> None:
    """Mark a mesh so that fine relief is bump everywhere."""
    _mark_spacing(mesh, np.full(len(mesh.vertices), np.inf))


def read_grid_heights(mesh: bpy.types.Mesh, terrain: TerrainSettings) -> Array | None:
    """Read the heights (n, n) in metres of a mesh that ``build_mesh`` made as a grid; None if the mesh has lost that
    shape."""
    n = int(terrain.resolution)
    if len(mesh.vertices) != n * n:
        return None
    positions = np.empty(3 * n * n, np.float32)
    mesh.attributes["position"].data.foreach_get("vector", positions)
    return positions[2::3].reshape(n, n).astype(np.float64)


def sample_patch(ground: Surface) -> Array:
    """Sample the heights (n, n) in metres of a ground over its patch, with the wavelengths that this grid can
    contain."""
    axis = np.linspace(-ground.size_m / 2, ground.size_m / 2, _MEASURED_POINTS_PER_SIDE)
    return ground.heights(axis[None, :], axis[:, None], 2 * (axis[1] - axis[0]))


def measure_patch_roughness(heights: Array | None, terrain: TerrainSettings) -> Roughness | None:
    """Measure the roughness of the patch over the distances that both its grid and ``terrain`` settings include."""
    if heights is None or min(heights.shape) < 3:
        return None
    spacing = terrain.size_m / (len(heights) - 1)
    shortest, longest = law_range_m(terrain)
    # The grid cuts off wavelengths below two spacings. This affects distances up to three times as long.
    return measure_roughness(heights, spacing, terrain.slope_baseline_m, (max(shortest, 6 * spacing), longest))


def describe_patch_statistics(heights: Array | None, terrain: TerrainSettings) -> dict[str, Any]:
    """Describe the statistics of the patch: ``baseline_m``, the values that ``terrain`` settings ask for, and the
    measured values. Empty if there is no grid to measure."""
    found = measure_patch_roughness(heights, terrain)
    if found is None:
        return {}
    return {"baseline_m": found.baseline_m, "asked": list_stated_statistics(terrain), "made": found.numbers()}


def make_roughness_table(heights: Array | None, terrain: TerrainSettings) -> list[tuple[str, ...]]:
    """Make rows of text with distance, measured and set RMS deviation, their ratio, and power spectral density.

    The density is given at the wave number 1/distance. The table is empty if there is no grid to measure.
    """
    found = measure_patch_roughness(heights, terrain)
    if found is None or heights is None:
        return []
    shortest, longest = law_range_m(terrain)
    waves, density = power_spectrum(heights, terrain.size_m / (len(heights) - 1))
    rows: list[tuple[str, ...]] = [("Distance", "RMS deviation", "Setting", "Ratio", "PSD")]
    at_baseline = math.tan(math.radians(terrain.rms_slope_deg)) * terrain.slope_baseline_m
    for distance, deviation in list(zip(found.lag_m, found.deviation_m, strict=True))[::2]:
        asked = at_baseline * (distance / terrain.slope_baseline_m) ** terrain.hurst
        inside = shortest <= distance <= longest and asked > 0
        there = waves.min() <= 1 / distance <= waves.max() and density.min() > 0
        psd = np.exp(np.interp(-np.log(distance), np.log(waves), np.log(density))) if there else 0.0
        rows.append(
            (
                f"{distance:.3g} m",
                f"{deviation * 1e3:.3g} mm",
                f"{asked * 1e3:.3g} mm" if inside else "",
                f"{deviation / asked:.2f}" if inside else "",
                f"{psd:.2e} m4" if there else "",
            )
        )
    if not math.isnan(found.hurst):
        rows.append(
            ("Hurst exponent", f"{found.hurst:.2f}", f"{terrain.hurst:.2f}", f"{found.hurst / terrain.hurst:.2f}", "")
        )
    return rows


def build_mesh_from_arrays(
    name: str, positions: Array, faces: Array, sharp: Array | None = None, uv: Array | None = None
) -> bpy.types.Mesh:
    """Build a mesh from float32 positions (n, 3) and int32 faces (m, corners per face). It is smooth-shaded except
    along ``sharp`` edges (k, 2). ``uv`` (m, corners per face, 2) are the UV coordinates of its corners, if there are
    any.
    """
    mesh = bpy.data.meshes.new(name)
    fill_mesh(mesh, positions, faces)
    if sharp is not None and len(sharp):
        _mark_sharp(mesh, sharp)
    if uv is not None:
        layer = mesh.attributes.new(UV_LAYER, "FLOAT2", "CORNER")
        layer.data.foreach_set("vector", np.ascontiguousarray(uv, np.float32).ravel())
    return mesh


def _find_edge_triangles(faces: Array, edges: Array) -> Array:
    """Find the triangles (m, 3) that have one of the edges (k, 2), as bool (m,). Edges go from the lower to the higher
    vertex."""
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    many = int(faces.max()) + 1
    touches = np.isin(sides[:, 0] * many + sides[:, 1], edges[:, 0] * many + edges[:, 1])
    return np.asarray(touches.reshape(-1, 3).any(axis=1))


def _mark_sharp(mesh: bpy.types.Mesh, edges: Array) -> None:
    """Make edges (k, 2) sharp: their faces share no normal. Each edge goes from the lower to the higher vertex."""
    ends = np.empty(2 * len(mesh.edges), np.int32)
    mesh.attributes[".edge_verts"].data.foreach_get("value", ends)
    low, high = np.sort(ends.reshape(-1, 2).astype(np.int64), axis=1).T
    many = len(mesh.vertices)
    mark = mesh.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    mark.data.foreach_set("value", np.isin(low * many + high, edges[:, 0] * many + edges[:, 1]))


def fill_mesh(mesh: bpy.types.Mesh, positions: Array, faces: Array) -> None:
    """Replace the geometry of a mesh, see ``build_mesh_from_arrays``. If only positions differ, faces are kept."""
    if (len(mesh.vertices), len(mesh.polygons)) == (len(positions), len(faces)) and has_faces(mesh, faces):
        mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(positions, np.float32).ravel())
        mesh.update()
        return
    mesh.clear_geometry()
    fill_with_polygons(mesh, positions, faces.ravel(), np.full(len(faces), faces.shape[1]))
    mesh.shade_smooth()


def has_faces(mesh: bpy.types.Mesh, faces: Array) -> bool:
    """Return whether a mesh has these faces (m, corners per face)."""
    if len(mesh.loops) != faces.size:
        return False
    corners = np.empty(faces.size, np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", corners)
    return bool(np.array_equal(corners, faces.ravel()))

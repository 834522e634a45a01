"""Counts the triangles that the ground of some settings will have, before the build. Imports no Blender."""

from __future__ import annotations

from ...formats import mesh_file
from ...formats.map_surroundings import plan_from_files
from ...physics.mesh.vertex_spacing import choose_vertex_spacing
from ...physics.terrain.terrain import make_terrain
from ...settings.topics.scene import Settings
from ...settings.topics.stand_ins import find_mesh_item
from ...settings.user_files import find_used_files, has_surroundings


def count_triangles(settings: Settings) -> float:
    """Count the triangles of the ground of complete settings; an estimate for ground from a file.

    Raises IcyMoonError if the user's file cannot be read.
    """
    if settings.source.kind == "STAND_IN":
        return float(find_mesh_item(settings.source.stand_in).triangles)
    if settings.source.kind == "MESH":
        return float(mesh_file.estimate_cost(find_used_files(settings)["source.file"]).triangles)
    if settings.source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED":
        return 2.0 * choose_vertex_spacing(make_terrain(settings, int(settings.dataset.seed)), settings).rings.vertices
    if has_surroundings(settings):
        return float(sum(level.triangles for level in plan_from_files(settings, find_used_files(settings))))
    return 2.0 * (settings.terrain.resolution - 1) ** 2

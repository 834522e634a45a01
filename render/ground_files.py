"""What is written of the ground of a scene: maps as GeoTIFF, meshes as PLY, OBJ and USD, and the frame of both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import system
from ..errors import IcyMoonError
from ..files import write_atomically
from ..formats.ply import write_triangles
from ..formats.tiff_write import Place, encode_tiff
from ..typed_settings import Settings
from .cycles_errors import first_line
from .ground_maps import GroundMap

#: Positions and normals (n, 3) and triangles (m, 3) of a mesh.
Triangles = tuple[np.ndarray, np.ndarray, np.ndarray]
#: Files of a map, and what their values are.
MAPS = {"dem.tif": "height of the ground, m", "dsm.tif": "height of ground and rocks, m",
        "albedo.tif": "albedo in even light: R 620 nm, G 550 nm, B 460 nm"}
_AXES = "x east, y north, z up, metres, right-handed"


def describe_frame(settings: Settings) -> str:
    """The site's frame in a sentence."""
    light = settings.light
    return (f"Icy Moon site, local frame on {str(light.body).title()} at latitude {light.latitude_deg:g}: {_AXES}, "
            "origin at the origin of the site")


def frame_facts(settings: Settings) -> dict[str, Any]:
    """The site's frame, for a file beside those of the ground."""
    return {"frame": describe_frame(settings), "axes": _AXES, "unit": "m",
            "height_zero": "the plane z = 0 of the ground's settings or file, not a datum of the body"}


def write_map(made: GroundMap, settings: Settings, folder: Path) -> dict[str, Any]:
    """Write the files of ``MAPS``, float32 GeoTIFF with NaN where there is no ground; facts about them."""
    extent = made.extent
    for (name, text), values in zip(MAPS.items(), (made.ground_m, made.surface_m, made.albedo), strict=True):
        place = Place(extent.cell_m, extent.west_m, extent.north_m, describe_frame(settings), values.ndim == 2)
        _write(folder / name, encode_tiff(np.ascontiguousarray(values, np.float32), place, text))
    return {"files": MAPS, "cell_m": extent.cell_m, "rows": extent.rows, "columns": extent.columns,
            "west_m": extent.west_m, "north_m": extent.north_m, "nodata": "NaN",
            "cells": "a value is that at the centre of its cell; the first row is the northernmost"}


def _write(path: Path, data: bytes) -> None:
    def fill(part: Path) -> None:
        part.write_bytes(data)

    write_atomically(path, fill)


def write_meshes(kinds: dict[str, Triangles], suffix: str, settings: Settings, folder: Path) -> list[str]:
    """Write meshes by kind, such as terrain and rock: a PLY file each, or one OBJ or USD file of all; their names.

    Raises IcyMoonError if this Blender has no exporter for it, or it fails.
    """
    if suffix == "ply":
        for kind, (vertices, normals, triangles) in kinds.items():
            write_triangles(folder / f"{kind}.ply", vertices, triangles, normals, (describe_frame(settings),))
        return [f"{kind}.ply" for kind in kinds]
    name = f"ground.{suffix}"
    write_atomically(folder / name, lambda part: _export(kinds, suffix, part))
    return [name]


def _export(kinds: dict[str, Triangles], suffix: str, path: Path) -> None:
    """Let Blender write meshes in a scene of their own."""
    scene = bpy.data.scenes.new("Icy Moon Ground")
    made = []
    # Blender completes a name that has another suffix.
    whole = path.with_name(f"{path.name}.{suffix}")
    try:
        for kind, (vertices, normals, triangles) in kinds.items():
            mesh = bpy.data.meshes.new(kind)
            made.append(bpy.data.objects.new(kind, mesh))
            mesh.vertices.add(len(vertices))
            mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices, np.float32).ravel())
            mesh.loops.add(3 * len(triangles))
            mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(triangles, np.int32).ravel())
            mesh.polygons.add(len(triangles))
            mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(triangles), 3, dtype=np.int32))
            mesh.update(calc_edges=True)
            mesh.normals_split_custom_set_from_vertices(normals.tolist())
            scene.collection.objects.link(made[-1])
        with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
            if suffix == "obj":
                bpy.ops.wm.obj_export(filepath=str(whole), forward_axis="Y", up_axis="Z", export_materials=False,
                                      export_triangulated_mesh=False, export_uv=False)
            else:
                bpy.ops.wm.usd_export(filepath=str(whole), export_materials=False, export_uvmaps=False,
                                      export_lights=False, export_cameras=False)
        system.replace(whole, path)
    except (RuntimeError, AttributeError, OSError) as error:
        raise IcyMoonError(f"Blender could not write the mesh as {suffix} ({first_line(error)}); take ply.") from None
    finally:
        for item in made:
            mesh = item.data
            bpy.data.objects.remove(item)
            bpy.data.meshes.remove(mesh)
        bpy.data.scenes.remove(scene)

"""Writes the ground of a scene: maps as GeoTIFF, meshes as PLY, OBJ, USD or glTF, and the description of their
frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.geotiff import describe_map_notes, describe_map_place
from ..formats.placed_meshes import PlacedMesh, group_by_kind, write_gltf, write_obj, write_ply, write_usd
from ..formats.tiff_write import Place, encode_tiff
from ..physics.light.sky_over_map import find_sky_place
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.files import write_atomically
from .ground_maps import GroundMap

#: Most triangles in formats without instances. Readers such as trimesh, with 64-bit numbers, take about 100 bytes for
#: each, so this is 5 GB of memory.
MAX_TRIANGLES = 50_000_000
#: Formats without instances: bytes of a vertex with its normal, and of a triangle.
_BYTES_WITHOUT_INSTANCES = {"ply": (24, 13), "obj": (75, 50)}
#: Files of a map, with the meaning of their values.
MAPS = {
    "dem.tif": "height of the ground, m",
    "dsm.tif": "height of ground and rocks, m",
    "albedo.tif": "albedo in even light: R 620 nm, G 550 nm, B 460 nm",
}
_AXES_TEXT = "x east, y north, z up, metres, right-handed"


def describe_frame(settings: Settings, ground: Mapping[str, Any] | None = None) -> str:
    """Describe the site's frame in a sentence; ``ground`` is the ground's report, with its map position."""
    light = settings.light
    place = find_sky_place(settings, (ground or {}).get("map"))
    latitude = place.latitude_deg if place else light.latitude_deg
    return (
        f"Icy Moon site, local frame on {str(light.body).title()} at latitude {latitude:g}: {_AXES_TEXT}, "
        "origin at the origin of the site"
    )


def make_frame_facts(settings: Settings, ground: Mapping[str, Any]) -> dict[str, Any]:
    """Make the facts on the site's frame, for a file beside the ground's files. ``ground`` is the report of the ground,
    with its place on a map."""
    place = describe_map_place(ground)
    zero = (
        f"the height {place['height_zero_m']!r} m of the ground's file"
        if place
        else "the plane z = 0 of the ground's settings, not a datum of the body"
    )
    return {
        "frame": describe_frame(settings, ground),
        "axes": _AXES_TEXT,
        "unit": "m",
        "height_zero": zero,
        **({"map": place} if place else {}),
    }


def write_map(made: GroundMap, settings: Settings, ground: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Write the files of ``MAPS`` as float32 GeoTIFF, with NaN beyond the ground, and return facts on them.

    The TIFF tag ``map`` is the map position from ``ground``, as JSON.
    """
    extent, notes = made.extent, describe_map_notes(ground)
    for (name, text), values in zip(MAPS.items(), (made.ground_m, made.surface_m, made.albedo), strict=True):
        place = Place(
            extent.cell_m, extent.west_m, extent.north_m, describe_frame(settings, ground), values.ndim == 2, notes
        )
        _write_bytes(folder / name, encode_tiff(np.ascontiguousarray(values, np.float32), place, text))
    return {
        "files": MAPS,
        "cell_m": extent.cell_m,
        "rows": extent.rows,
        "columns": extent.columns,
        "west_m": extent.west_m,
        "north_m": extent.north_m,
        "nodata": "NaN",
        "cells": "each value is at the centre of its cell; the first row is the northernmost",
    }


def _write_bytes(path: Path, data: bytes) -> None:
    def write_part(part: Path) -> None:
        part.write_bytes(data)

    write_atomically(path, write_part)


def write_meshes(meshes: Sequence[PlacedMesh], suffix: str, settings: Settings, folder: Path) -> list[str]:
    """Write meshes, and return the names of the files: one PLY file for each kind, such as terrain and rock, or one
    OBJ, USD or glTF file for all.
    """
    frame = describe_frame(settings)
    if suffix == "ply":
        kinds = group_by_kind(meshes)
        for kind, own in kinds.items():
            write_ply(folder / f"{kind}.ply", own, frame)
        return [f"{kind}.ply" for kind in kinds]
    write, name = {
        "obj": (write_obj, "ground.obj"),
        "usd": (write_usd, "ground.usd"),
        "gltf": (write_gltf, "ground.glb"),
    }[suffix]
    write(folder / name, meshes, frame)
    return [name]


def refuse_too_many_triangles(counts: Sequence[tuple[int, int, int]], suffix: str) -> None:
    """Raise IcyMoonError if a file without instances would have too many triangles.

    ``counts`` are the numbers of places, vertices and triangles of each mesh.
    """
    if suffix not in _BYTES_WITHOUT_INSTANCES:
        return
    places, vertices, triangles = (
        sum(column)
        for column in zip(*((place, place * own, place * those) for place, own, those in counts), strict=True)
    )
    if triangles <= MAX_TRIANGLES:
        return
    of_vertex, of_triangle = _BYTES_WITHOUT_INSTANCES[suffix]
    size = (vertices * of_vertex + triangles * of_triangle) / 1e9
    raise IcyMoonError(
        f"The {places} meshes of the ground have {triangles / 1e6:.0f} million triangles. As {suffix} they take "
        f"about {size:.1f} GB, and several times as much memory when read; export usd or gltf, where rocks of one "
        "shape share their triangles, or lower rocks.coverage."
    )

"""Files of the ground of a scene: maps as GeoTIFF; meshes as PLY, OBJ, USD and glTF; the frame of both."""

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

#: Most triangles in files that have no instances. Readers take about 100 bytes for each, as trimesh does with its
#: 64-bit numbers, so these are 5 GB in memory.
MOST_TRIANGLES = 50_000_000
#: Formats that have no instances, and their bytes for a vertex with its normal and for a triangle.
_WITHOUT_INSTANCES = {"ply": (24, 13), "obj": (75, 50)}
#: Files of a map, and what their values are.
MAPS = {
    "dem.tif": "height of the ground, m",
    "dsm.tif": "height of ground and rocks, m",
    "albedo.tif": "albedo in even light: R 620 nm, G 550 nm, B 460 nm",
}
_AXES = "x east, y north, z up, metres, right-handed"


def describe_frame(settings: Settings, ground: Mapping[str, Any] | None = None) -> str:
    """The site's frame in a sentence; ``ground`` is its report, with its place on a map."""
    light = settings.light
    place = find_sky_place(settings, (ground or {}).get("map"))
    latitude = place.latitude_deg if place else light.latitude_deg
    return (
        f"Icy Moon site, local frame on {str(light.body).title()} at latitude {latitude:g}: {_AXES}, "
        "origin at the origin of the site"
    )


def make_frame_facts(settings: Settings, ground: Mapping[str, Any]) -> dict[str, Any]:
    """The site's frame, for a file beside the ground's files; ``ground`` is its report, with its place on a map."""
    place = describe_map_place(ground)
    zero = (
        f"the height {place['height_zero_m']!r} m of the ground's file"
        if place
        else "the plane z = 0 of the ground's settings, not a datum of the body"
    )
    return {
        "frame": describe_frame(settings, ground),
        "axes": _AXES,
        "unit": "m",
        "height_zero": zero,
        **({"map": place} if place else {}),
    }


def write_map(made: GroundMap, settings: Settings, ground: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Write the files of ``MAPS``, float32 GeoTIFF with NaN where there is no ground; facts about them.

    Their metadata ``map`` is the place that ``ground`` states, as JSON.
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
        "cells": "a value is that at the centre of its cell; the first row is the northernmost",
    }


def _write_bytes(path: Path, data: bytes) -> None:
    def fill(part: Path) -> None:
        part.write_bytes(data)

    write_atomically(path, fill)


def write_meshes(meshes: Sequence[PlacedMesh], suffix: str, settings: Settings, folder: Path) -> list[str]:
    """Write meshes: a PLY file of each kind, such as terrain and rock, or one OBJ, USD or glTF file of all; the names
    of the files."""
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


def refuse_too_many(counts: Sequence[tuple[int, int, int]], suffix: str) -> None:
    """Raise IcyMoonError if a file without instances would have too many triangles; ``counts`` are places, vertices
    and triangles of each mesh."""
    if suffix not in _WITHOUT_INSTANCES:
        return
    places, vertices, triangles = (
        sum(column)
        for column in zip(*((place, place * own, place * those) for place, own, those in counts), strict=True)
    )
    if triangles <= MOST_TRIANGLES:
        return
    of_vertex, of_triangle = _WITHOUT_INSTANCES[suffix]
    size = (vertices * of_vertex + triangles * of_triangle) / 1e9
    raise IcyMoonError(
        f"The {places} meshes of the ground have {triangles / 1e6:.0f} million triangles, about "
        f"{size:.1f} GB as {suffix} and several times that in the memory of what reads it; export usd "
        "or gltf, where rocks of one shape share their triangles, or lower rocks.coverage."
    )

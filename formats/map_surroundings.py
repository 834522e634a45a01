"""Ground beyond the patch of a height map: its levels, and whether its map can carry them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..physics.mesh.nested_rings import Level, count_cells, plan_levels
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import gdal_lines
from .map_forward import project_point
from .map_frame import MapFrame, map_frame_from_json
from .map_heights import MapCover, read_cover
from .map_projection import MapSystem
from .map_site import read_site_place

#: Largest distance of ground from the site, over the radius of the body.
_MAX_REACH = 0.9
#: Ratio of the map's displacement of ground to the distance from the site, above which a warning is given.
_BENT_SHARE = 0.02
#: Number of directions in which a map's displacement is measured.
_DIRECTIONS = 16
#: Assumed width in metres of a map of unknown extent.
_ENDLESS_M = 1e9


def plan_surroundings(settings: Settings, covers: Sequence[MapCover]) -> list[Level]:
    """Plan the levels of the ground of settings, from the extents of their maps: the fine map, then the coarser one, if
    any."""
    terrain, fine, coarse = settings.terrain, covers[0], covers[-1]

    def pixel_at(distance_m: float) -> float:
        return fine.pixel_m if distance_m < fine.farthest_m else coarse.pixel_m

    size_m = float(terrain.size_m)
    reach_m = max(float(settings.source.surroundings_m), size_m / 2)
    return plan_levels(count_cells(int(terrain.resolution)), size_m, reach_m, pixel_at)


def plan_from_files(settings: Settings, files: Mapping[str, Path]) -> list[Level]:
    """Do ``plan_surroundings`` with the tags of the files that the settings name. A map whose pixel size is unknown
    before its import is taken to have pixels as large as the patch's cells. Raises IcyMoonError if a file cannot be
    read."""
    path, coarse = files["source.file"], files.get("source.surroundings_file")
    terrain, source = settings.terrain, settings.source
    stated_m = float(source.metres_per_pixel) or float(terrain.size_m) / max(int(terrain.resolution) - 1, 1)
    frame = find_map_frame(path, settings)
    covers = [read_cover(path, frame) if frame else MapCover(stated_m, _ENDLESS_M, _ENDLESS_M)]
    if coarse is not None and frame is not None:
        covers.append(read_cover(coarse, frame))
    return plan_surroundings(settings, covers)


def find_map_frame(path: Path, settings: Settings) -> MapFrame | None:
    """Find the frame of the settings' site on a file's map, with heights above the file's zero; None without a
    coordinate system. Raises IcyMoonError for a file that cannot be read, and for a site that is not on its map."""
    if settings.source.metres_per_pixel > 0 or path.suffix.lower() not in (".tif", ".tiff"):
        return None
    place = read_site_place(path, settings)
    return map_frame_from_json({"map": place.to_json() | {"height_zero_m": 0.0}}) if place else None


def find_body_radius_m(settings: Settings, frame: MapFrame | None) -> float:
    """Find the radius, m, of the body under a map: from its coordinate system, else from the settings."""
    if frame is None or frame.system is None:
        return float(settings.terrain.body_radius_m)
    return frame.system.radius_m


def check_reach(settings: Settings, frame: MapFrame | None, name: str) -> list[str]:
    """Return warnings about ground so far from the site that the map's projection displaces it; ``name`` is the file's.

    Raises IcyMoonError for ground beyond the visible side of the body, and for a map that ends before it.
    """
    reach_m, radius_m = float(settings.source.surroundings_m), find_body_radius_m(settings, frame)
    if reach_m * math.sqrt(2.0) > _MAX_REACH * radius_m:
        raise IcyMoonError(
            f"source.surroundings_m = {reach_m:g} m is beyond the visible side of a body with a radius of "
            f"{radius_m / 1000:.6g} km; set it to {math.floor(_MAX_REACH * radius_m / math.sqrt(2.0) / 100) * 100} or "
            "less."
        )
    if frame is None or frame.system is None:
        return []
    share = measure_displacement(frame, frame.system, reach_m)
    if share <= _BENT_SHARE:
        return []
    longitude, latitude = frame.system.to_sphere(*frame.origin)
    target = f"+proj=ortho +lat_0={latitude:.9f} +lon_0={longitude:.9f} +R={radius_m:.1f} +units=m +no_defs"
    command = gdal_lines.make_warp_command(name, _make_target_option(target))
    fix = f"project it about the site in its folder with: {command}"
    if not math.isfinite(share):
        raise IcyMoonError(
            f"{name}: has a map that ends before source.surroundings_m = {reach_m:g} m; lower it, or {fix}"
        )
    return [
        f"{name}: its map displaces ground at {reach_m:g} m from the site by up to {share:.0%} of that distance, and "
        f"ground there is where the map has it; {fix}"
    ]


def _make_target_option(target: str) -> str:
    """Make the option of ``gdalwarp`` that names the coordinate system of the result."""
    return f'-t_srs "{target}"'


def measure_displacement(frame: MapFrame, system: MapSystem, distance_m: float) -> float:
    """Measure the largest horizontal displacement of ground from its position on the site's tangent plane, as a share
    of its distance. Infinite outside the map."""
    longitude, latitude = system.to_sphere(*frame.origin)
    seen = replace(MapSystem("Orthographic", "", system.radius_m), longitude_deg=longitude, latitude_deg=latitude)

    def place(x_m: float, y_m: float) -> complex:
        at = system.to_sphere(frame.origin[0] + x_m / frame.scale[0], frame.origin[1] + y_m / frame.scale[1])
        return complex(*project_point(seen, *at))

    try:
        ahead = place(0.0, 1.0)
        turn = ahead / abs(ahead) / 1j  # from the map's up to north
        directions = np.exp(2j * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS) * distance_m
        apart = [abs(place(at.real, at.imag) / turn - at) for at in directions.tolist()]
    except (ValueError, OverflowError, ZeroDivisionError):
        return math.inf
    return max(apart) / distance_m

"""The user's own ground: a mesh or height map from a file, placed at the origin of the settings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...formats import gdal_lines, map_site, mesh_file, mesh_images
from ...formats.geotiff import MapPlace
from ...paper_stand_ins.cached_files import find_mesh_file
from ...physics.mesh import halve_edges, height_map, mesh_faults, texture_coordinates
from ...physics.mesh.ground_interface import Surface
from ...physics.mesh.height_map import HeightMap
from ...physics.mesh.heights_on_mesh import MeshGround
from ...physics.surfaces.textures import uses_uv
from ...physics.terrain.fine_detail import displace_by_relief
from ...settings.topics.ground import SourceSettings
from ...settings.topics.scene import Settings
from ...settings.topics.trust_boundary import NO_MARK
from ...settings.user_files import has_surroundings
from ...support.arrays import Array
from ...support.blender import compat
from ...support.errors import IcyMoonError
from ...support.number_text import format_count
from ..datablocks.blend_file_paths import find_used_files
from . import import_heights
from .import_mesh import read_mesh
from .surroundings import MapOfSite, surround
from .terrain_mesh import build_mesh_from_arrays, shade_flat, shortest_wavelength_m

#: Limits in metres of the size of a ground. A ground outside these limits cannot be a landing site in any unit.
_MIN_SIZE_M, _MAX_SIZE_M = 1e-3, 1e5
#: Maximum width in metres of a ground with its surroundings out to the horizon, such as an export of Icy Moon. Its
#: triangles must be as fine as at a site.
_LARGEST_HORIZON_M = 2e6
#: Limits in metres outside which the unit is probably wrong.
_UNLIKELY_M = (0.2, 2e4)
_SET_SCALE = "set source.scale (0.001 for millimetres)."
#: Relief divided by width above which the unit is probably wrong.
_UNLIKELY_RELIEF = 2.0
#: Median edge of a mesh's triangles over the height of the camera above which the unit is probably wrong: one triangle
#: then fills the image of a camera that looks down.
_UNLIKELY_EDGE = 3.0
#: Maximum number of triangles into which a mesh is divided for added roughness.
_MAX_TRIANGLES = 8_000_000
#: Rows of the matrix that rotates file coordinates to z up: the axis of the file and its sign.
_AXIS_ROTATIONS = {
    "X": ((1, 1), (2, 1), (0, 1)),
    "Y": ((0, 1), (2, -1), (1, 1)),
    "Z": ((0, 1), (1, 1), (2, 1)),
    "-X": ((2, 1), (1, 1), (0, -1)),
    "-Y": ((0, 1), (2, 1), (1, -1)),
    "-Z": ((0, 1), (1, -1), (2, -1)),
}


#: Suffixes of the files that can be a ground.
SUFFIXES = (*mesh_file.FORMATS, *map_site.SUFFIXES)


@dataclass(frozen=True)
class UserGround:
    """A ground from a file: vertices (n, 3), faces (m, 3 or 4), and UV coordinates (m, 3, 2) of the corners or None;
    ``flat`` if each face is shaded flat.

    ``surface`` gives its heights. ``report`` contains the findings of the import, and ``warnings`` are for the user.
    ``map_place`` is the position of its origin on a map (``geotiff.MapPlace``), with ``height_zero_m``, the height in
    the file that becomes z = 0. Without a map, ``map_place`` is the position of the origin in the file's own
    coordinates, turned so that z is up.
    """

    positions: Array
    faces: Array
    surface: HeightMap | MeshGround
    report: tuple[str, ...]
    warnings: tuple[str, ...]
    uv: Array | None = None
    map_place: dict[str, Any] | None = None
    flat: bool = False

    def build_mesh(self, name: str) -> bpy.types.Mesh:
        """Build the mesh of the ground, smooth-shaded unless ``flat``."""
        mesh = build_mesh_from_arrays(name, self.positions, self.faces, uv=self.uv)
        if self.flat:
            shade_flat(mesh, np.ones(len(self.faces), bool))
        return mesh

    def find_nearest_height_m(self, x_m: float, y_m: float) -> float:
        """Return the height in metres of the vertex that is nearest on the map."""
        nearest = np.argmin(np.hypot(self.positions[:, 0] - x_m, self.positions[:, 1] - y_m))
        return float(self.positions[nearest, 2])


def is_from_file(settings: Settings) -> bool:
    """Return whether the ground comes from a file."""
    return bool(settings.source.kind != "PROCEDURAL")


def find_kind(path: Path) -> str:
    """Find the ``source.kind`` of a file by its suffix. Raises IcyMoonError if the file cannot be a ground."""
    suffix = path.suffix.lower()
    if suffix in gdal_lines.SUFFIXES:
        return "HEIGHT_MAP"  # its import names the command that converts the file to GeoTIFF
    if suffix not in SUFFIXES:
        raise IcyMoonError(f"{path}: is not a ground that Icy Moon reads; choose one of {', '.join(SUFFIXES)}.")
    return "MESH" if suffix in mesh_file.FORMATS else "HEIGHT_MAP"


def is_mesh(settings: Settings) -> bool:
    """Return whether the ground is a mesh from a file: the user's own or a stand-in."""
    return bool(settings.source.kind in ("MESH", "STAND_IN"))


def find_ground_file(settings: Settings) -> Path:
    """Find the absolute path of the ground's file. A missing stand-in is made.

    Raises IcyMoonError if the settings name no file, or if a stand-in cannot be written.
    """
    if settings.source.kind == "STAND_IN":
        return find_mesh_file(settings.source.stand_in)
    return find_used_files(settings)["source.file"]


def warn_of_cost(settings: Settings) -> list[str]:
    """Return a warning if loading the ground takes a long time or much memory; otherwise nothing."""
    if settings.source.kind != "MESH":
        return []
    path = find_ground_file(settings)
    cost = mesh_file.estimate_cost(path)
    return [f"{cost.sentence(path)}."] if cost.is_high else []


def load_ground(settings: Settings, make_procedural: Callable[[Settings], Surface]) -> UserGround:
    """Load the ground that ``source`` settings name.

    ``make_procedural`` makes the procedural ground that ``source.detail`` adds below the resolution of the file.
    Raises IcyMoonError if the file is not a usable ground; then Blender keeps no data of it.
    """
    path = find_ground_file(settings)
    try:
        if is_mesh(settings):
            return _load_mesh(path, settings)
        return _load_height_map(path, settings, make_procedural)
    except MemoryError:
        raise IcyMoonError(
            f"{path}: is too large for the memory of this machine; cut out the part that you need, or make it coarser."
        ) from None


def _format_metres(values: Iterable[float]) -> str:
    return ", ".join(f"{float(v) + 0.0:.6g}" for v in values)  # + 0.0 makes -0 a 0


def _is_fine(edge_m: float, height_m: float) -> bool:
    """Return whether the median edge of triangles is short enough that a camera at this height sees more than one
    triangle."""
    return edge_m <= _UNLIKELY_EDGE * height_m


def _check_size(path: Path, extents_m: Array, fix: str, fix_height: str, to_horizon: bool = False) -> list[str]:
    """Return warnings of unlikely extents. Raises IcyMoonError for impossible extents; a ground ``to_horizon`` may be
    wider."""
    widest, relief = float(max(extents_m[:2])), float(extents_m[2])
    most = _LARGEST_HORIZON_M if to_horizon else _MAX_SIZE_M
    if to_horizon and widest > most:
        fix = f"cut off what is far from the site, or {fix}"
    if not _MIN_SIZE_M <= widest <= most:
        raise IcyMoonError(
            f"{path}: is {widest:.3g} m wide, outside the size of a landing site ({_MIN_SIZE_M:g} to {most:g} m); {fix}"
        )
    if not relief <= _MAX_SIZE_M:
        raise IcyMoonError(
            f"{path}: has a relief of {relief:.3g} m, too much for a landing site (at most "
            f"{_MAX_SIZE_M:g} m); {fix_height}"
        )
    warnings = []
    if not (_UNLIKELY_M[0] <= widest <= _UNLIKELY_M[1] or (to_horizon and widest > _UNLIKELY_M[1])):
        warnings.append(f"{path.name} is {widest:.3g} m wide; if its unit is not what you meant, {fix}")
    if relief > _UNLIKELY_RELIEF * widest:
        warnings.append(
            f"{path.name} has a relief of {relief:.3g} m on {widest:.3g} m; if its unit is not what you "
            f"meant, {fix_height}"
        )
    return warnings


def _check_against_camera(path: Path, positions: Array, faces: Array, height_m: float, fix: str) -> list[str]:
    """Return a warning if a mesh is too coarse or too small for a camera at this height above it."""
    widest, edge = float(np.ptp(positions[:, :2], axis=0).max()), halve_edges.edge_length_m(positions, faces)
    if widest >= height_m and _is_fine(edge, height_m):
        return []
    return [
        f"{path.name} is {widest:.3g} m wide with triangles of {edge:.3g} m, and the camera is {height_m:.3g} m "
        f"above it; if its unit is not what you meant, {fix}"
    ]


def rotate_up_axis(positions: Array, kind: str, up_axis: str) -> tuple[Array, str]:
    """Rotate the vertices of ``read_mesh`` so that ``up_axis`` of the file is z. Return them and that axis."""
    usual = "Y" if kind in ("OBJ", "glTF") else "Z"
    axis = usual if up_axis == "AUTO" else up_axis
    if kind == "glTF":
        if axis == "Y":
            return positions, axis
        positions = positions[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])  # back to the file's y up
    return np.stack([sign * positions[:, k] for k, sign in _AXIS_ROTATIONS[axis]], axis=1), axis


def _load_mesh(path: Path, settings: Settings) -> UserGround:
    source = settings.source
    kind = mesh_file.detect_kind(path)
    positions, faces, uv = read_mesh(path)
    warnings = [*_warn_of_rounding(path, positions), *_warn_of_ignored_unit(path, kind)]
    positions, axis = rotate_up_axis(positions * source.scale, kind, source.up_axis)
    before = mesh_faults.examine_mesh(positions, faces)
    fine = _is_fine(halve_edges.edge_length_m(positions, faces), float(settings.rig.height_m))
    unlikely = _check_size(path, np.array(before.extents_m), _SET_SCALE, "fix the vertices that stand out.", fine)
    _refuse_unusable(path, before, source.repair)
    report = [f"{kind}, {axis} up, {source.scale:g} m per unit", *before.lines()]
    if source.repair:
        positions, faces, uv = mesh_faults.repair_mesh(positions, faces, uv)
        after = mesh_faults.examine_mesh(positions, faces)
        report.append("Repaired: " + "; ".join(after.lines()))
    else:
        after = before
    if source.kind == "MESH" and not unlikely:  # a stand-in has its unit
        unlikely = _check_against_camera(path, positions, faces, float(settings.rig.height_m), _SET_SCALE)
    warnings += unlikely
    if after.up != "Z":
        warnings.append(
            f"Most faces of {path.name} point along {after.up}, so another axis may point up; set source.up_axis."
        )
    shift = _find_shift(positions, source)
    positions = positions + shift
    report.append(f"Moved by {_format_metres(shift)} m")
    place = _describe_place_in_file(shift, source.scale) if source.kind == "MESH" else None
    if uv is not None:
        uv, found = texture_coordinates.repair_coordinates(uv)
        report += found
        if uses_uv(settings.textures):
            warnings += [f"{path.name}: {sentence}." for sentence in found[1:]]
    if kinds := ", ".join(mesh_images.find_images(path).by_kind):
        report.append(f"Contains images ({kinds}), which textures.set = MESH shows")
    if source.detail:
        positions, faces, uv, sentence = _add_roughness(positions, faces, uv, settings)
        report.append(sentence)
    positions = positions.astype(np.float32)
    surface = MeshGround(positions, faces)
    return UserGround(positions, faces, surface, tuple(report), tuple(warnings), uv, place, flat=source.flat_faces)


def _add_roughness(
    positions: Array, faces: Array, uv: Array | None, settings: Settings
) -> tuple[Array, Array, Array | None, str]:
    """Divide a mesh to the vertex spacing of ``terrain``, and displace it along its normals. Return the mesh and a
    sentence on it."""
    edge = halve_edges.edge_length_m(positions, faces)
    wanted = shortest_wavelength_m(settings.terrain) / 2
    cuts = halve_edges.count_halvings(edge, wanted, len(faces), _MAX_TRIANGLES)
    for _ in range(cuts):
        positions, faces = halve_edges.halve_edges(positions, faces)
        uv = None if uv is None else texture_coordinates.halve_coordinates(uv)
    finest = edge / 2**cuts
    roughened = displace_by_relief(
        positions,
        halve_edges.vertex_normals(positions, faces),
        settings,
        int(settings.dataset.seed),
        2 * edge,
        2 * finest,
    )
    limit = f", not {wanted:.3g} m, to keep to {_MAX_TRIANGLES} triangles" if finest > 1.01 * wanted else ""
    return (
        roughened,
        faces,
        uv,
        (
            f"Roughness of {2 * finest:.3g} to {2 * edge:.3g} m added on {len(faces)} "
            f"triangles, edges of {finest:.3g} m{limit}"
        ),
    )


def _warn_of_rounding(path: Path, positions: Array) -> list[str]:
    """Return a warning if single precision rounds large coordinates by more than a thousandth of the vertex spacing.

    Raises IcyMoonError if no vertex is finite.
    """
    finite = np.isfinite(positions).all(axis=1)
    if not finite.any():
        raise IcyMoonError(
            f"{path}: none of its {len(positions)} vertices has finite coordinates; export the mesh again."
        )
    positions = positions[finite]
    if not np.array_equal(positions, positions.astype(np.float32)):
        return []  # double precision
    step = float(np.spacing(np.float32(np.abs(positions).max())))
    spacing = float(np.ptp(positions, axis=0).max()) / math.sqrt(len(positions))
    if step < 1e-3 * spacing:
        return []
    return [
        f"The coordinates of {path.name} are so large that they are rounded to {step:.2g} units, but vertices are "
        f"{spacing:.2g} apart; subtract an offset before the export, or write a PLY in double precision."
    ]


def _warn_of_ignored_unit(path: Path, kind: str) -> list[str]:
    """Return a warning if this Blender assumes metres for a file of this kind, whatever its stated unit."""
    if kind != "USD" or compat.applies_usd_unit():
        return []
    return [
        f"This Blender ignores the unit that {path.name} states and uses metres; set source.scale if "
        "it is another unit."
    ]


def _refuse_unusable(path: Path, found: mesh_faults.MeshReport, repair: bool) -> None:
    """Raise IcyMoonError for a mesh without an area, and, unless ``repair`` is set, for vertices without finite
    coordinates."""
    if found.area_m2 <= 0.0 or found.degenerate_faces == found.triangles:
        raise IcyMoonError(f"{path}: none of its {found.triangles} faces has an area; export the mesh again.")
    if found.non_finite_vertices and not repair:
        raise IcyMoonError(
            f"{path}: has {format_count(found.non_finite_vertices, 'vertex', 'vertices')} without finite "
            "coordinates; set source.repair or fix the mesh."
        )


def _find_shift(positions: Array, source: SourceSettings) -> Array:
    """Find the vector that moves the vertices so that the origin of the site is where the settings put it."""
    shift = np.array([-source.origin_x_m, -source.origin_y_m, 0.0])
    if source.centre:
        low, high = positions.min(axis=0), positions.max(axis=0)
        shift += [-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -float(np.median(positions[:, 2]))]
    return shift


def _describe_place_in_file(moved_m: Iterable[float], unit_m: float = 1.0) -> dict[str, Any]:
    """Describe the place of the origin in a file without a map, whose coordinates in metres were moved by ``moved_m``
    (3,)."""
    east, north, up = (-float(value) for value in moved_m)
    return MapPlace("", unit_m, (east, north), (1.0, 1.0)).to_json() | {"height_zero_m": up}


def _find_origin_m(source: SourceSettings) -> tuple[float, float]:
    return float(source.origin_x_m), float(source.origin_y_m)


def _place_heights(
    heights: Array, pixel: tuple[float, float], read: import_heights.Heights, source: SourceSettings, size_m: float
) -> tuple[HeightMap, tuple[float, float, float], dict[str, Any]]:
    """Place a map about the origin of the site. Return the map, its shift in metres, and its position.

    The position is from the map's coordinate system, unless the settings state the size of its pixels.
    """
    if read.place is not None and read.corner_m is not None and not source.metres_per_pixel > 0:
        zero_m = float(np.median(heights)) if source.centre else 0.0
        moved = (-read.place.origin[0], -read.place.origin[1], -zero_m)
        surface = HeightMap(heights - zero_m, pixel, *read.corner_m, size_m)
        return surface, moved, read.place.to_json() | {"height_zero_m": zero_m}
    surface, moved = height_map.place_map(
        heights,
        pixel,
        read.corner_m or (0.0, 0.0),
        centre=bool(source.centre),
        origin_m=_find_origin_m(source),
        size_m=size_m,
    )
    return surface, moved, _describe_place_in_file(moved)


def _make_grid_mesh(surface: HeightMap, spacing_m: float) -> tuple[Array, Array]:
    """Make the vertices and faces of a map, on a grid of about this spacing."""
    west, east, south, north = surface.bounds_m
    x, y = (np.linspace(a, b, max(2, round((b - a) / spacing_m) + 1)) for a, b in ((west, east), (south, north)))
    return height_map.make_grid_mesh(surface.heights(x[None, :], y[:, None], 2 * spacing_m), x, y)


def _load_height_map(path: Path, settings: Settings, make_procedural: Callable[[Settings], Surface]) -> UserGround:
    source, terrain = settings.source, settings.terrain
    size_m, radius_m = float(terrain.size_m), float(terrain.body_radius_m)
    by_hand = source.metres_per_pixel > 0  # then the size and place in the file do not count
    missing = None if source.missing in ("", NO_MARK) else float(source.missing)
    map_site.refuse_size_by_hand(source)
    read = import_heights.read_heights(path, None if by_hand else map_site.make_map_site(settings), missing, radius_m)
    values, sentences = (read.values, []) if source.missing else height_map.clear_unstated_mark(read.values)
    known = np.isfinite(values)
    if not known.any():
        raise IcyMoonError(f"{path}: none of its {known.size} pixels is a height; check its no-data value.")
    pixel = _find_pixel_size(path, read, source)
    warnings = [f"{path.name}: {sentence}." for sentence in (*read.warnings, *sentences)]
    if not known.all():
        warnings.append(f"{1 - known.mean():.2%} of {path.name} has no height and {_tell_gaps_filled(source)}.")
    heights = height_map.fill_holes(values) * source.height_scale_m
    surface, moved, place = _place_heights(heights, pixel, read, source, size_m)
    west, east, south, north = surface.bounds_m
    extents = np.array([max(east - west, 0.0), max(north - south, 0.0), float(np.ptp(heights))])
    _refuse_ground_off_map(path, surface, size_m)
    steep = "set source.height_scale_m, or mark the heights that are missing."
    warnings += _check_size(path, extents, "set source.metres_per_pixel.", steep)
    warnings += _warn_near_edge(path, surface, settings)
    if source.detail:
        surface = height_map.add_roughness(surface, make_procedural(settings))
    rows, columns = read.file_shape or heights.shape
    report = (
        _describe_map_size((rows, columns), heights, pixel),
        *read.report,
        f"Ground of {east - west:.4g} x {north - south:.4g} m, moved by {_format_metres(moved)} m",
        "Procedural roughness below the pixel size" if source.detail else "Nothing finer than the pixel size",
    )
    if not has_surroundings(settings):
        positions, faces = _make_grid_mesh(surface, shortest_wavelength_m(terrain) / 2)
        return UserGround(positions, faces, surface, report, tuple(warnings), map_place=place)
    zero_m = float(place["height_zero_m"])
    known_m = np.where(known, values * source.height_scale_m - zero_m, np.nan)
    of = MapOfSite(path, heights.shape == (rows, columns), known_m, surface, zero_m, missing)
    patch = UserGround(np.empty(0), np.empty(0), surface, report, tuple(warnings), map_place=place)
    return _add_surroundings(patch, of, settings)


def _refuse_ground_off_map(path: Path, surface: HeightMap, size_m: float) -> None:
    """Raise IcyMoonError if a map has no ground about the origin."""
    west, east, south, north = surface.bounds_m
    if east <= west or north <= south:
        raise IcyMoonError(
            f"{path}: has no height within terrain.size_m = {size_m:g} m of the origin; set "
            "source.centre, source.origin_x_m or source.origin_y_m."
        )


def _describe_map_size(shape: tuple[int, int], heights: Array, pixel: tuple[float, float]) -> str:
    """Describe, for the import report, the pixels and the size of a map of a ``shape`` (rows, columns), and the part
    that was read."""
    rows, columns = shape
    whole = (columns - 1) * pixel[0], (rows - 1) * pixel[1], float(np.ptp(heights))
    part = f", of which {heights.shape[1]} x {heights.shape[0]} were read" * (heights.shape != shape)
    return f"{columns} x {rows} pixels of {pixel[0]:.4g} x {pixel[1]:.4g} m, {_format_metres(whole)} m{part}"


def _tell_gaps_filled(source: SourceSettings) -> str:
    """Describe how the missing heights of a map are filled, as the end of a sentence."""
    if source.surroundings_m > 0 and source.surroundings_file:
        return "was interpolated smoothly, or in wide gaps taken from source.surroundings_file"
    return "was interpolated smoothly"


def _add_surroundings(patch: UserGround, of: MapOfSite, settings: Settings) -> UserGround:
    """Replace the patch of a map by the patch with its surroundings."""
    made = surround(of, find_used_files(settings).get("source.surroundings_file"), settings)
    found = made.surface
    return replace(
        patch,
        positions=found.positions,
        faces=found.faces,
        surface=found,
        report=(*patch.report, *made.report),
        warnings=(*patch.warnings, *made.warnings),
        map_place=(patch.map_place or {}) | {"body_radius_m": found.body_radius_m},
    )


def _warn_near_edge(path: Path, surface: HeightMap, settings: Settings) -> list[str]:
    """Return a warning if the map ends nearer to a stated site than half the width of the ground."""
    size_m, pixel_m = float(settings.terrain.size_m), max(surface.pixel_m)
    west, east, south, north = surface.bounds_m
    nearest, side = min((-west, "west"), (east, "east"), (-south, "south"), (north, "north"))
    if settings.source.site == "OFFSET" or has_surroundings(settings) or nearest >= size_m / 2 - pixel_m:
        return []
    return [
        f"{path.name}: ends {nearest:.4g} m {side} of the site, with north up on the map, and the ground ends there. "
        f"This is nearer than half of terrain.size_m = {size_m:g} m; choose a site farther from the edge, or a map "
        "that reaches farther."
    ]


def _find_pixel_size(path: Path, read: import_heights.Heights, source: SourceSettings) -> tuple[float, float]:
    """Find the metres per pixel (east, north) from the settings, or from the file if they state none."""
    if source.metres_per_pixel > 0:
        return (source.metres_per_pixel,) * 2
    if read.pixel_m is None or (source.site != "OFFSET" and read.place is None):
        map_site.refuse_unknown_pixel_size(path, read.unplaced, source)
    return read.pixel_m

"""A lander's decisions, shown on the ground: a map as colours of its vertices, the chosen site and the reach.

The map is painted in the same way as errors: in attributes that no render reads and no mark covers, and in a collection
that is not rendered. ``painted_errors.clear_painted`` removes both.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import bpy
import numpy as np

from ..stereo.decisions.map_colours import LEGEND_BY_MAP, colour_cells, count_cells
from ..stereo.decisions.stored_maps import (
    ABSTAINS,
    GUARANTEED,
    HEIGHT_ERROR,
    SLOPE,
    SUITABILITY,
    UNLIKE,
    StoredMap,
    trace_outlines,
)
from ..stereo.images.colours import SKY_GREY
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.steps import Steps
from .built_scene import Built
from .datablocks.fingerprint import TAG
from .datablocks.mesh_arrays import get_memory
from .ground.terrain_mesh import build_mesh_from_arrays
from .measured_surface import fill_colours, make_share_lines, set_colours, to_linear_colours
from .painted_errors import (
    ROLE,
    add_colours,
    begin_painting,
    darken_meshes,
    find_other_meshes,
    find_painted,
    find_rock_meshes,
    read_vertex_positions,
    refuse_other_ground,
    remove_unlinked,
    to_world,
)

NAME = "Icy Moon Decisions"
SITE, REACH = "Chosen Site", "Reach"
#: Colours of the marks (sRGB), which no map has, with their text and icon in a legend.
_MARKS = {
    SITE: ((255, 0, 188), "Chosen site, magenta ring", "COLORSET_05_VEC"),
    REACH: ((0, 243, 255), "Reach of the arm, cyan line", "COLORSET_08_VEC"),
}
#: The text of the chosen site by the verdict of a calibration.
_SITE_TEXTS = {
    GUARANTEED: "Guaranteed site, magenta ring",
    ABSTAINS: "Abstains from this site, crossed-out ring",
    UNLIKE: "Unlike ground, no guarantee, crossed-out ring",
}
#: Names of the maps in a legend.
TITLES = {SUITABILITY: "Suitability", SLOPE: "Slope", HEIGHT_ERROR: "Height error"}
_COUNTS_PROPERTY = "icymoon_cells"  # custom property of the collection
_GUARANTEE = "guarantee"
_LEGEND_ICONS = {
    "safe": "COLORSET_03_VEC",
    "unsafe": "COLORSET_02_VEC",
    "gentle": "COLORSET_03_VEC",
    "steep": "COLORSET_09_VEC",
    "steeper": "COLORSET_01_VEC",
    "high": "COLORSET_01_VEC",
    "low": "COLORSET_04_VEC",
    "right": "BLANK1",
    "unknown": "COLORSET_13_VEC",
}
#: Height of marks above the ground, m.
_ABOVE_M = 0.01
#: Half the thickness of the lines of marks, m, and number of points of a ring.
_LINE_RADIUS_M, _RING_POINTS = 0.006, 48
#: Number of sides of these lines, and the minimum of 1 plus the cosine of a turn. It limits how far a sharp corner
#: reaches.
_LINE_SIDES, _MIN_TURN_COSINE = 6, 0.25


def paint_decisions(find_build: Callable[[], Built], stored: StoredMap, title: str) -> Steps[bpy.types.Collection]:
    """Show a map in steps on the ground of a built scene with its site and reach, in place of anything painted before.

    The last step alone changes the scene, which it finds by ``find_build``. Raises IcyMoonError before any change if no
    vertex of the ground is within the map.
    """
    ground = find_build().terrain
    memory = yield from get_memory(3 * len(ground.data.vertices), np.float32)
    ground = find_build().terrain
    matrix, position = np.array(ground.matrix_world), read_vertex_positions(ground.data, memory)
    colours = yield partial(_colour_ground, matrix, position, stored)
    counts = yield partial(count_cells, stored)
    there = {SITE: stored.chosen is not None, REACH: stored.reach is not None and bool(stored.reach.any())}
    told = {**counts, **there, "title": title, "map": stored.kind, _GUARANTEE: stored.guarantee}
    marks = dict[str, bpy.types.Object]()
    try:
        if stored.chosen is not None:
            marks[SITE] = _draw_site(stored, *stored.chosen)
        if stored.reach is not None and there[REACH]:
            marks[REACH] = _draw_lines(REACH, (yield partial(_trace_reach, stored, stored.reach)))
        yield None
        built = find_build()
        refuse_other_ground(built, colours, *marks.values())
    except BaseException:
        remove_unlinked(*marks.values())
        raise
    return _show_in_scene(built, colours, marks, told)


def _colour_ground(to_the_world: Array, position: Array, stored: StoredMap) -> Array:
    """Return the colours by ``to_linear_colours`` of the ground's vertices at positions (n, 3) in its coordinates. Any
    thread may call this. Raises IcyMoonError if no vertex is within the map."""
    cell = stored.grid.find_cells(to_world(to_the_world, position))
    inside = cell >= 0
    if not inside.any():
        raise IcyMoonError(
            "No vertex of the ground is within the workspace of these decisions; press Build Scene, or "
            "raise terrain.resolution."
        )
    colours = np.full((len(cell), 3), SKY_GREY, np.uint8)
    colours[inside] = colour_cells(stored).reshape(-1, 3)[cell[inside]]
    return to_linear_colours(colours)


def _show_in_scene(
    built: Built, colours: Array, marks: dict[str, bpy.types.Object], told: dict[str, Any]
) -> bpy.types.Collection:
    """Give the meshes of a built scene the colours of a map, and link the marks."""
    mesh = built.terrain.data
    collection = begin_painting(built.scene, mesh, NAME)
    collection[_COUNTS_PROPERTY] = told
    fill_colours(add_colours(mesh), colours)
    darken_meshes({*find_rock_meshes(built), *find_other_meshes(built)})  # the ground under them is unknown from above
    for name, mark in marks.items():
        mark.name = mark.data.name = name  # which an earlier mark had until now
        _link_mark(collection, mark)
    return collection


def find_shown_map(scene: bpy.types.Scene) -> tuple[str, str]:
    """Find the title and the kind of the shown map; both empty if no map is shown."""
    collection = find_painted(scene)
    stored: Any = collection.get(_COUNTS_PROPERTY) if collection else None
    kind = stored.get("map") if hasattr(stored, "items") else None
    return (str(stored.get("title")), str(kind)) if kind in TITLES else ("", "")


def make_legend(scene: bpy.types.Scene) -> tuple[tuple[str, str], ...]:
    """Make the lines (text, icon) of the legend: the colours with their meaning and share of the workspace, then the
    marks."""
    title, kind = find_shown_map(scene)
    collection = find_painted(scene)
    if not kind or collection is None:
        return ()
    stored = collection[_COUNTS_PROPERTY]
    verdict = str(stored.get(_GUARANTEE, ""))
    texts = {SITE: _SITE_TEXTS[verdict]} if verdict in _SITE_TEXTS else {}
    counts = {key: stored[key] for key in LEGEND_BY_MAP[kind] if isinstance(stored.get(key), int)}
    return (
        *make_share_lines(
            f"{TITLES[kind]} by {title}",
            counts,
            {key: (text, _LEGEND_ICONS[key]) for key, text in LEGEND_BY_MAP[kind].items()},
            max(1, sum(counts.values())),
        ),
        *((texts.get(mark, text), icon) for mark, (_, text, icon) in _MARKS.items() if stored.get(mark)),
        ("Dark: rocks, the lander, beyond the workspace", "BLANK1"),
    )


def _link_mark(collection: bpy.types.Collection, item: bpy.types.Object) -> None:
    item[TAG] = ROLE
    item.hide_render = item.show_in_front = True
    collection.objects.link(item)


def _draw_site(stored: StoredMap, row: int, column: int) -> bpy.types.Object:
    """Draw a ring as large as the footprint of the site, crossed out if a calibration gives the site no guarantee."""
    angle = np.linspace(0.0, 2 * np.pi, _RING_POINTS, endpoint=False)
    ring = stored.disc_m / 2 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    # Lines are closed, so the line across the ring goes there and back.
    bar = ring[[_RING_POINTS * k // 8 for k in (1, 5)]].repeat(2, axis=0)
    bar += np.array([(-1, 1, 0), (1, -1, 0), (1, -1, 0), (-1, 1, 0)]) * _LINE_RADIUS_M / 2
    centre = _place_on_ground(stored, np.array([[row + 0.5, column + 0.5]]))
    return _draw_lines(SITE, [centre + ring, *([centre + bar] if stored.guarantee in (ABSTAINS, UNLIKE) else [])])


def _trace_reach(stored: StoredMap, reach: Array) -> list[Array]:
    """Trace the outlines of the reach as closed lines on the ground."""
    return [_place_on_ground(stored, way) for way in trace_outlines(reach)]


def _draw_lines(name: str, ways: list[Array]) -> bpy.types.Object:
    """Draw closed lines through positions (n, 3) as tubes with colours of vertices. In a camera view, bare lines and
    empties are hidden with the overlays, and in Blender 5.2, objects without such colours are white."""
    tubes = [_make_tube(way) for way in ways]
    starts = np.cumsum([0, *(len(position) for position, _ in tubes)])
    mesh = build_mesh_from_arrays(
        name,
        np.concatenate([position for position, _ in tubes]),
        np.concatenate([faces + start for (_, faces), start in zip(tubes, starts, strict=False)]),
    )
    set_colours(add_colours(mesh), np.tile(np.array(_MARKS[name][0], np.uint8), (len(mesh.vertices), 1)))
    return bpy.data.objects.new(name, mesh)


def _make_tube(way: Array) -> tuple[Array, Array]:
    """Make a tube along a closed line through positions (n, 3): positions (n _LINE_SIDES, 3) and triangles.

    Seen from above, the tube has the same width at corners as between them.
    """
    along = np.roll(way, -1, axis=0) - way
    across = np.stack([along[:, 1], -along[:, 0]], axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    before = np.roll(across, 1, axis=0)
    sharp = np.maximum(1 + (before * across).sum(axis=1, keepdims=True), _MIN_TURN_COSINE)
    mitre = np.pad((before + across) / sharp, ((0, 0), (0, 1)))
    angle = 2 * np.pi * np.arange(_LINE_SIDES) / _LINE_SIDES
    round_ = np.cos(angle)[:, None] * mitre[:, None] + np.sin(angle)[:, None] * np.array((0.0, 0.0, 1.0))
    here = np.arange(len(way) * _LINE_SIDES).reshape(-1, _LINE_SIDES)
    there = np.roll(here, -1, axis=0)
    corners = np.stack([here, np.roll(here, -1, axis=1), np.roll(there, -1, axis=1), there], axis=-1)
    return (
        (way[:, None] + _LINE_RADIUS_M * round_).reshape(-1, 3),
        np.concatenate([corners[..., (0, 1, 2)].reshape(-1, 3), corners[..., (0, 2, 3)].reshape(-1, 3)]),
    )


def _place_on_ground(stored: StoredMap, place: Array) -> Array:
    """Return the positions (n, 3) in metres just above the true ground at places (n, 2), in rows and columns from the
    outer corner."""
    grid, height = stored.grid, stored.height_m
    row, column = (np.clip(np.floor(place[:, axis]), 0, height.shape[axis] - 1).astype(np.intp) for axis in (0, 1))
    level = float(np.nanmedian(height)) if np.isfinite(height).any() else 0.0
    z = np.nan_to_num(height[row, column], nan=level) + _ABOVE_M
    return np.stack([grid.west_m + place[:, 1] * grid.cell_m, grid.north_m - place[:, 0] * grid.cell_m, z], axis=1)

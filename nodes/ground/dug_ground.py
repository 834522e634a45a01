"""Procedural ground with a trench: a fine square patch in its mesh has the heights of the excavation.

Every state of an excavation has the same patch, so only heights differ between states. The last ground is kept, so that
the next state of a series makes neither the mesh round the patch nor earlier states again.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import geometry

from ...physics.excavation import dig_site as sites
from ...physics.excavation.dig import ExcavationSeries
from ...physics.excavation.dig_grid import ExcavationGrid
from ...physics.excavation.scoop_paths import JOINTS
from ...physics.mesh.hole_for_trench import cut_hole, is_inside_loop, list_grid_rim
from ...physics.rocks.place_rocks import HeightAt
from ...physics.terrain.terrain import Terrain, make_terrain
from ...settings import rebuilt_parts
from ...settings.topics.ground import TerrainSettings
from ...settings.topics.scene import Settings
from ...settings.user_files import hash_content
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .terrain_mesh import MeshedGround, mesh_ground

#: Names of attributes: depth of dug ground below the untouched surface, m, and presence of spoil.
DEPTH, SPOIL = "icymoon_depth", "icymoon_spoil"
#: Minimum thickness of spoil that covers the ground, and minimum change of height of a dug face, m.
_COVERING_SPOIL_M, _MIN_DUG_M = 1.0e-3, 1.0e-4
#: Widths in cells of the margin round the patch without other vertices, tried in turn until the hole has one rim.
_FREE_CELLS = (2.0, 6.0, 16.0)


@dataclass(frozen=True)
class DugGround(MeshedGround):
    """Ground in a state of an excavation. The vertices of its patch come last, row by row from the south-west."""

    series: ExcavationSeries | None = None
    state: int = 0

    @property
    def grid(self) -> ExcavationGrid:
        """The grid of the patch."""
        assert self.series is not None
        return self.series.site.grid

    def without_skirts(self, height_at: HeightAt, terrain: TerrainSettings) -> HeightAt:
        """Make a function that returns the heights of the untouched ground without skirts, on which rocks lie."""
        return super().without_skirts(self.before(height_at), terrain)

    def compute_skirts(self, x_m: Array, y_m: Array, terrain: TerrainSettings) -> Array:
        """Compute the heights in metres of the skirts above the untouched ground at places (n, …), with the detail of
        the mesh."""
        skirts, grid = self.surface.skirts, self.grid
        assert skirts is not None
        patch = skirts.heights(grid.east_m[None, :], grid.north_m[:, None], 2 * grid.cell_m)
        return grid.interpolate(patch, x_m, y_m, super().compute_skirts(x_m, y_m, terrain))

    def before(self, height_at: HeightAt) -> HeightAt:
        """Make a function that returns the heights of the untouched ground. Outside the patch, it calls ``height_at``
        of the mesh in this state."""
        assert self.series is not None
        series = self.series

        def heights(x_m: Array, y_m: Array) -> Array:
            return series.site.grid.interpolate(series.before_m, x_m, y_m, height_at(x_m, y_m))

        return heights

    def change_m(self, x_m: Array, y_m: Array) -> Array:
        """Return the height in metres of the ground in this state above the untouched ground; negative where it is
        lower."""
        assert self.series is not None
        change = self.series.at(self.state).layers.top - self.series.before_m
        return self.grid.interpolate(change, x_m, y_m, np.zeros(np.shape(x_m)))

    def find_coarse_heights(self, terrain: TerrainSettings) -> HeightAt:
        """Make a function as ``MeshedGround.find_coarse_heights`` does, with the heights of this state in the patch."""
        untouched = self.before(super().find_coarse_heights(terrain))
        return lambda x_m, y_m: untouched(x_m, y_m) + self.change_m(x_m, y_m)

    def build_mesh(self, name: str) -> bpy.types.Mesh:
        """Build the mesh, with the attributes ``DEPTH`` and ``SPOIL``."""
        assert self.series is not None
        mesh = super().build_mesh(name)
        layers = self.series.at(self.state).layers
        around = np.zeros(len(self.positions) - layers.ground.size, np.float32)
        for key, values in (
            (DEPTH, self.series.before_m - layers.ground),
            (SPOIL, np.clip(layers.spoil / _COVERING_SPOIL_M, 0.0, 1.0)),
        ):
            attribute = mesh.attributes.new(key, "FLOAT", "POINT")
            attribute.data.foreach_set("value", np.concatenate([around, values.ravel().astype(np.float32)]))
        return mesh


@dataclass(frozen=True)
class _Prepared:
    """Ground with its patch untouched, and the states that have been dug."""

    key: str
    ground: MeshedGround
    series: ExcavationSeries


class _PreparedGroundCache:
    """The ground that was prepared last. One thread at a time uses it, since the window makes its fine ground in a
    thread."""

    prepared: _Prepared | None = None
    lock = threading.Lock()


def mesh_whole_ground(
    settings: Settings, mesh: Callable[[Terrain, Settings], MeshedGround] = mesh_ground
) -> MeshedGround:
    """Make procedural ground with its mesh, dug if ``settings`` have an excavation; any thread may call this.

    Paths in ``settings`` are absolute, since only the main thread may ask Blender for the folder of the open file.
    ``mesh`` makes the mesh of untouched ground. Raises IcyMoonError if the ground cannot be dug, ValueError if a height
    is not finite.
    """
    if not sites.is_dug(settings):
        return mesh(_make_untouched(settings), settings)
    if reasons := sites.find_refusals(settings):
        raise IcyMoonError(" ".join(reasons))
    with _PreparedGroundCache.lock:
        prepared = _prepare_ground(settings, mesh)
        return _dig_state(prepared, int(settings.excavation.state))


def _make_ground_key(settings: Settings, fine: bool = True) -> str:
    scene = {topic: dict(values) for topic, values in rebuilt_parts.select_scene(settings).items()}
    scene["excavation"]["state"] = 0
    return json.dumps([scene, sites.gravity_m_s2(settings), hash_content(settings), fine], sort_keys=True)


def _make_untouched(settings: Settings) -> Terrain:
    return make_terrain(settings, int(settings.dataset.seed))


def _prepare_ground(settings: Settings, mesh: Callable[[Terrain, Settings], MeshedGround]) -> _Prepared:
    key = _make_ground_key(settings, mesh is mesh_ground)
    if _PreparedGroundCache.prepared is None or _PreparedGroundCache.prepared.key != key:
        _PreparedGroundCache.prepared = None  # its memory is needed now
        made = mesh(_make_untouched(settings), settings)
        site = sites.make_site(settings)
        x, y = site.grid.east_m[None, :], site.grid.north_m[:, None]
        before = np.asarray(made.surface.heights(x, y, 2 * site.grid.cell_m), np.float64)
        loose = None if made.loose_m is None else made.surface.measure_loose(x, y, 2 * site.grid.cell_m)
        joined = join_patch(made, site.grid, before, loose)
        level = float(made.surface.heights(np.array([settings.rig.x_m]), np.array([settings.rig.y_m]), 0.0)[0])
        _PreparedGroundCache.prepared = _Prepared(
            key,
            joined,
            ExcavationSeries(
                site,
                settings.excavation,
                int(settings.dataset.seed),
                before,
                level if settings.excavation.path == JOINTS else None,
            ),
        )
    return _PreparedGroundCache.prepared


def _dig_state(prepared: _Prepared, state: int) -> DugGround:
    """Make the ground in a state: with the heights of its patch, and flat faces where it was dug."""
    ground, series = prepared.ground, prepared.series
    layers = series.at(state).layers
    top, loose = layers.top, None if ground.loose_m is None else ground.loose_m.copy()
    positions = ground.positions.copy()
    positions[-top.size :, 2] = top.ravel()
    if loose is not None:
        left = np.maximum(loose[-top.size :] - (series.before_m - layers.ground).ravel(), 0.0)
        loose[-top.size :] = left + layers.spoil.ravel()
    moved = np.concatenate(
        [np.zeros(len(positions) - top.size, bool), np.abs(top - series.before_m).ravel() > _MIN_DUG_M]
    )
    flat = moved[ground.faces].any(axis=1)
    fine = flat if ground.fine is None else flat | ground.fine
    return DugGround(
        ground.surface,
        positions,
        ground.faces,
        ground.sharp,
        ground.spacing_m,
        fine,
        ground.most_rocks,
        loose,
        series=series,
        state=state,
    )


def join_patch(
    ground: MeshedGround, grid: ExcavationGrid, heights_m: Array, loose_m: Array | None = None
) -> MeshedGround:
    """Join a patch to the mesh of a ground: the vertices of ``grid`` at ``heights_m`` (rows, columns). They come last
    in the mesh. ``loose_m`` (rows, columns) are the patch's thicknesses of loose material, if they are known.

    The triangles that meet the patch are removed, and a constrained Delaunay triangulation between the rims of the hole
    and the patch fills the gap. The triangulation adds no vertex, so no crack appears. Raises IcyMoonError if there is
    no ground all round the patch.
    """
    faces, fine = ground.faces, ground.fine
    if faces.shape[1] == 4:
        faces = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
        fine = None if fine is None else np.concatenate([fine, fine])
    holes = (cut_hole(ground.positions, faces, grid.bounds_m, free * grid.cell_m) for free in _FREE_CELLS)
    hole = next((found for found in holes if found is not None), None)
    if hole is None:
        raise IcyMoonError(
            "Trench and heap do not lie on one piece of ground; move excavation.start_x_m and "
            "excavation.start_y_m, or set mesh.walls to FLUTED."
        )
    kept, loop = hole
    used = np.zeros(len(ground.positions), bool)
    used[faces[kept]] = True
    number = np.cumsum(used) - 1
    around = int(used.sum())
    east, north = np.broadcast_arrays(grid.east_m[None, :], grid.north_m[:, None])
    patch = np.stack([east, north, heights_m], axis=2).reshape(-1, 3)
    rim = list_grid_rim(grid.rows, grid.columns)
    gap = _fill_gap(ground.positions[loop, :2], patch[rim, :2])
    ends = np.concatenate([number[loop], around + rim])
    corner = around + (np.arange(grid.rows - 1)[:, None] * grid.columns + np.arange(grid.columns - 1)).ravel()
    squares = np.stack([corner, corner + 1, corner + grid.columns + 1, corner + grid.columns], axis=1)
    added = np.concatenate([ends[gap], squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]])
    sharp = ground.sharp[used[ground.sharp].all(axis=1)] if len(ground.sharp) else ground.sharp
    return replace(
        ground,
        positions=np.concatenate([ground.positions[used].astype(np.float64), patch]),
        faces=np.concatenate([number[faces[kept]], added]).astype(np.int32),
        sharp=np.sort(number[sharp], axis=1) if len(sharp) else sharp,
        spacing_m=None
        if ground.spacing_m is None
        else np.concatenate([ground.spacing_m[used], np.full(len(patch), grid.cell_m)]),
        fine=None if fine is None else np.concatenate([fine[kept], np.ones(len(added), bool)]),
        loose_m=None
        if ground.loose_m is None or loose_m is None
        else np.concatenate([ground.loose_m[used], loose_m.ravel()]),
    )


def _fill_gap(outer_m: Array, inner_m: Array) -> Array:
    """Return triangles (m, 3), counter-clockwise, that fill the gap between an outer loop (n, 2) and an inner loop (k,
    2). Their corners are numbered from the outer loop on."""
    points = np.concatenate([outer_m, inner_m]) - inner_m.mean(axis=0)
    edges = [
        (first + k, first + (k + 1) % count)
        for first, count in ((0, len(outer_m)), (len(outer_m), len(inner_m)))
        for k in range(count)
    ]
    found, _, triangles, of, *_ = geometry.delaunay_2d_cdt(points.tolist(), edges, [], 0, 1e-9)
    if len(found) != len(points):
        raise IcyMoonError(
            "Ground that overhangs runs across the rim of trench and heap, where no patch fits; set "
            "mesh.walls to FLUTED, or move excavation.start_x_m and excavation.start_y_m."
        )
    original = np.array([each[0] for each in of])
    made = original[np.array(list(triangles), np.int64)]
    a, b, c = (points[made[:, k]] for k in range(3))
    ahead = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    made[ahead < 0] = made[ahead < 0][:, ::-1]
    middle = (a + b + c) / 3.0
    low, high = points[len(outer_m) :].min(axis=0), points[len(outer_m) :].max(axis=0)
    in_patch = ((middle > low) & (middle < high)).all(axis=1)
    return _drop_loose_triangles(
        made[is_inside_loop(middle, points[: len(outer_m)]) & ~in_patch], np.sort(edges, axis=1)
    )


def _drop_loose_triangles(faces: Array, rims: Array) -> Array:
    """Return the triangles (m, 3) that touch, on every side, another triangle or an edge (k, 2) of the rims.

    Along a seam of the mesh, three corners of the outer rim lie on a line. By rounding, a triangle without area between
    them may count as inside.
    """
    many = int(faces.max()) + 1
    rim = rims[:, 0] * many + rims[:, 1]
    while True:
        sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        side = sides[:, 0] * many + sides[:, 1]
        keys, times = np.unique(side, return_counts=True)
        loose = np.isin(side, np.setdiff1d(keys[times == 1], rim)).reshape(-1, 3).any(axis=1)
        if not loose.any():
            return faces
        faces = faces[~loose]

"""Ray-traced ground that a scoop digs: a patch of fine triangles replaces the ground's own triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...physics.excavation.dig import ExcavationSeries
from ...physics.excavation.dig_grid import ExcavationGrid, make_covering_grid
from ...physics.excavation.dig_site import make_site
from ...rays.engine import open_tracer
from ...rays.shapes import Placed, Shape, World
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ..design.made_workspaces import look_down, open_bare_ground
from ..learning.grounds import GROUND, Ground, make_shading_tables

#: Width, in metres, of the border of the patch on which nothing is dug. The ground's own triangles, up to 4 cm wide
#: within 3 m of the lander, overlap the patch there.
_BORDER_M = 0.06


def open_series(ground: Ground, settings: Settings, seed: int) -> ExcavationSeries:
    """Open the states of the excavation of ``settings`` in a ground without rocks; the first is the undisturbed ground.

    Raises IcyMoonError if the excavation cannot be dug.
    """
    site = make_site(settings)
    west, south, east, north = site.grid.bounds_m
    cell = site.grid.cell_m
    wider = make_covering_grid(west - _BORDER_M, south - _BORDER_M, east + _BORDER_M, north + _BORDER_M, cell)
    return ExcavationSeries(replace(site, grid=wider), settings.excavation, seed, _measure_heights(ground, wider))


def _measure_heights(ground: Ground, grid: ExcavationGrid) -> Array:
    """Measure the heights (rows, columns), m, of the ground without its rocks at the vertices of a grid."""
    x, y = (each.ravel() for each in np.meshgrid(grid.east_m, grid.north_m))
    with open_bare_ground(ground) as bare:
        return look_down(bare, x, y).reshape(grid.rows, grid.columns)


def dig_ground(untouched: Ground, series: ExcavationSeries, state: int) -> Ground:
    """Make the ground in a state of an excavation, with a new tracer. Rocks do not move."""
    own, *others = untouched.world.placed
    shape = _join_patch(own.shape, series.site.grid, series.at(state).layers.top)
    world = World([Placed(shape, own.places, own.numbers), *others])
    return replace(untouched, world=world, tracer=open_tracer(world), shading=make_shading_tables(world))


def _join_patch(shape: Shape, grid: ExcavationGrid, top_m: Array) -> Shape:
    """Join the ground's triangles outside a grid with the triangles of the grid at heights (rows, columns), m.

    A triangle that crosses the border of the grid stays, so that there is no gap.
    """
    west, south, east, north = grid.bounds_m
    x, y = shape.vertices[:, 0], shape.vertices[:, 1]
    inside = (x > west) & (x < east) & (y > south) & (y < north)
    kept = shape.triangles[~inside[shape.triangles].all(axis=1)]
    across, along = np.meshgrid(grid.east_m, grid.north_m)
    patch = np.stack([across.ravel(), along.ravel(), top_m.ravel()], axis=1).astype(np.float32)
    triangles = np.concatenate([kept, _list_triangles(grid) + len(shape.vertices)]).astype(np.uint32)
    count = len(triangles)
    return Shape(
        np.concatenate([shape.vertices, patch]), triangles, np.ones(count, bool), np.full(count, GROUND, np.uint8)
    )


def _list_triangles(grid: ExcavationGrid) -> Array:
    """List the triangles (n, 3) of a grid's vertices, counter-clockwise from above."""
    corner = np.arange(grid.rows * grid.columns).reshape(grid.rows, grid.columns)
    a, b, c, d = (each.ravel() for each in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])

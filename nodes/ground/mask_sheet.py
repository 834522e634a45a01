"""The sheet that a user paints masks on: a grid of vertices over the patch, with a vertex group for each mask.

It lies on the built ground but is a separate object, so a new build of the ground keeps it and its weights. Each vertex
is the centre of a pixel, so the weights are the mask, without interpolation. The sheet is the user's own object: it is
not rendered, and no pair depends on it.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...physics.rocks.painted_mask import PaintedMask, find_pixel_centres
from ...support.arrays import Array
from ..datablocks.fingerprint import NAME
from .heights_under import probe_heights

#: Vertices along a side.
SIDE = 256
#: Custom property of the sheet.
_MARK = "icymoon_mask_sheet"
#: Height above the highest ground around a vertex, in vertex spacings.
_LIFT = 0.25


def find_sheet(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Find the sheet of a scene; None without a sheet, or if the number of its vertices was changed by hand."""
    items = (item for item in scene.objects if _MARK in item and item.type == "MESH")
    return next((item for item in items if len(item.data.vertices) == SIDE**2), None)


def lay_sheet(scene: bpy.types.Scene, ground: bpy.types.Object, size_m: float) -> bpy.types.Object:
    """Lay the sheet of a scene on a ground, over the square with sides of ``size_m`` metres about the origin. An
    existing sheet keeps its weights."""
    sheet = find_sheet(scene)
    if sheet is None:
        sheet = bpy.data.objects.new(f"{NAME} Masks", _make_grid())
        sheet[_MARK], sheet.hide_render = True, True
        scene.collection.objects.link(sheet)
    x_m, y_m = find_pixel_centres(size_m, SIDE)
    with probe_heights(ground) as height_at:
        heights = height_at(x_m, y_m)
    heights = np.where(np.isnan(heights), np.nanmin(heights) if np.isfinite(heights).any() else 0.0, heights)
    z_m = _find_highest(heights) + _LIFT * size_m / SIDE
    places = np.stack([x_m, y_m, z_m], axis=-1).astype(np.float32)
    sheet.data.vertices.foreach_set("co", places.ravel())
    sheet.data.update()
    return sheet


def _make_grid() -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(f"{NAME} Masks")
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()  # upper left ones
    faces = np.stack([corner, corner + SIDE, corner + SIDE + 1, corner + 1], axis=1)
    mesh.from_pydata(np.zeros((SIDE**2, 3)), [], faces)
    return mesh


def _find_highest(heights: Array) -> Array:
    """Return, for each value of an array (n, n), the maximum of the value and its neighbours."""
    padded = np.pad(heights, 1, mode="edge")
    n = len(heights)
    return np.max([padded[i : i + n, j : j + n] for i in range(3) for j in range(3)], axis=0)


def read_shares(sheet: bpy.types.Object, group: str) -> Array:
    """Read the weights (SIDE, SIDE) of a vertex group, north first; 0 where a vertex is not in it."""
    index = sheet.vertex_groups[group].index
    shares = np.zeros(SIDE**2)
    for k, vertex in enumerate(sheet.data.vertices):
        for each in vertex.groups:
            if each.group == index:
                shares[k] = each.weight
    return shares.reshape(SIDE, SIDE)


def make_group(sheet: bpy.types.Object, group: str, mask: Array | None) -> None:
    """Make a vertex group active. A new group gets the values of a mask (rows, columns), or 0 without a mask."""
    found = sheet.vertex_groups.get(group)
    if found is None:
        found = sheet.vertex_groups.new(name=group)
        if mask is not None:
            for k, share in enumerate(PaintedMask(mask, 1.0).shares(*find_pixel_centres(1.0, SIDE)).ravel()):
                if share > 0:
                    found.add([k], float(share), "REPLACE")
    sheet.vertex_groups.active_index = found.index


def remove_group(sheet: bpy.types.Object, group: str) -> None:
    """Remove a vertex group, and the sheet together with its last group."""
    if found := sheet.vertex_groups.get(group):
        sheet.vertex_groups.remove(found)
    if not sheet.vertex_groups:
        mesh = sheet.data
        bpy.data.objects.remove(sheet)
        bpy.data.meshes.remove(mesh)

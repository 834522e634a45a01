"""Maps a built scene from straight above, as Cycles renders it: heights and albedo on square cells, north up.

An orthographic camera looks down and takes one sample at the centre of each cell. So heights include rocks and relief
that moves vertices, and nothing is blended at edges.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ..formats.exr_layout import is_whole
from ..formats.exr_pixels import decode_parts
from ..nodes.build_scene import Built
from ..nodes.datablocks.fingerprint import TAG, find_instanced_objects
from ..nodes.ground.user_ground import is_from_file
from ..nodes.lander.objects import ROLES as LANDER_ROLES
from ..nodes.surface.ground_and_rock_materials import build_ground_material, build_rock_material
from ..nodes.surface.sun_inputs import prepare_for_cycles
from ..rays.shapes import World
from ..rays.stereo_truth import list_squares
from ..rays.surface import Tracer, find_surface
from ..settings.user_files import has_surroundings
from ..support import system
from ..support.arrays import Array
from ..support.errors import IcyMoonError, find_first_line
from ..support.foreign_bytes import OverBudgetError
from ..support.labels import ALBEDO_AOV, ROCK, SALT_AOV, SKY_DEPTH_M, SKY_TAGS, TERRAIN, TRUTH
from . import cycles_settings, passes, separate_lights
from .pairs.workspace_cells import MAX_CELLS, PLACES_PER_SIDE, Extent
from .ray_stage import SceneRays
from .render_camera import SAMPLE_OFFSET_PX

#: Default number of cells along the longer side.
DEFAULT_CELLS = 1024
#: Height of the camera above the highest point, m.
_CAMERA_CLEARANCE_M = 1.0
_DOWN = np.array([0.0, 0.0, -1.0])
#: Tags of the objects that count as ground or rocks.
_GROUND_AND_ROCKS = ("terrain", "rock", "rock shape")


@dataclass(frozen=True)
class GroundMap:
    """A map of a site, (rows, columns), north first, NaN for unknown cells.

    ``ground_m`` are heights of the ground, ``surface_m`` of the top surface, rocks included, both above the z = 0 of
    the site's frame; ``albedo`` (rows, columns, 3) is of ground and rocks in even light, in the bands R, G, B.
    """

    extent: Extent
    ground_m: Array
    surface_m: Array
    albedo: Array


def find_extent(built: Built, cell_m: float | None) -> Extent:
    """Find the cells that cover a ground: its patch, or the bounding box of a ground from a file without surroundings.

    Raises IcyMoonError for more than ``MAX_CELLS`` cells along a side.
    """
    if is_from_file(built.settings) and not has_surroundings(built.settings):
        corners = np.array(built.terrain.bound_box) @ np.array(built.terrain.matrix_world)[:3, :3].T
        corners = corners + np.array(built.terrain.matrix_world)[:3, 3]
        (west, south), (east, north) = corners.min(axis=0)[:2], corners.max(axis=0)[:2]
    else:
        half = built.settings.terrain.size_m / 2
        west, south, east, north = -half, -half, half, half
    width, height = east - west, north - south
    cell = cell_m or max(width, height) / DEFAULT_CELLS
    # An excess below a millionth of a cell adds no cell.
    columns, rows = (max(1, int(np.ceil(side / cell - 1e-6))) for side in (width, height))
    if max(columns, rows) > MAX_CELLS:
        raise IcyMoonError(
            f"Cells of {cell:g} m are {columns} x {rows} on this ground, more than {MAX_CELLS} along a "
            f"side; give {max(width, height) / MAX_CELLS:.3g} m or more."
        )
    middle_x, middle_y = (west + east) / 2, (south + north) / 2
    return Extent(float(cell), rows, columns, float(middle_x - columns * cell / 2), float(middle_y + rows * cell / 2))


def make_heights(rays: SceneRays, extent: Extent) -> Array:
    """Make the heights, float32 (2, rows, columns), of the ground with rocks and of the ground alone, in metres of the
    site's frame.

    The height of a cell is the median at 3 x 3 points in it, as matchers' points are gridded by medians too. Other
    objects, such as a lander, do not count.
    """
    fine = replace(
        extent,
        cell_m=extent.cell_m / PLACES_PER_SIDE,
        rows=PLACES_PER_SIDE * extent.rows,
        columns=PLACES_PER_SIDE * extent.columns,
    )
    made = []
    for rocks in (True, False):
        with rays.open_ground(rocks) as (world, tracer):
            made.append(_median_by_cell(_find_heights(world, tracer, fine)))
    return np.stack(made).astype(np.float32)


def _find_heights(world: World, tracer: Tracer, extent: Extent) -> Array:
    """Find the heights (rows, columns) of the highest surface of a world at the centres of cells; NaN without a
    surface."""
    top_m = world.highest_m() + _CAMERA_CLEARANCE_M
    heights = np.full(extent.rows * extent.columns, np.nan)
    for cells in list_squares(extent.rows, extent.columns):
        row, column = np.divmod(cells, extent.columns)
        start = np.stack(
            [
                extent.west_m + (column + 0.5) * extent.cell_m,
                extent.north_m - (row + 0.5) * extent.cell_m,
                np.full(len(cells), top_m),
            ],
            axis=1,
        )
        down = np.broadcast_to(_DOWN, start.shape)
        met = find_surface(world, tracer.intersect(start, down, 0.0, np.inf), start, down)
        heights[cells] = np.where(np.isinf(met.along), np.nan, top_m - met.along)
    return heights.reshape(extent.rows, extent.columns)


def _median_by_cell(height_m: Array) -> Array:
    """Compute the medians of squares of ``PLACES_PER_SIDE`` rows and columns; NaN where one of the heights is
    unknown."""
    rows, columns = (count // PLACES_PER_SIDE for count in height_m.shape)
    squares = height_m.reshape(rows, PLACES_PER_SIDE, columns, PLACES_PER_SIDE).swapaxes(1, 2)
    return np.asarray(np.median(squares.reshape(rows, columns, -1), axis=2))


@contextmanager
def _hide_from_renders(items: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Hide objects from renders until the end of the ``with`` block."""
    shown = [item for item in items if not item.hide_render]
    for item in shown:
        item.hide_render = True
    try:
        yield
    finally:
        for item in shown:
            item.hide_render = False


def make_ground_map(built: Built, scene: bpy.types.Scene, folder: Path, cell_m: float | None = None) -> GroundMap:
    """Make the map of a built scene that ``scene`` renders, without its lander. Temporary images are in ``folder``.

    Raises IcyMoonError for cells that are too small, and if Cycles fails.
    """
    extent = find_extent(built, cell_m)
    lander = [item for item in built.collection.all_objects if item.get(TAG) in LANDER_ROLES.values()]
    with _open_view_from_above(built, scene, extent, {ALBEDO_AOV: "COLOR"}) as top_m, _hide_from_renders(lander):
        whole = _render_cells(scene, folder / "ground_map")
        surface = _depth_to_heights(whole, top_m)
        rocks = [item for item in built.collection.all_objects if item.get(TAG) == "rock" and not item.hide_render]
        with _hide_from_renders(rocks):
            ground = _depth_to_heights(_render_cells(scene, folder / "ground_map"), top_m) if rocks else surface
    albedo = np.stack(_find_pass_channels(whole, ALBEDO_AOV), axis=-1)
    return GroundMap(extent, ground, surface, _mask_other_objects(whole, albedo, top_m))


def make_materials(built: Built, scene: bpy.types.Scene, folder: Path, extent: Extent) -> Array:
    """Make a map of the materials on top of the cells, float32 (4, rows, columns), at the centres of cells: albedo in
    even light in the bands R, G, B, and share of salt. NaN where there is neither ground nor rock.

    A temporary image is in ``folder``. Raises IcyMoonError if Cycles fails.
    """
    others = [item for item in built.collection.all_objects if item.get(TAG) not in _GROUND_AND_ROCKS]
    with (
        _open_view_from_above(built, scene, extent, {ALBEDO_AOV: "COLOR", SALT_AOV: "VALUE"}) as top_m,
        _hide_from_renders([item for item in others if item.type != "CAMERA"]),
    ):
        found = _render_cells(scene, folder / "materials")
    values = np.stack([*_find_pass_channels(found, ALBEDO_AOV), *_find_pass_channels(found, SALT_AOV)], axis=-1)
    return np.moveaxis(_mask_other_objects(found, values, top_m), -1, 0)


@contextmanager
def _open_view_from_above(
    built: Built, scene: bpy.types.Scene, extent: Extent, aovs: Mapping[str, str]
) -> Iterator[float]:
    """Let ``scene`` render a map from above with value passes (name to type), and yield the height of its camera, m."""
    cycles_settings.apply_quality(scene, built.settings.quality, 0)
    layer = scene.view_layers[0]
    for name, kind in aovs.items():
        made = layer.aovs.add()
        made.name, made.type = name, kind
    top_m = _find_top_m(scene) + _CAMERA_CLEARANCE_M
    with _use_albedo_materials(built), _look_down(scene, extent, top_m), _disable_osl(scene, built):
        yield top_m
    for name in aovs:
        layer.aovs.remove(layer.aovs[name])


def _mask_other_objects(channels: dict[str, Array], values: Array, top_m: float) -> Array:
    """Return the float32 ``values`` (rows, columns, n) of a map where it shows ground or rocks; NaN elsewhere."""
    label = np.rint(_find_pass_channels(channels, "Material Index", "IndexMA")[0])
    ours = np.isin(label, (TERRAIN, ROCK)) & np.isfinite(_depth_to_heights(channels, top_m))
    return np.where(ours[..., None], values, np.nan).astype(np.float32)


@contextmanager
def _disable_osl(scene: bpy.types.Scene, built: Built) -> Iterator[None]:
    """Switch Open Shading Language off until the end of the ``with`` block, because Cycles writes no value passes with
    it.
    """
    prepare_for_cycles(scene, built.materials, built.sun, built.planetshine, built.lamps)
    with separate_lights.disable_osl(scene):
        yield


def _find_top_m(scene: bpy.types.Scene) -> float:
    """Find the height, m, of the highest corner of the bounding boxes of the site's meshes."""
    scene.view_layers[0].update()
    tops = [0.0]
    for found in scene.view_layers[0].depsgraph.object_instances:
        item = found.object
        far = item.original.get(TAG) in SKY_TAGS
        if item.type == "MESH" and len(item.data.polygons) and not far:
            matrix = np.array(found.matrix_world)
            tops.append(float((np.array(item.bound_box) @ matrix[2, :3]).max() + matrix[2, 3]))
    # Relief of a material may rise above the box.
    return max(tops) + 1.0


@contextmanager
def _use_albedo_materials(built: Built) -> Iterator[None]:
    """Give ground and rocks materials that write ``ALBEDO_AOV``, until the end of the ``with`` block."""
    ground, settings = built.terrain.data, built.settings
    lent: list[tuple[bpy.types.Mesh, bpy.types.Material]] = []
    made: list[bpy.types.Material] = []

    def set_material(mesh: bpy.types.Mesh, material: bpy.types.Material) -> None:
        lent.append((mesh, mesh.materials[0]))
        mesh.materials[0] = material

    try:
        made.append(build_ground_material(settings, ground, albedo_pass=True))
        set_material(ground, made[0])
        rocks = [item for item in built.collection.all_objects if item.get(TAG) == "rock"]
        if rocks:
            made.append(build_rock_material(settings, ground, albedo_pass=True))
        meshes = {
            each.data
            for item in rocks
            for each in find_instanced_objects(item)
            if isinstance(each.data, bpy.types.Mesh) and len(each.data.materials)
        }
        for mesh in meshes:
            set_material(mesh, made[1])
        yield
    finally:
        for mesh, material in lent:
            mesh.materials[0] = material
        for material in made:
            bpy.data.materials.remove(material)


@contextmanager
def _look_down(scene: bpy.types.Scene, extent: Extent, top_m: float) -> Iterator[None]:
    """Turn the camera of ``scene`` straight down on the map, north up, at the height ``top_m``, until the end of the
    ``with`` block.
    """
    item, render = scene.camera, scene.render
    lens = item.data
    lens.type, lens.sensor_fit, lens.dof.use_dof = "ORTHO", "AUTO", False
    longest = max(extent.columns, extent.rows)
    lens.ortho_scale = longest * extent.cell_m
    lens.shift_x = lens.shift_y = -SAMPLE_OFFSET_PX / longest
    lens.clip_start, lens.clip_end = 1e-4, 1e6
    item.rotation_euler = (0.0, 0.0, 0.0)
    item.location = (
        extent.west_m + extent.columns * extent.cell_m / 2,
        extent.north_m - extent.rows * extent.cell_m / 2,
        top_m,
    )
    render.resolution_x, render.resolution_y = extent.columns, extent.rows
    render.use_multiview = render.use_persistent_data = False
    try:
        yield
    finally:
        render.use_multiview = True


def _render_cells(scene: bpy.types.Scene, stem: Path) -> dict[str, Array]:
    """Render one sample at the centre of each cell, and return the channels (rows, columns) by name."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    passes.choose_layer(scene, TRUTH, stem, "FULL")
    file = stem.with_name(f"{stem.name}.exr")
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        raise IcyMoonError(f"Cycles could not render the map: {find_first_line(error)}") from None
    if not is_whole(file):
        raise IcyMoonError(
            f"Blender could not write the map to {file}: the disk is full, or you may not write to the folder; free "
            "some space or choose another folder."
        )
    try:
        return {name: values for _, channels in decode_parts(file.read_bytes()) for name, values in channels.items()}
    except (ValueError, KeyError, OverBudgetError) as error:
        raise IcyMoonError(f"The map that Blender wrote cannot be read ({error}); write it again.") from None
    finally:
        system.remove(file)


def _find_pass_channels(channels: dict[str, Array], *names: str) -> list[Array]:
    """Find the channels of a pass under any of its names, which differ between versions of Blender. They are R, G, B,
    or one channel."""
    found = {key: values for key, values in channels.items() if key.split(".")[-2] in names}
    if not found:
        raise IcyMoonError(f"The map that Blender wrote has no pass {names[0]}; write it again.")
    components = {key.split(".")[-1]: values for key, values in found.items()}
    return [components[key] for key in "RGB"] if "R" in components else list(components.values())


def _depth_to_heights(channels: dict[str, Array], top_m: float) -> Array:
    depth = _find_pass_channels(channels, "Depth")[0].astype(np.float64)
    return np.where((depth > 0) & (depth < SKY_DEPTH_M), top_m - depth, np.nan).astype(np.float32)

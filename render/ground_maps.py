"""Maps of a built scene from straight above, as Cycles gets it: heights and albedo on square cells, north up.

An orthographic camera looks down on the ground and takes one sample at the centre of each cell, so relief that moves
vertices and the shapes of rocks are in the heights, and nothing is blended at edges.
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
from ..support import system
from ..support.arrays import Array
from ..support.errors import IcyMoonError, first_line
from ..support.foreign_bytes import OverBudgetError
from ..support.labels import ALBEDO_AOV, ROCK, SALT_AOV, SKY_DEPTH_M, TERRAIN, TRUTH
from . import cycles_settings, passes, separate_lights
from .pairs.workspace_cells import MOST_CELLS, PLACES, Extent
from .render_camera import SAMPLE_OFFSET_PX
from .traced_triangles import SceneRays

#: Cells along the longer side if none are asked for.
CELLS = 1024
#: From the highest point to the camera, in metres.
_ABOVE_M = 1.0
_DOWN = np.array([0.0, 0.0, -1.0])
#: Tags of the objects that are ground or rocks.
_GROUND_AND_ROCKS = ("terrain", "rock", "rock shape")


@dataclass(frozen=True)
class GroundMap:
    """A map of a site, (rows, columns), north first, NaN where there is nothing.

    ``ground_m`` are heights of the ground, ``surface_m`` of the top surface, rocks included, both above the z = 0 of
    the site's frame; ``albedo`` (rows, columns, 3) is of ground and rocks in even light, in the bands R, G, B.
    """

    extent: Extent
    ground_m: Array
    surface_m: Array
    albedo: Array


def find_extent(built: Built, cell_m: float | None) -> Extent:
    """The cells that cover a ground: its patch, or the bounding box of a ground from a file.

    Raises IcyMoonError for more than ``MOST_CELLS`` along a side.
    """
    if is_from_file(built.settings):
        corners = np.array(built.terrain.bound_box) @ np.array(built.terrain.matrix_world)[:3, :3].T
        corners = corners + np.array(built.terrain.matrix_world)[:3, 3]
        (west, south), (east, north) = corners.min(axis=0)[:2], corners.max(axis=0)[:2]
    else:
        half = built.settings.terrain.size_m / 2
        west, south, east, north = -half, -half, half, half
    width, height = east - west, north - south
    cell = cell_m or max(width, height) / CELLS
    # An excess of less than a millionth of a cell adds no further cell.
    columns, rows = (max(1, int(np.ceil(side / cell - 1e-6))) for side in (width, height))
    if max(columns, rows) > MOST_CELLS:
        raise IcyMoonError(
            f"Cells of {cell:g} m are {columns} x {rows} on this ground, more than {MOST_CELLS} along a "
            f"side; give {max(width, height) / MOST_CELLS:.3g} m or more."
        )
    middle_x, middle_y = (west + east) / 2, (south + north) / 2
    return Extent(float(cell), rows, columns, float(middle_x - columns * cell / 2), float(middle_y + rows * cell / 2))


def make_heights(rays: SceneRays, extent: Extent) -> Array:
    """Heights, float32 (2, rows, columns), of the ground with rocks and of the ground alone, in the site's frame.

    A height is the median of the heights at 3 x 3 places of its cell, as matchers' points are gridded by medians. Other
    objects, such as a lander, are left out.
    """
    fine = replace(extent, cell_m=extent.cell_m / PLACES, rows=PLACES * extent.rows, columns=PLACES * extent.columns)
    made = []
    for rocks in (True, False):
        with rays.ground(rocks) as (world, tracer):
            made.append(_median_by_cell(_find_heights(world, tracer, fine)))
    return np.stack(made).astype(np.float32)


def _find_heights(world: World, tracer: Tracer, extent: Extent) -> Array:
    """Heights (rows, columns) of the highest of a world at the centres of cells, NaN where there is nothing."""
    top_m = world.highest_m() + _ABOVE_M
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
    """The medians of squares of ``PLACES`` rows and columns, NaN where a part is not known."""
    rows, columns = (count // PLACES for count in height_m.shape)
    squares = height_m.reshape(rows, PLACES, columns, PLACES).swapaxes(1, 2)
    return np.asarray(np.median(squares.reshape(rows, columns, -1), axis=2))


@contextmanager
def _hide_objects(items: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Renders do not show these objects."""
    shown = [item for item in items if not item.hide_render]
    for item in shown:
        item.hide_render = True
    try:
        yield
    finally:
        for item in shown:
            item.hide_render = False


def make_ground_map(built: Built, scene: bpy.types.Scene, folder: Path, cell_m: float | None = None) -> GroundMap:
    """The map of a built scene that ``scene`` renders, without its lander; images are written to ``folder`` meanwhile.

    Raises IcyMoonError for cells that are too small, and where Cycles fails.
    """
    extent = find_extent(built, cell_m)
    lander = [item for item in built.collection.all_objects if item.get(TAG) in LANDER_ROLES.values()]
    with _from_above(built, scene, extent, {ALBEDO_AOV: "COLOR"}) as top_m, _hide_objects(lander):
        whole = _render_cells(scene, folder / "ground_map")
        surface = _depth_to_heights(whole, top_m)
        rocks = [item for item in built.collection.all_objects if item.get(TAG) == "rock" and not item.hide_render]
        with _hide_objects(rocks):
            ground = _depth_to_heights(_render_cells(scene, folder / "ground_map"), top_m) if rocks else surface
    albedo = np.stack(_find_pass(whole, ALBEDO_AOV), axis=-1)
    return GroundMap(extent, ground, surface, _of_ground(whole, albedo, top_m))


def make_materials(built: Built, scene: bpy.types.Scene, folder: Path, extent: Extent) -> Array:
    """What lies on top in the cells, float32 (4, rows, columns): the albedo in even light in the bands R, G, B, and the
    share of salt, of ground and rocks at the centres of cells; NaN where there is neither. Other objects are left out.

    An image is written to ``folder`` meanwhile. Raises IcyMoonError where Cycles fails.
    """
    others = [item for item in built.collection.all_objects if item.get(TAG) not in _GROUND_AND_ROCKS]
    with (
        _from_above(built, scene, extent, {ALBEDO_AOV: "COLOR", SALT_AOV: "VALUE"}) as top_m,
        _hide_objects([item for item in others if item.type != "CAMERA"]),
    ):
        found = _render_cells(scene, folder / "materials")
    values = np.stack([*_find_pass(found, ALBEDO_AOV), *_find_pass(found, SALT_AOV)], axis=-1)
    return np.moveaxis(_of_ground(found, values, top_m), -1, 0)


@contextmanager
def _from_above(built: Built, scene: bpy.types.Scene, extent: Extent, aovs: Mapping[str, str]) -> Iterator[float]:
    """``scene`` renders a map with these value passes, by their types; the height of its camera in metres."""
    cycles_settings.apply_quality(scene, built.settings.quality, 0)
    layer = scene.view_layers[0]
    for name, kind in aovs.items():
        made = layer.aovs.add()
        made.name, made.type = name, kind
    top_m = _find_top_m(scene) + _ABOVE_M
    with _use_albedo_materials(built), _look_down(scene, extent, top_m), _disable_osl(scene, built):
        yield top_m
    for name in aovs:
        layer.aovs.remove(layer.aovs[name])


def _of_ground(channels: dict[str, Array], values: Array, top_m: float) -> Array:
    """float32 ``values`` (rows, columns, n) of a map where it shows ground or rocks, elsewhere NaN."""
    label = np.rint(_find_pass(channels, "Material Index", "IndexMA")[0])
    ours = np.isin(label, (TERRAIN, ROCK)) & np.isfinite(_depth_to_heights(channels, top_m))
    return np.where(ours[..., None], values, np.nan).astype(np.float32)


@contextmanager
def _disable_osl(scene: bpy.types.Scene, built: Built) -> Iterator[None]:
    """Value passes are written, which Cycles does not do with Open Shading Language."""
    prepare_for_cycles(scene, built.materials, built.sun, built.planetshine)
    with separate_lights.disable_osl(scene):
        yield


def _find_top_m(scene: bpy.types.Scene) -> float:
    """Height of the highest corner of a box around a mesh of the site."""
    scene.view_layers[0].update()
    tops = [0.0]
    for found in scene.view_layers[0].depsgraph.object_instances:
        item = found.object
        far = item.original.get(TAG) in ("planet", "rings", "stars")
        if item.type == "MESH" and len(item.data.polygons) and not far:
            matrix = np.array(found.matrix_world)
            tops.append(float((np.array(item.bound_box) @ matrix[2, :3]).max() + matrix[2, 3]))
    # Relief of a material may rise above the box.
    return max(tops) + 1.0


@contextmanager
def _use_albedo_materials(built: Built) -> Iterator[None]:
    """Ground and rocks have materials that write ``ALBEDO_AOV``."""
    ground, settings = built.terrain.data, built.settings
    lent: list[tuple[bpy.types.Mesh, bpy.types.Material]] = []
    made: list[bpy.types.Material] = []

    def lend(mesh: bpy.types.Mesh, material: bpy.types.Material) -> None:
        lent.append((mesh, mesh.materials[0]))
        mesh.materials[0] = material

    try:
        made.append(build_ground_material(settings, ground, albedo_pass=True))
        lend(ground, made[0])
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
            lend(mesh, made[1])
        yield
    finally:
        for mesh, material in lent:
            mesh.materials[0] = material
        for material in made:
            bpy.data.materials.remove(material)


@contextmanager
def _look_down(scene: bpy.types.Scene, extent: Extent, top_m: float) -> Iterator[None]:
    """The camera of ``scene`` looks straight down on the map, north up, from the height ``top_m``."""
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
    """The channels, (rows, columns), of a render of one sample at the centres of cells."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    passes.choose_layer(scene, TRUTH, stem, "FULL")
    file = stem.with_name(f"{stem.name}.exr")
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        raise IcyMoonError(f"Cycles could not render the map: {first_line(error)}") from None
    if not is_whole(file):
        raise IcyMoonError(
            f"Blender could not write the map to {file}; the disk is full or the folder may not be written to."
        )
    try:
        return {name: values for _, channels in decode_parts(file.read_bytes()) for name, values in channels.items()}
    except (ValueError, KeyError, OverBudgetError) as error:
        raise IcyMoonError(f"The map that Blender wrote cannot be read ({error}); write it again.") from None
    finally:
        system.remove(file)


def _find_pass(channels: dict[str, Array], *names: str) -> list[Array]:
    """The channels of a pass, which has another name in each version, in the order R, G, B, or the only one."""
    found = {key: values for key, values in channels.items() if key.split(".")[-2] in names}
    if not found:
        raise IcyMoonError(f"The map that Blender wrote has no pass {names[0]}; write it again.")
    components = {key.split(".")[-1]: values for key, values in found.items()}
    return [components[key] for key in "RGB"] if "R" in components else list(components.values())


def _depth_to_heights(channels: dict[str, Array], top_m: float) -> Array:
    depth = _find_pass(channels, "Depth")[0].astype(np.float64)
    return np.where((depth > 0) & (depth < SKY_DEPTH_M), top_m - depth, np.nan).astype(np.float32)

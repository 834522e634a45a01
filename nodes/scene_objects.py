"""Makes the objects of a scene from its settings, before they replace earlier objects."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from ..physics import scene_checks
from ..physics.camera import blur
from ..physics.camera.depth_accuracy import advise_on_rounding
from ..physics.excavation.camera_jitter import jitter_rig
from ..physics.excavation.unsupported_rocks import settle_rocks
from ..physics.light.sky_over_map import find_sky_place, warn_sky_of_another_site
from ..physics.mesh.finer_in_view import advise_on_displacement, nearest_ground_m
from ..physics.mesh.graded_mesh import GradedGround
from ..physics.mesh.ground_interface import Surface
from ..physics.mesh.heights_on_mesh import SurroundedGround
from ..physics.rig.focal_length import focal_px
from ..physics.rocks.beyond_patch import ViewBeyond, make_view_beyond
from ..physics.rocks.own_rock import find_rock_shapes
from ..physics.rocks.place_rocks import Rocks, scatter_rocks
from ..physics.rocks.rock_table import TABLE, read_rock_table
from ..physics.terrain.skirts import advise_on_skirts
from ..physics.terrain.terrain import Terrain, advise_on_terrain, make_terrain
from ..settings.topics.camera import RigSettings
from ..settings.topics.rocks import RocksSettings
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.labels import TERRAIN_INSTANCE
from ..support.number_text import format_count
from .datablocks.blend_file_paths import make_paths_absolute
from .datablocks.fingerprint import NAME, TAG
from .ground.dug_ground import DugGround, mesh_whole_ground
from .ground.heights_under import probe_heights
from .ground.rocks import build_rocks
from .ground.terrain_mesh import (
    MeshedGround,
    compute_vertex_spacing_m,
    site_wavelength_m,
)
from .ground.user_ground import UserGround, is_from_file, load_ground
from .head_cameras import build_head_cameras
from .lander.contact import find_contact
from .lander.objects import build_lander
from .light.scene_lights import advise_on_sky as light_advice
from .light.scene_lights import build_lights, compute_scene_sky
from .light.sun_lamp import build_sky
from .remove_objects import remove_unused
from .rig import build_rig
from .surface import ground_and_rock_materials, reflectance_laws
from .surface.ground_and_rock_materials import build_ground_material, build_rock_material
from .surface.patches_and_grain import mark_elevation


@dataclass
class MadeObjects:
    """The parts of a scene, before they are in a collection."""

    objects: list[bpy.types.Object]  # the terrain, the Sun, the camera, then others
    sky: bpy.types.World
    own: UserGround | None  # the user's own ground
    site_m: float  # height of the ground under the camera
    warnings: list[str] = field(default_factory=list)
    excavation: dict[str, Any] = field(default_factory=dict)  # its report
    #: The record of a build that another process has made, see ``stored_build``.
    record: dict[str, Any] = field(default_factory=dict)
    coarse: bool = False  # whether the ground is the coarse one of a preview


def mark_as_built(block: bpy.types.ID, role: str) -> bpy.types.ID:
    """Mark a data-block as ours, in a role."""
    block[TAG] = role
    return block


def make_ground(settings: Settings) -> Terrain:
    """The height function of the procedural ground."""
    # Files of rocks are read for their skirts.
    found = make_paths_absolute(settings) if settings.rocks.skirt > 0 else settings
    return make_terrain(found, int(settings.dataset.seed))


def read_stated_ground_m(rig: RigSettings) -> float:
    """Height in metres of the ground under a left camera, from its stated heights above zero and above the ground."""
    return float(rig.z_m) - float(rig.height_m)


def find_site_ground_m(settings: Settings, ground: Surface) -> float:
    """Height in metres of the ground under the left camera, with the detail of the mesh; NaN outside the ground.

    For a camera whose height is stated, use ``read_stated_ground_m``.
    """
    rig = settings.rig
    if rig.height_from == "ZERO":
        return read_stated_ground_m(rig)
    return float(ground.heights(rig.x_m, rig.y_m, site_wavelength_m(settings.terrain, ground)))


def make_objects(settings: Settings, meshed: MeshedGround | None) -> MadeObjects:
    """Make all objects of the scene and its world. ``meshed`` is the procedural ground, if it has been made already.

    Raises IcyMoonError, before anything is made, for settings that cannot be built.
    """
    if reasons := scene_checks.find_reasons_in_settings(settings):
        raise IcyMoonError(" ".join(reasons))
    hapke_warnings = reflectance_laws.advise_on_hapke(settings)
    sky = compute_scene_sky(settings)
    own = load_ground(settings, make_ground) if is_from_file(settings) else None
    ground_and_rock_materials.refuse_without_uv(settings, own is not None and own.uv is not None)
    ground = own or meshed or mesh_whole_ground(make_ground, settings)
    site_m, warnings = _find_site(settings, ground.surface, own)
    warnings += [
        *hapke_warnings,
        *advise_on_rounding(settings.rig, site_m),
        *scene_checks.advise_on_scene(settings),
        *_advise_on_ground(settings, ground.surface, own),
    ]
    terrain = _make_terrain(settings, ground, warnings)
    camera = mark_as_built(build_rig(f"{NAME} Camera", jitter_rig(settings), site_m), "camera")
    others = build_head_cameras(settings, camera, terrain)
    lights = build_lights(settings, sky, camera)
    warnings += [*light_advice(sky, settings), *blur.advise_on_blur(settings)]
    space = mark_as_built(build_sky(f"{NAME} Sky"), "sky")
    made = MadeObjects([terrain, lights[0], camera, *lights[1:]], space, own, site_m, warnings)
    made.coarse = isinstance(ground, MeshedGround) and ground.most_rocks is not None
    _add_rocks_and_lander(made, settings, ground)
    made.objects += others
    return made


def _advise_on_ground(settings: Settings, ground: Surface, own: UserGround | None) -> list[str]:
    if own is None:
        return [
            *advise_on_terrain(settings, site_wavelength_m(settings.terrain, ground)),
            *(ground.advice(settings) if isinstance(ground, GradedGround) else []),
        ]
    if settings.rocks.coverage > 0:
        scene_checks.refuse_no_rocks(settings.rocks, ground.size_m, "source.file")
    said = [*own.warnings, *advise_on_skirts(settings)]
    if find_sky_place(settings, own.map_place):
        return said
    return [*said, *warn_sky_of_another_site(settings.light, own.map_place)]


def _make_terrain(settings: Settings, made: MeshedGround | UserGround, warnings: list[str]) -> bpy.types.Object:
    """The object of the ground with its material; adds to the ``warnings``."""
    ground = made.surface
    mesh = made.build_mesh(f"{NAME} Terrain")
    mark_elevation(
        mesh, settings.surface, ground.drop_m if isinstance(ground, GradedGround | SurroundedGround) else None
    )
    warnings += ground_and_rock_materials.advise_on_surfaces(settings)
    warnings += advise_on_displacement(settings, _find_nearest_spacing_m(settings, ground, mesh))
    try:
        mesh.materials.append(build_ground_material(settings, mesh))
    except IcyMoonError:  # an image that cannot be read
        bpy.data.meshes.remove(mesh)
        raise
    warnings += ground_and_rock_materials.advise_on_images(settings, mesh)
    terrain = mark_as_built(bpy.data.objects.new(f"{NAME} Terrain", mesh), "terrain")
    terrain.pass_index = TERRAIN_INSTANCE
    return terrain


def _add_rocks_and_lander(made: MadeObjects, settings: Settings, ground: MeshedGround | UserGround) -> None:
    """Add rocks, the lander and the report of the excavation."""
    dug, terrain = ground if isinstance(ground, DugGround) else None, made.objects[0]
    if dug is not None and dug.series is not None:
        made.excavation = dug.series.facts(dug.state)
        made.warnings += made.excavation.get("advice", [])
    if settings.rocks.coverage > 0:
        rocks, warnings, moved = _build_rocks(settings, terrain, ground)
        made.objects.append(rocks)
        made.warnings += warnings
        made.excavation |= {"rocks_moved": moved} if dug is not None else {}
    if settings.lander.kind != "NONE":
        made.objects += build_lander(settings, made.site_m, terrain)
        made.warnings += find_contact(settings, made.site_m, terrain).advice()


def _find_site(settings: Settings, ground: Surface, own: UserGround | None) -> tuple[float, list[str]]:
    """Height in metres of the ground under the camera, and a warning if the camera is beside the ground."""
    rig, size = settings.rig, settings.terrain.size_m
    height = find_site_ground_m(settings, ground)
    if own is not None and math.isnan(height):
        return own.find_nearest_height_m(rig.x_m, rig.y_m), [
            "There is no ground under the camera; change rig.x_m or rig.y_m, or move the ground with source.origin_x_m "
            "and source.origin_y_m."
        ]
    if own is None and not isinstance(ground, GradedGround) and max(abs(rig.x_m), abs(rig.y_m)) > size / 2:
        return height, [
            f"The camera is outside the {size:g} m patch of ground; change rig.x_m, rig.y_m or terrain.size_m."
        ]
    return height, []


def _build_rocks(
    settings: Settings, terrain: bpy.types.Object, ground: MeshedGround | UserGround
) -> tuple[bpy.types.Object, list[str], int]:
    """The object whose points are the rocks on the ground, warnings, and the number of rocks that lost support by an
    excavation."""
    seed, wanted, rig = int(settings.dataset.seed), make_paths_absolute(settings).rocks, settings.rig
    shapes = find_rock_shapes(wanted, seed)
    with probe_heights(terrain) as height_at:
        view = make_view_beyond(settings)
        clear = rig.x_m, rig.y_m, wanted.clear_radius_m
        bare, whole, most_seen, moved = height_at, height_at, None, 0
        if isinstance(ground, MeshedGround):
            bare, most_seen = ground.without_skirts(height_at, settings.terrain), ground.most_rocks
            whole = ground.before(height_at)
        rocks = scatter_rocks(wanted, ground.surface.size_m, seed, bare, shapes, clear, view, most_seen, whole)
        if isinstance(ground, DugGround):
            rocks, moved = settle_rocks(rocks, ground.change_m, height_at, shapes)
    ice = build_rock_material(settings, terrain.data)
    item = mark_as_built(build_rocks(f"{NAME} Rock", rocks, shapes, ice, TAG), "rock")
    remove_unused([], [ice])  # it has no users if there are no rocks
    return item, _advise_on_rocks(settings, wanted, rocks, view), moved


def _advise_on_rocks(settings: Settings, wanted: RocksSettings, rocks: Rocks, view: ViewBeyond | None) -> list[str]:
    """Warnings about rocks and debris that are left out; ``wanted`` has an absolute path of its table."""
    warnings, most = list[str](), format_count(wanted.most, "rock")
    if rocks.smallest_m > (0.0 if wanted.law == TABLE else wanted.smallest_m):
        warnings.append(
            f"Rocks under {rocks.smallest_m:.3g} m are left out to keep to {most}; "
            "raise rocks.most or rocks.smallest_m."
        )
    if rocks.debris_smallest_m > wanted.debris_smallest_m:
        warnings.append(
            f"Debris under {rocks.debris_smallest_m:.3g} m is left out to keep to "
            f"{format_count(wanted.debris_most, 'fragment')}; raise rocks.debris_most or rocks.debris_smallest_m."
        )
    if wanted.law == TABLE and (lost := min(len(read_rock_table(Path(wanted.file))), wanted.most) - rocks.debris_start):
        warnings.append(
            f"The scene lacks {format_count(lost, 'rock')} of {wanted.file}, off the ground or closer to the "
            "site than rocks.clear_radius_m."
        )
    if view is not None and rocks.beyond_rad > view.smallest_rad:
        width_px = rocks.beyond_rad * focal_px(settings.rig)
        warnings.append(
            f"Beyond the patch rocks under {width_px:.2g} px are left out to keep to {most}; "
            "raise rocks.most, rocks.beyond_px or rocks.smallest_m."
        )
    return warnings


def _find_nearest_spacing_m(settings: Settings, ground: Surface, mesh: bpy.types.Mesh) -> float:
    """Distance in metres between the nearest vertices that the cameras see; on ground from a file, a mean distance."""
    if isinstance(ground, GradedGround):
        height_m = float(settings.rig.height_m)
        return float(ground.grading.spacing_at(math.sqrt(max(nearest_ground_m(settings.rig) ** 2 - height_m**2, 0.0))))
    if isinstance(ground, SurroundedGround):
        return ground.spacing_m
    if is_from_file(settings):
        return math.sqrt(sum(each.area for each in mesh.polygons) / max(len(mesh.vertices), 1))
    return compute_vertex_spacing_m(settings.terrain)

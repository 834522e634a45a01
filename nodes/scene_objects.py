"""Makes the objects of a scene from its settings, before they replace earlier objects."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..physics import scene_checks
from ..physics.camera import blur
from ..physics.camera.depth_accuracy import advise_on_rounding
from ..physics.excavation.camera_jitter import jitter_rig
from ..physics.excavation.unsupported_rocks import settle_rocks
from ..physics.light.sky import Sky
from ..physics.light.sky_over_map import find_sky_place, warn_sky_of_another_site
from ..physics.mesh.finer_in_view import advise_on_displacement, nearest_ground_m
from ..physics.mesh.graded_mesh import GradedGround
from ..physics.mesh.ground_interface import Surface
from ..physics.mesh.heights_on_mesh import SurroundedGround
from ..physics.rig.focal_length import focal_px
from ..physics.rocks.beyond_patch import make_view_beyond
from ..physics.rocks.own_rock import find_rock_shapes
from ..physics.rocks.place_rocks import HeightAt, Rocks, scatter_rocks
from ..physics.rocks.rock_shapes import RockShape
from ..physics.rocks.rock_table import TABLE, read_rock_table
from ..physics.terrain.outcrops import advise_on_outcrops
from ..physics.terrain.skirts import advise_on_skirts
from ..physics.terrain.terrain import Terrain, advise_on_terrain, make_terrain
from ..settings.topics.camera import RigSettings
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.labels import TERRAIN_INSTANCE
from ..support.number_text import format_count
from ..support.steps import Steps
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
from .remove_objects import remove_objects, remove_unused
from .rig import build_rig
from .surface import ground_and_rock_materials, reflectance_laws
from .surface.ground_and_rock_materials import build_ground_material, build_rock_material
from .surface.patches_and_grain import mark_elevation
from .surface.sheltered_ground import mark_shelter_in_steps


@dataclass
class MadeObjects:
    """The parts of a scene, before they are in a collection."""

    objects: list[bpy.types.Object]  # the terrain, the Sun, the camera, then others
    sky: bpy.types.World | None  # made last, since live preview removes worlds without users
    own: UserGround | None  # the user's own ground
    site_m: float  # height of the ground under the camera
    warnings: list[str] = field(default_factory=list)
    excavation: dict[str, Any] = field(default_factory=dict)  # its report
    #: The record of a build that another process has made, see ``stored_build``.
    record: dict[str, Any] = field(default_factory=dict)
    coarse: bool = False  # whether the ground is the coarse one of a preview
    #: Meshes and materials of objects that are not finished.
    unfinished: list[bpy.types.ID] = field(default_factory=list)

    def keep_unused_sky(self, keep: bool) -> None:
        """Choose whether the file keeps the world, if it is made, while nothing uses it."""
        if self.sky is not None:
            self.sky.use_fake_user = keep

    def is_there(self) -> bool:
        """Return whether all objects still exist; for example, *Purge Unused Data* may remove them."""
        return all(block is not None and _exists(block) for block in (*self.objects, self.sky))

    def remove(self) -> None:
        """Remove every made object that is not in a scene and still exists; undo, for example, may have removed
        some."""
        if self.sky is not None and not _exists(self.sky):
            self.sky = None
        self.keep_unused_sky(False)
        remove_objects([item for item in self.objects if _exists(item)])
        remove_unused([block for block in self.unfinished if _exists(block)], [self.sky])


def _exists(block: bpy.types.ID) -> bool:
    """Return whether a data-block still exists in the file."""
    try:
        return bool(block.name)
    except ReferenceError:
        return False


def mark_as_built(block: bpy.types.ID, role: str) -> bpy.types.ID:
    """Mark a data-block as built by Icy Moon, in a role."""
    block[TAG] = role
    return block


def make_ground(settings: Settings) -> Terrain:
    """Make the height function of the procedural ground."""
    # Files of rocks are read for their skirts.
    found = make_paths_absolute(settings) if settings.rocks.skirt > 0 else settings
    return make_terrain(found, int(settings.dataset.seed))


def read_stated_ground_m(rig: RigSettings) -> float:
    """Read the height in metres of the ground under a left camera, from its stated heights above zero and above the
    ground."""
    return float(rig.z_m) - float(rig.height_m)


def find_site_ground_m(settings: Settings, ground: Surface) -> float:
    """Find the height in metres of the ground under the left camera, with the detail of the mesh; NaN outside the
    ground.

    For a camera whose height is stated, use ``read_stated_ground_m``.
    """
    rig = settings.rig
    if rig.height_from == "ZERO":
        return read_stated_ground_m(rig)
    return float(ground.heights(rig.x_m, rig.y_m, site_wavelength_m(settings.terrain, ground)))


def make_objects(settings: Settings, meshed: MeshedGround | None) -> Steps[MadeObjects]:
    """Make all objects of the scene and its world in steps. ``meshed`` is the procedural ground, if it has been made
    already.

    Raises IcyMoonError for settings that cannot be built. Nothing that was made remains if the steps end early.
    """
    if reasons := scene_checks.find_reasons_in_settings(settings):
        raise IcyMoonError(" ".join(reasons))
    hapke_warnings = reflectance_laws.advise_on_hapke(settings)
    sky = compute_scene_sky(settings)
    own = load_ground(settings, make_ground) if is_from_file(settings) else None
    ground_and_rock_materials.refuse_without_uv(settings, own is not None and own.uv is not None)
    ground = own or meshed or (yield partial(mesh_whole_ground, make_paths_absolute(settings)))
    site_m, warnings = _find_site(settings, ground.surface, own)
    warnings += [
        *hapke_warnings,
        *advise_on_rounding(settings.rig, site_m),
        *scene_checks.advise_on_scene(settings),
        *_advise_on_ground(settings, ground.surface, own),
    ]
    made = MadeObjects([], None, own, site_m, warnings, coarse=is_coarse(ground))
    try:
        yield from _make_parts(made, settings, ground, sky)
    except BaseException:
        made.remove()
        raise
    return made


def is_coarse(ground: MeshedGround | UserGround) -> bool:
    """Return whether a ground is the coarse one of a preview."""
    return isinstance(ground, MeshedGround) and ground.most_rocks is not None


def _make_parts(made: MadeObjects, settings: Settings, ground: MeshedGround | UserGround, sky: Sky) -> Steps[None]:
    """Add the objects of the scene and their warnings to ``made``."""
    terrain = yield from _make_terrain(made, settings, ground)
    camera = mark_as_built(build_rig(f"{NAME} Camera", jitter_rig(settings), made.site_m), "camera")
    made.objects.append(camera)
    yield None
    for light in build_lights(settings, sky, camera):
        made.objects.append(light)
        yield None
    _, _, sun, *others = made.objects
    made.objects = [terrain, sun, camera, *others]
    made.warnings += [*(yield partial(light_advice, sky, settings)), *blur.advise_on_blur(settings)]
    yield from _add_rocks_and_lander(made, settings, ground)
    made.objects += build_head_cameras(settings, camera, terrain)
    made.sky = mark_as_built(build_sky(f"{NAME} Sky"), "sky")


def _advise_on_ground(settings: Settings, ground: Surface, own: UserGround | None) -> list[str]:
    if own is None:
        return [
            *advise_on_terrain(settings, site_wavelength_m(settings.terrain, ground)),
            *(advise_on_outcrops(settings.hills) if settings.mesh.kind == "GRADED" else []),
            *(ground.advice(settings) if isinstance(ground, GradedGround) else []),
        ]
    if settings.rocks.coverage > 0:
        scene_checks.refuse_no_rocks(settings.rocks, ground.size_m, "source.file")
    said = [*own.warnings, *advise_on_skirts(settings)]
    if find_sky_place(settings, own.map_place):
        return said
    return [*said, *warn_sky_of_another_site(settings.light, own.map_place)]


def _make_terrain(made: MadeObjects, settings: Settings, meshed: MeshedGround | UserGround) -> Steps[bpy.types.Object]:
    """Add the object of the ground with its material, and warnings about it, to ``made``; return the object."""
    ground = meshed.surface
    mesh = meshed.build_mesh(f"{NAME} Terrain")
    made.unfinished = [mesh]
    yield None
    mark_elevation(
        mesh, settings.surface, ground.drop_m if isinstance(ground, GradedGround | SurroundedGround) else None
    )
    made.warnings += ground_and_rock_materials.advise_on_surfaces(settings)
    made.warnings += advise_on_displacement(settings, _find_nearest_spacing_m(settings, ground, mesh))
    mesh.materials.append(build_ground_material(settings, mesh))
    terrain = mark_as_built(bpy.data.objects.new(f"{NAME} Terrain", mesh), "terrain")
    made.objects, made.unfinished = [terrain], []
    made.warnings += ground_and_rock_materials.advise_on_images(settings, mesh)
    terrain.pass_index = TERRAIN_INSTANCE
    yield None
    return terrain


def _add_rocks_and_lander(made: MadeObjects, settings: Settings, ground: MeshedGround | UserGround) -> Steps[None]:
    """Add rocks, the lander and the report of the excavation."""
    dug, terrain = ground if isinstance(ground, DugGround) else None, made.objects[0]
    if dug is not None and dug.series is not None:
        made.excavation = dug.series.facts(dug.state)
        made.warnings += made.excavation.get("advice", [])
    if settings.rocks.coverage > 0:
        moved = yield from _add_rocks(made, settings, ground)
        made.excavation |= {"rocks_moved": moved} if dug is not None else {}
        yield None
    else:
        yield from mark_shelter_in_steps(terrain.data, settings)
    if settings.lander.kind != "NONE":
        made.objects += build_lander(settings, made.site_m, terrain)
        made.warnings += find_contact(settings, made.site_m, terrain).advice()
        yield None


def _find_site(settings: Settings, ground: Surface, own: UserGround | None) -> tuple[float, list[str]]:
    """Find the height in metres of the ground under the camera, and a warning if the camera is beside the ground."""
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


def _add_rocks(made: MadeObjects, settings: Settings, ground: MeshedGround | UserGround) -> Steps[int]:
    """Add the object whose points are the rocks on the ground, and warnings about them; return the number of rocks that
    lost support by an excavation."""
    terrain, absolute = made.objects[0], make_paths_absolute(settings)
    if isinstance(ground, MeshedGround) and is_coarse(ground):  # no mesh is read, so a thread may place the rocks
        height_at = ground.find_coarse_heights(settings.terrain)
        shapes, rocks, moved = yield partial(_place_rocks, absolute, ground, height_at)
    else:
        with probe_heights(terrain) as height_at:
            shapes, rocks, moved = _place_rocks(absolute, ground, height_at)
    shelter = yield from mark_shelter_in_steps(terrain.data, settings, rocks, shapes)
    ice = build_rock_material(settings, terrain.data)
    made.unfinished = [ice]
    yield None
    made.objects.append(mark_as_built(build_rocks(f"{NAME} Rock", rocks, shapes, ice, TAG, shelter), "rock"))
    made.unfinished = []
    remove_unused([], [ice])  # it has no users if there are no rocks
    made.warnings += _advise_on_rocks(settings, rocks)
    return int(moved)


def _place_rocks(
    settings: Settings, ground: MeshedGround | UserGround, height_at: HeightAt
) -> tuple[tuple[tuple[RockShape, ...], ...], Rocks, int]:
    """Place the rocks on ground of the heights ``height_at``. Returns the shapes of the rocks, the rocks, and the
    number of rocks that lost support by an excavation. Paths in ``settings`` are absolute, and any thread may call this
    if it may call ``height_at``.
    """
    seed, wanted, rig = int(settings.dataset.seed), settings.rocks, settings.rig
    shapes = find_rock_shapes(wanted, seed)
    clear = rig.x_m, rig.y_m, wanted.clear_radius_m
    bare, whole, most_seen, moved = height_at, height_at, None, 0
    if isinstance(ground, MeshedGround):
        bare, most_seen = ground.without_skirts(height_at, settings.terrain), ground.most_rocks
        whole = ground.before(height_at)
    rocks = scatter_rocks(
        wanted, ground.surface.size_m, seed, bare, shapes, clear, make_view_beyond(settings), most_seen, whole
    )
    if isinstance(ground, DugGround):
        rocks, moved = settle_rocks(rocks, ground.change_m, height_at, shapes)
    return shapes, rocks, moved


def _advise_on_rocks(settings: Settings, rocks: Rocks) -> list[str]:
    """Return sentences on rocks that the settings ask for but that are left out."""
    wanted, view = make_paths_absolute(settings).rocks, make_view_beyond(settings)
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
    if wanted.low_ground_m and not len(rocks.diameter_m):
        warnings.append(
            f"No place of a rock is lower than the mean height within {wanted.low_ground_m:g} m "
            "(rocks.low_ground_m); raise it, or set it to 0 for rocks anywhere."
        )
    if rocks.crowded_out:
        warnings.append(
            f"At rest there is no room for {format_count(rocks.crowded_out, 'rock')}; lower rocks.coverage or "
            "rocks.clustering, or set rocks.at_rest to false."
        )
    if wanted.law == TABLE and (
        lost := min(len(read_rock_table(Path(wanted.file))), wanted.most) - rocks.debris_start - rocks.crowded_out
    ):
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
    """Find the distance in metres between neighbouring vertices where the cameras see the ground nearest; on ground
    from a file, the mean distance."""
    if isinstance(ground, GradedGround):
        height_m = float(settings.rig.height_m)
        return float(ground.grading.spacing_at(math.sqrt(max(nearest_ground_m(settings.rig) ** 2 - height_m**2, 0.0))))
    if isinstance(ground, SurroundedGround):
        return ground.spacing_m
    if is_from_file(settings):
        return math.sqrt(sum(each.area for each in mesh.polygons) / max(len(mesh.vertices), 1))
    return compute_vertex_spacing_m(settings.terrain)

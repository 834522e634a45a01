"""Builds the whole scene from its settings, in its own collection.

The builders tag their data-blocks, and building again replaces only tagged ones. Everything else in the file and in
the collection is the user's and stays.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..errors import IcyMoonError
from ..labels import TERRAIN_INSTANCE
from ..number_text import count_of
from ..physics import refused_scenes
from ..physics.camera import blur
from ..physics.camera.stereo_geometry import rounding_advice
from ..physics.excavation.jitter import jittered_rig
from ..physics.excavation.unsupported_rocks import settle_rocks
from ..physics.light.map_sky import doubt_sky
from ..physics.mesh.fine_relief import displacement_advice, nearest_m
from ..physics.mesh.graded_ground import Graded
from ..physics.mesh.height_surface import Surface
from ..physics.rig.focal_length import focal_px
from ..physics.rocks.beyond_patch import view_beyond
from ..physics.rocks.rocks import scatter
from ..physics.rocks.shapes import make_rock_shapes
from ..physics.rocks.table import TABLE, read_table
from ..physics.terrain.terrain import Terrain, terrain_advice
from ..physics.terrain.terrain import make_terrain as make_terrain
from ..settings.description import merged
from ..settings.topics.scene import Settings
from . import engine, eyes_above_ground
from .built_scene import (
    CONTENT,
    EXCAVATION,
    FINGERPRINT,
    GROUND,
    NOTES,
    PREVIEW,
    PREVIOUS_CAMERA,
    PREVIOUS_OSL,
    PREVIOUS_VIEW,
    PREVIOUS_WORLD,
    REFINED,
    SETTINGS,
    SITE,
    STATISTICS,
    Built,
    changed_settings,
    extra,
    find,
    find_collection,
    ground_statistics,
    shows_earlier_ground,
)
from .datablocks.blend_file_paths import content, with_absolute_files
from .datablocks.fingerprint import NAME, TAG, built_objects, instanced_objects, parts
from .ground.dug_ground import DugGround, mesh_whole_ground
from .ground.heights_under import probe_heights
from .ground.rocks import build_rocks
from .ground.terrain_mesh import (
    MeshedGround,
    grid_heights,
    patch_heights,
    patch_statistics,
    site_wavelength_m,
    vertex_spacing_m,
)
from .ground.user_ground import UserGround, is_from_file, is_mesh, load_ground
from .keep_references import is_owned_elsewhere, owned_blocks, replace_block, set_owned_blocks, update_object
from .lander.contact import find_contact
from .lander.objects import ROLES as LANDER_ROLES
from .lander.objects import build_lander
from .light.scene_lights import ROLES, build_lights, described_sky
from .light.scene_lights import advice as light_advice
from .light.sun_lamp import build_sky
from .remove import free_names, materials_of, remove, remove_leftovers, remove_unused, with_parts
from .rig import build_rig
from .surface import ground_and_rock_materials, reflectance_laws, sun_inputs
from .surface.ground_and_rock_materials import build_ground_material, build_rock_material
from .surface.patches_and_grain import mark_elevation

#: Names for users of a scene, with names from ``built_scene`` and ``remove``.
__all__ = [
    "NAME",
    "NOTES",
    "PREVIEW",
    "REFINED",
    "SITE",
    "Built",
    "build",
    "changed_settings",
    "clear",
    "extra",
    "find",
    "find_collection",
    "free_names",
    "ground_of",
    "ground_statistics",
    "measured_patch",
    "remove",
    "separate_copies",
    "shows_earlier_ground",
    "site_ground_m",
    "update_sunlight",
    "why_shared",
]

#: Roles of the objects in a built collection.
OBJECTS = ("terrain", "sun", "camera", "rock", *ROLES, *LANDER_ROLES.values())


def ground_of(settings: Settings) -> Terrain:
    """The height function of the procedural ground."""
    return make_terrain(settings, int(settings.dataset.seed))


def site_ground_m(settings: Settings, ground: Surface) -> float:
    """Height in metres of the ground under the left camera, with the detail of the mesh; NaN outside the ground."""
    rig = settings.rig
    return float(ground.heights(rig.x_m, rig.y_m, site_wavelength_m(settings.terrain, ground)))


def measured_patch(built: Built) -> np.ndarray | None:
    """Heights (n, n) in metres on a grid over the patch of procedural ground; None for other ground."""
    if is_from_file(built.settings):
        return None
    if built.settings.mesh.kind == "GRADED":
        return patch_heights(ground_of(built.settings))
    return grid_heights(built.terrain.data, built.settings.terrain)


def _tag(block: Any, role: str) -> Any:
    block[TAG] = role
    return block


def _site(settings: Settings, ground: Surface, own: UserGround | None) -> tuple[float, list[str]]:
    """Height in metres of the ground under the camera, and a warning if the camera is beside the ground."""
    rig, size = settings.rig, settings.terrain.size_m
    height = site_ground_m(settings, ground)
    if own is not None and math.isnan(height):
        return own.nearest_height_m(rig.x_m, rig.y_m), [
            "There is no ground under the camera; change rig.x_m or rig.y_m, or move the ground with source.origin_x_m "
            "and source.origin_y_m."]
    if own is None and not isinstance(ground, Graded) and max(abs(rig.x_m), abs(rig.y_m)) > size / 2:
        return height, [f"The camera is outside the {size:g} m patch of ground; change rig.x_m, rig.y_m or "
                        "terrain.size_m."]
    return height, []


def _build_rocks(settings: Settings, terrain: bpy.types.Object, size_m: float,
                 dug: DugGround | None) -> tuple[bpy.types.Object, list[str], int]:
    """The object whose points are the rocks on the ground, ``dug`` or not, warnings, and how many lost support."""
    seed, wanted, rig = int(settings.dataset.seed), with_absolute_files(settings).rocks, settings.rig
    shapes = make_rock_shapes(wanted.family, wanted.angularity, seed)
    with probe_heights(terrain) as height_at:
        view = view_beyond(settings)
        clear = rig.x_m, rig.y_m, wanted.clear_radius_m
        before, moved = height_at if dug is None else dug.before(height_at), 0
        rocks = scatter(wanted, size_m, seed, before, shapes, clear, view)
        if dug is not None:
            rocks, moved = settle_rocks(rocks, dug.change_m, height_at, shapes)
    ice = build_rock_material(settings, terrain.data)
    item = _tag(build_rocks(f"{NAME} Rock", rocks, shapes, ice, TAG), "rock")
    remove_unused([], [ice])  # it has no users if there are no rocks
    warnings, most = [], count_of(wanted.most, "rock")
    if rocks.smallest_m > (0.0 if wanted.law == TABLE else wanted.smallest_m):
        warnings.append(f"Rocks under {rocks.smallest_m:.3g} m are left out to keep to {most}; "
                        "raise rocks.most or rocks.smallest_m.")
    if wanted.law == TABLE and (lost := min(len(read_table(Path(wanted.file))), wanted.most) - len(rocks.diameter_m)):
        warnings.append(f"The scene lacks {count_of(lost, 'rock')} of {wanted.file}, off the ground or closer to the "
                        "site than rocks.clear_radius_m.")
    if view is not None and rocks.beyond_rad > view.smallest_rad:
        width_px = rocks.beyond_rad * focal_px(rig)
        warnings.append(f"Beyond the patch rocks under {width_px:.2g} px are left out to keep to {most}; "
                        "raise rocks.most, rocks.beyond_px or rocks.smallest_m.")
    return item, warnings, moved


def _nearest_spacing_m(settings: Settings, ground: Surface, mesh: bpy.types.Mesh) -> float:
    """Distance in metres between the nearest vertices that the cameras see; on ground from a file, a mean distance."""
    if isinstance(ground, Graded):
        height_m = float(settings.rig.height_m)
        return float(ground.grading.spacing_at(math.sqrt(max(nearest_m(settings.rig) ** 2 - height_m**2, 0.0))))
    if is_from_file(settings):
        return math.sqrt(sum(each.area for each in mesh.polygons) / max(len(mesh.vertices), 1))
    return vertex_spacing_m(settings.terrain)


def _build_objects(settings: Settings, meshed: MeshedGround | None) -> tuple[
        list[bpy.types.Object], bpy.types.World, list[str], UserGround | None, float, dict[str, Any]]:
    """Make all objects of the scene (terrain, Sun, camera, then others) and its world.

    ``meshed`` is the procedural ground, if it has been made already. Also returns warnings, the user's own ground or
    None, the height in metres of the ground under the camera, and the report of the excavation.
    """
    # Errors come first, before anything is made.
    if reasons := refused_scenes.reasons_of_settings(settings):
        raise IcyMoonError(" ".join(reasons))
    hapke_warnings = reflectance_laws.advice(settings)
    sky = described_sky(settings)
    own = load_ground(settings, ground_of) if is_from_file(settings) else None
    ground_and_rock_materials.refuse_without_uv(settings, own is not None and own.uv is not None)
    made = own or meshed or mesh_whole_ground(ground_of, settings)
    dug = made if isinstance(made, DugGround) else None
    ground: Surface = made.surface
    site_m, warnings = _site(settings, ground, own)
    warnings += [*hapke_warnings, *rounding_advice(settings.rig, site_m), *refused_scenes.scene_advice(settings)]
    if own is not None:
        if settings.rocks.coverage > 0:
            refused_scenes.refuse_no_rocks(settings.rocks, ground.size_m, "source.file")
        warnings += [*own.warnings, *doubt_sky(settings.light, own.map_place)]
    else:
        warnings += terrain_advice(settings, site_wavelength_m(settings.terrain, ground))
        warnings += ground.advice(settings) if isinstance(ground, Graded) else []
    mesh = made.build_mesh(f"{NAME} Terrain")
    mark_elevation(mesh, settings.surface, ground.drop_m if isinstance(ground, Graded) else None)
    warnings += ground_and_rock_materials.advice(settings)
    warnings += displacement_advice(settings, _nearest_spacing_m(settings, ground, mesh))
    try:
        mesh.materials.append(build_ground_material(settings, mesh))
    except IcyMoonError:  # an image that cannot be read
        bpy.data.meshes.remove(mesh)
        raise
    warnings += ground_and_rock_materials.image_advice(settings, mesh)
    terrain = _tag(bpy.data.objects.new(f"{NAME} Terrain", mesh), "terrain")
    terrain.pass_index = TERRAIN_INSTANCE
    camera = _tag(build_rig(f"{NAME} Camera", jittered_rig(settings), site_m), "camera")
    lights = build_lights(settings, sky, camera)
    warnings += light_advice(sky, settings)
    warnings += blur.blur_advice(settings)
    objects = [terrain, lights[0], camera, *lights[1:]]
    facts = dug.series.facts(dug.state) if dug is not None and dug.series is not None else {}
    warnings += facts.get("advice", [])
    if settings.rocks.coverage > 0:
        rocks, rock_warnings, moved = _build_rocks(settings, terrain, ground.size_m, dug)
        objects.append(rocks)
        warnings += rock_warnings
        facts |= {"rocks_moved": moved} if dug is not None else {}
    if settings.lander.kind != "NONE":
        objects += build_lander(settings, site_m, terrain)
        warnings += find_contact(settings, site_m, terrain).advice()
    return objects, _tag(build_sky(f"{NAME} Sky"), "sky"), warnings, own, site_m, facts


def _adopt_children(removed: list[bpy.types.Object], terrain: bpy.types.Object) -> None:
    """Make the ground the parent of the user's objects whose parent is removed."""
    for item in bpy.data.objects:
        if item.parent in removed and item not in removed:
            inverse = item.matrix_parent_inverse.copy()
            item.parent = terrain
            item.matrix_parent_inverse = inverse


def update_sunlight(collection: bpy.types.Collection) -> None:
    """Update what surfaces, lamps and scenes know of each other, after any of them has changed.

    Surfaces get the directions of Sun and planet. A lamp no longer lights surfaces that trace it themselves. Scenes use
    Open Shading Language if a surface needs it.
    """
    objects = list(built_objects(collection).values())
    lamp = next(item for item in objects if item[TAG] == "sun")
    shine = next((item for item in objects if item[TAG] == "planetshine"), None)
    used = {item: materials_of(with_parts([item])[0]) for item in objects}
    every = set().union(*used.values())
    # From the lamp, in single precision, so that aiming again at render time changes nothing.
    sun_inputs.aim_surfaces(every, sun_inputs.Sun.from_lamp(lamp, lamp.matrix_basis), shine)
    of_osl = [item for item in objects if any(map(sun_inputs.is_osl, used[item]))]
    sun_inputs.exempt_from_lamp(f"{NAME} Traced Sun", lamp,
                                [i for i in of_osl if any(map(sun_inputs.traces_sun, used[i]))])
    if shine is not None:
        sun_inputs.exempt_from_lamp(f"{NAME} Traced Planet", shine, of_osl)
    for item in objects:
        if item[TAG] in ("terrain", "rock"):
            # Hapke's law in OSL emits all of the planet's light and all or part of the Sun's. By day,
            # ``render.separate_lights`` separates the two.
            group = "Sun" if lamp.data.energy > 0 or shine is None else "Planet"
            for each in (item, *instanced_objects(item)):
                each.lightgroup = group if item in of_osl else ""
    remove_leftovers()
    for scene in bpy.data.scenes:
        if find_collection(scene) == collection:
            scene.cycles.shading_system = bool(collection.get(PREVIOUS_OSL, False)) or bool(of_osl)


def _refuse_editing(ours: list[bpy.types.Object]) -> None:
    """Raise IcyMoonError if an object that will be replaced is being edited."""
    for item in ours:
        if item.mode != "OBJECT":
            raise IcyMoonError(f"{item.name} is being edited; go to Object Mode to build the scene.")


def _find_built_blocks(scene: bpy.types.Scene, collection: bpy.types.Collection | None) -> dict[str, Any]:
    """The data-blocks built before, see ``owned_blocks``, even if the user has deleted the collection."""
    if collection is not None:
        return {**built_objects(collection), **owned_blocks(collection)}
    theirs = {block for other in bpy.data.collections if other.get(TAG) == "scene"
              for block in (*owned_blocks(other).values(), *other.all_objects)}
    strays = [item for item in bpy.data.objects if item.get(TAG) in OBJECTS and item not in theirs
              and (item.name in scene.objects or not item.users_collection)]
    return {item[TAG]: item for item in reversed(strays)}


def _make_collection(scene: bpy.types.Scene, ours: list[bpy.types.Object]) -> bpy.types.Collection:
    """A new built collection, with the scene's present camera, world and view, which Clear Scene restores.

    ``ours`` are unlinked from other collections.
    """
    collection = _tag(bpy.data.collections.new(NAME), "scene")
    for item in ours:
        for other in item.users_collection:
            other.objects.unlink(item)
    for other in [c for c in scene.collection.children_recursive if c.get(TAG) == "rocks" and not c.all_objects]:
        bpy.data.collections.remove(other)
    scene.collection.children.link(collection)
    world, camera = scene.world, scene.camera
    collection[PREVIOUS_WORLD] = None if world is None or TAG in world else world
    collection[PREVIOUS_CAMERA] = None if camera in ours else camera
    collection[PREVIOUS_VIEW] = [scene.view_settings.exposure, scene.render.resolution_x, scene.render.resolution_y]
    collection[PREVIOUS_OSL] = scene.cycles.shading_system
    return collection


def _put_in_place(collection: bpy.types.Collection, there: dict[str, Any],
                  new: list[bpy.types.Object]) -> tuple[list[bpy.types.Object], list[Any]]:
    """Replace the data-blocks that are ``there`` by new objects.

    Returns the objects of the scene, and the data-blocks that keep the names of earlier ones.
    """
    set_owned_blocks(collection, {})  # otherwise unused data-blocks would keep a user
    old = {role: item for role, item in there.items() if role in OBJECTS}
    named, objects = list(old.values()), []
    for item in new:
        role = item[TAG]
        successors = {f"{role} data": item.data} | {f"{role} material": material for material in _material(item)}
        for name, block in successors.items():
            if name in there and not is_owned_elsewhere(collection, there[name]):
                replace_block(there[name], block)
                named.append(block)
        objects.append(update_object(old.pop(role), item) if role in old else item)
    _adopt_children(list(old.values()), objects[0])
    remove(list(old.values()))
    return objects, named


def _material(item: bpy.types.Object) -> list[bpy.types.Material]:
    """The material of the ground or of the rocks."""
    meshes = [each.data for each in (item, *instanced_objects(item)) if isinstance(each.data, bpy.types.Mesh)]
    return [mesh.materials[0] for mesh in meshes if len(mesh.materials)][:1]


def _blocks_to_own(objects: list[bpy.types.Object]) -> dict[str, Any]:
    """The built data-blocks by role, for ``set_owned_blocks``."""
    found: dict[str, Any] = {item[TAG]: item for item in objects}
    found["terrain data"] = found["terrain"].data
    return found | {f"{role} material": material for role in ("terrain", "rock") if role in found
                    for material in _material(found[role])}


def disown_copies(collection: bpy.types.Collection) -> None:
    """Remove the tags from copies of built objects, which then are the user's own objects."""
    ours = built_objects(collection).values()
    for item in collection.all_objects:
        if TAG in item and item not in ours:
            del item[TAG]


def separate_copies(built: Built) -> None:
    """Separate a built scene from copies that the user has made of it or of its objects."""
    disown_copies(built.collection)
    lamps = [item for role, item in built_objects(built.collection).items() if role in ("sun", "planetshine")]
    exempt = [item for lamp in lamps if lamp.light_linking.receiver_collection is not None
              and lamp.light_linking.receiver_collection.get(TAG) == sun_inputs.SHARED
              for item in lamp.light_linking.receiver_collection.objects]
    if any(item not in list(built.collection.all_objects) for item in exempt):
        update_sunlight(built.collection)


def why_shared(built: Built) -> str:
    """Why the live preview would change another scene too, in a sentence; empty if it would not."""
    surfaces = [block for name, block in owned_blocks(built.collection).items() if name.endswith(" material")]
    if any(is_owned_elsewhere(built.collection, surface) for surface in surfaces):
        return "This scene shares its surfaces with the scene that it is a copy of; press Build Scene to separate them."
    return ""


def build(scene: bpy.types.Scene, settings: Settings, meshed: MeshedGround | None = None) -> Built:
    """Build, or build again, the scene of complete ``settings``; ``meshed`` is its ground, if it has been made already.

    Sets the scene's camera and world to the built ones, unless the user has set others since the first build. Objects
    that were built before are kept and updated, so that references to them stay valid. Raises IcyMoonError, without
    changing the scene, if Cycles is off, the ground is being edited, there is not enough memory, or the file of the
    ground cannot be used.
    """
    collection = find_collection(scene)
    engine.require()
    there = _find_built_blocks(scene, collection)
    ours = [item for role, item in there.items() if role in OBJECTS]
    _refuse_editing(ours)
    try:
        objects, sky, warnings, own, site_m, dug = _build_objects(settings, meshed)
    except MemoryError:
        if is_mesh(settings):
            raise IcyMoonError("There is not enough memory for the mesh; make it coarser before the import.") from None
        if settings.mesh.kind == "GRADED" and not is_from_file(settings):
            raise IcyMoonError("There is not enough memory for the mesh; lower mesh.most.") from None
        n = settings.terrain.resolution
        raise IcyMoonError(f"There is not enough memory for {n} x {n} vertices; lower terrain.resolution.") from None
    first = collection is None
    if collection is None:
        collection = _make_collection(scene, ours)
    rocks_collection = next((c for c in collection.children if c.get(TAG) == "rocks"), None)
    if rocks_collection is None:
        rocks_collection = _tag(bpy.data.collections.new(f"{NAME} Rocks"), "rocks")
        collection.children.link(rocks_collection)
    takes_camera = first or scene.camera is None or scene.camera in ours
    takes_world = first or scene.world is None or TAG in scene.world
    objects, kept = _put_in_place(collection, there, objects)
    for item in objects:
        if item not in list(collection.all_objects):
            (rocks_collection if item[TAG] == "rock" else collection).objects.link(item)
    if takes_camera:
        scene.camera = objects[2]
    if takes_world:
        scene.world = sky
    remove_leftovers()
    made, others = with_parts(objects)
    named = [*made, *(o.data for o in made), *others, *materials_of(made)] + ([sky] if takes_world else [])
    free_names([block for block in named if block not in kept])
    set_owned_blocks(collection, _blocks_to_own(objects))
    disown_copies(collection)
    update_sunlight(collection)
    collection[SETTINGS] = json.dumps(merged(settings))
    on_map = {"map": own.map_place} if own and own.map_place else {}
    collection[GROUND] = json.dumps({"report": own.report, "site_m": site_m, **on_map} if own else {})
    collection[SITE] = site_m
    collection[CONTENT] = content(settings)
    collection[EXCAVATION] = json.dumps(dug)
    built = Built(collection, objects[0], objects[1], objects[2], merged(settings), scene, tuple(warnings))
    built.warnings += tuple(eyes_above_ground.reasons_when_built(built))
    collection[STATISTICS] = json.dumps(patch_statistics(measured_patch(built), settings.terrain))
    collection[FINGERPRINT], collection[PREVIEW] = json.dumps(parts(collection)), "{}"
    collection[NOTES] = "[]"
    collection.pop(REFINED, None)
    return built


def clear(scene: bpy.types.Scene) -> bool:
    """Remove what Build Scene made, and restore the earlier world, camera, frame and view exposure.

    Objects that the user put into the collection move to the scene's own collection. Returns whether anything was
    built.
    """
    collection = find_collection(scene)
    if collection is None:
        return False
    previous_world, previous_camera = collection.get(PREVIOUS_WORLD), collection.get(PREVIOUS_CAMERA)
    ours = [item for role, item in _find_built_blocks(scene, collection).items() if role in OBJECTS]
    scene.view_settings.exposure, *resolution = collection[PREVIOUS_VIEW]
    if not engine.why_unavailable():
        scene.cycles.shading_system = bool(collection.get(PREVIOUS_OSL, False))
    scene.render.resolution_x, scene.render.resolution_y = (int(n) for n in resolution)
    if scene.camera in ours or scene.camera is None:
        scene.camera = previous_camera
    if scene.world is None or TAG in scene.world:
        scene.world = previous_world
    disown_copies(collection)
    for item in [item for item in collection.all_objects if TAG not in item]:
        if item.name not in scene.collection.objects:
            scene.collection.objects.link(item)
    remove(ours)
    for child in [c for c in collection.children_recursive if TAG in c]:
        bpy.data.collections.remove(child)
    bpy.data.collections.remove(collection)
    remove_leftovers()
    return True

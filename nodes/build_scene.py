"""Builds the whole scene from its settings, in its own collection.

The builders tag their data-blocks, and building again replaces only tagged ones. Everything else in the file and in
the collection is the user's and stays.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator
from typing import Any

import bpy

from ..physics.terrain.terrain import make_terrain as make_terrain
from ..settings.description import merged
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.steps import Steps, finish
from . import before_build, check_cycles, eyes_above_ground
from .built_scene import (
    CONTENT,
    EXCAVATION,
    FINGERPRINT,
    GROUND,
    MARKS_SHAPE,
    NOTES,
    PREVIEW,
    REFINED,
    SETTINGS,
    SITE,
    STATISTICS,
    Built,
    describe_ground_statistics,
    find_built,
    find_collection,
    find_scenes_sharing_build,
    list_changed_settings,
    list_collections,
    make_build_facts,
    shows_earlier_ground,
)
from .datablocks.blend_file_paths import hash_content
from .datablocks.fingerprint import (
    MAKER,
    NAME,
    OWN,
    TAG,
    find_added_objects,
    find_built_objects,
    find_instanced_objects,
    read_parts,
    update_marks,
)
from .datablocks.known_marks import forget_marks
from .datablocks.stored_json import read_stored
from .ground.terrain_mesh import (
    MeshedGround,
    describe_patch_statistics,
    read_grid_heights,
    sample_patch,
)
from .ground.user_ground import is_from_file, is_mesh
from .head_cameras import ROLES as HEAD_ROLES
from .keep_references import (
    find_owned_blocks,
    is_owned_by_another_build,
    replace_block,
    set_owned_blocks,
    update_object,
)
from .lander.objects import ROLES as LANDER_ROLES
from .light.lamps import ROLES as LAMP_ROLES
from .light.scene_lights import ROLES
from .remove_objects import find_materials, find_parts, free_names, remove_leftovers, remove_objects
from .scene_objects import (
    MadeObjects,
    find_site_ground_m,
    make_ground,
    make_objects,
    mark_as_built,
    read_stated_ground_m,
)
from .surface import sun_inputs
from .surface.own_groups import connect_own_groups

#: Public names of this module, including names that come from other modules.
__all__ = [
    "NAME",
    "NOTES",
    "PREVIEW",
    "REFINED",
    "SITE",
    "Built",
    "build_scene",
    "clear_scene",
    "describe_ground_statistics",
    "find_built",
    "find_collection",
    "find_scenes_sharing_build",
    "find_site_ground_m",
    "free_names",
    "list_changed_settings",
    "list_collections",
    "make_build_facts",
    "make_ground",
    "make_in_memory",
    "measure_patch",
    "put_in_scene",
    "read_stated_ground_m",
    "refuse_place",
    "remove_objects",
    "separate_from_copies",
    "shows_earlier_ground",
    "update_sunlight",
    "why_shared",
]

#: Roles of the objects in a built collection.
OBJECTS = ("terrain", "sun", "camera", "rock", *ROLES, *LANDER_ROLES.values(), *HEAD_ROLES)


def measure_patch(built: Built) -> Array | None:
    """Measure the heights (n, n) in metres of procedural ground on a grid over its patch; None for other ground."""
    if is_from_file(built.settings):
        return None
    if built.settings.mesh.kind == "GRADED":
        return sample_patch(make_ground(built.settings))
    return read_grid_heights(built.terrain.data, built.settings.terrain)


def _adopt_children(removed: list[bpy.types.Object], terrain: bpy.types.Object) -> None:
    """Make the ground the parent of the user's objects whose parent is removed."""
    for item in bpy.data.objects:
        if item.parent in removed and item not in removed:
            inverse = item.matrix_parent_inverse.copy()
            item.parent = terrain
            item.matrix_parent_inverse = inverse


def update_sunlight(collection: bpy.types.Collection) -> None:
    """Make surfaces, lamps and scenes agree after one of them has changed.

    Surfaces get the directions of Sun and planet. A lamp stops lighting surfaces whose shader traces the lamp. Scenes
    use Open Shading Language if a surface needs it.
    """
    objects = list(find_built_objects(collection).values())
    lamp = next(item for item in objects if item[TAG] == "sun")
    shine = next((item for item in objects if item[TAG] == "planetshine"), None)
    used = {item: find_materials(find_parts([item])[0]) for item in objects}
    every = set().union(*used.values())
    # Read from the lamp, in single precision, so that aiming again at render time changes nothing.
    lamps = [item for item in objects if item[TAG] in LAMP_ROLES]
    sun_inputs.set_light_inputs(every, sun_inputs.Sun.from_lamp(lamp, lamp.matrix_basis), shine, lamps)
    of_osl = [item for item in objects if any(map(sun_inputs.is_osl, used[item]))]
    sun_inputs.exclude_from_lamp(
        f"{NAME} Traced Sun", lamp, [i for i in of_osl if any(map(sun_inputs.traces_sun, used[i]))]
    )
    if shine is not None:
        sun_inputs.exclude_from_lamp(f"{NAME} Traced Planet", shine, of_osl)
    for item, group in _list_light_groups(objects):
        item.lightgroup = group
    remove_leftovers()
    for scene in bpy.data.scenes:
        if find_collection(scene) == collection:
            scene.cycles.shading_system = before_build.used_osl_before_build(scene) or bool(of_osl)


def _list_light_groups(objects: list[bpy.types.Object]) -> Iterator[tuple[bpy.types.Object, str]]:
    """Yield the ground, the rocks and their shapes among built objects, each with the light group that it must have.

    Hapke's law in OSL emits all of the planet's light and all or part of the Sun's. By day, ``render.separate_lights``
    separates the two.
    """
    lamp = next(item for item in objects if item[TAG] == "sun")
    by_day = lamp.data.energy > 0 or all(item[TAG] != "planetshine" for item in objects)
    for item in objects:
        if item[TAG] in ("terrain", "rock"):
            traced = any(map(sun_inputs.is_osl, find_materials(find_parts([item])[0])))
            for each in (item, *find_instanced_objects(item)):
                yield each, ("Sun" if by_day else "Planet") if traced else ""


def keeps_light_groups(collection: bpy.types.Collection) -> bool:
    """Return whether the ground, the rocks and their shapes have the light groups that ``update_sunlight`` would
    set."""
    return all(
        item.lightgroup == group for item, group in _list_light_groups([*find_built_objects(collection).values()])
    )


def _refuse_editing(ours: list[bpy.types.Object]) -> None:
    """Raise IcyMoonError if an object that will be replaced is being edited."""
    for item in ours:
        if item.mode != "OBJECT":
            raise IcyMoonError(f"{item.name} is being edited; go to Object Mode to build the scene.")


def _find_built_blocks(
    scene: bpy.types.Scene, collection: bpy.types.Collection | None, made: Collection[bpy.types.Object] = ()
) -> dict[str, Any]:
    """Find the data-blocks that were built before, by role as in ``find_owned_blocks``, even if the user has deleted
    the collection. Objects that were ``made`` now are left out."""
    if collection is not None:
        return {**find_built_objects(collection), **find_owned_blocks(collection)}
    theirs = set(made) | {
        block
        for other in bpy.data.collections
        if other.get(TAG) == "scene"
        for block in (*find_owned_blocks(other).values(), *other.all_objects)
    }
    strays = [
        item
        for item in bpy.data.objects
        if item.get(TAG) in OBJECTS
        and item.library is None
        and item not in theirs
        and (item.name in scene.objects or not item.users_collection)
    ]
    return {item[TAG]: item for item in reversed(strays)}


def _make_collection(scene: bpy.types.Scene, ours: list[bpy.types.Object]) -> bpy.types.Collection:
    """Make a new built collection. ``ours`` are unlinked from other collections."""
    collection = mark_as_built(bpy.data.collections.new(NAME), "scene")
    for item in ours:
        for other in item.users_collection:
            other.objects.unlink(item)
    for other in [c for c in scene.collection.children_recursive if c.get(TAG) == "rocks" and not c.all_objects]:
        bpy.data.collections.remove(other)
    scene.collection.children.link(collection)
    before_build.note_before_build(scene)
    return collection


def _put_in_place(
    collection: bpy.types.Collection, there: dict[str, Any], new: list[bpy.types.Object]
) -> tuple[list[bpy.types.Object], list[Any]]:
    """Replace the existing data-blocks, ``there`` by role, by the ``new`` objects.

    Returns the objects of the scene, and the data-blocks that keep the names of earlier data-blocks.
    """
    set_owned_blocks(collection, {})  # otherwise unused data-blocks would keep a user
    old = {role: item for role, item in there.items() if role in OBJECTS}
    named, objects = list(old.values()), []
    for item in new:
        role = item[TAG]
        successors = {f"{role} data": item.data} | {f"{role} material": material for material in _find_material(item)}
        for name, block in successors.items():
            if name in there and not is_owned_by_another_build(collection, there[name]):
                replace_block(there[name], block)
                named.append(block)
        objects.append(update_object(old.pop(role), item) if role in old else item)
    _adopt_children(list(old.values()), objects[0])
    remove_objects(list(old.values()))
    return objects, named


def _find_material(item: bpy.types.Object) -> list[bpy.types.Material | None]:
    """Return a list of the material of the ground or of the rocks; its item is None if the material was removed."""
    meshes = [each.data for each in (item, *find_instanced_objects(item)) if isinstance(each.data, bpy.types.Mesh)]
    return [mesh.materials[0] for mesh in meshes if len(mesh.materials)][:1]


def _list_owned_blocks(objects: list[bpy.types.Object]) -> dict[str, Any]:
    """List the built data-blocks by role, for ``set_owned_blocks``."""
    found: dict[str, Any] = {item[TAG]: item for item in objects}
    found["terrain data"] = found["terrain"].data
    return found | {
        f"{role} material": material
        for role in ("terrain", "rock")
        if role in found
        for material in _find_material(found[role])
    }


def untag_copies(collection: bpy.types.Collection) -> None:
    """Remove the tags from copies of built objects, so that the copies count as the user's objects."""
    ours = find_built_objects(collection).values()
    for item in collection.all_objects:
        if TAG in item and item not in ours:
            del item[TAG]


def separate_from_copies(built: Built) -> None:
    """Separate a built scene from copies that the user has made of it or of its objects."""
    untag_copies(built.collection)
    lamps = [item for role, item in find_built_objects(built.collection).items() if role in ("sun", "planetshine")]
    exempt = [
        item
        for lamp in lamps
        if lamp.light_linking.receiver_collection is not None
        and lamp.light_linking.receiver_collection.get(TAG) == sun_inputs.SHARED
        for item in lamp.light_linking.receiver_collection.objects
    ]
    if any(item not in list(built.collection.all_objects) for item in exempt):
        update_sunlight(built.collection)


def _leave_shared(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """Unlink the built collection from a scene that shares it with linked copies, and return it. The copies keep it.

    Returns None if no other scene shares it.

    Raises IcyMoonError if the collection is in another collection that both scenes share.
    """
    collection, others = find_collection(scene), find_scenes_sharing_build(scene)
    if collection is None or not others:
        return None
    if collection not in list(scene.collection.children):
        raise IcyMoonError(
            f"The scenes {scene.name} and {others[0].name} share the collection that {collection.name} is in; drag "
            f"{collection.name} to the scene's own collection in the Outliner."
        )
    scene.collection.children.unlink(collection)
    collection[NOTES] = "[]"
    return collection


def _inherit(collection: bpy.types.Collection, left: bpy.types.Collection) -> None:
    """Move the scene's notes and the user's objects from the collection that it ``left`` to a new built collection."""
    for key in left.keys():  # noqa: SIM118 - no mapping
        if not key.startswith(OWN) and key != TAG and isinstance(left[key], str | int | float):
            collection[key] = left[key]
    for item in find_added_objects(left):
        collection.objects.link(item)


def why_shared(built: Built) -> str:
    """Return a sentence on why the live preview would also change another scene; empty if it would not."""
    if find_scenes_sharing_build(built.scene):
        return "This scene shares its ground with the scene that it is a copy of; press Build Scene to separate them."
    surfaces = [block for name, block in find_owned_blocks(built.collection).items() if name.endswith(" material")]
    if any(is_owned_by_another_build(built.collection, surface) for surface in surfaces):
        return "This scene shares its surfaces with the scene that it is a copy of; press Build Scene to separate them."
    return ""


def build_scene(
    scene: bpy.types.Scene,
    settings: Settings,
    meshed: MeshedGround | None = None,
    *,
    take_over: Callable[[], MadeObjects] | None = None,
) -> Built:
    """Build, or build again, the scene of complete ``settings``. ``meshed`` is its procedural ground, if it has been
    made already; ``take_over`` returns the objects that another process has made.

    Sets the scene's camera and world to the built ones, unless the user has set others since the first build. Objects
    that were built before are kept and updated, so that references to them stay valid. Raises IcyMoonError, without
    changing the scene, if Cycles is off, the ground is being edited, there is not enough memory, or the file of the
    ground cannot be used.
    """
    refuse_place(scene)
    return put_in_scene(scene, settings, take_over() if take_over else finish(make_in_memory(settings, meshed)))


def refuse_place(scene: bpy.types.Scene) -> None:
    """Raise IcyMoonError if nothing can be built in a scene now."""
    _find_place(scene)


def _find_place(
    scene: bpy.types.Scene, made: Collection[bpy.types.Object] = ()
) -> tuple[bpy.types.Collection | None, dict[str, Any], list[bpy.types.Object]]:
    """Find what a new build replaces in a scene. Returns the built collection, unless linked copies share it, the
    data-blocks of the earlier build by role, and the objects among them. Objects that were ``made`` now are left out.
    Raises IcyMoonError if nothing can be built in their place.
    """
    collection = None if find_scenes_sharing_build(scene) else find_collection(scene)
    check_cycles.require_cycles()
    there = _find_built_blocks(scene, collection, made)
    ours = [item for role, item in there.items() if role in OBJECTS]
    _refuse_editing(ours)
    return collection, there, ours


def put_in_scene(scene: bpy.types.Scene, settings: Settings, made: MadeObjects) -> Built:
    """Put the objects that were made of complete ``settings`` into a scene, in place of those that were built before.

    Raises IcyMoonError, without changing the scene, in the cases of ``build_scene``, and if some of the objects are
    gone; then it removes all of them.
    """
    try:
        if not made.is_there() or any(None in _find_material(item) for item in made.objects):
            raise IcyMoonError("Parts of the new scene were removed while it was built; press Build Scene again.")
        collection, there, ours = _find_place(scene, made.objects)
        first = collection is None
        left = _leave_shared(scene)
    except IcyMoonError:
        made.remove()
        raise
    if collection is None:
        collection = _make_collection(scene, ours)
        if left is not None:
            _inherit(collection, left)
    before_build.move_notes([scene, *find_scenes_sharing_build(scene)], collection)
    takes_camera = first or scene.camera is None or scene.camera in ours
    takes_world = first or scene.world is None or TAG in scene.world
    objects, kept = _put_in_place(collection, there, made.objects)
    _link_objects(collection, objects)
    if takes_camera:
        scene.camera = objects[2]
    if takes_world:
        scene.world = made.sky
    remove_leftovers()
    _name_blocks(objects, kept, [made.sky] if takes_world else [])
    set_owned_blocks(collection, _list_owned_blocks(objects))
    untag_copies(collection)
    update_sunlight(collection)
    built = Built(collection, objects[0], objects[1], objects[2], merged(settings), scene, tuple(made.warnings))
    connect_own_groups(built.materials)
    _record_build(built, made)
    return built


def make_in_memory(settings: Settings, meshed: MeshedGround | None) -> Steps[MadeObjects]:
    """Make the objects of the scene in steps, as ``make_objects`` does. Raises IcyMoonError also if there is not enough
    memory."""
    try:
        return (yield from make_objects(settings, meshed))
    except MemoryError:
        if is_mesh(settings):
            raise IcyMoonError("There is not enough memory for the mesh; make it coarser before the import.") from None
        if settings.mesh.kind == "GRADED" and not is_from_file(settings):
            raise IcyMoonError("There is not enough memory for the mesh; lower mesh.most.") from None
        n = settings.terrain.resolution
        raise IcyMoonError(f"There is not enough memory for {n} x {n} vertices; lower terrain.resolution.") from None


def _link_objects(collection: bpy.types.Collection, objects: list[bpy.types.Object]) -> None:
    """Link objects to the built collection, and rocks to a collection inside it."""
    of_rocks = next((c for c in collection.children if c.get(TAG) == "rocks"), None)
    if of_rocks is None:
        of_rocks = mark_as_built(bpy.data.collections.new(f"{NAME} Rocks"), "rocks")
        collection.children.link(of_rocks)
    for item in objects:
        if item not in list(collection.all_objects):
            (of_rocks if item[TAG] == "rock" else collection).objects.link(item)


def _name_blocks(objects: list[bpy.types.Object], kept: list[Any], skies: list[bpy.types.World]) -> None:
    """Give the data-blocks their names, except where the names of earlier data-blocks are kept."""
    made, others = find_parts(objects)
    named = [*made, *(item.data for item in made), *others, *find_materials(made), *skies]
    free_names([block for block in named if block not in kept])


def _record_build(built: Built, made: MadeObjects) -> None:
    """Record the build in the collection, for later readers."""
    collection = built.collection
    forget_marks()
    collection[SETTINGS] = json.dumps(built.settings)
    if made.record:
        for key, value in made.record.items():
            collection[key] = value
        known = read_stored(collection, FINGERPRINT, MARKS_SHAPE)
        others = {part.split()[0] for part in known} - {MAKER, "terrain"}
        marks = update_marks(collection, known, *others, "terrain object", "terrain materials", "added")
    else:
        _describe_ground(built, made)
        marks = read_parts(collection)
    collection[FINGERPRINT], collection[PREVIEW] = json.dumps(marks), "{}"
    collection[NOTES] = "[]"
    collection.pop(REFINED, None)


def _describe_ground(built: Built, made: MadeObjects) -> None:
    """Record the ground of a build in the collection, and add the warnings about its meshes to the build."""
    collection, settings, own = built.collection, built.settings, made.own
    on_map = {"map": own.map_place} if own and own.map_place else {}
    collection[GROUND] = json.dumps({"report": own.report, "site_m": made.site_m, **on_map} if own else {})
    collection[SITE] = made.site_m
    collection[CONTENT] = hash_content(settings)
    collection[EXCAVATION] = json.dumps(made.excavation)
    statistics: dict[str, Any] = {}
    if not made.coarse:  # otherwise the fine ground follows with its own warnings and statistics
        built.warnings += tuple(eyes_above_ground.find_reasons_when_built(built))
        statistics = describe_patch_statistics(measure_patch(built), settings.terrain)
    collection[STATISTICS] = json.dumps(statistics)


def _link_own_objects(scene: bpy.types.Scene, items: list[bpy.types.Object]) -> None:
    """Move the user's objects to the scene's own collection."""
    for item in items:
        if item.name not in scene.collection.objects:
            scene.collection.objects.link(item)


def clear_scene(scene: bpy.types.Scene) -> bool:
    """Remove the scene that Build Scene made, and restore the earlier world, camera, frame and view exposure.

    Objects that the user put into the collection move to the scene's own collection. Returns whether anything was
    built.
    """
    collection = find_collection(scene)
    if collection is None:
        return False
    before_build.move_notes([scene, *find_scenes_sharing_build(scene)], collection)
    ours = [item for role, item in _find_built_blocks(scene, collection).items() if role in OBJECTS]
    untag_copies(collection)
    before_build.restore_before_build(scene)
    if left := _leave_shared(scene):
        _link_own_objects(scene, find_added_objects(left))
        remove_leftovers()
        return True
    _link_own_objects(scene, [item for item in collection.all_objects if TAG not in item])
    remove_objects(ours)
    for child in [c for c in collection.children_recursive if TAG in c]:
        bpy.data.collections.remove(child)
    bpy.data.collections.remove(collection)
    remove_leftovers()
    return True

"""Shows changed settings at once in the built scene.

Light, camera and surfaces become as Build Scene would make them. The ground becomes a coarse mesh of the same height
function, finest where the cameras look, with the rocks that look largest. It is never rendered, and Build Scene
replaces it. Parts that the user has edited by hand, and ground from a file, stay as they are.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import bpy
import numpy as np

from ..physics import scene_checks
from ..physics.arm.parametric_arm import JOINTS
from ..physics.excavation.camera_jitter import jitter_rig
from ..physics.excavation.dig_site import is_dug
from ..physics.mesh import finer_in_view
from ..physics.mesh.graded_mesh import GradedGround
from ..physics.mesh.ground_interface import Surface
from ..physics.mesh.horizon import drop_m
from ..physics.mesh.preview_ground import PreviewGround
from ..physics.mesh.vertex_spacing import GRADING_RIG_SETTINGS
from ..physics.rocks.beyond_patch import make_view_beyond
from ..physics.rocks.own_rock import find_rock_shapes
from ..physics.rocks.place_rocks import LEVEL_RANKS, HeightAt, Rocks, scatter_rocks
from ..physics.rocks.rock_shapes import RockShape
from ..physics.scene_requirements import find_elevation_mark
from ..physics.terrain.terrain import Terrain
from ..rays.rock_exposure import RockShelter
from ..settings import rebuilt_parts
from ..settings.description import merged
from ..settings.rebuilt_parts import select_geometry
from ..settings.topics.camera import RigSettings
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.file_schemas import TABLE, TEXT, Each
from ..support.steps import Steps, finish
from . import build_scene as scenes
from . import painted_errors
from .datablocks.blend_file_paths import make_paths_absolute
from .datablocks.fingerprint import TAG, find_built_objects, find_instanced_objects
from .datablocks.marks import is_random_by_object
from .datablocks.stored_json import read_stored
from .ground.dug_ground import mesh_whole_ground
from .ground.heights_under import probe_heights
from .ground.rocks import build_rocks, find_rock_parts, move_rocks
from .ground.terrain_mesh import MeshedGround, compute_vertex_spacing_m, mesh_coarsely
from .ground.user_ground import is_from_file
from .lander.objects import ROLES as LANDER_ROLES
from .lander.objects import build_lander, place_lander
from .light.scene_lights import ROLES, compute_scene_sky, list_light_settings, update_lights
from .rig import place_rig
from .scene_objects import MadeObjects
from .surface.ground_and_rock_materials import (
    build_ground_material,
    build_rock_material,
    follow_ground_material,
    follow_rock_material,
)
from .surface.images import remove_unused_images
from .surface.patches_and_grain import mark_elevation
from .surface.sheltered_ground import check_shelter, mark_shelter
from .tree.builder import copy_values

#: Maximum number of rocks on coarse ground. They are the rocks that look largest.
MAX_ROCKS = 1000
#: Maximum number of rocks that follow a slider.
MAX_MOVED_ROCKS = 500
#: Approximate number of vertices of the whole ground in ``build_coarse``, which takes about a second.
MAX_VERTICES = 100000
_LIGHT_PARTS: tuple[str, ...] = ("sun object", "planetshine object")
_EDITED_MESSAGE = "The {} was edited by hand, so sliders do not change it; press Build Scene to build it again."
_TURNED_MESSAGE = "Preview: fine relief and broken walls are real only where the camera looked; press Build Scene"
_UNDUG_MESSAGE = "Coarse ground without the trench: press Build Scene"
COARSE_MESSAGE = "Coarse ground: Build Scene or a render makes the fine one"
_CHANGED_MESSAGE = "Preview of the change; a render builds it"


def read_notes(scene: bpy.types.Scene) -> list[str]:
    """Read sentences on settings that the scene does not show or shows as a preview, and warnings about the fine ground
    that replaced a coarse ground."""
    collection = scenes.find_collection(scene)
    if collection is None:
        return []
    sentences: list[str] = read_stored(collection, scenes.NOTES, Each(TEXT), "[]")
    previewed = read_stored(collection, scenes.PREVIEW, Each(TABLE, TEXT))
    if not previewed or sentences:
        return sentences
    turned = set(previewed) == {"rig"} and not set(previewed["rig"]).isdisjoint(finer_in_view.RELIEF_RIG_SETTINGS)
    # ``build_coarse`` digs, but the ground that follows a slider is too coarse for a trench.
    undug = previewed.get("excavation", {}).get("path", "NONE") != "NONE" and collection.get(
        scenes.REFINED
    ) != json.dumps(previewed)
    if turned or undug:
        return [_TURNED_MESSAGE if turned else _UNDUG_MESSAGE]
    return [COARSE_MESSAGE if "terrain" in previewed else _CHANGED_MESSAGE]


def lacks_trench(scene: bpy.types.Scene) -> bool:
    """Return whether the scene shows a preview without the trench of its settings."""
    return _UNDUG_MESSAGE in read_notes(scene)


def has_coarse_ground(scene: bpy.types.Scene) -> bool:
    """Return whether the ground that is seen is the coarse one of a preview."""
    collection = scenes.find_collection(scene)
    return collection is not None and "terrain" in read_stored(collection, scenes.PREVIEW, Each(TABLE, TEXT))


def set_notes(built: scenes.Built, sentences: list[str]) -> None:
    """Store the sentences of ``read_notes``, unless they are stored already."""
    sentences = list(dict.fromkeys(sentences))  # one cause, such as a missing file, may affect two parts
    if json.dumps(sentences) != built.collection.get(scenes.NOTES, "[]"):
        built.collection[scenes.NOTES] = json.dumps(sentences)


def build_coarse(scene: bpy.types.Scene, settings: Settings) -> scenes.Built:
    """Build the scene of complete ``settings`` out to the horizon, but with a coarse ground and the largest rocks.

    The scene is marked as a preview: its ground at full resolution follows, see ``find_preview_of``. Ground from a
    file is built at full resolution. Raises IcyMoonError as ``scenes.build_scene`` does.
    """
    if is_from_file(settings):
        return scenes.build_scene(scene, settings)
    scenes.refuse_place(scene)
    return put_coarse_in_scene(scene, settings, finish(make_coarse(settings)))


def make_coarse(settings: Settings) -> Steps[MadeObjects]:
    """Make in steps what ``build_coarse`` makes of settings without ground from a file, for ``put_coarse_in_scene``."""
    ground = yield partial(mesh_whole_ground, make_paths_absolute(settings), _mesh_for_choice)
    return (yield from scenes.make_in_memory(settings, ground))


def put_coarse_in_scene(scene: bpy.types.Scene, settings: Settings, made: MadeObjects) -> scenes.Built:
    """Put what ``make_coarse`` made into a scene. Raises IcyMoonError, without changing the scene, as
    ``scenes.put_in_scene`` does."""
    built = scenes.put_in_scene(scene, settings, made)
    built.remember(settings, select_geometry(settings))
    mark_as_preview(built, settings)
    return replace(built, warnings=())  # they are about the coarse ground, and the fine ground brings its own


def _mesh_for_choice(ground: Terrain, settings: Settings) -> MeshedGround:
    return mesh_coarsely(ground, settings, MAX_VERTICES, MAX_ROCKS)


def mark_as_preview(built: scenes.Built, settings: Settings) -> None:
    """Mark that the ground at full resolution will follow in a scene that shows a preview of ``settings``."""
    if built.preview:
        built.collection[scenes.REFINED] = json.dumps(select_geometry(settings))


def find_preview_of(scene: bpy.types.Scene, settings: Settings) -> scenes.Built | None:
    """Find the built scene if it is a preview whose fine ground will follow; None for another scene, or if the ground's
    settings changed."""
    built = scenes.find_built(scene)
    marked = built is not None and built.collection.get(scenes.REFINED) == json.dumps(select_geometry(settings))
    return built if marked and built is not None and built.preview else None


def show_settings(built: scenes.Built, settings: Settings, side: int) -> bool:
    """Show complete ``settings`` in a built scene, the ground with about ``side``² vertices.

    Returns whether the ground was made again. Settings that cannot be shown raise no error: ``read_notes`` reports
    them.
    """
    with built.reading_marks_once():
        return _show_differences(built, settings, side)


def _show_differences(built: scenes.Built, settings: Settings, side: int) -> bool:
    messages: list[str] = []
    before = merged(built.settings, built.preview)
    ground = None
    if select_geometry(settings) != select_geometry(before) or _has_view_changed(built, settings, before):
        try:
            ground = _show_ground(built, settings, side)
        except IcyMoonError as error:
            messages.append(str(error))
            settings = merged(settings, select_geometry(before))
    messages += _show_surfaces(built, settings, before)
    if list_light_settings(settings) != list_light_settings(before):
        if built.edited_parts("sun"):
            messages.append(_EDITED_MESSAGE.format("Sun"))
        else:
            messages += _show_lights(built, settings)
    if merged(built.settings, built.preview) != before:
        _show_sunlight(built)
    find_site_m = cache(partial(_find_site_m, built, settings, ground))  # it may make the ground's function
    if jitter_rig(settings) != jitter_rig(before) or settings.rig != before.rig or ground is not None:
        if built.edited_parts("camera"):
            messages.append(_EDITED_MESSAGE.format("camera"))
        else:
            _show_rig(built, settings, find_site_m())
    messages += _show_lander(built, settings, before, ground is not None, find_site_m)
    set_notes(built, messages)
    return ground is not None


def _has_view_changed(built: scenes.Built, settings: Settings, before: Settings) -> bool:
    """Return whether the view of coarse ground has changed; such ground is fine enough only in its first view.
    Ground with a trench stays, because only a build digs."""
    keys = (*GRADING_RIG_SETTINGS, *finer_in_view.RELIEF_RIG_SETTINGS)
    return (
        has_coarse_ground(built.scene)
        and not built.edited_parts("camera")
        and not is_dug(settings)
        and any(settings.rig[key] != before.rig[key] for key in keys)
    )


def _show_sunlight(built: scenes.Built) -> None:
    """Update surfaces and lamps with each other's state, without losing the marks of the user's edits. The Sun's
    direction in surfaces does not count in their marks.
    """
    parts = _LIGHT_PARTS
    if not scenes.keeps_light_groups(built.collection):  # to read the marks of all rocks takes 50 ms
        parts += ("terrain object", "rock object")
    by_hand = built.edited_parts(*parts)
    scenes.update_sunlight(built.collection)
    built.remember(built.settings, built.preview, *(part for part in parts if part not in by_hand))


def _show_ground(built: scenes.Built, settings: Settings, side: int) -> Surface:
    """Make a coarse ground with rocks from ``settings``, and return the ground.

    Raises IcyMoonError, without changing the scene, if the ground is from a file, being edited or edited by hand.
    """
    if is_from_file(settings):
        if settings.source.kind != "STAND_IN" and not settings.source.file:
            raise IcyMoonError("source.file is empty; choose a path. The ground stays as it was built.")
        raise IcyMoonError("Ground from a file has no live preview; press Build Scene to build it with its rocks.")
    if built.terrain.mode != "OBJECT":
        raise IcyMoonError("The ground is being edited; leave Edit or Sculpt Mode to see changes of its settings.")
    parts = ("terrain object", "terrain data", "rock object", "rock data")
    # Edits of the lights and the camera are asked for later in the same update.
    by_hand = built.edited_parts(*parts, *_LIGHT_PARTS, "camera").intersection(parts)
    if by_hand:
        is_ground = any(part.startswith("terrain") for part in by_hand)
        raise IcyMoonError(_EDITED_MESSAGE.format("ground" if is_ground else "field of rocks"))
    ground = mesh_coarsely(scenes.make_ground(settings), settings, side**2, MAX_MOVED_ROCKS)
    rocks = _scatter_seen(settings, ground.surface) if settings.rocks.coverage > 0 else None
    check_shelter(settings)
    # From here on nothing raises, so the scene is changed completely or not at all.
    painted_errors.clear_painted(built.scene)  # the painted errors are of the previous ground
    ground.show_in_mesh(built.terrain.data)
    mark_elevation(
        built.terrain.data,
        settings.surface,
        ground.surface.drop_m if isinstance(ground.surface, GradedGround) and settings.mesh.kind == "GRADED" else None,
    )
    coarse = _make_coarse_shapes(settings) if rocks else ()
    shelter = mark_shelter(built.terrain.data, settings, rocks, coarse)
    changed = _show_rocks(built, settings, rocks, shelter)
    built.remember(built.settings, merged(built.preview, select_geometry(settings)), "terrain data", *changed)
    return ground.surface


def _make_coarse_shapes(settings: Settings) -> tuple[tuple[RockShape, ...], ...]:
    rocks = make_paths_absolute(settings).rocks
    return find_rock_shapes(rocks, int(settings.dataset.seed))[-1:]


def _scatter_seen(settings: Settings, ground: Terrain | GradedGround) -> Rocks:
    """Scatter the rocks of the settings that look largest, with the coarsest shapes."""
    rocks, rig = make_paths_absolute(settings).rocks, settings.rig
    step_m = compute_vertex_spacing_m(settings.terrain)

    def heights_on(mesh: Terrain | GradedGround) -> HeightAt:
        if isinstance(mesh, PreviewGround):
            return mesh.compute_mesh_heights
        return lambda x, y: mesh.heights(x, y, 2 * step_m)

    found = scatter_rocks(
        rocks,
        float(settings.terrain.size_m),
        int(settings.dataset.seed),
        heights_on(ground.without_skirts()),
        _make_coarse_shapes(settings) * (1 + len(LEVEL_RANKS)),
        (rig.x_m, rig.y_m, rocks.clear_radius_m),
        make_view_beyond(settings),
        MAX_MOVED_ROCKS,
        heights_on(ground),
    )
    return replace(found, level=np.zeros_like(found.level))


def _show_rocks(
    built: scenes.Built, settings: Settings, rocks: Rocks | None, shelter: RockShelter | None
) -> tuple[str, ...]:
    """Replace the rocks in the scene by ``rocks`` with their ``shelter``, and return the names of the changed parts.
    Unchanged shapes stay, because building and marking them takes longest."""
    old = next((item for item in built.collection.all_objects if item.get(TAG) == "rock"), None)
    if rocks is None:
        scenes.remove_objects([old] if old else [])
        return ("rock",)
    shapes = _make_coarse_shapes(settings)
    if old is not None and move_rocks(old, rocks, shapes, TAG, shelter):
        return ("rock data",)
    ice = next((shape.data.materials[0] for shape in find_instanced_objects(old)), None) if old else None
    new = build_rocks(
        f"{scenes.NAME} Rock",
        rocks,
        shapes,
        ice or build_rock_material(settings, built.terrain.data),
        TAG,
        shelter,
    )
    if old is None:
        shown = new
        shown[TAG] = "rock"
        next(c for c in built.collection.children if c.get(TAG) == "rocks").objects.link(shown)
    else:
        shown = old
        shown.data, new.data = new.data, shown.data
        ours, theirs = shown.modifiers[0], new.modifiers[0]
        ours.node_group, theirs.node_group = theirs.node_group, ours.node_group
        scenes.remove_objects([new])
    scenes.free_names(
        [shown.data, *find_rock_parts(shown, TAG), *(shape.data for shape in find_instanced_objects(shown))]
    )
    return ("rock object", "rock data") if ice else ("rock",)


def _show_surfaces(built: scenes.Built, settings: Settings, before: Settings) -> list[str]:
    """Replace the materials of ground and rocks according to ``settings``; return sentences on unchanged materials."""
    seeds = settings.dataset.seed, before.dataset.seed
    if rebuilt_parts.select_appearance(settings) == rebuilt_parts.select_appearance(before) and seeds[0] == seeds[1]:
        return []
    rocks = (item for item in built.collection.all_objects if item.get(TAG) == "rock")
    shapes = [shape for item in rocks for shape in find_instanced_objects(item)]
    builders = {
        "terrain": ("ground", follow_ground_material, build_ground_material, [built.terrain]),
        "rock": ("rocks", follow_rock_material, build_rock_material, shapes),
    }
    by_hand = built.edited_parts(*(f"{role} materials" for role in builders))
    messages: list[str] = []
    changed: list[str] = []
    if find_elevation_mark(settings.surface) != find_elevation_mark(before.surface):
        changed += [] if built.edited_parts("terrain data") else ["terrain data"]
        mark_elevation(built.terrain.data, settings.surface, _make_drop_function(built))
    for role, (name, follow, make, items) in builders.items():
        if f"{role} materials" in by_hand:
            messages.append(_EDITED_MESSAGE.format(f"surface of the {name}"))
        elif items:
            try:
                if follow(items[0].data.materials[0], settings, built.terrain.data):
                    changed.append(f"{role} materials")
                else:
                    changed += _show_material(built, role, items[0], make(settings, built.terrain.data))
            except IcyMoonError as error:  # an image that cannot be read
                messages.append(str(error))
                break
    remove_unused_images()
    shown = built.settings if messages else merged(built.settings, rebuilt_parts.select_materials(settings))
    preview = {topic: values for topic, values in built.preview.items() if topic != "surface"}
    if rebuilt_parts.describe_mesh_relief(shown) != rebuilt_parts.describe_mesh_relief(
        built.settings
    ):  # the mesh was made for other relief
        preview["surface"] = {key: shown.surface[key] for key in finer_in_view.RELIEF_SETTINGS}
        shown = merged(shown, {"surface": {key: built.settings.surface[key] for key in finer_in_view.RELIEF_SETTINGS}})
    built.remember(shown, preview, *changed)
    return messages


def _show_material(built: scenes.Built, role: str, item: bpy.types.Object, new: bpy.types.Material) -> tuple[str, ...]:
    """Replace the material of the ground or of the rocks on ``item``; return the names of the changed parts.

    The mark of an object has its name only while a material of it is random by object, see ``marks.of_object``.
    Otherwise it stays, and is not read, which takes 50 ms for the rocks.
    """
    old, part = item.data.materials[0], f"{role} object"
    changes_mark = is_random_by_object(old.node_tree) != is_random_by_object(new.node_tree)
    parts = (part,) if changes_mark and not built.edited_parts(part) else ()
    _replace_material(old, new)
    return (f"{role} materials", *parts)


def _make_drop_function(built: scenes.Built) -> Callable[[Array, Array], Array] | None:
    """Make a function of x and y, m, for the drop, m, of curved ground below the site's plane; None for flat ground."""
    place = built.ground.get("map", {})
    if is_from_file(built.settings) and "body_radius_m" in place:
        around = float(place["body_radius_m"])
        return lambda x, y: np.asarray(drop_m(np.hypot(x, y), around))
    shown = merged(built.settings, built.preview)
    if is_from_file(shown) or shown.mesh.kind != "GRADED":
        return None
    rig, radius = shown.rig, float(shown.terrain.body_radius_m)
    return lambda x, y: np.asarray(drop_m(np.hypot(x - rig.x_m, y - rig.y_m), radius))


def _replace_material(old: bpy.types.Material, new: bpy.types.Material) -> None:
    """Replace a material by a new material. If only numbers differ, the old material takes them and keeps its nodes."""
    if old.displacement_method == new.displacement_method and copy_values(old.node_tree, new.node_tree):
        bpy.data.materials.remove(new)
        return
    old.user_remap(new)
    bpy.data.materials.remove(old)
    scenes.free_names([new])


def _show_lights(built: scenes.Built, settings: Settings) -> list[str]:
    """Change the lights according to ``settings``; return a sentence if the sky cannot be computed."""
    try:
        sky = compute_scene_sky(settings)
    except IcyMoonError as error:  # no such date, or no kernels
        return [str(error)]
    keeps = not built.edited_parts("planet data", "planet materials", "planetshine data")
    old = update_lights(built.sun, built.collection, settings, sky, keeps)
    scenes.remove_objects(old)
    for item in [item for item in built.collection.all_objects if item.get(TAG) in ROLES]:
        scenes.free_names([item, item.data, *(slot.material for slot in item.material_slots)])
    built.remember(merged(built.settings, {"light": settings.light}), built.preview, "sun", *ROLES)
    return []


def _show_lander(
    built: scenes.Built, settings: Settings, before: Settings, new_ground: bool, find_site_m: Callable[[], float]
) -> list[str]:
    """Move the lander and its arm according to ``settings``, or build it again; return a sentence if it stays."""
    there = settings.lander.kind != "NONE"
    if rebuilt_parts.select_lander(settings) == rebuilt_parts.select_lander(before) and not (new_ground and there):
        return []
    if built.edited_parts("lander"):
        return [_EDITED_MESSAGE.format("lander")]
    if reasons := list(scene_checks.find_lander_reasons(settings)):
        return [str(reason) for reason in reasons]
    old = {role: item for role, item in find_built_objects(built.collection).items() if role in LANDER_ROLES.values()}
    if there and old and not new_ground and _only_joints_differ(settings, before):
        place_lander(old, settings, find_site_m())
    else:
        scenes.remove_objects(list(old.values()))
        for item in build_lander(settings, find_site_m(), built.terrain) if there else []:
            built.collection.objects.link(item)
            scenes.free_names([item, item.data, *item.data.materials])
    built.remember(merged(built.settings, {"lander": settings.lander, "arm": settings.arm}), built.preview, "lander")
    return []


def _only_joints_differ(settings: Settings, before: Settings) -> bool:
    """Return whether only the lander's joints differ, not its shape and position."""
    turned = {("arm", f"{joint}{key}") for joint in JOINTS for key in ("_deg", "_offset_deg", "_low_deg", "_high_deg")}
    turned.add(("lander", "joints"))
    now, then = rebuilt_parts.select_lander(settings), rebuilt_parts.select_lander(before)
    return all((topic, key) in turned or now[topic][key] == then[topic].get(key) for topic in now for key in now[topic])


def _has_moved(built: scenes.Built, rig: RigSettings) -> bool:
    """Return whether the ground under the cameras of ``rig`` may differ from the ground under the rig of the build."""
    of_build = built.settings.rig
    return (rig.x_m, rig.y_m) != (of_build.x_m, of_build.y_m) or "ZERO" in (rig.height_from, of_build.height_from)


def _find_site_m(built: scenes.Built, settings: Settings, ground: Surface | None) -> float:
    """Find the height in metres of the ground under the cameras of ``settings``, on ``ground`` if it has been made
    already.

    On ground from a file, away from the site where it was built, the height is read from the mesh and only approximate.
    """
    rig, moved = settings.rig, _has_moved(built, settings.rig)
    if not is_from_file(settings):
        if not moved and ground is None and not set(built.preview) - {"rig"}:
            return built.site_m
        return scenes.find_site_ground_m(settings, ground or scenes.make_ground(settings))
    if rig.height_from == "ZERO":
        return scenes.read_stated_ground_m(rig)
    if not moved:
        return built.site_m
    with probe_heights(built.terrain) as height_at:
        under = float(height_at(np.array([rig.x_m]), np.array([rig.y_m]))[0])
    return built.site_m if math.isnan(under) else under


def _show_rig(built: scenes.Built, settings: Settings, site_m: float) -> None:
    """Move the camera to the site of ``settings``, where the ground has the height ``site_m`` in metres."""
    rig, preview = settings.rig, {topic: values for topic, values in built.preview.items() if topic != "rig"}
    built_rig, moved = built.settings.rig, _has_moved(built, settings.rig)
    if not is_from_file(settings):
        if settings.mesh.kind == "GRADED":  # the mesh was made for the rig that it was built with
            of_relief = rebuilt_parts.describe_mesh_relief(settings) != rebuilt_parts.describe_mesh_relief(
                built.settings
            )
            keys = (*GRADING_RIG_SETTINGS, *(finer_in_view.RELIEF_RIG_SETTINGS if of_relief else ()))
            other = {key: built_rig[key] for key in keys if built_rig[key] != rig[key]}
            preview |= {"rig": {key: rig[key] for key in other}} if other else {}
            settings = merged(settings, {"rig": other})
    elif moved and rig.height_from != "ZERO":
        preview["rig"] = {"x_m": rig.x_m, "y_m": rig.y_m}
        settings = merged(settings, {"rig": {"x_m": built_rig.x_m, "y_m": built_rig.y_m}})
    place_rig(built.camera, jitter_rig(merged(settings, {"rig": rig})), site_m)
    if moved and not preview:
        built.collection[scenes.SITE] = site_m
    shown = {key: settings.excavation[key] for key in ("jitter_m", "jitter_deg")}
    built.remember(merged(built.settings, {"rig": settings.rig, "excavation": shown}), preview, "camera")

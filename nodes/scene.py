"""The whole scene from its settings, in a collection of its own.

What the builders make is tagged; building again replaces exactly that. Everything else in the
file, in the collection too, is the person's and stays.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ..errors import IcyMoonError
from ..labels import TERRAIN_INSTANCE
from ..physics.graded import Graded
from ..physics.ground import Surface
from ..physics.rocks import scatter
from ..physics.shapes import block_shapes
from ..physics.sizes import size_law
from ..physics.terrain import Terrain, advice
from ..physics.terrain import terrain as make_terrain
from ..properties import TOPICS
from ..settings import Settings, merged
from . import materials, sunlight, sunlit
from .composition import mark_elevation
from .fingerprint import NAME, TAG, added_objects, edited, fingerprint, parts, updated
from .ground import OwnGround, is_own, own_ground
from .light import build_sky
from .lights import SKY, build_lights, described_sky
from .lights import advice as light_advice
from .materials import ground_material, rock_material
from .own_files import content, used_files
from .probe import heights_of
from .rig import build_rig
from .rocks import build_blocks, parts_of
from .terrain import as_meshed, build_mesh, grid_heights, measured, patch_heights, site_wavelength_m
from .textures import remove_unused_images

_SETTINGS, _FINGERPRINT, _PREVIOUS_WORLD, _PREVIOUS_CAMERA, _PREVIOUS_VIEW, _GROUND = (
    "icymoon_settings", "icymoon_fingerprint", "icymoon_previous_world", "icymoon_previous_camera",
    "icymoon_previous_view", "icymoon_ground")
_PREVIOUS_OSL = "icymoon_previous_osl"
_CONTENT = "icymoon_content"  # hash of the person's own files
_ROUGHNESS = "icymoon_roughness"  # measured on the built ground
PREVIEW = "icymoon_preview"  # settings that are shown otherwise than Build Scene would show them
NOTES = "icymoon_notes"  # why not all settings are shown


@dataclass
class Built:
    """A scene that has been built: its collection, objects and the settings it was built from."""

    collection: bpy.types.Collection
    terrain: bpy.types.Object
    sun: bpy.types.Object
    camera: bpy.types.Object
    settings: Settings
    warnings: tuple[str, ...] = ()

    @property
    def ground(self) -> dict[str, Any]:
        """Of a ground from a file, the ``report`` of its import; else empty."""
        return dict(json.loads(self.collection.get(_GROUND, "{}")))

    @property
    def content(self) -> str:
        """Hash of the content of the person's own files that it was built from; empty without any."""
        return str(self.collection.get(_CONTENT, ""))

    @property
    def extra(self) -> str:
        """What identifies the scene beside the settings: the person's own files, what stands in, edits by hand."""
        edits = fingerprint(self.collection) if self.edited else ""
        return self.content + sunlit.stand_in(self.settings) + edits

    @property
    def materials(self) -> list[bpy.types.Material]:
        """The materials of the ground and the blocks."""
        return sorted(_materials(_with_parts(list(self.collection.all_objects))[0]), key=lambda m: m.name)

    @property
    def block_count(self) -> int:
        """Number of ice blocks."""
        return sum(len(item.data.vertices) for item in self.collection.all_objects if item.get(TAG) == "rock")

    def edited_parts(self, *wanted: str) -> set[str]:
        """Which parts, of these parts and roles or of all, a person has changed since they were built."""
        return edited(self.collection, json.loads(self.collection[_FINGERPRINT]), *wanted)

    @property
    def sky(self) -> dict[str, Any]:
        """Where the lights stand and how bright they are, see ``physics.sky.facts``."""
        return dict(json.loads(self.sun.get(SKY, "{}")))

    @property
    def several_lights(self) -> bool:
        """Whether there may be other light than the Sun's: the planet's, or that of what a person added."""
        return (any(item.get(TAG) == "planet" for item in self.collection.all_objects)
                or bool(added_objects(self.collection)))

    @property
    def edited(self) -> bool:
        """Whether a person has changed or added something since it was built."""
        return bool(added_objects(self.collection)) or bool(self.edited_parts())

    @property
    def preview(self) -> Settings:
        """Settings of which a preview is shown, where ``settings`` say what was built; empty if none is."""
        return dict(json.loads(self.collection.get(PREVIEW, "{}")))

    def remember(self, settings: Settings, preview: Settings, *changed: str) -> None:
        """Remember what the scene shows now, of which the ``changed`` parts or roles are as they should be."""
        self.settings = merged(settings)
        self.collection[_SETTINGS], self.collection[PREVIEW] = json.dumps(self.settings), json.dumps(preview)
        known = json.loads(self.collection[_FINGERPRINT])
        self.collection[_FINGERPRINT] = json.dumps(updated(self.collection, known, *changed))


def find_collection(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection that Build made in this scene, if any."""
    for collection in scene.collection.children_recursive:
        if collection.get(TAG) == "scene":
            return collection
    return None


def find(scene: bpy.types.Scene) -> Built | None:
    """What Build made in this scene, or None if it has not, or if a part of it was deleted."""
    collection = find_collection(scene)
    if collection is None or _SETTINGS not in collection:
        return None
    roles = {item[TAG]: item for item in collection.all_objects if TAG in item}
    if not {"terrain", "sun", "camera"} <= roles.keys():
        return None
    return Built(collection, roles["terrain"], roles["sun"], roles["camera"], json.loads(collection[_SETTINGS]))


def measured_roughness(scene: bpy.types.Scene) -> str:
    """What Build measured on the ground it made from the ``terrain`` settings, in a line; empty if it made none."""
    built = find(scene)
    return str(built.collection.get(_ROUGHNESS, "")) if built and not built.preview else ""


def ground_of(settings: Settings) -> Terrain:
    """The height function of the described ground."""
    return make_terrain(settings, int(settings["dataset"]["seed"]))


def site_ground_m(settings: Settings, ground: Surface) -> float:
    """Height in metres of the ground under the left camera, at the detail of the mesh; NaN beyond the ground."""
    rig = settings["rig"]
    return float(ground.heights(rig["x_m"], rig["y_m"], site_wavelength_m(settings["terrain"], ground)))


def measured_patch(built: Built) -> np.ndarray | None:
    """Heights (n, n) in metres on a grid over the patch of procedural ground; None of other ground."""
    if is_own(built.settings):
        return None
    if built.settings["mesh"]["kind"] == "GRADED":
        return patch_heights(ground_of(built.settings))
    return grid_heights(built.terrain.data, built.settings["terrain"])


def _tagged(block: Any, role: str) -> Any:
    block[TAG] = role
    return block


def _site(settings: Settings, ground: Surface, own: OwnGround | None) -> tuple[float, list[str]]:
    """Height in metres of the ground to stand on, and a warning if the camera stands beside it."""
    rig, size = settings["rig"], settings["terrain"]["size_m"]
    height = site_ground_m(settings, ground)
    if own is not None and math.isnan(height):
        return own.nearest_height_m(rig["x_m"], rig["y_m"]), [
            "There is no ground under the camera; change rig.x_m or rig.y_m, or move the ground with source.origin_x_m "
            "and source.origin_y_m."]
    if own is None and not isinstance(ground, Graded) and max(abs(rig["x_m"]), abs(rig["y_m"])) > size / 2:
        return height, [f"The camera stands outside the {size:g} m patch of ground; change rig.x_m, rig.y_m or "
                        "terrain.size_m."]
    return height, []


def _blocks(settings: Settings, terrain: bpy.types.Object, size_m: float) -> tuple[bpy.types.Object, list[str]]:
    """The object that carries the blocks on the ground, and warnings."""
    seed, described, rig = int(settings["dataset"]["seed"]), settings["rocks"], settings["rig"]
    shapes = block_shapes(described["family"], described["angularity"], seed)
    with heights_of(terrain) as height_at:
        rocks = scatter(described, size_m, seed, height_at, shapes,
                        (rig["x_m"], rig["y_m"], described["clear_radius_m"]))
    ice = rock_material(settings)
    blocks = _tagged(build_blocks(f"{NAME} Rock", rocks, shapes, ice, TAG), "rock")
    _remove_unused([], [ice])  # if there is room for no block
    if rocks.smallest_m > described["smallest_m"]:
        return blocks, [f"Blocks under {rocks.smallest_m:.3g} m are left out to keep to {described['most']} blocks; "
                        "raise rocks.most or rocks.smallest_m."]
    return blocks, []


def _make(settings: Settings) -> tuple[list[bpy.types.Object], bpy.types.World, list[str], OwnGround | None]:
    """All objects of the scene (terrain, Sun, camera, then others), its sky, warnings, and the person's own ground."""
    # What can be refused comes first: nothing has been made yet.
    if settings["rocks"]["coverage"] > 0:
        size_law(settings["rocks"])
    hapke_warnings = sunlit.advice(settings)
    sky = described_sky(settings)
    own = own_ground(settings, ground_of) if is_own(settings) else None
    ground: Surface = own.surface if own else as_meshed(ground_of(settings), settings)
    site_m, warnings = _site(settings, ground, own)
    warnings += hapke_warnings
    if own is not None:
        warnings += own.warnings
        mesh = own.build_mesh(f"{NAME} Terrain")
    else:
        warnings += advice(settings, site_wavelength_m(settings["terrain"], ground))
        warnings += ground.advice(settings) if isinstance(ground, Graded) else []
        mesh = build_mesh(f"{NAME} Terrain", settings["terrain"], ground)
    mark_elevation(mesh, settings["surface"], ground.drop_m if isinstance(ground, Graded) else None)
    warnings += materials.advice(settings)
    mesh.materials.append(ground_material(settings))
    terrain = _tagged(bpy.data.objects.new(f"{NAME} Terrain", mesh), "terrain")
    terrain.pass_index = TERRAIN_INSTANCE
    lights = build_lights(settings, sky)
    warnings += light_advice(sky)
    camera = _tagged(build_rig(f"{NAME} Camera", settings["rig"], site_m), "camera")
    objects = [terrain, lights[0], camera, *lights[1:]]
    if settings["rocks"]["coverage"] > 0:
        blocks, more = _blocks(settings, terrain, ground.size_m)
        objects.append(blocks)
        warnings += more
    return objects, _tagged(build_sky(f"{NAME} Sky"), "sky"), warnings, own


def _with_parts(objects: list[bpy.types.Object]) -> tuple[list[bpy.types.Object], list[Any]]:
    """Objects with those that others among them are made with, and the other data-blocks of that kind."""
    others = [part for item in objects for part in parts_of(item, TAG)]
    return ([*objects, *(part for part in others if isinstance(part, bpy.types.Object))],
            [part for part in others if not isinstance(part, bpy.types.Object)])


def _materials(objects: list[bpy.types.Object]) -> set[bpy.types.Material]:
    meshes = {item.data for item in objects if isinstance(item.data, bpy.types.Mesh)}
    return {material for mesh in meshes for material in mesh.materials if material is not None}


def _remove_unused(meshes: Iterable[Any], others: Iterable[Any]) -> None:
    """Remove data-blocks that nothing uses: an orphaned mesh would stay in memory for good."""
    for blocks in (meshes, others):
        unused = [block for block in blocks if block is not None and block.users == 0]
        if unused:
            bpy.data.batch_remove(unused)


def remove_leftovers() -> None:
    """Remove built worlds and lamps' collections that are no longer used."""
    _remove_unused([], [w for w in bpy.data.worlds if TAG in w])
    _remove_unused([], [c for c in bpy.data.collections if c.get(TAG) == sunlight.SHARED])


def remove(objects: list[bpy.types.Object]) -> None:
    """Remove objects with the meshes, lamps, cameras, materials and node groups that only they use."""
    objects, others = _with_parts(objects)
    data = {item.data for item in objects if item.data is not None}
    materials = {m for m in _materials(objects) if TAG in m}
    bpy.data.batch_remove([*objects, *others])
    _remove_unused(data, materials)
    remove_unused_images()


def free_names(blocks: Iterable[Any]) -> None:
    """Give data-blocks the names that were taken by those which they replace."""
    for block in blocks:
        block.name = block.name.split(".")[0]


def _adopt_children(collection: bpy.types.Collection, old: list[bpy.types.Object],
                    new: list[bpy.types.Object]) -> None:
    """Keep the person's objects attached to the new camera, Sun or ground as they were to the old."""
    successor = {item[TAG]: item for item in reversed(new)}
    for item in bpy.data.objects:
        if item.parent in old and item not in old:
            inverse = item.matrix_parent_inverse.copy()
            item.parent = successor.get(item.parent[TAG], successor["terrain"])
            item.matrix_parent_inverse = inverse


def sun_shines(collection: bpy.types.Collection) -> None:
    """Make surfaces, lamp and window agree, after any of them has changed: the surfaces know where the lamp is, it
    lights only what does not trace it, and the scenes use Open Shading Language if a surface needs it."""
    objects = [item for item in collection.all_objects if TAG in item]
    lamp = next(item for item in objects if item[TAG] == "sun")
    used = {item: _materials(_with_parts([item])[0]) for item in objects}
    for item in _with_parts([item for item in objects if item[TAG] in ("terrain", "rock")])[0]:
        item.lightgroup = lamp.lightgroup  # what it gives off itself is sunlight that it has traced
    every = set().union(*used.values())
    # As the lamp has it, in single precision, so that aiming again at render time changes nothing.
    sunlight.aim(every, sunlight.Sun.from_lamp(lamp, lamp.matrix_basis))
    sunlight.share_lamp(f"{NAME} Traced Sun", lamp, [item for item in objects if any(map(sunlight.traces, used[item]))])
    remove_leftovers()
    for scene in bpy.data.scenes:
        if find_collection(scene) == collection:
            scene.cycles.shading_system = bool(collection.get(_PREVIOUS_OSL, False)) or any(map(sunlight.is_osl, every))


def build(scene: bpy.types.Scene, settings: Settings) -> Built:
    """Build, or build again, the scene that complete ``settings`` describe.

    Sets the scene's camera and world to the built ones unless the person has set others since the
    first build. Raises IcyMoonError if there is not enough memory, or the ground's file cannot be
    used; the scene is then unchanged.
    """
    collection = find_collection(scene)
    try:
        objects, sky, warnings, own = _make(settings)
    except MemoryError:
        if settings["source"]["kind"] == "MESH":
            raise IcyMoonError("There is not enough memory for the mesh; reduce it before importing it.") from None
        if settings["mesh"]["kind"] == "GRADED" and not is_own(settings):
            raise IcyMoonError("There is not enough memory for the mesh; lower mesh.most.") from None
        n = settings["terrain"]["resolution"]
        raise IcyMoonError(f"There is not enough memory for {n} x {n} vertices; lower terrain.resolution.") from None
    if collection is None:
        collection = _tagged(bpy.data.collections.new(NAME), "scene")
        scene.collection.children.link(collection)
        collection[_PREVIOUS_WORLD], collection[_PREVIOUS_CAMERA] = scene.world, scene.camera
        collection[_PREVIOUS_VIEW] = [scene.view_settings.exposure, scene.render.resolution_x,
                                      scene.render.resolution_y]
        collection[_PREVIOUS_OSL] = scene.cycles.shading_system
        first = True
    else:
        first = False
    blocks_collection = next((c for c in collection.children if c.get(TAG) == "rocks"), None)
    if blocks_collection is None:
        blocks_collection = _tagged(bpy.data.collections.new(f"{NAME} Rocks"), "rocks")
        collection.children.link(blocks_collection)
    old = [item for item in collection.all_objects if TAG in item]
    takes_camera = first or scene.camera is None or scene.camera in old
    takes_world = first or scene.world is None or TAG in scene.world
    _adopt_children(collection, old, objects)
    remove(old)
    for item in objects:
        (blocks_collection if item[TAG] == "rock" else collection).objects.link(item)
    if takes_camera:
        scene.camera = objects[2]
    if takes_world:
        scene.world = sky
    remove_leftovers()
    made, others = _with_parts(objects)
    named = [*made, *(o.data for o in made), *others, *_materials(made)] + ([sky] if takes_world else [])
    free_names(named)
    sun_shines(collection)
    collection[_SETTINGS] = json.dumps(merged(settings))
    collection[_GROUND] = json.dumps({"report": own.report, "site_m": _site(settings, own.surface, own)[0]}
                                     if own else {})
    collection[_CONTENT] = content(settings)
    built = Built(collection, objects[0], objects[1], objects[2], merged(settings), tuple(warnings))
    roughness = measured(measured_patch(built), settings["terrain"])
    collection[_ROUGHNESS] = roughness.summary() if roughness else ""
    collection[_FINGERPRINT], collection[PREVIEW] = json.dumps(parts(collection)), "{}"
    collection[NOTES] = "[]"
    return built


def clear(scene: bpy.types.Scene) -> bool:
    """Remove what Build made and give the scene its earlier world, camera, frame and view exposure back.

    Objects that a person put into the collection stay, in the scene's own collection.
    Returns whether there was anything to remove.
    """
    collection = find_collection(scene)
    if collection is None:
        return False
    previous_world, previous_camera = collection.get(_PREVIOUS_WORLD), collection.get(_PREVIOUS_CAMERA)
    ours = [item for item in collection.all_objects if TAG in item]
    scene.view_settings.exposure, *resolution = collection[_PREVIOUS_VIEW]
    scene.cycles.shading_system = bool(collection.get(_PREVIOUS_OSL, False))
    scene.render.resolution_x, scene.render.resolution_y = (int(n) for n in resolution)
    if scene.camera in ours or scene.camera is None:
        scene.camera = previous_camera
    if scene.world is None or TAG in scene.world:
        scene.world = previous_world
    for item in [item for item in collection.all_objects if TAG not in item]:
        if item.name not in scene.collection.objects:
            scene.collection.objects.link(item)
    remove(ours)
    for child in [c for c in collection.children_recursive if TAG in c]:
        bpy.data.collections.remove(child)
    bpy.data.collections.remove(collection)
    remove_leftovers()
    return True


def extra(settings: Settings) -> str:
    """``Built.extra`` of the scene that settings would build."""
    return content(settings) + sunlit.stand_in(settings)


def changed_settings(built: Built, settings: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Names of the settings that the built scene does not show yet, those of files also if the content is another."""
    shown = [(topic.key, s.key) for topic in TOPICS.values() for s in topic.settings
             if s.effect in ("geometry", "material", "light", "camera")]
    changed = [f"{topic}.{key}" for topic, key in shown
               if built.settings.get(topic, {}).get(key) != settings[topic][key]]
    files = used_files(settings)
    # A file that is gone changes nothing: what was built from it is still there.
    if all(path.is_file() for path in files.values()) and built.content != content(settings):
        changed += files
    return changed

"""The whole scene from its settings, in a collection of its own.

What the builders make is tagged; building again replaces exactly that. Everything else in the
file, in the collection too, is the person's and stays.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ..errors import IcyMoonError
from ..labels import ROCK, TERRAIN, TERRAIN_INSTANCE
from ..physics.rocks import scatter
from ..physics.terrain import Terrain
from ..physics.terrain import terrain as make_terrain
from ..settings import Settings, merged
from .fingerprint import TAG, added_objects, fingerprint
from .light import build_sky, build_sun
from .rig import build_rig
from .rocks import SHAPES, build_objects, build_shapes
from .surface import build_material
from .terrain import build_mesh, shortest_wavelength_m

NAME = "Icy Moon"
_SETTINGS, _FINGERPRINT, _PREVIOUS_WORLD, _PREVIOUS_CAMERA, _PREVIOUS_VIEW = (
    "icymoon_settings", "icymoon_fingerprint", "icymoon_previous_world", "icymoon_previous_camera",
    "icymoon_previous_view")


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
    def edited(self) -> bool:
        """Whether a person has changed or added something since it was built."""
        return bool(added_objects(self.collection)) or self.collection[_FINGERPRINT] != fingerprint(self.collection)


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


def ground_of(settings: Settings) -> Terrain:
    """The height function of the described ground."""
    return make_terrain(settings["terrain"], int(settings["dataset"]["seed"]))


def site_ground_m(settings: Settings, ground: Terrain) -> float:
    """Height in metres of the ground under the left camera, at the detail of the mesh."""
    rig = settings["rig"]
    return float(ground.heights(rig["x_m"], rig["y_m"], shortest_wavelength_m(settings["terrain"])))


def _tagged(block: Any, role: str) -> Any:
    block[TAG] = role
    return block


def _make(settings: Settings) -> tuple[list[bpy.types.Object], bpy.types.World, list[str]]:
    """All objects of the scene (terrain, sun, camera, then blocks), its sky, and warnings."""
    seed, warnings = int(settings["dataset"]["seed"]), []
    ground = ground_of(settings)
    mesh = build_mesh(f"{NAME} Terrain", settings["terrain"], ground)
    mesh.materials.append(_tagged(build_material(f"{NAME} Surface", settings["surface"], seed, TERRAIN), "material"))
    terrain = _tagged(bpy.data.objects.new(f"{NAME} Terrain", mesh), "terrain")
    terrain.pass_index = TERRAIN_INSTANCE
    sun = _tagged(build_sun(f"{NAME} Sun", settings["light"]), "sun")
    camera = _tagged(build_rig(f"{NAME} Camera", settings["rig"], site_ground_m(settings, ground)), "camera")
    objects = [terrain, sun, camera]
    rig, half = settings["rig"], settings["terrain"]["size_m"] / 2
    if max(abs(rig["x_m"]), abs(rig["y_m"])) > half:
        warnings.append(f"The camera stands outside the {2 * half:g} m patch of ground; change rig.x_m, rig.y_m "
                        "or terrain.size_m.")
    if settings["light"]["sun_elevation_deg"] < 0 or settings["light"]["sun_irradiance_wm2"] == 0:
        warnings.append("The Sun gives no light; raise light.sun_elevation_deg or light.sun_irradiance_wm2.")
    if settings["rocks"]["coverage"] > 0:
        rocks = scatter(settings["rocks"], ground, seed, shortest_wavelength_m(settings["terrain"]), SHAPES,
                        (rig["x_m"], rig["y_m"]))
        if rocks.smallest_m > settings["rocks"]["smallest_m"]:
            warnings.append(f"Blocks under {rocks.smallest_m:.3g} m are left out to keep to "
                            f"{settings['rocks']['most']} blocks; raise rocks.most or rocks.smallest_m.")
        ice = _tagged(build_material(f"{NAME} Rock Surface", settings["surface"], seed, ROCK), "material")
        shapes = build_shapes(f"{NAME} Rock", settings["rocks"]["angularity"], seed)
        objects += [_tagged(block, "rock") for block in build_objects(f"{NAME} Rock", rocks, shapes, ice)]
        _remove_unused(shapes, [ice])
    return objects, _tagged(build_sky(f"{NAME} Sky"), "sky"), warnings


def _materials(objects: list[bpy.types.Object]) -> set[bpy.types.Material]:
    meshes = {item.data for item in objects if isinstance(item.data, bpy.types.Mesh)}
    return {material for mesh in meshes for material in mesh.materials if material is not None}


def _remove_unused(meshes: Iterable[Any], others: Iterable[Any]) -> None:
    """Remove data-blocks that nothing uses: an orphaned mesh would stay in memory for good."""
    for blocks in (meshes, others):
        unused = [block for block in blocks if block is not None and block.users == 0]
        if unused:
            bpy.data.batch_remove(unused)


def _remove(objects: list[bpy.types.Object]) -> None:
    """Remove objects with the meshes, lamps, cameras and materials that only they use."""
    data = {item.data for item in objects if item.data is not None}
    materials = {m for m in _materials(objects) if TAG in m}
    bpy.data.batch_remove(objects)
    _remove_unused(data, materials)


def _adopt_children(collection: bpy.types.Collection, old: list[bpy.types.Object],
                    new: list[bpy.types.Object]) -> None:
    """Keep the person's objects attached to the new camera, Sun or ground as they were to the old."""
    successor = {item[TAG]: item for item in reversed(new)}
    for item in bpy.data.objects:
        if item.parent in old and item not in old:
            inverse = item.matrix_parent_inverse.copy()
            item.parent = successor.get(item.parent[TAG], successor["terrain"])
            item.matrix_parent_inverse = inverse


def build(scene: bpy.types.Scene, settings: Settings) -> Built:
    """Build, or build again, the scene that complete ``settings`` describe.

    Sets the scene's camera and world to the built ones unless the person has set others since the
    first build. Raises IcyMoonError if there is not enough memory; the scene is then unchanged.
    """
    collection = find_collection(scene)
    try:
        objects, sky, warnings = _make(settings)
    except MemoryError:
        n = settings["terrain"]["resolution"]
        raise IcyMoonError(f"There is not enough memory for {n} x {n} vertices; lower terrain.resolution.") from None
    if collection is None:
        collection = _tagged(bpy.data.collections.new(NAME), "scene")
        scene.collection.children.link(collection)
        collection[_PREVIOUS_WORLD], collection[_PREVIOUS_CAMERA] = scene.world, scene.camera
        collection[_PREVIOUS_VIEW] = [scene.view_settings.exposure, scene.render.resolution_x,
                                      scene.render.resolution_y]
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
    _remove(old)
    for item in objects:
        (blocks_collection if item[TAG] == "rock" else collection).objects.link(item)
    if takes_camera:
        scene.camera = objects[2]
    if takes_world:
        scene.world = sky
    _remove_unused([], [w for w in bpy.data.worlds if TAG in w])
    named = [*objects, *(o.data for o in objects), *_materials(objects)] + ([sky] if takes_world else [])
    for block in named:
        block.name = block.name.split(".")[0]  # free again now that the old one is gone
    collection[_SETTINGS] = json.dumps(merged(settings))
    collection[_FINGERPRINT] = fingerprint(collection)
    return Built(collection, objects[0], objects[1], objects[2], merged(settings), tuple(warnings))


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
    scene.render.resolution_x, scene.render.resolution_y = (int(n) for n in resolution)
    if scene.camera in ours or scene.camera is None:
        scene.camera = previous_camera
    if scene.world is None or TAG in scene.world:
        scene.world = previous_world
    for item in [item for item in collection.all_objects if TAG not in item]:
        if item.name not in scene.collection.objects:
            scene.collection.objects.link(item)
    _remove(ours)
    for child in [c for c in collection.children_recursive if TAG in c]:
        bpy.data.collections.remove(child)
    bpy.data.collections.remove(collection)
    _remove_unused([], [w for w in bpy.data.worlds if TAG in w])
    return True


def changed_settings(built: Built, settings: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Names of the settings that the built scene does not show yet."""
    return [f"{topic}.{key}" for topic in ("terrain", "surface", "rocks", "light", "rig")
            for key, value in settings[topic].items() if built.settings.get(topic, {}).get(key) != value] + (
        ["dataset.seed"] if built.settings["dataset"]["seed"] != settings["dataset"]["seed"] else [])

"""What changed settings look like, at once, in the scene that is built.

Light, camera and surfaces become what Build Scene would make of them. The ground becomes a coarse
grid of the same height function with the largest rocks on it, which Build Scene replaces and
nothing renders. What the user has edited by hand is left as it is, and so is a ground from a file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np

from ..errors import IcyMoonError
from ..physics.mesh.grading import OF_THE_RIG
from ..physics.mesh.height_map import HeightMap
from ..physics.mesh.height_surface import Surface
from ..physics.mesh.horizon import drop_m
from ..physics.rocks.rocks import LEVEL_RANKS, Rocks, scatter
from ..physics.rocks.shapes import Shape, make_rock_shapes
from ..settings import changes
from ..settings.changes import geometry
from ..settings.description import merged
from ..typed_settings import Settings
from . import scene as scenes
from .datablocks.fingerprint import TAG, instanced_objects
from .ground.heights_under import probe_heights
from .ground.rocks import build_rocks, parts_of
from .ground.terrain_mesh import fill_mesh, grid
from .ground.user_ground import is_from_file
from .light.scene_lights import ROLES, change_lights, described_sky, settings_of_lights
from .rig import place_rig
from .surface.ground_and_rock_materials import build_ground_material, build_rock_material
from .surface.images import remove_unused_images
from .surface.patches_and_grain import mark_elevation
from .tree.builder import take_values

#: Most rocks that a preview shows; the smallest are left out.
MOST_ROCKS = 1000
_EDITED = "The {} was edited by hand, so sliders leave it as it is; Build Scene makes it anew."


def notes(scene: bpy.types.Scene) -> list[str]:
    """What the user should know about how the scene shows the settings: sentences, none if it shows them all."""
    collection = scenes.find_collection(scene)
    if collection is None:
        return []
    said: list[str] = json.loads(collection.get(scenes.NOTES, "[]"))
    shows = json.loads(collection.get(scenes.PREVIEW, "{}"))
    return said + (["Preview: press Build Scene"] if shows and not said else [])


def set_notes(built: scenes.Built, sentences: list[str]) -> None:
    """Set what ``notes`` states; nothing is written where nothing changes."""
    sentences = list(dict.fromkeys(sentences))  # one cause, such as a file that is missing, may keep two parts back
    if json.dumps(sentences) != built.collection.get(scenes.NOTES, "[]"):
        built.collection[scenes.NOTES] = json.dumps(sentences)


def show_settings(built: scenes.Built, settings: Settings, side: int) -> bool:
    """Show complete ``settings`` in a built scene, the ground with at most ``side`` vertices per side.

    Returns whether the ground was made anew. What cannot be shown is in ``notes``; nothing is raised for it.
    """
    said: list[str] = []
    before = merged(built.settings, built.preview)
    ground = None
    if geometry(settings) != geometry(before):
        try:
            ground = _show_ground(built, settings, side)
        except IcyMoonError as error:
            said.append(str(error))
            settings = merged(settings, geometry(before))
    said += _show_surfaces(built, settings, before)
    if settings_of_lights(settings) != settings_of_lights(before):
        if built.edited_parts("sun"):
            said.append(_EDITED.format("Sun"))
        else:
            said += _show_lights(built, settings)
    if merged(built.settings, built.preview) != before:
        _show_sunlight(built)
    if settings.rig != before.rig or ground is not None:
        if built.edited_parts("camera"):
            said.append(_EDITED.format("camera"))
        else:
            _show_rig(built, settings, ground)
    set_notes(built, said)
    return ground is not None


def _show_sunlight(built: scenes.Built) -> None:
    """Make surfaces and lamp agree; what the user has edited of either stays an edit.

    What surfaces know of the Sun is no part of their marks.
    """
    parts = ("sun object", "planetshine object", "terrain object", "rock object")
    by_hand = built.edited_parts(*parts)
    scenes.update_sunlight(built.collection)
    built.remember(built.settings, built.preview, *(part for part in parts if part not in by_hand))


def _show_ground(built: scenes.Built, settings: Settings, side: int) -> Surface:
    """Make the ground and its rocks as ``settings`` say, coarsely, and return the ground's height function.

    Raises IcyMoonError if that cannot or must not be done; the scene is then unchanged.
    """
    if is_from_file(settings):
        raise IcyMoonError("Your own ground and the rocks on it are made by Build Scene, not while settings change.")
    if built.terrain.mode != "OBJECT":
        raise IcyMoonError("The ground is being edited; leave Edit or Sculpt Mode to see changes of its settings.")
    by_hand = {part.split()[0] for part in built.edited_parts("terrain object", "terrain data", "rock object",
                                                              "rock data")}
    if by_hand:
        raise IcyMoonError(_EDITED.format("ground" if "terrain" in by_hand else "field of rocks"))
    coarse = merged(settings, {"terrain": {"resolution": min(side, int(settings.terrain.resolution))}})
    ground = scenes.ground_of(settings)
    positions, faces = grid(coarse.terrain, ground)
    rocks = _scatter_largest(coarse, positions) if coarse.rocks.coverage > 0 else None
    # Nothing is refused from here on.
    fill_mesh(built.terrain.data, positions, faces)
    mark_elevation(built.terrain.data, settings.surface)
    changed = _show_rocks(built, coarse, rocks)
    built.remember(built.settings, merged(built.preview, geometry(settings)), "terrain data", *changed)
    return ground


def _coarse_shapes(settings: Settings) -> tuple[tuple[Shape, ...], ...]:
    rocks = settings.rocks
    return make_rock_shapes(rocks.family, rocks.angularity, int(settings.dataset.seed))[-1:]


def _scatter_largest(settings: Settings, positions: np.ndarray) -> Rocks:
    """The largest of the described rocks, of the coarsest shapes, on a grid of positions (n², 3)."""
    rocks, rig, size = settings.rocks, settings.rig, float(settings.terrain.size_m)
    n = round(len(positions) ** 0.5)
    pixel = size / (n - 1)
    heights = positions[:, 2].reshape(n, n)[::-1].astype(np.float64)
    ground = HeightMap(heights, (pixel, pixel), -size / 2, -size / 2, size)
    found = scatter(rocks | {"most": min(rocks.most, MOST_ROCKS)}, size, int(settings.dataset.seed),
                    ground.heights, _coarse_shapes(settings) * (1 + len(LEVEL_RANKS)),
                    (rig.x_m, rig.y_m, rocks.clear_radius_m))
    return replace(found, level=np.zeros_like(found.level))


def _show_rocks(built: scenes.Built, settings: Settings, rocks: Rocks | None) -> tuple[str, ...]:
    """Put ``rocks`` in the place of the rocks there are; which parts that has changed."""
    there = next((item for item in built.collection.all_objects if item.get(TAG) == "rock"), None)
    if rocks is None:
        scenes.remove([there] if there else [])
        return ("rock",)
    ice = next((shape.data.materials[0] for shape in instanced_objects(there)), None) if there else None
    new = build_rocks(f"{scenes.NAME} Rock", rocks, _coarse_shapes(settings),
                      ice or build_rock_material(settings, built.terrain.data), TAG)
    if there is None:
        there = new
        there[TAG] = "rock"
        next(c for c in built.collection.children if c.get(TAG) == "rocks").objects.link(there)
    else:
        there.data, new.data = new.data, there.data
        ours, theirs = there.modifiers[0], new.modifiers[0]
        ours.node_group, theirs.node_group = theirs.node_group, ours.node_group
        scenes.remove([new])
    scenes.free_names([there.data, *parts_of(there, TAG), *(shape.data for shape in instanced_objects(there))])
    return ("rock object", "rock data") if ice else ("rock",)


def _show_surfaces(built: scenes.Built, settings: Settings, before: Settings) -> list[str]:
    """Make ground and rocks of what ``settings`` say; what keeps that from being done, in sentences."""
    seeds = settings.dataset.seed, before.dataset.seed
    if changes.look(settings) == changes.look(before) and seeds[0] == seeds[1]:
        return []
    made = {"terrain": ("ground", build_ground_material, [built.terrain]),
            "rock": ("blocks", build_rock_material,
                     [shape for item in built.collection.all_objects if item.get(TAG) == "rock"
                      for shape in instanced_objects(item)])}
    by_hand = built.edited_parts(*(f"{role} materials" for role in made))
    said: list[str] = []
    changed: list[str] = []
    if bool(settings.surface.trough_dirt) != bool(before.surface.trough_dirt):
        changed += [] if built.edited_parts("terrain data") else ["terrain data"]
        mark_elevation(built.terrain.data, settings.surface, _roundness(built))
    for role, (name, make, items) in made.items():
        if f"{role} materials" in by_hand:
            said.append(_EDITED.format(f"surface of the {name}"))
        elif items:
            try:
                _replace_material(items[0].data.materials[0], make(settings, built.terrain.data))
                changed.append(f"{role} materials")
            except IcyMoonError as error:  # an image that cannot be read
                said.append(str(error))
                break
    remove_unused_images()
    shown = built.settings if said else merged(built.settings, changes.materials(settings))
    built.remember(shown, built.preview, *changed)
    return said


def _roundness(built: scenes.Built) -> Callable[[np.ndarray, np.ndarray], np.ndarray] | None:
    """How far the ground that is shown falls at coordinates, like the body; None where it is flat."""
    if is_from_file(built.settings) or built.settings.mesh.kind != "GRADED" or "terrain" in built.preview:
        return None
    rig, radius = built.settings.rig, float(built.settings.terrain.body_radius_m)
    return lambda x, y: np.asarray(drop_m(np.hypot(x - rig.x_m, y - rig.y_m), radius))


def _replace_material(old: bpy.types.Material, new: bpy.types.Material) -> None:
    """Make one material what another is, which is gone afterwards; its own nodes stay if only numbers differ."""
    if old.displacement_method == new.displacement_method and take_values(old.node_tree, new.node_tree):
        bpy.data.materials.remove(new)
        return
    old.user_remap(new)
    bpy.data.materials.remove(old)
    scenes.free_names([new])


def _show_lights(built: scenes.Built, settings: Settings) -> list[str]:
    """Make the lights what ``settings`` say; what keeps that from being done, in sentences."""
    try:
        sky = described_sky(settings)
    except IcyMoonError as error:  # no such date, or no kernels
        return [str(error)]
    old = change_lights(built.sun, built.collection, settings, sky)
    scenes.remove(old)
    for item in [item for item in built.collection.all_objects if item.get(TAG) in ROLES]:
        scenes.free_names([item, item.data, *(slot.material for slot in item.material_slots)])
    built.remember(merged(built.settings, {"light": settings.light}), built.preview, "sun", *ROLES)
    return []


def _show_rig(built: scenes.Built, settings: Settings, ground: Surface | None) -> None:
    """Put the camera where ``settings`` say, on the ``ground`` if it has been made already.

    On a ground from a file, away from where it was built, the camera is only nearly there.
    """
    rig, preview = settings.rig, {topic: values for topic, values in built.preview.items() if topic != "rig"}
    site_m, stood = built.site_m, built.settings.rig
    moved = (rig.x_m, rig.y_m) != (stood.x_m, stood.y_m)
    if not is_from_file(settings):
        if moved or ground is not None or preview:
            site_m = scenes.site_ground_m(settings, ground or scenes.ground_of(settings))
        if settings.mesh.kind == "GRADED":  # the mesh was made for the rig that it was built with
            other = {key: stood[key] for key in OF_THE_RIG if stood[key] != rig[key]}
            preview |= {"rig": {key: rig[key] for key in other}} if other else {}
            settings = merged(settings, {"rig": other})
    elif moved:
        with probe_heights(built.terrain) as height_at:
            under = float(height_at(np.array([rig.x_m]), np.array([rig.y_m]))[0])
        site_m = site_m if math.isnan(under) else under
        preview["rig"] = {"x_m": rig.x_m, "y_m": rig.y_m}
        settings = merged(settings, {"rig": {"x_m": stood.x_m, "y_m": stood.y_m}})
    place_rig(built.camera, rig, site_m)
    if moved and not preview:
        built.collection[scenes.SITE] = site_m
    built.remember(merged(built.settings, {"rig": settings.rig}), preview, "camera")

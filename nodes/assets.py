"""Makes assets of Blender from shipped presets: landscapes, surfaces, stereo cameras and lights, one file for each
asset. The sky is one more asset.

Build Scene makes the content of an asset from the preset. The marks of Icy Moon are then removed, because a dropped
asset belongs to the user. Blender drops no scenes, so a landscape is a collection. It has a coarse ground, so that the
library is small. Materials compute Hapke's law by nodes, since a dropped material cannot switch a scene to Open Shading
Language.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..formats.asset_library import catalog_id
from ..settings import description, preset_files
from ..settings.topics.declaration import Parts
from ..settings.topics.scene import Settings
from ..support.blender import compat
from .build_scene import NAME
from .change_scene import open_empty_scene
from .datablocks.fingerprint import TAG
from .light.lamps import find_lamp_matrix
from .light.scene_lights import build_lights, compute_scene_sky
from .light.sun_lamp import build_sky
from .rig import build_rig
from .surface.ground_and_rock_materials import build_ground_material

AUTHOR, LICENSE = "Icy Moon developers", "GPL-3.0-or-later"
#: Number of vertices of a landscape's ground. 32 000 need 1.6 MB and lie within 4 to 30 px of the exact ground.
MAX_VERTICES = 32_000
_ASSET_SETTINGS: Parts = {"mesh": {"most": MAX_VERTICES}, "hapke": {"backend": "NODES", "accuracy": "FAST"}}


#: The asset without a preset, and the preset whose picture it gets.
SKY, _SKY_PICTURE_PRESET = "skies/airless", "lights/guiss_europa"


def list_asset_names() -> list[str]:
    """List the names of the presets that become assets, and of the sky."""
    return [*(name for kind in _MAKER_BY_KIND for name in preset_files.preset_names(kind)), SKY]


def make_asset_settings(name: str) -> Settings:
    """Make the complete settings from which the asset of a preset is made."""
    preset: Parts = preset_files.load_preset(name) if name != SKY else {}
    return description.merged(description.defaults(), preset, _ASSET_SETTINGS)


def _read_header(name: str) -> tuple[str, str]:
    """Return the title and the description of an asset."""
    if name == SKY:
        return "Airless Sky", "A black world: an airless moon has no light from its sky."
    title, text = preset_files.read_preset_header(name)
    return (
        title,
        f"{text}. {_describe_resolution(make_asset_settings(name)) if name.startswith('rigs/') else ''}Preset {name}",
    )


def write_asset(name: str, path: Path) -> None:
    """Make an asset in a new, empty file, and write it with its dependencies to a .blend file."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    kind = name.split("/")[0]
    settings = make_asset_settings(name)
    block = _MAKER_BY_KIND[kind](settings)
    title, text = _read_header(name)
    _give_to_user(title)
    block.name = title
    block.asset_mark()
    facts = block.asset_data
    facts.catalog_id, facts.author, facts.license = catalog_id(kind), AUTHOR, LICENSE
    facts.description = text
    for tag in _make_tags(kind, settings):
        facts.tags.new(tag, skip_if_exists=True)
    _set_picture(block, preset_files.find_preview(_SKY_PICTURE_PRESET if name == SKY else name))
    path.parent.mkdir(parents=True, exist_ok=True)
    _forget_scene()
    # In Blender 5.0, ``libraries.write`` leaves out the pictures of collections.
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=True, check_existing=False)


def _make_landscape(settings: Settings) -> bpy.types.Collection:
    """Make a collection of ground, rocks, lights and camera, as Build Scene does.

    The hidden shapes of rocks are in the collection too. Otherwise Blender would put them into the scene, as it does
    with every object of a dropped asset that is outside its collections.
    """
    collection = open_empty_scene(settings).collection
    for shapes in [each for each in bpy.data.collections if each.get(TAG) == "rock shapes"]:
        collection.children.link(shapes)
        shapes.hide_viewport = shapes.hide_render = True
    return collection


def _make_surface(settings: Settings) -> bpy.types.Material:
    """Make the material of the ground."""
    return build_ground_material(settings, bpy.data.meshes.new(NAME))


def _make_rig(settings: Settings) -> bpy.types.Object:
    """Make an empty object that carries the stereo camera at the height and pitch of the settings.

    Blender sets location and rotation of the dropped object, so the empty is the foot of the mast. Its custom property
    refers to the camera, so Blender puts the camera into the scene too.
    """
    mast = bpy.data.objects.new(NAME, None)
    mast["camera"] = camera = build_rig(f"{NAME} Camera", settings.rig, 0.0)
    camera.parent = mast
    return mast


def _make_light(settings: Settings) -> bpy.types.Collection:
    """Make a collection of the Sun, the planet, the planet's light and lamps, about the origin."""
    collection = bpy.data.collections.new(NAME)
    camera = build_rig(NAME, settings.rig, 0.0)
    for item in build_lights(settings, compute_scene_sky(settings), camera):
        for constraint in list(item.constraints):  # the planet follows the camera, which is not part of the asset
            item.constraints.remove(constraint)
        if item.parent is not None:  # nor do lamps
            world = find_lamp_matrix(item)
            item.parent, item.matrix_basis = None, world
        collection.objects.link(item)
    bpy.data.objects.remove(camera)
    return collection


def _make_sky(settings: Settings) -> bpy.types.World:
    """Make the world that Build Scene gives a scene."""
    return build_sky(NAME)


_MAKER_BY_KIND: dict[str, Any] = {
    "scenes": _make_landscape,
    "gallery": _make_landscape,
    "surfaces": _make_surface,
    "rigs": _make_rig,
    "lights": _make_light,
    "bodies": _make_light,
    "skies": _make_sky,
}


def _give_to_user(title: str) -> None:
    """Take away the marks by which Build Scene knows its data-blocks, and name the data-blocks after the asset."""
    for block in bpy.data.user_map():
        if not isinstance(block, bpy.types.Scene):
            for key in [key for key in compat.list_custom_properties(block) if key.startswith(TAG)]:
                del block[key]
            if block.library is None and block.name.startswith(NAME):
                block.name = block.name.replace(NAME, title, 1)


def _forget_scene() -> None:
    """Replace the scene, and everything that only it uses, by an empty scene, because a file must have one."""
    built, _ = bpy.context.scene, bpy.data.scenes.new("Scene")
    bpy.data.scenes.remove(built)
    bpy.data.orphans_purge(do_recursive=True)


def _describe_resolution(settings: Settings) -> str:
    """Describe in words the settings of a stereo camera that Blender's camera does not store."""
    rig = settings.rig
    return f"Set the resolution to {rig.width_px} x {rig.height_px} px. "


def _make_tags(kind: str, settings: Settings) -> list[str]:
    """Make the tags by which the Asset Browser finds an asset."""
    law = settings.surface.model.replace("_", "-").title()
    of_kind = {
        "surfaces": ["ice", law],
        "rigs": ["stereo", "camera"],
        "lights": ["lamp"] if settings.light.lamps else ["Sun"],
        "bodies": ["Sun", "planet"],
        "skies": ["sky", "world", "black"],
    }
    return ["Icy Moon", *of_kind.get(kind, ["landscape", settings.light.body.title(), law])]


def _set_picture(block: bpy.types.ID, path: Path) -> None:
    """Give an asset a picture from a file."""
    image = bpy.data.images.load(str(path))
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    picture = block.preview_ensure()
    picture.image_size = image.size
    picture.image_pixels_float.foreach_set(values)
    bpy.data.images.remove(image)

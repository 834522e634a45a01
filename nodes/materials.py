"""What ground and blocks are made of, from the whole description."""

from __future__ import annotations

import bpy

from ..labels import ROCK, TERRAIN
from ..physics import principled
from ..settings import Settings
from .fingerprint import NAME, TAG
from .own_files import used_files
from .rocks import label_instances
from .surface import Textured, build_material
from .textures import load_maps


def advice(settings: Settings) -> list[str]:
    """What a person should know about the surfaces that the scene shows: sentences, none if all is well."""
    own = settings["rocks"]["coverage"] > 0 and settings["rocks"]["own_surface"]
    told = [principled.advice(settings[topic]) for topic in (("surface", "rock_surface") if own else ("surface",))
            if settings[topic]["model"] == "PRINCIPLED"]
    return [sentence for sentence in told if sentence]


def _textured(settings: Settings) -> Textured | None:
    """The textures of ground and blocks, or None if there are none."""
    if settings["textures"]["set"] == "NONE":
        return None
    files = {name.removeprefix("textures.").removesuffix("_file"): path
             for name, path in used_files(settings).items() if name.startswith("textures.")}
    return Textured(settings["textures"], load_maps(settings["textures"], files))


def _material(name: str, settings: Settings, topic: str, semantic: int) -> bpy.types.Material:
    made = build_material(f"{NAME} {name}", settings[topic], int(settings["dataset"]["seed"]), semantic,
                          _textured(settings), settings)
    made[TAG] = "material"
    return made


def ground_material(settings: Settings) -> bpy.types.Material:
    """What the ground is made of. Raises IcyMoonError if a texture cannot be read."""
    return _material("Surface", settings, "surface", TERRAIN)


def rock_material(settings: Settings) -> bpy.types.Material:
    """What the blocks are made of. Raises IcyMoonError if a texture cannot be read."""
    ice = _material("Rock Surface", settings, "rock_surface" if settings["rocks"]["own_surface"] else "surface", ROCK)
    label_instances(ice)
    return ice

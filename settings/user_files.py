"""The user's own files that settings name: their paths and their content.

The id of a pair depends on the content of these files, not on their paths. Imports no Blender.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from ..formats import mesh_file, mesh_images
from ..formats.calibrations.head_file import list_head_files
from ..paper_stand_ins.shown_items import RECIPE_NUMBER, list_items
from ..physics.arm.own_arm import list_arm_files
from ..physics.light.kernels import list_kernel_files
from ..physics.scene_requirements import surface_topics
from ..support.errors import IcyMoonError
from ..support.files import absolute_path, hash_file_once
from ..support.foreign_bytes import describe_reason
from .table import TOPICS
from .topics.scene import Settings


def find_used_files(settings: Settings, blend_folder: str | None = None) -> dict[str, Path]:
    """Find the absolute path of each file in use, by the setting that names it (``topic.key``).

    ``blend_folder`` is the folder for //, or None without a saved .blend file. Raises IcyMoonError if a required path
    is empty, or begins with // without a folder.
    """
    named = {}
    if settings.source.kind in ("MESH", "HEIGHT_MAP"):
        named["source.file"] = str(settings.source.file)
    if has_surroundings(settings) and settings.source.surroundings_file:
        named["source.surroundings_file"] = str(settings.source.surroundings_file)
    if settings.textures.set == "OWN":
        named |= {
            f"textures.{s.key}": str(settings.textures[s.key])
            for s in TOPICS["textures"].settings
            if s.subtype == "FILE_PATH" and settings.textures[s.key]
        }
    if settings.rocks.law == "TABLE" and settings.rocks.coverage > 0:
        named["rocks.file"] = str(settings.rocks.file)
    if settings.rocks.family == "OWN" and settings.rocks.coverage > 0:
        named["rocks.shape_file"] = str(settings.rocks.shape_file)
    named |= {f"{topic}.{key}": str(settings[topic][key]) for topic, key in _list_masks(settings)}
    if settings.excavation.path in ("RECORDED", "JOINTS"):
        named["excavation.file"] = str(settings.excavation.file)
    if settings.lander.kind == "OWN":
        named["lander.file"] = str(settings.lander.file)
    if settings.rig.head_file:
        named["rig.head_file"] = str(settings.rig.head_file)
    if settings.light.directions_from == "KERNELS":
        named["light.kernels"] = str(settings.light.kernels)
    if any(lamp.kind == "IES" for lamp in settings.light.lamps):
        named["light.ies_file"] = str(settings.light.ies_file)
    return {name: absolute_path(text, name, blend_folder) for name, text in named.items()}


def _list_masks(settings: Settings) -> list[tuple[str, str]]:
    """List the topics and keys of the painted masks that have an effect."""
    return [
        (topic, s.key)
        for topic in ("rocks", *surface_topics(settings))
        for s in TOPICS[topic].settings
        if s.key.endswith("mask_file")
        and settings[topic][s.key]
        and TOPICS[topic].is_shown(s.key, settings)
        and TOPICS[topic].has_effect(s.key, settings)
    ]


def has_surroundings(settings: Settings) -> bool:
    """Return whether the ground of a height map continues beyond the patch."""
    return bool(settings.source.kind == "HEIGHT_MAP" and settings.source.surroundings_m > 0)


def hash_content(settings: Settings, blend_folder: str | None = None) -> str:
    """Hash the content of the files that the settings use and the recipes of their stand-ins; empty without files and
    stand-ins.

    Raises IcyMoonError if a file cannot be read.
    """
    marks = []
    for name, path in find_used_files(settings, blend_folder).items():
        try:
            marks.append(name + "".join([hash_file_once(part) for part in _list_parts(settings, name, path)]))
        except OSError as error:
            raise IcyMoonError(
                f"{error.filename or path}: cannot be read ({describe_reason(error)}); check {name}."
            ) from None
    # Stand-ins are made on each machine. Their recipe counts, not their bytes, which rounding may change.
    marks += [f"{item.key} {RECIPE_NUMBER}" for item in list_items(settings)]
    return hashlib.sha256("".join(marks).encode()).hexdigest() if marks else ""


def do_files_exist(settings: Settings, blend_folder: str | None = None) -> bool:
    """Return whether all files that the settings use exist, including files that belong to them, such as an arm's
    meshes."""
    return all(
        path.is_file() and all(part.is_file() for part in _list_parts(settings, name, path))
        for name, path in find_used_files(settings, blend_folder).items()
    )


def _list_parts(settings: Settings, name: str, path: Path) -> list[Path]:
    """List the files whose content counts: a mesh with its buffers and shown images, a head with the calibrations that
    it names, or all files of a folder."""
    if name == "source.file":
        shown = mesh_images.find_images(path).files() if settings.textures.set == "MESH" else []
        return [*mesh_file.find_geometry_files(path), *shown]
    if name == "lander.file":
        return list_arm_files(path)
    if name == "rig.head_file":
        return list_head_files(path)
    return list_kernel_files(path)

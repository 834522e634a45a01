"""Replaces stand-ins by the user's own files of the same names, in the folder that a plan states. Imports no
Blender."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from ...formats import mesh_images
from ...formats.mesh_file import FORMATS
from ...paper_stand_ins.shown_items import list_items
from ...settings.topics.scene import Settings
from ...settings.topics.stand_ins import MeshItem, TextureItem
from ...support.errors import IcyMoonError
from .planned_pair import PlannedPair

#: Images of a texture by the word after its name; an image with the bare name is the albedo too.
_IMAGE_KINDS = ("albedo", "roughness", "normal", "transmission", "height")
_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")


def list_files_by_name(folder: Path) -> dict[str, list[Path]]:
    """List the files of a folder by their names without suffix, in small letters; empty without the folder."""
    found: dict[str, list[Path]] = {}
    try:
        for path in sorted(folder.iterdir()):
            if path.is_file():
                found.setdefault(path.stem.lower(), []).append(path)
    except OSError:
        return {}
    return found


def replace_stand_ins(settings: Settings, there: dict[str, list[Path]]) -> dict[str, dict[str, Any]]:
    """Return the settings that use the user's files ``there`` (see ``list_files_by_name``) instead of stand-ins. Empty
    if no file has the name of a stand-in in complete ``settings``. Raises IcyMoonError for two files of one name."""
    changes: dict[str, dict[str, Any]] = {}
    for item in list_items(settings):
        if isinstance(item, TextureItem):
            if own := _find_images(item, there):
                changes["textures"] = {
                    "set": "OWN",
                    **{f"{kind}_file": str(own.get(kind, "")) for kind in _IMAGE_KINDS},
                }
        elif mesh := _find_file(item.names, there, tuple(FORMATS)):
            changes["source"] = {"kind": "MESH", "file": str(mesh)}
            if settings.textures.set == "MESH" and not mesh_images.find_images(mesh).by_kind:
                changes["textures"] = {"set": "NONE"}
    return changes


def _find_images(item: TextureItem, there: dict[str, list[Path]]) -> dict[str, Path]:
    found = {}
    for kind in _IMAGE_KINDS:
        names = tuple(f"{name}_{kind}" for name in item.names) + (item.names if kind == "albedo" else ())
        if image := _find_file(names, there, _IMAGE_SUFFIXES):
            found[kind] = image
    return found


def _find_file(names: Sequence[str], there: dict[str, list[Path]], suffixes: tuple[str, ...]) -> Path | None:
    found = [path for name in names for path in there.get(name.lower(), ()) if path.suffix.lower() in suffixes]
    if len(found) > 1:
        raise IcyMoonError(f"{found[0]} and {found[1].name} both replace the stand-in {names[-1]}; keep one of them.")
    return found[0] if found else None


def describe_stand_ins(pairs: Sequence[PlannedPair], folders: Sequence[Path]) -> list[str]:
    """Describe in sentences the stand-ins that pairs use, and the user's files in ``folders`` that replace others."""
    shown = {item.key: item for pair in pairs for item in list_items(pair.settings)}
    sentences = []
    if shown:
        count = sum(bool(list_items(pair.settings)) for pair in pairs)
        textures = [item.stem for item in shown.values() if isinstance(item, TextureItem)]
        meshes = [item.stem for item in shown.values() if isinstance(item, MeshItem)]
        parts = [
            f"{len(names)} {what} ({', '.join(sorted(names))})"
            for names, what in ((textures, "textures"), (meshes, "meshes"))
            if names
        ]
        sentences.append(
            f"{count} of the pairs show stand-ins, made by code in place of files of the GUISS paper: "
            f"{' and '.join(parts)}. Files with these names in your plan's folder plan.files "
            "replace them."
        )
    own = find_own_files(pairs, folders)
    return [*sentences, describe_own_files(own, folders)] if own else sentences


def find_own_files(pairs: Sequence[PlannedPair], folders: Sequence[Path]) -> set[Path]:
    """Find the user's files in ``folders`` that pairs use instead of stand-ins."""
    return {path for pair in pairs for path in _list_shown_files(pair.settings) if path.parent in folders}


def describe_own_files(own: Collection[Path], folders: Sequence[Path]) -> str:
    """Describe the user's files in ``folders`` that are used."""
    return (
        f"{len(own)} of your own files in {', '.join(map(str, folders))} replace stand-ins: "
        f"{', '.join(sorted(path.name for path in own))}."
    )


def _list_shown_files(settings: Settings) -> list[Path]:
    found = [Path(settings.source.file)] if settings.source.kind == "MESH" else []
    if settings.textures.set == "OWN":
        found += [Path(settings.textures[f"{kind}_file"]) for kind in _IMAGE_KINDS if settings.textures[f"{kind}_file"]]
    return found

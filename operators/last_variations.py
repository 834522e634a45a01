"""The variations of a scene that were rendered last: their folder and their pairs.

A scene stores them beside its settings, so that a render of variations leaves the scene's data set folder as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from ..settings.description import overlay
from ..settings.topics.scene import Settings, typed
from ..support.errors import IcyMoonError
from .kept_pairs import find_existing_pairs
from .render import find_dataset_folder

#: Name of these pairs as the scope of an evaluation and the source of an export.
SCOPE = "VARIATIONS"
#: Maximum number of pairs whose pictures the sidebar offers.
MAX_PICTURES = 24


def remember_folder(scene: bpy.types.Scene, folder: Path) -> None:
    """Store the folder into which the variations of a scene are rendered, without pairs to show yet."""
    group = scene.icymoon.variations
    group.folder, group.pairs = str(folder), ""


def remember_pairs(scene: bpy.types.Scene, ids: Sequence[str]) -> None:
    """Store the ids of the pairs that the sidebar shows, chosen from these ids."""
    scene.icymoon.variations.pairs = " ".join(choose_spread(ids))


def choose_spread(ids: Sequence[str]) -> list[str]:
    """Return all ids, or as many as the sidebar can show: the first, the last and others at equal steps."""
    count = min(MAX_PICTURES, len(ids))
    return [ids[round(k * (len(ids) - 1) / max(1, count - 1))] for k in range(count)]


def use_folder(scene: bpy.types.Scene, settings: Settings) -> Settings:
    """Return the settings with the folder of the variations as their data set folder. Raises IcyMoonError if no
    variations are rendered."""
    folder = scene.icymoon.variations.folder
    if not folder:
        raise IcyMoonError("No variations of this scene are rendered; press Render These Variations first.")
    return overlay(settings, {"dataset": {"folder": folder}})


def find_folder(scene: bpy.types.Scene) -> Path | None:
    """Return the folder of the variations; None without one."""
    folder = scene.icymoon.variations.folder
    try:
        return find_dataset_folder(typed({"dataset": {"folder": folder}})) if folder else None
    except IcyMoonError:
        return None


def find_pairs(scene: bpy.types.Scene) -> list[Path]:
    """Find the existing folders of the pairs to show; empty if the scene's ids are invalid."""
    group = scene.icymoon.variations
    return find_existing_pairs(group.folder, group.pairs) if group.folder else []

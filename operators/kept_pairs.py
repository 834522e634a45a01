"""The pairs that a scene knows, and the settings that have changed since they were rendered."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import bpy

from ..render.pairs.dataset_file_names import check_id, folder_of_pair
from ..render.pairs.pair_folder import read_pair
from ..settings.blender import scene_properties
from ..settings.description import merged
from ..settings.table import list_differing_settings
from ..settings.topics.declaration import Setting
from ..settings.topics.scene import Settings, typed
from ..support.errors import IcyMoonError
from .render import find_dataset_folder


def find_existing_pairs(dataset_folder: str, ids: str) -> list[Path]:
    """Find the existing folders of the pairs with these ids, which a scene keeps. ``dataset_folder`` is the data set
    folder as the settings state it. Empty if the folder or an id is invalid."""
    try:
        folder = find_dataset_folder(typed({"dataset": {"folder": dataset_folder}}))
        found = [folder_of_pair(folder, check_id(name, "The scene")) for name in ids.split()]
    except IcyMoonError:
        return []
    return [path for path in found if (path / "pair.json").is_file()]


def find_kept_pairs(scene: bpy.types.Scene) -> list[Path]:
    """Find the existing folders of the pairs that were rendered last from a scene; empty if the scene's ids are
    invalid."""
    return find_existing_pairs(scene.icymoon.dataset.folder, scene.icymoon.pairs)


def list_changes_since_render(scene: bpy.types.Scene, folder: Path) -> list[tuple[str, Setting]]:
    """List (topic, setting) of each setting that changes the images and has changed since a pair was rendered; empty
    for a pair that cannot be read."""
    rendered = _read_settings(folder, (folder / "pair.json").stat().st_mtime_ns)
    if rendered is None:
        return []
    present = scene_properties.read_for_display(scene.icymoon)
    if present.quality.indirect == "AUTO":  # the render has chosen, and the pair states the choice
        present = merged(present, {"quality": {"indirect": rendered.quality.indirect}})
    return [
        (topic, setting)
        for topic, setting in list_differing_settings(rendered, present)
        if setting.effect not in ("run", "response")
    ]


@lru_cache(maxsize=4)
def _read_settings(folder: Path, written_ns: int) -> Settings | None:
    """Read the settings of a pair; None if it cannot be read. ``written_ns``, when the pair's record was written, only
    tells the cache to read a newer record."""
    try:
        return read_pair(folder).settings
    except IcyMoonError:
        return None

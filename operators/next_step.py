"""The next step from the present state of a scene to a measured stereo error."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import bpy

from ..nodes.build_scene import find_collection
from ..nodes.preview import lacks_trench
from ..render.pairs.pair_folder import read_pair
from ..settings.blender import scene_properties
from ..settings.description import merged
from ..settings.table import list_differing_settings
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import results
from .show_pair import find_kept_pairs


def find_next_step(scene: bpy.types.Scene) -> str:
    """The button or panel of the next step. A pair that has other settings than the present ones must be rendered
    again."""
    if find_collection(scene) is None or lacks_trench(scene):
        return "Next: Build Scene"
    pairs = find_kept_pairs(scene)
    if not pairs or (len(pairs) == 1 and _is_of_other_settings(scene, pairs[0])):
        return "Next: Render Stereo Pair"
    found = results.read_stored_results(scene)
    evaluated = found is not None and (found.scope == "DATASET" or {path.name for path in pairs} <= {*found.pairs})
    if evaluated and not results.list_changed_settings(scene):
        return "Next: Stereo Error, below"
    return "Next: Evaluate Stereo Pair" if len(pairs) == 1 else "Next: Evaluate Whole Data Set"


def _is_of_other_settings(scene: bpy.types.Scene, folder: Path) -> bool:
    """Whether the settings on which the images depend have changed since the pair was rendered. False for a pair that
    cannot be read."""
    rendered = _read_settings(folder, (folder / "pair.json").stat().st_mtime_ns)
    if rendered is None:
        return False
    present = scene_properties.read_for_display(scene.icymoon)
    if present.quality.indirect == "AUTO":  # the render has chosen, and the pair states the choice
        present = merged(present, {"quality": {"indirect": rendered.quality.indirect}})
    return any(setting.effect not in ("run", "response") for _, setting in list_differing_settings(rendered, present))


@lru_cache(maxsize=4)
def _read_settings(folder: Path, written_ns: int) -> Settings | None:
    """The settings of a pair whose record was written at that time; None if it cannot be read."""
    try:
        return read_pair(folder).settings
    except IcyMoonError:
        return None

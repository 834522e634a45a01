"""The plan of a scene's variations: whether it shows the scene, where it can be rendered, and its file."""

from __future__ import annotations

import os
import re
from pathlib import Path

import bpy

from ..nodes import build_scene as scenes
from ..nodes.datablocks.blend_file_paths import make_paths_absolute
from ..nodes.datablocks.fingerprint import find_added_objects
from ..physics.scene_checks import find_reasons_without_file
from ..render.pairs.dataset_file_names import pairs_folder
from ..render.plans.frozen_plan import PLAN as FROZEN
from ..render.plans.frozen_plan import read_frozen_plan
from ..render.plans.plan_file import parse_plan
from ..render.plans.vary_scene import make_plan_text
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.files import read_text, write_text
from ..support.number_text import format_count
from . import dialogs

#: File of the plan in the folder of its data set.
PLAN = "plan.toml"
#: Maximum number of pairs whose ids are compared with an existing data set. The comparison takes a second.
_MAX_COMPARED_PAIRS = 500
_EDITED_MESSAGE = (
    "The scene was edited by hand, and a plan contains settings only, so its pairs would not show the edits; "
    "press Build Scene to undo them."
)


def why_not_a_plan(scene: bpy.types.Scene, thorough: bool = False) -> str:
    """Explain why the pairs of a plan would not show the scene; empty if they would.

    Only a ``thorough`` check finds edits of built objects; it reads all meshes.
    """
    collection = scenes.find_collection(scene)
    if collection is None:
        return ""
    names = [item.name for item in find_added_objects(collection)]
    if names:
        more = f" and {format_count(len(names) - 1, 'more object')} of yours" if len(names) > 1 else ""
        return (
            f"The scene contains {names[0]}{more}, and a plan contains settings only, so its pairs would not show "
            f"{'them' if more else 'it'}; move {'them' if more else 'it'} out of the collection "
            f"{collection.name}."
        )
    built = scenes.find_built(scene)
    if built is not None and (reasons := find_reasons_without_file(built.settings)):
        return str(reasons[0])
    if not thorough:
        return ""
    return _EDITED_MESSAGE if built is not None and not built.outdated and built.edited_parts() else ""


def make_scene_plan_text(scene: bpy.types.Scene, settings: Settings) -> str:
    """Make the text of the plan that varies a scene. Raises IcyMoonError for settings that cannot be combined, and for
    a scene that was edited by hand."""
    if why := why_not_a_plan(scene, thorough=True):
        raise IcyMoonError(why)
    variations = scene_properties.read_variations(scene.icymoon)
    if not variations.varied and variations.seeds == 1:
        raise IcyMoonError("No setting varies yet; press + under Vary This Scene, or raise Variations by Seed.")
    return make_plan_text(make_paths_absolute(settings), variations)


def find_folder_fault(folder: Path, text: str) -> str:
    """Explain in a sentence why a plan cannot be rendered into a folder; empty if it can.

    A folder fits if it has neither plan nor pairs, if it is the plan's own data set, or if the plan contains all of its
    pairs.
    """
    path, pairs = folder / PLAN, pairs_folder(folder)
    try:
        there = read_text(path) if os.path.lexists(path) else ""
        if there == text:
            return ""
        frozen = read_frozen_plan(folder) if os.path.lexists(folder / FROZEN) else None
        rendered = {each.name for each in pairs.iterdir()} if pairs.is_dir() else set()
    except (OSError, ValueError, IcyMoonError):
        return f"{folder} contains files that cannot be read; choose another folder."
    if there and (frozen is None or frozen.text != there):
        return f"{folder} contains another plan, {PLAN}; choose another folder."
    rendered |= {pair.id for pair in frozen.pairs} if frozen else set()
    if rendered and (
        len(rendered) > _MAX_COMPARED_PAIRS or not rendered <= {p.id for p in parse_plan(path, text).pairs()}
    ):
        return f"{folder} contains other pairs than those of these variations; choose another folder."
    return ""


def find_free_folder(folder: Path, text: str, title: str, last: Path | None = None) -> Path:
    """Find a folder for the plan. If this plan continues the plan in the folder of the ``last`` variations, or in the
    scene's ``folder``, return that folder; else a folder beside the scene's, named after the varied settings."""
    stem = f"{folder.name}_{re.sub(r'[^a-z0-9]+', '_', title.lower()).strip('_')}"
    beside = [folder.with_name(stem), *(folder.with_name(f"{stem}_{k}") for k in range(2, 100))]
    begun = [each for each in (last, folder) if each is not None and os.path.lexists(each / PLAN)]
    return next((each for each in (*begun, *beside) if not find_folder_fault(each, text)), beside[0])


class ICYMOON_OT_save_plan(dialogs.TomlFileDialog, dialogs.SaveDialog, bpy.types.Operator):
    """Save the plan of these variations as a TOML file, for icymoon batch in a shell or on another machine"""

    bl_idname = "icymoon.save_plan"
    bl_label = "Save Plan"
    first_name = PLAN

    filepath: dialogs.file_property("TOML file to write")

    def save(self, context: bpy.types.Context, path: Path) -> None:
        write_text(path, make_scene_plan_text(context.scene, scene_properties.read_settings(context.scene.icymoon)))


CLASSES = (ICYMOON_OT_save_plan,)

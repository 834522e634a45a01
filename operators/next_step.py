"""The next step on the way from the present state of a scene to a measured stereo error."""

from __future__ import annotations

import bpy

from ..nodes.build_scene import find_collection
from ..nodes.preview import lacks_trench
from ..settings.blender import scene_properties
from . import decide, last_variations, results
from .kept_pairs import find_kept_pairs, list_changes_since_render
from .render import explain_missing_denoiser
from .session import session

#: The next step if this Blender lacks the scene's denoiser.
DENOISER_OFF = "Next: Turn Denoiser Off"


def find_next_step(scene: bpy.types.Scene) -> str:
    """Return the button or panel of the next step. A pair whose settings differ from the present ones must be rendered
    again."""
    if find_collection(scene) is None or lacks_trench(scene):
        return "Next: Build Scene"
    pairs = find_kept_pairs(scene)
    if not pairs or (len(pairs) == 1 and list_changes_since_render(scene, pairs[0])):
        return DENOISER_OFF if explain_missing_denoiser(scene) else "Next: Render Stereo Pair"
    if scene_properties.read_variations(scene.icymoon).varied and not last_variations.find_pairs(scene):
        return "Next: Vary This Scene, below"
    if session.find_end(scene).startswith(f"{decide.TITLE}: ") and scene.session_uid in session.decided:
        return "Next: Evaluation, at its end"
    found = results.read_stored_results(scene)
    evaluated = found is not None and (found.scope != "SCENE" or {path.name for path in pairs} <= {*found.pairs})
    if evaluated and not results.list_changed_settings(scene):
        return "Next: Stereo Error, below"
    return "Next: Evaluate Stereo Pair" if len(pairs) == 1 else "Next: Evaluate Whole Data Set"

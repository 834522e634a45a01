"""Render Stereo Pair: bring the scene up to date, and render its pairs in a separate process."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.datablocks.blend_file_paths import make_paths_absolute
from ..nodes.ground.user_ground import is_from_file
from ..physics.scene_checks import find_reasons_without_file
from ..render.cost.blender_abilities import Abilities, explain_unavailable_quality
from ..render.cost.measure_speed import read_speed_of_pair
from ..render.cost.quality_presets import estimate_render_seconds
from ..render.cycles_settings import check_possible
from ..render.plans.planned_pair import PlannedPair, expand_headings
from ..render.worker import render_pairs
from ..render.workers.job_commands import Job as JobFiles
from ..render.workers.job_commands import blender_command, resolve_dataset_folder
from ..render.workers.process import Message
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from ..support.steps import Steps, finish
from . import jobs
from .build import find_views_through, frame_and_expose, leave_edit_mode, look_through
from .build_in_pieces import make_for_scene, put_in_scene
from .job_operators import PreparingOperator
from .refine_ground import start_refining
from .session import session
from .settled_steps import settle
from .sidebar_text import format_for_window, keep_speed, recall_known_speed
from .user_render import prepare_render
from .window_areas import find_scene, pause_rendered_views, push_undo


def find_dataset_folder(settings: Settings) -> Path:
    """Return the absolute path of the data set folder that the settings name."""
    saved = os.path.dirname(bpy.data.filepath) if bpy.data.filepath else None
    return resolve_dataset_folder(str(settings.dataset.folder), saved)


def bring_up_to_date(scene: bpy.types.Scene, settings: Settings) -> scenes.Built:
    """Return the built scene, after building it again if it does not show the settings.

    Objects that the user added stay. Raises IcyMoonError if building again would, or might, overwrite edits by hand.
    """
    built = _find_traceable(scene)
    if built is None:
        return _build_anew(scene, settings)
    changed = scenes.list_changed_settings(built, settings)
    if not changed and not built.preview:
        return built
    by_hand = built.edited_parts()  # a build would keep the user's node groups
    if by_hand and built.preview:
        raise IcyMoonError(
            "The scene was edited by hand and shows a preview; press Build Scene to build it again, or undo the edits."
        )
    if by_hand:
        raise IcyMoonError(
            f"{changed[0]} was changed after the scene was built and edited by hand; press Build Scene to build it "
            "again, or set the setting back to keep your edits."
        )
    return _build_anew(scene, settings)


def show_rendered_scene(scene_uid: int, settings: Settings) -> Steps[scenes.Built | None]:
    """Return, in steps, the built scene if it must be rendered as the user edited it, else None.

    If None, another process builds the scene from its settings, and the window must not wait for that process. If the
    window does not show the settings already, it shows coarse ground, and the fine ground follows. Ground from a file
    stays as it is. Raises IcyMoonError as ``bring_up_to_date`` does.
    """
    edited = yield from settle(partial(find_whether_edited, scene_uid))
    scene = require_scene(scene_uid)
    if find_reasons_without_file(settings) or edited:
        return bring_up_to_date(scene, settings)
    built = scenes.find_built(scene)
    shown = built is not None and not built.preview and not scenes.list_changed_settings(built, settings)
    if not shown and not is_from_file(settings):
        if not preview.find_preview_of(scene, settings):
            yield from _build_coarse_anew(scene_uid, settings)
        start_refining()
    return None


def find_whether_edited(scene_uid: int) -> Steps[bool]:
    """Return, in steps, whether a scene was built and then edited by hand. Raises IcyMoonError if edits cannot be
    detected."""
    built = _find_traceable(require_scene(scene_uid))
    return built is not None and (yield from built.is_edited_in_steps())


def require_scene(scene_uid: int) -> bpy.types.Scene:
    """Return the scene with this ``session_uid``. Raises IcyMoonError if it was deleted."""
    scene = find_scene(scene_uid)
    if scene is None:
        raise IcyMoonError("The scene was deleted meanwhile; choose another scene, and start again.")
    return scene


def _build_coarse_anew(scene_uid: int, settings: Settings) -> Steps[None]:
    """Build a scene with coarse ground in steps. Settings that the user changes meanwhile are shown afterwards."""
    session.stop_building()
    scene, made = yield from make_for_scene(scene_uid, settings)
    _build_anew(scene, settings, partial(put_in_scene, made=made))


def _find_traceable(scene: bpy.types.Scene) -> scenes.Built | None:
    """Return the built scene, separated from the user's copies of it, or None. Raises IcyMoonError if edits by hand
    cannot be detected."""
    built = scenes.find_built(scene)
    if built is None:
        return None
    scenes.separate_from_copies(built)
    if built.outdated:
        raise IcyMoonError(built.outdated)
    return built


def _build_anew(
    scene: bpy.types.Scene,
    settings: Settings,
    build: Callable[[bpy.types.Scene, Settings], scenes.Built] = scenes.build_scene,
) -> scenes.Built:
    session.stop_building()
    leave_edit_mode()
    earlier = scenes.find_built(scene)
    before = earlier.settings if earlier else None
    with pause_rendered_views():
        built = build(scene, settings)
    prepare_render(scene, built)
    frame_and_expose(scene, settings, before)
    push_undo("Build Scene")
    return built


def plan_pairs(scene: bpy.types.Scene, settings: Settings) -> list[PlannedPair]:
    """Plan the pairs that Render Stereo Pair would render from a scene now."""
    return finish(plan_pairs_in_steps(scene, settings))


def plan_pairs_in_steps(scene: bpy.types.Scene, settings: Settings) -> Steps[list[PlannedPair]]:
    """Plan pairs as ``plan_pairs`` does, in steps."""
    built = scenes.find_built(scene)
    if built is not None:
        scenes.separate_from_copies(built)
    # Reading the marks of a full ground takes 0.2 s, so they are read only once.
    if built is not None and (
        not scenes.list_changed_settings(built, settings) or (yield from built.is_edited_in_steps())
    ):
        return expand_headings(settings, (yield from built.find_extra()))
    return expand_headings(settings, scenes.make_build_facts(settings))


def _save_copy(path: Path) -> None:
    """Save a copy of the open file without its preview picture.

    Blender would draw the whole ground for the picture. For 1.8 million faces without a graphics card, this takes the
    processor 8 s instead of 0.05 s.
    """
    preferences = bpy.context.preferences
    before = preferences.filepaths.file_preview_type, preferences.is_dirty
    preferences.filepaths.file_preview_type = "NONE"
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, check_existing=False)
    finally:
        preferences.filepaths.file_preview_type, preferences.is_dirty = before


def keep_speed_of_pair(folder: Path) -> None:
    """Store the speed of a pair that was just rendered, for later estimates, if it shows the speed of this machine."""
    with suppress(IcyMoonError):  # the pair is rendered, even if its time cannot be stored
        if speed := read_speed_of_pair(folder):
            keep_speed(speed)


def explain_missing_denoiser(scene: bpy.types.Scene) -> str:
    """Explain that this Blender lacks the denoiser of a scene, with the fix; empty if it has it. Graphics cards are not
    looked for, since panels ask at each redraw."""
    quality = scene_properties.read_for_display(scene.icymoon).quality
    return explain_unavailable_quality(quality, Abilities(compat.has_osl(), compat.has_oidn(), gpu=True))


class ICYMOON_OT_render_pair(PreparingOperator, bpy.types.Operator):
    """Render a stereo pair with exact truth into the data set folder. Runs in a separate process; Esc twice stops it"""

    bl_idname = "icymoon.render_pair"
    bl_label = "Render Stereo Pair"

    again: bpy.props.BoolProperty(
        name="Again", default=False, description="Render pairs again that are already complete"
    )

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return super().find_obstacle(context) or format_for_window(explain_missing_denoiser(context.scene))

    def prepare(self, context: bpy.types.Context) -> Steps[jobs.Job]:
        settings = scene_properties.read_settings(context.scene.icymoon)
        check_possible(settings.quality)
        before = scenes.find_built(context.scene)
        views = find_views_through(context, before.camera if before else None)
        self._scene_uid = context.scene.session_uid
        self._rendered: list[str] = []
        yield None
        edited = yield from show_rendered_scene(self._scene_uid, settings)
        scene = require_scene(self._scene_uid)
        if built := scenes.find_built(scene):
            look_through(views, built)
        files = JobFiles(
            find_dataset_folder(settings),
            make_paths_absolute(settings),
            again=self.again,
            scene=scene.name if edited else None,
        )
        if edited:
            self._warn(edited)
            _save_copy(files.blend)
        command, device = blender_command(jobs.find_this_blender(), "worker", str(files.file)), settings.quality.device
        job = jobs.Job.start(
            "Render Stereo Pair",
            command,
            self._hear,
            files.remove,
            device=device,
            clean=False,
            if_stopped="finished pairs are kept" if int(settings.dataset.headings) > 1 else "no pair was finished",
        )
        job.expected = jobs.Expectation(*estimate_render_seconds(settings, recall_known_speed(str(device))))
        return job

    def _hear(self, message: Message) -> None:
        if message["type"] == "pair":
            self._rendered.append(str(message["id"]))
            if message.get("rendered"):
                keep_speed_of_pair(Path(message["folder"]))

    def run_blocking(self, context: bpy.types.Context) -> None:
        settings = scene_properties.read_settings(context.scene.icymoon)
        check_possible(settings.quality)
        start = time.perf_counter()
        built = bring_up_to_date(context.scene, settings)
        self._warn(built)
        folders = render_pairs(
            built,
            plan_pairs(context.scene, settings),
            find_dataset_folder(settings),
            context.scene.frame_current,
            time.perf_counter() - start,
            lambda *a, **k: None,
            self.again,
        )
        context.scene.icymoon.pairs = " ".join(folder.name for folder in folders)
        self.report(
            {"INFO"}, show_controls(f"{len(folders)} stereo pair{'s' * (len(folders) > 1)} in {folders[0].parent}")
        )

    def report_success(self, context: bpy.types.Context) -> None:
        self.report({"INFO"}, "Stereo pair rendered; press Evaluate to measure it")
        scene = find_scene(self._scene_uid)
        if scene is not None:
            scene.icymoon.pairs = " ".join(self._rendered)
            push_undo(self.bl_label)  # otherwise undo would remove the pair along with the step before
        if scene == context.scene:
            bpy.ops.icymoon.show_pair("INVOKE_DEFAULT", automatic=True)

    def _warn(self, built: scenes.Built) -> None:
        for warning in built.warnings:
            self.report({"WARNING"}, format_for_window(warning))


CLASSES = (ICYMOON_OT_render_pair,)

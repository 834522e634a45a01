"""Render the pairs of Vary This Scene, and estimate their time and size."""

from __future__ import annotations

import textwrap

import bpy

from ..render.cost.estimate import estimate_roughly, format_duration, format_size
from ..render.plans.frozen_plan import PLAN as FROZEN
from ..render.plans.vary_scene import (
    count_pairs,
    describe_variations,
    make_title,
    sample_settings,
)
from ..settings.blender import scene_properties
from ..support.errors import IcyMoonError
from ..support.files import absolute_path, write_text
from ..support.printer import show_controls
from . import dataset, jobs, last_variations, variation_curves, variation_pictures, variation_plan
from .render import find_dataset_folder
from .sidebar_text import recall_known_speed, replace_keys_by_labels
from .window_areas import push_undo
from .window_events import keep_until_change

#: Characters of a line of the dialog.
_DIALOG_LINE_CHARACTERS = 60
#: Number of pairs over which the estimate averages.
_SAMPLED_PAIRS = 16


def list_lines(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Describe the pairs of a scene's variations, their time and size in sentences, or why they are impossible.
    Computed once per change."""
    key = ("variations", scene.session_uid, recall_known_speed(str(scene.icymoon.quality.device)))
    return keep_until_change(key, lambda: _make_lines(scene))


def _make_lines(scene: bpy.types.Scene) -> tuple[str, ...]:
    settings = scene_properties.read_unchecked(scene.icymoon)
    variations = scene_properties.read_variations(scene.icymoon)
    try:
        told = describe_variations(settings, variations)
        some, grounds = sample_settings(settings, variations, _SAMPLED_PAIRS)
    except IcyMoonError as error:
        return (str(error),)
    speed = recall_known_speed(str(settings.quality.device))
    seconds, size = estimate_roughly(some, count_pairs(settings, variations), grounds, speed)
    machine = speed.basis if speed else "another machine; render a pair here, or measure this one in Quality and Speed"
    return (told, f"About {format_duration(seconds)} and {format_size(size)} on {machine}")


class ICYMOON_OT_render_variations(dataset.DatasetOperator, bpy.types.Operator):
    """Render the pairs of all variations of this scene into a data set folder, in separate processes. Their plan is saved there, so the shell can continue it"""  # noqa: E501

    bl_idname = "icymoon.render_variations"
    bl_label = "Render These Variations"

    folder: bpy.props.StringProperty(
        name="Folder",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
        description="Folder of the data set; if it is empty, the folder in the panel Data Set",
    )
    use_for_scene: bpy.props.BoolProperty(
        name="Use for the Scene Too",
        options={"SKIP_SAVE"},
        description="Make it the folder in the panel Data Set, so that all buttons there work on these pairs",
    )
    _asked = False
    _told: tuple[str, ...] = ()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or self.folder:
            return super().invoke(context, event)
        scene = context.scene
        try:
            settings = scene_properties.read_settings(scene.icymoon)
            title = make_title(scene_properties.read_variations(scene.icymoon))
            self.folder = str(
                variation_plan.find_free_folder(
                    find_dataset_folder(settings),
                    variation_plan.make_scene_plan_text(scene, settings),
                    title,
                    last_variations.find_folder(scene),
                )
            )
        except IcyMoonError as error:
            return self.fail(error)
        self._asked = True
        return set(context.window_manager.invoke_props_dialog(self, width=420, confirm_text="Render"))

    def draw(self, context: bpy.types.Context) -> None:
        column, group = self.layout.column(), context.scene.icymoon.dataset
        for sentence in list_lines(context.scene):
            for line in textwrap.wrap(replace_keys_by_labels(sentence), _DIALOG_LINE_CHARACTERS):
                column.label(text=line)
        variation_pictures.draw_icons(column, context.scene)
        column.prop(self, "folder")
        column.prop(self, "use_for_scene")
        column.prop(group, "evaluate")
        row = column.row()  # always there, so that the buttons below stay in place
        row.enabled = group.evaluate
        row.prop(group, "methods")

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self._asked:
            return super().execute(context)
        # A dialog runs this operator as a script does, so it would wait until all pairs are rendered, and Blender does
        # not free an operator that becomes modal when its dialog is confirmed. So another operator does the work.
        try:
            bpy.ops.icymoon.render_variations("INVOKE_DEFAULT", folder=self.folder, use_for_scene=self.use_for_scene)
        except RuntimeError as error:  # with the operator's report
            self.report({"ERROR"}, show_controls(str(error).removeprefix("Error: ").strip()))
            return {"CANCELLED"}
        return {"FINISHED"}

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        text = variation_plan.make_scene_plan_text(context.scene, settings)
        if self.folder:
            settings.dataset.folder = str(absolute_path(self.folder, "dataset.folder"))
        folder = find_dataset_folder(settings)
        if fault := variation_plan.find_folder_fault(folder, text):
            raise IcyMoonError(fault)
        plan = str(folder / variation_plan.PLAN)
        command = dataset.make_batch_command(
            context.scene, settings, plan
        )  # an impossible plan is refused before anything is written
        if (folder / FROZEN).is_file():
            self.report({"INFO"}, show_controls(f"Continuing the data set in {folder}"))
        write_text(folder / variation_plan.PLAN, text)
        process = dataset.start_batch(settings, command, plan, last_variations.SCOPE)
        last_variations.remember_folder(context.scene, folder)
        if self.use_for_scene:
            context.scene.icymoon.dataset.folder = settings.dataset.folder
        push_undo(self.bl_label)
        return self._make_job(process, context)

    def report_success(self, context: bpy.types.Context) -> None:
        super().report_success(context)
        variation_curves.show_curves(context, open_window=False)


CLASSES = (ICYMOON_OT_render_variations,)

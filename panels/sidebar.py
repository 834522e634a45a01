"""The sidebar: panels in the order of the work, from settings to evaluation. They contain no logic."""

from __future__ import annotations

import bpy

from ..nodes import preview
from ..operators import (
    dataset,
    evaluate,
    import_ground,
    lamp_list,
    live_preview,
    manual,
    next_step,
    noise_layers,
    painted_masks,
    presets,
    refine_ground,
    results,
    shadow_warning,
    sidebar_text,
    view_exposure,
    view_resolution,
)
from ..operators.preferences import list_own_matchers, list_plugin_matchers
from ..operators.session import session
from ..settings.blender import scene_properties
from ..settings.topics.trust_boundary import OWN_PREFIX
from ..stereo.matchers import get_matcher_needs, list_matcher_titles
from ..stereo.matchers.methods import names_method
from ..stereo.report.table_columns import NOISE_DECIDES
from . import previews
from .decision_maps import draw_decisions
from .error_table import WRONG, draw_errors, explain_errors
from .exports import draw_export
from .fields import RowsOfText, draw_fields, draw_lines, draw_sentence, draw_settings, draw_start, fill_room
from .find_setting import draw_found, draw_search
from .pair_views import draw_pair
from .view_line import LONGEST, describe_view

#: Range of the ``bl_order`` of the topics' panels: from FIRST to below LAST.
FIRST, LAST = 10, 1000


#: Characters that the icons of a header take beside the title, in a panel and in a panel within another panel, and
#: characters that the icon of a menu takes.
_HEADER_CHARACTERS, _INNER_HEADER_CHARACTERS, _MENU_CHARACTERS = 9, 12, 3


class Sidebar:
    """Base class that puts a panel into Icy Moon's tab, with a button in its header that opens the panel's manual
    page."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Icy Moon"
    layout: bpy.types.UILayout
    bl_label: str
    page = manual.WINDOW_PAGE
    #: Kind of the presets in the menu of the header; empty for none.
    preset_kind = ""

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        room = sidebar_text.measure_line_length() - len(self.bl_label)
        room -= _INNER_HEADER_CHARACTERS if hasattr(self, "bl_parent_id") else _HEADER_CHARACTERS
        if self.preset_kind and room >= _MENU_CHARACTERS:
            self.layout.menu(f"ICYMOON_MT_presets_{self.preset_kind}", text="", icon="PRESET")
        if room < 0:
            return  # the button would hide the end of the title
        self.layout.operator("icymoon.open_manual", text="", icon="HELP", emboss=False).page = self.page


#: A text about as long as the longest status of a built scene while a setting is dragged, except for rare combinations.
_STATUS_ROOM = max(f"{refine_ground.NOTE}, 99 s so far", shadow_warning.BRIEF, key=len)
#: Texts of a button, in a sidebar as Blender opens it and in a narrow one.
_SEVERAL_SUNS = "Decide Where to Dig on Several Suns", "Decide on Several Suns"
#: Share of its line that the progress bar takes, beside the button that stops the job.
_BAR_SHARE = 0.76


def draw_job(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw the progress of the running job and a button that stops it. Without a job, draw how the last job ended, and
    the next step.

    A painting or a build in pieces is drawn in the same place. The drawing always takes two lines, so that nothing
    below moves under the mouse when a job begins or ends.
    """
    job, column = session.job, layout.column(align=True)
    if job is None and (kind := painted_masks.find_painted_kind(bpy.context)):
        column.label(text="Painting: red is all, black none")
        column.operator("icymoon.use_painted_mask").kind = kind
        return
    if job is None and session.building is not None:
        column.label(text=f"Building the scene{session.building.so_far}", icon="TIME")
        column.label(text="Esc stops it", icon="BLANK1")
        return
    if job is None:
        ended = session.find_end(scene)
        title, _, outcome = (ended or "No job is running").rpartition(": ")
        column.label(text=_choose_text(ended, outcome.capitalize()) if title else outcome)
        if ended and session.remains:
            column.label(text=session.remains)
        else:
            _draw_next_step(column, next_step.find_next_step(scene))
        return
    text, below = job.shown
    row = column.split(factor=_BAR_SHARE, align=True)
    row.progress(factor=job.fraction, text=text)
    row.operator("icymoon.cancel")
    column.label(text=below)


def _draw_next_step(layout: bpy.types.UILayout, step: str) -> None:
    """Draw the next step, as a button if no other button of the panel does it."""
    if step == next_step.DENOISER_OFF:
        button = layout.operator("wm.context_set_enum", text=step)
        button.data_path, button.value = "scene.icymoon.quality.denoiser", "NONE"
    else:
        layout.label(text=step)


class ICYMOON_PT_main(Sidebar, bpy.types.Panel):
    """Presets, and the three steps to a measured stereo error"""

    bl_idname = "ICYMOON_PT_main"
    bl_label = "Icy Moon"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        group = context.scene.icymoon
        searches = draw_search(layout, context)
        if searches:  # the found settings may fill the sidebar
            draw_job(layout, context.scene)
            draw_found(layout, context)
        picture = layout.column()
        picture.active = not presets.is_changed(context.scene)
        picture.template_icon_view(
            context.window_manager, previews.CHOICE, show_labels=True, scale=8.0, scale_popup=6.85
        )
        row = layout.row(align=True)
        icon = "GREASEPENCIL" if presets.is_changed(context.scene) else "PRESET"  # words would cut the title
        row.menu("ICYMOON_MT_presets", text=presets.find_title(context.scene.icymoon.preset), icon=icon)
        row.operator("icymoon.add_preset", text="", icon="ADD")
        row.operator("icymoon.remove_preset", text="", icon="REMOVE")
        column = layout.column(align=True)
        column.scale_y = 1.4
        column.operator("icymoon.build_scene", icon="RNDCURVE")
        draw_start(column, "icymoon.render_pair", "Render Stereo Pair", "RENDER_STILL")
        draw_start(column, "icymoon.evaluate", "Evaluate Stereo Pair", "VIEWZOOM", scope="SCENE")
        if not searches:
            draw_job(layout, context.scene)
        draw_pair(layout, context.scene)
        layout.prop(group, "live")
        if shown := live_preview.list_lines(context.scene):
            scene, column = context.scene, layout.column(align=True)
            drawn = draw_lines(column, shown, "INFO")
            told = describe_view(
                context.space_data,
                scene.render.engine,
                view_exposure.describe_exposure(scene),
                view_resolution.is_coarse(scene),
                session.picture.is_shown(scene),
                view_exposure.is_without_planetshine(scene),
                preview.has_coarse_ground(scene),
            )
            drawn += draw_sentence(column, told, "SHADING_RENDERED")
            fill_room(column, drawn, (_STATUS_ROOM, LONGEST))


class ICYMOON_PT_results(Sidebar, bpy.types.Panel):
    """Metrics of the last evaluation, as the mean over its pairs"""

    bl_idname = "ICYMOON_PT_results"
    bl_label = "Stereo Error"
    page = "theory/metrics"
    bl_parent_id = "ICYMOON_PT_main"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(results.read_summary(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        rows = results.read_summary(context.scene)
        verdict = results.describe_verdict(rows, results.read_noise_doubt(context.scene))
        draw_lines(layout, (verdict,), "VIEWZOOM")
        draw_lines(layout, (WRONG, *filter(None, [results.describe_nearer(rows)])))
        origin, *warnings = results.list_notes(context.scene)
        draw_sentence(layout, origin, "TIME")
        for sentence in warnings:
            draw_sentence(layout, sentence, "ERROR")
        briefs = results.list_brief_limits(context.scene)
        for brief in briefs:  # the full sentences are below the table, so that the table stays in sight
            draw_lines(layout, (brief,), "ERROR" if results.casts_doubt_on_results(context.scene, brief) else "INFO")
            if brief.startswith(NOISE_DECIDES):
                row = layout.row()
                row.operator_context = "INVOKE_DEFAULT"
                draw_start(row, "icymoon.auto_quality", "Find Cheapest Quality…", "VIEWZOOM")
        draw_errors(layout, context.scene, rows)
        buttons = layout.column(align=True)
        buttons.operator("icymoon.open_report", icon="URL")
        buttons.operator("icymoon.hide_surface", icon="X")
        # The explanations are below the buttons, so that the buttons are in sight of the table.
        explain_errors(layout, context.scene, rows)
        for sentence in results.list_limits(context.scene):
            told = [f"{brief}: " for brief in briefs if sentence.startswith(f"{brief}: ")]
            draw_sentence(layout, sentence.removeprefix(told[0]) if told else sentence, "INFO")


def _choose_text(text: str, shorter: str) -> str:
    """Return the text of a button, or a shorter text if the sidebar would cut it."""
    return text if len(text) <= sidebar_text.measure_line_length() else shorter


class ICYMOON_PT_evaluation(Sidebar, bpy.types.Panel):
    """Choose matchers and evaluate the scene or the whole data set"""

    bl_idname = "ICYMOON_PT_evaluation"
    bl_label = "Evaluation"
    page = "theory/metrics"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = LAST

    def draw(self, context: bpy.types.Context) -> None:
        methods = context.scene.icymoon.dataset.methods
        column = self.layout.column(align=True)
        listed = {
            **list_matcher_titles(),
            **{name: name for name in list_plugin_matchers()},
            **{f"{OWN_PREFIX}:{own}": own for own in list_own_matchers()},
        }
        for name, title in listed.items():
            row, chosen = column.row(align=True), names_method(methods, name)
            row.operator(
                "icymoon.toggle_matcher",
                text=title,
                depress=chosen,
                icon="CHECKBOX_HLT" if chosen else "CHECKBOX_DEHLT",
            ).matcher = name
            if chosen and (needs := get_matcher_needs(name)):
                draw_sentence(column, f"{title} needs {needs}.", "INFO")
        draw_settings(self.layout, context.scene.icymoon, "dataset", ("methods",))
        missing = evaluate.explain_missing_maps(context.scene)
        column = self.layout.column()
        column.enabled = not missing
        draw_fields(column, context.scene.icymoon, "dataset", ("maps", "map_cell_m"))
        if missing:
            draw_sentence(self.layout, missing, "INFO")
        column = self.layout.column(align=True)
        draw_start(column, "icymoon.evaluate", "Evaluate Stereo Pair", "VIEWZOOM", scope="SCENE")
        draw_start(column, "icymoon.evaluate", "Evaluate Whole Data Set", "VIEWZOOM", scope="DATASET")
        draw_start(column, "icymoon.evaluate_folder", "Evaluate Other Pairs…", "FILE_FOLDER")
        draw_start(column, "icymoon.decide", "Decide Where to Dig", "VIEWZOOM")
        draw_start(column, "icymoon.decide", _choose_text(*_SEVERAL_SUNS), "VIEWZOOM", fuse_suns=True)
        draw_start(column, "icymoon.decide_by_rules", "Decide by Own Rules…", "FILE_FOLDER")
        draw_start(column, "icymoon.decide_with_guarantee", "Decide with Guarantee…", "FILE_FOLDER")
        column.operator("icymoon.open_report", icon="URL")
        draw_sentence(self.layout, "Errors on the ground: Stereo Error, at the top", "INFO")
        draw_decisions(self.layout, context.scene)


def list_sky_lines(scene: bpy.types.Scene) -> tuple[str, ...]:
    """List the lines of the panel on the sky."""
    return sidebar_text.list_sky_lines(sidebar_text.find_light(scene_properties.read_for_display(scene.icymoon)))


class ICYMOON_PT_sky(Sidebar, bpy.types.Panel):
    """Position, apparent size and irradiance of the Sun and the planet"""

    bl_idname = "ICYMOON_PT_sky"
    bl_label = "In the Sky"
    page = manual.find_page_of_topic("light")
    bl_parent_id = "ICYMOON_PT_light"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(list_sky_lines(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        draw_lines(self.layout, list_sky_lines(context.scene))


class ICYMOON_PT_resolution(Sidebar, bpy.types.Panel):
    """Field of view of the stereo camera on level ground, and the depth error there"""

    bl_idname = "ICYMOON_PT_resolution"
    bl_label = "Depth Resolution"
    page = manual.find_page_of_topic("rig")
    bl_parent_id = "ICYMOON_PT_rig"

    def draw(self, context: bpy.types.Context) -> None:
        draw_lines(
            self.layout, sidebar_text.list_rig_lines(scene_properties.read_for_display(context.scene.icymoon).rig)
        )


class ICYMOON_PT_left_out(Sidebar, bpy.types.Panel):
    """Parts of the settings that a render omits, with the reasons"""

    bl_idname = "ICYMOON_PT_left_out"
    bl_label = "Not Rendered"
    page = "theory/limits"
    bl_parent_id = "ICYMOON_PT_quality"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(sidebar_text.list_omission_lines(scene_properties.read_for_display(context.scene.icymoon)))

    def draw(self, context: bpy.types.Context) -> None:
        for sentence in sidebar_text.list_omission_lines(scene_properties.read_for_display(context.scene.icymoon)):
            draw_sentence(self.layout, sentence, "INFO")


class ICYMOON_UL_layers(RowsOfText, bpy.types.UIList):
    """List of the layers of noise"""

    bl_idname = "ICYMOON_UL_layers"

    symbol = "RNDCURVE"

    @staticmethod
    def describe(item: bpy.types.PropertyGroup) -> str:
        return noise_layers.describe_layer(item)


class ICYMOON_UL_lamps(RowsOfText, bpy.types.UIList):
    """List of the lamps"""

    bl_idname = "ICYMOON_UL_lamps"

    symbol = "LIGHT"

    @staticmethod
    def describe(item: bpy.types.PropertyGroup) -> str:
        return lamp_list.describe_entry(item)


class ICYMOON_PT_plan(Sidebar, bpy.types.Panel):
    """Choose a shipped plan or a file of your own, estimate its cost and render it"""

    bl_idname = "ICYMOON_PT_plan"
    bl_label = "Shipped Plans"
    page = "datasets#plans-from-files"
    bl_parent_id = "ICYMOON_PT_dataset"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout, root = self.layout, context.scene.icymoon
        group = root.dataset
        row = layout.row(align=True)
        row.operator("icymoon.choose_plan", text=dataset.find_plan_title(group.plan), icon="PRESET")
        row.operator("icymoon.open_plan", text="", icon="FILEBROWSER")
        draw_settings(layout, root, "dataset", ("plan", "workers", "evaluate", "leave_running"))
        draw_start(layout, "icymoon.plan_dry_run", "Dry Run", "VIEWZOOM")
        for line in dataset.readout["lines"] if dataset.readout["plan"] == group.plan else ():
            draw_sentence(layout, line)
        column = layout.column()
        column.scale_y = 1.4
        draw_start(column, "icymoon.render_dataset", "Render Data Set", "RENDER_ANIMATION")
        layout.operator("icymoon.show_last_pair", icon="IMAGE_DATA")
        draw_export(layout, context.scene, "DATASET")
        for line in dataset.readout["set_aside"][-3:]:
            draw_sentence(layout, f"Set aside: {line}")
        draw_start(layout, "icymoon.reproduce", "Reproduce GUISS Paper…")


class ICYMOON_PT_ground_report(Sidebar, bpy.types.Panel):
    """Findings and repairs of the import in the file of the ground"""

    bl_idname = "ICYMOON_PT_ground_report"
    bl_label = "Import Report"
    page = manual.find_page_of_topic("source")
    bl_parent_id = "ICYMOON_PT_source"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(import_ground.list_report_lines(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        draw_lines(self.layout, import_ground.list_report_lines(context.scene), hang="   ")


CLASSES = (ICYMOON_UL_lamps, ICYMOON_UL_layers, ICYMOON_PT_main, ICYMOON_PT_results, ICYMOON_PT_evaluation)
DETAILS = (ICYMOON_PT_plan, ICYMOON_PT_ground_report, ICYMOON_PT_sky, ICYMOON_PT_resolution, ICYMOON_PT_left_out)

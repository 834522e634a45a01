"""The menus Render ▸ Icy Moon and Add ▸ Mesh, the Asset Browser's menus, and the status bar.

F3 finds only operators that are in a menu.
"""

from __future__ import annotations

import bpy

from ..operators import sidebar_text
from ..operators.painted_masks import KINDS
from ..operators.preferences import can_install_evaluator, find_asset_libraries
from ..operators.presets import list_preset_items
from ..operators.session import session
from ..settings.blender import scene_properties
from ..settings.preset_files import PRESET_KINDS
from .fields import draw_start

#: Width of the progress bar, in heights of a button. Blender's default width would cut its text.
_BAR_UNITS = 15
_ORIGINAL_DRAW = "_draw_orig"
_MASK_OPERATORS = {"Paint": "icymoon.paint_mask", "Use": "icymoon.use_painted_mask", "Clear": "icymoon.clear_mask"}


_KIND_TITLES = {"own": "Yours", **PRESET_KINDS}


def group_presets_by_kind() -> list[tuple[str, list[tuple[str, str]]]]:
    """Group the presets by kind, as (title, presets), the user's own first. Each preset is (name, title)."""
    kinds: dict[str, list[tuple[str, str]]] = {}
    for name, title, _ in list_preset_items():
        kinds.setdefault(name.split("/")[0], []).append((name, title))
    return [(title, kinds[kind]) for kind, title in _KIND_TITLES.items() if kind in kinds]


class _KindMenu:
    """Mix-in: a menu of the presets of one kind."""

    kind: str
    layout: bpy.types.UILayout

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return any(title == cls.kind for title, _ in group_presets_by_kind())

    def draw(self, context: bpy.types.Context) -> None:
        listed = dict(group_presets_by_kind()).get(self.kind, [])
        lacking = _find_lacks(context.scene) if self.kind == _KIND_TITLES["qualities"] else {}
        for name, title in listed:
            place = self.layout
            if name in lacking:
                place = place.row()
                place.enabled = False
            place.operator("icymoon.load_preset", text=title).preset = name
        for lack in dict.fromkeys(lacking.values()):
            self.layout.label(text=f"Grey: {lack.partition(';')[0]}", icon="INFO")


def _find_lacks(scene: bpy.types.Scene) -> dict[str, str]:
    """Find the sentences on the features that this Blender lacks, by the names of the qualities that need them."""
    shown = sidebar_text.list_quality_presets(scene_properties.read_for_display(scene.icymoon))
    return {quality.name: quality.lacks for quality in shown if quality.lacks}


_MENU_TITLES = {f"ICYMOON_MT_presets_{kind}": title for kind, title in _KIND_TITLES.items()}
_KIND_MENUS = [
    type(
        name,
        (_KindMenu, bpy.types.Menu),
        {"__doc__": f"Presets: {title}", "bl_idname": name, "bl_label": title, "kind": title},
    )
    for name, title in _MENU_TITLES.items()
]


class ICYMOON_MT_presets(bpy.types.Menu):
    """Presets of whole scenes and of parts of them, by kind"""

    bl_idname = "ICYMOON_MT_presets"
    bl_label = "Icy Moon Presets"

    def draw(self, context: bpy.types.Context) -> None:
        there = {title for title, _ in group_presets_by_kind()}
        for name, title in _MENU_TITLES.items():
            if title in there:
                self.layout.menu(name)
        if not find_asset_libraries():
            self.layout.separator()
            draw_start(self.layout, "icymoon.make_asset_library", "Make Asset Library of Presets", "ASSET_MANAGER")


class ICYMOON_MT_settings_files(bpy.types.Menu):
    """Load and save presets and settings"""

    bl_idname = "ICYMOON_MT_settings_files"
    bl_label = "Load and Save"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("icymoon.load_preset", text="Load Preset…")
        layout.operator("icymoon.add_preset", text="Add Preset…")
        layout.operator("icymoon.remove_preset", text="Remove Preset…")
        layout.separator()
        layout.operator("icymoon.load_settings", text="Load Settings…")
        layout.operator("icymoon.save_settings", text="Save Settings…")


class ICYMOON_MT_quality(bpy.types.Menu):
    """Measure how many samples a scene needs"""

    bl_idname = "ICYMOON_MT_quality"
    bl_label = "Quality and Speed"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("icymoon.auto_quality", text="Find Cheapest Quality…")
        layout.operator("icymoon.trade", text="Compare Qualities…")
        layout.operator("icymoon.show_trade", text="Show Chart of Qualities")
        layout.operator("icymoon.measure_machine")


class ICYMOON_MT_dataset(bpy.types.Menu):
    """Vary this scene, and render data sets"""

    bl_idname = "ICYMOON_MT_dataset"
    bl_label = "Data Set"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("icymoon.vary", text="Vary or Sweep a Setting…")
        layout.operator("icymoon.show_ends")
        layout.operator("icymoon.render_variations").folder = ""
        layout.operator("icymoon.save_plan", text="Save Plan…")
        layout.operator("icymoon.save_trajectory", text="Save Trajectory…")
        layout.operator("icymoon.show_curve")
        layout.separator()
        layout.operator("icymoon.choose_plan", text="Choose Plan…")
        layout.operator("icymoon.open_plan", text="Open Plan…")
        layout.operator("icymoon.plan_dry_run")
        layout.operator("icymoon.render_dataset")
        layout.operator("icymoon.watch_dataset")
        layout.operator("icymoon.show_last_pair")
        layout.separator()
        layout.operator("icymoon.evaluate", text="Evaluate Whole Data Set").scope = "DATASET"
        layout.operator("icymoon.evaluate_folder", text="Evaluate Other Pairs…")
        layout.operator("icymoon.decide", text="Decide Where to Dig on Several Suns").fuse_suns = True
        layout.operator("icymoon.decide_by_rules", text="Decide by Own Rules…")
        layout.operator("icymoon.decide_with_guarantee", text="Decide with Guarantee…")
        layout.operator("icymoon.export_pairs", text="Export Pair or Data Set…")
        layout.operator("icymoon.reproduce", text="Reproduce the GUISS Paper…")


class ICYMOON_MT_results(bpy.types.Menu):
    """Show measured results, and remove them from the view"""

    bl_idname = "ICYMOON_MT_results"
    bl_label = "Results"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("icymoon.open_report")
        layout.operator("icymoon.show_error")
        layout.operator("icymoon.show_surface", text="Show Measured Surface or Point Cloud").method = ""
        layout.operator("icymoon.paint_errors").method = ""
        layout.operator("icymoon.hide_surface")
        layout.separator()
        layout.operator("icymoon.paint_decisions", text="Show Decisions on Ground").method = ""
        layout.operator("icymoon.hide_decisions")


class ICYMOON_MT_set_up(bpy.types.Menu):
    """Install and check the programs that Icy Moon works with"""

    bl_idname = "ICYMOON_MT_set_up"
    bl_label = "Set Up"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("icymoon.check_evaluator")
        if can_install_evaluator():
            layout.operator("icymoon.install_evaluator")
        layout.separator()
        layout.operator("icymoon.make_asset_library")
        layout.operator("icymoon.remove_asset_library")


class ICYMOON_MT_masks(bpy.types.Menu):
    """Paint where rocks, dirt and frost lie"""

    bl_idname = "ICYMOON_MT_masks"
    bl_label = "Masks"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        for action in ("Paint Where {} Lie{s}", "Use Painted Mask of {}", "Clear Mask of {}"):
            for kind, label, _ in KINDS:
                name = _MASK_OPERATORS[action.split()[0]]
                text = action.format(label, s="" if kind == "ROCKS" else "s")
                layout.operator(name, text=text).kind = kind
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("icymoon.use_image_as_mask", text="Use Image as Mask…")


class ICYMOON_MT_lidar(bpy.types.Menu):
    """Scan the scene with a laser scanner, and show its beams and points"""

    bl_idname = "ICYMOON_MT_lidar"
    bl_label = "LiDAR"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("icymoon.show_beams")
        layout.operator("icymoon.scan_lidar")
        layout.operator("icymoon.show_scan")
        layout.operator("icymoon.hide_scan")


class ICYMOON_MT_icymoon(bpy.types.Menu):
    """All commands of Icy Moon"""

    bl_idname = "ICYMOON_MT_icymoon"
    bl_label = "Icy Moon"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.menu(ICYMOON_MT_presets.bl_idname)
        layout.menu(ICYMOON_MT_settings_files.bl_idname)
        layout.separator()
        layout.operator("icymoon.find_setting", text="Find Setting…", icon="VIEWZOOM")
        layout.operator("icymoon.import_ground", text="Import Ground…")
        layout.operator("icymoon.object_as_ground")
        layout.operator("icymoon.object_as_rock")
        layout.menu(ICYMOON_MT_masks.bl_idname)
        layout.operator_menu_enum("icymoon.place_on_ground", "target")
        layout.operator("icymoon.read_calibration", text="Read Calibration…")
        layout.operator("icymoon.write_calibration", text="Write Calibration…")
        layout.operator("icymoon.build_scene")
        layout.operator("icymoon.clear_scene")
        layout.prop(context.scene.icymoon, "live")
        layout.separator()
        layout.operator("icymoon.render_pair")
        layout.operator_menu_enum("icymoon.show_pair", "view")
        layout.operator("icymoon.expose")
        layout.menu(ICYMOON_MT_lidar.bl_idname)
        layout.operator("icymoon.evaluate", text="Evaluate Stereo Pair").scope = "SCENE"
        layout.operator("icymoon.decide")
        layout.operator("icymoon.cancel", text="Cancel or Stop")
        layout.separator()
        for menu in (ICYMOON_MT_quality, ICYMOON_MT_dataset, ICYMOON_MT_results, ICYMOON_MT_set_up):
            layout.menu(menu.bl_idname)
        layout.separator()
        layout.operator("icymoon.open_manual", icon="HELP")


def _draw_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(ICYMOON_MT_icymoon.bl_idname, icon="WORLD")


def _draw_assets(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw a button beside the menus of the Asset Browser, until the asset library exists."""
    if not find_asset_libraries():
        draw_start(self.layout, "icymoon.make_asset_library", "Make Asset Library of Icy Moon")


def _draw_meshes(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator("icymoon.add_terrain", icon="RNDCURVE")
    self.layout.operator("icymoon.add_block", icon="MESH_ICOSPHERE")


def _draw_status(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the running job in the status bar, which is also visible without the sidebar."""
    job = session.job
    if job is None:
        return
    row = self.layout.row(align=True)
    bar = row.row(align=True)
    bar.ui_units_x = _BAR_UNITS
    bar.progress(factor=job.fraction, text=job.brief)
    row.operator("icymoon.cancel", text="", icon="X")


def _append_to_status_bar() -> None:
    """Draw the running job in the status bar, also in the session that installed the extension.

    At its first call ``WorkSpace.status_text_set`` stores the function that draws the status bar, and each later call
    restores this function. Blender calls it while it installs an extension, so a later addition would be lost.
    """
    header, shown = bpy.types.STATUSBAR_HT_header, bpy.types.STATUSBAR_HT_header.draw
    stored = getattr(header, _ORIGINAL_DRAW, None)
    if stored is not None:
        header.draw = stored
    header.append(_draw_status)
    if stored is not None:
        setattr(header, _ORIGINAL_DRAW, header.draw)
        header.draw = header.draw if shown is stored else shown  # keep a text that is shown now


def _remove_from_status_bar() -> None:
    header = bpy.types.STATUSBAR_HT_header
    for draw in (header.draw, getattr(header, _ORIGINAL_DRAW, None)):
        functions = getattr(draw, "_draw_funcs", [])
        if _draw_status in functions:
            functions.remove(_draw_status)


CLASSES = (
    *_KIND_MENUS,
    ICYMOON_MT_presets,
    ICYMOON_MT_settings_files,
    ICYMOON_MT_quality,
    ICYMOON_MT_dataset,
    ICYMOON_MT_results,
    ICYMOON_MT_set_up,
    ICYMOON_MT_masks,
    ICYMOON_MT_lidar,
    ICYMOON_MT_icymoon,
)


def register() -> None:
    """Add the menu to Render in the top bar, the meshes to Add ▸ Mesh, the assets to the Asset Browser, and the running
    job to the status bar."""
    bpy.types.TOPBAR_MT_render.append(_draw_menu)
    bpy.types.VIEW3D_MT_mesh_add.append(_draw_meshes)
    bpy.types.ASSETBROWSER_MT_editor_menus.append(_draw_assets)
    _append_to_status_bar()


def unregister() -> None:
    """Remove the additions to the menus and to the status bar."""
    _remove_from_status_bar()
    bpy.types.ASSETBROWSER_MT_editor_menus.remove(_draw_assets)
    bpy.types.VIEW3D_MT_mesh_add.remove(_draw_meshes)
    bpy.types.TOPBAR_MT_render.remove(_draw_menu)

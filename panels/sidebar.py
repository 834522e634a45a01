"""The sidebar, top to bottom as the work goes: describe, build, render, evaluate. No logic here."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from .. import settings as description
from ..nodes import scene as scenes
from ..operators import dataset, follow, ground, jobs, layers, live, readouts, results
from ..physics import principled, surfaces
from ..physics.blur import MOTION
from ..physics.textures import by_uv
from ..properties import LANDFORMS, TOPICS, Setting, Topic


class _Sidebar:
    """Where every panel of Icy Moon is."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Icy Moon"
    layout: Any


def _draw_job(layout: Any) -> None:
    job = jobs.current
    if job is None:
        return
    text, percent, left = job.shown
    column = layout.column(align=True)
    column.progress(factor=percent / 100, text=f"{text}  {percent} %")
    row = column.row(align=True)
    row.label(text=left or "Starting")
    row.operator("icymoon.cancel", icon="X")


class ICYMOON_PT_main(_Sidebar, bpy.types.Panel):
    """Preset, and the three steps from nothing to a measured stereo error"""

    bl_idname = "ICYMOON_PT_main"
    bl_label = "Icy Moon"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        group = context.scene.icymoon
        title = description.preset_header(group.preset)[0] if group.preset else "Choose a Preset"
        layout.menu("ICYMOON_MT_presets", text=title, icon="PRESET")
        column = layout.column(align=True)
        column.scale_y = 1.4
        column.operator("icymoon.build_scene", icon="RNDCURVE")
        column.operator("icymoon.render_pair", icon="RENDER_STILL")
        column.operator("icymoon.evaluate", icon="VIEWZOOM").scope = "SCENE"
        layout.prop(group, "live")
        _draw_lines(layout, tuple(live.lines(context.scene)), "INFO")
        _draw_job(layout)


class ICYMOON_PT_results(_Sidebar, bpy.types.Panel):
    """Metrics of the last evaluation, mean over its pairs"""

    bl_idname = "ICYMOON_PT_results"
    bl_label = "Stereo Error"
    bl_parent_id = "ICYMOON_PT_main"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(results.summary())

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        rows = results.summary()
        grid = layout.grid_flow(row_major=True, columns=len(rows) + 1, even_columns=True, align=True)
        grid.label(text="")
        for row in rows:
            grid.label(text=row["method"])
        lines = (("L1", lambda r: f"{results.number(r['l1_m'], 3)} m"),
                 ("L1 > 10 cm", lambda r: results.percent(r["l1_rate_10"])),
                 ("si-RMSE", lambda r: results.number(r["si_rmse"], 4)),
                 ("DOD", lambda r: results.percent(r["dod"])),
                 ("Coverage", lambda r: results.percent(r["coverage"])))
        for label, text in lines:
            grid.label(text=label)
            for row in rows:
                grid.label(text=text(row))
        buttons = layout.row(align=True)
        buttons.operator("icymoon.open_report", icon="URL")
        buttons.operator("icymoon.show_error", text="Error Image", icon="IMAGE_DATA")
        surfaces = layout.row(align=True)
        for method in results.methods_with_points():
            surfaces.operator("icymoon.show_surface", text=f"Surface {method}", icon="MESH_GRID").method = method
        surfaces.operator("icymoon.hide_surface", text="" if results.methods_with_points() else "Remove Surface",
                          icon="X")


class _TopicPanel(_Sidebar):
    """One topic of the settings, drawn from the table of settings."""

    bl_options = {"DEFAULT_CLOSED"}
    topic: Topic

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if self.topic.key == "source":
            layout.operator("icymoon.import_ground", text="Import Ground…", icon="IMPORT")
        if self.topic.key == "sensor":
            layout.operator("icymoon.expose", icon="IMAGE_DATA")
            layout.prop(context.scene.icymoon, "follow")
            _draw_lines(layout, tuple(follow.lines()), "INFO")
        if self.topic.key == "terrain":
            layout.prop(context.scene.icymoon.dataset, "seed")
        if self.topic.key == "rock_surface":
            layout.enabled = context.scene.icymoon.rocks.own_surface
        if self.topic.key == "hapke":
            layout.active = "HAPKE" in (context.scene.icymoon.surface.model, context.scene.icymoon.rock_surface.model)
        group = getattr(context.scene.icymoon, self.topic.key)
        for setting in self.topic.settings:
            row = layout.row()
            row.enabled = _matters(self.topic.key, setting.key, group) and _source_asks(
                context.scene.icymoon, self.topic.key, setting.key)
            if setting.kind == "list":
                _draw_list(row.column(), group, setting)
            else:
                _draw_field(row, group, setting)
            if (self.topic.key, setting.key) in _EXPLAINED:
                _draw_choice(layout, group, setting)
        if self.topic.key in ("surface", "rock_surface"):
            told = principled.advice({s.key: getattr(group, s.key) for s in self.topic.settings})
            if told and group.model == "PRINCIPLED":
                _draw_lines(layout, tuple(textwrap.wrap(told, readouts.LINE)), "INFO")
        if self.topic.key in ("surface", "rock_surface", "hapke"):
            _draw_albedos(layout, self.topic.key, context.scene.icymoon)
        if self.topic.key == "rig":
            _draw_lines(layout, readouts.camera_notes(description.from_group(context.scene.icymoon)), "INFO")
        if self.topic.key == "terrain" and scenes.measured_roughness(context.scene):
            layout.operator("icymoon.show_roughness", text=f"Measured: {scenes.measured_roughness(context.scene)}",
                            icon="DRIVER_DISTANCE")


#: Choices whose cost and shortcomings stand in the panel, not only in the tooltip.
_EXPLAINED = {("surface", "model"), ("rock_surface", "model"), ("hapke", "accuracy")}


def _draw_choice(layout: Any, group: Any, setting: Setting) -> None:
    """What the chosen one of a setting's choices does, costs and misses."""
    told = next(choice[2] for choice in setting.choices if choice[0] == getattr(group, setting.key))
    _draw_lines(layout, tuple(textwrap.wrap(told, readouts.LINE)))


def _draw_albedos(layout: Any, topic: str, group: Any) -> None:
    """The albedos that follow from the settings of a surface."""
    values = description.from_group(group)
    surface = {**values["surface"], "model": "HAPKE"} if topic == "hapke" else values[topic]
    found = surfaces.albedos(surface, values["hapke"])
    if found is not None:
        column = layout.column(align=True)
        for label, value in (("Normal", found.normal), ("Geometric", found.geometric), ("Bond", found.bond)):
            column.label(text=f"{label} albedo {value:.3f}")


def _draw_lines(layout: Any, lines: tuple[str, ...], icon: str = "NONE") -> None:
    column = layout.column(align=True)
    for k, line in enumerate(lines):
        column.label(text=line, icon="BLANK1" if k and icon != "NONE" else icon)


class ICYMOON_PT_sky(_Sidebar, bpy.types.Panel):
    """Where Sun and planet stand, how large they look and what they shed on level ground"""

    bl_idname = "ICYMOON_PT_sky"
    bl_label = "In the Sky"
    bl_parent_id = "ICYMOON_PT_light"

    def draw(self, context: bpy.types.Context) -> None:
        _draw_lines(self.layout, readouts.sky_lines(description.from_group(context.scene.icymoon)["light"]))


class ICYMOON_PT_resolution(_Sidebar, bpy.types.Panel):
    """What the stereo camera sees of level ground, and how well depth can be measured there"""

    bl_idname = "ICYMOON_PT_resolution"
    bl_label = "Depth Resolution"
    bl_parent_id = "ICYMOON_PT_rig"

    def draw(self, context: bpy.types.Context) -> None:
        _draw_lines(self.layout, readouts.rig_lines(description.from_group(context.scene.icymoon)["rig"]))


class ICYMOON_UL_layers(bpy.types.UIList):
    """Layers of noise, a line each"""

    bl_idname = "ICYMOON_UL_layers"

    def draw_item(self, context: bpy.types.Context, layout: Any, data: Any, item: Any, icon: int,
                  active_data: Any, active_property: str) -> None:
        layout.label(text=layers.layer_title(item), icon="RNDCURVE")


def _draw_list(layout: Any, group: Any, setting: Setting) -> None:
    """A list of tables with its buttons, and the settings of the selected table."""
    layout.label(text=setting.label)
    row = layout.row()
    row.template_list("ICYMOON_UL_layers", "", group, setting.key, group, f"{setting.key}_active", rows=3)
    buttons = row.column(align=True)
    buttons.operator("icymoon.layer_add", text="", icon="ADD")
    buttons.operator("icymoon.layer_remove", text="", icon="REMOVE")
    buttons.operator("icymoon.layer_move", text="", icon="TRIA_UP").direction = "UP"
    buttons.operator("icymoon.layer_move", text="", icon="TRIA_DOWN").direction = "DOWN"
    entries, active = getattr(group, setting.key), getattr(group, f"{setting.key}_active")
    for each in setting.entries if active < len(entries) else ():
        _draw_field(layout, entries[active], each)


def _draw_field(layout: Any, group: Any, setting: Setting) -> None:
    """A setting's field; where Blender puts the name beside it, with room for the name."""
    if setting.kind in ("choice", "text"):
        split = layout.split(factor=0.45 if setting.choices else 0.38)
        split.label(text=setting.label)
        split.prop(group, setting.key, text="")
    else:
        layout.prop(group, setting.key)


def _source_asks(group: Any, topic: str, key: str) -> bool:
    """Whether the kind of ground leaves a setting an effect."""
    source = group.source
    if topic == "terrain":
        graded = source.kind == "PROCEDURAL" and group.mesh.kind == "GRADED"
        return bool((source.kind == "PROCEDURAL" and key != ("resolution" if graded else "body_radius_m"))
                    or (source.detail and key != "body_radius_m")
                    or (source.kind == "HEIGHT_MAP" and key in ("size_m", "resolution")))
    if topic == "mesh":
        return bool(source.kind == "PROCEDURAL" and (key == "kind" or group.mesh.kind == "GRADED"))
    if topic == "source" and key != "kind":
        only = {"scale": "MESH", "up_axis": "MESH", "repair": "MESH", "metres_per_pixel": "HEIGHT_MAP",
                "height_scale_m": "HEIGHT_MAP"}
        return bool(source.kind == only[key] if key in only else source.kind != "PROCEDURAL")
    return True


#: Surface settings that have an effect only beside another that is above 0.
_SURFACE_NEEDS = {"albedo_patch_m": "albedo_variation", "subsurface_radius_m": "subsurface_weight",
                  "grain_size_m": "grain_amplitude_m", "relief": "grain_amplitude_m",
                  **{f"salt_{key}": "salt_share" for key in ("patch_m", "red", "green", "blue")}}
_PRINCIPLED_ONLY = {"subsurface_weight", "subsurface_radius_m", "transmission", "roughness", "specular",
                    "refractive_index"}


def _matters(topic: str, key: str, group: Any) -> bool:
    """Whether a setting has an effect beside the others; what has none is drawn greyed."""
    if TOPICS[topic].parent == LANDFORMS:
        # The first setting of a landform, its height, depth or coverage, turns it on.
        return key == TOPICS[topic].settings[0].key or getattr(group, TOPICS[topic].settings[0].key) > 0
    if topic == "rocks" and key != "coverage":
        return bool(group.coverage > 0 and (key != "power_index" or group.law == "POWER")
                    and (key not in ("cluster_blocks", "cluster_radius_m") or group.clustering > 0))
    if topic in ("surface", "rock_surface"):
        return _matters_to_surface(key, group)
    if topic == "textures" and key != "set":
        return _matters_to_textures(key, group)
    if topic == "hapke":
        off = {"c": group.b == 0.0, "h_s": group.b_s0 == 0.0, "h_c": group.b_c0 == 0.0,
               "accuracy": group.backend == "NODES"}
        return not off.get(key, False)
    if topic == "light":
        return _light_matters(key, group)
    if topic == "textures" and key != "set":
        return bool(group.set == "OWN" if key.endswith("_file") else group.set != "NONE")
    if topic == "sensor" and key in ("auto_percentile", "auto_target"):
        return bool(group.auto_exposure)
    if topic == "sensor" and key == "exposure_s":
        return not group.auto_exposure
    if topic == "rig" and key == "motion_exposure_s":
        return any(getattr(group, moving) != 0 for moving in MOTION)
    if topic == "sensor" and key == "bracket_stops":
        return bool(group.brackets > 1)
    if topic == "sensor" and key in ("radiation_depth_um", "radiation_e_per_um"):
        return bool(group.radiation_flux_cm2_s > 0)
    return True


def _matters_to_surface(key: str, group: Any) -> bool:
    """The same for the settings of a surface."""
    if key in _PRINCIPLED_ONLY and group.model != "PRINCIPLED":
        return False
    if key == "albedo":
        return bool(group.model != "HAPKE")
    if key == "lommel_seeliger_share":
        return bool(group.model == "LUNAR_LAMBERT")
    return bool(key not in _SURFACE_NEEDS or getattr(group, _SURFACE_NEEDS[key]) > 0)


def _matters_to_textures(key: str, group: Any) -> bool:
    """The same for how images lie on the ground."""
    if key.endswith("_file"):
        return bool(group.set == "OWN")
    if key in ("width_m", "repeat"):
        return bool(group.set != "NONE" and not by_uv({"set": group.set, "mapping": group.mapping}))
    return bool(group.set not in ("NONE", "MESH"))


def _light_matters(key: str, group: Any) -> bool:
    """``_matters`` for the lights: what a date gives is not asked for."""
    dated, kernels = group.directions_from != "ANGLES", group.directions_from == "KERNELS"
    if key in ("body", "date_utc", "longitude_deg"):
        return dated
    if key in ("parent", "kernels"):
        return kernels
    if key == "stars_faintest_mag":
        return bool(group.stars)
    if key in ("planet_albedo", "planet_phase_law", "planet_scale", "planet_rings",
               "planet_least"):
        return bool(group.planet)
    if key.startswith("planet_"):
        return bool(group.planet) and not dated
    return not dated if key.endswith(("_elevation_deg", "_azimuth_deg", "_diameter_deg", "_wm2")) else True


class ICYMOON_PT_landforms(_Sidebar, bpy.types.Panel):
    """Features of icy ground, each off until its height, depth or coverage is above 0"""

    bl_idname = "ICYMOON_PT_landforms"
    bl_label = LANDFORMS
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 10 + next(k for k, topic in enumerate(TOPICS.values()) if topic.parent == LANDFORMS)

    def draw(self, context: bpy.types.Context) -> None:
        group = context.scene.icymoon
        shaping = [t.label for t in TOPICS.values() if t.parent == LANDFORMS
                   and getattr(getattr(group, t.key), t.settings[0].key) > 0]
        self.layout.label(text=", ".join(shaping) or "None")


def _topic_panel(topic: Topic, order: int) -> type:
    parent = {"bl_parent_id": ICYMOON_PT_landforms.bl_idname} if topic.parent == LANDFORMS else {}
    return type(f"ICYMOON_PT_{topic.key}", (_TopicPanel, bpy.types.Panel), {
        "__doc__": topic.description, "bl_idname": f"ICYMOON_PT_{topic.key}", "bl_label": topic.label,
        "bl_order": order, "topic": topic, **parent})


TOPIC_PANELS = tuple(_topic_panel(topic, 10 + k) for k, topic in enumerate(TOPICS.values()))


class ICYMOON_PT_plan(_Sidebar, bpy.types.Panel):
    """The plan of a data set: what it will take, and rendering it"""

    bl_idname = "ICYMOON_PT_plan"
    bl_label = "Plan"
    bl_parent_id = "ICYMOON_PT_dataset"

    def draw(self, context: bpy.types.Context) -> None:
        layout, group = self.layout, context.scene.icymoon.dataset
        row = layout.row(align=True)
        row.operator("icymoon.choose_plan", text=dataset.title_of(group.plan), icon="PRESET")
        row.operator("icymoon.open_plan", text="", icon="FILEBROWSER")
        layout.operator("icymoon.plan_dry_run", icon="VIEWZOOM")
        for line in dataset.readout["lines"] if dataset.readout["plan"] == group.plan else ():
            _draw_wrapped(layout, line)
        column = layout.column()
        column.scale_y = 1.4
        column.operator("icymoon.render_dataset", icon="RENDER_ANIMATION")
        _draw_job(layout)
        layout.operator("icymoon.show_last_pair", icon="IMAGE_DATA")
        for line in dataset.readout["set_aside"][-3:]:
            _draw_wrapped(layout, f"Set aside: {line}")


def _draw_wrapped(layout: Any, text: str) -> None:
    """A sentence in lines of the sidebar's width."""
    _draw_lines(layout, tuple(textwrap.wrap(text, 40)))


class ICYMOON_PT_ground_report(_Sidebar, bpy.types.Panel):
    """What was found and mended in the file that the ground was built from"""

    bl_idname = "ICYMOON_PT_ground_report"
    bl_label = "Import Report"
    bl_parent_id = "ICYMOON_PT_source"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(ground.report(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        _draw_lines(self.layout, tuple(ground.report(context.scene)))


CLASSES = (ICYMOON_UL_layers, ICYMOON_PT_main, ICYMOON_PT_results, ICYMOON_PT_landforms, *TOPIC_PANELS,
           ICYMOON_PT_plan, ICYMOON_PT_ground_report, ICYMOON_PT_sky, ICYMOON_PT_resolution)

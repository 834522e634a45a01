"""The content of a topic's panel besides settings: buttons above the settings, derived values below them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..operators import live_exposure, shadow_warning, sidebar_text
from ..operators.painted_masks import can_use, has_mask
from ..operators.sidebar_text import remember_answers
from ..paper_stand_ins.shown_items import describe_item, list_items
from ..physics.surfaces import principled, surface_law
from ..settings.blender import scene_properties
from ..settings.preset_files import find_preset, load, preset_names, read_preset_header
from ..settings.table import TOPICS
from ..settings.topics.rocks import PLACE
from ..settings.topics.stand_ins import MeshItem, TextureItem
from ..settings.topics.surfaces import COVER, DIRT, HapkeSettings, SurfaceSettings
from .fields import draw_lines, draw_sentence, draw_settings, draw_start

_albedo_advice, _albedos = remember_answers(principled.advise_on_albedo), remember_answers(surface_law.find_albedos)
#: Characters that the margins of a button take.
_BUTTON_CHARACTERS = 3
#: Characters that the margins and the icon of a button take.
_ICON_BUTTON_CHARACTERS = 5
Extra = Callable[[Any, bpy.types.Context], None]


def _draw_import(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    layout.operator("icymoon.import_ground", text="Import Ground…", icon="IMPORT")
    _draw_taking(layout, "ground")
    if told := sidebar_text.describe_ground_file(context.scene):
        draw_lines(layout, (told,), "MESH_DATA")
    if context.scene.icymoon.source.kind != "PROCEDURAL":
        draw_placing(layout, "SITE")


def _draw_taking(layout: bpy.types.UILayout, what: str) -> None:
    """Draw the button that uses the selected object as the ground or the rock; in a narrow sidebar with fewer words."""
    long = f"Use Selected Object as {what.title()}"
    fits = len(long) <= sidebar_text.measure_line_length() - _BUTTON_CHARACTERS
    layout.operator(f"icymoon.object_as_{what}", text=long if fits else "Use Selected Object")


def _draw_own_rock(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    _draw_taking(layout, "rock")


def _draw_calibration(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    column = layout.column(align=True)  # in one row their words would not fit
    column.operator_context = "INVOKE_DEFAULT"
    column.operator("icymoon.read_calibration", text="Read Calibration…", icon="IMPORT")
    column.operator("icymoon.write_calibration", text="Write Calibration…", icon="EXPORT")
    draw_placing(layout, "CAMERA")


def draw_placing(layout: bpy.types.UILayout, target: str) -> None:
    """Draw the button that places a ``target`` of the operator by a click on the ground; in a narrow sidebar with fewer
    words."""
    row = layout.row()
    row.operator_context = "INVOKE_DEFAULT"
    short = f"Place {target.title()}"
    fits = len(long := f"{short} by Click") <= sidebar_text.measure_line_length() - _ICON_BUTTON_CHARACTERS
    row.operator("icymoon.place_on_ground", text=long if fits else short, icon="CURSOR").target = target


def _make_placing(target: str) -> Extra:
    return lambda layout, context: draw_placing(layout, target)


def _draw_seed(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    root = context.scene.icymoon
    layout.prop(root.dataset, "seed")
    if root.source.kind != "PROCEDURAL" and not root.source.detail:
        draw_sentence(
            layout,
            "The ground is from a file. Add Roughness, under Ground from a File, adds the "
            "roughness of this panel to it.",
            "INFO",
        )


def _draw_roughness(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the measured roughness of the ground. Values of an earlier ground stay and are marked as such, because
    fields must not move while the user drags a number."""
    settings = scene_properties.read_for_display(context.scene.icymoon)
    lines = scenes.describe_ground_statistics(context.scene)
    earlier = scenes.shows_earlier_ground(context.scene, settings)
    if not lines or (earlier and preview.find_preview_of(context.scene, settings)):
        return
    column = layout.column(align=True)
    draw_lines(column, ("Of the ground built before:" if earlier else "Of the ground as it is built:", *lines[:2]))
    fits = len(lines[2]) <= sidebar_text.measure_line_length() - _ICON_BUTTON_CHARACTERS
    if not fits:
        draw_lines(column, (lines[2],))
    column.operator("icymoon.show_roughness", text=lines[2] if fits else "Measured Roughness", icon="GRAPH")


def _draw_moons(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw a button for each moon whose sky is shipped; the button of the scene's moon is pressed."""
    body = context.scene.icymoon.light.body
    narrow = sidebar_text.measure_line_length() < sidebar_text.LINE
    split = layout.column(align=True) if narrow else layout.split(factor=0.25)
    split.label(text="Sky of")
    row = split.row(align=True)
    for name, title, there in _list_moons():
        row.operator("icymoon.load_preset", text=title, depress=there == body).preset = name


@cache
def _list_moons() -> list[tuple[str, str, object]]:
    """List the preset name, title and ``light.body`` of the shipped moons. They are read once, since the window asks at
    every redraw."""
    return [(name, read_preset_header(name)[0], load(find_preset(name)).light.body) for name in preset_names("bodies")]


def _draw_sky_fault(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw, below the fields that determine the sky, why the sky cannot be computed, and any warning of a dark view
    with a button that turns the Sun."""
    if fault := sidebar_text.find_sky_fault(
        sidebar_text.find_light(scene_properties.read_for_display(context.scene.icymoon))
    ):
        draw_sentence(layout, fault, "ERROR")
    if shadow := shadow_warning.describe_shadow(context.scene):
        draw_sentence(layout, shadow, "ERROR")
        azimuth = shadow_warning.recall_lit_azimuth(context.scene)
        if azimuth is not None:
            button = layout.operator("wm.context_set_float", text=f"Turn Sun to {azimuth:g}°", icon="LIGHT_SUN")
            button.data_path, button.value = "scene.icymoon.light.sun_azimuth_deg", azimuth


def _draw_expose(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    draw_start(layout, "icymoon.expose", "Show Camera Image", "IMAGE_DATA")
    layout.prop(context.scene.icymoon, "follow")


def _draw_development_notes(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw warnings on the shown camera image. They are below the fields, because fields must not move while the user
    drags one."""
    draw_lines(layout, live_exposure.list_lines(), "INFO")


def _draw_qualities(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw a button for each quality with its seconds and its error; the button of the scene's quality is pressed."""
    settings = scene_properties.read_for_display(context.scene.icymoon)
    column = layout.column(align=True)
    # In a narrow sidebar the cost of a quality is below its button.
    narrow = sidebar_text.measure_line_length() < sidebar_text.LINE - 4
    titles = column if narrow else column.split(factor=0.45, align=True)
    for title in ("A pair, stereo error",) if narrow else ("", "A pair, stereo error"):
        titles.label(text=title)
    *shipped, own = sidebar_text.list_quality_presets(settings)
    for quality in shipped:
        row = column if narrow else column.split(factor=0.45, align=True)
        button = row.row(align=True)
        button.enabled = not quality.lacks
        button.operator("icymoon.load_preset", text=quality.title, depress=quality.chosen).preset = quality.name
        if quality.brief or not narrow:
            row.label(text=quality.brief)
    for lack in dict.fromkeys(quality.lacks for quality in shipped if quality.lacks):
        titles = " and ".join(quality.title for quality in shipped if quality.lacks == lack)
        # If the present settings can be rendered, the fix has nothing to change.
        told = (
            lack
            if own.lacks
            else (f"{lack.partition(';')[0]}; the Blender of blender.org has it. For a first look, lower Samples.")
        )
        draw_sentence(column, f"{titles} cannot be rendered here. {told}", "ERROR")
    if own.chosen:
        draw_lines(column, (f"With the settings below: {own.brief}",))
    draw_sentence(column, sidebar_text.describe_speed(settings))
    layout.operator_context = "INVOKE_DEFAULT"
    if sidebar_text.recall_known_speed(str(settings.quality.device)) is None:
        draw_start(layout, "icymoon.measure_machine", "Measure This Machine", "TIME")
    draw_start(layout, "icymoon.auto_quality", "Find Cheapest Quality…", "VIEWZOOM")


def _draw_camera_notes(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    draw_lines(layout, sidebar_text.list_camera_notes(scene_properties.read_for_display(context.scene.icymoon)), "INFO")


def _make_surface_extra(topic: str) -> Extra:
    def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        group = getattr(context.scene.icymoon, topic)
        surface = SurfaceSettings.from_values({s.key: getattr(group, s.key) for s in TOPICS[topic].settings})
        advice = _albedo_advice(surface)
        if advice and group.model == "PRINCIPLED":
            draw_sentence(layout, advice, "INFO")
        if group.model == "HAPKE":  # its albedos are in the panel with the other parameters of Hapke's law
            draw_settings(layout, context.scene.icymoon, "hapke", ("w",))
        else:
            values = scene_properties.read_for_display(context.scene.icymoon)
            _draw_albedos(layout, values[topic], values.hapke)

    return draw


def _draw_hapke(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    values = scene_properties.read_for_display(context.scene.icymoon)
    _draw_albedos(layout, values.surface | {"model": "HAPKE"}, values.hapke)


def _make_stand_in_note(kind: type) -> Extra:
    def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        for item in list_items(scene_properties.read_for_display(context.scene.icymoon)):
            if isinstance(item, kind):
                draw_sentence(layout, describe_item(item), "INFO")

    return draw


def _draw_albedos(layout: bpy.types.UILayout, surface: SurfaceSettings, hapke: HapkeSettings) -> None:
    """Draw the albedos that follow from the settings of a surface."""
    found = _albedos(surface, hapke)
    if found is not None:
        values = ("Normal", found.normal), ("Geometric", found.geometric), ("Bond", found.bond)
        draw_lines(layout, tuple(f"{label} albedo {value:.3f}" for label, value in values))


def _make_painting(kind: str) -> Extra:
    """Make a function that draws the buttons that paint a mask of a kind, use the painted mask, and clear it."""
    text = f"Paint Where {kind.title()} {'Lie' if kind == 'ROCKS' else 'Lies'}"

    def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        column = layout.column(align=True)
        column.operator("icymoon.paint_mask", text=text, icon="BRUSH_DATA").kind = kind
        painted = can_use(context.scene, kind)
        if not painted and not has_mask(context.scene, kind):
            return
        row = column.row(align=True)
        if painted:
            row.operator("icymoon.use_painted_mask").kind = kind
        row.operator("icymoon.clear_mask", text="" if painted else "Clear Mask", icon="X").kind = kind

    return draw


#: Functions that draw above the settings of a sub-panel, by topic and section.
IN_SECTION: dict[tuple[str, str], Extra] = {
    ("rocks", PLACE.key): _make_painting("ROCKS"),
    ("surface", DIRT.key): _make_painting("DIRT"),
    ("surface", COVER.key): _make_painting("FROST"),
}
#: Functions that draw above and below the settings, by topic.
BEFORE: dict[str, Extra] = {
    "source": _draw_import,
    "rig": _draw_calibration,
    "terrain": _draw_seed,
    "rocks": _draw_own_rock,
    "excavation": _make_placing("TRENCH"),
    "workspace": _make_placing("WORKSPACE"),
    "light": _draw_moons,
    "sensor": _draw_expose,
    "quality": _draw_qualities,
}
AFTER: dict[str, Extra] = {
    "terrain": _draw_roughness,
    "light": _draw_sky_fault,
    "source": _make_stand_in_note(MeshItem),
    "textures": _make_stand_in_note(TextureItem),
    "surface": _make_surface_extra("surface"),
    "rock_surface": _make_surface_extra("rock_surface"),
    "hapke": _draw_hapke,
    "rig": _draw_camera_notes,
    "sensor": _draw_development_notes,
}

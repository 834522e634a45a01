"""What F3 finds of Icy Moon for words that users type. It looks through the entries of all menus."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from icymoon import operators
from icymoon.panels import menu
from panel_drawing import Layout, drawn

SOUGHT = {
    "Render Stereo Pair": "icymoon.render_pair",
    "Evaluate Stereo": "icymoon.evaluate",
    "Stereo Error": "icymoon.show_error",
    "Icy Moon Manual": "icymoon.open_manual",
    "Show Stereo Pair": "icymoon.show_pair",
    "Europa Chaos": "icymoon.load_preset",
    "Load Preset": "icymoon.load_preset",
    "Live Preview": "icymoon.live",
    "Build Scene": "icymoon.build_scene",
    "Vary": "icymoon.vary",
    "Anaglyph": "icymoon.show_pair",
    "Evaluation Report": "icymoon.open_report",
    "Measured Surface": "icymoon.show_surface",
    "Install Evaluator": "icymoon.install_evaluator",
    "Render Data Set": "icymoon.render_dataset",
    "Icy Terrain": "icymoon.add_terrain",
    "Decisions on Ground": "icymoon.paint_decisions",
    "Where to Dig": "icymoon.decide",
    "several suns": "icymoon.decide",
    "own rules": "icymoon.decide_by_rules",
    "guarantee": "icymoon.decide_with_guarantee",
    "Lander": "icymoon.load_preset",
    "dry run": "icymoon.plan_dry_run",
    "true depth": "icymoon.show_pair",
    "flicker": "icymoon.show_pair",
    "error curve": "icymoon.show_curve",
    "paint errors": "icymoon.paint_errors",
    "camera image": "icymoon.expose",
    "ice rock": "icymoon.add_block",
    "save settings": "icymoon.save_settings",
    "import ground": "icymoon.import_ground",
    "read calibration": "icymoon.read_calibration",
    "write calibration": "icymoon.write_calibration",
    "cheapest quality": "icymoon.auto_quality",
    "compare qualities": "icymoon.trade",
    "asset library": "icymoon.make_asset_library",
    "other pairs": "icymoon.evaluate_folder",
    "whole data set": "icymoon.evaluate",
    "save plan": "icymoon.save_plan",
    "cancel": "icymoon.cancel",
    "stop": "icymoon.cancel",
    "sweep": "icymoon.vary",
    "paper": "icymoon.reproduce",
    "export pair": "icymoon.export_pairs",
    "find setting": "icymoon.find_setting",
    "object as ground": "icymoon.object_as_ground",
    "point cloud": "icymoon.show_surface",
}
#: Rows of a menu that fit a screen of 1080 pixels with its bars, at 24 pixels each as Blender draws them.
MAX_ROWS = 36
#: Commands that need what is selected in a list or under the mouse, and those of the page of preferences.
IN_PANELS_ONLY = {
    "icymoon.dig_trench",  # a click on the ground starts it
    "icymoon.lamp_add",
    "icymoon.lamp_remove",
    "icymoon.lamp_move",
    "icymoon.layer_add",
    "icymoon.layer_remove",
    "icymoon.layer_move",
    "icymoon.variation_remove",
    "icymoon.variation_move",
    "icymoon.toggle_matcher",
    "icymoon.show_roughness",
    "icymoon.wait",
    "icymoon.add_matcher",
    "icymoon.remove_matcher",
    "icymoon.remove_evaluator",
}


def entries(record: list, path: str = "") -> list[tuple[str, str]]:
    """(what it starts, its text with those of the menus above it) of each entry that a menu has drawn."""
    found = []
    for kind, *rest in record:
        if kind == "operator":
            category, _, name = rest[0].partition(".")
            label = rest[1] or getattr(getattr(bpy.ops, category), name).get_rna_type().name
            found.append((rest[0], f"{path} {label}"))
        elif kind == "operator_menu_enum":
            operator, key = rest[0]
            rna = getattr(bpy.ops.icymoon, operator.partition(".")[2]).get_rna_type()
            found += [(operator, f"{path} {rna.name} {item.name}") for item in rna.properties[key].enum_items]
        elif kind == "prop":
            setting: Any = bpy.types.Scene.bl_rna.properties["icymoon"].fixed_type.properties[rest[0].split(".")[-1]]
            found.append((rest[0], f"{path} {setting.name}"))
        elif kind == "menu":
            cls = getattr(bpy.types, rest[0])
            found += entries(drawn(cls), f"{path} {cls.bl_label}")
    return found


@pytest.fixture
def found(scene):
    """The entries of Render ▸ Icy Moon and of Add ▸ Mesh."""
    record: list = []
    top = type("Top", (), {"layout": Layout(record)})()
    menu._draw_menu(top, bpy.context)
    menu._draw_meshes(top, bpy.context)
    return entries(record)


def found_by(typed: str, found: list[tuple[str, str]]) -> set[str]:
    """What Blender lists: each word that is typed begins a word of the entry, or of the menus above it."""
    words = typed.lower().split()
    return {
        started
        for started, text in found
        if all(any(part.startswith(word) for part in text.lower().split()) for word in words)
    }


def test_every_menu_fits_the_screen(scene):
    menus: list[Any] = [cls for cls in menu.CLASSES if issubclass(cls, bpy.types.Menu)]
    assert {cls.bl_idname: len(drawn(cls)) for cls in menus if len(drawn(cls)) > MAX_ROWS} == {}


@pytest.mark.ci_takes(12)
@pytest.mark.parametrize("typed", SOUGHT)
def test_the_words_that_users_type_find_it(found, typed):
    assert SOUGHT[typed] in found_by(typed, found)


def test_every_command_is_found_by_its_name(found):
    missing = {
        cls.bl_idname
        for cls in operators.CLASSES
        if issubclass(cls, bpy.types.Operator) and cls.bl_idname not in found_by(cls.bl_label, found)
    }
    assert missing == IN_PANELS_ONLY

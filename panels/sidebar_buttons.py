"""The buttons of the sidebar and the commands of the menus, each with its place, for the search."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import bpy

from .. import operators
from ..operators.job_operators import JobOperator
from ..settings.find_settings import WordIndex, make_entry
from ..settings.table import TOPICS
from ..settings.topics.rocks import PLACE
from ..settings.topics.surfaces import COVER, DIRT
from .fields import draw_start

_MENU = "Render ▸ Icy Moon"


class Button(NamedTuple):
    """A button: its operator, its text, its panel, the operator's properties, and further words that users type."""

    operator: str
    text: str
    place: str
    properties: tuple[tuple[str, Any], ...] = ()
    also: str = ""


class FoundButton(NamedTuple):
    """A button that has all typed words. ``near`` tells whether a word is on the button or names its panel or
    operator."""

    button: Button
    near: bool


def _list_by_panel() -> Iterator[Button]:
    """Iterate over the buttons of panels other than the topics' panels."""
    for place, buttons in _BY_PANEL.items():
        for operator, text, *more in buttons:
            yield Button(f"icymoon.{operator}", text, place, *more)


def _list_by_topic() -> Iterator[Button]:
    """Iterate over the buttons in panels of topics."""
    for topic, buttons in _BY_TOPIC.items():
        for operator, text, *more in buttons:
            yield Button(f"icymoon.{operator}", text, TOPICS[topic].label, *more)


_BY_PANEL: dict[str, tuple[tuple[Any, ...], ...]] = {
    "Icy Moon": (
        ("build_scene", "Build Scene"),
        ("render_pair", "Render Stereo Pair"),
        ("evaluate", "Evaluate Stereo Pair", (("scope", "SCENE"),), "measure"),
        ("export_pairs", "Export…", (("source", "SCENE"),), "save pair"),
        ("show_pair", "Show Stereo Pair", (), "picture view"),
        ("cancel", "Cancel", (), "stop job"),
        ("add_preset", "Add Preset…", (), "save"),
        ("remove_preset", "Remove Preset…", (), "delete"),
        ("open_manual", "Open Manual", (), "help"),
    ),
    "Stereo Error": (
        ("open_report", "Open Evaluation Report"),
        ("show_error", "Show Error Image"),
        ("paint_errors", "Paint Errors on Ground", (("method", ""),)),
        ("show_surface", "Show Surface", (("method", ""),), "measured point cloud"),
        ("hide_surface", "Remove Errors from View"),
    ),
    "Vary This Scene": (
        ("vary", "Vary a Setting…", (), "sweep"),
        ("render_variations", "Render These Variations", (("folder", ""),), "sweep study"),
        ("evaluate", "Evaluate These Variations", (("scope", "VARIATIONS"),), "measure study"),
        ("show_ends", "Show First and Last"),
        ("save_plan", "Save Plan…"),
        ("show_curve", "Show Error Curve", (), "chart"),
    ),
    "Shipped Plans": (
        ("choose_plan", "Choose Plan…"),
        ("open_plan", "Open Plan…"),
        ("plan_dry_run", "Dry Run", (), "estimate time"),
        ("render_dataset", "Render Data Set"),
        ("show_last_pair", "Show Last Pair"),
        ("export_pairs", "Export Whole Data Set…", (("source", "DATASET"),), "save"),
        ("reproduce", "Reproduce GUISS Paper…"),
    ),
    "Evaluation": (
        ("evaluate", "Evaluate Whole Data Set", (("scope", "DATASET"),), "measure"),
        ("evaluate_folder", "Evaluate Other Pairs…", (), "measure photographs"),
        ("decide", "Decide Where to Dig", (("fuse_suns", False),), "decision site"),
        ("decide", "Decide Where to Dig on Several Suns", (("fuse_suns", True),), "decision site"),
        ("decide_by_rules", "Decide by Own Rules…", (), "decision dig site"),
        ("decide_with_guarantee", "Decide with Guarantee…", (), "decision dig site"),
        ("paint_decisions", "Show Decisions on Ground", (("method", ""),), "map suitability slope"),
        ("hide_decisions", "Remove Decisions"),
    ),
    "Speed and Accuracy": (
        ("trade", "Compare Qualities…"),
        ("show_trade", "Show Chart of Qualities"),
    ),
    "Active Sensors": (("lamp_add", "Add Lamp", (), "light night"),),
    "LiDAR": (
        ("show_beams", "Show LiDAR Beams", (), "laser"),
        ("scan_lidar", "Scan with LiDAR", (), "laser"),
        ("show_scan", "Show LiDAR Points", (), "laser"),
        ("hide_scan", "Remove LiDAR from View", (), "laser hide"),
    ),
    f"Rocks ▸ {PLACE.label}": (("paint_mask", "Paint Where Rocks Lie", (("kind", "ROCKS"),), "mask"),),
    f"Ice ▸ {DIRT.label}": (("paint_mask", "Paint Where Dirt Lies", (("kind", "DIRT"),), "mask"),),
    f"Ice ▸ {COVER.label}": (("paint_mask", "Paint Where Frost Lies", (("kind", "FROST"),), "mask"),),
    f"{_MENU} ▸ Load and Save": (
        ("load_preset", "Load Preset…", (), "open"),
        ("load_settings", "Load Settings…", (), "open import"),
        ("save_settings", "Save Settings…", (), "export"),
    ),
    _MENU: (
        ("clear_scene", "Clear Scene", (), "delete remove"),
        ("save_trajectory", "Save Trajectory…", (), "export"),
        ("watch_dataset", "Watch Data Set"),
        ("use_image_as_mask", "Use Image as Mask…"),
        ("make_asset_library", "Make Asset Library"),
        ("check_evaluator", "Check Evaluator"),
    ),
}
_BY_TOPIC: dict[str, tuple[tuple[Any, ...], ...]] = {
    "source": (
        ("import_ground", "Import Ground…", (), "own terrain height map mesh"),
        ("object_as_ground", "Use Selected Object as Ground", (), "own mesh"),
        ("place_on_ground", "Place Site by Click", (("target", "SITE"),)),
    ),
    "rig": (
        ("read_calibration", "Read Calibration…", (), "import"),
        ("write_calibration", "Write Calibration…", (), "export"),
        ("place_on_ground", "Place Camera by Click", (("target", "CAMERA"),), "move"),
    ),
    "terrain": (("show_roughness", "Measured Roughness"),),
    "rocks": (("object_as_rock", "Use Selected Object as Rock", (), "own mesh stone boulder"),),
    "excavation": (("place_on_ground", "Place Trench by Click", (("target", "TRENCH"),), "dig"),),
    "workspace": (("place_on_ground", "Place Workspace by Click", (("target", "WORKSPACE"),), "reach"),),
    "sensor": (("expose", "Show Camera Image", (), "develop picture"),),
    "quality": (
        ("measure_machine", "Measure This Machine", (), "time benchmark"),
        ("auto_quality", "Find Cheapest Quality…"),
    ),
}
#: All buttons, in the order of the work.
BUTTONS = (*_list_by_panel(), *_list_by_topic())


@cache
def _find_operator_classes() -> dict[str, type]:
    return {cls.bl_idname: cls for cls in operators.CLASSES if issubclass(cls, bpy.types.Operator)}


@cache
def _index_buttons() -> WordIndex:
    return WordIndex(
        [
            make_entry(
                (button.operator, name := button.operator.partition(".")[2]),
                button.text,
                f"{name} {button.also}",
                button.place,
                str(_find_operator_classes()[button.operator].__doc__),
            )
            for button in BUTTONS
        ]
    )


#: Number of a button's tiers of search words, from the nearest, whose words are on it or name its panel or operator.
_NEAR = 3


def find_buttons(typed: str) -> tuple[FoundButton, ...]:
    """Find the buttons that have all of the typed words, the nearest first. Words of the tooltip count as the
    farthest."""
    return tuple(FoundButton(BUTTONS[found.number], found.tier < _NEAR) for found in _index_buttons().rank(typed))


def draw_button(layout: bpy.types.UILayout, button: Button) -> None:
    """Draw a button below the name of its panel."""
    layout.label(text=button.place)
    row = layout.row()
    row.operator_context = "INVOKE_DEFAULT"  # so that it asks the same questions as the button in the panel
    if issubclass(_find_operator_classes()[button.operator], JobOperator):
        draw_start(row, button.operator, button.text, **dict(button.properties))
        return
    drawn = row.operator(button.operator, text=button.text)
    for name, value in button.properties:
        setattr(drawn, name, value)

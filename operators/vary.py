"""Vary This Scene: the list of settings that vary, the estimate of time and size, and rendering its pairs."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ..nodes import scene as scenes
from ..nodes.datablocks.blend_file_paths import with_absolute_files
from ..nodes.datablocks.fingerprint import added_objects
from ..render.cost.estimate import duration_text, estimate_roughly, size_text
from ..render.pairs.our_files import folder_of_pairs
from ..render.plans.frozen_plan import PLAN as FROZEN
from ..render.plans.frozen_plan import read_frozen_plan
from ..render.plans.plan_file import parse_plan
from ..render.plans.vary_scene import (
    VariedSetting,
    check_varied,
    count_pairs,
    describe,
    label_of,
    list_values,
    names_that_vary,
    plan_text,
    sample_settings,
    title_of,
    vary_around,
    why_fixed,
)
from ..settings import change_announcements
from ..settings.blender import scene_properties
from ..settings.table import TOPICS
from ..settings.topics.declaration import Setting
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.files import absolute_path, read_text, write_text
from ..support.number_text import count_of
from ..support.printer import show_controls
from . import dataset, dialogs, jobs, results, variation_pictures
from .list_editing import EditedList, MoveEntry, RemoveEntry
from .render import dataset_folder
from .sidebar_text import in_window, known_speed, plain

#: File of the plan in the folder of its data set.
PLAN = "plan.toml"
#: Rendered pairs whose pictures the sidebar offers, and characters of a line of the dialog.
_PICTURES, _DIALOG_LINE = 24, 60
#: Values of a setting that the panel shows.
_SHOWN = 12
#: Characters that a line of the list has room for.
_LIST_LINE = 29
#: Number of pairs over which the estimate takes the mean.
_SAMPLE = 16
#: Maximum number of pairs whose ids are compared with an existing data set: it takes a second.
_COMPARED = 500
_EDITED = (
    "The scene was edited by hand, and a plan contains settings only, so its pairs would not show the edits; "
    "press Build Scene to undo them."
)
_UNITS = {"deg": "°", "1": ""}
_lines: dict[tuple[int, object], tuple[str, ...]] = {}  # by scene and measured speed, until anything changes


def _of_name(name: str) -> Setting:
    topic, _, key = name.partition(".")
    return TOPICS[topic][key]


def unit_of(name: str) -> str:
    """The unit of a setting as the sidebar shows it."""
    unit = _of_name(name).unit
    return _UNITS.get(unit, unit)


#: (name, label, description) of the settings that can vary.
_ITEMS = [
    (name, f"{TOPICS[name.partition('.')[0]].label} ▸ {label_of(name)}", _of_name(name).description)
    for name in names_that_vary()
]


def setting_of_button(context: bpy.types.Context) -> str:
    """The setting under the mouse when a context menu was opened; empty if it is not a setting of Icy Moon."""
    prop, group = getattr(context, "button_prop", None), getattr(context, "button_pointer", None)
    topic = type(group).__name__.removeprefix("ICYMOON_PG_")
    if prop is None or topic not in TOPICS or prop.identifier not in {s.key for s in TOPICS[topic].settings}:
        return ""
    return f"{topic}.{prop.identifier}"


def _choice_items(operator: Any, _context: Any) -> list[tuple[str, str, str]]:
    """The values of the choice that the dialog is about."""
    return list(_of_name(operator.setting).choices) if operator.setting else []


#: The values of a number, as properties of a dialog.
_ValueFields: Any = type("_ValueFields", (), {"__annotations__": scene_properties.varied_fields(options={"SKIP_SAVE"})})


class ICYMOON_OT_vary(_ValueFields, bpy.types.Operator):
    """Vary a setting of this scene: render a pair for each value and see how the error depends on it"""

    bl_idname = "icymoon.vary"
    bl_label = "Vary"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "setting"

    setting: bpy.props.EnumProperty(
        items=_ITEMS,
        name="Setting",
        options={"SKIP_SAVE"},
        description="Which setting varies",
    )
    values: bpy.props.EnumProperty(
        items=_choice_items,
        name="Values",
        options={"ENUM_FLAG", "SKIP_SAVE"},
        description="The values of a choice",
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        """The tooltip, with the description of the setting if one is given."""
        if not properties.is_property_set("setting"):
            return str(cls.__doc__)
        return (
            f"Vary {label_of(properties.setting)}: render a pair for each value and see how the error depends on "
            f"it. {_of_name(properties.setting).description}"
        )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        name = setting_of_button(context)
        why = why_fixed(*name.split(".")) if name else ""
        if why:
            cls.poll_message_set(in_window(f"{name} {why}."))
        return not why

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.properties.is_property_set("setting"):
            context.window_manager.invoke_search_popup(self)
            return {"INTERFACE"}  # as Blender's own searches; a running operator would never be freed
        self._complete(context.scene.icymoon)
        return set(context.window_manager.invoke_props_dialog(self, title=f"Vary {label_of(self.setting)}"))

    def execute(self, context: bpy.types.Context) -> set[str]:
        root = context.scene.icymoon
        self._complete(root)
        varied = scene_properties.read_varied(
            self,
            self.setting,
            tuple(choice[0] for choice in _of_name(self.setting).choices if choice[0] in self.values),
        )
        try:
            check_varied(varied)
        except IcyMoonError as error:
            self.report({"ERROR"}, in_window(error))
            return {"CANCELLED"}
        scene_properties.write_varied(root, varied)
        return {"FINISHED"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_values(self.layout, self, self.setting)
        if _of_name(self.setting).choices:
            self.layout.column().prop(self, "values")

    def _complete(self, root: Any) -> None:
        """Fill in the fields that the caller did not give: from the list, or else with values about the present one."""
        there = next(
            (each for each in scene_properties.read_variations(root).varied if each.name == self.setting), None
        )
        topic, _, key = self.setting.partition(".")
        value = scene_properties.read_unchecked(root)[topic][key]
        wanted = there or vary_around(self.setting, value)
        whole = "_whole" if _of_name(self.setting).kind == "int" else ""
        stated = {
            f"first{whole}": wanted.first,
            f"last{whole}": wanted.last,
            "count": wanted.count,
            "spacing": wanted.spacing,
            "values": set(wanted.values),
        }
        for name, each in stated.items():
            if not self.properties.is_property_set(name) and (name != "values" or each):
                setattr(self, name, each)


def draw_values(layout: Any, fields: Any, name: str) -> None:
    """Draw the ends, the number and the spacing of a number that varies; a sentence for a tick."""
    setting, unit = _of_name(name), unit_of(name)
    if setting.kind == "bool":
        layout.label(text="Off and on", icon="CHECKBOX_HLT")
    if setting.kind not in ("int", "float"):
        return
    column = layout.column(align=True)
    for end, label in (("first", "From"), ("last", "To")):
        shown = f"{end}_whole" if setting.kind == "int" else scene_properties.shown_as(end, setting.precision)
        column.prop(fields, shown, text=f"{label} ({unit})" if unit else label)
    column.prop(fields, "count")
    layout.prop(fields, "spacing", text="")


@lru_cache(maxsize=256)
def title_of_varied(varied: VariedSetting) -> str:
    """A line of the list: the setting and its values."""
    try:
        setting = check_varied(varied)
    except IcyMoonError:
        return label_of(varied.name)[:40]
    if setting.kind in ("bool", "choice"):
        labels = {choice[0]: choice[1] for choice in setting.choices}
        title = f"{label_of(varied.name)}: {', '.join(labels[v] for v in varied.values) if labels else 'off, on'}"
        short = f"{label_of(varied.name)}: {count_of(len(varied.values), 'value')}"
        return title if len(title) <= _LIST_LINE else short
    count = len(list_values(varied)) if varied.spacing != "RANDOM" else varied.count
    unit = unit_of(varied.name)
    return (
        f"{label_of(varied.name)}: {varied.first:.4g} to {varied.last:.4g}"
        f"{unit if unit == '°' else f' {unit}' if unit else ''}, {count} {'random' * (varied.spacing == 'RANDOM')}"
    ).rstrip()


@lru_cache(maxsize=256)
def values_of_varied(varied: VariedSetting) -> str:
    """The values of a number that does not vary at random, up to the maximum number that the panel shows."""
    try:
        if check_varied(varied).kind not in ("int", "float") or varied.spacing == "RANDOM":
            return ""
    except IcyMoonError:
        return ""
    values = [f"{value:.5g}" for value in list_values(varied)]
    return ", ".join(values if len(values) <= _SHOWN else [*values[: _SHOWN - 1], "…", values[-1]])


class _OfVariations:
    """Mix-in: an operator on the list of settings that vary."""

    empty = "Nothing varies yet; press Add Setting"

    @staticmethod
    def find(scene: bpy.types.Scene) -> EditedList:
        return EditedList(scene.icymoon.variations, "varied", "active", "run")


class ICYMOON_OT_variation_remove(_OfVariations, RemoveEntry, bpy.types.Operator):
    """Remove the selected setting from the list; the setting itself stays as it is"""

    bl_idname = "icymoon.variation_remove"
    bl_label = "Remove Varied Setting"


class ICYMOON_OT_variation_move(_OfVariations, MoveEntry, bpy.types.Operator):
    """Move the selected setting in the list; the last one changes fastest from pair to pair"""

    bl_idname = "icymoon.variation_move"
    bl_label = "Move Varied Setting"

    direction: bpy.props.EnumProperty(
        name="Direction",
        description="Direction of the move",
        items=(("UP", "Up", "Toward the first"), ("DOWN", "Down", "Toward the last")),
    )


def lines(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Sentences on the pairs of a scene's variations, their time and size, or on why they are impossible; computed once
    per change."""
    device = str(scene.icymoon.quality.device)
    key = (scene.session_uid, known_speed(device))
    if key not in _lines:
        _lines[key] = _make_lines(scene)
    return _lines[key]


def _make_lines(scene: bpy.types.Scene) -> tuple[str, ...]:
    settings = scene_properties.read_unchecked(scene.icymoon)
    variations = scene_properties.read_variations(scene.icymoon)
    try:
        told = describe(settings, variations)
        some, grounds = sample_settings(settings, variations, _SAMPLE)
    except IcyMoonError as error:
        return (str(error),)
    speed = known_speed(str(settings.quality.device))
    seconds, size = estimate_roughly(some, count_pairs(settings, variations), grounds, speed)
    machine = "on this machine" if speed else "on another machine; measure this one under Quality and Speed"
    return (told, f"About {duration_text(seconds)} and {size_text(size)} {machine}")


def _forget_lines(*_: Any) -> None:
    _lines.clear()


@bpy.app.handlers.persistent
def _forget_after(*_: Any) -> None:
    _forget_lines()


def why_not_a_plan(scene: bpy.types.Scene, thorough: bool = False) -> str:
    """Why the pairs of a plan would not show the scene, in a sentence; empty if they would.

    Only a ``thorough`` look finds edits of built objects; it reads all meshes.
    """
    collection = scenes.find_collection(scene)
    if collection is None:
        return ""
    names = [item.name for item in added_objects(collection)]
    if names:
        more = f" and {count_of(len(names) - 1, 'more object')} of yours" if len(names) > 1 else ""
        return (
            f"The scene contains {names[0]}{more}, and a plan contains settings only, so its pairs would not show "
            f"{'them' if more else 'it'}; move {'them' if more else 'it'} out of the collection "
            f"{collection.name}."
        )
    built = scenes.find(scene) if thorough else None
    return _EDITED if built is not None and not built.outdated and built.edited_parts() else ""


def _plan_text(scene: bpy.types.Scene, settings: Settings) -> str:
    """The plan that varies a scene. Raises IcyMoonError for what cannot be, and for a scene edited by hand."""
    if why := why_not_a_plan(scene, thorough=True):
        raise IcyMoonError(why)
    variations = scene_properties.read_variations(scene.icymoon)
    if not variations.varied and variations.seeds == 1:
        raise IcyMoonError("Nothing varies yet; press + under Vary This Scene, or raise Variations by Seed.")
    return plan_text(with_absolute_files(settings), variations)


def _fault_of_folder(folder: Path, text: str) -> str:
    """Why a plan cannot be rendered into a folder, in a sentence; empty if it can.

    A folder fits if it has neither plan nor pairs, if it is the plan's own data set, or if the plan contains all of its
    pairs.
    """
    path, pairs = folder / PLAN, folder_of_pairs(folder)
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
    if rendered and (len(rendered) > _COMPARED or not rendered <= {p.id for p in parse_plan(path, text).pairs()}):
        return f"{folder} contains other pairs than those of these variations; choose another folder."
    return ""


def _spread(pairs: Sequence[Any]) -> list[Any]:
    """All pairs, or as many as the sidebar can show: the first, the last and others at equal steps."""
    count = min(_PICTURES, len(pairs))
    return [pairs[round(k * (len(pairs) - 1) / max(1, count - 1))] for k in range(count)]


def _free_folder(folder: Path, text: str, title: str) -> Path:
    """The folder if the plan can be rendered into it, or one beside it, named after what varies."""
    stem = f"{folder.name}_{re.sub(r'[^a-z0-9]+', '_', title.lower()).strip('_')}"
    candidates = [folder, folder.with_name(stem), *(folder.with_name(f"{stem}_{k}") for k in range(2, 100))]
    return next((each for each in candidates if not _fault_of_folder(each, text)), folder)


class ICYMOON_OT_render_variations(dataset.DatasetOperator, bpy.types.Operator):
    """Render the pairs of all variations of this scene into a data set folder, in separate processes. Their plan is saved there, so the shell can continue it"""  # noqa: E501

    bl_idname = "icymoon.render_variations"
    bl_label = "Render These Variations"

    folder: bpy.props.StringProperty(
        name="Folder",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
        description="Folder of the data set; if empty, that of the panel Data Set",
    )
    _asked = False
    _told: tuple[str, ...] = ()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or self.folder:
            return super().invoke(context, event)
        scene = context.scene
        try:
            settings = scene_properties.read_settings(scene.icymoon)
            title = title_of(scene_properties.read_variations(scene.icymoon))
            self.folder = str(_free_folder(dataset_folder(settings), _plan_text(scene, settings), title))
        except IcyMoonError as error:
            return self.fail(error)
        self._asked = True
        return set(context.window_manager.invoke_props_dialog(self, width=420, confirm_text="Render"))

    def draw(self, context: bpy.types.Context) -> None:
        column, group = self.layout.column(), context.scene.icymoon.dataset
        for sentence in lines(context.scene):
            for line in textwrap.wrap(plain(sentence), _DIALOG_LINE):
                column.label(text=line)
        variation_pictures.draw_icons(column, context.scene)
        column.prop(self, "folder")
        column.prop(group, "evaluate")
        if group.evaluate:
            column.prop(group, "methods")

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self._asked:
            return super().execute(context)
        # A dialog runs it as a script does, which would wait until all pairs are there; and Blender does not free an
        # operator that becomes modal when its dialog is confirmed. So another operator does the work.
        try:
            bpy.ops.icymoon.render_variations("INVOKE_DEFAULT", folder=self.folder)
        except RuntimeError as error:  # with the operator's report
            self.report({"ERROR"}, show_controls(str(error).removeprefix("Error: ").strip()))
            return {"CANCELLED"}
        return {"FINISHED"}

    def start(self, context: bpy.types.Context) -> jobs.Job:
        group = context.scene.icymoon.dataset
        settings = scene_properties.read_settings(context.scene.icymoon)
        text = _plan_text(context.scene, settings)
        if self.folder:
            settings.dataset.folder = str(absolute_path(self.folder, "dataset.folder"))
        folder = dataset_folder(settings)
        if fault := _fault_of_folder(folder, text):
            raise IcyMoonError(fault)
        plan = str(folder / PLAN)
        command = dataset.batch_command(settings, plan)  # which is refused before anything is written
        if (folder / FROZEN).is_file():
            self.report({"INFO"}, show_controls(f"Continuing the data set in {folder}"))
        write_text(folder / PLAN, text)
        process = dataset.start_batch(settings, command, plan)
        if group.folder != settings.dataset.folder:
            group.folder = settings.dataset.folder
            jobs.push_undo(self.bl_label)
        return self._job_of(process, context)

    def report_success(self, context: bpy.types.Context) -> None:
        scene = self._keeper.scene
        if scene is not None:
            pairs = read_frozen_plan(Path(self._process.facts["dataset"])).pairs
            scene.icymoon.pairs = " ".join(pair.id for pair in _spread(pairs))
            jobs.push_undo(self.bl_label)
        super().report_success(context)
        _show_curves(context, open_window=False)


class ICYMOON_OT_save_plan(dialogs.TomlFileDialog, bpy.types.Operator):
    """Save the plan of these variations as a TOML file, for icymoon batch in a shell or on another machine"""

    bl_idname = "icymoon.save_plan"
    bl_label = "Save Plan"

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH",
        name="File",
        description="TOML file to write",
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or PLAN
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath)).with_suffix(".toml")
        try:
            write_text(path, _plan_text(context.scene, scene_properties.read_settings(context.scene.icymoon)))
        except IcyMoonError as error:
            self.report({"ERROR"}, in_window(error))
            return {"CANCELLED"}
        self.report({"INFO"}, show_controls(f"Saved {path}"))
        return {"FINISHED"}


def sorted_curves(scene: bpy.types.Scene) -> dict[str, Path]:
    """The pictures of the error against each setting of an evaluation that varies, those in the list first."""
    curves = results.curves(scene)
    listed = [each.name for each in scene_properties.read_variations(scene.icymoon).varied]
    return {name: curves[name] for name in sorted(curves, key=lambda name: name not in listed)}


def curve_title(name: str) -> str:
    """What a curve of the error against a setting is called."""
    return f"Error against {label_of(name)}"


def _show_curves(context: bpy.types.Context, open_window: bool, first: str = "") -> None:
    """Show the curves in an Image Editor, the curve of the setting ``first`` before the others."""
    curves = sorted_curves(context.scene)
    results.show_images(
        context,
        sorted(curves.values(), key=lambda path: path != curves.get(first)),
        open_window,
        {path: curve_title(name) for name, path in curves.items()},
    )


class ICYMOON_OT_show_curve(bpy.types.Operator):
    """Show the error of each matcher against a setting that varies, in an Image Editor"""

    bl_idname = "icymoon.show_curve"
    bl_label = "Show Error Curve"

    setting: bpy.props.StringProperty(name="Setting", description="Which setting; if empty, the first that varies")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not results.curves(context.scene):
            cls.poll_message_set("There is no evaluation of a data set in which a setting varies; evaluate one first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        _show_curves(context, open_window=True, first=self.setting)
        return {"FINISHED"}


CLASSES = (
    ICYMOON_OT_vary,
    ICYMOON_OT_variation_remove,
    ICYMOON_OT_variation_move,
    ICYMOON_OT_render_variations,
    ICYMOON_OT_save_plan,
    ICYMOON_OT_show_curve,
)
_HANDLERS: tuple[Callable[[], list[Any]], ...] = (
    lambda: bpy.app.handlers.undo_post,
    lambda: bpy.app.handlers.redo_post,
    lambda: bpy.app.handlers.load_post,
)


def register() -> None:
    """Compute the lines anew whenever anything changes."""
    change_announcements.listeners.append(_forget_lines)
    for handlers in _HANDLERS:
        handlers().append(_forget_after)


def unregister() -> None:
    """Listen no longer."""
    for handlers in _HANDLERS:
        handlers().remove(_forget_after)
    change_announcements.listeners.remove(_forget_lines)
    _forget_lines()

"""Presets: the shipped ones, and the user's own in the extension's folder."""

from __future__ import annotations

import re
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path

import bpy

from ..commands.sources import BY_HAND, DEFAULT, find_origins
from ..formats.png import encode_png
from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.datablocks.blend_file_paths import make_paths_absolute
from ..nodes.ground.user_ground import is_from_file
from ..render.cycles_settings import find_missing_feature
from ..settings import description, preset_files, rebuilt_parts, toml_text
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..stereo.pair_views import read_pair_views
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors, write_bytes, write_text
from ..support.printer import show_controls
from ..support.system import find_name_fault, remove
from . import dialogs, live_preview, refine_ground
from .build import build_and_report
from .build_in_pieces import PiecewiseBuildOperator
from .evaluate import find_rendered_pairs
from .job_operators import WatchingOperator
from .operator_type import ExplainedOperator
from .preferences import find_extension_folder
from .session import session
from .sidebar_text import format_for_window, remember_answers
from .window_areas import find_scene

#: Prefix of the names of the user's own presets.
OWN = "own/"
_PICTURE_SUFFIX = ".png"
#: Topics that belong to the user and stay when a scene is loaded.
_KEPT_TOPICS = ("dataset", "quality")
#: Maximum number of columns and of rows of a preset's picture.
PICTURE_PX = 256
_shipped: list[tuple[str, str, str]] = []
_kept: dict[tuple[str, str, str], tuple[str, str, str]] = {}  # Blender requires that Python keeps the strings of items


def find_own_folder() -> Path:
    """Return the folder of the user's own presets. Raises IcyMoonError if Icy Moon is not an installed extension."""
    return find_extension_folder() / "presets"


def list_own_presets() -> dict[str, Path]:
    """List the files of the user's own presets by name, such as ``own/my_site``."""
    try:
        return {f"{OWN}{path.stem}": path for path in sorted(find_own_folder().glob("*.toml"))}
    except IcyMoonError:  # not installed as an extension
        return {}


def find_preset(name: str) -> Path:
    """Find the file of a preset, shipped or the user's own. Raises IcyMoonError if the preset does not exist."""
    if not name.startswith(OWN):
        return preset_files.find_preset(name)
    try:
        return list_own_presets()[name]
    except KeyError:
        raise IcyMoonError(
            f"Your preset {name.removeprefix(OWN)!r} does not exist on this machine; choose another one."
        ) from None


def find_picture(name: str) -> Path:
    """Return the path of the picture of a scene preset, shipped or the user's own. The picture may not exist."""
    return (
        preset_files.find_preview(name)
        if not name.startswith(OWN)
        else find_own_folder() / (f"{name.removeprefix(OWN)}{_PICTURE_SUFFIX}")
    )


def _save_picture(context: bpy.types.Context, settings: Settings, target: Path) -> bool:
    """Save the left image of the rendered pair of ``settings`` beside a preset. Returns False without such a pair."""
    try:
        views = read_pair_views(
            find_rendered_pairs(context, settings)[0], rebuilt_parts.select_response(settings), PICTURE_PX
        )
    except IcyMoonError:
        return False
    content = encode_png(views.pictures("LEFT")[0])
    write_bytes(target, content)
    return True


def list_preset_items(_self: object = None, _context: object = None) -> list[tuple[str, str, str]]:
    """List (name, title, description) of all presets. The shipped presets are read once."""
    if not _shipped:
        _shipped.extend((name, *preset_files.read_preset_header(name)) for name in preset_files.preset_names())
    own = [(name, *_read_header(path, path.stat().st_mtime_ns)) for name, path in list_own_presets().items()]
    return [*_shipped, *(_kept.setdefault(item, item) for item in own)]


def list_search_items(_self: object = None, _context: object = None) -> list[tuple[str, str, str]]:
    """List the items of ``list_preset_items`` with the preset's kind after each title, since presets of two kinds may
    have the same title."""
    found = []
    for name, title, tooltip in list_preset_items():
        kind = preset_files.PRESET_KINDS.get(name.split("/")[0], "Yours")
        item = (name, f"{title}   {kind}", tooltip)
        found.append(_kept.setdefault(item, item))
    return found


@lru_cache(maxsize=256)
def _read_header(path: Path, modified_ns: int) -> tuple[str, str]:
    """Read (title, description) of one of the user's own presets. The answer is cached, because the sidebar asks at
    every redraw."""
    try:
        return preset_files.read_header(path, path.stem)
    except IcyMoonError as error:
        return path.stem, str(error)


def find_title(name: str) -> str:
    """Return the title of a preset in the sidebar."""
    found = next((title for known, title, _ in list_preset_items() if known == name), name.split("/")[-1])
    return found or "Choose a Preset"


def is_changed(scene: bpy.types.Scene) -> bool:
    """Return whether the settings of the scene differ from its preset, so that loading the preset would change them.

    Data set and quality do not count, because loading a preset keeps them.
    """
    name = scene.icymoon.preset
    if not name or not _exists(name):
        return False
    path = find_preset(name)
    return _differs(scene_properties.read_for_display(scene.icymoon), path, path.stat().st_mtime_ns)


def _exists(name: str) -> bool:
    return (
        name in list_own_presets() if name.startswith(OWN) else any(name == known for known, *_ in list_preset_items())
    )


@remember_answers
def _differs(settings: Settings, path: Path, modified_ns: int) -> bool:
    try:
        loaded = description.merged(description.defaults(), preset_files.load(path))
    except IcyMoonError:
        return False  # the user's file has become unreadable, which loading it reports
    return any(settings[topic] != loaded[topic] for topic in loaded if topic not in _KEPT_TOPICS)


def find_known_sources(settings: Settings, preset: str) -> dict[str, str]:
    """Find the known sources of settings, by ``topic.key``.

    If a value is still as in the user's preset that was loaded last, its source is taken from there, else from a
    shipped preset with this value.
    """
    whole = description.merged(description.defaults(), settings)
    found = {
        origin.name: origin.source
        for origin in find_origins(whole)
        if origin.preset not in (DEFAULT, BY_HAND) and origin.name.partition(".")[0] in settings
    }
    path = list_own_presets().get(preset)
    if path is None:
        return found
    preset_settings, sources = preset_files.load(path), toml_text.read_toml(path).get("sources", {})
    unchanged = {
        f"{topic}.{key}"
        for topic, values in preset_settings.items()
        for key, value in values.items()
        if whole[topic][key] == value
    }
    return found | {name: str(source) for name, source in sources.items() if name in unchanged}


def _make_fresh_settings(group: bpy.types.PropertyGroup) -> Settings:
    """Make the settings to which a preset of a whole scene is applied: defaults, and the quality that the user has
    chosen.

    Quality values that came from the previous preset become defaults again. Settings of the data set are left out.
    """
    fresh, now = description.defaults(), scene_properties.read_unchecked(group).quality
    try:
        of_previous = preset_files.load(find_preset(group.preset)).get("quality", {}) if group.preset else {}
    except IcyMoonError:  # the user has deleted the preset
        of_previous = {}
    fresh.quality.update({key: value for key, value in now.items() if of_previous.get(key) != value})
    fresh.pop("dataset")
    return fresh


class ICYMOON_OT_load_preset(dialogs.SearchDialog, PiecewiseBuildOperator, bpy.types.Operator):
    """Load a preset. A scene preset keeps the data set and your quality, other presets set only their part"""

    bl_idname = "icymoon.load_preset"
    bl_label = "Load Preset"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "preset"

    preset: bpy.props.EnumProperty(
        items=list_search_items,
        name="Preset",
        description="Preset to load",
    )
    # In a window, show the scene at once, with coarse ground first and at full resolution afterwards.
    build: bpy.props.BoolProperty(default=False, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Return the tooltip. Blender adds the title and the description of a given preset."""
        given = properties.is_property_set("preset")
        return "Load this preset into the settings of the scene" if given else str(cls.__doc__)

    _before: tuple[str, Settings] | None = None  # the loaded preset and the settings before

    def execute(self, context: bpy.types.Context) -> set[str]:
        group = context.scene.icymoon
        try:
            loaded = preset_files.load(find_preset(self.preset))
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        session.stop_building()  # the build of the earlier settings
        self._before = group.preset, scene_properties.read_unchecked(group)
        if preset_files.is_whole_scene(self.preset):
            loaded = description.merged(_make_fresh_settings(group), loaded)
            group.preset = self.preset
        in_pieces = self._builds_in_pieces(context)
        with live_preview.leave_to_build() if in_pieces else nullcontext():
            scene_properties.write_settings(group, loaded)
        if "quality" in loaded and (lack := find_missing_feature(description.merged(description.defaults(), loaded))):
            self.report({"WARNING"}, format_for_window(lack))
        if self.build and live_preview.has_window():
            return self._show(context, in_pieces)
        return {"FINISHED"}

    def _builds_in_pieces(self, context: bpy.types.Context) -> bool:
        """Return whether the scene is built in pieces, if its ground is not from a file. A scene that was edited by
        hand is shown by the live preview, since a build would undo the edits."""
        if not self.build or bpy.app.background or not self.options.is_invoke or self.options.is_repeat:
            return False
        built = scenes.find_built(context.scene)
        return built is None or (context.scene.icymoon.live and not built.outdated and not built.edited)

    def _show(self, context: bpy.types.Context, in_pieces: bool) -> set[str]:
        """Show the settings of the scene with coarse ground, and let the ground at full resolution follow."""
        scene = context.scene
        settings = scene_properties.read_unchecked(scene.icymoon)
        if in_pieces and not is_from_file(settings):
            return WatchingOperator.invoke(self, context, None)
        if scenes.find_collection(scene) is not None:
            live_preview.update_scene(scene)
            if scene.icymoon.live and (built := scenes.find_built(scene)):
                preview.mark_as_preview(built, settings)
        elif is_from_file(settings):
            bpy.ops.icymoon.build_scene("INVOKE_DEFAULT")  # this asks before it loads a large mesh
        else:
            build_and_report(self, context, coarse=True)
        self._cover(scene)
        return {"FINISHED"}

    def _cover(self, scene: bpy.types.Scene) -> None:
        """Cover the view with the preset's picture until the view is clear, and start to make the fine ground."""
        session.picture.show(scene, find_picture(self.preset))
        if preview.find_preview_of(scene, scene_properties.read_unchecked(scene.icymoon)) is None:
            session.picture.count(scene)
        refine_ground.start_refining()

    def take_back(self, scene: bpy.types.Scene) -> None:
        """Restore the preset and the settings that the scene had before the operator."""
        if self._before is not None:
            scene.icymoon.preset, before = self._before
            scene_properties.write_settings(scene.icymoon, before)

    def fail(self, error: Exception) -> set[str]:
        """Report why the scene was not built. Its settings stay loaded."""
        super().fail(error)
        return {"FINISHED"}

    def report_success(self, context: bpy.types.Context) -> None:
        """Report the built scene, and cover its view."""
        super().report_success(context)
        if (scene := find_scene(self._scene_uid)) is not None:
            self._cover(scene)


class ICYMOON_OT_add_preset(bpy.types.Operator):
    """Save the present settings, except the data set, as your own preset. It replaces a preset of the same name"""

    bl_idname = "icymoon.add_preset"
    bl_label = "Add Preset"
    bl_options = {"UNDO"}

    title: bpy.props.StringProperty(
        name="Name",
        default="My Site",
        maxlen=60,
        description="Name of the preset in the menu",
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_props_dialog(self))

    def execute(self, context: bpy.types.Context) -> set[str]:
        group, stem = context.scene.icymoon, re.sub(r"\W+", "_", self.title.lower()).strip("_")
        stem += "_" if find_name_fault(stem) else ""  # such as con, the name of a device in Windows
        try:
            if not stem:
                raise IcyMoonError(f"The preset's name is {self.title!r}; give it a name with letters or digits.")
            settings = scene_properties.read_settings(group)
            wanted = make_paths_absolute(settings)
            wanted.pop("dataset")
            remove(find_own_folder() / f"{stem}{_PICTURE_SUFFIX}")  # the picture of an earlier preset of this name
            pictured = _save_picture(context, settings, find_own_folder() / f"{stem}{_PICTURE_SUFFIX}")
            write_text(
                find_own_folder() / f"{stem}.toml",
                preset_files.make_preset_text(
                    self.title, "A preset of yours", wanted, find_known_sources(wanted, group.preset)
                ),
            )
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        group.preset = f"{OWN}{stem}"
        without = "" if pictured else "; it gets its picture if you save it after Render Stereo Pair"
        self.report({"INFO"}, show_controls(f"Saved {find_own_folder() / stem}.toml{without}"))
        return {"FINISHED"}


class ICYMOON_OT_remove_preset(ExplainedOperator, bpy.types.Operator):
    """Delete your own preset that was loaded last. The settings stay as they are"""

    bl_idname = "icymoon.remove_preset"
    bl_label = "Remove Preset"
    bl_options = {"UNDO"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        own = context.scene.icymoon.preset in list_own_presets()
        return "" if own else "Load one of your own presets first; the presets of Icy Moon cannot be removed"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_confirm(self, event))

    def execute(self, context: bpy.types.Context) -> set[str]:
        group = context.scene.icymoon
        try:
            path = find_preset(group.preset)
            with explain_disk_errors("delete", path):
                remove(path)
                remove(path.with_suffix(_PICTURE_SUFFIX))
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        group.preset = ""
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_load_preset, ICYMOON_OT_add_preset, ICYMOON_OT_remove_preset)

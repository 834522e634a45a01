"""Show Stereo Pair: the camera images of the rendered pair and its true depth, in an Image Editor.

It needs no evaluator: a thread of Blender's own process reads and develops the pair in numpy, and the window does not
wait for it.

The picture is a file in a temporary folder, which one image data-block shows. If a script set the pixels of the image
instead, Blender would ask to save it at the end and would pack it into the .blend file.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ..formats.png import encode_png
from ..nodes.datablocks.fingerprint import TAG
from ..render.pairs.our_files import checked_id, folder_of_pair
from ..settings import change_announcements
from ..settings.blender import scene_properties
from ..settings.changes import response
from ..settings.topics.scene import typed
from ..stereo.pair_views import PairViews, read_pair_views
from ..support.errors import IcyMoonError, describe_error
from ..support.files import explain_disk_errors
from ..support.printer import show_controls
from ..support.scratch import make_scratch_folder
from ..support.system import remove_folder
from . import image_editor, live_preview, view_exposure
from .evaluate import rendered_pairs
from .jobs import push_undo, redraw
from .render import dataset_folder
from .sidebar_text import in_window, plain

VIEWS = (
    ("SIDE_BY_SIDE", "Side by Side", "Left image, right image and true depth"),
    ("LEFT", "Left", "The image of the left camera, pixel by pixel"),
    ("RIGHT", "Right", "The image of the right camera, pixel by pixel"),
    ("FLICKER", "Flicker", "Left and right in turn, aligned at the median depth. Nearer and farther ground moves"),
    ("ANAGLYPH", "Anaglyph", "For red and cyan glasses: the left image is red. Aligned at the median depth"),
    ("DEPTH", "True Depth", "The true depth in colours over the left image"),
)
NAME = "Icy Moon Pair"
ROLE = "pair picture"  # value of the custom property that marks the image
#: Seconds after the last change of a setting until the pair is developed again.
REST_S = 0.3
_INTERVAL_S, _FLICKER_S = 0.05, 1 / 3


@dataclass
class Shown:
    """The pair and the view that the picture shows."""

    folder: Path
    made_of: tuple[Any, ...]  # the sources of its development, see ``_made_of``
    views: PairViews
    view: str
    turn: int = 0  # which of a view's pictures


class _Reading(threading.Thread):
    """A pair that is being read and developed."""

    def __init__(self, folder: Path, camera_response: Mapping[str, Mapping[str, Any]]) -> None:
        super().__init__(name="Icy Moon pair")
        self.folder, self.made_of = folder, _made_of(folder, camera_response)
        self._response = camera_response
        self.views: PairViews | None = None
        self.error = ""

    def run(self) -> None:
        try:
            self.views = read_pair_views(self.folder, self._response)
        except Exception as error:
            self.error = describe_error(error, self.folder)


shown: Shown | None = None
_reading: _Reading | None = None  # the latest; the result of an earlier one is not used


def _made_of(folder: Path, camera_response: Mapping[str, Mapping[str, Any]]) -> tuple[Any, ...]:
    try:
        written_ns = (folder / "pair.json").stat().st_mtime_ns
    except OSError:
        written_ns = 0
    return folder, written_ns, camera_response


# ---- which pair -----------------------------------------------------------------------------------------------------


def kept_pairs(scene: bpy.types.Scene) -> list[Path]:
    """Existing folders of the pairs that were rendered last from a scene; none if the scene's ids are invalid."""
    try:
        folder = dataset_folder(typed({"dataset": {"folder": scene.icymoon.dataset.folder}}))
        found = [folder_of_pair(folder, checked_id(name, "The scene")) for name in scene.icymoon.pairs.split()]
    except IcyMoonError:
        return []
    return [path for path in found if (path / "pair.json").is_file()]


# ---- the image ------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _pictures_folder() -> Path:
    return make_scratch_folder()


def find_image() -> bpy.types.Image | None:
    """The image that shows pairs, if there is one."""
    return next((image for image in bpy.data.images if image.get(TAG) == ROLE and image.library is None), None)


def _load(image: bpy.types.Image, turn: int) -> None:
    """Load the file of this turn into the image."""
    image.filepath_raw = str(_pictures_folder() / f"picture_{turn}.png")
    image.reload()
    image.is_runtime_data = True  # Blender does not write it into the .blend file: its file is temporary
    for area in image_editor.showing(bpy.context, image):
        area.tag_redraw()


def _write(pictures: list[Any]) -> None:
    """Write the files of both turns, the same if the view has one picture: undo may restore the path of either."""
    for turn in (0, 1):
        path = _pictures_folder() / f"picture_{turn}.png"
        with explain_disk_errors("write", path):
            path.write_bytes(encode_png(pictures[turn % len(pictures)], 0))


def _show(context: bpy.types.Context, now: Shown, open_window: bool) -> None:
    """Show a view in an Image Editor, see ``image_editor.find_or_open``."""
    global shown
    _write(now.views.pictures(now.view))
    image = find_image()
    new = image is None
    if image is None:
        image = bpy.data.images.load(str(_pictures_folder() / "picture_0.png"))
        image.name, image[TAG] = NAME, ROLE
    size = tuple(image.size)
    _load(image, 0)
    shown = now
    areas = image_editor.showing(context, image)
    placed = None if areas else image_editor.find_or_open(context, open_window)
    if placed is not None:
        placed.spaces.active.image = image
        areas = [placed]
    for area in areas if placed is not None or size != tuple(image.size) else ():
        image_editor.fit(context, area)
    if new or placed is not None:
        push_undo("Show Stereo Pair")
    if now.view == "FLICKER" and areas and not bpy.app.timers.is_registered(_flicker):
        bpy.app.timers.register(_flicker, first_interval=_FLICKER_S)
    redraw()


def _flicker() -> float | None:
    """Show the other eye. The timer calls this until another view is chosen or no editor shows the image."""
    image = find_image()
    if shown is None or shown.view != "FLICKER" or image is None or not image_editor.showing(bpy.context, image):
        return None
    shown.turn = 1 - shown.turn
    _load(image, shown.turn)
    return _FLICKER_S


# ---- the operator ---------------------------------------------------------------------------------------------------


class ShowsPair:
    """Mix-in: an operator that shows a pair in an Image Editor. It reads and develops it in a thread."""

    #: One of VIEWS, and whether it is shown without being asked for: then in the view that is shown already.
    view: Any = VIEWS[0][0]
    automatic: Any = False
    _timer: Any = None
    _read: _Reading

    def find_folder(self, context: bpy.types.Context) -> Path:
        """The folder of the pair to show. Raises IcyMoonError if there is no such pair."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            if not self._show_known(context):
                self._read.start()
                self._read.join()
                self._take_up(context)
        except IcyMoonError as error:
            return self._fail(error)
        assert shown is not None
        self.report({"INFO"}, show_controls("; ".join(shown.views.lines)))  # type: ignore[attr-defined]
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        global _reading
        if bpy.app.background:
            return self.execute(context)
        try:
            if self._show_known(context):
                return {"FINISHED"}
        except IcyMoonError as error:
            return self._fail(error)
        _reading = self._read
        self._read.start()
        manager = context.window_manager
        self._timer = manager.event_timer_add(_INTERVAL_S, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type != "TIMER" or self._read.is_alive():
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        if self._read is not _reading:
            return {"CANCELLED"}
        try:
            self._take_up(context)
        except IcyMoonError as error:
            return self._fail(error)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the window closes or another file is opened."""
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)

    def _show_known(self, context: bpy.types.Context) -> bool:
        """Show the pair if it is already developed; otherwise prepare a thread that reads it, and return False."""
        if self.automatic and shown is not None:
            self.view = shown.view
        camera_response = response(scene_properties.read_settings(context.scene.icymoon))
        self._read = _Reading(self.find_folder(context), camera_response)
        if shown is None or shown.made_of != self._read.made_of:
            return False
        _show(context, Shown(shown.folder, shown.made_of, shown.views, self.view), self._opens_window(context))
        return True

    def _take_up(self, context: bpy.types.Context) -> None:
        if self._read.views is None:
            raise IcyMoonError(self._read.error)
        _show(
            context,
            Shown(self._read.folder, self._read.made_of, self._read.views, self.view),
            self._opens_window(context),
        )
        if self.automatic:
            view_exposure.measure(context.scene, self._read.folder, self._read.views.exposures_s)

    def _opens_window(self, context: bpy.types.Context) -> bool:
        """Whether to open a window: after a render only if the user's preference for renders allows it."""
        return not self.automatic or context.preferences.view.render_display_type != "NONE"

    def _fail(self, error: IcyMoonError) -> set[str]:
        self.report({"ERROR"}, in_window(error))  # type: ignore[attr-defined]
        return {"CANCELLED"}


class ICYMOON_OT_show_pair(ShowsPair, bpy.types.Operator):
    """Show the rendered pair in an Image Editor: the camera images and the true depth. Needs no evaluator"""

    bl_idname = "icymoon.show_pair"
    bl_label = "Show Stereo Pair"

    view: bpy.props.EnumProperty(
        name="View",
        items=VIEWS,
        default="SIDE_BY_SIDE",
        options={"SKIP_SAVE"},
        description="How to show it",
    )
    number: bpy.props.IntProperty(
        name="Pair",
        default=1,
        min=1,
        options={"SKIP_SAVE"},
        description="Which pair, if the scene has several headings",
    )
    automatic: bpy.props.BoolProperty(default=False, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        return next(text for name, _, text in VIEWS if name == properties.view)

    def find_folder(self, context: bpy.types.Context) -> Path:
        settings = scene_properties.read_settings(context.scene.icymoon)
        found = kept_pairs(context.scene) or rendered_pairs(context, settings)
        return found[min(self.number, len(found)) - 1]


# ---- what panels show -----------------------------------------------------------------------------------------------


def current(scene: bpy.types.Scene) -> Shown | None:
    """The pair and view that are shown; None if they are not of this scene."""
    return shown if shown is not None and shown.folder in kept_pairs(scene) else None


def lines(scene: bpy.types.Scene) -> list[str]:
    """Lines for the sidebar about the pair of a scene that is shown: id, exposure, depth and warnings."""
    now = current(scene)
    if now is None:
        return []
    return [plain(sentence) for sentence in (*now.views.lines, *now.views.warnings)]


# ---- following the settings -----------------------------------------------------------------------------------------


def listen(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Follow changes of the camera response."""
    if "response" not in effects or scene is None or not live_preview.has_window() or not scene.icymoon.follow:
        return
    if bpy.app.timers.is_registered(_follow):
        bpy.app.timers.unregister(_follow)
    bpy.app.timers.register(_follow, first_interval=REST_S)


def _follow() -> None:
    """Develop the pair that is shown with the present response."""
    image, windows = find_image(), bpy.context.window_manager.windows
    if shown is None or image is None or not image_editor.showing(bpy.context, image):
        return
    found = kept_pairs(windows[0].scene)
    if shown.folder in found:
        with bpy.context.temp_override(window=windows[0]):
            bpy.ops.icymoon.show_pair("INVOKE_DEFAULT", automatic=True, number=1 + found.index(shown.folder))


@bpy.app.handlers.persistent
def _forget(*_: object) -> None:
    """Stop the timers and forget the picture, before another file is opened or Icy Moon is disabled."""
    global shown, _reading
    shown = _reading = None
    for timer in (_flicker, _follow):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)


CLASSES = (ICYMOON_OT_show_pair,)


def register() -> None:
    """Follow the settings."""
    change_announcements.listeners.append(listen)
    bpy.app.handlers.load_pre.append(_forget)


def unregister() -> None:
    """Stop following the settings, and remove the pictures."""
    reading = _reading
    change_announcements.listeners.remove(listen)
    bpy.app.handlers.load_pre.remove(_forget)
    _forget()
    if reading is not None and reading.is_alive():
        reading.join()
    if _pictures_folder.cache_info().currsize:
        remove_folder(_pictures_folder())
        _pictures_folder.cache_clear()

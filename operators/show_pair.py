"""Show Stereo Pair: the camera images of the rendered pair and its true depth, in an Image Editor.

It needs no evaluator. A thread of Blender's own process reads and develops the pair in numpy and draws the picture, and
the window does not wait for it.

The picture is a file in a temporary folder, which one image data-block shows. If a script set the pixels of the image
instead, Blender would ask the user at the end to save the image, and would pack it into the .blend file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import bpy

from ..formats.png import encode_png
from ..nodes.datablocks.fingerprint import TAG
from ..render.pairs.dataset_file_names import check_id, folder_of_pair
from ..render.workers.watched_thread import Calculation
from ..settings.blender import scene_properties
from ..settings.rebuilt_parts import select_response
from ..stereo.pair_views import PairViews, read_pair_views
from ..support.files import explain_disk_errors
from ..support.printer import show_controls
from ..support.system import remove_folder
from ..support.temporary_folders import make_scratch_folder
from . import image_editor, last_variations, live_preview, view_exposure
from .camera_image_notes import AS_RECORDED
from .evaluate import find_rendered_pairs
from .job_operators import WatchingOperator
from .jobs import INTERVAL_S, Job
from .kept_pairs import find_kept_pairs
from .render import find_dataset_folder
from .session import ShownPair, session
from .sidebar_text import replace_keys_by_labels
from .window_areas import push_undo, redraw_panels
from .window_events import call_later, cancel_call, make_registration

VIEWS = (
    ("SIDE_BY_SIDE", "Side by Side", "Left image, right image and true depth"),
    ("LEFT", "Left", "The image of the left camera, pixel by pixel"),
    ("RIGHT", "Right", "The image of the right camera, pixel by pixel"),
    ("FLICKER", "Flicker", "Left and right in turn, aligned at the median depth. Nearer and farther ground moves"),
    ("ANAGLYPH", "Anaglyph", "For red and cyan glasses: the left image is red. Aligned at the median depth"),
    (
        "DEPTH",
        "True Depth",
        "The true depth in colours over the left image. They end at the nearest and farthest 1 % of the pixels",
    ),
)
NAME = "Icy Moon Pair"
ROLE = "pair picture"  # value of the custom property that marks the image
#: The line in place of the lines about a pair. It fills as much room.
_NO_PAIR = "No pair is rendered; the exposure, the depth and warnings of a pair will be here"
#: Seconds after the last change of a setting until the pair is developed again.
REST_S = 0.3
_FLICKER_S = 1 / 3
#: Maximum seconds by which a field that is dragged or typed in delays the window of a new pair.
_MAX_HELD_S = 60.0


def _describe_origin(folder: Path, camera_response: Mapping[str, Mapping[str, Any]]) -> tuple[Any, ...]:
    try:
        written_ns = (folder / "pair.json").stat().st_mtime_ns
    except OSError:
        written_ns = 0
    return folder, written_ns, camera_response


# ---- which pair -----------------------------------------------------------------------------------------------------


def find_pairs_to_show(scene: bpy.types.Scene) -> list[Path]:
    """Find the existing folders of the pairs, then of the variations, that were rendered last from a scene."""
    return list(dict.fromkeys([*find_kept_pairs(scene), *last_variations.find_pairs(scene)]))


# ---- the image ------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _find_pictures_folder() -> Path:
    return make_scratch_folder()


def find_image() -> bpy.types.Image | None:
    """Find the image that shows pairs; None without one."""
    return next((image for image in bpy.data.images if image.get(TAG) == ROLE and image.library is None), None)


def _get_image() -> bpy.types.Image:
    """Return the image that shows pairs; if it does not exist, load it from the written picture."""
    image = find_image()
    if image is None:
        image = bpy.data.images.load(str(_find_pictures_folder() / "picture_0.png"))
        image.name, image[TAG] = NAME, ROLE
        image.is_runtime_data = True
    return image


def _load_picture(image: bpy.types.Image, turn: int) -> None:
    """Load the picture file of a turn, 0 for the left and 1 for the right image, into the image."""
    image.filepath_raw = str(_find_pictures_folder() / f"picture_{turn}.png")
    image.reload()
    image.is_runtime_data = True  # Blender does not write it into the .blend file: its file is temporary
    for area in image_editor.find_editors_showing(image):
        area.tag_redraw()


def _draw(read: Callable[[], PairViews], view: str) -> tuple[PairViews, list[bytes]]:
    """Return the pair that ``read`` returns, and the PNG files of a view's pictures, one or two. Any thread may call
    this."""
    views = read()
    return views, [encode_png(picture, 0) for picture in views.pictures(view)]


def _write_pictures(files: Sequence[bytes]) -> None:
    """Write a view's one or two pictures to ``picture_0.png`` and ``picture_1.png``. A single picture goes to both
    files, since undo may restore either path."""
    for turn in (0, 1):
        path = _find_pictures_folder() / f"picture_{turn}.png"
        with explain_disk_errors("write", path):
            path.write_bytes(files[turn % len(files)])


def _show_view(now: ShownPair, files: Sequence[bytes], open_window: bool, raise_window: bool) -> None:
    """Show the ``files`` of a view in an Image Editor, see ``image_editor.show_in_editor``. With ``raise_window`` the
    window of an editor that already shows the image comes to the front."""
    _write_pictures(files)
    new = find_image() is None
    image = _get_image()
    size = tuple(image.size)
    _load_picture(image, 0)
    session.shown = now
    areas = image_editor.find_editors_showing(image)
    for area in areas if size != tuple(image.size) else ():
        image_editor.zoom_to_fit(area)
    placed = not areas and image_editor.show_in_editor(open_window, _show_in)
    if new and not placed:
        push_undo("Show Stereo Pair")
    if areas:
        _begin_flicker()
        if raise_window:
            image_editor.raise_window(areas[0])
    redraw_panels()


def _show_in(area: bpy.types.Area) -> None:
    """Show the image in an editor, as an undo step, unless the image was removed meanwhile."""
    image = find_image()
    if image is None:
        return
    area.spaces.active.image = image
    image_editor.zoom_to_fit(area)
    push_undo("Show Stereo Pair")
    _begin_flicker()
    redraw_panels()


def _note_areas() -> None:
    """Remember the areas that show the pair, before an undo or redo."""
    image = find_image()
    found = image_editor.find_editors_showing(image) if image is not None else []
    session.pair_areas = [area.as_pointer() for area in found] or session.pair_areas


def _return_picture() -> None:
    """Show the pair again in the areas that an undo has emptied, because the picture is no part of the user's work."""
    if session.shown is None:
        return
    for area in image_editor.find_empty_editors():
        if area.as_pointer() in session.pair_areas:
            area.spaces.active.image = _get_image()
            image_editor.zoom_to_fit(area)
    _begin_flicker()


def _begin_flicker() -> None:
    if session.shown is not None and session.shown.view == "FLICKER":
        call_later(_show_other_eye, _FLICKER_S)


def _show_other_eye() -> float | None:
    """Show the other eye. The timer calls this until another view is chosen or no editor shows the image."""
    image, shown = find_image(), session.shown
    if shown is None or shown.view != "FLICKER" or image is None or not image_editor.find_editors_showing(image):
        return None
    shown.turn = 1 - shown.turn
    _load_picture(image, shown.turn)
    return _FLICKER_S


# ---- the operator ---------------------------------------------------------------------------------------------------


class ShowsPair(WatchingOperator):
    """Mix-in: an operator that reads and develops a pair in a thread, and shows it in an Image Editor."""

    #: One of VIEWS; and whether the pair is shown without a request by the user, and then in the present view.
    view: str = VIEWS[0][0]
    automatic: bool = False
    _is_new = False  # whether the pair is read, not only drawn

    def find_folder(self, context: bpy.types.Context) -> Path:
        """Return the folder of the pair to show. Raises IcyMoonError if there is no such pair."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        result = super().execute(context)
        if result == {"FINISHED"} and session.shown is not None:
            views = session.shown.views
            self.report({"INFO"}, show_controls("; ".join([f"Pair {views.id}", *views.lines])))
        return result

    def start(self, context: bpy.types.Context) -> Job:
        """Read the pair, unless it is developed already, and draw the view. A reading that still runs is cancelled."""
        if self.automatic and session.shown is not None:
            self.view = session.shown.view
        camera_response = select_response(scene_properties.read_settings(context.scene.icymoon))
        folder = self.find_folder(context)
        self._folder, self._made_of = folder, _describe_origin(folder, camera_response)
        shown = session.shown
        read: Callable[[], PairViews] = partial(read_pair_views, folder, camera_response)
        self._is_new = shown is None or shown.made_of != self._made_of
        if shown is not None and not self._is_new:
            read = partial(getattr, shown, "views")
        if session.reading is not None:
            session.reading.cancel()
        session.reading = Job("Show Stereo Pair", Calculation(partial(_draw, read, self.view), folder))
        return session.reading

    def report_success(self, context: bpy.types.Context) -> None:
        """Show the pair. If it was just read, set the view's exposure by the pair."""
        assert self._job is not None
        session.reading = None
        views, files = self._job.result["value"]
        found = ShownPair(self._folder, self._made_of, views, self.view)
        _show_view(found, files, self._opens_window(context), raise_window=not self.automatic)
        if self._is_new and self.automatic:
            view_exposure.expose_as_rendered(context.scene, self._folder, views.exposures_s)

    def look(self, context: bpy.types.Context) -> bool:
        """Check the job. A window that the user has not asked for waits until a held field is left, since it would take
        the field from under the mouse."""
        if super().look(context):
            return True
        held = self.automatic and session.pressed_s is not None
        return held and time.monotonic() - (session.pressed_s or 0.0) < _MAX_HELD_S

    def _opens_window(self, context: bpy.types.Context) -> bool:
        """Return whether to open a window. After a render this needs the permission of the user's preference for
        renders."""
        return not self.automatic or context.preferences.view.render_display_type != "NONE"


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
        description="Which pair, if the scene has several headings or variations",
    )
    automatic: bpy.props.BoolProperty(default=False, options={"HIDDEN", "SKIP_SAVE"})
    id: bpy.props.StringProperty(
        name="Id", description="Id of the pair in the data set folder, instead of its number", options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        if properties.id:
            return f"Show pair {properties.id} in an Image Editor"
        return next(text for name, _, text in VIEWS if name == properties.view)

    def find_folder(self, context: bpy.types.Context) -> Path:
        settings = scene_properties.read_settings(context.scene.icymoon)
        if self.id:
            return folder_of_pair(find_dataset_folder(settings), check_id(self.id, "The button"))
        found = find_pairs_to_show(context.scene) or find_rendered_pairs(context, settings)
        return found[min(self.number, len(found)) - 1]


# ---- shown in panels ------------------------------------------------------------------------------------------------


def find_shown_pair(scene: bpy.types.Scene) -> ShownPair | None:
    """Return the shown pair and view; None if they belong to another scene."""
    now = session.shown
    return now if now is not None and now.folder in find_pairs_to_show(scene) else None


def list_lines(scene: bpy.types.Scene) -> list[str]:
    """List lines for the sidebar on the shown pair of a scene: exposure, depth and warnings. If no pair is shown, give
    the reason."""
    now = find_shown_pair(scene)
    if now is None:
        return [_explain_why_not_shown(scene)]
    return [replace_keys_by_labels(sentence) for sentence in (*now.views.lines, *now.views.warnings)]


def describe_picture(scene: bpy.types.Scene) -> str:
    """Describe the pair of a scene that the picture shows in a line that a narrow header cuts at its end; empty without
    one. The view is left out, because its pressed button names it."""
    now = find_shown_pair(scene)
    if now is None:
        return ""
    pairs = find_pairs_to_show(scene)
    which = [f"Pair {1 + pairs.index(now.folder)} of {len(pairs)}"] if len(pairs) > 1 else []
    return "; ".join([*which, *now.views.lines, AS_RECORDED, f"id {now.views.id}"])


def _explain_why_not_shown(scene: bpy.types.Scene) -> str:
    if find_pairs_to_show(scene):
        return "The pair is not shown; the buttons above show it"
    # The scene knows its pair although the folder has changed or its files are gone.
    return "The pair is not in Data Set ▸ Folder" if scene.icymoon.pairs else _NO_PAIR


# ---- following the settings -----------------------------------------------------------------------------------------


def follow_response(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Schedule the development of the shown pair after a change of the camera response."""
    if "response" not in effects or scene is None or not live_preview.has_window() or not scene.icymoon.follow:
        return
    cancel_call(_develop_shown_pair)
    call_later(_develop_shown_pair, REST_S)


def _develop_shown_pair() -> None:
    """Develop the shown pair with the present response."""
    image, shown, windows = find_image(), session.shown, bpy.context.window_manager.windows
    if shown is None or image is None or not image_editor.find_editors_showing(image):
        return
    found = find_pairs_to_show(windows[0].scene)
    if shown.folder in found:
        with bpy.context.temp_override(window=windows[0]):
            bpy.ops.icymoon.show_pair("INVOKE_DEFAULT", automatic=True, number=1 + found.index(shown.folder))


CLASSES = (ICYMOON_OT_show_pair,)


def _remove_pictures() -> None:
    """Remove the files of the pictures, after a running thread has ended."""
    while session.reading is not None and session.reading.poll():
        time.sleep(INTERVAL_S)
    if _find_pictures_folder.cache_info().currsize:
        remove_folder(_find_pictures_folder())
        _find_pictures_folder.cache_clear()


register, unregister = make_registration(
    follow_response,
    timers=(_show_other_eye, _develop_shown_pair, _return_picture),
    end=_remove_pictures,
    undo_pre=_note_areas,
    redo_pre=_note_areas,
    undo_post=lambda: call_later(_return_picture),
    redo_post=lambda: call_later(_return_picture),
)

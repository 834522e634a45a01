"""Show Stereo Pair: the picture is what the cameras give, in one image that leaves no trace in the user's file."""

from __future__ import annotations

import shutil
import subprocess
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from evaluations import PAIR, evaluated
from icymoon.operators import dataset, image_editor, job_operators, kept_pairs, live_preview, results, show_pair
from icymoon.operators.session import session
from icymoon.panels import pair_views, sidebar
from icymoon.stereo.pair_views import read_pair_views
from icymoon.support.arrays import Array
from numpy.testing import assert_array_equal  # its import starts a process, which a test forbids
from pairs import write_pair
from panel_drawing import Layout, drawn, texts
from thread_asks import list_asks_of_threads


@pytest.fixture
def rendered(small):
    """A scene whose pair is rendered."""
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    yield small
    session.reset()


@pytest.fixture
def editor(monkeypatch):
    """An Image Editor that shows the image, as in a window; there is none here."""
    areas = [SimpleNamespace(tag_redraw=lambda: None)]
    monkeypatch.setattr(image_editor, "find_editors_showing", lambda image: areas)
    monkeypatch.setattr(image_editor, "zoom_to_fit", lambda area: None)
    return areas


class Area(SimpleNamespace):
    """An Image Editor, in a place in memory."""

    def __init__(self, address):
        super().__init__(address=address, spaces=SimpleNamespace(active=SimpleNamespace(image=None)))

    def as_pointer(self):
        return self.address

    def tag_redraw(self):
        pass


def test_undo_leaves_the_pair_in_the_editors_that_showed_it(rendered, monkeypatch):
    shows, other = Area(1), Area(2)
    bpy.ops.icymoon.show_pair(view="LEFT")
    monkeypatch.setattr(image_editor, "list_areas", lambda kind: [(None, shows), (None, other)])
    monkeypatch.setattr(image_editor, "zoom_to_fit", lambda area: None)
    shows.spaces.active.image = show_pair.find_image()
    picture = pixels()
    show_pair._note_areas()
    bpy.data.images.remove(show_pair.find_image())  # as an undo to before it was shown does
    shows.spaces.active.image = None
    show_pair._note_areas()  # before a second undo
    show_pair._return_picture()
    assert shows.spaces.active.image == show_pair.find_image()
    assert_array_equal(pixels(), picture)
    assert other.spaces.active.image is None  # the user's own


def test_the_window_of_a_new_pair_waits_for_the_field_that_is_held(rendered, monkeypatch):
    operator = show_pair.ShowsPair()
    ended: Any = SimpleNamespace(poll=lambda: False)
    operator.automatic, operator._job = True, ended
    look = partial(operator.look, bpy.context)
    job_operators._notice_button(SimpleNamespace(type="LEFTMOUSE", value="PRESS"))
    assert look()
    operator.automatic = False  # the user has asked for it
    assert not look()
    operator.automatic = True
    job_operators._notice_button(SimpleNamespace(type="MOUSEMOVE", value="NOTHING"))
    assert not look()
    job_operators._notice_button(SimpleNamespace(type="LEFTMOUSE", value="PRESS"))
    monkeypatch.setattr(session, "pressed_s", session.pressed_s - 61.0)
    assert not look()
    job_operators._notice_button(SimpleNamespace(type="LEFTMOUSE", value="RELEASE"))
    assert session.pressed_s is None


def pixels() -> Array:
    """What the image shows, uint8 RGB (H, W, 3), the top row first."""
    image = show_pair.find_image()
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return np.rint(255 * values.reshape(image.size[1], image.size[0], -1)[::-1, :, :3]).astype(np.uint8)


def views_of(scene):
    """What there is to show of a scene's pair, read anew."""
    (folder,) = kept_pairs.find_kept_pairs(scene)
    return read_pair_views(folder, {})


@pytest.mark.long
@pytest.mark.parametrize("view", [name for name, *_ in show_pair.VIEWS])
def test_the_image_is_the_picture_of_the_view(rendered, view):
    assert bpy.ops.icymoon.show_pair(view=view) == {"FINISHED"}
    picture = views_of(rendered).pictures(view)[0]
    assert_array_equal(pixels(), picture)
    assert picture[:, :, 0].std() > 5


def test_the_last_pair_of_a_data_set_is_shown_without_another_process(rendered, monkeypatch):
    (folder,) = kept_pairs.find_kept_pairs(rendered)
    picture = views_of(rendered).pictures("SIDE_BY_SIDE")[0]
    rendered.icymoon.pairs = ""  # it is none of the scene's
    rendered.icymoon.dataset.folder = "/nowhere"
    monkeypatch.setattr(subprocess, "Popen", None)
    monkeypatch.setitem(dataset.readout, "last", folder)
    assert bpy.ops.icymoon.show_last_pair() == {"FINISHED"}
    assert_array_equal(pixels(), picture)
    monkeypatch.setitem(dataset.readout, "last", folder / "gone")
    with pytest.raises(RuntimeError, match="no longer exists; render the data set again"):
        bpy.ops.icymoon.show_last_pair()


def test_there_is_one_image_that_blender_never_asks_to_save_nor_writes(rendered, tmp_path):
    before = len(bpy.data.images)
    for view in ("SIDE_BY_SIDE", "ANAGLYPH", "FLICKER", "LEFT", "SIDE_BY_SIDE"):
        bpy.ops.icymoon.show_pair(view=view)
    assert len(bpy.data.images) == before + 1
    image = show_pair.find_image()
    assert (image.is_dirty, image.packed_file, image.source) == (False, None, "FILE")
    image.use_fake_user = True  # as if an Image Editor showed it
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), copy=True)
    with bpy.data.libraries.load(str(tmp_path / "a.blend")) as (there, _):
        assert show_pair.NAME not in there.images
        assert there.scenes


def test_a_pair_is_read_once_and_again_when_the_response_or_the_pair_changes(rendered, monkeypatch):
    read = []
    monkeypatch.setattr(
        show_pair, "read_pair_views", lambda folder, response: read.append(folder) or read_pair_views(folder, response)
    )
    for view in ("SIDE_BY_SIDE", "LEFT", "DEPTH"):
        bpy.ops.icymoon.show_pair(view=view)
    assert len(read) == 1
    bpy.ops.icymoon.show_pair(view="LEFT")
    before = pixels().mean()
    rendered.icymoon.sensor.auto_target = 0.1
    bpy.ops.icymoon.show_pair(view="LEFT")
    assert pixels().mean() < 0.4 * before
    bpy.ops.icymoon.render_pair(again=True)
    bpy.ops.icymoon.show_pair(view="LEFT")
    assert len(read) == 3


def test_threads_draw_every_view_and_ask_blender_nothing(rendered, monkeypatch):
    """To draw and encode a view takes 0.1 s, in which the window must stay usable."""
    threads, encode, asked = list[bool](), show_pair.encode_png, list_asks_of_threads(monkeypatch)
    monkeypatch.setattr(
        show_pair,
        "encode_png",
        lambda *of: threads.append(threading.current_thread() is not threading.main_thread()) or encode(*of),
    )
    for view in ("SIDE_BY_SIDE", "DEPTH"):  # the second of a pair that was read already
        bpy.ops.icymoon.show_pair(view=view)
    assert threads == [True, True]
    assert asked == []


def test_the_pair_stays_with_the_scene(rendered, tmp_path):
    (folder,) = kept_pairs.find_kept_pairs(rendered)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert kept_pairs.find_kept_pairs(bpy.context.scene) == []
    assert session.shown is None
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert kept_pairs.find_kept_pairs(bpy.context.scene) == [folder]
    assert bpy.ops.icymoon.show_pair() == {"FINISHED"}


@pytest.mark.parametrize("text", ["", "../../etc", "/etc/passwd", "0123456789ab", "x" * 10_000, "0123456789ab ../.."])
def test_what_a_file_names_leads_nowhere(scene, tmp_path, text):
    scene.icymoon.dataset.folder, scene.icymoon.pairs = str(tmp_path), text
    assert kept_pairs.find_kept_pairs(scene) == []
    assert "icymoon.show_pair" not in texts(drawn(sidebar.ICYMOON_PT_main))


def test_what_cannot_be_shown_is_one_sentence(rendered):
    (folder,) = kept_pairs.find_kept_pairs(rendered)
    left = folder / "left.exr"
    content = left.read_bytes()
    left.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(RuntimeError, match=r"left\.exr is not the file that was rendered.*render the pair again"):
        bpy.ops.icymoon.show_pair()
    shutil.rmtree(folder)
    with pytest.raises(RuntimeError, match=r"no rendered pair in .*; press Render Stereo Pair first"):
        bpy.ops.icymoon.show_pair()
    assert show_pair.find_image() is None
    assert session.shown is None


def turns() -> int:
    """How often the timer of the flicker shows another eye before it ends, at most five times."""
    for k in range(5):
        if show_pair._show_other_eye() is None:
            return k
    return 5


def test_flicker_shows_the_eyes_by_turns(rendered, editor):
    bpy.ops.icymoon.show_pair(view="FLICKER")
    assert bpy.app.timers.is_registered(show_pair._show_other_eye)
    eyes = views_of(rendered).pictures("FLICKER")
    for k in (1, 0, 1):
        assert show_pair._show_other_eye() == pytest.approx(1 / 3)
        assert_array_equal(pixels(), eyes[k])
    assert not show_pair.find_image().is_dirty
    bpy.ops.icymoon.show_pair(view="FLICKER")
    assert turns() == 5


def test_flicker_ends_with_its_view_its_image_its_editor_and_its_file(rendered, editor):
    bpy.ops.icymoon.show_pair(view="FLICKER")
    bpy.ops.icymoon.show_pair(view="LEFT")
    assert turns() == 0
    bpy.ops.icymoon.show_pair(view="FLICKER")
    shown = editor.pop()
    assert turns() == 0
    editor.append(shown)
    bpy.data.images.remove(show_pair.find_image())
    assert turns() == 0
    bpy.ops.icymoon.show_pair(view="FLICKER")
    assert bpy.app.timers.is_registered(show_pair._show_other_eye)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not bpy.app.timers.is_registered(show_pair._show_other_eye)


def test_undo_cannot_bring_the_flicker_back(rendered, editor):
    """It may bring back the path of either file: both are of the view that is shown."""
    bpy.ops.icymoon.show_pair(view="FLICKER")
    show_pair._show_other_eye()
    bpy.ops.icymoon.show_pair(view="ANAGLYPH")
    image = show_pair.find_image()
    wanted = pixels()
    image.filepath_raw = image.filepath_raw.replace("picture_0", "picture_1")
    image.reload()
    assert_array_equal(pixels(), wanted)


def test_the_sidebar_and_the_header_show_the_views_where_there_is_a_pair(small, tmp_path):
    assert "icymoon.show_pair" not in texts(drawn(sidebar.ICYMOON_PT_main))
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    labels = [entry[2] for entry in drawn(sidebar.ICYMOON_PT_main) if entry[1] == "icymoon.show_pair"]
    assert labels == [label for _, label, _ in show_pair.VIEWS]
    (folder,) = kept_pairs.find_kept_pairs(small)
    assert folder.name not in texts(drawn(sidebar.ICYMOON_PT_main))
    bpy.ops.icymoon.show_pair()
    said = texts(drawn(sidebar.ICYMOON_PT_main))
    assert all(line in said for line in views_of(small).lines)
    header = SimpleNamespace(layout=Layout())
    for image, there in ((None, False), (bpy.data.images.new("Other", 4, 4), False), (show_pair.find_image(), True)):
        pair_views._draw_header(header, SimpleNamespace(scene=small, space_data=SimpleNamespace(image=image)))
        assert ("icymoon.show_pair" in texts(header.layout.record)) == there
    other = bpy.data.scenes.new("Other")
    assert show_pair.find_shown_pair(other) is None


def test_every_pair_of_several_headings_can_be_shown(small):
    small.icymoon.dataset.headings = 2
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    folders = kept_pairs.find_kept_pairs(small)
    assert len(set(folders)) == 2
    for number, folder in enumerate(folders, 1):
        bpy.ops.icymoon.show_pair(number=number)
        assert session.shown.folder == folder
        assert f"Pair {number} of 2" in texts(drawn(sidebar.ICYMOON_PT_main))
    session.reset()


def test_the_picture_follows_the_response_where_it_is_shown(rendered, editor, monkeypatch):
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    rendered.icymoon.sensor.auto_target = 0.5
    assert bpy.app.timers.is_registered(show_pair._develop_shown_pair)
    show_pair._develop_shown_pair()  # nothing is shown yet
    assert session.shown is None
    bpy.ops.icymoon.show_pair(view="RIGHT")
    bright = pixels().mean()
    rendered.icymoon.sensor.auto_target = 0.1
    show_pair._develop_shown_pair()
    assert pixels().mean() < 0.4 * bright
    now = show_pair.find_shown_pair(rendered)
    assert now is not None
    assert now.view == "RIGHT"
    rendered.icymoon.follow = False
    bpy.app.timers.unregister(show_pair._develop_shown_pair)
    rendered.icymoon.sensor.auto_target = 0.3
    assert not bpy.app.timers.is_registered(show_pair._develop_shown_pair)


def test_pictures_are_gone_with_icy_moon(rendered, monkeypatch):
    bpy.ops.icymoon.show_pair()
    folder = show_pair._find_pictures_folder()
    assert {path.name for path in folder.glob("*.png")} == {"picture_0.png", "picture_1.png"}
    show_pair.unregister()
    try:
        assert not folder.exists()
    finally:
        show_pair.register()


@pytest.mark.parametrize(
    ("preference", "automatic", "opens"),
    [("WINDOW", True, True), ("AREA", True, True), ("NONE", True, False), ("NONE", False, True)],
)
def test_a_render_opens_a_window_where_the_user_wants_it(rendered, monkeypatch, preference, automatic, opens):
    asked = []
    monkeypatch.setattr(image_editor, "show_in_editor", lambda open_window, show: asked.append(open_window))
    monkeypatch.setattr(bpy.context.preferences.view, "render_display_type", preference)
    assert bpy.ops.icymoon.show_pair(automatic=automatic) == {"FINISHED"}
    assert asked == [opens]


def test_a_pair_whose_files_are_elsewhere_is_not_said_to_be_unrendered(scene, tmp_path):
    """The results below it tell of the pair that was rendered last."""
    scene.icymoon.dataset.folder = str(tmp_path)
    assert show_pair.list_lines(scene) == [show_pair._NO_PAIR]
    evaluated(scene, tmp_path)
    assert results.list_notes(scene)[0].startswith("Of an earlier pair;")
    scene.icymoon.pairs = PAIR
    assert results.list_notes(scene)[0].startswith("Of the pair rendered last;")
    assert show_pair.list_lines(scene) == ["The pair is not in Data Set ▸ Folder"]
    write_pair(tmp_path / "pairs" / PAIR)
    assert show_pair.list_lines(scene) == ["The pair is not shown; the buttons above show it"]


def test_the_header_names_the_pair_its_facts_and_how_it_is_shown(rendered):
    (folder,) = kept_pairs.find_kept_pairs(rendered)
    assert show_pair.describe_picture(rendered) == ""
    for view in ("RIGHT", "DEPTH"):
        bpy.ops.icymoon.show_pair(view=view)
        space = SimpleNamespace(image=show_pair.find_image())
        header = SimpleNamespace(layout=Layout())
        pair_views._draw_header(header, SimpleNamespace(scene=rendered, space_data=space))
        told = texts(header.layout.record)
        assert f"{session.shown.views.lines[0]}; " in told
        assert f"as recorded, not stretched; id {folder.name}" in told

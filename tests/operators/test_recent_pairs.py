"""The list of recent pairs: which are in it, in which order, their pictures, and a click on one."""

from __future__ import annotations

import os
import shutil
import time

import bpy
import pytest
from icymoon.operators import recent_pairs, show_pair
from icymoon.operators.session import session
from icymoon.stereo.pair_views import read_pair_views
from pairs import write_pair
from panel_drawing import drawn

NAMES = ("0123456789ab", "aaaaaaaaaaaa", "bbbbbbbbbbbb")


@pytest.fixture
def dataset(scene, tmp_path):
    """A data set of three pairs; the second is the newest, and the third has lost its images."""
    first = write_pair(tmp_path / "pairs" / NAMES[0])
    for name in NAMES[1:]:
        shutil.copytree(first, tmp_path / "pairs" / name)
    (tmp_path / "pairs" / NAMES[2] / "left.exr").unlink()
    (tmp_path / "pairs" / "cccccccccccc").mkdir()  # not complete
    for name, written_s in zip(NAMES, (1e9, 3e9, 2e9), strict=True):
        os.utime(tmp_path / "pairs" / name / "pair.json", (written_s, written_s))
    scene.icymoon.dataset.folder = str(tmp_path)
    yield tmp_path
    recent_pairs.unregister()
    session.reset()


def make_all() -> None:
    end = time.monotonic() + 60
    while recent_pairs.make_next() is not None:
        assert time.monotonic() < end
        time.sleep(0.01)


def test_the_newest_is_first_and_each_readable_pair_gets_a_picture(scene, dataset):
    found = recent_pairs.list_recent(scene)
    assert [pair.id for pair in found] == [NAMES[1], NAMES[2], NAMES[0]]
    assert found[-1].title == time.strftime("%d %b %Y, %H:%M", time.localtime(1e9))
    assert [recent_pairs.find_icon(pair) for pair in found] == [None] * 3
    make_all()
    assert [recent_pairs.find_icon(pair) is None for pair in found] == [False, True, False]  # 0 without a window
    assert recent_pairs.make_next() is None  # the damaged one is not read again
    described = [recent_pairs.find_description(pair) for pair in found]
    assert described[1] == ""
    views = read_pair_views(found[0].folder, {}, recent_pairs.SIDE_PX)
    assert described[0] == views.about
    side = recent_pairs._pictures.collection[recent_pairs._make_key(found[0])].image_size
    assert max(side) <= recent_pairs.SIDE_PX


def test_a_redraw_while_a_picture_is_made_asks_for_no_second_one(scene, dataset):
    newest = recent_pairs.list_recent(scene)[0]
    recent_pairs.find_icon(newest)
    assert recent_pairs.make_next() is not None
    assert recent_pairs.find_icon(newest) is None
    assert recent_pairs._PictureQueue.waiting == ()
    make_all()
    assert recent_pairs.find_icon(newest) is not None


def test_the_panel_has_a_button_for_each_and_a_click_shows_it(scene, dataset, monkeypatch):
    record = drawn(bpy.types.ICYMOON_PT_recent)
    assert len([entry for entry in record if entry[:2] == ("operator", "icymoon.show_pair")]) == len(NAMES)
    assert bpy.ops.icymoon.show_pair(id=NAMES[0]) == {"FINISHED"}
    assert session.shown.folder == dataset / "pairs" / NAMES[0]
    assert show_pair.find_kept_pairs(scene) == []
    with pytest.raises(RuntimeError, match="12 of the digits"):
        bpy.ops.icymoon.show_pair(id="../../../etc")


def test_without_pairs_there_is_no_panel(scene, tmp_path):
    scene.icymoon.dataset.folder = str(tmp_path)
    assert recent_pairs.list_recent(scene) == ()
    assert drawn(bpy.types.ICYMOON_PT_recent) == []

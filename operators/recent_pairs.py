"""The pairs of the data set folder that were rendered last, with small pictures that a thread makes one by one."""

from __future__ import annotations

import heapq
import os
import time
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ..render.pairs.dataset_file_names import is_pair_id, pairs_folder
from ..render.workers.watched_thread import Calculation
from ..settings.topics.scene import typed
from ..stereo.pair_views import PairViews, read_pair_views
from ..support.errors import IcyMoonError
from . import jobs
from .render import find_dataset_folder
from .window_areas import ButtonPictures, redraw_panels
from .window_events import call_later, cancel_call

#: Maximum numbers of pairs in the list, of columns or rows of a picture, and of kept pictures.
MAX_PAIRS, SIDE_PX, _MAX_PICTURES = 8, 128, 64
#: Seconds after which even an unchanged folder is read again, because a pair may be rendered anew in its place.
_REREAD_S = 5.0
_pictures = ButtonPictures()
#: Descriptions of the pairs with pictures, by the key of the picture.
_about: dict[str, str] = {}


class RecentPair(NamedTuple):
    """A pair of a data set, and the time at which its ``pair.json`` was written, in ns."""

    folder: Path
    written_ns: int

    @property
    def id(self) -> str:
        """The pair's id."""
        return self.folder.name

    @property
    def title(self) -> str:
        """The time of the render, with its date unless it was today."""
        written, now = time.localtime(self.written_ns / 1e9), time.localtime()
        return time.strftime("%H:%M:%S" if written[:3] == now[:3] else "%d %b %Y, %H:%M", written)


class _PictureQueue:
    """The pair whose picture is being made, the pairs that wait, and the pairs that cannot be read."""

    job: jobs.Job | None = None
    pair: RecentPair | None = None
    waiting: tuple[RecentPair, ...] = ()
    failed: frozenset[RecentPair] = frozenset()


def list_recent(scene: bpy.types.Scene) -> tuple[RecentPair, ...]:
    """List the pairs of a scene's data set folder that were written last, newest first; empty without a folder."""
    try:
        dataset = find_dataset_folder(typed({"dataset": {"folder": scene.icymoon.dataset.folder}}))
        changed_ns = pairs_folder(dataset).stat().st_mtime_ns
    except (IcyMoonError, OSError):
        return ()
    return _read_recent(pairs_folder(dataset), changed_ns, int(time.monotonic() / _REREAD_S))


@lru_cache(maxsize=4)
def _read_recent(folder: Path, changed_ns: int, period: int) -> tuple[RecentPair, ...]:
    """Read ``list_recent`` from a folder of pairs. The answer is kept for a while, because the window asks at every
    redraw."""
    found = []
    with os.scandir(folder) as entries:
        for entry in entries:
            if not is_pair_id(entry.name):
                continue
            try:
                found.append((os.stat(os.path.join(entry.path, "pair.json")).st_mtime_ns, entry.name))
            except OSError:  # not complete
                continue
    return tuple(RecentPair(folder / name, written_ns) for written_ns, name in heapq.nlargest(MAX_PAIRS, found))


def find_icon(pair: RecentPair) -> int | None:
    """Return the icon of a pair's picture (0 without a window), or None until it is made. A pair without a picture is
    queued."""
    shown = _pictures.collection.get(_make_key(pair))
    if shown is not None:
        return int(shown.icon_id)
    if pair not in _PictureQueue.failed and pair not in _PictureQueue.waiting and pair != _PictureQueue.pair:
        _PictureQueue.waiting = (*_PictureQueue.waiting, pair)
    if not bpy.app.background:
        call_later(make_next)
    return None


def find_description(pair: RecentPair) -> str:
    """Describe the Sun and the image size of a pair, which tell it from others; empty until its picture is made."""
    return _about.get(_make_key(pair), "")


def _make_key(pair: RecentPair) -> str:
    return f"{pair.folder} {pair.written_ns}"


def make_next() -> float | None:
    """Make the picture of the next waiting pair in a thread. Returns the seconds until the next call, None if no pair
    waits."""
    if _PictureQueue.job is not None and _PictureQueue.pair is not None:
        if _PictureQueue.job.poll():
            return jobs.INTERVAL_S
        _keep_picture(_PictureQueue.pair, _PictureQueue.job)
        _PictureQueue.job = _PictureQueue.pair = None
        redraw_panels()
    if not _PictureQueue.waiting:
        return None
    pair, *rest = _PictureQueue.waiting
    _PictureQueue.pair, _PictureQueue.waiting = pair, tuple(rest)
    _PictureQueue.job = jobs.Job("Picture", Calculation(lambda: read_pair_views(pair.folder, {}, SIDE_PX), pair.folder))
    return jobs.INTERVAL_S


def _keep_picture(pair: RecentPair, job: jobs.Job) -> None:
    """Keep the left image of a pair that was read, or note that the pair cannot be read."""
    if job.failure:
        _PictureQueue.failed |= {pair}
        return
    if len(_pictures.collection) >= _MAX_PICTURES:
        _pictures.collection.clear()
        _about.clear()
    views: PairViews = job.result["value"]
    _about[_make_key(pair)] = views.about
    picture = views.shown_left
    shown = _pictures.collection.new(_make_key(pair))
    shown.image_size = picture.shape[1::-1]
    rgba = np.ones((*picture.shape[:2], 4), np.float32)
    rgba[..., :3] = picture[::-1] / np.float32(255)
    shown.image_pixels_float.foreach_set(rgba.ravel())


def register() -> None:
    """Do nothing, because pictures are made only on request."""


def unregister() -> None:
    """Stop making pictures, and remove the existing ones."""
    cancel_call(make_next)
    if _PictureQueue.job is not None:
        _PictureQueue.job.close()
    _PictureQueue.job = _PictureQueue.pair = None
    _PictureQueue.waiting, _PictureQueue.failed = (), frozenset()
    _pictures.remove()
    _about.clear()

"""The pairs of the data set folder that were rendered last, with small pictures that a thread makes in turn."""

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

#: Maximum number of pairs in the list, of columns or rows of a picture, and of pictures that are kept.
MAX_PAIRS, SIDE_PX, _MAX_PICTURES = 8, 128, 64
#: Seconds after which the folder is read again although it has not changed: a pair may be rendered anew in its place.
_REREAD_S = 5.0
_pictures = ButtonPictures()
#: What tells a pair with a picture from others, by the key of the picture.
_about: dict[str, str] = {}


class RecentPair(NamedTuple):
    """A pair of a data set, and when its ``pair.json`` was written, ns."""

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
    """The pair whose picture is being made, the pairs that wait for one, and the pairs that cannot have one."""

    job: jobs.Job | None = None
    pair: RecentPair | None = None
    waiting: tuple[RecentPair, ...] = ()
    failed: frozenset[RecentPair] = frozenset()


def list_recent(scene: bpy.types.Scene) -> tuple[RecentPair, ...]:
    """The pairs of a scene's data set folder that were written last, the newest first; none without a folder."""
    try:
        dataset = find_dataset_folder(typed({"dataset": {"folder": scene.icymoon.dataset.folder}}))
        changed_ns = pairs_folder(dataset).stat().st_mtime_ns
    except (IcyMoonError, OSError):
        return ()
    return _read_recent(pairs_folder(dataset), changed_ns, int(time.monotonic() / _REREAD_S))


@lru_cache(maxsize=4)
def _read_recent(folder: Path, changed_ns: int, period: int) -> tuple[RecentPair, ...]:
    """``list_recent`` of a folder of pairs. The window asks at every redraw, so the answer is kept for a while."""
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
    """The icon of a pair's picture (0 without a window); None until it is made. A pair without a picture is queued."""
    shown = _pictures.collection.get(_make_key(pair))
    if shown is not None:
        return int(shown.icon_id)
    if pair not in _PictureQueue.failed and pair not in _PictureQueue.waiting and pair != _PictureQueue.pair:
        _PictureQueue.waiting = (*_PictureQueue.waiting, pair)
    if not bpy.app.background:
        call_later(make_next)
    return None


def find_description(pair: RecentPair) -> str:
    """What tells a pair from others: its Sun and the size of its images; empty until its picture is made."""
    return _about.get(_make_key(pair), "")


def _make_key(pair: RecentPair) -> str:
    return f"{pair.folder} {pair.written_ns}"


def make_next() -> float | None:
    """Make the picture of the next pair that waits, in a thread; seconds until the next look, None if none waits."""
    if _PictureQueue.job is not None and _PictureQueue.pair is not None:
        if _PictureQueue.job.poll():
            return jobs.INTERVAL_S
        _keep(_PictureQueue.pair, _PictureQueue.job)
        _PictureQueue.job = _PictureQueue.pair = None
        redraw_panels()
    if not _PictureQueue.waiting:
        return None
    pair, *rest = _PictureQueue.waiting
    _PictureQueue.pair, _PictureQueue.waiting = pair, tuple(rest)
    _PictureQueue.job = jobs.Job("Picture", Calculation(lambda: read_pair_views(pair.folder, {}, SIDE_PX), pair.folder))
    return jobs.INTERVAL_S


def _keep(pair: RecentPair, job: jobs.Job) -> None:
    """Keep the left image of a pair that was read. A pair that cannot be read is noted as having no picture."""
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
    """Nothing: pictures are made once they are asked for."""


def unregister() -> None:
    """Stop making pictures, and remove the existing ones."""
    cancel_call(make_next)
    if _PictureQueue.job is not None:
        _PictureQueue.job.close()
    _PictureQueue.job = _PictureQueue.pair = None
    _PictureQueue.waiting, _PictureQueue.failed = (), frozenset()
    _pictures.remove()
    _about.clear()

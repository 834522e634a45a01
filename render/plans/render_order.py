"""Orders pairs so that as little as possible is rebuilt from one pair to the next. Imports no Blender.

The costly changes come first: another scene builds ground and rocks and Cycles' tree of triangles; another surface,
light or lander builds that tree; another camera builds nothing.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from itertools import groupby, pairwise

from ...settings import rebuilt_parts
from ...settings.topics.declaration import Parts
from ...settings.topics.scene import Settings
from ...support.system import count_processors
from .planned_pair import PlannedPair

_PARTS_BY_COST: tuple[Callable[[Settings], Parts], ...] = (
    rebuilt_parts.select_scene,
    rebuilt_parts.select_appearance,
    rebuilt_parts.select_light,
    rebuilt_parts.select_lander,
    rebuilt_parts.select_camera,
    rebuilt_parts.select_sampling,
)
#: Jobs per worker into which a data set is cut, so that all workers end at about the same time.
_JOBS_PER_WORKER = 4
#: Default of the most scenes that one process renders.
DEFAULT_MAX_SCENES = 50
#: Default of the processors for each worker: sampling scales well to this number of threads.
_PROCESSORS_PER_WORKER = 4


def choose_worker_count() -> int:
    """Choose the default number of workers that render a data set on this machine."""
    return max(1, count_processors() // _PROCESSORS_PER_WORKER)


def make_settings_key(part: Callable[[Settings], Parts], pair: PlannedPair) -> str:
    """Make a text that is equal for pairs that agree in a part of their settings, such as
    ``rebuilt_parts.select_scene``."""
    return json.dumps(part(pair.settings))


def order_pairs(pairs: Sequence[PlannedPair]) -> list[PlannedPair]:
    """Order the pairs, each once, so that scenes change least, then surfaces, lights, landers and cameras.

    Within a stage the order follows the plan, whichever pairs are complete.
    """
    pairs = list({pair.id: pair for pair in pairs}.values())
    keys = [tuple(make_settings_key(stage, pair) for stage in _PARTS_BY_COST) for pair in pairs]
    ranks = [{text: rank for rank, text in enumerate(dict.fromkeys(column))} for column in zip(*keys, strict=True)]
    places = [tuple(rank[text] for rank, text in zip(ranks, texts, strict=True)) for texts in keys]
    return [pairs[k] for k in sorted(range(len(pairs)), key=places.__getitem__)]


def split_into_scene_runs(pairs: Sequence[PlannedPair]) -> list[list[PlannedPair]]:
    """Split ordered pairs into runs that share a scene."""
    return [list(run) for _, run in groupby(pairs, lambda pair: make_settings_key(rebuilt_parts.select_scene, pair))]


def cut_into_jobs(pairs: Sequence[PlannedPair], workers: int, most_scenes: int) -> list[list[PlannedPair]]:
    """Cut ordered pairs into runs of similar length, one for each job.

    A run ends with a scene, unless the scene has enough pairs for several workers. A process renders at most
    ``most_scenes`` scenes.
    """
    length = -(-len(pairs) // (workers * _JOBS_PER_WORKER))
    found: list[list[PlannedPair]] = []
    held = 0  # number of scenes in the last run
    for scene in split_into_scene_runs(pairs):
        for start in range(0, len(scene), 2 * length):
            piece = scene[start : start + 2 * length]
            if found and held < most_scenes and len(found[-1]) + len(piece) <= length:
                found[-1] += piece
                held += 1
            else:
                found.append(piece)
                held = 1
    return found


def choose_shard(pairs: Sequence[PlannedPair], number: int, count: int) -> list[PlannedPair]:
    """Choose the pairs of shard ``number`` (from 1) of ``count``, in order: runs of about equal length.

    Shards have whole scenes if there are enough. All shards together are all pairs.
    """
    units = split_into_scene_runs(pairs)
    if len(units) < count:
        units = [[pair] for pair in pairs]
    ends = [0]
    for unit in units:
        ends.append(ends[-1] + len(unit))
    # A scene belongs to the shard that contains its middle.
    middles = [(a + b) / 2 / len(pairs) for a, b in pairwise(ends)]
    return [
        pair for unit, middle in zip(units, middles, strict=True) if int(middle * count) == number - 1 for pair in unit
    ]

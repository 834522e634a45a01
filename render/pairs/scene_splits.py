"""Which scene a pair is of, and which split of a data set: pairs of one ground are never in two splits."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping

from ...errors import IcyMoonError
from ...settings import pair_ids
from ...settings.table import TOPICS
from .pair_folder import Pair

#: Shares of the scenes in each split.
SPLITS = {"train": 0.8, "val": 0.1, "test": 0.1}


def scene_of(pair: Pair) -> str:
    """A name of the ground and the rocks of a pair: twelve hexadecimal digits, of what their shape depends on.

    The seed is a part of it. Surfaces, light, cameras and qualities are not: another Sun makes no other scene.
    """
    own = pair.id if pair.data.get("edited_by_hand") else pair.data.get("own_files_sha256", "")
    # As ids are made: a setting that a later version adds moves no scene into another split.
    shape = [[name, value] for part in pair_ids.counted(pair.settings) for name, value in part if _is_shape(name)]
    return hashlib.sha256(json.dumps([shape, own], sort_keys=True).encode()).hexdigest()[:12]


def _is_shape(name: str) -> bool:
    """Whether the shape of ground and rocks depends on a setting, or on an entry of its list."""
    topic, key, *_ = re.split(r"[. ]", pair_ids.present_name(name))
    return topic in TOPICS and any(s.key == key and s.effect == "geometry" for s in TOPICS[topic].settings)


def check_splits(splits: Mapping[str, float]) -> dict[str, float]:
    """The shares of splits, whose sum is 1. Raises IcyMoonError for others."""
    if not splits or min(splits.values()) < 0 or abs(sum(splits.values()) - 1) > 1e-6:
        shown = ", ".join(f"{name} {share:g}" for name, share in splits.items())
        raise IcyMoonError(f"The splits are {shown or 'none'}; give each a share of the scenes, 1 in all.")
    return dict(splits)


def split_of(scene: str, splits: Mapping[str, float]) -> str:
    """The split that a scene is in: drawn by its name, so that it stays there whatever else a data set contains.

    The shares are those of many scenes; of a few, a split may get none.
    """
    drawn = int(hashlib.sha256(f"split {scene}".encode()).hexdigest()[:12], 16) / 16**12
    end = 0.0
    for name, share in splits.items():
        end += share
        if drawn < end:
            return name
    return next(name for name, share in reversed(list(splits.items())) if share > 0)

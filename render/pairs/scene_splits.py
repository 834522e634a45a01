"""Which scene a pair is of, and which split of a data set: pairs of one ground are never in two splits."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path

from ...settings import pair_ids
from ...settings.table import TOPICS
from ...support.errors import IcyMoonError
from ...support.files import quote
from ...support.foreign_bytes import ForeignBytes, parse_json, parse_toml, read
from .pair_folder import Pair

_NAME = re.compile(r"[A-Za-z0-9_-]+")
#: Shares of the scenes in each split.
SPLITS = {"train": 0.8, "val": 0.1, "test": 0.1}


def name_scene(pair: Pair) -> str:
    """A name of the ground and the rocks of a pair: twelve hexadecimal digits, of what their shape depends on.

    The seed is a part of it. Surfaces, light, cameras and qualities are not: another Sun makes no other scene.
    """
    own = pair.id if pair.data.get("edited_by_hand") else pair.data.get("own_files_sha256", "")
    # As ids are made: a setting that a later version adds moves no scene into another split.
    shape = [
        [name, value]
        for part in pair_ids.list_counted_values(pair.settings)
        for name, value in part
        if _changes_shape(name)
    ]
    return hashlib.sha256(json.dumps([shape, own], sort_keys=True).encode()).hexdigest()[:12]


def _changes_shape(name: str) -> bool:
    """Whether the shape of ground and rocks depends on a setting, or on an entry of its list."""
    topic, key, *_ = re.split(r"[. ]", pair_ids.find_present_name(name))
    return topic in TOPICS and any(s.key == key and s.effect == "geometry" for s in TOPICS[topic].settings)


def check_splits(splits: object) -> dict[str, float]:
    """The shares of splits, whose sum is 1. Raises IcyMoonError for others."""
    if not isinstance(splits, Mapping) or any(
        isinstance(share, bool) or not isinstance(share, int | float) for share in splits.values()
    ):
        raise IcyMoonError(f"The splits are {quote(splits)}; give each a share of the scenes, such as train = 0.9.")
    if bad := next((name for name in splits if not _NAME.fullmatch(name)), None):
        raise IcyMoonError(
            f"A split is called {quote(bad)}; use letters, digits, - and _ only, since files are named so."
        )
    if not splits or min(splits.values()) < 0 or abs(sum(splits.values()) - 1) > 1e-6:
        shown = ", ".join(f"{name} {share:g}" for name, share in splits.items())
        raise IcyMoonError(f"The splits are {shown or 'none'}; give each a share of the scenes, 1 in all.")
    return dict(splits)


def read_splits(dataset: Path) -> dict[str, float]:
    """The shares of splits that the plan of a data set states; ``SPLITS`` if it states none or there is no plan.

    Raises IcyMoonError for a plan that states invalid shares.
    """
    try:
        text = read(dataset / "plan.jsonl", _parse_plan, "a list of planned pairs", "")
        stated = parse_toml(text).get("plan", {}).get("splits")
    except (IcyMoonError, ValueError, AttributeError):
        return SPLITS
    try:
        return SPLITS if stated is None else check_splits(stated)
    except IcyMoonError as error:
        raise IcyMoonError(f"{dataset / 'plan.jsonl'}: {error}") from None


def _parse_plan(foreign: ForeignBytes) -> str:
    """The text of the plan in the first line of the list of its pairs."""
    for most in (2**16, 2**21, 2**26):  # it is asked for each pair, and the list may be long
        first, end, _ = foreign.part(0, min(most, foreign.size)).partition(b"\n")
        if end or foreign.size <= most:
            return str(parse_json(first)["plan"])
    raise ValueError("its first line has no end")


def find_split_of_pair(pair: Pair) -> str:
    """The split of a pair, by the shares that the plan of its data set states."""
    return choose_split(name_scene(pair), read_splits(pair.folder.parent.parent))


def choose_split(scene: str, splits: Mapping[str, float]) -> str:
    """The split that a scene is in: drawn by its name, so that it stays there whatever else a data set contains.

    The shares hold for many scenes; with a few scenes, a split may stay empty.
    """
    drawn = int(hashlib.sha256(f"split {scene}".encode()).hexdigest()[:12], 16) / 16**12
    end = 0.0
    for name, share in splits.items():
        end += share
        if drawn < end:
            return name
    return next(name for name, share in reversed(list(splits.items())) if share > 0)
